/* Messages off the bus: checked before they are decoded, decoded before they are believed, counted
 * when they are refused. */
#ifndef DSE_RUNTIME_MESSAGES_H
#define DSE_RUNTIME_MESSAGES_H

#include <stdbool.h>
#include <stdint.h>

#include "dse_clock_t.h"
#include "dse_done_t.h"
#include "dse_estimate_t.h"
#include "dse_exchange_t.h"
#include "dse_input_t.h"
#include "dse_measurement_t.h"
#include "dse_run_info_t.h"
#include "dse_status_t.h"
#include "dse_truth_t.h"

#define MESSAGE_MAX_BYTES      1400
#define MESSAGE_MAX_PARTS      64   /* of a vector */
#define MESSAGE_MAX_TEXT_PARTS 4096 /* of a run_info: 4 MiB, a scenario may have 1 MiB */

/* What was refused or noticed, for status_t. */
struct message_counters {
    int64_t refused_hash;
    int64_t refused_length;
    int64_t refused_count;
    int64_t refused_nonfinite;
    int64_t foreign_run;
    int64_t duplicates;
    int64_t gaps;
};

/* Each takes the bytes of one message apart. False: refused and counted, `message` is not to be
 * used. What is checked:
 * - fingerprint and length as of the type, before anything is read;
 * - header: known role, sample >= -1, round >= 0, finite time;
 * - parts and counts: 0 <= part < parts <= MESSAGE_MAX_PARTS, full parts before the last one;
 * - numbers of inputs, truths and exchanges: finite. In a measurement NaN or infinity marks its
 *   channel invalid; an estimate may carry NaN where there is no variance. */
bool message_clock(const uint8_t *bytes, int length, struct message_counters *counters,
                   dse_clock_t *message);
bool message_status(const uint8_t *bytes, int length, struct message_counters *counters,
                    dse_status_t *message);
bool message_run_info(const uint8_t *bytes, int length, struct message_counters *counters,
                      dse_run_info_t *message);
bool message_input(const uint8_t *bytes, int length, struct message_counters *counters,
                   dse_input_t *message);
bool message_measurement(const uint8_t *bytes, int length, struct message_counters *counters,
                         dse_measurement_t *message);
bool message_truth(const uint8_t *bytes, int length, struct message_counters *counters,
                   dse_truth_t *message);
bool message_exchange(const uint8_t *bytes, int length, struct message_counters *counters,
                      dse_exchange_t *message);
bool message_estimate(const uint8_t *bytes, int length, struct message_counters *counters,
                      dse_estimate_t *message);
bool message_done(const uint8_t *bytes, int length, struct message_counters *counters,
                  dse_done_t *message);

/* The i-th message type's name and fingerprint, NULL past the last: for run_info. */
const char *message_type(int i, int64_t *fingerprint);

/* A vector that arrives in parts. */
struct message_vector {
    double *value; /* capacity values, the owner's */
    int capacity;
    int parts;     /* of the message being collected; 0: nothing yet */
    uint64_t have; /* bit p: part p is here */
    int count;     /* of the whole vector, known with the last part */
};

void message_vector_reset(struct message_vector *vector);
/* Adds a checked part. False when it does not fit (more values than capacity, other number of
 * parts than before). */
bool message_vector_add(struct message_vector *vector, int part, int parts, int count,
                        const double *value);
bool message_vector_complete(const struct message_vector *vector);

/* Number of parts for a vector of `count` values, at least 1; how many values part p has. */
int message_parts(int count);
int message_part_count(int count, int part);

#endif
