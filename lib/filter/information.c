/* Measurements in information form. */
#include "dse/information.h"

#include <stddef.h>

#include "dse/factored.h"
#include "dse/linalg.h"
#include "dse/math.h"

/* Z <- L^-1 Z, z <- L^-1 z with R = L L'; independent noises need no factor. */
static enum dse_status whiten(int nx, int ny, dse_real *R, dse_real *Z, dse_real *z)
{
    bool independent = true;
    for (int r = 0; r < ny; r++)
        for (int c = 0; c < r; c++)
            independent = independent && R[r * ny + c] == 0;
    if (!independent) {
        const enum dse_status status = dse_cholesky(ny, R, R);
        if (status != DSE_OK)
            return status;
        dse_lower_solve(ny, R, nx, Z);
        dse_lower_solve(ny, R, 1, z);
        return DSE_OK;
    }
    for (int r = 0; r < ny; r++) {
        const dse_real variance = R[r * ny + r];
        if (!(variance > 0))
            return DSE_ENOTPD;
        const dse_real scale = 1 / dse_sqrt(variance);
        z[r] *= scale;
        for (int c = 0; c < nx; c++)
            Z[r * nx + c] *= scale;
    }
    return DSE_OK;
}

/* Z = L^-1 C and z = L^-1 y with R = L L', where the rows and columns of channels that are not
 * there are those of the identity in R and zero in C and y: then u = Z'z and Y = Z'Z. */
enum dse_status dse_information_of(int nx, int ny, const dse_real *C, const dse_real *R,
                                   const struct dse_measurement *measurement, dse_real *u,
                                   dse_real *Y, int *used, dse_real *scratch)
{
    dse_real *L = scratch, *Z = L + ny * ny, *z = Z + ny * nx;
    int present = 0;
    for (int r = 0; r < ny; r++) {
        const bool has = dse_measurement_has(measurement, r);
        present += has;
        z[r] = has ? measurement->y[r] : 0;
        for (int c = 0; c < nx; c++)
            Z[r * nx + c] = has ? C[r * nx + c] : 0;
        for (int c = 0; c <= r; c++) { /* the lower triangle */
            const bool both = has && dse_measurement_has(measurement, c);
            L[r * ny + c] = both ? R[r * ny + c] : (dse_real)(r == c);
        }
    }
    if (used != NULL)
        *used = present;
    const enum dse_status status = whiten(nx, ny, L, Z, z);
    if (status != DSE_OK)
        return status;
    dse_mat_tvec(ny, nx, Z, z, u);
    dse_mat_mul_tn(nx, ny, nx, Z, Z, Y);
    dse_sym_enforce(nx, Y);
    return dse_all_finite(u, nx) && dse_all_finite(Y, nx * nx) ? DSE_OK : DSE_ENONFINITE;
}

/* W (n x n) with P = W'W: the Cholesky factor, or for a singular P rows that are found by
 * elimination with pivoting. scratch: n x n + n. */
static enum dse_status square_root(int n, const dse_real *P, dse_real *W, dse_real *scratch)
{
    if (dse_cholesky(n, P, scratch) == DSE_OK) {
        dse_mat_transpose(n, n, scratch, W);
        return DSE_OK;
    }
    dse_real *d = scratch;
    const enum dse_status status = dse_semidefinite_rows(n, n, P, W, d);
    if (status != DSE_OK)
        return status;
    for (int i = 0; i < n; i++) {
        const dse_real root = dse_sqrt(d[i]);
        for (int j = 0; j < n; j++)
            W[i * n + j] *= root;
    }
    return DSE_OK;
}

/* L L' = I + G G', G = W Y^(1/2), without forming G G': for information so precise beside P that
 * the sum would round the identity away. */
static enum dse_status add_precise(int n, const dse_real *Y, const dse_real *W, dse_real *L,
                                   dse_real *scratch)
{
    dse_real *V = scratch, *d = V + n * n, *array = d + n; /* n x 2 n: [I G] */
    const enum dse_status status = dse_semidefinite_rows(n, n, Y, V, d);
    if (status != DSE_OK)
        return status;
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++) {
            array[i * 2 * n + j] = (dse_real)(i == j);
            array[i * 2 * n + n + j] = dse_dot(n, W + i * n, V + j * n) * dse_sqrt(d[j]);
        }
    }
    dse_lq_lower(n, 2 * n, array, L);
    return DSE_OK;
}

/* Z = L^-1 W with L L' = I + W Y W': then M = Z'Z. Z takes the place of W. */
static enum dse_status add_information(int n, const dse_real *Y, dse_real *W, dse_real *L,
                                       dse_real *scratch)
{
    dse_sym_congruence(n, n, W, Y, NULL, L, scratch);
    dse_real most = 0;
    for (int i = 0; i < n; i++) {
        most = dse_max(most, L[i * n + i]);
        L[i * n + i] += 1;
    }
    const bool precise = most * most * DSE_REAL_EPSILON > 1;
    const enum dse_status status =
        precise ? add_precise(n, Y, W, L, scratch) : dse_cholesky(n, L, L);
    if (status == DSE_OK)
        dse_lower_solve(n, L, n, W);
    return status;
}

enum dse_status dse_information_update(int nx, const dse_real *x, const dse_real *P,
                                       const dse_real *u, const dse_real *Y, dse_real *xh,
                                       dse_real *M, dse_real *scratch)
{
    const int n = nx, square = n * n;
    dse_real *W = scratch, *L = W + square, *residual = L + square, *corrected = residual + n;
    dse_real *sum = corrected + n; /* and scratch: 3 n x n + n */
    enum dse_status status = square_root(n, P, W, sum);
    if (status == DSE_OK)
        status = add_information(n, Y, W, L, sum);
    if (status != DSE_OK)
        return status;
    dse_mat_mul_tn(n, n, n, W, W, sum); /* M */
    dse_sym_enforce(n, sum);
    dse_mat_vec(n, n, Y, x, residual);
    for (int i = 0; i < n; i++)
        residual[i] = u[i] - residual[i];
    dse_mat_vec(n, n, sum, residual, corrected); /* M (u - Y x) */
    dse_axpy(n, 1, x, corrected);
    if (!dse_all_finite(sum, square) || !dse_all_finite(corrected, n))
        return DSE_ENONFINITE;
    for (int k = 0; k < square; k++)
        M[k] = sum[k];
    for (int i = 0; i < n; i++)
        xh[i] = corrected[i];
    return DSE_OK;
}
