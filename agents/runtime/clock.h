/* The sample clock: gathers the nodes of a run, then publishes sample after sample from a source
 * (simulated plant or recorded log) as fast as everybody is done, or at wall-clock pace. */
#ifndef DSE_RUNTIME_CLOCK_H
#define DSE_RUNTIME_CLOCK_H

#include <stdbool.h>
#include <stdint.h>

#include "runtime/agent.h"
#include "runtime/scenario.h"

/* One sample of the plant; pointers are valid until the next call of `next`. */
struct sample_data {
    double t;
    const double *x;   /* nx, then the n_unknown inputs; NULL when the truth is not known */
    const double *u;   /* nu, as the estimators may know them */
    const double *y;   /* ny, in the plant's order */
    const bool *valid; /* ny, NULL: all */
};

struct sample_source {
    void *self;
    /* The data of sample k; called with k = 0, 1, 2, .. False and a reason when it cannot. */
    bool (*next)(void *self, int64_t k, struct sample_data *data, char *reason, int size);
    void (*destroy)(void *self);
};

struct clock_config {
    const struct scenario *scenario;
    struct sample_source source; /* owned by the clock from clock_create on, also when that fails */
    int64_t samples;
    int pace;         /* lockstep or realtime */
    double speed;     /* realtime: plant seconds per second, 0 means 1 */
    int64_t run_id;   /* not 0 */
    double join_s;    /* how long it waits for the nodes, 0: for ever */
    int recorder_lag; /* lockstep: samples that it may be ahead of the recorder's `done`; 0: none is
                         there to wait for */
};

/* Fills `agent`. */
bool clock_create(const struct clock_config *config, struct bus *bus, struct agent *agent,
                  struct error *error);

/* The simulated plant of a scenario as a source. */
bool plant_source(const struct scenario *scenario, struct sample_source *source,
                  struct error *error);

/* A run id from the wall clock and a random number, never 0. */
int64_t clock_new_run_id(void);

#endif
