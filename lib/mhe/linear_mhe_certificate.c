/* Linear moving horizon estimator: how far given states are from optimal, from the data of the
 * problem alone. */
#include <stddef.h>

#include "dse/linalg.h"
#include "dse/linear_mhe.h"
#include "dse/math.h"
#include "linear_mhe_internal.h"

/* The largest absolute values over the window, and what follows from them. */
struct sizes {
    dse_real *x;     /* nx */
    dse_real *b;     /* nx */
    dse_real *white; /* ny */
    dse_real *dual;  /* nx: of the terms of lambda */
    dse_real *work;  /* nx */
};

static struct sizes sizes_in(const struct dse_linear_mhe *mhe)
{
    struct sizes s;
    s.x = mhe->scratch;
    s.b = s.x + mhe->nx;
    s.dual = s.b + mhe->nx;
    s.work = s.dual + mhe->nx;
    s.white = s.work + mhe->nx;
    return s;
}

/* A NaN does not count here: it makes a residual NaN. */
static void enlarge(int n, const dse_real *v, dse_real *largest)
{
    for (int i = 0; i < n; i++) {
        const dse_real a = dse_abs(v[i]);
        largest[i] = a > largest[i] ? a : largest[i];
    }
}

/* mhe->errors (length x ny) = white_j - E_j x_j, all at once but for incomplete samples; and
 * mhe->lambda = E_j' of them. */
