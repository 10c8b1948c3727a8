/* What the parts of the distributed observer share. */
#ifndef DSE_DISTRIBUTED_OBSERVER_INTERNAL_H
#define DSE_DISTRIBUTED_OBSERVER_INTERNAL_H

#include <stddef.h>

#include "dse/distributed_observer.h"

/* The rows in which neighbour j is compared: its own ones, or this node's. */
static inline const struct dse_observer_rows *
dse_observer_compared(const struct dse_distributed_observer_config *config, int j)
{
    return config->residual == DSE_OBSERVER_OWN ? &config->own : &config->theirs[j];
}

/* Their number: columns of Gamma_ij. */
static inline int dse_observer_columns(const struct dse_distributed_observer_config *config, int j)
{
    const struct dse_observer_rows *compared = dse_observer_compared(config, j);
    return compared->C2 != NULL ? compared->rows : config->nx;
}

/* Rows of Gamma_ij: of the residual that teaches it. */
static inline int dse_observer_gain_rows(const struct dse_distributed_observer_config *config,
                                         int j)
{
    return config->residual == DSE_OBSERVER_OWN ? config->nr : dse_observer_columns(config, j);
}

/* At what the right-hand side is evaluated. */
struct dse_observer_view {
    const dse_real *y, *u;
    const dse_real *messages; /* n_rows */
    const int *age;           /* neighbours; NULL: all are fresh */
    bool alone;               /* neither coupling nor adaptation */
};

/* Of a message of this age. */
static inline enum dse_observer_hearing
dse_observer_hearing_of(const struct dse_distributed_observer *observer, int age)
{
    if (age < 0 || age > observer->hold)
        return DSE_OBSERVER_DROPPED;
    return age == 0 ? DSE_OBSERVER_FRESH : DSE_OBSERVER_HELD;
}

/* derivative (nz + n_gain) of state, or the next z of a discrete observer. */
void dse_observer_evaluate(const struct dse_distributed_observer *observer,
                           const struct dse_observer_view *view, const dse_real *state,
                           dse_real *derivative);

#endif
