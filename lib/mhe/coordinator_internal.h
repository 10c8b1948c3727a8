/* Coordinator of moving horizon estimators: what its parts share.
 *
 * Stacks are packed by the length H of the window: X_i begins at H first[i], p_i at
 * (H-1) first[i]. */
#ifndef DSE_MHE_COORDINATOR_INTERNAL_H
#define DSE_MHE_COORDINATOR_INTERNAL_H

#include "coordinated_internal.h"

/* What the coordinator knows of an agent. */
enum {
    MHE_ALIVE = 1,    /* has answered within the last dead_after rounds */
    MHE_DATA = 2,     /* there are data of it to hold */
    MHE_ANSWERED = 4, /* in this round */
    MHE_CURRENT = 8,  /* with regard to the message of this round */
    MHE_SYNC = 16,    /* knows which X_i the coordinator has */
    MHE_INFEASIBLE = 32,
    MHE_SINGULAR = 64,
    MHE_SHORT = 128 /* its window is not full yet: works for itself */
};

static inline bool coordinator_has(const struct dse_mhe_coordinator *c, int i, int bits)
{
    return (c->state[i] & bits) == bits;
}

static inline int coordinator_nx(const struct dse_mhe_coordinator *c, int i)
{
    return c->first[i + 1] - c->first[i];
}

static inline dse_real *coordinator_states(const struct dse_mhe_coordinator *c, dse_real *stack,
                                           int i)
{
    return stack + c->length * c->first[i];
}

static inline dse_real *coordinator_transitions(const struct dse_mhe_coordinator *c,
                                                dse_real *stack, int i)
{
    return stack + (c->length - 1) * c->first[i];
}

/* A_il, rows of n. */
static inline const dse_real *coordinator_block(const struct dse_mhe_coordinator *c, int i, int l)
{
    return c->config->A + c->first[i] * c->n + c->first[l];
}

/* h_i = -(Th X)_i:  h_i(t) = sum_l A_il x_l(t). */
void coordinator_interaction(const struct dse_mhe_coordinator *c, dse_real *X, int i, dse_real *h);
/* g_i = Th_i'p:  g_i(t) = -sum_l A_li' p_l(t); zero for the newest sample, which is left out. */
void coordinator_price_on(const struct dse_mhe_coordinator *c, dse_real *p, int i, dse_real *g);

/* Every agent that is alive has answered to the message of this round. */
bool coordinator_is_complete(const struct dse_mhe_coordinator *c);

/* ---- prediction-driven (coordinator_prediction.c, coordinator_anderson.c) ---- */

/* The stacks of the sample before become those that this one starts with. */
void coordinator_warm_start(struct dse_mhe_coordinator *c, bool first);
enum dse_mhe_outcome coordinator_advance_prediction(struct dse_mhe_coordinator *c);
/* asked, p <- the next ones from the answers X, other to the present ones. */
void coordinator_accelerate(struct dse_mhe_coordinator *c);

/* ---- price-driven (coordinator_price.c, coordinator_newton.c, coordinator_dual.c) ---- */

void coordinator_start_prices(struct dse_mhe_coordinator *c, bool first);
enum dse_mhe_outcome coordinator_advance_price(struct dse_mhe_coordinator *c);
/* Takes part in the prices of this round. */
bool coordinator_takes_part(const struct dse_mhe_coordinator *c, int i);
/* Step of Levenberg and Marquardt from the present point or from the best one (4.5). */
void coordinator_globalised_step(struct dse_mhe_coordinator *c);
/* dual.matrix = -Hd0 for the agents that take part, or, when nobody has bounds, its factor.
 * DSE_ENOTPD. */
enum dse_status coordinator_dual_free(struct dse_mhe_coordinator *c);
/* dual.active = -Hd for the active bounds of the last answers. */
enum dse_status coordinator_dual_active(struct dse_mhe_coordinator *c);

#endif
