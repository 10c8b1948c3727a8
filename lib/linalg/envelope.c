/* Cholesky factorisation of symmetric matrices whose rows end before the last column. */
#include "dse/linalg.h"
#include "dse/math.h"

/* U_k = A_k / sqrt(A_kk),   A_i -= U_ki U_k  for i > k, right of the diagonal: row k changes
 * nothing beyond its own end, so that the factor has no entry outside of the envelope either. */
enum dse_status dse_envelope_cholesky(int n, const int *last, const dse_real *A, dse_real *U)
{
    for (int k = 0; k < n && U != A; k++)
        for (int j = k; j <= last[k]; j++)
            U[k * n + j] = A[k * n + j];
    for (int k = 0; k < n; k++) {
        dse_real *u = U + k * n;
        if (!(u[k] > 0) || !dse_is_finite(u[k]))
            return DSE_ENOTPD;
        const dse_real pivot = dse_sqrt(u[k]);
        for (int j = k; j <= last[k]; j++)
            u[j] /= pivot;
        for (int i = k + 1; i <= last[k]; i++)
            dse_axpy(last[k] + 1 - i, -u[i], u + i, U + i * n + i);
    }
    return DSE_OK;
}

void dse_envelope_solve(int n, const int *last, const dse_real *U, dse_real *b)
{
    for (int k = 0; k < n; k++) { /* U'y = b: y_k = b_k / U_kk, then out of the others */
        const dse_real *u = U + k * n;
        b[k] /= u[k];
        dse_axpy(last[k] - k, -b[k], u + k + 1, b + k + 1);
    }
    for (int k = n - 1; k >= 0; k--) { /* U x = y */
        const dse_real *u = U + k * n;
        b[k] = (b[k] - dse_dot(last[k] - k, u + k + 1, b + k + 1)) / u[k];
    }
}
