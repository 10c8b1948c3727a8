/* The Kalman filter as textbooks print it, with dense products and an explicit inverse: slow, not
 * robust, and independent of the library's way. For tests. */
#ifndef DENSE_FILTER_H
#define DENSE_FILTER_H

#include <stddef.h>

#include "dse/real.h"

#define DENSE_MAX 16

/* C (m x n) = A (m x k) B (k x n); with transposed != 0: A B', B is n x k. */
static inline void dense_product(int m, int k, int n, const dse_real *A, const dse_real *B,
                                 int transposed, dse_real *C)
{
    for (int i = 0; i < m; i++) {
        for (int j = 0; j < n; j++) {
            dse_real sum = 0;
            for (int p = 0; p < k; p++)
                sum += A[i * k + p] * (transposed ? B[j * k + p] : B[p * n + j]);
            C[i * n + j] = sum;
        }
    }
}

/* B (n x n) = A^-1 by Gauss-Jordan elimination without pivoting, A positive definite, overwritten.
 */
static inline void dense_inverse(int n, dse_real *A, dse_real *B)
{
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            B[i * n + j] = i == j;
    for (int k = 0; k < n; k++) {
        const dse_real pivot = A[k * n + k];
        for (int j = 0; j < n; j++) {
            A[k * n + j] /= pivot;
            B[k * n + j] /= pivot;
        }
        for (int i = 0; i < n; i++) {
            const dse_real factor = A[i * n + k];
            for (int j = 0; j < n && i != k; j++) {
                A[i * n + j] -= factor * A[k * n + j];
                B[i * n + j] -= factor * B[k * n + j];
            }
        }
    }
}

/* P <- F P F' + Q. */
static inline void dense_predict(int nx, const dse_real *F, const dse_real *Q, dse_real *P)
{
    dse_real FP[DENSE_MAX * DENSE_MAX];
    dense_product(nx, nx, nx, F, P, 0, FP);
    dense_product(nx, nx, nx, FP, F, 1, P);
    for (int i = 0; i < nx * nx; i++)
        P[i] += Q[i];
}

/* S = H P H' + R, K = P H' S^-1, x <- x + K e, P <- P - K H P; returns e' S^-1 e. */
static inline dse_real dense_update(int nx, int ny, const dse_real *H, const dse_real *R,
                                    const dse_real *e, dse_real *x, dse_real *P)
{
    dse_real HP[DENSE_MAX * DENSE_MAX], S[DENSE_MAX * DENSE_MAX], inverse[DENSE_MAX * DENSE_MAX];
    dse_real K[DENSE_MAX * DENSE_MAX], weighted[DENSE_MAX], nis = 0;
    dense_product(ny, nx, nx, H, P, 0, HP);
    dense_product(ny, nx, ny, HP, H, 1, S);
    for (int i = 0; i < ny * ny; i++)
        S[i] += R[i];
    dense_inverse(ny, S, inverse);
    dense_product(ny, ny, 1, inverse, e, 0, weighted);
    for (int j = 0; j < ny; j++) {
        nis += e[j] * weighted[j];
        for (int i = 0; i < nx; i++)
            x[i] += HP[j * nx + i] * weighted[j];
    }
    dense_product(ny, ny, nx, inverse, HP, 0, K); /* K' */
    for (int i = 0; i < nx; i++)
        for (int j = 0; j < nx; j++)
            for (int c = 0; c < ny; c++)
                P[i * nx + j] -= K[c * nx + i] * HP[c * nx + j];
    return nis;
}

#endif
