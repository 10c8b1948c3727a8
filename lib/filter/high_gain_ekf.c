/* Distributed adaptive high-gain EKF: the course of a tick, and what is read from outside. Set-up
 * is in high_gain_ekf_setup.c, the exchange in _exchange.c, late states in _past.c, the numerical
 * step in _step.c, _outputs.c and _coordinates.c, the innovation in _innovation.c. */
#include "dse/high_gain_ekf.h"

#include <stddef.h>

#include "dse/linalg.h"
#include "dse/math.h"
#include "high_gain_ekf_internal.h"

/* ---- the course of a tick ---- */

enum dse_status dse_high_gain_fail(struct dse_high_gain_ekf *filter, enum dse_status status)
{
    filter->open = false;
    filter->theta_tick = filter->theta;
    filter->health = DSE_HEALTH_DIVERGED;
    filter->last_sample = -1;
    filter->counters.failed_ticks++;
    return status;
}

/* u at t_k and its rates, where inputs have one. */
static enum dse_status take_inputs(struct dse_high_gain_ekf *filter, const dse_real *u)
{
    const struct dse_normal_form *form = filter->config->form;
    if (form->nu > 0 && u == NULL) {
        return DSE_EINVAL;
    }
    if (form->nu > 0 && !dse_all_finite(u, form->nu)) {
        return DSE_ENONFINITE;
    }
    for (int k = 0; k < form->nu; k++) {
        filter->u[k] = u[k];
    }
    filter->moving = dse_high_gain_rates(form, filter->u, filter->du);
    return DSE_OK;
}

/* Own outputs, and which of them may be used. */
static void take_measurement(struct dse_high_gain_ekf *filter,
                             const struct dse_measurement *measurement)
{
    filter->q = 0;
    for (int l = 0; l < filter->m; l++) {
        const bool has = measurement != NULL && dse_measurement_has(measurement, l);
        filter->y[l] = has ? measurement->y[l] : 0;
        if (has) {
            filter->chosen[filter->q++] = l;
        }
    }
}

/* base = the picture at t_k. In normal coordinates the map may depend on u: where u is not what the
 * last tick ended with, the same physical state gets new coordinates (4.1). */
static enum dse_status open_picture(struct dse_high_gain_ekf *filter)
{
    const struct dse_normal_form *form = filter->config->form;
    if (!filter->started && filter->config->coords == DSE_HIGH_GAIN_NORMAL) {
        return form->encode(form, filter->t, filter->x, filter->u, filter->base);
    }
    for (int k = 0; k < filter->n; k++) {
        filter->base[k] = filter->x[k];
    }
    return dse_high_gain_recode(filter, filter->t, filter->u_next, filter->u, filter->base);
}

/* P_chi = M^-1 P M^-T by two solves: X = M^-1 P, P_chi = M^-1 X'. */
static enum dse_status physical_covariance(struct dse_high_gain_ekf *filter, const dse_real *chi)
{
    const int n_i = filter->n_i;
    dse_real *X = filter->FP;

    for (int k = 0; k < n_i * n_i; k++) {
        X[k] = filter->P[k];
    }
    if (filter->config->coords != DSE_HIGH_GAIN_PHYSICAL) {
        enum dse_status status = dse_high_gain_map(filter, filter->t, chi, filter->u);
        status = status != DSE_OK ? status : dse_lu(n_i, filter->M, filter->pivots);
        if (status != DSE_OK) {
            return status;
        }
        dse_lu_solve(n_i, filter->M, filter->pivots, n_i, X);
        dse_mat_transpose(n_i, n_i, X, filter->F);
        dse_lu_solve(n_i, filter->M, filter->pivots, n_i, filter->F);
        dse_sym_enforce(n_i, filter->F);
        X = filter->F;
    }
    for (int k = 0; k < n_i * n_i; k++) {
        filter->estimate_covariance[k] = X[k];
    }
    return DSE_OK;
}

enum dse_status dse_high_gain_report(struct dse_high_gain_ekf *filter)
{
    enum dse_status status =
        dse_high_gain_decode(filter, filter->t, filter->base, filter->u, filter->chi);
    status = status != DSE_OK ? status : physical_covariance(filter, filter->chi);
    if (status != DSE_OK) {
        return status;
    }
    for (int k = 0; k < filter->n_i; k++) {
        filter->estimate[k] = filter->chi[filter->offset + k];
    }
    return DSE_OK;
}

