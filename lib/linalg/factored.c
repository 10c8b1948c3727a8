/* Time and measurement updates of a factored covariance.
 *
 * Rows are padded with zeros to a multiple of four columns, and triangular rows are taken from the
 * multiple of four at or left of their diagonal: loops then have few and equal lengths, without
 * remainders. Padding only ever meets padding, so it changes no result. */
#include "dse/factored.h"

#include <stdbool.h>
#include <stddef.h>

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
    for (int j = 0; j < n; j++)
        combine(sm, n - 1 - j, T + j * s + j + 1, 1, B + (j + 1) * sm, sm, 1, true, B + j * sm,
                W + j * sm);
}

/* A tile of four rows and 2 LANES columns, in registers while p runs over the rows of M:
 *     c_ij <- c_ij +- sum_p d_p A_pi B_pj,   i < 4,  j < 2 LANES,  A and B blocks of columns of M.
 */
static inline void tile_2(int m, const dse_real *d, const dse_real *A, const dse_real *B, int s,
                          dse_real sign, dse_real *c)
{
    lanes c00, c01, c10, c11, c20, c21, c30, c31;
    c00 = c01 = c10 = c11 = c20 = c21 = c30 = c31 = lanes_all(0);
    if (sign < 0) {
        c00 = lanes_load(c);
        c01 = lanes_load(c + LANES);
        c10 = lanes_load(c + s);
        c11 = lanes_load(c + s + LANES);
        c20 = lanes_load(c + 2 * s);
        c21 = lanes_load(c + 2 * s + LANES);
        c30 = lanes_load(c + 3 * s);
        c31 = lanes_load(c + 3 * s + LANES);
    }
    for (int p = 0; p < m; p++, A += s, B += s) {
        const dse_real w = sign * d[p];
        const lanes b0 = w * lanes_load(B), b1 = w * lanes_load(B + LANES);
        c00 += A[0] * b0;
        c01 += A[0] * b1;
        c10 += A[1] * b0;
        c11 += A[1] * b1;
        c20 += A[2] * b0;
        c21 += A[2] * b1;
        c30 += A[3] * b0;
        c31 += A[3] * b1;
    }
    lanes_store(c, c00);
    lanes_store(c + LANES, c01);
    lanes_store(c + s, c10);
    lanes_store(c + s + LANES, c11);
    lanes_store(c + 2 * s, c20);
    lanes_store(c + 2 * s + LANES, c21);
    lanes_store(c + 3 * s, c30);
    lanes_store(c + 3 * s + LANES, c31);
}

static inline void tile_1(int m, const dse_real *d, const dse_real *A, const dse_real *B, int s,
                          dse_real sign, dse_real *c)
{
    lanes c0, c1, c2, c3;
    c0 = c1 = c2 = c3 = lanes_all(0);
    if (sign < 0) {
        c0 = lanes_load(c);
        c1 = lanes_load(c + s);
        c2 = lanes_load(c + 2 * s);
        c3 = lanes_load(c + 3 * s);
    }
    for (int p = 0; p < m; p++, A += s, B += s) {
        const lanes b = (sign * d[p]) * lanes_load(B);
        c0 += A[0] * b;
        c1 += A[1] * b;
        c2 += A[2] * b;
        c3 += A[3] * b;
    }
    lanes_store(c, c0);
    lanes_store(c + s, c1);
    lanes_store(c + 2 * s, c2);
    lanes_store(c + 3 * s, c3);
}

/* U = M' diag(d) M (sign 1) or U <- U - M' diag(d) M (sign -1), rows k .. k + 3 of it (U is the
 * first of them), columns k .. s - 1; M has m rows. */
static inline void add_products(int m, const dse_real *d, const dse_real *M, int s, int k,
                                dse_real sign, dse_real *U)
{
    int j = k;
    for (; j + 2 * LANES <= s; j += 2 * LANES)
        tile_2(m, d, M + k, M + j, s, sign, U + j);
    for (; j < s; j += LANES)
        tile_1(m, d, M + k, M + j, s, sign, U + j);
}

