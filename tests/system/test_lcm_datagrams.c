/* dse/wire.h against LCM itself: what it encodes, LCM delivers; what LCM sends, it decodes.
 *
 * Multicast with TTL 0 on a port that the kernel picks: nothing leaves the machine, and no other
 * LCM network is disturbed. Datagrams may be lost, so everything is sent again until it arrives or
 * the time is up. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cmocka.h>
#include <lcm/lcm.h>

#include "dse/wire.h"
#include "dse_clock_t.h"

#define COUNT(array) ((int)(sizeof(array) / sizeof(array)[0]))
#define GROUP        "239.255.76.67"
#define PATIENCE_S   10.0
#define REPEAT_MS    100

struct network {
    int socket; /* both sends and receives, without LCM */
    struct sockaddr_in group;
    lcm_t *lcm;
    uint8_t datagram[DSE_WIRE_MAX_DATAGRAM];
};

static double now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

/* Our own member of the group, on a port that was free. */
static bool open_socket(struct network *network)
{
    const int yes = 1;
    const unsigned char ttl = 0;
    socklen_t size = sizeof network->group;
    struct ip_mreq membership = {.imr_interface.s_addr = htonl(INADDR_ANY)};
    inet_pton(AF_INET, GROUP, &membership.imr_multiaddr);
    network->group =
        (struct sockaddr_in){.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_ANY)};
    network->socket = socket(AF_INET, SOCK_DGRAM, 0);
    const int fd = network->socket;
    if (fd < 0 || setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes) != 0 ||
        bind(fd, (struct sockaddr *)&network->group, size) != 0 ||
        getsockname(fd, (struct sockaddr *)&network->group, &size) != 0 ||
        setsockopt(fd, IPPROTO_IP, IP_ADD_MEMBERSHIP, &membership, sizeof membership) != 0 ||
        setsockopt(fd, IPPROTO_IP, IP_MULTICAST_TTL, &ttl, sizeof ttl) != 0)
        return false;
    network->group.sin_addr = membership.imr_multiaddr;
    return true;
}

static int start(void **state)
{
    struct network *network = calloc(1, sizeof *network);
    if (network == NULL)
        return -1;
    *state = network;
    if (!open_socket(network)) {
        perror("this machine has no multicast");
        return -1;
    }
    char url[64];
    snprintf(url, sizeof url, "udpm://" GROUP ":%d?ttl=0", ntohs(network->group.sin_port));
    network->lcm = lcm_create(url);
    return network->lcm != NULL ? 0 : -1;
}

static int stop(void **state)
{
    struct network *network = *state;
    lcm_destroy(network->lcm);
    close(network->socket);
    free(network);
    return 0;
}

/* ---- to LCM ---- */

struct delivery {
    int count;
    char channel[DSE_WIRE_MAX_CHANNEL + 1];
    uint8_t bytes[512];
    int size;
};

static void deliver(const lcm_recv_buf_t *buffer, const char *channel, void *user)
{
    struct delivery *delivery = user;
    delivery->count++;
    snprintf(delivery->channel, sizeof delivery->channel, "%s", channel);
    delivery->size = (int)buffer->data_size;
    if (buffer->data_size <= sizeof delivery->bytes)
        memcpy(delivery->bytes, buffer->data, buffer->data_size);
}

/* Sends until LCM has delivered; false when it never does. */
static bool send_until_delivered(struct network *network, const char *channel,
                                 const uint8_t *payload, int size, struct delivery *delivery)
{
    *delivery = (struct delivery){0};
    lcm_subscription_t *subscription = lcm_subscribe(network->lcm, channel, deliver, delivery);
    assert_non_null(subscription);
    const double end = now() + PATIENCE_S;
    for (uint32_t sequence = 0; delivery->count == 0 && now() < end; sequence++) {
        int length = 0;
        assert_int_equal(dse_wire_encode(sequence, channel, payload, size, network->datagram,
                                         COUNT(network->datagram), &length),
                         DSE_OK);
        assert_int_equal(sendto(network->socket, network->datagram, (size_t)length, 0,
                                (struct sockaddr *)&network->group, sizeof network->group),
                         length);
        assert_true(lcm_handle_timeout(network->lcm, REPEAT_MS) >= 0);
    }
    lcm_unsubscribe(network->lcm, subscription);
    return delivery->count > 0;
}

