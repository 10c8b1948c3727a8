/* Linear moving horizon estimator: the backward Riccati recursion in square-root form.
 *
 * The cost to go of the samples from j on, minimised over the disturbances between them, is
 * 1/2 |T_j x_j|^2 + linear terms. With w = V' v, v ~ N(0, I), it follows from that of sample j + 1
 * by an orthogonal triangularisation:
 *
 *         [ I        0      ]   [ R11  R12 ]
 *     H   [ T+ V'    T+ A   ] = [ 0    T   ]        E the whitened rows of C
 *         [ 0        E      ]   [ 0    0   ]
 *
 * R11' R11 = I + V T+' T+ V' is regular whatever Q and A are. The optimal disturbance leads to
 *
 *     x_{j+1} = F x_j + S ghat + b,   Z = R11'^-1 V,   F = A - Z' R12,   S = Z' Z
 *
 * where S = (Q^-1 + T+' T+)^-1, also where Q has no inverse, is the covariance of x_{j+1} given
 * x_j. */
#include <stddef.h>

#include "dse/linalg.h"
#include "dse/math.h"
#include "linear_mhe_internal.h"

/* Z (m x nx) <- R11'^-1 Z, R11 upper triangular in the corner of an array with rows of `width`. */
static void solve_transposed(int m, int width, const dse_real *R, int nx, dse_real *Z)
{
    for (int i = 0; i < m; i++) {
        dse_real *z = Z + i * nx;
        for (int p = 0; p < i; p++)
            dse_axpy(nx, -R[p * width + i], Z + p * nx, z);
        for (int j = 0; j < nx; j++)
            z[j] /= R[i * width + i];
    }
}

/* Rows [T V', T A] of the array from row V's number on, T upper triangular, V rank x nx; A NULL:
 * only the first part. */
static void fill_cost_to_go(int nx, int rank, const dse_real *T, const dse_real *V,
                            const dse_real *A, int width, dse_real *W)
{
    for (int i = 0; i < nx; i++) {
        const dse_real *t = T + i * nx;
        dse_real *w = W + (rank + i) * width;
        for (int p = 0; p < rank; p++)
            w[p] = dse_dot(nx - i, t + i, V + p * nx + i);
        for (int p = i; p < nx && A; p++)
            dse_axpy(nx, t[p], A + p * nx, w + rank);
    }
}

/* Zeros, but ones on the diagonal of the first `rank` rows. */
static void clear_array(int rows, int width, int rank, dse_real *W)
{
    for (int i = 0; i < rows * width; i++)
        W[i] = 0;
    for (int i = 0; i < rank; i++)
        W[i * width + i] = 1;
}

/* F = A - Z' R12 and S = Z' Z; Z is scratch (rank x nx). */
static void make_transition(const struct dse_linear_mhe *mhe, const dse_real *W, dse_real *Z,
                            const struct dse_linear_mhe_stage *stage)
{
    const int nx = mhe->nx, rank = mhe->rank, width = rank + nx;
    for (int i = 0; i < rank * nx; i++)
        Z[i] = mhe->V[i];
    solve_transposed(rank, width, W, nx, Z);
    for (int i = 0; i < nx * nx; i++)
        stage->F[i] = mhe->config->linear.A[i];
    for (int p = 0; p < rank; p++)
        for (int i = 0; i < nx; i++)
            dse_axpy(nx, -Z[p * nx + i], W + p * width + rank, stage->F + i * nx);
    dse_mat_mul_tn(nx, rank, nx, Z, Z, stage->S);
}

/* One step of the recursion, away from the newest sample. T_next NULL: the newest sample itself. */
static enum dse_status factor_stage(struct dse_linear_mhe *mhe, const dse_real *T_next,
                                    const dse_real *rows, const struct dse_linear_mhe_stage *stage)
{
    const int nx = mhe->nx, ny = mhe->ny, rank = T_next ? mhe->rank : 0;
    const int width = rank + nx, height = rank + nx + ny;
    dse_real *W = mhe->scratch, *tau = W + (2 * nx + ny) * 2 * nx;
    clear_array(height, width, rank, W);
    if (T_next)
        fill_cost_to_go(nx, rank, T_next, mhe->V, mhe->config->linear.A, width, W);
    for (int i = 0; i < ny; i++)
        for (int j = 0; j < nx; j++)
            W[(rank + nx + i) * width + rank + j] = rows[i * nx + j];
    /* A singular T is no error here: the samples so far do not determine the state. */
    if (dse_qr(height, width, W, tau) == DSE_ENONFINITE)
        return DSE_ENONFINITE;
    for (int i = 0; i < nx; i++)
        for (int j = 0; j < nx; j++)
            stage->T[i * nx + j] = j >= i ? W[(rank + i) * width + rank + j] : 0;
    if (T_next) /* the part of the array that has been read becomes scratch */
        make_transition(mhe, W, W + rank * width, stage);
    return DSE_OK;
}

