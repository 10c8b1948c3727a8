/* Checks before decode. */
#include "runtime/messages.h"

#include <math.h>
#include <string.h>

#include "dse/wire.h"

#define PART_CAPACITY DSE_EXCHANGE_T_CAPACITY

_Static_assert(DSE_INPUT_T_CAPACITY == PART_CAPACITY && DSE_TRUTH_T_CAPACITY == PART_CAPACITY &&
                   DSE_MEASUREMENT_T_CAPACITY == PART_CAPACITY &&
                   DSE_ESTIMATE_T_CAPACITY == PART_CAPACITY,
               "vectors are cut into parts of one size");

static bool envelope_ok(const uint8_t *bytes, int length, int64_t fingerprint, int size,
                        struct message_counters *counters)
{
    switch (dse_wire_check(bytes, length, (uint64_t)fingerprint, size)) {
    case DSE_WIRE_OK:
        return true;
    case DSE_WIRE_WRONG_TYPE:
        counters->refused_hash++;
        return false;
    default:
        counters->refused_length++;
        return false;
    }
}

static bool header_ok(const dse_header_t *header, struct message_counters *counters)
{
    if (!isfinite(header->plant_time)) {
        counters->refused_nonfinite++;
        return false;
    }
    if (header->role < DSE_HEADER_T_ROLE_PLANT || header->role > DSE_HEADER_T_ROLE_RUN ||
        header->sample < -1 || header->round < 0 || header->node < 0 || header->network < -1) {
        counters->refused_count++;
        return false;
    }
    return true;
}

static bool count_ok(int part, int parts, int max_parts, int count, int capacity,
                     struct message_counters *counters)
{
    bool last = part == parts - 1;
    if (part >= 0 && part < parts && parts <= max_parts && count >= 0 && count <= capacity &&
        (last || count == capacity))
        return true;
    counters->refused_count++;
    return false;
}

static bool parts_ok(int part, int parts, int count, struct message_counters *counters)
{
    return count_ok(part, parts, MESSAGE_MAX_PARTS, count, PART_CAPACITY, counters);
}

static bool finite_ok(const double *value, int count, struct message_counters *counters)
{
    for (int i = 0; i < count; i++)
        if (!isfinite(value[i])) {
            counters->refused_nonfinite++;
            return false;
        }
    return true;
}

/* Fingerprint, length and header of one type; `extra` is its own condition on the decoded message.
 */
#define MESSAGE_TAKE(type, extra)                                                                  \
    bool message_##type(const uint8_t *bytes, int length, struct message_counters *counters,       \
                        dse_##type##_t *message)                                                   \
    {                                                                                              \
        int size = 8 + __dse_##type##_t_encoded_array_size(message, 1);                            \
        if (!envelope_ok(bytes, length, __dse_##type##_t_get_hash(), size, counters))              \
            return false;                                                                          \
        if (dse_##type##_t_decode(bytes, 0, length, message) < 0) {                                \
            counters->refused_length++;                                                            \
            return false;                                                                          \
        }                                                                                          \
        return header_ok(&message->header, counters) && (extra);                                   \
    }

static bool estimate_ok(const dse_estimate_t *message, struct message_counters *counters)
{
    if (message->diagnostics < 0 || message->diagnostics > DSE_ESTIMATE_T_DIAGNOSTICS) {
        counters->refused_count++;
        return false;
    }
    return parts_ok(message->part, message->parts, message->count, counters);
}

static bool measurement_ok(dse_measurement_t *message, struct message_counters *counters)
{
    if (!parts_ok(message->part, message->parts, message->count, counters))
        return false;
    for (int i = 0; i < message->count; i++)
        if (message->valid[i] != 0 && !isfinite(message->value[i])) {
            message->valid[i] = 0;
            counters->refused_nonfinite++;
        }
    return true;
}

static bool status_ok(const dse_status_t *message, struct message_counters *counters)
{
    if (message->reason_length >= 0 && message->reason_length <= (int)sizeof message->reason)
        return true;
    counters->refused_count++;
    return false;
}

static bool vector_ok(int part, int parts, int count, const double *value,
                      struct message_counters *counters)
{
    return parts_ok(part, parts, count, counters) && finite_ok(value, count, counters);
}

MESSAGE_TAKE(clock, true)
MESSAGE_TAKE(status, status_ok(message, counters))
MESSAGE_TAKE(done, true)
MESSAGE_TAKE(run_info, count_ok(message->part, message->parts, MESSAGE_MAX_TEXT_PARTS,
                                message->count, DSE_RUN_INFO_T_CAPACITY, counters))
MESSAGE_TAKE(input,
             vector_ok(message->part, message->parts, message->count, message->value, counters))
MESSAGE_TAKE(truth,
             vector_ok(message->part, message->parts, message->count, message->value, counters))
MESSAGE_TAKE(exchange,
             vector_ok(message->part, message->parts, message->count, message->value, counters))
MESSAGE_TAKE(measurement, measurement_ok(message, counters))
MESSAGE_TAKE(estimate, estimate_ok(message, counters))

const char *message_type(int i, int64_t *fingerprint)
{
    static const struct {
        const char *name;
        int64_t (*fingerprint)(void);
    } types[] = {
        {"clock_t", __dse_clock_t_get_hash},       {"done_t", __dse_done_t_get_hash},
        {"estimate_t", __dse_estimate_t_get_hash}, {"exchange_t", __dse_exchange_t_get_hash},
        {"input_t", __dse_input_t_get_hash},       {"measurement_t", __dse_measurement_t_get_hash},
        {"run_info_t", __dse_run_info_t_get_hash}, {"status_t", __dse_status_t_get_hash},
        {"truth_t", __dse_truth_t_get_hash},
    };
    if (i < 0 || i >= (int)(sizeof types / sizeof types[0]))
        return NULL;
    *fingerprint = types[i].fingerprint();
    return types[i].name;
}

void message_vector_reset(struct message_vector *vector)
{
    vector->parts = 0;
    vector->have = 0;
    vector->count = 0;
}

bool message_vector_add(struct message_vector *vector, int part, int parts, int count,
                        const double *value)
{
    int offset = part * PART_CAPACITY;
    if ((vector->parts != 0 && vector->parts != parts) || offset + count > vector->capacity)
        return false;
    vector->parts = parts;
    vector->have |= UINT64_C(1) << part;
    if (part == parts - 1)
        vector->count = offset + count;
    if (count > 0)
        memcpy(vector->value + offset, value, (size_t)count * sizeof *value);
    return true;
}

bool message_vector_complete(const struct message_vector *vector)
{
    if (vector->parts == 0)
        return false;
    uint64_t all = vector->parts == 64 ? UINT64_MAX : (UINT64_C(1) << vector->parts) - 1;
    return vector->have == all;
}

int message_parts(int count)
{
    return count <= 0 ? 1 : (count + PART_CAPACITY - 1) / PART_CAPACITY;
}

int message_part_count(int count, int part)
{
    int left = count - part * PART_CAPACITY;
    return left > PART_CAPACITY ? PART_CAPACITY : left;
}