/* U <- U + w Q in rows k .. k + rows - 1, columns k .. n - 1. */
static inline void add_noise(int n, int k, int rows, const dse_real *Q, dse_real w, dse_real *U)
{
    const int s = DSE_FACTORED_STRIDE(n);
    for (int i = 0; i < rows; i++) {
        const dse_real *q = Q + (k + i) * n;
        dse_real *u = U + i * s;
        int j = k;
        for (; j + LANES <= n; j += LANES)
            lanes_store(u + j, lanes_load(u + j) + w * lanes_load(q + j));
        for (; j < n; j++)
            u[j] += w * q[j];
    }
}

/* Elimination within rows k .. k + rows - 1, after all that earlier rows do to them:
 *     d_i = U_ii,  T_i = U_i / d_i,  U_l <- U_l - U_il T_i  for l > i.
 * variance: the diagonal before any elimination. False when a pivot cancels. */
static bool eliminate_rows(int s, int k, int rows, const dse_real *variance, dse_real *U,
                           dse_real *dp)
{
    for (int i = 0; i < rows; i++) {
        dse_real *u = U + i * s;
        dp[i] = u[k + i];
        if (!(dp[i] > PIVOT_FRACTION * variance[i]) || !dse_is_finite(dp[i]))
            return false;
        if (dp[i] < DSE_REAL_MIN) /* its inverse would overflow */
            return false;
        const dse_real inverse = 1 / dp[i];
        for (int l = i + 1; l < rows; l++) {
            const dse_real factor = -(u[k + l] * inverse);
            for (int j = k; j < s; j += LANES)
                lanes_store(U + l * s + j, lanes_load(U + l * s + j) + factor * lanes_load(u + j));
        }
        for (int j = k; j < s; j += LANES)
            lanes_store(u + j, inverse * lanes_load(u + j));
        for (int j = 0; j < i; j++)
            u[k + j] = 0;
        u[k + i] = 1;
    }
    return true;
}

/* Tp' diag(dp) Tp = U = W' diag(d) W + w Q by forming the sum, four rows at a time, and factoring
 * it on the way: U_k = w Q_k + sum_j (d_j W_jk) W_j - sum_{p<k} (dp_p Tp_pk) Tp_p. The cheapest
 * way, safe while no pivot cancels; false when one does. `rows`: four rows. */
