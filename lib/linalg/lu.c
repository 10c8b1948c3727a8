/* LU factorisation with partial pivoting. */
#include "combine_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"

static void swap_rows(int n, dse_real *a, dse_real *b)
{
    for (int j = 0; j < n; j++) {
        const dse_real t = a[j];
        a[j] = b[j];
        b[j] = t;
    }
}

/* The row at or below k whose entry in column k is largest. */
static int pivot_row(int n, const dse_real *A, int k)
{
    int best = k;
    for (int i = k + 1; i < n; i++)
        if (dse_abs(A[i * n + k]) > dse_abs(A[best * n + k]))
            best = i;
    return best;
}

enum dse_status dse_lu(int n, dse_real *A, int *pivots)
{
    for (int k = 0; k < n; k++) {
        pivots[k] = pivot_row(n, A, k);
        if (pivots[k] != k)
            swap_rows(n, A + k * n, A + pivots[k] * n);
        const dse_real pivot = A[k * n + k];
        if (!dse_is_finite(pivot))
            return DSE_ENONFINITE;
        if (pivot == 0)
            return DSE_ESINGULAR;
        for (int i = k + 1; i < n; i++) {
            const dse_real factor = A[i * n + k] / pivot;
            A[i * n + k] = factor;
            dse_axpy(n - k - 1, -factor, A + k * n + k + 1, A + i * n + k + 1);
        }
    }
    return DSE_OK;
}

void dse_lu_solve(int n, const dse_real *LU, const int *pivots, int m, dse_real *B)
{
    for (int i = 0; i < n; i++)
        if (pivots[i] != i)
            swap_rows(m, B + i * m, B + pivots[i] * m);
    for (int i = 0; i < n; i++) /* L unit lower triangular, top down */
        combine_subtract(m, i, LU + i * n, 1, B, m, B + i * m);
    for (int i = n - 1; i >= 0; i--) { /* U, bottom up */
        dse_real *b = B + i * m;
        combine_subtract(m, n - 1 - i, LU + i * n + i + 1, 1, b + m, m, b);
        for (int j = 0; j < m; j++)
            b[j] /= LU[i * n + i];
    }
}
