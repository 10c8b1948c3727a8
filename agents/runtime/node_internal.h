/* The parts of a node: node_create.c (making it), node.c (its life, sample by sample),
 * node_messages.c (what arrives), node_samples.c (inputs and measurements of a sample),
 * node_rounds.c (exchange with the neighbours). */
#ifndef DSE_RUNTIME_NODE_INTERNAL_H
#define DSE_RUNTIME_NODE_INTERNAL_H

#include <stdbool.h>
#include <stdint.h>

#include "methods/method.h"
#include "runtime/agent.h"
#include "runtime/announcement.h"
#include "runtime/messages.h"
#include "runtime/node.h"
#include "runtime/sender.h"

#define NODE_SAMPLES 256 /* samples that may wait .. */
#define NODE_BACKLOG                                                                               \
    (1 << 16)            /* .. in a replay: lcm-logplayer may be faster than the estimators        \
                          */
#define NODE_LINGER  0.5 /* s, without lockstep: for what is under way after the last sample */
#define NODE_INBOX   8   /* messages of one neighbour that may wait */
#define NODE_HISTORY 32  /* own messages kept for neighbours that ask */

/* A sample being collected. */
struct node_sample {
    int64_t k; /* -1: free */
    double t;
    struct message_vector u;
    struct message_vector *y; /* one per group */
    bool *valid;              /* stacked over the groups */
};

/* A neighbour's message being collected or waiting for its round. */
struct inbox_slot {
    int64_t k; /* -1: free */
    int round;
    bool withheld;
    struct message_vector vector;
};
struct inbox {
    int from;
    bool gone; /* patience with it ran out and nothing has come from it since: it is not awaited */
    struct inbox_slot slots[NODE_INBOX];
};

/* An own message, kept in case that somebody asks for it. */
struct spoken {
    int64_t k; /* -1: none */
    double t;
    int round;
    int32_t sequence;
    bool withheld;
    double answered_at;
    int count;
    int capacity;
    double *value;
};

enum node_phase { NODE_WAIT_SAMPLE, NODE_IN_ROUND };

struct node {
    struct node_config config;
    const struct scenario_network *network;
    const struct method *method;
    struct method_info info;
    struct method_setup setup;
    void *instance; /* the method's node */
    dse_real *values, *prepared;
    char name[96];

    struct bus *bus;
    struct sender sender;
    struct announcement announcement; /* its run_info */
    struct message_counters counters;
    int64_t asked, answered, predicted, method_failures;
    int64_t instance_id; /* tells two processes for one node apart */
    int64_t source_run;  /* run whose samples are used: own run, or the recorded one in replay */
    bool started;
    int64_t first; /* sample with which it began: 0 unless it joined a run that was going on */
    bool stopping;
    int64_t stop_at;   /* samples of the run once it is stopping */
    double stop_heard; /* when it was told so */
    double last_status;
    double last_progress; /* when something last arrived that moved the node on */
    double last_repeat;
    enum agent_state state;
    char reason[256];

    enum node_phase phase;
    int64_t k; /* sample being waited for or worked on */
    double t;
    struct node_sample *samples; /* n_samples; sample k is at k % n_samples */
    int n_samples;
    int64_t newest; /* sample of the newest complete input, -1 */
    double *u_held, *y_stacked;
    bool *y_valid;
    int ny;
    int *group_ny, *group_offset;
    bool gap_reported;

    int round;
    struct method_plan plan;
    struct inbox *inboxes; /* one per neighbour */
    struct spoken history[NODE_HISTORY];
    int next_spoken;
    double round_started;
    double next_ask, ask_interval;
    double repeat_s; /* learned: what is missing is asked for after this */
    double asked_at; /* when it was asked for last in this wait, 0: not yet */
    double sample_started;
    double *outgoing;

    int sent, sent_bytes;
    double step_s;
    uint64_t estimate_hash;
    struct method_estimate estimate;
};

/* node.c */
double node_repeat_s(const struct node *node);
double node_poll(void *self, double now);
enum agent_state node_state(const void *self);
const char *node_reason(const void *self);
void node_stop(void *self, const char *reason);
/* Begins with sample k of a run. */
void node_start(struct node *node, int64_t k);
/* The run has gone on to sample k without this node: what it has not got of the samples before, it
 * will not get. */
void node_skip_to(struct node *node, int64_t k);
void node_finish(struct node *node);
void node_publish_status(struct node *node, int state);
void node_repeat_done(struct node *node);
void node_fail(struct node *node, const char *format, ...) __attribute__((format(printf, 2, 3)));
void node_advance(struct node *node);

/* node_messages.c: bus handlers, user is the node */
void node_on_clock(void *user, const char *channel, const uint8_t *bytes, int length);
void node_on_status(void *user, const char *channel, const uint8_t *bytes, int length);
void node_on_input(void *user, const char *channel, const uint8_t *bytes, int length);
void node_on_measurement(void *user, const char *channel, const uint8_t *bytes, int length);
void node_on_exchange(void *user, const char *channel, const uint8_t *bytes, int length);

/* node_samples.c */
bool node_samples_create(struct node *node, struct error *error);
void node_samples_destroy(struct node *node);
void node_take_input(struct node *node, const dse_input_t *message);
void node_take_measurement(struct node *node, const dse_measurement_t *message);
/* True when sample node->k can begin; fills t, u_held, y_stacked and y_valid. */
bool node_sample_ready(struct node *node);
/* Counts messages of sample k that never came; in replay says once what to do about it. */
void node_report_gap(struct node *node, int64_t k, int64_t count);

/* node_rounds.c */
bool node_rounds_create(struct node *node, struct error *error);
void node_rounds_destroy(struct node *node);
void node_take_exchange(struct node *node, const dse_exchange_t *message);
/* Opens round node->round; false when the method has no further round. */
bool node_open_round(struct node *node);
bool node_round_complete(const struct node *node);
/* Hands the messages of the round to the method; those that are missing were not to be had. */
void node_close_round(struct node *node);
void node_ask(struct node *node);
/* "node 0" or "node 0 and 3 others": whom the round is waiting for. */
void node_awaited(const struct node *node, char *text, int size);

#endif
