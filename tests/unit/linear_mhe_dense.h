/* A window of the linear moving horizon estimator as dense least squares. */
#ifndef LINEAR_MHE_DENSE_H
#define LINEAR_MHE_DENSE_H

#include "linear_mhe_rig.h"

#define UNKNOWNS (2 * N_MAX * NX_MAX)

/* The optimality system of a window as one dense matrix in states and multipliers. */
struct dense {
    int n; /* unknowns */
    dse_real M[UNKNOWNS * UNKNOWNS], v[UNKNOWNS];
};

/* C' R^-1 C and C' R^-1 (y - D u) of the channels that sample k has, at row and column `at`. */
static inline void dense_sample(const struct system *s, const struct data *data, int k, int at,
                                struct dense *dense)
{
    const int nx = s->nx, ny = s->ny;
    dse_real R[NY_MAX * NY_MAX] = {0}, inverse[NY_MAX * NY_MAX] = {0};
    for (int a = 0; a < ny; a++)
        for (int b = 0; b < ny; b++)
            R[a * ny + b] =
                data->valid[k][a] && data->valid[k][b] ? s->R[a * ny + b] : (dse_real)(a == b);
    dense_inverse(ny, R, inverse);
    for (int ab = 0; ab < ny * ny; ab++) {
        const int a = ab / ny, b = ab % ny;
        for (int i = 0; i < nx && data->valid[k][a] && data->valid[k][b]; i++) {
            const dse_real weight = s->C[a * nx + i] * inverse[ab];
            dense->v[at + i] += weight * (data->y[k][b] - s->D[b] * data->u[k]);
            for (int p = 0; p < nx; p++)
                dense->M[(at + i) * dense->n + at + p] += weight * s->C[b * nx + p];
        }
    }
}

/* The samples first .. first + H - 1, where Q and P need no inverse; LU with pivoting.
 * xbar NULL: no arrival cost. */
static inline void dense_window(const struct system *s, const struct data *data, int first, int H,
                                const dse_real *xbar, dse_real *x)
{
    static struct dense dense;
    int pivots[UNKNOWNS];
    const int nx = s->nx, half = H * nx, n = 2 * half;
    dense = (struct dense){.n = n};
    for (int j = 0; j < H; j++) {
        const int at = j * nx;
        dense_sample(s, data, first + j, at, &dense);
        for (int i = 0; i < nx; i++) {
            dse_real *dual = dense.M + (at + i) * n, *primal = dense.M + (half + at + i) * n;
            dual[half + at + i] = 1; /* .. - A' lambda_{j+1} + lambda_j = .. */
            for (int p = 0; p < nx && j + 1 < H; p++)
                dual[half + at + nx + p] = -s->A[p * nx + i];
            if (j == 0 && !xbar) { /* lambda_0 = 0 */
                primal[half + i] = 1;
                continue;
            }
            primal[at + i] = 1; /* x_j - A x_{j-1} - Q lambda_j = b, or xbar with P0 */
            for (int p = 0; p < nx; p++) {
                primal[half + at + p] = j > 0 ? -s->Q[i * nx + p] : -s->P0[i * nx + p];
                if (j > 0)
                    primal[at - nx + p] = -s->A[i * nx + p];
            }
            dense.v[half + at + i] = j > 0 ? s->B[i] * data->u[first + j - 1] : xbar[i];
        }
    }
    assert_int_equal(dse_lu(n, dense.M, pivots), DSE_OK);
    dse_lu_solve(n, dense.M, pivots, 1, dense.v);
    for (int i = 0; i < half; i++)
        x[i] = dense.v[i];
}

#endif
