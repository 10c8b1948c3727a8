/* Coordinator of moving horizon estimators: the globalised Newton step on the prices with bounds.
 *
 * The dual function is concave and piecewise quadratic, with the gradient E and, for the bounds
 * that are active, the Hessian Hd; none bends more than the one without bounds, Hd0. Plain Newton
 * cycles between active sets; steps
 *
 *     d = (-Hd + tau (-Hd0))^-1 E
 *
 * with tau by the rule of Levenberg and Marquardt do not: for tau >= 1 the value never falls. */
#include "coordinator_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"

static void raise_tau(struct dse_mhe_prices *prices)
{
    const dse_real larger = prices->tau * (prices->tau >= 1 ? 2 : 10);
    prices->tau = larger > DSE_REAL(1e-2) ? larger : DSE_REAL(1e-2);
}

/* The value of the dual function, sum J_i. */
static dse_real value(const struct dse_mhe_coordinator *c)
{
    dse_real sum = 0;
    for (int i = 0; i < c->parts; i++)
        sum += coordinator_takes_part(c, i) ? c->J[i] : 0;
    return sum;
}

static bool is_better(struct dse_mhe_coordinator *c, dse_real J)
{
    struct dse_mhe_prices *prices = &c->prices;
    if (!prices->has_best)
        return true;
    const dse_real gain = J - prices->best_J;
    const dse_real slack = 500 * DSE_REAL_EPSILON * dse_abs(J); /* 1e-13 |phi| in double */
    const bool better = gain >= DSE_REAL(1e-3) * prices->expected - slack ||
                        c->error <= DSE_REAL(0.1) * prices->best_norm;
    if (better && gain > DSE_REAL(0.25) * prices->expected)
        prices->tau = prices->tau / 10 < DSE_REAL(1e-6) ? 0 : prices->tau / 10;
    return better;
}

static void keep(struct dse_mhe_coordinator *c, dse_real J)
{
    struct dse_mhe_prices *prices = &c->prices;
    for (int e = 0; e < (c->length - 1) * c->n; e++) {
        prices->best[e] = c->p[e];
        prices->best_E[e] = prices->E[e];
    }
    prices->best_J = J;
    prices->best_norm = c->error;
    prices->has_best = true;
}

/* factor <- that of active + tau matrix. */
static enum dse_status factor(struct dse_mhe_coordinator *c, int m)
{
    struct dse_mhe_dual *dual = &c->dual;
    for (int r = 0; r < m; r++)
        for (int e = r * m + r; e <= r * m + dual->last[r]; e++)
            dual->factor[e] = dual->active[e] + c->prices.tau * dual->matrix[e];
    return dse_envelope_cholesky(m, dual->last, dual->factor, dual->factor);
}

/* E'd - 1/2 d'(-Hd)d, the gain that the model of the dual function promises. */
static dse_real expect(const struct dse_mhe_coordinator *c, int m)
{
    const dse_real *d = c->prices.step;
    dse_real sum = dse_dot(m, c->prices.best_E, d);
    for (int e = 0; e < m; e++) {
        const dse_real *row = c->dual.active + e * m; /* upper triangle */
        sum -= d[e] * row[e] * d[e] / 2;
        sum -= d[e] * dse_dot(c->dual.last[e] - e, row + e + 1, d + e + 1);
    }
    return sum;
}

void coordinator_globalised_step(struct dse_mhe_coordinator *c)
{
    enum { MOST_RAISES = 60 };
    struct dse_mhe_prices *prices = &c->prices;
    const int m = (c->length - 1) * c->n;
    const dse_real J = value(c);
    c->accepted = is_better(c, J);
    if (!c->accepted) {
        raise_tau(prices);
    } else {
        keep(c, J);
        if (coordinator_dual_free(c) != DSE_OK || coordinator_dual_active(c) != DSE_OK)
            return; /* the same prices again: the agents can solve what this side cannot factor */
    }
    int raises = 0;
    while (factor(c, m) != DSE_OK && raises < MOST_RAISES) {
        raise_tau(prices);
        raises++;
    }
    for (int e = 0; e < m; e++) {
        c->p[e] = prices->best[e];
        prices->step[e] = prices->best_E[e];
    }
    if (raises == MOST_RAISES)
        return;
    dse_envelope_solve(m, c->dual.last, c->dual.factor, prices->step);
    prices->expected = expect(c, m);
    dse_axpy(m, 1, prices->step, c->p);
}
