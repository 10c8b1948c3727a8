/* LCM datagrams and the check before decoding. tests/system/test_lcm_datagrams.c holds the same
 * functions against LCM itself. */
#include <limits.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "dse/wire.h"

#define COUNT(array) ((int)(sizeof(array) / sizeof(array)[0]))

static const uint8_t reference[] = {'L', 'C', '0', '2', 0x01, 0x02, 0x83, 0x04, 'D', 'S',
                                    'E', '_', 'X', 0,   0xde, 0xad, 0x00, 0xbe, 0xef};
static const uint8_t reference_payload[] = {0xde, 0xad, 0x00, 0xbe, 0xef};

/* A copy of exactly `length` bytes on the heap, so that AddressSanitizer sees one byte too many. */
static uint8_t *exact_copy(const uint8_t *bytes, int length)
{
    uint8_t *copy = malloc(length > 0 ? (size_t)length : 1);
    assert_non_null(copy);
    memcpy(copy, bytes, (size_t)length);
    return copy;
}

static void encoding_gives_the_bytes_of_the_protocol(void **state)
{
    (void)state;
    uint8_t datagram[64];
    int length = 0;
    assert_int_equal(dse_wire_encode(0x01028304, "DSE_X", reference_payload,
                                     COUNT(reference_payload), datagram, COUNT(datagram), &length),
                     DSE_OK);
    assert_int_equal(length, COUNT(reference));
    assert_memory_equal(datagram, reference, sizeof reference);
}

static void decoding_takes_the_bytes_of_the_protocol_apart(void **state)
{
    (void)state;
    struct dse_wire_message message;
    assert_int_equal(dse_wire_decode(reference, COUNT(reference), &message), DSE_WIRE_OK);
    assert_true(message.sequence == 0x01028304);
    assert_string_equal(message.channel, "DSE_X");
    assert_int_equal(message.channel_length, 5);
    assert_int_equal(message.payload_length, COUNT(reference_payload));
    assert_memory_equal(message.payload, reference_payload, sizeof reference_payload);
}

static void what_is_encoded_decodes_for_every_channel_and_payload_length(void **state)
{
    (void)state;
    uint8_t payload[300];
    uint8_t datagram[400];
    char channel[DSE_WIRE_MAX_CHANNEL + 1];
    for (int i = 0; i < COUNT(payload); i++)
        payload[i] = (uint8_t)(31 * i + 7);
    for (int name = 1; name <= DSE_WIRE_MAX_CHANNEL; name++) {
        memset(channel, 'c', (size_t)name);
        channel[name] = '\0';
        for (int size = 0; size <= COUNT(payload); size += 23) {
            uint32_t sequence = 0xfffffff0u + (uint32_t)size;
            int length = 0;
            struct dse_wire_message message;
            assert_int_equal(dse_wire_encode(sequence, channel, payload, size, datagram,
                                             COUNT(datagram), &length),
                             DSE_OK);
            assert_int_equal(dse_wire_decode(datagram, length, &message), DSE_WIRE_OK);
            assert_true(message.sequence == sequence);
            assert_string_equal(message.channel, channel);
            assert_int_equal(message.channel_length, name);
            assert_int_equal(message.payload_length, size);
            assert_memory_equal(message.payload, payload, (size_t)size);
        }
    }
}

static void a_payload_already_in_place_is_not_touched(void **state)
{
    (void)state;
    uint8_t datagram[sizeof reference] = {0};
    uint8_t *payload = datagram + DSE_WIRE_PAYLOAD_OFFSET(5);
    int length = 0;
    memcpy(payload, reference_payload, sizeof reference_payload);
    assert_int_equal(dse_wire_encode(0x01028304, "DSE_X", payload, COUNT(reference_payload),
                                     datagram, COUNT(datagram), &length),
                     DSE_OK);
    assert_int_equal(length, COUNT(reference));
    assert_memory_equal(datagram, reference, sizeof reference);
}

static void every_truncation_is_refused_or_shortens_the_payload(void **state)
{
    (void)state;
    const int payload_offset = DSE_WIRE_PAYLOAD_OFFSET(5);
    for (int length = 0; length < COUNT(reference); length++) {
        uint8_t *bytes = exact_copy(reference, length);
        struct dse_wire_message message = {.payload_length = -77};
        enum dse_wire_verdict verdict = dse_wire_decode(bytes, length, &message);
        if (length < payload_offset) {
            assert_int_equal(verdict, DSE_WIRE_TOO_SHORT);
            assert_int_equal(message.payload_length, -77);
        } else {
            assert_int_equal(verdict, DSE_WIRE_OK);
            assert_int_equal(message.payload_length, length - payload_offset);
        }
        free(bytes);
    }
}

