/* Linear moving horizon estimator: how far given states are from optimal, from the data of the
 * problem alone. */
#include <stddef.h>

#include "dse/linalg.h"
#include "dse/linear_mhe.h"
#include "dse/math.h"
#include "linear_mhe_internal.h"

/* The largest absolute values over the window, and what follows from them. */
struct sizes {
    dse_real *x;        /* nx */
    dse_real *b;        /* nx */
    dse_real *residual; /* nx: of the transitions */
    dse_real *dual;     /* nx: of the terms of lambda */
    dse_real *work;     /* nx */
    dse_real *white;    /* ny */
};

static struct sizes sizes_in(const struct dse_linear_mhe *mhe)
{
    struct sizes s;
    s.x = mhe->scratch;
    s.b = s.x + mhe->nx;
    s.residual = s.b + mhe->nx;
    s.dual = s.residual + mhe->nx;
    s.work = s.dual + mhe->nx;
    s.white = s.work + mhe->nx;
    return s;
}

static dse_real larger(dse_real value, dse_real largest)
{
    const dse_real a = dse_abs(value);
    return a > largest ? a : largest;
}

/* largest_i <- max(largest_i, max_j |v_ji|), v count x n. A NaN does not count here: it makes
 * lambda_0 NaN. */
static void enlarge(int count, int n, const dse_real *v, dse_real *largest)
{
    int i = 0;
    for (; i + 4 <= n; i += 4) {
        dse_real l0 = largest[i], l1 = largest[i + 1], l2 = largest[i + 2], l3 = largest[i + 3];
        for (int j = 0; j < count; j++) {
            const dse_real *row = v + j * n + i;
            l0 = larger(row[0], l0);
            l1 = larger(row[1], l1);
            l2 = larger(row[2], l2);
            l3 = larger(row[3], l3);
        }
        largest[i] = l0;
        largest[i + 1] = l1;
        largest[i + 2] = l2;
        largest[i + 3] = l3;
    }
    for (; i < n; i++)
        for (int j = 0; j < count; j++)
            largest[i] = larger(v[j * n + i], largest[i]);
}

/* Samples from j on that lie side by side in the ring, beginning in that place. */
static int side_by_side(const struct dse_linear_mhe *mhe, int j, int place)
{
    const int window = mhe->length - j, ring = mhe->N - place;
    return window < ring ? window : ring;
}

/* mhe->errors (length x ny) = white_j - E_j x_j and mhe->lambda = E_j' of them: all at once, but
 * for incomplete samples. */
static void find_output_errors(struct dse_linear_mhe *mhe, const dse_real *x, const struct sizes *s)
{
    const int nx = mhe->nx, ny = mhe->ny, H = mhe->length;
    for (int j = 0, count; j < H; j += count) {
        const int place = linear_mhe_place(mhe, j);
        const dse_real *white = mhe->white + place * ny;
        count = side_by_side(mhe, j, place);
        dse_mat_mul_subtract(count, nx, ny, x + j * nx, mhe->E_transposed, white,
                             mhe->errors + j * ny);
        enlarge(count, ny, white, s->white);
    }
    enlarge(H, nx, x, s->x);
    dse_mat_mul(H, ny, nx, mhe->errors, mhe->E, mhe->lambda);
    for (int j = 0; j < H && mhe->incomplete > 0; j++) {
        const int place = linear_mhe_place(mhe, j);
        const dse_real *rows = linear_mhe_rows(mhe, place), *white = mhe->white + place * ny;
        dse_real *error = mhe->errors + j * ny;
        if (linear_mhe_is_complete(mhe, place))
            continue;
        for (int c = 0; c < ny; c++)
            error[c] = white[c] - dse_dot(nx, rows + c * nx, x + j * nx);
        dse_mat_tvec(ny, nx, rows, error, mhe->lambda + j * nx);
    }
}

/* Multipliers of the bounds of x_j, and of those of the disturbance that leads to x_j, j > 0. */
static const dse_real *mu(const struct dse_linear_mhe *mhe, const dse_real *y, int j)
{
    return y + 2 * j * mhe->nx;
}

static const dse_real *nu(const struct dse_linear_mhe *mhe, const dse_real *y, int j)
{
    return y + (2 * j - 1) * mhe->nx;
}

