/* Any bytes as a message of any type: a refusal is counted, and what is taken keeps every promise
 * of runtime/messages.h.
 *
 * Input: byte 0 chooses the type, byte 1 what the rest is: (0) the whole message, (1) its fields,
 * (2) its fields for the size of the type, with zeros behind or cut. With 1 and 2 the fingerprint
 * is put before them, so that the checks behind it are reached whatever the types' fingerprints
 * are.
 */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "dse/plant.h"
#include "dse/wire.h"
#include "runtime/messages.h"

#define COUNT(array) ((int)(sizeof(array) / sizeof(array)[0]))

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

union any {
    dse_header_t header; /* the first member of every message */
    dse_clock_t clock;
    dse_done_t done;
    dse_estimate_t estimate;
    dse_exchange_t exchange;
    dse_input_t input;
    dse_measurement_t measurement;
    dse_run_info_t run_info;
    dse_status_t status;
    dse_truth_t truth;
};

static void require(bool condition)
{
    if (!condition)
        abort();
}

static void require_header(const dse_header_t *header)
{
    require(isfinite(header->plant_time));
    require(header->sample >= -1 && header->round >= 0);
    require(header->role >= DSE_HEADER_T_ROLE_PLANT && header->role <= DSE_HEADER_T_ROLE_RUN);
}

static void require_part(int part, int parts, int max_parts, int count, int capacity)
{
    require(part >= 0 && part < parts && parts <= max_parts);
    require(count >= 0 && count <= capacity && (part == parts - 1 || count == capacity));
}

/* Finite where the channel is valid (all are, without flags), and fit for the receiver's next step:
 * collecting the parts in a vector of the largest plant. */
static void require_values(int part, int parts, int count, const double *value, const int8_t *valid)
{
    double storage[DSE_PLANT_MAX_STATES];
    struct message_vector vector = {.value = storage, .capacity = DSE_PLANT_MAX_STATES};
    require_part(part, parts, MESSAGE_MAX_PARTS, count, DSE_INPUT_T_CAPACITY);
    for (int i = 0; i < count; i++)
        require(isfinite(value[i]) || (valid != NULL && valid[i] == 0));
    message_vector_reset(&vector);
    bool added = message_vector_add(&vector, part, parts, count, value);
    require(message_vector_complete(&vector) == (added && parts == 1));
    require(vector.count >= 0 && vector.count <= vector.capacity);
}

/* ---- the types ---- */

/* These promise no more than their header. */
static void keep_clock(const dse_clock_t *message)
{
    (void)message;
}

static void keep_done(const dse_done_t *message)
{
    (void)message;
}

static void keep_status(const dse_status_t *message)
{
    require(message->reason_length >= 0 && message->reason_length <= (int)sizeof message->reason);
}

static void keep_run_info(const dse_run_info_t *message)
{
    require_part(message->part, message->parts, MESSAGE_MAX_TEXT_PARTS, message->count,
                 DSE_RUN_INFO_T_CAPACITY);
}

static void keep_input(const dse_input_t *message)
{
    require_values(message->part, message->parts, message->count, message->value, NULL);
}

static void keep_truth(const dse_truth_t *message)
{
    require_values(message->part, message->parts, message->count, message->value, NULL);
}

static void keep_exchange(const dse_exchange_t *message)
{
    require_values(message->part, message->parts, message->count, message->value, NULL);
}

static void keep_measurement(const dse_measurement_t *message)
{
    require_values(message->part, message->parts, message->count, message->value, message->valid);
}

static void keep_estimate(const dse_estimate_t *message)
{
    require_part(message->part, message->parts, MESSAGE_MAX_PARTS, message->count,
                 DSE_ESTIMATE_T_CAPACITY);
    require(message->diagnostics >= 0 && message->diagnostics <= DSE_ESTIMATE_T_DIAGNOSTICS);
}

/* The same three functions for every type, with one signature. */
#define TYPE(name)                                                                                 \
    static bool take_##name(const uint8_t *bytes, int length, struct message_counters *counters,   \
                            union any *any)                                                        \
    {                                                                                              \
        if (!message_##name(bytes, length, counters, &any->name))                                  \
            return false;                                                                          \
        keep_##name(&any->name);                                                                   \
        return true;                                                                               \
    }                                                                                              \
    static int size_##name(const union any *any)                                                   \
    {                                                                                              \
        return dse_##name##_t_encoded_size(&any->name);                                            \
    }                                                                                              \
    static int write_##name(const union any *any, uint8_t *bytes)                                  \
    {                                                                                              \
        return dse_##name##_t_encode(bytes, 0, MESSAGE_MAX_BYTES, &any->name);                     \
    }
TYPE(clock)
TYPE(done)
TYPE(estimate)
TYPE(exchange)
TYPE(input)
TYPE(measurement)
TYPE(run_info)
TYPE(status)
TYPE(truth)

static const struct {
    bool (*take)(const uint8_t *, int, struct message_counters *, union any *);
    int (*size)(const union any *);
    int (*write)(const union any *, uint8_t *);
    int64_t (*fingerprint)(void);
    bool corrects; /* marks channels invalid and counts them instead of refusing the message */
} types[] = {
#define ROW(name) take_##name, size_##name, write_##name, __dse_##name##_t_get_hash
    {ROW(clock), false},    {ROW(done), false},   {ROW(estimate), false},
    {ROW(exchange), false}, {ROW(input), false},  {ROW(measurement), true},
    {ROW(run_info), false}, {ROW(status), false}, {ROW(truth), false},
};

/* ---- one input ---- */

static void put_fingerprint(int type, uint8_t *bytes)
{
    const uint64_t fingerprint = (uint64_t)types[type].fingerprint();
    for (int i = 0; i < DSE_WIRE_FINGERPRINT_BYTES; i++)
        bytes[i] = (uint8_t)(fingerprint >> (56 - 8 * i));
}

static int smaller(int a, int b)
{
    return a < b ? a : b;
}

/* `bytes` has exactly `length` bytes, so that the sanitizer sees every read beyond them. */
static void offer(int type, const uint8_t *bytes, int length)
{
    union any message;
    uint8_t again[MESSAGE_MAX_BYTES];
    struct message_counters counters = {0};
    const bool taken = types[type].take(bytes, length, &counters, &message);
    const int64_t counted = counters.refused_hash + counters.refused_length +
                            counters.refused_count + counters.refused_nonfinite;
    require(counters.foreign_run == 0 && counters.duplicates == 0 && counters.gaps == 0);
    require(taken ? counted == 0 || types[type].corrects : counted > 0);
    if (!taken)
        return;
    require_header(&message.header);
    require(types[type].write(&message, again) == length);
    require(counted > 0 || memcmp(again, bytes, (size_t)length) == 0);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const union any zero;
    if (size < 2 || size > 4096)
        return 0;
    const int type = data[0] % COUNT(types);
    const int form = data[1] % 3;
    const int rest = (int)size - 2;
    const int front = form == 0 ? 0 : DSE_WIRE_FINGERPRINT_BYTES;
    const int length = form == 2 ? types[type].size(&zero) : front + rest;
    uint8_t *bytes = calloc(length > 0 ? (size_t)length : 1, 1);
    require(bytes != NULL);
    if (form != 0)
        put_fingerprint(type, bytes);
    memcpy(bytes + front, data + 2, (size_t)smaller(rest, length - front));
    offer(type, bytes, length);
    free(bytes);
    return 0;
}
