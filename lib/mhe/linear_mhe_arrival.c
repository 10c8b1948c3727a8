/* Linear moving horizon estimator: what stands for the samples that have left the window. */
#include <stddef.h>

#include "dse/linalg.h"
#include "dse/math.h"
#include "linear_mhe_internal.h"

/* P = T' diag(d) T = V' V,  V the rows sqrt(d_i) T_i. */
void linear_mhe_prior_rows(struct dse_linear_mhe *mhe)
{
    const int nx = mhe->nx, s = DSE_FACTORED_STRIDE(nx);
    int rank = 0;
    for (int i = 0; i < nx; i++) {
        if (mhe->prior_d[i] == 0)
            continue;
        const dse_real root = dse_sqrt(mhe->prior_d[i]);
        for (int j = 0; j < nx; j++)
            mhe->prior_V[rank * nx + j] = root * mhe->prior_T[i * s + j];
        rank++;
    }
    mhe->prior_rank = rank;
}

/* Pieces of the scratch memory. */
struct workspace {
    dse_real *T, *d; /* factors of the covariance on its way */
    dse_real *G;     /* T E' */
    dse_real *e, *r; /* innovations and their noise variances, which are 1 */
    dse_real *dx;
    dse_real *rest;
};

static struct workspace workspace_of(const struct dse_linear_mhe *mhe)
{
    const int nx = mhe->nx, ny = mhe->ny;
    struct workspace w;
    w.T = mhe->scratch;
    w.d = w.T + DSE_FACTORED_SIZE(nx);
    w.G = w.d + nx;
    w.e = w.G + nx * DSE_FACTORED_STRIDE(ny);
    w.r = w.e + ny;
    w.dx = w.r + ny;
    w.rest = w.dx + nx;
    return w;
}

/* Measurement update of (x, w->T, w->d) with the whitened sample: y = E x + e, e ~ N(0, I). A
 * missing channel has a zero row and a zero value, which say nothing. */
static void absorb(const struct dse_linear_mhe *mhe, int place, const struct workspace *w,
                   dse_real *x)
{
    const int nx = mhe->nx, ny = mhe->ny;
    const dse_real *rows = linear_mhe_rows(mhe, place);
    for (int j = 0; j < ny; j++) {
        w->e[j] = mhe->white[place * ny + j] - dse_dot(nx, rows + j * nx, x);
        w->r[j] = 1;
    }
    dse_factored_project(nx, ny, w->T, rows, w->G, w->rest);
    (void)dse_factored_update(nx, ny, w->T, w->d, w->G, w->r, w->e, w->T, w->d, w->dx, w->rest);
    dse_axpy(nx, 1, w->dx, x);
}

/* xbar+ = A (xbar + K (y - C xbar)) + b,  P+ = A (P - K C P) A' + Q. */
static enum dse_status arrive_kalman(struct dse_linear_mhe *mhe, int place, const dse_real *b)
{
    const int nx = mhe->nx, size = DSE_FACTORED_SIZE(nx);
    const struct workspace w = workspace_of(mhe);
    for (int i = 0; i < size; i++)
        w.T[i] = mhe->prior_T[i];
    dse_real *x = mhe->lambda; /* free between solutions */
    for (int i = 0; i < nx; i++) {
        w.d[i] = mhe->prior_d[i];
        x[i] = mhe->xbar[i];
    }
    if (linear_mhe_has_data(mhe, place))
        absorb(mhe, place, &w, x);
    linear_mhe_move(mhe, x, b, mhe->xbar_next);
    const enum dse_status status = dse_factored_predict(nx, w.T, w.d, mhe->config->Q, 1,
                                                        mhe->config->linear.A, w.T, w.d, w.rest);
    if (status != DSE_OK)
        return status;
    if (!dse_all_finite(mhe->xbar_next, nx) || !dse_factored_is_finite(nx, w.T, w.d))
        return DSE_ENONFINITE;
    for (int i = 0; i < size; i++)
        mhe->prior_T[i] = w.T[i];
    for (int i = 0; i < nx; i++)
        mhe->prior_d[i] = w.d[i];
    linear_mhe_prior_rows(mhe);
    mhe->start_length = 0;
    return DSE_OK;
}

enum dse_status linear_mhe_arrive(struct dse_linear_mhe *mhe, const dse_real *b)
{
    const int nx = mhe->nx, place = linear_mhe_place(mhe, 0);
    enum dse_status status = DSE_OK;
    if (mhe->config->arrival == DSE_ARRIVAL_NONE)
        return DSE_OK;
    if (mhe->config->arrival == DSE_ARRIVAL_KALMAN)
        status = arrive_kalman(mhe, place, b);
    else
        linear_mhe_move(mhe, mhe->past + place * nx, b, mhe->xbar_next);
    if (status != DSE_OK)
        return status;
    if (!dse_all_finite(mhe->xbar_next, nx))
        return DSE_ENONFINITE;
    for (int i = 0; i < nx; i++)
        mhe->xbar[i] = mhe->xbar_next[i];
    return DSE_OK;
}
