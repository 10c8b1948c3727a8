/* What runs on a bus: state machines that are driven by messages and by the passing of time, so
 * that the same code runs one per process or all in one. */
#ifndef DSE_RUNTIME_AGENT_H
#define DSE_RUNTIME_AGENT_H

#include <stdbool.h>

#include "runtime/bus.h"
#include "runtime/error.h"

enum agent_state { AGENT_JOINING, AGENT_RUNNING, AGENT_FINISHED, AGENT_FAILED };

struct agent {
    void *self;
    char name[96]; /* for messages: "node 1 (reactor 2) of network ahg" */
    /* Does what is due at `now`; returns when it wants to be asked again (host_now() scale) even if
     * no message comes. Messages reach the agent through its bus subscriptions. */
    double (*poll)(void *self, double now);
    enum agent_state (*state)(const void *self);
    /* Why it failed; "" while it has not. */
    const char *(*reason)(const void *self);
    /* Ends the run in an orderly way: last messages are sent before state becomes FINISHED. */
    void (*stop)(void *self, const char *reason);
    void (*destroy)(void *self);
};

/* Monotonic time in seconds. */
double host_now(void);

/* Set by SIGINT and SIGTERM. */
bool host_interrupted(void);
void host_catch_signals(void);

/* Drives all agents on one bus until every one has finished or one has failed. `tick` (may be NULL)
 * is called at least every 0.2 s: for progress lines. False and the failed agent's name and reason
 * otherwise. */
bool host_run(struct bus *bus, struct agent *agents, int n_agents, void (*tick)(void *),
              void *tick_user, struct error *error);

#endif