/* The header of a fragment is longer; a receiver must not even look for a channel in it. */
static void fragments_and_strangers_have_verdicts_of_their_own(void **state)
{
    (void)state;
    static const struct {
        const char *magic;
        enum dse_wire_verdict verdict;
    } cases[] = {
        {"LC03", DSE_WIRE_FRAGMENT}, {"LC01", DSE_WIRE_NOT_LCM}, {"LC04", DSE_WIRE_NOT_LCM},
        {"20CL", DSE_WIRE_NOT_LCM},  {"lc02", DSE_WIRE_NOT_LCM}, {"HTTP", DSE_WIRE_NOT_LCM},
        {"MC02", DSE_WIRE_NOT_LCM},
    };
    for (int i = 0; i < COUNT(cases); i++) {
        struct dse_wire_message message;
        uint8_t *bytes = exact_copy(reference, COUNT(reference));
        memcpy(bytes, cases[i].magic, 4);
        assert_int_equal(dse_wire_decode(bytes, COUNT(reference), &message), cases[i].verdict);
        assert_int_equal(dse_wire_decode(bytes, DSE_WIRE_HEADER_BYTES, &message), cases[i].verdict);
        free(bytes);
    }
}

static void channels_outside_1_to_63_bytes_are_refused_both_ways(void **state)
{
    (void)state;
    for (int name = 0; name <= 200; name += name < 62 ? 31 : 1) {
        bool good = name >= 1 && name <= DSE_WIRE_MAX_CHANNEL;
        char channel[201];
        memset(channel, 'x', (size_t)name);
        channel[name] = '\0';

        uint8_t bytes[DSE_WIRE_PAYLOAD_OFFSET(200)];
        memcpy(bytes, reference, DSE_WIRE_HEADER_BYTES);
        memcpy(bytes + DSE_WIRE_HEADER_BYTES, channel, (size_t)name + 1);
        struct dse_wire_message message;
        assert_int_equal(dse_wire_decode(bytes, DSE_WIRE_PAYLOAD_OFFSET(name), &message),
                         good ? DSE_WIRE_OK : DSE_WIRE_BAD_CHANNEL);

        int length = -1;
        assert_int_equal(dse_wire_encode(0, channel, NULL, 0, bytes, COUNT(bytes), &length),
                         good ? DSE_OK : DSE_EINVAL);
        assert_int_equal(length, good ? DSE_WIRE_PAYLOAD_OFFSET(name) : -1);
    }
}

/* Neither a truncated nor an overlong name makes the decoder read beyond the datagram. */
static void a_channel_without_end_is_refused_within_the_datagram(void **state)
{
    (void)state;
    uint8_t endless[200];
    memset(endless, 'x', sizeof endless);
    memcpy(endless, reference, DSE_WIRE_HEADER_BYTES);
    for (int length = DSE_WIRE_HEADER_BYTES; length <= COUNT(endless); length++) {
        uint8_t *bytes = exact_copy(endless, length);
        struct dse_wire_message message;
        bool could_still_end = length - DSE_WIRE_HEADER_BYTES <= DSE_WIRE_MAX_CHANNEL;
        assert_int_equal(dse_wire_decode(bytes, length, &message),
                         could_still_end ? DSE_WIRE_TOO_SHORT : DSE_WIRE_BAD_CHANNEL);
        free(bytes);
    }
}

static void encoding_never_writes_beyond_the_capacity(void **state)
{
    (void)state;
    for (int capacity = 0; capacity <= COUNT(reference); capacity++) {
        uint8_t *datagram = malloc(capacity > 0 ? (size_t)capacity : 1);
        assert_non_null(datagram);
        int length = -1;
        enum dse_status status = dse_wire_encode(
            1, "DSE_X", reference_payload, COUNT(reference_payload), datagram, capacity, &length);
        assert_int_equal(status, capacity < COUNT(reference) ? DSE_ESTORAGE : DSE_OK);
        assert_int_equal(length, capacity < COUNT(reference) ? -1 : COUNT(reference));
        free(datagram);
    }
}

