/* One classical Runge-Kutta step of (x^{p,i}, P_i) over a tick, stage by stage, so that filters can
 * exchange their states between the stages. y_i and theta are held (reference discretisation, 4.5).
 */
#include "high_gain_ekf_internal.h"

#include <stddef.h>

#include "dse/linalg.h"
#include "dse/math.h"

static const dse_real node[4] = {0, DSE_REAL(0.5), DSE_REAL(0.5), 1};
static const dse_real weight[4] = {1, 2, 2, 1};

const dse_real *dse_high_gain_inputs(const dse_real *u, const dse_real *du, bool moving, int nu,
                                     dse_real dt, dse_real *u_stage)
{
    if (!moving) {
        return u;
    }
    for (int k = 0; k < nu; k++) {
        u_stage[k] = u[k] + dt * du[k];
    }
    return u_stage;
}

enum dse_status dse_high_gain_decode(const struct dse_high_gain_ekf *filter, dse_real t,
                                     const dse_real *x, const dse_real *u, dse_real *chi)
{
    const struct dse_normal_form *form = filter->config->form;
    if (filter->config->coords == DSE_HIGH_GAIN_NORMAL) {
        return form->decode(form, t, x, u, chi);
    }
    for (int k = 0; k < filter->n; k++) {
        chi[k] = x[k];
    }
    return DSE_OK;
}

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

/* Vector field kx, Jacobian F of block i and predicted output at the stage's point. */
static enum dse_status linearise(struct dse_high_gain_ekf *filter, dse_real t, const dse_real *u,
                                 dse_real *y_hat)
{
    const struct dse_high_gain_ekf_config *config = filter->config;
    const struct dse_normal_form *form = config->form;
    const struct dse_model *model = config->model;
    enum dse_status status;

    *y_hat = filter->xs[filter->offset]; /* C_i = [1 0 ...] */
    switch (config->coords) {
    case DSE_HIGH_GAIN_NORMAL:
        status = form->field(form, t, filter->xs, u, filter->kx);
        return status != DSE_OK ? status
                                : form->jacobian(form, config->i, t, filter->xs, u, filter->F);
    case DSE_HIGH_GAIN_MAPPED:
        status = model->f(model, t, filter->xs, u, filter->kx);
        if (status == DSE_OK) {
            status = form->encode(form, t, filter->xs, u, filter->z);
            *y_hat = filter->z[filter->offset];
        }
        return status != DSE_OK ? status
                                : form->jacobian(form, config->i, t, filter->z, u, filter->F);
    case DSE_HIGH_GAIN_PHYSICAL:
        status = model->f(model, t, filter->xs, u, filter->kx);
        return status != DSE_OK ? status : own_block(filter, t, u);
    }
    return DSE_EINVAL;
}

/* kx_i += K_i e with K_i = P_i C_i' / R_th; mapped coordinates: M_i^-1 K_i e. */
static enum dse_status correct(struct dse_high_gain_ekf *filter, dse_real t, const dse_real *u,
                               dse_real e)
{
    const struct dse_high_gain_ekf_config *config = filter->config;
    const struct dse_normal_form *form = config->form;
    const int n_i = filter->n_i;

    for (int r = 0; r < n_i; r++) {
        filter->K[r] = filter->Ps[r * n_i] / filter->R_th * e;
    }
    if (config->coords == DSE_HIGH_GAIN_MAPPED) {
        enum dse_status status = form->map_jacobian(form, config->i, t, filter->xs, u, filter->M);
        if (status == DSE_OK) {
            status = dse_lu(n_i, filter->M, filter->pivots);
        }
        if (status != DSE_OK) {
            return status;
        }
        dse_lu_solve(n_i, filter->M, filter->pivots, 1, filter->K);
    }
    for (int r = 0; r < n_i; r++) {
        filter->kx[filter->offset + r] += filter->K[r];
    }
    return DSE_OK;
}

/* P' = F P + P F' + Q_th - P C' R_th^-1 C P   (A.28); without a measurement the last term is not
 * there. Entries (r, c) and (c, r) are sums and products of the same numbers, so that P stays
 * symmetric to the last bit. */
static void riccati(struct dse_high_gain_ekf *filter)
{
    const int n_i = filter->n_i;
    const dse_real *P = filter->Ps;
    const dse_real *FP = filter->FP;
    const dse_real information = filter->has_y ? 1 / filter->R_th : 0;

    dse_mat_mul(n_i, n_i, n_i, filter->F, P, filter->FP);
    for (int r = 0; r < n_i; r++) {
        for (int c = 0; c < n_i; c++) {
            filter->kP[r * n_i + c] = FP[r * n_i + c] + FP[c * n_i + r] +
                                      filter->Q_th[r * n_i + c] -
                                      P[r * n_i] * P[c * n_i] * information;
        }
    }
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

enum dse_status dse_high_gain_stage(struct dse_high_gain_ekf *filter, int s)
{
    const struct dse_high_gain_ekf_config *config = filter->config;
    const dse_real h = config->period;
    const dse_real t = filter->t + node[s] * h;
    const dse_real *u = dse_high_gain_inputs(filter->u, filter->du, filter->moving,
                                             config->form->nu, node[s] * h, filter->u_stage);
    const int n_P = filter->n_i * filter->n_i;
    dse_real y_hat;

    enum dse_status status = linearise(filter, t, u, &y_hat);
    if (status != DSE_OK) {
        return status;
    }
    if (s == 0) {
        filter->output_error = filter->has_y ? filter->y - y_hat : 0;
    }
    if (filter->has_y) {
        status = correct(filter, t, u, filter->y - y_hat);
        if (status != DSE_OK) {
            return status;
        }
    }
    if (config->predictor == DSE_HIGH_GAIN_HOLD) {
        hold_neighbours(filter);
    }
    riccati(filter);

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
