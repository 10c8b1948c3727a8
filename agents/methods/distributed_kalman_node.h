/* A node of the distributed Kalman filters: made in distributed_kalman_create.c, run in
 * distributed_kalman.c; who is told what: distributed_kalman_voices.c. */
#ifndef DSE_METHODS_DISTRIBUTED_KALMAN_NODE_H
#define DSE_METHODS_DISTRIBUTED_KALMAN_NODE_H

#include "dse/distributed_kalman.h"
#include "methods/discretised.h"
#include "methods/distributed_kalman_section.h"
#include "methods/lossy_link.h"
#include "methods/method.h"

enum distributed_kalman_diagnostic {
    DIAGNOSTIC_GAIN,
    DIAGNOSTIC_LOOP_GAIN,
    DIAGNOSTIC_RESIDUAL,
    DIAGNOSTIC_USED,
    DIAGNOSTIC_REFUSED,
    DIAGNOSTIC_LIMITED,
    DIAGNOSTICS
};

/* Where a neighbour's message has the values for this node: it says those for equal sensors once.
 */
struct distributed_kalman_ear {
    int from;
    int offset;
};

struct distributed_kalman_node {
    const struct distributed_kalman_section *section;
    struct dse_model model;
    struct dse_model discretised_plant; /* with section->discretise: the continuous one */
    struct discretised discretised;
    struct dse_dkf_config config;
    struct dse_dkf_sensor *listeners; /* config.listeners */
    struct dse_dkf filter;
    struct dse_arena arena;
    dse_real *memory;
    dse_real *C; /* ny x nx of the whole plant */

    int node, nodes;
    int n_ears; /* neighbours by the graph, in its order */
    struct distributed_kalman_ear *ears;
    int n_voices; /* listeners whose sensors differ: what is said, in this order */
    int *voices;
    dse_real *sum;   /* scheme global: of the terms, ny x ny */
    dse_real *terms; /* nodes x ny x ny, of those marked in has_term */
    bool *has_term;
    struct lossy_rounds *links; /* NULL: what is said is heard */
    int64_t k;
    bool ok; /* the filter takes part in this sample */
};

/* ---- distributed_kalman_voices.c ---- */

/* The sensor group that a node reads. */
const struct dse_subsystem *distributed_kalman_group(const struct method_setup *setup, int node);
/* Whether messages are whole states. */
bool distributed_kalman_says_states(const struct distributed_kalman_section *section);
/* Fills ears and voices; node->C is known. */
bool distributed_kalman_find_voices(struct distributed_kalman_node *node,
                                    const struct method_setup *setup, struct error *error);

/* ---- distributed_kalman_create.c: as in struct method ---- */

void *distributed_kalman_create(const struct method_setup *setup, struct method_info *info,
                                struct error *error);
void distributed_kalman_destroy(void *self);

#endif
