/* The innovation over a past horizon (2.10, 2.11):
 *
 *     J_i(t) = integral_{t-d}^{t} (y_i(tau) - yhat_i(tau; t-d))^2 dtau
 *
 * yhat_i(.; t-d) is output i of the whole model started from the picture at t-d and run open loop.
 * Instead of integrating a horizon in every tick, N_d + 1 predictions run side by side, one started
 * in each tick; the oldest is read, and then its slot is used again. Cost per tick: one Runge-Kutta
 * step of the plant for each (4.4). */
#include "high_gain_ekf_internal.h"

#include <stddef.h>

#include "dse/math.h"
#include "dse/ode.h"

/* Slot s: the predicted physical state (n), then the accumulated squares. */
static dse_real *slot_at(const struct dse_high_gain_ekf *filter, int s)
{
    return filter->ring + s * (filter->n + 1);
}

/* Index of the prediction that began N_d ticks ago, or at the start. */
static int oldest(const struct dse_high_gain_ekf *filter)
{
    const int horizon = filter->config->horizon;
    return filter->slot < horizon ? 0 : (int)((filter->slot - horizon) % (horizon + 1));
}

/* (y_i - h_i(chi))^2 at t_k; a missing sample contributes nothing. */
static enum dse_status squared_error(struct dse_high_gain_ekf *filter, const dse_real *chi,
                                     dse_real *e2)
{
    const struct dse_model *model = filter->config->model;
    *e2 = 0;
    if (!filter->has_y) {
        return DSE_OK;
    }
    const enum dse_status status = model->h(model, filter->t, chi, filter->u, filter->y_all);
    if (status == DSE_OK) {
        const dse_real e = filter->y - filter->y_all[filter->config->i];
        *e2 = e * e;
    }
    return status;
}

enum dse_status dse_high_gain_innovation(struct dse_high_gain_ekf *filter)
{
    filter->J_own = 0;
    if (filter->config->horizon == 0 || filter->slot == 0) {
        return DSE_OK;
    }
    const dse_real *slot = slot_at(filter, oldest(filter));
    dse_real e2;
    const enum dse_status status = squared_error(filter, slot, &e2);
    if (status != DSE_OK) {
        return status;
    }
    /* trapezoid rule: the last sample counts half */
    const dse_real J = slot[filter->n] + DSE_REAL(0.5) * filter->config->period * e2;
    /* a square beyond the number range stays a number, so that it can be sent and summed */
    filter->J_own = dse_min(J, DSE_REAL_MAX / (dse_real)filter->p);
    return DSE_OK;
}

/* chi' = f(t, chi, u(t)) */
static enum dse_status plant(void *context, dse_real t, const dse_real *chi, dse_real *dchi)
{
    const struct dse_high_gain_ekf *filter = context;
    const struct dse_model *model = filter->config->model;
    const dse_real *u = dse_high_gain_inputs(filter->u, filter->du, filter->moving, model->nu,
                                             t - filter->t, filter->u_stage);
    return model->f(model, t, chi, u, dchi);
}

/* One step of a prediction. From a bad start the open-loop model may leave the region where it can
 * be evaluated (4.1 of the spec: the 4-CSTR ignites); then the prediction stands still: it goes on
 * to disagree with y, which is all that it is asked for. */
static void predict(struct dse_high_gain_ekf *filter, dse_real *slot)
{
    /* a step that fails or is not finite leaves the state where it was */
    if (dse_rk4_step(plant, filter, filter->t, filter->config->period, filter->n, slot,
                     filter->rk) != DSE_OK) {
        filter->counters.frozen_predictions++;
    }
}

enum dse_status dse_high_gain_advance_predictions(struct dse_high_gain_ekf *filter,
                                                  const dse_real *chi)
{
    const int horizon = filter->config->horizon;
    const int fresh = (int)(filter->slot % (horizon + 1));
    const bool full = filter->slot >= horizon;
    const int finished = full ? oldest(filter) : -1; /* read in this tick, restarts in the next */
    const int live = full ? horizon + 1 : (int)filter->slot + 1;
    const dse_real h = filter->config->period;
    dse_real e2;

    /* the first sample counts half */
    enum dse_status status = squared_error(filter, chi, &e2);
    if (status != DSE_OK) {
        return status;
    }
    dse_real *restarted = slot_at(filter, fresh);
    for (int k = 0; k < filter->n; k++) {
        restarted[k] = chi[k];
    }
    restarted[filter->n] = DSE_REAL(0.5) * h * e2;

    for (int s = 0; s < live; s++) {
        dse_real *slot = slot_at(filter, s);
        if (s == finished) {
            continue;
        }
        if (s != fresh) {
            status = squared_error(filter, slot, &e2);
            slot[filter->n] += status == DSE_OK ? h * e2 : 0;
        }
        predict(filter, slot);
    }
    return DSE_OK;
}
