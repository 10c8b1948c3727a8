/* Symmetric matrices: each element is computed once and written twice, so that S = S' holds bit
 * for bit. */
#include "combine_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"

static void mirror_upper(int n, dse_real *S)
{
    for (int i = 0; i < n; i++)
        for (int j = i + 1; j < n; j++)
            S[j * n + i] = S[i * n + j];
}

static void transpose_in_place(int n, dse_real *W)
{
    for (int i = 0; i < n; i++) {
        for (int j = i + 1; j < n; j++) {
            const dse_real w = W[i * n + j];
            W[i * n + j] = W[j * n + i];
            W[j * n + i] = w;
        }
    }
}

void dse_sym_congruence(int m, int n, const dse_real *A, const dse_real *P, const dse_real *Q,
                        dse_real *S, dse_real *scratch)
{
    dse_real *W = scratch;
    dse_mat_mul(m, n, n, A, P, W); /* W = A P */
    if (m == n)
        transpose_in_place(n, W); /* rows of W' = P A' are combined below */
    for (int i = 0; i < m; i++) {
        dse_real *s = S + i * m;
        for (int j = i; j < m; j++)
            s[j] = Q ? Q[i * m + j] : 0;
        if (m == n) { /* S_i = Q_i + sum_p A_ip W'_p, on and right of the diagonal */
            combine_add(m - i, n, A + i * n, 1, W + i, m, s + i);
        } else {
            for (int j = i; j < m; j++)
                s[j] += dse_dot(n, W + i * n, A + j * n);
        }
    }
    mirror_upper(m, S);
}

void dse_sym_rank1(int n, dse_real a, const dse_real *v, dse_real *S)
{
    for (int i = 0; i < n; i++)
        dse_axpy(n - i, a * v[i], v + i, S + i * n + i);
    mirror_upper(n, S);
}

void dse_sym_enforce(int n, dse_real *S)
{
    for (int i = 0; i < n; i++) {
        for (int j = i + 1; j < n; j++) {
            const dse_real mean = DSE_REAL(0.5) * S[i * n + j] + DSE_REAL(0.5) * S[j * n + i];
            S[i * n + j] = mean;
            S[j * n + i] = mean;
        }
    }
}

enum dse_status dse_sym_check(int n, const dse_real *S)
{
    if (!dse_all_finite(S, n * n))
        return DSE_ENONFINITE;
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < i; j++) {
            const dse_real size = dse_sqrt(dse_abs(S[i * n + i])) * dse_sqrt(dse_abs(S[j * n + j]));
            if (dse_abs(S[i * n + j] - S[j * n + i]) > dse_sqrt(DSE_REAL_EPSILON) * size)
                return DSE_EINVAL;
        }
    }
    return DSE_OK;
}

void dse_sym_pack(int n, const dse_real *S, dse_real *packed)
{
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++)
            *packed++ = S[i * n + j];
}

void dse_sym_unpack(int n, const dse_real *packed, dse_real *S)
{
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++)
            S[i * n + j] = S[j * n + i] = *packed++;
}
