/* A recorded run: its scenario, its samples as a source for the clock, its estimates to compare
 * with. */
#ifndef DSE_RUN_RECORDED_H
#define DSE_RUN_RECORDED_H

#include "runtime/clock.h"
#include "runtime/run_info.h"

struct recorded_estimates {
    int network;
    int node;
    int n_states; /* columns per sample: at least the number of states */
    int64_t samples;
    double *values; /* samples x 2 n_states: state, then variance */
    uint8_t *have;  /* samples */
};

struct recorded {
    const char *path;
    int64_t run_id; /* of the first run in the log */
    struct run_info_scenario info;

    /* After recorded_load: */
    const struct dse_plant *process;
    int64_t samples; /* with an input in the log */
    double *t, *x, *u, *y;
    bool *valid;
    uint8_t *have_u, *have_x, *have_y; /* per sample, sample, and sample x group */
    struct recorded_estimates *estimates;
    int n_estimates;
    int64_t missing; /* measurement vectors that are not in the log */
};

/* Reads the scenario from the log's run_info. */
bool recorded_open(const char *path, struct recorded *recorded, struct error *error);
/* Reads the samples and, if asked to, the estimates. */
bool recorded_load(struct recorded *recorded, const struct scenario *scenario, bool with_estimates,
                   struct error *error);
void recorded_free(struct recorded *recorded);

/* The recorded samples as a source; `recorded` must outlive it. */
void recorded_source(struct recorded *recorded, struct sample_source *source);

/* The recorded estimates of a node, NULL when the log has none. */
const struct recorded_estimates *recorded_estimates_of(const struct recorded *recorded, int network,
                                                       int node);

#endif
