/* Coordinator of moving horizon estimators, price-driven: prices that make the interactions fit. */
#include "coordinator_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"

/* Stacks of transitions, packed by `before` samples, become stacks of c->length, newest zero. */
static void repack(const struct dse_mhe_coordinator *c, int before, int after, dse_real *stack)
{
    for (int i = c->parts - 1; i >= 0; i--) {
        const int nx = coordinator_nx(c, i), start = c->first[i];
        for (int e = after * nx - 1; e >= 0; e--)
            stack[after * start + e] = e < before * nx ? stack[before * start + e] : 0;
    }
}

static bool starts_closed(const struct dse_mhe_coordinator *c)
{
    const enum dse_mhe_price_start start = c->config->price_start;
    return c->bounded && c->config->gradient_step == 0 &&
           (start == DSE_MHE_START_CLOSED_FORM || start == DSE_MHE_START_DEFAULT);
}

void coordinator_start_prices(struct dse_mhe_coordinator *c, bool first)
{
    struct dse_mhe_prices *prices = &c->prices;
    const enum dse_mhe_price_start start = c->config->price_start;
    const int H = c->length, before = c->last_length, m = (H - 1) * c->n;
    const bool zero = start == DSE_MHE_START_ZERO || starts_closed(c);
    if (!first && H > before) {
        repack(c, before, H, c->X);
        repack(c, before - 1, H - 1, c->other);
        repack(c, before - 1, H - 1, c->p);
    }
    for (int e = 0; e < m; e++) {
        c->p[e] = first || zero ? 0 : c->p[e];
        prices->reference[e] = 0;
    }
    prices->has_best = false;
    prices->tau = 0;
    prices->recentred = 0;
    prices->unbounded_round = starts_closed(c);
}

bool coordinator_takes_part(const struct dse_mhe_coordinator *c, int i)
{
    return coordinator_has(c, i, MHE_CURRENT) &&
           (c->state[i] & (MHE_SHORT | MHE_SINGULAR | MHE_INFEASIBLE)) == 0;
}

/* E = H + Th X: what the agents take as interactions minus what their states make of them. The
 * price of an agent that does not take part has no effect: its row is left out. */
static dse_real interaction_error(struct dse_mhe_coordinator *c)
{
    dse_real sum = 0;
    for (int i = 0; i < c->parts; i++) {
        const int count = (c->length - 1) * coordinator_nx(c, i);
        dse_real *E = coordinator_transitions(c, c->prices.E, i);
        const dse_real *h = coordinator_transitions(c, c->other, i);
        coordinator_interaction(c, c->X, i, c->work);
        for (int e = 0; e < count; e++)
            E[e] = coordinator_takes_part(c, i) ? h[e] - c->work[e] : 0;
        sum += dse_dot(count, E, E);
    }
    return dse_sqrt(sum);
}

/* p <- p + (-Hd0)^-1 E: exact without bounds. */
static enum dse_status newton(struct dse_mhe_coordinator *c)
{
    struct dse_mhe_prices *prices = &c->prices;
    const int m = (c->length - 1) * c->n;
    const enum dse_status status = coordinator_dual_free(c);
    if (status != DSE_OK)
        return status;
    const dse_real *U = c->dual.matrix;
    if (c->bounded) {
        const enum dse_status factored =
            dse_envelope_cholesky(m, c->dual.last, c->dual.matrix, c->dual.factor);
        if (factored != DSE_OK)
            return factored;
        U = c->dual.factor;
    }
    for (int e = 0; e < m; e++)
        prices->step[e] = prices->E[e];
    dse_envelope_solve(m, c->dual.last, U, prices->step);
    dse_axpy(m, 1, prices->step, c->p);
    return DSE_OK;
}

/* h_ref <- h: the next pass of re-centring starts at these prices. */
static void recentre(struct dse_mhe_coordinator *c)
{
    for (int e = 0; e < (c->length - 1) * c->n; e++)
        c->prices.reference[e] = c->other[e];
    c->prices.recentred++;
    c->prices.has_best = false;
    c->prices.tau = 0;
}

static int count_state(const struct dse_mhe_coordinator *c, int bits)
{
    int count = 0;
    for (int i = 0; i < c->parts; i++)
        count += coordinator_has(c, i, bits);
    return count;
}

enum dse_mhe_outcome coordinator_advance_price(struct dse_mhe_coordinator *c)
{
    struct dse_mhe_prices *prices = &c->prices;
    const int singular = count_state(c, MHE_ANSWERED | MHE_SINGULAR);
    c->accepted = false;
    if (singular > 0 && singular == count_state(c, MHE_ANSWERED))
        return DSE_MHE_OUTCOME_SINGULAR;
    /* A step needs all answers to the same prices: they are sent again. */
    if (count_state(c, MHE_CURRENT) == 0 ||
        (!c->config->stop_on_any && !coordinator_is_complete(c)))
        return DSE_MHE_CONTINUE;
    c->error = interaction_error(c);
    const bool closed = prices->unbounded_round;
    prices->unbounded_round = false;
    if (!closed && c->error <= c->config->eps) {
        c->accepted = true;
        if (prices->recentred >= c->config->recentrings)
            return DSE_MHE_OUTCOME_CONVERGED;
        recentre(c);
        return DSE_MHE_CONTINUE;
    }
    if (c->config->gradient_step > 0) {
        c->accepted = true;
        dse_axpy((c->length - 1) * c->n, c->config->gradient_step, prices->E, c->p);
        return DSE_MHE_CONTINUE;
    }
    if (c->bounded && !closed) {
        coordinator_globalised_step(c);
        return DSE_MHE_CONTINUE;
    }
    c->accepted = !closed;
    return newton(c) == DSE_OK ? DSE_MHE_CONTINUE : DSE_MHE_OUTCOME_SINGULAR;
}
