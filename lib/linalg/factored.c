/* Time and measurement updates of a factored covariance.
 *
 * Rows are padded with zeros to a multiple of four columns, and triangular rows are taken from the
 * multiple of four at or left of their diagonal: loops then have few and equal lengths, without
 * remainders. Padding only ever meets padding, so it changes no result. */
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

/* First column of a block of four that holds column k. */
static inline int block_start(int k)
{
    return k - k % 4;
}

/* B (n x m, padded rows) = A', A is m x n. */
static void transpose_padded(int m, int n, const dse_real *restrict A, dse_real *restrict B)
{
    const int s = DSE_FACTORED_STRIDE(m);
    int i = 0;
    for (; i + 4 <= m; i += 4) { /* four rows of A are four neighbours in each row of B */
        const dse_real *a = A + i * n;
        dse_real *b = B + i;
        for (int j = 0; j < n; j++, a++, b += s) {
            b[0] = a[0];
            b[1] = a[n];
            b[2] = a[2 * n];
            b[3] = a[3 * n];
        }
    }
    if (i == m)
        return;
    for (int j = 0; j < n; j++)
        for (int k = 0; k < 4; k++)
            B[j * s + i + k] = i + k < m ? A[(i + k) * n + j] : 0;
}

void dse_factored_expand(int n, const dse_real *T, const dse_real *d, dse_real *P)
{
    const int s = DSE_FACTORED_STRIDE(n);
    for (int i = 0; i < n; i++) {
        for (int j = i; j < n; j++) {
            dse_real sum = 0;
            for (int k = 0; k <= i; k++)
                sum += d[k] * T[k * s + i] * T[k * s + j];
            P[i * n + j] = sum;
            P[j * n + i] = sum;
        }
    }
}

void dse_factored_diagonal(int n, const dse_real *T, const dse_real *d, dse_real *variance)
{
    const int s = DSE_FACTORED_STRIDE(n);
    for (int i = 0; i < n; i++)
        variance[i] = 0;
    for (int k = 0; k < n; k++)
        for (int i = k; i < n; i++)
            variance[i] += d[k] * T[k * s + i] * T[k * s + i];
}

/* W (n x m) = T B, T unit upper triangular:  W_j = B_j + sum_{i > j} T_ji B_i. Rows of B and W have
 * sm columns. */
static void combine_unit_upper(int n, int sm, const dse_real *T, const dse_real *restrict B,
                               dse_real *restrict W)
{
    const int s = DSE_FACTORED_STRIDE(n);
    for (int j = 0; j < n; j++) {
        const dse_real *b = B + j * sm;
        dse_real *w = W + j * sm;
        for (int i = 0; i < sm; i++)
            w[i] = b[i];
        combine_add(sm, n - 1 - j, T + j * s + j + 1, 1, b + sm, sm, w);
    }
}

/* a_p = d_p M_pk, p < m: the weights with which rows of M enter row k of M' diag(d) M. */
static inline void column_weights(int m, int s, const dse_real *M, const dse_real *d, int k,
                                  dse_real *a)
{
    for (int p = 0; p < m; p++)
        a[p] = d[p] * M[p * s + k];
}

/* t_k .. = w Q_k ..; zero elsewhere from the start of the block on. */
static inline void start_row(int n, int k, const dse_real *Q, dse_real w, dse_real *t)
{
    const int s = DSE_FACTORED_STRIDE(n);
    for (int j = block_start(k); j < k; j++)
        t[j] = 0;
    for (int j = k; j < n; j++)
        t[j] = Q ? w * Q[k * n + j] : 0;
    for (int j = n; j < s; j++)
        t[j] = 0;
}

/* t = U_k / U_kk right of the diagonal, 1 on it, 0 left of it. */
static inline void finish_row(int s, int k, dse_real inverse, dse_real *t)
{
    for (int j = block_start(k); j < s; j += LANES)
        lanes_store(t + j, inverse * lanes_load(t + j));
    for (int j = block_start(k); j < k; j++)
        t[j] = 0;
    t[k] = 1;
}

/* Tp' diag(dp) Tp = W' diag(d) W + w Q by forming the sum row by row and factoring it on the way:
 *     U_k = w Q_k + sum_j (d_j W_jk) W_j - sum_{p<k} (dp_p Tp_pk) Tp_p.
 * The cheapest way, safe while no pivot cancels; false when one does. */
