/* Publishing with a header. */
#include "runtime/sender.h"

#include <stdio.h>
#include <string.h>

#include "runtime/channels.h"

int32_t sender_sequence(const struct sender *sender, enum sender_type type)
{
    return sender->sequence[type];
}

static dse_header_t header(struct sender *sender, enum sender_type type, int64_t k, double t,
                           int32_t sequence)
{
    dse_header_t made = sender->id;
    made.sample = k;
    made.plant_time = t;
    made.sequence = sequence;
    if (sequence < 0) {
        made.sequence = sender->sequence[type];
        sender->sequence[type] = made.sequence == INT32_MAX ? 0 : made.sequence + 1;
    }
    return made;
}

/* A message that the bus refuses is a lost message: whoever misses it asks for it. */
#define PUBLISH(sender, channel, type, message)                                                    \
    do {                                                                                           \
        uint8_t bytes[MESSAGE_MAX_BYTES];                                                          \
        int encoded = dse_##type##_t_encode(bytes, 0, (int)sizeof bytes, (message));               \
        if (encoded > 0)                                                                           \
            (void)bus_publish((sender)->bus, (channel), bytes, encoded);                           \
    } while (0)

void sender_clock(struct sender *sender, int64_t k, double t, dse_clock_t *message)
{
    message->header = header(sender, SENDER_CLOCK, k, t, -1);
    PUBLISH(sender, CHANNEL_CLOCK, clock, message);
}

void sender_status(struct sender *sender, int64_t k, double t, dse_status_t *message)
{
    message->header = header(sender, SENDER_STATUS, k, t, -1);
    PUBLISH(sender, CHANNEL_STATUS, status, message);
}

void sender_done(struct sender *sender, int64_t k, double t, dse_done_t *message)
{
    message->header = header(sender, SENDER_DONE, k, t, -1);
    PUBLISH(sender, CHANNEL_DONE, done, message);
}

static int32_t part_sequence(int32_t first, int part)
{
    return first >= 0 ? first + part : -1;
}

void sender_run_info(struct sender *sender, const char *json, int32_t sequence)
{
    size_t length = strlen(json);
    int16_t parts = (int16_t)((length + DSE_RUN_INFO_T_CAPACITY - 1) / DSE_RUN_INFO_T_CAPACITY);
    for (int16_t part = 0; part < parts; part++) {
        size_t offset = (size_t)part * DSE_RUN_INFO_T_CAPACITY;
        size_t count = length - offset;
        if (count > DSE_RUN_INFO_T_CAPACITY)
            count = DSE_RUN_INFO_T_CAPACITY;
        dse_run_info_t message = {.part = part, .parts = parts, .count = (int16_t)count};
        message.header = header(sender, SENDER_RUN_INFO, -1, 0, part_sequence(sequence, part));
        memcpy(message.text, json + offset, count);
        PUBLISH(sender, CHANNEL_RUN_INFO, run_info, &message);
    }
}

static void fill(double *to, const double *from, int count)
{
    if (count > 0)
        memcpy(to, from, (size_t)count * sizeof *to);
}

void sender_input(struct sender *sender, int64_t k, double t, int32_t sequence, const double *u,
                  int nu)
{
    int parts = message_parts(nu);
    for (int part = 0; part < parts; part++) {
        dse_input_t message = {.part = (int16_t)part, .parts = (int16_t)parts};
        message.header = header(sender, SENDER_INPUT, k, t, part_sequence(sequence, part));
        message.count = (int16_t)message_part_count(nu, part);
        fill(message.value, u + part * DSE_INPUT_T_CAPACITY, message.count);
        PUBLISH(sender, CHANNEL_INPUT, input, &message);
    }
}

void sender_truth(struct sender *sender, int64_t k, double t, const double *x, int nx)
{
    int parts = message_parts(nx);
    for (int part = 0; part < parts; part++) {
        dse_truth_t message = {.part = (int16_t)part, .parts = (int16_t)parts};
        message.header = header(sender, SENDER_TRUTH, k, t, -1);
        message.count = (int16_t)message_part_count(nx, part);
        fill(message.value, x + part * DSE_TRUTH_T_CAPACITY, message.count);
        PUBLISH(sender, CHANNEL_TRUTH, truth, &message);
    }
}

void sender_measurement(struct sender *sender, int64_t k, double t, int32_t sequence, int group,
                        int64_t measured_at, const double *y, const bool *valid, int ny)
{
    char channel[CHANNEL_LENGTH];
    snprintf(channel, sizeof channel, CHANNEL_MEASUREMENT, group);
    int parts = message_parts(ny);
    for (int part = 0; part < parts; part++) {
        int offset = part * DSE_MEASUREMENT_T_CAPACITY;
        dse_measurement_t message = {.part = (int16_t)part, .parts = (int16_t)parts};
        message.header = header(sender, SENDER_MEASUREMENT, k, t, part_sequence(sequence, part));
        message.header.node = (int16_t)group;
        message.measured_at = measured_at;
        message.count = (int16_t)message_part_count(ny, part);
        fill(message.value, y + offset, message.count);
        for (int i = 0; i < message.count; i++)
            message.valid[i] = (int8_t)(valid == NULL || valid[offset + i]);
        PUBLISH(sender, channel, measurement, &message);
    }
}

void sender_exchange(struct sender *sender, int64_t k, double t, int32_t sequence,
                     const struct sender_exchange *what)
{
    char channel[CHANNEL_LENGTH];
    snprintf(channel, sizeof channel, CHANNEL_EXCHANGE, sender->id.network, sender->id.node);
    int parts = message_parts(what->count);
    for (int part = 0; part < parts; part++) {
        dse_exchange_t message = {.part = (int16_t)part, .parts = (int16_t)parts};
        message.header = header(sender, SENDER_EXCHANGE, k, t, part_sequence(sequence, part));
        message.header.round = (int16_t)what->round;
        message.intent = (int8_t)what->intent;
        message.withheld = (int8_t)what->withheld;
        message.count = (int16_t)message_part_count(what->count, part);
        fill(message.value, what->value + part * DSE_EXCHANGE_T_CAPACITY, message.count);
        PUBLISH(sender, channel, exchange, &message);
    }
}

void sender_estimate(struct sender *sender, int64_t k, double t, const struct sender_estimate *what)
{
    char channel[CHANNEL_LENGTH];
    snprintf(channel, sizeof channel, CHANNEL_ESTIMATE, sender->id.network, sender->id.node);
    int parts = message_parts(what->count);
    for (int part = 0; part < parts; part++) {
        int offset = part * DSE_ESTIMATE_T_CAPACITY;
        dse_estimate_t message = {.part = (int16_t)part, .parts = (int16_t)parts};
        message.header = header(sender, SENDER_ESTIMATE, k, t, -1);
        message.health = (int8_t)what->health;
        message.count = (int16_t)message_part_count(what->count, part);
        message.diagnostics = (int16_t)what->diagnostics;
        fill(message.state, what->state + offset, message.count);
        fill(message.variance, what->variance + offset, message.count);
        fill(message.diagnostic, what->diagnostic, what->diagnostics);
        PUBLISH(sender, channel, estimate, &message);
    }
}