enum dse_status dse_high_gain_ekf_begin(struct dse_high_gain_ekf *filter, int64_t k, dse_real t,
                                        const dse_real *u,
                                        const struct dse_measurement *measurement)
{
    filter->open = false;
    if (k < 0) {
        return dse_high_gain_fail(filter, DSE_EINVAL);
    }
    if (!dse_is_finite(t)) {
        return dse_high_gain_fail(filter, DSE_ENONFINITE);
    }
    filter->sample = k;
    filter->t = t;
    take_measurement(filter, measurement);

    enum dse_status status = take_inputs(filter, u);
    status = status != DSE_OK ? status : open_picture(filter);
    status = status != DSE_OK ? status : dse_high_gain_report(filter);
    status = status != DSE_OK ? status : dse_high_gain_innovation(filter);
    if (status != DSE_OK) {
        return dse_high_gain_fail(filter, status);
    }
    filter->counters.missing_measurements += filter->q > 0 ? 0 : 1;
    dse_high_gain_note_sample(filter);
    dse_high_gain_plan_rounds(filter);
    filter->open = true;
    return DSE_OK;
}

/* The state of t_{k+1} becomes the filter's state. */
static void commit(struct dse_high_gain_ekf *filter)
{
    const dse_real h = filter->config->period;
    for (int k = 0; k < filter->n; k++) {
        filter->x[k] = filter->xs[k];
    }
    for (int k = 0; k < filter->n_i * filter->n_i; k++) {
        filter->P[k] = filter->Ps[k];
    }
    for (int k = 0; k < filter->config->form->nu; k++) {
        filter->u_next[k] = filter->u[k] + h * filter->du[k];
    }
    filter->theta = filter->theta_tick;
    filter->started = true;
    filter->measured = filter->measured || filter->q > 0;
    filter->slot++;
    filter->counters.ticks++;
    filter->open = false;
    filter->health = filter->q > 0      ? DSE_HEALTH_TRACKING
                     : filter->measured ? DSE_HEALTH_COASTING
                                        : DSE_HEALTH_INITIALISING;
}

enum dse_status dse_high_gain_ekf_finish(struct dse_high_gain_ekf *filter)
{
    if (!filter->open || filter->round < filter->rounds) {
        return DSE_EINVAL;
    }
    enum dse_status status = DSE_OK;
    if (filter->rounds == 0) {
        status = dse_high_gain_start_step(filter);
    }
    if (filter->rounds < 4) {
        for (int s = 0; s < 4 && status == DSE_OK; s++) {
            status = dse_high_gain_stage(filter, s);
        }
    }
    status = status != DSE_OK ? status : dse_high_gain_combine(filter);
    if (status == DSE_OK && filter->config->horizon > 0) {
        status = dse_high_gain_decode(filter, filter->t, filter->base, filter->u, filter->chi);
        status = status != DSE_OK ? status : dse_high_gain_advance_predictions(filter, filter->chi);
    }
    if (status != DSE_OK) {
        return dse_high_gain_fail(filter, status);
    }
    commit(filter);
    return DSE_OK;
}

/* ---- what is read from outside ---- */

const dse_real *dse_high_gain_ekf_estimate(const struct dse_high_gain_ekf *filter)
{
    return filter->estimate;
}

const dse_real *dse_high_gain_ekf_estimate_covariance(const struct dse_high_gain_ekf *filter)
{
    return filter->estimate_covariance;
}

const dse_real *dse_high_gain_ekf_picture(const struct dse_high_gain_ekf *filter)
{
    return filter->x;
}

const dse_real *dse_high_gain_ekf_covariance(const struct dse_high_gain_ekf *filter)
{
    return filter->P;
}

dse_real dse_high_gain_ekf_theta(const struct dse_high_gain_ekf *filter)
{
    return filter->theta_tick;
}

dse_real dse_high_gain_ekf_innovation(const struct dse_high_gain_ekf *filter)
{
    return filter->J_own;
}

dse_real dse_high_gain_ekf_drive(const struct dse_high_gain_ekf *filter)
{
    return filter->J_drive;
}

const dse_real *dse_high_gain_ekf_output_error(const struct dse_high_gain_ekf *filter)
{
    return filter->output_error;
}

enum dse_health dse_high_gain_ekf_health(const struct dse_high_gain_ekf *filter)
{
    return filter->health;
}

const struct dse_high_gain_ekf_counters *
dse_high_gain_ekf_counters(const struct dse_high_gain_ekf *filter)
{
    return &filter->counters;
}
