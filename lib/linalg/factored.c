/* Time and measurement updates of a factored covariance. */
#include "dse/factored.h"

#include <stdbool.h>

#include "combine_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"

/* A pivot of the fast time update must keep this fraction of the variance that it comes from;
 * half of the digits are then left. Below it the orthogonal update takes over. */
#ifdef DSE_REAL_IS_float
#define PIVOT_FRACTION DSE_REAL(3.5e-4)
#else
#define PIVOT_FRACTION DSE_REAL(1.5e-8)
#endif

/* a_p = d_p M_pk, p < m: the weights with which rows of M enter row k of M' diag(d) M. */
static void column_weights(int m, int n, const dse_real *M, const dse_real *d, int k, dse_real *a)
{
    for (int p = 0; p < m; p++)
        a[p] = d[p] * M[p * n + k];
}

void dse_factored_expand(int n, const dse_real *T, const dse_real *d, dse_real *P)
{
    for (int i = 0; i < n; i++) {
        for (int j = i; j < n; j++) {
            dse_real sum = 0;
            for (int k = 0; k <= i; k++)
                sum += d[k] * T[k * n + i] * T[k * n + j];
            P[i * n + j] = sum;
            P[j * n + i] = sum;
        }
    }
}

void dse_factored_diagonal(int n, const dse_real *T, const dse_real *d, dse_real *variance)
{
    for (int i = 0; i < n; i++)
        variance[i] = 0;
    for (int k = 0; k < n; k++)
        for (int i = k; i < n; i++)
            variance[i] += d[k] * T[k * n + i] * T[k * n + i];
}

/* W (n x n) = T F', from Ft = F':  W_j = sum_{i >= j} T_ji Ft_i. */
static void propagate_rows(int n, const dse_real *T, const dse_real *Ft, dse_real *W)
{
    for (int j = 0; j < n; j++) {
        dse_real *w = W + j * n;
        for (int i = 0; i < n; i++)
            w[i] = Ft[j * n + i];
        combine_add(n, n - 1 - j, T + j * n + j + 1, 1, Ft + (j + 1) * n, n, w);
    }
}

/* Tp' diag(dp) Tp = W' diag(d) W + w Q by forming the sum row by row and factoring it on the way:
 *     U_k = w Q_k + sum_j (d_j W_jk) W_j - sum_{p<k} (dp_p Tp_pk) Tp_p.
 * The cheapest way, safe while no pivot cancels; false when one does. */
static bool refactor_by_sum(int n, const dse_real *W, const dse_real *d, const dse_real *Q,
                            dse_real w, dse_real *Tp, dse_real *dp, dse_real *a)
{
    for (int k = 0; k < n; k++) {
        dse_real *t = Tp + k * n;
        for (int j = k; j < n; j++)
            t[j] = Q ? w * Q[k * n + j] : 0;
        column_weights(n, n, W, d, k, a);
        combine_add(n - k, n, a, 1, W + k, n, t + k);
        const dse_real variance = t[k];
        column_weights(k, n, Tp, dp, k, a);
        combine_subtract(n - k, k, a, 1, Tp + k, n, t + k);
        dp[k] = t[k];
        if (!(dp[k] > PIVOT_FRACTION * variance) || !dse_is_finite(dp[k]))
            return false;
        const dse_real inverse = 1 / dp[k];
        for (int j = k + 1; j < n; j++)
            t[j] *= inverse;
        t[k] = 1;
    }
    return true;
}

/* The same factors without ever forming the sum: modified weighted Gram-Schmidt (Thornton) on the
 * rows of Y (m x n) with weights D >= 0, Y = [W; rows of Q]:
 *     dp_k = sum_r D_r Y_rk^2,  Tp_k = sum_r (D_r Y_rk) Y_r / dp_k,  Y_r -= Y_rk Tp_k.
 * Pivots are sums of squares and cannot become negative. */
static enum dse_status refactor_orthogonally(int m, int n, dse_real *Y, const dse_real *D,
                                             dse_real *Tp, dse_real *dp)
{
    for (int k = 0; k < n; k++) {
        dse_real *t = Tp + k * n;
        for (int j = k; j < n; j++)
            t[j] = 0;
        for (int r = 0; r < m; r++)
            dse_axpy(n - k, D[r] * Y[r * n + k], Y + r * n + k, t + k);
        dp[k] = t[k];
        if (!dse_is_finite(dp[k]))
            return DSE_ENONFINITE;
        for (int j = k + 1; j < n; j++)
            t[j] = dp[k] > 0 ? t[j] / dp[k] : 0;
        t[k] = 1;
        for (int r = 0; r < m; r++)
            dse_axpy(n - 1 - k, -Y[r * n + k], t + k + 1, Y + r * n + k + 1);
        if (!dse_all_finite(t + k, n - k))
            return DSE_ENONFINITE;
    }
    return DSE_OK;
}