static bool refactor_by_sum(int n, const dse_real *W, const dse_real *d, const dse_real *Q,
                            dse_real w, dse_real *Tp, dse_real *dp, dse_real *a)
{
    const int s = DSE_FACTORED_STRIDE(n);
    for (int k = 0; k < n; k++) {
        const int from = block_start(k);
        dse_real *t = Tp + k * s;
        start_row(n, k, Q, w, t);
        column_weights(n, s, W, d, k, a);
        combine_add(s - from, n, a, 1, W + from, s, t + from);
        const dse_real variance = t[k];
        column_weights(k, s, Tp, dp, k, a);
        combine_subtract(s - from, k, a, 1, Tp + from, s, t + from);
        dp[k] = t[k];
        if (!(dp[k] > PIVOT_FRACTION * variance) || !dse_is_finite(dp[k]))
            return false;
        finish_row(s, k, 1 / dp[k], t);
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
    const int s = DSE_FACTORED_STRIDE(n);
    for (int k = 0; k < n; k++) {
        dse_real *t = Tp + k * s;
        for (int j = 0; j < s; j++)
            t[j] = 0;
        for (int r = 0; r < m; r++)
            dse_axpy(n - k, D[r] * Y[r * s + k], Y + r * s + k, t + k);
        dp[k] = t[k];
        if (!dse_is_finite(dp[k]))
            return DSE_ENONFINITE;
        for (int j = k + 1; j < n; j++)
            t[j] = dp[k] > 0 ? t[j] / dp[k] : 0;
        t[k] = 1;
        for (int r = 0; r < m; r++)
            dse_axpy(n - 1 - k, -Y[r * s + k], t + k + 1, Y + r * s + k + 1);
        if (!dse_all_finite(t + k, n - k))
            return DSE_ENONFINITE;
    }
    return DSE_OK;
}

enum dse_status dse_factored_from(int n, const dse_real *P, dse_real *T, dse_real *d,
                                  dse_real *scratch)
{
    const int s = DSE_FACTORED_STRIDE(n);
    dse_real *Y = scratch, *weights = Y + n * s;
    const enum dse_status status = dse_semidefinite_rows(n, s, P, Y, weights);
    if (status != DSE_OK)
        return status;
    return refactor_orthogonally(n, n, Y, weights, T, d);
}

enum dse_status dse_factored_predict(int n, const dse_real *T, const dse_real *d, const dse_real *Q,
                                     dse_real w, const dse_real *F, dse_real *Tp, dse_real *dp,
                                     dse_real *scratch)
{
    const int s = DSE_FACTORED_STRIDE(n);
    dse_real *W = scratch, *Ft = W + n * s, *weights = Ft + n * s, *prior = weights + n;
    transpose_padded(n, n, F, Ft);
    combine_unit_upper(n, s, T, Ft, W); /* W = T F' */
    for (int j = 0; j < n; j++)
        prior[j] = d[j];
    if (refactor_by_sum(n, W, prior, Q, w, Tp, dp, weights))
        return DSE_OK;

    for (int j = 0; j < n; j++)
        weights[j] = prior[j];
    if (!Q)
        return refactor_orthogonally(n, n, W, weights, Tp, dp);
    const enum dse_status status = dse_semidefinite_rows(n, s, Q, Ft, weights + n); /* behind W */
    if (status != DSE_OK)
        return status;
    for (int j = 0; j < n; j++)
        weights[n + j] *= w;
    return refactor_orthogonally(2 * n, n, W, weights, Tp, dp);
}

void dse_factored_project(int n, int m, const dse_real *T, const dse_real *H, dse_real *G,
                          dse_real *scratch)
{
    transpose_padded(m, n, H, scratch);
    combine_unit_upper(n, DSE_FACTORED_STRIDE(m), T, scratch, G);
}

dse_real dse_factored_form(int n, int m, const dse_real *d, const dse_real *G, int c)
{
    const int s = DSE_FACTORED_STRIDE(m);
    dse_real sum = 0;
    for (int j = 0; j < n; j++)
        sum += d[j] * G[j * s + c] * G[j * s + c];
    return sum;
}

/* What one scalar measurement with f = T h does to the weights; alpha_n = r, from the last row up:
 *     g_j = d_j f_j,  alpha_j = alpha_{j+1} + f_j g_j
 *     dn_j = d_j alpha_{j+1} / alpha_j,  lambda_j = -f_j / alpha_{j+1}
 * alpha and reciprocal have n + 1 entries. Returns alpha_0 = h' P h + r. */
static inline dse_real update_weights(int n, const dse_real *d, const dse_real *f, dse_real r,
                                      dse_real *dn, dse_real *g, dse_real *lambda, dse_real *alpha,
                                      dse_real *reciprocal)
{
    dse_real sum = r;
    alpha[n] = r;
    for (int j = n - 1; j >= 0; j--) {
        g[j] = d[j] * f[j];
        sum += f[j] * g[j];
        alpha[j] = sum;
    }
    for (int j = 0; j <= n; j++)
        reciprocal[j] = 1 / alpha[j];
    for (int j = 0; j < n; j++) {
        dn[j] = d[j] * (alpha[j + 1] * reciprocal[j]);
        lambda[j] = -(f[j] * reciprocal[j + 1]);
    }
    return sum;
}

/* The same for the rows of T, or of anything that is multiplied by T, a block of columns at a time
 * with v in registers; rows from the last one up, v = 0 in the beginning:
 *     N_j = M_j + lambda_j v,  v <- v + g_j M_j
 * N may be M. Columns 0 .. 2 LANES - 1 of `rows` rows with stride s. */
static inline void update_rows_2(int rows, int s, const dse_real *g, const dse_real *lambda,
                                 const dse_real *M, dse_real *N, dse_real *v)
{
    lanes v0 = lanes_all(0), v1 = lanes_all(0);
    for (int j = rows - 1; j >= 0; j--) {
        const lanes m0 = lanes_load(M + j * s), m1 = lanes_load(M + j * s + LANES);
        const lanes l = lanes_all(lambda[j]), w = lanes_all(g[j]);
        lanes_store(N + j * s, m0 + l * v0);
        lanes_store(N + j * s + LANES, m1 + l * v1);
        v0 += w * m0;
        v1 += w * m1;
    }
    lanes_store(v, v0);
    lanes_store(v + LANES, v1);
}

static inline void update_rows_1(int rows, int s, const dse_real *g, const dse_real *lambda,
                                 const dse_real *M, dse_real *N, dse_real *v)
{
    lanes v0 = lanes_all(0);
    for (int j = rows - 1; j >= 0; j--) {
        const lanes m0 = lanes_load(M + j * s);
        lanes_store(N + j * s, m0 + lambda[j] * v0);
        v0 += g[j] * m0;
    }
    lanes_store(v, v0);
}

/* All w columns. Triangular: column i of T ends at row i, and the zeros below the diagonal within a
 * block stay zero. */
static inline void update_rows(int n, int w, bool triangular, int s, const dse_real *g,
                               const dse_real *lambda, const dse_real *M, dse_real *N, dse_real *v)
{
    int i = 0;
    for (; i + 2 * LANES <= w; i += 2 * LANES)
        update_rows_2(triangular && i + 2 * LANES < n ? i + 2 * LANES : n, s, g, lambda, M + i,
                      N + i, v + i);
    for (; i < w; i += LANES)
        update_rows_1(triangular && i + LANES < n ? i + LANES : n, s, g, lambda, M + i, N + i,
                      v + i);
}

dse_real dse_factored_update(int n, int m, const dse_real *T, const dse_real *d, dse_real *G,
                             const dse_real *r, dse_real *e, dse_real *Tn, dse_real *dn,
                             dse_real *dx, dse_real *scratch)
{
    const int s = DSE_FACTORED_STRIDE(n), sm = DSE_FACTORED_STRIDE(m);
    dse_real *f = scratch, *g = f + n, *lambda = g + n, *v = lambda + n, *w = v + s;
    dse_real *alpha = w + sm, *reciprocal = alpha + n + 1;
    dse_real nis = 0;
    for (int i = 0; i < n; i++)
        dx[i] = 0;
    for (int c = 0; c < m; c++) {
        for (int j = 0; j < n; j++)
            f[j] = G[j * sm + c];
        const dse_real variance = update_weights(n, d, f, r[c], dn, g, lambda, alpha, reciprocal);
        const int from = block_start(c + 1); /* columns of G still to come see the new T */
        if (from < sm)
            update_rows(n, sm - from, false, sm, g, lambda, G + from, G + from, w + from);
        update_rows(n, s, true, s, g, lambda, T, Tn, v);
        const dse_real k = e[c] / variance; /* dx += P h k, hence e_l -= h_l' P h k */
        nis += e[c] * k;
        for (int i = 0; i < n; i++)
            dx[i] += k * v[i];
        for (int l = c + 1; l < m; l++)
            e[l] -= k * w[l];
        T = Tn;
        d = dn;
    }
    return nis;
}

bool dse_factored_is_finite(int n, const dse_real *T, const dse_real *d)
{
    const int s = DSE_FACTORED_STRIDE(n);
    lanes sum = lanes_all(0); /* 0 x is NaN for every x that is not finite, and NaN stays NaN */
    for (int j = 0; j < n; j++) {
        for (int i = block_start(j); i < s; i += LANES)
            sum += 0 * lanes_load(T + j * s + i);
        sum += lanes_all(0 * d[j]);
    }
    dse_real parts[LANES], total = 0;
    lanes_store(parts, sum);
    for (int i = 0; i < LANES; i++)
        total += parts[i];
    return total == 0;
}