static void encoding_refuses_impossible_lengths(void **state)
{
    (void)state;
    static uint8_t datagram[DSE_WIRE_MAX_DATAGRAM + 1];
    static uint8_t payload[DSE_WIRE_MAX_DATAGRAM];
    const int largest = DSE_WIRE_MAX_DATAGRAM - DSE_WIRE_PAYLOAD_OFFSET(1);
    static const struct {
        int extra; /* beyond the largest payload; negative numbers stand for themselves */
        int capacity;
        enum dse_status status;
    } cases[] = {
        {0, DSE_WIRE_MAX_DATAGRAM + 1, DSE_OK},
        {1, DSE_WIRE_MAX_DATAGRAM + 1, DSE_ESTORAGE},
        {INT_MAX - DSE_WIRE_MAX_DATAGRAM, DSE_WIRE_MAX_DATAGRAM, DSE_ESTORAGE},
        {-1, DSE_WIRE_MAX_DATAGRAM, DSE_EINVAL},
        {INT_MIN, DSE_WIRE_MAX_DATAGRAM, DSE_EINVAL},
        {0, -1, DSE_EINVAL},
        {0, INT_MIN, DSE_EINVAL},
    };
    for (int i = 0; i < COUNT(cases); i++) {
        int size = cases[i].extra < 0 ? cases[i].extra : largest + cases[i].extra;
        int length = -1;
        assert_int_equal(
            dse_wire_encode(1, "X", payload, size, datagram, cases[i].capacity, &length),
            cases[i].status);
        assert_int_equal(length, cases[i].status == DSE_OK ? DSE_WIRE_MAX_DATAGRAM : -1);
    }
}

static void only_the_right_type_and_size_pass_the_check(void **state)
{
    (void)state;
    static const uint8_t message[16] = {0x81, 0x02, 0x03, 0x04, 0x85, 0x06, 0x07, 0x08, 9};
    const uint64_t fingerprint = 0x8102030485060708u;
    static const struct {
        int length;
        int expected_size;
        uint64_t fingerprint_change;
        enum dse_wire_verdict verdict;
    } cases[] = {
        {16, 16, 0, DSE_WIRE_OK},
        {8, 8, 0, DSE_WIRE_OK},
        {15, 16, 0, DSE_WIRE_WRONG_LENGTH},
        {16, 15, 0, DSE_WIRE_WRONG_LENGTH},
        {8, 16, 0, DSE_WIRE_WRONG_LENGTH},
        {16, 16, 1, DSE_WIRE_WRONG_TYPE},
        {16, 16, 1ull << 63, DSE_WIRE_WRONG_TYPE},
        {16, 16, 1ull << 32, DSE_WIRE_WRONG_TYPE},
        {16, 16, 1ull << 31, DSE_WIRE_WRONG_TYPE},
        {15, 16, 1, DSE_WIRE_WRONG_TYPE},
        {7, 16, 0, DSE_WIRE_TOO_SHORT},
        {7, 7, 0, DSE_WIRE_TOO_SHORT},
        {0, 16, 0, DSE_WIRE_TOO_SHORT},
        {-1, 16, 0, DSE_WIRE_TOO_SHORT},
    };
    for (int i = 0; i < COUNT(cases); i++) {
        int length = cases[i].length;
        uint8_t *bytes = exact_copy(message, length > 0 ? length : 0);
        assert_int_equal(dse_wire_check(bytes, length, fingerprint ^ cases[i].fingerprint_change,
                                        cases[i].expected_size),
                         cases[i].verdict);
        free(bytes);
    }
}

static void every_verdict_has_a_text_of_its_own(void **state)
{
    (void)state;
    const char *unknown = dse_wire_verdict_text((enum dse_wire_verdict)99);
    assert_non_null(unknown);
    for (int i = DSE_WIRE_OK; i <= DSE_WIRE_BAD_CHANNEL; i++) {
        assert_string_not_equal(dse_wire_verdict_text((enum dse_wire_verdict)i), unknown);
        for (int j = 0; j < i; j++)
            assert_string_not_equal(dse_wire_verdict_text((enum dse_wire_verdict)i),
                                    dse_wire_verdict_text((enum dse_wire_verdict)j));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(encoding_gives_the_bytes_of_the_protocol),
        cmocka_unit_test(decoding_takes_the_bytes_of_the_protocol_apart),
        cmocka_unit_test(what_is_encoded_decodes_for_every_channel_and_payload_length),
        cmocka_unit_test(a_payload_already_in_place_is_not_touched),
        cmocka_unit_test(every_truncation_is_refused_or_shortens_the_payload),
        cmocka_unit_test(fragments_and_strangers_have_verdicts_of_their_own),
        cmocka_unit_test(channels_outside_1_to_63_bytes_are_refused_both_ways),
        cmocka_unit_test(a_channel_without_end_is_refused_within_the_datagram),
        cmocka_unit_test(encoding_never_writes_beyond_the_capacity),
        cmocka_unit_test(encoding_refuses_impossible_lengths),
        cmocka_unit_test(only_the_right_type_and_size_pass_the_check),
        cmocka_unit_test(every_verdict_has_a_text_of_its_own),
    };
    return cmocka_run_group_tests_name("wire", tests, NULL, NULL);
}
