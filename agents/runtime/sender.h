/* Publishing with a header: who says it, of which run, with which sequence number. */
#ifndef DSE_RUNTIME_SENDER_H
#define DSE_RUNTIME_SENDER_H

#include <stdbool.h>
#include <stdint.h>

#include "runtime/bus.h"
#include "runtime/messages.h"

enum sender_type {
    SENDER_CLOCK,
    SENDER_STATUS,
    SENDER_RUN_INFO,
    SENDER_INPUT,
    SENDER_TRUTH,
    SENDER_MEASUREMENT,
    SENDER_EXCHANGE,
    SENDER_ESTIMATE,
    SENDER_DONE,
    SENDER_TYPES
};

struct sender {
    struct bus *bus;
    dse_header_t id; /* run_id, role, network and node of every message; the rest is filled in */
    int32_t sequence[SENDER_TYPES]; /* next number of each type */
};

/* The number of the next message of this type: hand it to a repetition to keep its number. */
int32_t sender_sequence(const struct sender *sender, enum sender_type type);

void sender_clock(struct sender *sender, int64_t k, double t, dse_clock_t *message);
void sender_status(struct sender *sender, int64_t k, double t, dse_status_t *message);
void sender_done(struct sender *sender, int64_t k, double t, dse_done_t *message);
/* sequence: -1 for new numbers, else the number of the first part. */
void sender_run_info(struct sender *sender, const char *json, int32_t sequence);

/* Vectors in parts. sequence: -1 for new numbers, else the number of the first part. */
void sender_input(struct sender *sender, int64_t k, double t, int32_t sequence, const double *u,
                  int nu);
void sender_truth(struct sender *sender, int64_t k, double t, const double *x, int nx);
void sender_measurement(struct sender *sender, int64_t k, double t, int32_t sequence, int group,
                        int64_t measured_at, const double *y, const bool *valid, int ny);
struct sender_exchange {
    int round;
    int intent; /* DSE_EXCHANGE_T_INTENT_* */
    bool withheld;
    int count;
    const double *value;
};
void sender_exchange(struct sender *sender, int64_t k, double t, int32_t sequence,
                     const struct sender_exchange *what);
struct sender_estimate {
    int health;
    int count;
    const double *state;
    const double *variance;
    int diagnostics;
    const double *diagnostic;
};
void sender_estimate(struct sender *sender, int64_t k, double t,
                     const struct sender_estimate *what);

#endif