/* Backwards  lambda_j = E_j' (white_j - E_j x_j) - mu_j + A' lambda_{j+1}. */
static void find_multipliers(struct dse_linear_mhe *mhe, const dse_real *x, const dse_real *y,
                             const struct sizes *s)
{
    const int nx = mhe->nx;
    const dse_real *A = mhe->config->linear.A;
    find_output_errors(mhe, x, s);
    for (int j = mhe->length - 1; j >= 0; j--) {
        dse_real *lambda = mhe->lambda + j * nx;
        if (y)
            dse_axpy(nx, -1, mu(mhe, y, j), lambda);
        if (j < mhe->length - 1)
            dse_mat_tvec_add(nx, nx, A, lambda + nx, lambda, lambda);
    }
}

/* r <- r - Q (lambda_j - nu_j). */
static void subtract_disturbance(const struct dse_linear_mhe *mhe, int j, const dse_real *y,
                                 dse_real *r)
{
    const int nx = mhe->nx;
    const dse_real *Q = mhe->config->Q, *dual = mhe->lambda + j * nx;
    if (y) {
        for (int i = 0; i < nx; i++)
            mhe->product[i] = dual[i] - nu(mhe, y, j)[i];
        dual = mhe->product;
    }
    if (!mhe->Q_diagonal)
        dse_mat_mul_subtract(1, nx, nx, dual, Q, r, r); /* symmetric */
    for (int i = 0; i < nx && mhe->Q_diagonal; i++)
        r[i] -= Q[i * nx + i] * dual[i];
}

/* residual_0 = x_0 - xbar - P lambda_0  or  lambda_0. */
static void find_start_residual(struct dse_linear_mhe *mhe, const dse_real *x,
                                const struct sizes *s)
{
    const int nx = mhe->nx, rank = mhe->prior_rank; /* 0 when NONE */
    const bool none = mhe->config->arrival == DSE_ARRIVAL_NONE;
    dse_real *r = mhe->residual;
    for (int i = 0; i < nx; i++)
        r[i] = none ? mhe->lambda[i] : x[i] - mhe->xbar[i];
    dse_mat_vec(rank, nx, mhe->prior_V, mhe->lambda, s->work);
    dse_mat_mul_subtract(1, rank, nx, s->work, mhe->prior_V, r, r);
}

/* residual_j = x_j - A x_{j-1} - b_j - Q (lambda_j - nu_j). */
static void find_residuals(struct dse_linear_mhe *mhe, const dse_real *x, const dse_real *y,
                           const struct sizes *s)
{
    const int nx = mhe->nx, H = mhe->length;
    for (int j = 1, count; j < H; j += count) {
        const int place = linear_mhe_place(mhe, j);
        const dse_real *b = mhe->b + place * nx;
        count = side_by_side(mhe, j, place);
        dse_mat_mul_add(count, nx, nx, x + (j - 1) * nx, mhe->A_transposed, b,
                        mhe->residual + j * nx);
        if (mhe->nu > 0)
            enlarge(count, nx, b, s->b);
    }
    for (int k = nx; k < H * nx; k++)
        mhe->residual[k] = x[k] - mhe->residual[k];
    for (int j = 1; j < H && mhe->config->Q; j++)
        subtract_disturbance(mhe, j, y, mhe->residual + j * nx);
    enlarge(H - 1, nx, mhe->residual + nx, s->residual);
    find_start_residual(mhe, x, s);
}

/* sum_p |m_p| v_p, in four partial sums for the sake of speed. */
static dse_real row_size(int n, const dse_real *m, const dse_real *v)
{
    dse_real s0 = 0, s1 = 0, s2 = 0, s3 = 0;
    int p = 0;
    for (; p + 4 <= n; p += 4) {
        s0 += dse_abs(m[p]) * v[p];
        s1 += dse_abs(m[p + 1]) * v[p + 1];
        s2 += dse_abs(m[p + 2]) * v[p + 2];
        s3 += dse_abs(m[p + 3]) * v[p + 3];
    }
    for (; p < n; p++)
        s0 += dse_abs(m[p]) * v[p];
    return (s0 + s1) + (s2 + s3);
}

/* v += a |m|. */
static void add_size(int n, dse_real a, const dse_real *restrict m, dse_real *restrict v)
{
    for (int i = 0; i < n; i++)
        v[i] += a * dse_abs(m[i]);
}

/* What lambda consists of, and what its recursion makes of it over the horizon:
 *     dual = (I + |A|' + .. + (|A|')^{N-1}) (|E|' (|white| + |E| |x|) + |mu|) + |nu|. */
