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

/* Slot s: the predicted physical state, and its accumulated squares. The states lie side by side.
 */
static dse_real *state_at(const struct dse_high_gain_ekf *filter, int s)
{
    return filter->ring + s * filter->n;
}

static dse_real *squares_at(const struct dse_high_gain_ekf *filter, int s)
{
    return filter->ring + (filter->config->horizon + 1) * filter->n + s;
}

/* Index of the prediction that began N_d ticks ago, or at the start. */
static int oldest(const struct dse_high_gain_ekf *filter)
{
    const int horizon = filter->config->horizon;
    return filter->slot < horizon ? 0 : (int)((filter->slot - horizon) % (horizon + 1));
}

/* |y_i - h_i(chi)|^2 at t_k; what is missing contributes nothing. */
static enum dse_status squared_error(struct dse_high_gain_ekf *filter, const dse_real *chi,
                                     dse_real *e2)
{
    const struct dse_model *model = filter->config->model;
    *e2 = 0;
    if (filter->q == 0) {
        return DSE_OK;
    }
    const enum dse_status status = model->h(model, filter->t, chi, filter->u, filter->y_all);
    for (int a = 0; a < filter->q && status == DSE_OK; a++) {
        const int l = filter->chosen[a];
        const dse_real e = filter->y[l] - filter->y_all[filter->first_output + l];
        *e2 += e * e;
    }
    return status;
}

enum dse_status dse_high_gain_innovation(struct dse_high_gain_ekf *filter)
{
    filter->J_own = 0;
    if (filter->config->horizon == 0 || filter->slot == 0) {
        return DSE_OK;
    }
    const int s = oldest(filter);
    dse_real e2;
    const enum dse_status status = squared_error(filter, state_at(filter, s), &e2);
    if (status != DSE_OK) {
        return status;
    }
    /* trapezoid rule: the last sample counts half */
    const dse_real J = *squares_at(filter, s) + DSE_REAL(0.5) * filter->config->period * e2;
    /* a square beyond the number range stays a number, so that it can be sent and summed */
    filter->J_own = dse_min(J, DSE_REAL_MAX / (dse_real)filter->p);
    return DSE_OK;
}

/* Predictions that are stepped together. */
struct lanes {
    struct dse_high_gain_ekf *filter;
    int count;
};

/* chi' = f(t, chi, u(t)) in each lane */
static enum dse_status plant(void *context, dse_real t, const dse_real *chi, dse_real *dchi)
{
    const struct lanes *lanes = context;
    const struct dse_high_gain_ekf *filter = lanes->filter;
    const struct dse_model *model = filter->config->model;
    const dse_real *u = dse_high_gain_inputs(filter->u, filter->du, filter->moving, model->nu,
                                             t - filter->t, filter->u_stage);
    if (model->f_many != NULL && lanes->count > 1) {
        return model->f_many(model, t, lanes->count, chi, u, dchi);
    }
    enum dse_status status = DSE_OK;
    for (int l = 0; l < lanes->count && status == DSE_OK; l++) {
        status = model->f(model, t, chi + l * model->nx, u, dchi + l * model->nx);
    }
    return status;
}

/* A step that fails or is not finite leaves the states where they were. */
static enum dse_status step(struct dse_high_gain_ekf *filter, int s, int count)
{
    struct lanes lanes = {filter, count};
    return dse_rk4_step(plant, &lanes, filter->t, filter->config->period, count * filter->n,
                        state_at(filter, s), filter->rk);
}

/* One step of the predictions first..end-1, several at a time: their arithmetic is independent, and
 * what a processor waits for in one it does in the others. The bits are those of single steps.
 *
 * From a bad start the open-loop model may leave the region where it can be evaluated (4.1 of the
 * spec: the 4-CSTR ignites); then that prediction stands still: it goes on to disagree with y,
 * which is all that it is asked for. */
static void predict(struct dse_high_gain_ekf *filter, int first, int end)
{
    for (int s = first; s < end; s += DSE_HIGH_GAIN_EKF_LANES) {
        const int left = end - s;
        const int count = left < DSE_HIGH_GAIN_EKF_LANES ? left : DSE_HIGH_GAIN_EKF_LANES;
        if (step(filter, s, count) == DSE_OK) {
            continue;
        }
        for (int l = s; l < s + count; l++) {
            filter->counters.frozen_predictions += step(filter, l, 1) != DSE_OK;
        }
    }
}

enum dse_status dse_high_gain_advance_predictions(struct dse_high_gain_ekf *filter,
                                                  const dse_real *chi)
{
    const int horizon = filter->config->horizon;
    const int fresh = (int)(filter->slot % (horizon + 1));
    const bool full = filter->slot >= horizon;
    const int live = full ? horizon + 1 : (int)filter->slot + 1;
    /* read in this tick, restarts in the next */
    const int finished = full ? oldest(filter) : live;
    const dse_real h = filter->config->period;
    dse_real e2;

    /* the first sample counts half */
    enum dse_status status = squared_error(filter, chi, &e2);
    if (status != DSE_OK) {
        return status;
    }
    dse_real *restarted = state_at(filter, fresh);
    for (int k = 0; k < filter->n; k++) {
        restarted[k] = chi[k];
    }
    *squares_at(filter, fresh) = DSE_REAL(0.5) * h * e2;

    for (int s = 0; s < live; s++) {
        if (s != fresh && s != finished) {
            status = squared_error(filter, state_at(filter, s), &e2);
            *squares_at(filter, s) += status == DSE_OK ? h * e2 : 0;
        }
    }
    predict(filter, 0, finished);
    predict(filter, finished + 1, live);
    return DSE_OK;
}