static void lcm_delivers_a_message_that_dse_wire_encoded(void **state)
{
    struct network *network = *state;
    dse_clock_t sent;
    memset(&sent, 0, sizeof sent);
    sent.header.run_id = INT64_C(0x0102030405060708);
    sent.header.plant_time = 0.25;
    uint8_t payload[512];
    const int size = dse_clock_t_encode(payload, 0, COUNT(payload), &sent);
    assert_true(size > 0);

    struct delivery delivery;
    assert_true(send_until_delivered(network, "DSE_CLOCK", payload, size, &delivery));
    assert_string_equal(delivery.channel, "DSE_CLOCK");
    assert_int_equal(delivery.size, size);
    assert_memory_equal(delivery.bytes, payload, (size_t)size);

    const uint64_t fingerprint = (uint64_t)__dse_clock_t_get_hash();
    assert_int_equal(
        dse_wire_check(delivery.bytes, delivery.size, fingerprint, dse_clock_t_encoded_size(&sent)),
        DSE_WIRE_OK);
    dse_clock_t received;
    assert_int_equal(dse_clock_t_decode(delivery.bytes, 0, delivery.size, &received), size);
    assert_true(received.header.run_id == sent.header.run_id);
}

static void lcm_takes_the_longest_channel_and_an_empty_payload(void **state)
{
    char channel[DSE_WIRE_MAX_CHANNEL + 1];
    memset(channel, 'c', DSE_WIRE_MAX_CHANNEL);
    channel[DSE_WIRE_MAX_CHANNEL] = '\0';
    struct delivery delivery;
    assert_true(send_until_delivered(*state, channel, NULL, 0, &delivery));
    assert_string_equal(delivery.channel, channel);
    assert_int_equal(delivery.size, 0);
}

/* ---- from LCM ---- */

/* Publishes until a datagram with that verdict has come; when it is OK, until it is the one. */
static bool publish_until_received(struct network *network, const char *channel,
                                   const uint8_t *payload, unsigned size,
                                   enum dse_wire_verdict verdict, struct dse_wire_message *message)
{
    struct pollfd incoming = {.fd = network->socket, .events = POLLIN};
    const double end = now() + PATIENCE_S;
    while (now() < end) {
        assert_int_equal(lcm_publish(network->lcm, channel, payload, size), 0);
        while (poll(&incoming, 1, REPEAT_MS) == 1) {
            ssize_t length = recv(network->socket, network->datagram, sizeof network->datagram, 0);
            assert_true(length >= 0);
            if (dse_wire_decode(network->datagram, (int)length, message) == verdict &&
                (verdict != DSE_WIRE_OK ||
                 (strcmp(message->channel, channel) == 0 && message->payload_length == (int)size)))
                return true;
        }
    }
    return false;
}

static void dse_wire_decodes_what_lcm_publishes(void **state)
{
    struct network *network = *state;
    uint8_t payload[1400];
    for (int i = 0; i < COUNT(payload); i++)
        payload[i] = (uint8_t)(7 * i + 3);
    static const unsigned sizes[] = {0, 1, 8, 1400};
    uint32_t last = 0;
    for (int i = 0; i < COUNT(sizes); i++) {
        struct dse_wire_message message;
        assert_true(
            publish_until_received(network, "DSE_INPUT", payload, sizes[i], DSE_WIRE_OK, &message));
        assert_memory_equal(message.payload, payload, sizes[i]);
        assert_true(i == 0 || message.sequence > last); /* one sender's counter */
        last = message.sequence;
    }
}

static void a_message_that_lcm_cuts_into_fragments_is_refused_as_such(void **state)
{
    struct network *network = *state;
    enum { LARGE = 2 * DSE_WIRE_MAX_DATAGRAM };
    uint8_t *payload = calloc(LARGE, 1);
    assert_non_null(payload);
    struct dse_wire_message message = {0};
    assert_true(
        publish_until_received(network, "DSE_INPUT", payload, LARGE, DSE_WIRE_FRAGMENT, &message));
    assert_null(message.channel);
    free(payload);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(lcm_delivers_a_message_that_dse_wire_encoded, start, stop),
        cmocka_unit_test_setup_teardown(lcm_takes_the_longest_channel_and_an_empty_payload, start,
                                        stop),
        cmocka_unit_test_setup_teardown(dse_wire_decodes_what_lcm_publishes, start, stop),
        cmocka_unit_test_setup_teardown(a_message_that_lcm_cuts_into_fragments_is_refused_as_such,
                                        start, stop),
    };
    return cmocka_run_group_tests_name("lcm datagrams", tests, NULL, NULL);
}