static void find_output_errors(struct dse_linear_mhe *mhe, const dse_real *x, const struct sizes *s)
{
    const int nx = mhe->nx, ny = mhe->ny, H = mhe->length;
    dse_mat_mul(H, nx, ny, x, mhe->E_transposed, mhe->errors);
    for (int j = 0; j < H; j++) {
        const int place = linear_mhe_place(mhe, j);
        const dse_real *white = mhe->white + place * ny;
        dse_real *error = mhe->errors + j * ny;
        if (!linear_mhe_is_complete(mhe, place))
            dse_mat_vec(ny, nx, linear_mhe_rows(mhe, place), x + j * nx, error);
        for (int c = 0; c < ny; c++)
            error[c] = white[c] - error[c];
        enlarge(ny, white, s->white);
        enlarge(nx, x + j * nx, s->x);
    }
    dse_mat_mul(H, ny, nx, mhe->errors, mhe->E, mhe->lambda);
    for (int j = 0; j < H; j++) {
        const int place = linear_mhe_place(mhe, j);
        if (!linear_mhe_is_complete(mhe, place))
            dse_mat_tvec(ny, nx, linear_mhe_rows(mhe, place), mhe->errors + j * ny,
                         mhe->lambda + j * nx);
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
    find_output_errors(mhe, x, s);
    for (int j = mhe->length - 1; j >= 0; j--) {
        dse_real *lambda = mhe->lambda + j * nx;
        if (y)
            dse_axpy(nx, -1, mu(mhe, y, j), lambda);
        if (j == mhe->length - 1)
            continue;
        dse_mat_tvec(nx, nx, mhe->config->linear.A, lambda + nx, s->work);
        dse_axpy(nx, 1, s->work, lambda);
    }
}

/* r <- r - Q v; work: nx. */
static void subtract_noise(const struct dse_linear_mhe *mhe, const dse_real *v, dse_real *work,
                           dse_real *r)
{
    const int nx = mhe->nx;
    const dse_real *Q = mhe->config->Q;
    if (!Q)
        return;
    if (mhe->Q_diagonal) {
        for (int i = 0; i < nx; i++)
            r[i] -= Q[i * nx + i] * v[i];
        return;
    }
    dse_mat_tvec(nx, nx, Q, v, work); /* symmetric */
    dse_axpy(nx, -1, work, r);
}

/* r <- r - Q (lambda_j - nu_j). */
static void subtract_disturbance(const struct dse_linear_mhe *mhe, int j, const dse_real *y,
                                 const struct sizes *s, dse_real *r)
{
    const int nx = mhe->nx;
    const dse_real *lambda = mhe->lambda + j * nx;
    if (!y) {
        subtract_noise(mhe, lambda, s->work, r);
        return;
    }
    for (int i = 0; i < nx; i++)
        mhe->product[i] = lambda[i] - nu(mhe, y, j)[i];
    subtract_noise(mhe, mhe->product, s->work, r);
}

/* residual_j = x_j - A x_{j-1} - b_j - Q (lambda_j - nu_j),  residual_0 = x_0 - xbar - P lambda_0
 * or lambda_0. */
static void find_residuals(struct dse_linear_mhe *mhe, const dse_real *x, const dse_real *y,
                           const struct sizes *s)
{
    const int nx = mhe->nx, H = mhe->length;
    dse_mat_mul(H - 1, nx, nx, x, mhe->A_transposed, mhe->residual + nx);
    for (int j = 1; j < H; j++) {
        const dse_real *b = mhe->b + linear_mhe_place(mhe, j) * nx;
        dse_real *r = mhe->residual + j * nx;
        for (int i = 0; i < nx; i++)
            r[i] = x[j * nx + i] - r[i] - b[i];
        subtract_disturbance(mhe, j, y, s, r);
        if (mhe->nu > 0)
            enlarge(nx, b, s->b);
    }
    dse_real *r = mhe->residual;
    for (int i = 0; i < nx; i++)
        r[i] = mhe->config->arrival == DSE_ARRIVAL_NONE ? mhe->lambda[i] : x[i] - mhe->xbar[i];
    if (mhe->config->arrival == DSE_ARRIVAL_NONE)
        return;
    for (int p = 0; p < mhe->prior_rank; p++) {
        const dse_real *v = mhe->prior_V + p * nx;
        dse_axpy(nx, -dse_dot(nx, v, mhe->lambda), v, r);
    }
}

/* sum_p |m_p| v_p. */
static dse_real row_size(int n, const dse_real *m, const dse_real *v)
{
    dse_real sum = 0;
    for (int p = 0; p < n; p++)
        sum += dse_abs(m[p]) * v[p];
    return sum;
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
        enlarge(nx, mu(mhe, y, j), s->work);
    for (int c = 0; c < ny; c++) {
        const dse_real *e = mhe->E + c * nx;
        const dse_real size = s->white[c] + row_size(nx, e, s->x);
        for (int i = 0; i < nx; i++)
            s->work[i] += dse_abs(e[i]) * size;
    }
    dse_mat_vec(nx, nx, mhe->spread, s->work, s->dual);
    if (!y)
        return;
    for (int i = 0; i < nx; i++)
        s->work[i] = 0;
    for (int j = 1; j < mhe->length; j++)
        enlarge(nx, nu(mhe, y, j), s->work);
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
        const dse_real along = row_size(nx, v, s->dual);
        for (int i = 0; i < nx; i++)
            s->work[i] += dse_abs(v[i]) * along;
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
    for (int i = 0; i < nx; i++)
        s->work[i] = 0;
    for (int j = 1; j < mhe->length; j++)
        enlarge(nx, mhe->residual + j * nx, s->work);
    dse_real worst = 0;
    for (int i = 0; i < nx; i++) {
        const dse_real noise = Q ? row_size(nx, Q + i * nx, s->dual) : 0;
        const dse_real size = s->x[i] + row_size(nx, A + i * nx, s->x) + s->b[i] + noise;
        worst = dse_max(worst, ratio(s->work[i], size));
    }
    return worst;
}

dse_real linear_mhe_certify(struct dse_linear_mhe *mhe, const dse_real *x, const dse_real *y)
{
    const struct sizes s = sizes_in(mhe);
    for (int i = 0; i < 4 * mhe->nx + mhe->ny; i++)
        s.x[i] = 0;
    find_multipliers(mhe, x, y, &s);
    find_residuals(mhe, x, y, &s);
    find_dual_size(mhe, y, &s);
    return dse_max(start_ratio(mhe, x, &s), transition_ratio(mhe, &s));
}

dse_real dse_linear_mhe_certify(struct dse_linear_mhe *mhe, const dse_real *x)
{
    return linear_mhe_certify(mhe, x, NULL);
}