enum dse_status dse_factored_from(int n, const dse_real *P, dse_real *T, dse_real *d,
                                  dse_real *scratch)
{
    dse_real *Y = scratch, *weights = Y + n * n;
    const enum dse_status status = dse_semidefinite_rows(n, P, Y, weights);
    if (status != DSE_OK)
        return status;
    return refactor_orthogonally(n, n, Y, weights, T, d);
}

enum dse_status dse_factored_predict(int n, const dse_real *T, const dse_real *d, const dse_real *Q,
                                     dse_real w, dse_real *FS, dse_real *Tp, dse_real *dp)
{
    dse_real *Ft = FS + n * n, *weights = Ft + n * n, *prior = weights + n;
    dse_mat_transpose(n, n, FS, Ft);
    dse_real *W = FS; /* F is no longer needed */
    propagate_rows(n, T, Ft, W);
    for (int j = 0; j < n; j++)
        prior[j] = d[j];
    if (refactor_by_sum(n, W, prior, Q, w, Tp, dp, weights))
        return DSE_OK;

    for (int j = 0; j < n; j++)
        weights[j] = prior[j];
    if (!Q)
        return refactor_orthogonally(n, n, W, weights, Tp, dp);
    const enum dse_status status = dse_semidefinite_rows(n, Q, Ft, weights + n); /* behind W */
    if (status != DSE_OK)
        return status;
    for (int j = 0; j < n; j++)
        weights[n + j] *= w;
    return refactor_orthogonally(2 * n, n, W, weights, Tp, dp);
}

bool dse_factored_is_finite(int n, const dse_real *T, const dse_real *d)
{
    dse_real s0 = 0, s1 = 0; /* 0 x is NaN for every x that is not finite, and NaN stays NaN */
    for (int j = 0; j < n; j++) {
        const dse_real *t = T + j * n;
        s0 += 0 * d[j];
        int i = j + 1;
        for (; i + 2 <= n; i += 2) {
            s0 += 0 * t[i];
            s1 += 0 * t[i + 1];
        }
        if (i < n)
            s0 += 0 * t[i];
    }
    return s0 + s1 == 0;
}

/* f = T h. */
static void project(int n, const dse_real *T, const dse_real *h, dse_real *f)
{
    for (int j = 0; j < n; j++)
        f[j] = h[j] + dse_dot(n - 1 - j, T + j * n + j + 1, h + j + 1);
}

dse_real dse_factored_form(int n, const dse_real *T, const dse_real *d, const dse_real *h)
{
    dse_real sum = 0;
    for (int j = 0; j < n; j++) {
        const dse_real f = h[j] + dse_dot(n - 1 - j, T + j * n + j + 1, h + j + 1);
        sum += d[j] * f * f;
    }
    return sum;
}

/* Bierman's update, from the last row upwards, with f = T h, g = d f, alpha_n = r, v = 0:
 *     alpha_j = alpha_{j+1} + f_j g_j        d_j <- d_j alpha_{j+1} / alpha_j
 *     T_j <- T_j - (f_j / alpha_{j+1}) v     v <- v + g_j T_j (prior T_j)
 * ends with s = alpha_0 and v = P h. */
dse_real dse_factored_update(int n, dse_real *T, dse_real *d, const dse_real *h, dse_real r,
                             dse_real *restrict v, dse_real *scratch)
{
    dse_real *f = scratch, *g = f + n, *lambda = g + n;
    project(n, T, h, f);
    dse_real alpha = r;
    for (int j = n - 1; j >= 0; j--) {
        g[j] = d[j] * f[j];
        lambda[j] = -(f[j] / alpha);
        const dse_real next = alpha + f[j] * g[j];
        d[j] *= alpha / next;
        alpha = next;
    }
    for (int j = n - 1; j >= 0; j--) {
        dse_real *restrict t = T + j * n;
        const dse_real gain = g[j], correction = lambda[j];
        for (int i = j + 1; i < n; i++) {
            const dse_real prior = t[i];
            t[i] = prior + correction * v[i];
            v[i] += gain * prior;
        }
        v[j] = gain;
    }
    return alpha;
}
