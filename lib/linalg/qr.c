/* Householder QR, least squares, and the LQ step of a factored filter. */
#include "dse/linalg.h"
#include "dse/math.h"

/* A reflector H = I - tau v v', v = [1; tail], that maps [alpha; x] to [beta; 0] has
 *     beta = -sign(alpha) |[alpha; x]|,  tau = (beta - alpha) / beta,  tail = x / (alpha - beta).
 * Columns are updated in blocks of this many at a time, so that rows are read contiguously. */
#define BLOCK 8

/* Norm of rows j .. m-1 of column j, safe against overflow. */
static dse_real column_norm(int m, int n, const dse_real *A, int j)
{
    dse_real s = 0, sum = 0;
    for (int i = j; i < m; i++)
        s = dse_max(s, dse_abs(A[i * n + j]));
    if (s == 0)
        return 0;
    for (int i = j; i < m; i++) {
        const dse_real q = A[i * n + j] / s;
        sum += q * q;
    }
    return s * dse_sqrt(sum);
}

/* Columns c .. c + w - 1 of A <- H A with the reflector kept below the diagonal of column j:
 *     A_r -= v_r tau (v' A). */
static void reflect_block(int m, int n, dse_real *A, int j, dse_real tau, int c, int w)
{
    dse_real projection[BLOCK];
    for (int b = 0; b < w; b++)
        projection[b] = A[j * n + c + b];
    for (int r = j + 1; r < m; r++)
        for (int b = 0; b < w; b++)
            projection[b] += A[r * n + j] * A[r * n + c + b];
    for (int b = 0; b < w; b++)
        projection[b] *= tau;
    for (int b = 0; b < w; b++)
        A[j * n + c + b] -= projection[b];
    for (int r = j + 1; r < m; r++)
        for (int b = 0; b < w; b++)
            A[r * n + c + b] -= A[r * n + j] * projection[b];
}

enum dse_status dse_qr(int m, int n, dse_real *A, dse_real *tau)
{
    const dse_real size = dse_norm_max(m * n, A);
    if (!dse_is_finite(size))
        return DSE_ENONFINITE;
    const dse_real threshold = (dse_real)m * DSE_REAL_EPSILON * size;
    enum dse_status status = DSE_OK;
    for (int j = 0; j < n; j++) {
        const dse_real alpha = A[j * n + j];
        const dse_real norm = column_norm(m, n, A, j);
        tau[j] = 0;
        if (norm <= threshold)
            status = DSE_ESINGULAR;
        if (norm == 0)
            continue;
        const dse_real beta = alpha > 0 ? -norm : norm;
        tau[j] = (beta - alpha) / beta;
        for (int i = j + 1; i < m; i++)
            A[i * n + j] /= alpha - beta;
        A[j * n + j] = beta;
        for (int c = j + 1; c < n; c += BLOCK)
            reflect_block(m, n, A, j, tau[j], c, n - c < BLOCK ? n - c : BLOCK);
    }
    return status;
}

void dse_qr_apply_qt(int m, int n, const dse_real *QR, const dse_real *tau, dse_real *b)
{
    for (int j = 0; j < n; j++) {
        dse_real projection = b[j];
        for (int i = j + 1; i < m; i++)
            projection += QR[i * n + j] * b[i];
        projection *= tau[j];
        b[j] -= projection;
        for (int i = j + 1; i < m; i++)
            b[i] -= QR[i * n + j] * projection;
    }
}

/* R x = (Q' b)_{1..n}, bottom up. */
void dse_qr_solve(int m, int n, const dse_real *QR, const dse_real *tau, dse_real *b, dse_real *x)
{
    dse_qr_apply_qt(m, n, QR, tau, b);
    for (int i = n - 1; i >= 0; i--) {
        const dse_real known = dse_dot(n - 1 - i, QR + i * n + i + 1, x + i + 1);
        x[i] = (b[i] - known) / QR[i * n + i];
    }
}

/* The same reflectors from the right, on contiguous rows: A H_0 .. H_{n-1} = [L 0]. */
void dse_lq_lower(int n, int m, dse_real *A, dse_real *L)
{
    for (int i = 0; i < n; i++) {
        dse_real *v = A + i * m;
        const dse_real alpha = v[i];
        const dse_real norm = dse_norm2(m - i, v + i);
        for (int j = i; j < n; j++)
            L[i * n + j] = 0;
        if (norm == 0)
            continue;
        const dse_real beta = alpha > 0 ? -norm : norm;
        const dse_real tau = (beta - alpha) / beta;
        for (int c = i + 1; c < m; c++)
            v[c] /= alpha - beta;
        v[i] = 1;
        for (int r = i + 1; r < n; r++)
            dse_axpy(m - i, -tau * dse_dot(m - i, A + r * m + i, v + i), v + i, A + r * m + i);
        const dse_real sign = beta > 0 ? 1 : -1; /* a column of L may change its sign freely */
        L[i * n + i] = norm;
        for (int r = i + 1; r < n; r++)
            A[r * m + i] *= sign;
    }
    for (int r = 1; r < n; r++)
        for (int i = 0; i < r; i++)
            L[r * n + i] = A[r * m + i];
}
