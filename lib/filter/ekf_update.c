/* Extended Kalman filter: what a sample of the outputs tells about the state. */
#include "ekf_internal.h"

#include <stddef.h>

#include "dse/linalg.h"
#include "dse/math.h"

/* Pieces of the scratch memory. */
struct workspace {
    dse_real *G;        /* nx x ny: T H'; columns of used channels move to the left */
    dse_real *rest;     /* scratch of the projection, then of the update */
    dse_real *H;        /* ny x nx */
    dse_real *R_factor; /* ny x ny, for a part of the channels */
    dse_real *e;        /* ny: innovations of used channels */
    dse_real *r;        /* ny: their noise variances */
    dse_real *dx;       /* nx: correction */
};

static struct workspace workspace_of(const struct dse_ekf *ekf)
{
    const int nx = ekf->nx, ny = ekf->ny;
    struct workspace w;
    w.G = ekf->scratch;
    w.rest = w.G + nx * DSE_FACTORED_STRIDE(ny);
    w.H = w.rest + DSE_EKF_SCRATCH_REST(nx, ny);
    w.R_factor = w.H + ny * nx;
    w.e = w.R_factor + ny * ny;
    w.r = w.e + ny;
    w.dx = w.r + ny;
    return w;
}

/* Which channels have a finite value; how many. */
static int sort_channels(struct dse_ekf *ekf, const struct dse_measurement *measurement)
{
    int present = 0;
    for (int j = 0; j < ekf->ny; j++) {
        enum dse_channel channel = DSE_CHANNEL_USED;
        if (measurement->valid && !measurement->valid[j])
            channel = DSE_CHANNEL_MISSING;
        else if (!dse_measurement_has(measurement, j))
            channel = DSE_CHANNEL_NONFINITE;
        else
            present++;
        ekf->channel[j] = channel;
    }
    return present;
}

static bool is_used(const struct dse_ekf *ekf, int j)
{
    return ekf->channel[j] == (dse_real)DSE_CHANNEL_USED;
}

/* e = y - h(x, u), and H at the same point. */
static enum dse_status linearise(struct dse_ekf *ekf, const dse_real *u,
                                 const struct dse_measurement *measurement, dse_real *H)
{
    const struct dse_model *model = ekf->config->model;
    enum dse_status status = model->h(model, ekf->time, ekf->x, u, ekf->innovation);
    if (status != DSE_OK)
        return status;
    status = model->dhdx(model, ekf->time, ekf->x, u, H);
    if (status != DSE_OK)
        return status;
    for (int j = 0; j < ekf->ny; j++) {
        ekf->innovation[j] = is_used(ekf, j) ? measurement->y[j] - ekf->innovation[j] : 0;
        if (!dse_is_finite(ekf->innovation[j]))
            return DSE_ENONFINITE;
    }
    return DSE_OK;
}

/* Rejects channel j when e_j^2 > gate^2 (H_j P H_j' + R_jj): each against its own prior
 * distribution, so the verdict does not depend on the order of channels. */
static void apply_gate(struct dse_ekf *ekf, const dse_real *G)
{
    const int nx = ekf->nx, ny = ekf->ny;
    const dse_real gate = ekf->config->gate;
    for (int j = 0; j < ny; j++) {
        if (!is_used(ekf, j))
            continue;
        const dse_real e = ekf->innovation[j];
        const dse_real variance =
            dse_factored_form(nx, ny, ekf->d, G, j) + ekf->config->R[j * ny + j];
        if (e * e > gate * gate * variance)
            ekf->channel[j] = DSE_CHANNEL_REJECTED;
    }
}

/* Innovations, noise variances and columns of G of the used channels, without gaps; how many. */
static int gather(const struct dse_ekf *ekf, const struct workspace *w)
{
    const int nx = ekf->nx, ny = ekf->ny;
    int used = 0;
    for (int j = 0; j < ny; j++) {
        if (!is_used(ekf, j))
            continue;
        w->e[used] = ekf->innovation[j];
        w->r[used] = ekf->config->R[j * ny + j];
        used++;
    }
    if (used == ny)
        return used;
    const int from = DSE_FACTORED_STRIDE(ny), to = DSE_FACTORED_STRIDE(used); /* to <= from */
    for (int i = 0; i < nx; i++) {
        int c = 0;
        for (int j = 0; j < ny; j++)
            if (is_used(ekf, j))
                w->G[i * to + c++] = w->G[i * from + j];
        for (; c < to; c++)
            w->G[i * to + c] = 0;
    }
    return used;
}

