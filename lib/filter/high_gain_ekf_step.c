/* One classical Runge-Kutta step of (x^{p,i}, P_i) over a tick, stage by stage, so that filters can
 * exchange their states between the stages. y_i and theta are held (reference discretisation, 4.5).
 */
#include "high_gain_ekf_internal.h"

#include <stddef.h>

#include "dse/linalg.h"
#include "dse/math.h"

static const dse_real node[4] = {0, DSE_REAL(0.5), DSE_REAL(0.5), 1};
static const dse_real weight[4] = {1, 2, 2, 1};

void dse_high_gain_first_stage(struct dse_high_gain_ekf *filter)
{
    for (int k = 0; k < filter->n; k++) {
        filter->xs[k] = filter->base[k];
        filter->sx[k] = 0;
    }
    for (int k = 0; k < filter->n_i * filter->n_i; k++) {
        filter->Ps[k] = filter->P[k];
        filter->sP[k] = 0;
    }
}

/* The own block of df/dchi. */
static enum dse_status own_block(struct dse_high_gain_ekf *filter, dse_real t, const dse_real *u)
{
    const struct dse_model *model = filter->config->model;
    const enum dse_status status = model->dfdx(model, t, filter->xs, u, filter->dfdx);
    for (int r = 0; status == DSE_OK && r < filter->n_i; r++) {
        for (int c = 0; c < filter->n_i; c++) {
            filter->F[r * filter->n_i + c] =
                filter->dfdx[(filter->offset + r) * filter->n + filter->offset + c];
        }
    }
    return status;
}

/* Jacobian F of the own block in normal coordinates, at z. */
static enum dse_status normal_block(struct dse_high_gain_ekf *filter, dse_real t, const dse_real *z,
                                    const dse_real *u)
{
    const struct dse_normal_form *form = filter->config->form;
    return filter->config->whole ? form->field_jacobian(form, t, z, u, filter->F)
                                 : form->jacobian(form, filter->config->i, t, z, u, filter->F);
}

/* Vector field kx and Jacobian F of block i at the stage's point; z: the point in the coordinates
 * of the Riccati equation, whose chains begin with the outputs. */
static enum dse_status linearise(struct dse_high_gain_ekf *filter, dse_real t, const dse_real *u,
                                 const dse_real **z)
{
    const struct dse_normal_form *form = filter->config->form;
    enum dse_status status = dse_high_gain_field(filter, t, filter->xs, u, filter->kx);

    *z = filter->xs;
    if (filter->config->coords == DSE_HIGH_GAIN_PHYSICAL) {
        return status != DSE_OK ? status : own_block(filter, t, u);
    }
    if (filter->config->coords == DSE_HIGH_GAIN_MAPPED) {
        status = status != DSE_OK ? status : form->encode(form, t, filter->xs, u, filter->z);
        *z = filter->z;
    }
    return status != DSE_OK ? status : normal_block(filter, t, *z, u);
}

/* kx_i += K_i e with K_i = P_i C_i' R_th^-1; mapped coordinates: M_i^-1 K_i e. */
static enum dse_status correct(struct dse_high_gain_ekf *filter, dse_real t, const dse_real *u)
{
    dse_high_gain_correction(filter);
    if (filter->config->coords == DSE_HIGH_GAIN_MAPPED) {
        enum dse_status status = dse_high_gain_map(filter, t, filter->xs, u);
        status = status != DSE_OK ? status : dse_lu(filter->n_i, filter->M, filter->pivots);
        if (status != DSE_OK) {
            return status;
        }
        dse_lu_solve(filter->n_i, filter->M, filter->pivots, 1, filter->K);
    }
    for (int r = 0; r < filter->n_i; r++) {
        filter->kx[filter->offset + r] += filter->K[r];
    }
    return DSE_OK;
}

/* Blocks j /= i stand still between messages. */
static void hold_neighbours(struct dse_high_gain_ekf *filter)
{
    for (int k = 0; k < filter->n; k++) {
        if (k < filter->offset || k >= filter->offset + filter->n_i) {
            filter->kx[k] = 0;
        }
    }
}

/* Blocks j /= i go as the predictor's own model says. */
static enum dse_status predict_neighbours(struct dse_high_gain_ekf *filter, dse_real t,
                                          const dse_real *u)
{
    dse_real *dx = filter->rk;
    const enum dse_status status = dse_high_gain_predictor_field(filter, t, filter->xs, u, dx);
    for (int k = 0; k < filter->n && status == DSE_OK; k++) {
        if (k < filter->offset || k >= filter->offset + filter->n_i) {
            filter->kx[k] = dx[k];
        }
    }
    return status;
}

static void keep_output_errors(struct dse_high_gain_ekf *filter)
{
    for (int l = 0; l < filter->m; l++) {
        filter->output_error[l] = 0;
    }
    for (int a = 0; a < filter->q; a++) {
        filter->output_error[filter->chosen[a]] = filter->e[a];
    }
}

enum dse_status dse_high_gain_stage(struct dse_high_gain_ekf *filter, int s)
{
    const struct dse_high_gain_ekf_config *config = filter->config;
    const dse_real h = config->period;
    const dse_real t = filter->t + node[s] * h;
    const dse_real *u = dse_high_gain_inputs(filter->u, filter->du, filter->moving,
                                             config->form->nu, node[s] * h, filter->u_stage);
    const int n_P = filter->n_i * filter->n_i;
    const dse_real *z;

    enum dse_status status = linearise(filter, t, u, &z);
    if (status != DSE_OK) {
        return status;
    }
    dse_high_gain_output_errors(filter, z + filter->offset);
    if (s == 0) {
        keep_output_errors(filter);
    }
    if (filter->q > 0) {
        status = correct(filter, t, u);
    }
    if (config->predictor == DSE_HIGH_GAIN_HOLD) {
        hold_neighbours(filter);
    } else if (config->predictor_model != NULL && status == DSE_OK) {
        status = predict_neighbours(filter, t, u);
    }
    if (status != DSE_OK) {
        return status;
    }
    dse_high_gain_riccati(filter);

    dse_axpy(filter->n, weight[s], filter->kx, filter->sx);
    dse_axpy(n_P, weight[s], filter->kP, filter->sP);
    if (s < 3) {
        for (int k = 0; k < filter->n; k++) {
            filter->xs[k] = filter->base[k] + node[s + 1] * h * filter->kx[k];
        }
        for (int k = 0; k < n_P; k++) {
            filter->Ps[k] = filter->P[k] + node[s + 1] * h * filter->kP[k];
        }
    }
    return DSE_OK;
}

enum dse_status dse_high_gain_combine(struct dse_high_gain_ekf *filter)
{
    const dse_real sixth = filter->config->period / 6;
    const int n_P = filter->n_i * filter->n_i;

    /* x + h/6 (k1 + 2 k2 + 2 k3 + k4) */
    for (int k = 0; k < filter->n; k++) {
        filter->xs[k] = filter->base[k] + sixth * filter->sx[k];
    }
    for (int k = 0; k < n_P; k++) {
        filter->Ps[k] = filter->P[k] + sixth * filter->sP[k];
    }
    if (!dse_all_finite(filter->xs, filter->n) || !dse_all_finite(filter->Ps, n_P)) {
        return DSE_ENONFINITE;
    }
    return dse_cholesky(filter->n_i, filter->Ps, filter->FP);
}
