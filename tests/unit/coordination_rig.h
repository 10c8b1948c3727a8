/* A network of agents and its coordinator in one process, messages handed over by function calls:
 * for tests and benchmarks of the coordination schemes. */
#ifndef COORDINATION_RIG_H
#define COORDINATION_RIG_H

#include <stdbool.h>

#include "dse/coordinated_mhe.h"

enum { RIG_MAX_PARTS = 64 };

struct coordination;

/* Whether a message arrives; up: from agent i, else to it. */
typedef bool coordination_delivers(const struct coordination *net, int i, bool up);

struct coordination {
    struct dse_mhe_settings settings;
    struct dse_mhe_coordinator_config config; /* settings is filled in by coordination_start */
    struct dse_mhe_local_config local_config[RIG_MAX_PARTS];
    struct dse_mhe_local local[RIG_MAX_PARTS];
    struct dse_mhe_coordinator coordinator;
    coordination_delivers *delivers; /* NULL: always */
    bool without_coordinator;        /* it takes no part: agents begin and finish */
    void *context;
    long k;
    int n, ny;
    int first[RIG_MAX_PARTS + 1], first_output[RIG_MAX_PARTS + 1];
    dse_real *start[RIG_MAX_PARTS];
    dse_real *memory[RIG_MAX_PARTS + 1];
    dse_real *down[RIG_MAX_PARTS], *up;
    long messages, reals; /* handed over, both ways */

    double (*clock)(void);            /* seconds, for benchmarks; NULL: nothing is measured */
    double coordinator_time;          /* in all calls so far, */
    double agent_time[RIG_MAX_PARTS]; /* and in those of each agent */
};

/* net->settings and net->config are set (but config.settings). Fails the way the objects do. */
enum dse_status coordination_start(struct coordination *net);
/* One sample: begin, rounds, finish. y: all outputs, subsystem after subsystem; valid likewise or
 * NULL. */
enum dse_mhe_outcome coordination_sample(struct coordination *net, long k, const dse_real *y,
                                         const bool *valid);
/* The states of all agents, newest estimates (n). */
void coordination_state(const struct coordination *net, dse_real *x);
void coordination_free(struct coordination *net);

/* An agent alone (scheme ALONE) with memory of its own; free(alone->memory). */
struct coordination_alone {
    struct dse_mhe_settings settings;
    struct dse_mhe_local_config config;
    struct dse_mhe_local local;
    dse_real *memory;
    int max_active; /* of the bounded problem, 0: all */
};
enum dse_status coordination_alone_start(struct coordination_alone *alone, int horizon,
                                         int min_horizon, double barrier,
                                         const struct dse_mhe_subsystem *subsystem);
void coordination_alone_sample(struct coordination_alone *alone, long k, const dse_real *y,
                               const bool *valid);

#endif