enum dse_status linear_mhe_factor_complete(struct dse_linear_mhe *mhe)
{
    const dse_real *T_next = NULL;
    for (int d = 0; d < mhe->N; d++) {
        const struct dse_linear_mhe_stage stage = linear_mhe_stage_in(mhe->nx, mhe->complete, d);
        const enum dse_status status = factor_stage(mhe, T_next, mhe->E, &stage);
        if (status != DSE_OK)
            return status;
        T_next = stage.T;
    }
    return DSE_OK;
}

/* From the newest incomplete sample on backwards. */
static enum dse_status factor_partial(struct dse_linear_mhe *mhe)
{
    const int H = mhe->length;
    mhe->partial_from = H;
    for (int d = H - 1; d >= 0 && mhe->incomplete > 0; d--)
        if (!linear_mhe_is_complete(mhe, linear_mhe_place(mhe, H - 1 - d)))
            mhe->partial_from = d;
    for (int d = mhe->partial_from; d < H; d++) {
        const struct dse_linear_mhe_stage stage = linear_mhe_stage_in(mhe->nx, mhe->partial, d);
        const dse_real *rows = linear_mhe_rows(mhe, linear_mhe_place(mhe, H - 1 - d));
        const enum dse_status status =
            factor_stage(mhe, d > 0 ? linear_mhe_stage(mhe, d - 1).T : NULL, rows, &stage);
        if (status != DSE_OK)
            return status;
    }
    return DSE_OK;
}

/* Prior P = V' V: R' R = I + V T' T V', start = R'^-1 V, so that start' start = (P^-1 + T' T)^-1.
 */
static enum dse_status factor_start(struct dse_linear_mhe *mhe, const dse_real *T)
{
    const int nx = mhe->nx, rank = mhe->prior_rank;
    dse_real *W = mhe->scratch, *tau = W + (2 * nx + mhe->ny) * 2 * nx;
    clear_array(rank + nx, rank, rank, W);
    fill_cost_to_go(nx, rank, T, mhe->prior_V, NULL, rank, W);
    if (rank > 0 && dse_qr(rank + nx, rank, W, tau) == DSE_ENONFINITE)
        return DSE_ENONFINITE;
    for (int i = 0; i < rank * nx; i++)
        mhe->start[i] = mhe->prior_V[i];
    solve_transposed(rank, rank, W, nx, mhe->start);
    mhe->start_rank = rank;
    return DSE_OK;
}

/* Without prior T itself must be regular: no column may lie in the span of those before it. */
static enum dse_status check_regular(int nx, const dse_real *T)
{
    const dse_real precision = (dse_real)(16 * nx) * DSE_REAL_EPSILON;
    for (int j = 0; j < nx; j++) {
        dse_real largest = 0;
        for (int i = 0; i <= j; i++)
            largest = dse_max(largest, dse_abs(T[i * nx + j]));
        if (!(dse_abs(T[j * nx + j]) > precision * largest))
            return DSE_ESINGULAR;
    }
    return DSE_OK;
}

enum dse_status linear_mhe_factor_window(struct dse_linear_mhe *mhe)
{
    const int H = mhe->length;
    enum dse_status status = factor_partial(mhe);
    if (status != DSE_OK)
        return status;
    const bool complete = mhe->partial_from >= H;
    if (complete && mhe->start_length == H)
        return DSE_OK;
    mhe->factors_new = true;
    mhe->start_length = 0;
    const dse_real *T = linear_mhe_stage(mhe, H - 1).T;
    status =
        mhe->config->arrival == DSE_ARRIVAL_NONE ? check_regular(mhe->nx, T) : factor_start(mhe, T);
    if (status == DSE_OK && complete)
        mhe->start_length = H;
    return status;
}
