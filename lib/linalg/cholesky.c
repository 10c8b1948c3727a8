/* Cholesky factorisation and triangular solves. */
#include "combine_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"

/* Works on the rows of U = L' (upper triangle), which are contiguous where columns of L are not:
 *     U_k = A_k / sqrt(A_kk),   A_i -= U_ki U_k  for i > k, right of the diagonal. */
enum dse_status dse_cholesky(int n, const dse_real *A, dse_real *L)
{
    for (int i = 0; i < n; i++)
        for (int j = i; j < n; j++)
            L[i * n + j] = A[j * n + i];
    for (int k = 0; k < n; k++) {
        dse_real *u = L + k * n;
        if (!(u[k] > 0) || !dse_is_finite(u[k]))
            return DSE_ENOTPD;
        const dse_real pivot = dse_sqrt(u[k]);
        for (int j = k; j < n; j++)
            u[j] /= pivot;
        for (int i = k + 1; i < n; i++)
            dse_axpy(n - i, -u[i], u + i, L + i * n + i);
    }
    for (int i = 0; i < n; i++) {
        for (int j = i + 1; j < n; j++) {
            L[j * n + i] = L[i * n + j];
            L[i * n + j] = 0;
        }
    }
    return DSE_OK;
}

/* B_i <- (B_i - sum_{p<i} L_ip B_p) / L_ii, top down. */
void dse_lower_solve(int n, const dse_real *L, int m, dse_real *B)
{
    for (int i = 0; i < n; i++) {
        dse_real *b = B + i * m;
        combine_subtract(m, i, L + i * n, 1, B, m, b);
        for (int j = 0; j < m; j++)
            b[j] /= L[i * n + i];
    }
}

/* B_i <- (B_i - sum_{p>i} L_pi B_p) / L_ii, bottom up. */
void dse_lower_transpose_solve(int n, const dse_real *L, int m, dse_real *B)
{
    for (int i = n - 1; i >= 0; i--) {
        dse_real *b = B + i * m;
        combine_subtract(m, n - 1 - i, L + (i + 1) * n + i, n, b + m, m, b);
        for (int j = 0; j < m; j++)
            b[j] /= L[i * n + i];
    }
}

void dse_cholesky_solve(int n, const dse_real *L, int m, dse_real *B)
{
    dse_lower_solve(n, L, m, B);
    dse_lower_transpose_solve(n, L, m, B);
}