static bool refactor_by_sum(int n, const dse_real *W, const dse_real *d, const dse_real *Q,
                            dse_real w, dse_real *Tp, dse_real *dp, dse_real *four_rows)
{
    const int s = DSE_FACTORED_STRIDE(n);
    for (int k = 0; k < n; k += 4) {
        const int rows = n - k < 4 ? n - k : 4;
        dse_real *U = rows == 4 ? Tp + k * s : four_rows;
        dse_real variance[4];
        add_products(n, d, W, s, k, 1, U);
        if (Q)
            add_noise(n, k, rows, Q, w, U);
        for (int i = 0; i < rows; i++)
            variance[i] = U[i * s + k + i];
        if (k > 0)
            add_products(k, dp, Tp, s, k, -1, U);
        if (!eliminate_rows(s, k, rows, variance, U, dp + k))
            return false;
        for (int i = 0; i < rows && U == four_rows; i++)
            for (int j = k; j < s; j++)
                Tp[(k + i) * s + j] = U[i * s + j];
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
    dse_real *four_rows = prior + n;
    transpose_padded(n, n, F, Ft);
    combine_unit_upper(n, s, T, Ft, W); /* W = T F' */
    for (int j = 0; j < n; j++)
        prior[j] = d[j];
    if (refactor_by_sum(n, W, prior, Q, w, Tp, dp, four_rows))
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

/* What one scalar measurement does to the rows of T and their weights. */
struct channel {
    dse_real *f;      /* n: T h */
    dse_real *g;      /* n: d f */
    dse_real *lambda; /* n */
    dse_real *v;      /* stride of n: P h */
    dse_real *w;      /* stride of m: H P h */
    dse_real variance;
};

/* Weights of a channel with noise variance r; alpha_n = r, from the last row up:
 *     g_j = d_j f_j,  alpha_j = alpha_{j+1} + f_j g_j
 *     dn_j = d_j alpha_{j+1} / alpha_j,  lambda_j = -f_j / alpha_{j+1}
 * The variance of the innovation is alpha_0 = h' P h + r. alpha and reciprocal: n + 1 each. dn may
 * be d. */
static void channel_weights(int n, const dse_real *d, dse_real r, struct channel *channel,
                            dse_real *dn, dse_real *restrict alpha, dse_real *restrict reciprocal)
{
    const dse_real *restrict f = channel->f;
    dse_real *restrict g = channel->g, *restrict lambda = channel->lambda;
    dse_real sum = r;
    alpha[n] = r;
    for (int j = n - 1; j >= 0; j--) {
        g[j] = d[j] * f[j];
        sum += f[j] * g[j];
        alpha[j] = sum;
    }
    for (int j = 0; j <= n; j++)
        reciprocal[j] = 1 / alpha[j];
    for (int j = 0; j < n; j++)
        dn[j] = d[j] * (alpha[j + 1] * reciprocal[j]);
    for (int j = 0; j < n; j++)
        lambda[j] = -(f[j] * reciprocal[j + 1]);
    channel->variance = sum;
}

/* The same for the rows of T, or of anything that is multiplied by T, a block of columns at a time
 * with v in registers; rows from the last one up, v = 0 in the beginning:
 *     N_j = M_j + lambda_j v,  v <- v + g_j M_j
 * N may be M. Two channels one after the other, in one pass over the rows: */
static inline void update_rows_twice(int rows, int s, const struct channel *a,
                                     const struct channel *b, int i, const dse_real *M, dse_real *N)
{
    lanes va0 = lanes_all(0), va1 = va0, vb0 = va0, vb1 = va0;
    for (int j = rows - 1; j >= 0; j--) {
        const lanes m0 = lanes_load(M + j * s + i), m1 = lanes_load(M + j * s + i + LANES);
        const lanes la = lanes_all(a->lambda[j]), ga = lanes_all(a->g[j]);
        const lanes lb = lanes_all(b->lambda[j]), gb = lanes_all(b->g[j]);
        const lanes k0 = m0 + la * va0, k1 = m1 + la * va1;
        va0 += ga * m0;
        va1 += ga * m1;
        lanes_store(N + j * s + i, k0 + lb * vb0);
        lanes_store(N + j * s + i + LANES, k1 + lb * vb1);
        vb0 += gb * k0;
        vb1 += gb * k1;
    }
    lanes_store(a->v + i, va0);
    lanes_store(a->v + i + LANES, va1);
    lanes_store(b->v + i, vb0);
    lanes_store(b->v + i + LANES, vb1);
}

static inline void update_rows_2(int rows, int s, const struct channel *a, const dse_real *M,
                                 dse_real *N, dse_real *v)
{
    lanes v0 = lanes_all(0), v1 = v0;
    for (int j = rows - 1; j >= 0; j--) {
        const lanes m0 = lanes_load(M + j * s), m1 = lanes_load(M + j * s + LANES);
        const lanes l = lanes_all(a->lambda[j]), g = lanes_all(a->g[j]);
        lanes_store(N + j * s, m0 + l * v0);
        lanes_store(N + j * s + LANES, m1 + l * v1);
        v0 += g * m0;
        v1 += g * m1;
    }
    lanes_store(v, v0);
    lanes_store(v + LANES, v1);
}

static inline void update_rows_1(int rows, int s, const struct channel *a, const dse_real *M,
                                 dse_real *N, dse_real *v)
{
    lanes v0 = lanes_all(0);
    for (int j = rows - 1; j >= 0; j--) {
        const lanes m0 = lanes_load(M + j * s);
        lanes_store(N + j * s, m0 + lanes_all(a->lambda[j]) * v0);
        v0 += lanes_all(a->g[j]) * m0;
    }
    lanes_store(v, v0);
}

/* Columns of G from the block of `from` on. */
static void update_projection(int n, int sm, const struct channel *a, int from, dse_real *G)
{
    int i = block_start(from);
    for (; i + 2 * LANES <= sm; i += 2 * LANES)
        update_rows_2(n, sm, a, G + i, G + i, a->w + i);
    for (; i < sm; i += LANES)
        update_rows_1(n, sm, a, G + i, G + i, a->w + i);
}

static inline int smaller(int a, int b)
{
    return a < b ? a : b;
}

/* T, by one channel or by two (b not NULL). Column i of T ends at row i; the zeros below the
 * diagonal within a block stay zero. */
static void update_triangle(int n, const struct channel *a, const struct channel *b,
                            const dse_real *T, dse_real *Tn)
{
    const int s = DSE_FACTORED_STRIDE(n);
    int i = 0;
    for (; i + 2 * LANES <= s && b; i += 2 * LANES)
        update_rows_twice(smaller(i + 2 * LANES, n), s, a, b, i, T, Tn);
    for (; i + 2 * LANES <= s; i += 2 * LANES)
        update_rows_2(smaller(i + 2 * LANES, n), s, a, T + i, Tn + i, a->v + i);
    for (; i < s; i += LANES) {
        update_rows_1(smaller(i + LANES, n), s, a, T + i, Tn + i, a->v + i);
        if (b)
            update_rows_1(smaller(i + LANES, n), s, b, Tn + i, Tn + i, b->v + i);
    }
}

/* Everything about channel c but T: its f, its weights, and what it does to the columns of G that
 * are still to come, because they are to see the new T. */
static void prepare_channel(int n, int m, int c, const dse_real *d, dse_real r, dse_real *G,
                            struct channel *channel, dse_real *dn, dse_real *work)
{
    const int sm = DSE_FACTORED_STRIDE(m);
    for (int j = 0; j < n; j++)
        channel->f[j] = G[j * sm + c];
    channel_weights(n, d, r, channel, dn, work, work + n + 1);
    if (c + 1 < m)
        update_projection(n, sm, channel, c + 1, G);
}

/* dx += P h e_c / s,  e_l -= h_l' P h e_c / s  for the channels to come; returns e_c^2 / s. */
static dse_real use_innovation(int n, int m, int c, const struct channel *channel, dse_real *e,
                               dse_real *restrict dx)
{
    const dse_real *restrict v = channel->v;
    const dse_real k = e[c] / channel->variance, contribution = e[c] * k;
    for (int i = 0; i < n; i++)
        dx[i] += k * v[i];
    for (int l = c + 1; l < m; l++)
        e[l] -= k * channel->w[l];
    return contribution;
}

dse_real dse_factored_update(int n, int m, const dse_real *T, const dse_real *d, dse_real *G,
                             const dse_real *r, dse_real *e, dse_real *Tn, dse_real *dn,
                             dse_real *dx, dse_real *scratch)
{
    const int s = DSE_FACTORED_STRIDE(n), sm = DSE_FACTORED_STRIDE(m);
    struct channel pair[2];
    for (int i = 0; i < 2; i++) {
        pair[i].v = scratch;
        pair[i].w = pair[i].v + s;
        pair[i].f = pair[i].w + sm;
        pair[i].g = pair[i].f + n;
        pair[i].lambda = pair[i].g + n;
        scratch = pair[i].lambda + n;
    }
    dse_real nis = 0;
    for (int i = 0; i < n; i++)
        dx[i] = 0;
    for (int c = 0; c < m; c += 2) {
        const bool both = c + 1 < m;
        prepare_channel(n, m, c, d, r[c], G, &pair[0], dn, scratch);
        if (both)
            prepare_channel(n, m, c + 1, dn, r[c + 1], G, &pair[1], dn, scratch);
        update_triangle(n, &pair[0], both ? &pair[1] : NULL, T, Tn);
        nis += use_innovation(n, m, c, &pair[0], e, dx);
        if (both)
            nis += use_innovation(n, m, c + 1, &pair[1], e, dx);
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