/* The Cholesky factor of the part of R that belongs to the used channels. */
static enum dse_status factor_part(const struct dse_ekf *ekf, int used, dse_real *L)
{
    const int ny = ekf->ny;
    for (int a = 0, j = 0; j < ny; j++) {
        if (!is_used(ekf, j))
            continue;
        for (int b = 0, k = 0; k <= j; k++)
            if (is_used(ekf, k))
                L[a * used + b++] = ekf->config->R[j * ny + k];
        a++;
    }
    return dse_cholesky(used, L, L);
}

/* H <- L^-1 H, hence each row of G <- L^-1 row, and e <- L^-1 e with L L' = R of the used channels:
 * their noises become independent with variance 1. */
static enum dse_status whiten(const struct dse_ekf *ekf, int used, const struct workspace *w)
{
    const dse_real *L = ekf->R_factor;
    if (used < ekf->ny) {
        const enum dse_status status = factor_part(ekf, used, w->R_factor);
        if (status != DSE_OK)
            return status;
        L = w->R_factor;
    }
    for (int i = 0; i < ekf->nx; i++)
        dse_lower_solve(used, L, 1, w->G + i * DSE_FACTORED_STRIDE(used));
    dse_lower_solve(used, L, 1, w->e);
    for (int c = 0; c < used; c++)
        w->r[c] = 1;
    return DSE_OK;
}

/* Fills the next estimate. */
static enum dse_status correct(struct dse_ekf *ekf, int used, const struct workspace *w,
                               dse_real *nis)
{
    const int nx = ekf->nx;
    if (!ekf->R_diagonal) {
        const enum dse_status status = whiten(ekf, used, w);
        if (status != DSE_OK)
            return status;
    }
    *nis = dse_factored_update(nx, used, ekf->T, ekf->d, w->G, w->r, w->e, ekf->T_next, ekf->d_next,
                               w->dx, w->rest);
    for (int i = 0; i < nx; i++)
        ekf->x_next[i] = ekf->x[i] + w->dx[i];
    if (!dse_is_finite(*nis) || !dse_all_finite(ekf->x_next, nx) ||
        !dse_factored_is_finite(nx, ekf->T_next, ekf->d_next))
        return DSE_ENONFINITE;
    return DSE_OK;
}

/* Adds the channels of this update to the totals; how many were rejected. */
static int count_channels(struct dse_ekf *ekf)
{
    int rejected = 0;
    for (int j = 0; j < ekf->ny; j++) {
        const enum dse_channel channel = dse_ekf_channel(ekf, j);
        ekf->counts.used += channel == DSE_CHANNEL_USED;
        ekf->counts.missing += channel == DSE_CHANNEL_MISSING;
        ekf->counts.nonfinite += channel == DSE_CHANNEL_NONFINITE;
        rejected += channel == DSE_CHANNEL_REJECTED;
    }
    ekf->counts.rejected += rejected;
    return rejected;
}

static enum dse_health judge(const struct dse_ekf *ekf, int rejected)
{
    if (rejected > 0)
        return DSE_HEALTH_REJECTING;
    if (ekf->used > 0)
        return DSE_HEALTH_TRACKING;
    return ekf->counts.used > 0 ? DSE_HEALTH_COASTING : DSE_HEALTH_INITIALISING;
}

enum dse_status dse_ekf_update(struct dse_ekf *ekf, dse_real t, const dse_real *u,
                               const struct dse_measurement *measurement)
{
    if (t != ekf->time)
        return DSE_EINVAL;
    const struct workspace w = workspace_of(ekf);
    int used = sort_channels(ekf, measurement);
    enum dse_status status = DSE_OK;
    dse_real nis = 0;
    if (used > 0) {
        status = linearise(ekf, u, measurement, w.H);
        if (status != DSE_OK)
            return dse_ekf_fail(ekf, status);
        dse_factored_project(ekf->nx, ekf->ny, ekf->T, w.H, w.G, w.rest);
        if (ekf->config->gate > 0)
            apply_gate(ekf, w.G);
        used = gather(ekf, &w);
    } else {
        for (int j = 0; j < ekf->ny; j++)
            ekf->innovation[j] = 0;
    }
    if (used > 0) {
        status = correct(ekf, used, &w, &nis);
        if (status != DSE_OK)
            return dse_ekf_fail(ekf, status);
        dse_ekf_commit(ekf);
    }
    ekf->nis = nis;
    ekf->used = used;
    ekf->predicted = false;
    ekf->counts.updates++;
    ekf->health = judge(ekf, count_channels(ekf));
    return DSE_OK;
}
