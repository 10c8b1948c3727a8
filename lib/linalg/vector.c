/* Vectors: inner product, scaled addition, norms; transposition. */
#include "dse/linalg.h"
#include "dse/math.h"

/* Four partial sums, joined as (s0 + s1) + (s2 + s3): a fixed order that shortens the chain of
 * dependent additions and is the same for every register width. */
dse_real dse_dot(int n, const dse_real *x, const dse_real *y)
{
    dse_real s0 = 0, s1 = 0, s2 = 0, s3 = 0;
    int i = 0;
    for (; i + 4 <= n; i += 4) {
        s0 += x[i] * y[i];
        s1 += x[i + 1] * y[i + 1];
        s2 += x[i + 2] * y[i + 2];
        s3 += x[i + 3] * y[i + 3];
    }
    for (; i < n; i++)
        s0 += x[i] * y[i];
    return (s0 + s1) + (s2 + s3);
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
