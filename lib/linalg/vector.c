/* Vectors: inner product, scaled addition, norms; transposition. */
#include "dot_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"

dse_real dse_dot(int n, const dse_real *x, const dse_real *y)
{
    return dot(n, x, y);
}

void dse_axpy(int n, dse_real a, const dse_real *restrict x, dse_real *restrict y)
{
    for (int i = 0; i < n; i++)
        y[i] += a * x[i];
}

/* Four rows of A at a time, so that most stores go to neighbouring places. */
void dse_mat_transpose(int m, int n, const dse_real *restrict A, dse_real *restrict B)
{
    int i = 0;
    for (; i + 4 <= m; i += 4) {
        const dse_real *a = A + i * n;
        dse_real *b = B + i;
        for (int j = 0; j < n; j++, a++, b += m) {
            b[0] = a[0];
            b[1] = a[n];
            b[2] = a[2 * n];
            b[3] = a[3 * n];
        }
    }
    for (; i < m; i++)
        for (int j = 0; j < n; j++)
            B[j * m + i] = A[i * n + j];
}

void dse_mat_identity(int n, dse_real *A)
{
    for (int i = 0; i < n * n; i++)
        A[i] = 0;
    for (int i = 0; i < n; i++)
        A[i * n + i] = 1;
}

/* Once the result is NaN no comparison replaces it: a NaN is not overlooked. */
dse_real dse_norm_max(int n, const dse_real *x)
{
    dse_real largest = 0;
    for (int i = 0; i < n; i++) {
        const dse_real a = dse_abs(x[i]);
        if (a > largest || a != a)
            largest = a;
    }
    return largest;
}

/* |x| = s |x / s|, s the largest entry: no square over- or underflows. */
dse_real dse_norm2(int n, const dse_real *x)
{
    const dse_real s = dse_norm_max(n, x);
    if (s == 0 || !dse_is_finite(s))
        return s;
    dse_real sum = 0;
    for (int i = 0; i < n; i++) {
        const dse_real q = x[i] / s;
        sum += q * q;
    }
    return s * dse_sqrt(sum);
}