static void find_dual_size(const struct dse_linear_mhe *mhe, const dse_real *y,
                           const struct sizes *s)
{
    const int nx = mhe->nx, ny = mhe->ny;
    for (int i = 0; i < nx; i++)
        s->work[i] = 0;
    for (int j = 0; y && j < mhe->length; j++)
        enlarge(1, nx, mu(mhe, y, j), s->work);
    for (int c = 0; c < ny; c++) {
        const dse_real *e = mhe->E + c * nx;
        add_size(nx, s->white[c] + row_size(nx, e, s->x), e, s->work);
    }
    dse_mat_vec(nx, nx, mhe->spread, s->work, s->dual);
    if (!y)
        return;
    for (int i = 0; i < nx; i++)
        s->work[i] = 0;
    for (int j = 1; j < mhe->length; j++)
        enlarge(1, nx, nu(mhe, y, j), s->work);
    dse_axpy(nx, 1, s->work, s->dual);
}

/* spread = I + |A|' + .. + (|A|')^{N-1}, by Horner's rule. */
void linear_mhe_find_spread(struct dse_linear_mhe *mhe)
{
    const int nx = mhe->nx;
    const dse_real *A = mhe->config->linear.A;
    dse_real *next = mhe->scratch;
    dse_mat_identity(nx, mhe->spread);
    for (int k = 1; k < mhe->N; k++) {
        for (int i = 0; i < nx; i++) {
            for (int j = 0; j < nx; j++) {
                next[i * nx + j] = i == j;
                for (int p = 0; p < nx; p++)
                    next[i * nx + j] += dse_abs(A[p * nx + i]) * mhe->spread[p * nx + j];
            }
        }
        for (int i = 0; i < nx * nx; i++)
            mhe->spread[i] = next[i];
    }
}

/* residual / size where there is something, and infinity where a residual has no terms. */
static dse_real ratio(dse_real residual, dse_real size)
{
    return residual == 0 ? 0 : residual / size;
}

/* The start: |x_0| + |xbar| + |P| dual, with |P| <= sum_p |V_p| |V_p|'. */
static dse_real start_ratio(const struct dse_linear_mhe *mhe, const dse_real *x,
                            const struct sizes *s)
{
    const int nx = mhe->nx;
    const bool none = mhe->config->arrival == DSE_ARRIVAL_NONE;
    for (int i = 0; i < nx; i++)
        s->work[i] = none ? s->dual[i] : dse_abs(x[i]) + dse_abs(mhe->xbar[i]);
    for (int p = 0; p < mhe->prior_rank; p++) { /* rank 0 when NONE */
        const dse_real *v = mhe->prior_V + p * nx;
        add_size(nx, row_size(nx, v, s->dual), v, s->work);
    }
    dse_real worst = 0;
    for (int i = 0; i < nx; i++)
        worst = dse_max(worst, ratio(dse_abs(mhe->residual[i]), s->work[i]));
    return worst;
}

/* A transition: |x| + |A| |x| + |b| + |Q| dual. */
static dse_real transition_ratio(const struct dse_linear_mhe *mhe, const struct sizes *s)
{
    const int nx = mhe->nx;
    const dse_real *A = mhe->config->linear.A, *Q = mhe->config->Q;
    dse_real worst = 0;
    for (int i = 0; i < nx; i++) {
        const dse_real noise = !Q                ? 0
                               : mhe->Q_diagonal ? Q[i * nx + i] * s->dual[i]
                                                 : row_size(nx, Q + i * nx, s->dual);
        const dse_real size = s->x[i] + row_size(nx, A + i * nx, s->x) + s->b[i] + noise;
        worst = dse_max(worst, ratio(s->residual[i], size));
    }
    return worst;
}

dse_real linear_mhe_certify(struct dse_linear_mhe *mhe, const dse_real *x, const dse_real *y)
{
    const struct sizes s = sizes_in(mhe);
    for (int i = 0; i < 5 * mhe->nx + mhe->ny; i++)
        s.x[i] = 0;
    find_multipliers(mhe, x, y, &s);
    const dse_real oldest = dse_norm_max(mhe->nx, mhe->lambda);
    if (!dse_is_finite(oldest)) /* what is not finite comes down to lambda_0 */
        return oldest;
    find_residuals(mhe, x, y, &s);
    find_dual_size(mhe, y, &s);
    return dse_max(start_ratio(mhe, x, &s), transition_ratio(mhe, &s));
}

dse_real dse_linear_mhe_certify(struct dse_linear_mhe *mhe, const dse_real *x)
{
    return linear_mhe_certify(mhe, x, NULL);
}
