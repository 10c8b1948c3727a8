/* LDL' factorisation without square roots and without pivoting. */
#include "combine_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"

/* On the rows of U = L', as in cholesky.c:
 *     D_k = A_kk,  A_i -= (A_ki / D_k) A_k  for i > k,  U_k = A_k / D_k. */
enum dse_status dse_ldl(int n, const dse_real *A, dse_real *L, dse_real *D)
{
    for (int i = 0; i < n; i++)
        for (int j = i; j < n; j++)
            L[i * n + j] = A[j * n + i];
    for (int k = 0; k < n; k++) {
        dse_real *u = L + k * n;
        if (!dse_is_finite(u[k]))
            return DSE_ENONFINITE;
        if (u[k] == 0)
            return DSE_ESINGULAR;
        D[k] = u[k];
        for (int i = k + 1; i < n; i++)
            dse_axpy(n - i, -(u[i] / D[k]), u + i, L + i * n + i);
        for (int j = k + 1; j < n; j++)
            u[j] /= D[k];
    }
    for (int i = 0; i < n; i++) {
        L[i * n + i] = 1;
        for (int j = i + 1; j < n; j++) {
            L[j * n + i] = L[i * n + j];
            L[i * n + j] = 0;
        }
    }
    return DSE_OK;
}

/* L Z = B top down, then Y = D^-1 Z, then L' X = Y bottom up. */
void dse_ldl_solve(int n, const dse_real *L, const dse_real *D, int m, dse_real *B)
{
    for (int i = 0; i < n; i++)
        combine_subtract(m, i, L + i * n, 1, B, m, B + i * m);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < m; j++)
            B[i * m + j] /= D[i];
    for (int i = n - 1; i >= 0; i--)
        combine_subtract(m, n - 1 - i, L + (i + 1) * n + i, n, B + (i + 1) * m, m, B + i * m);
}
