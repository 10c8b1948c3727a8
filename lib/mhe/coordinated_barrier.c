/* Coordinated moving horizon estimation: bounds by a log barrier (4.63).
 *
 *     min 1/2 X'M X - rhs'X + 1/2 |W|^2_{Q^-1} + B(X) + B(W)   s.t.  G X - W = h,
 *     B(z) = (1/t) sum -log(z - lower) - log(upper - z)
 *
 * by Newton's method from strictly inside the bounds, where the equality need not hold yet. With
 * r = G X - W - h the step of W is eliminated, dW = G dX + r, and
 *
 *     (M + B_X'' + G'(Q^-1 + B_W'')G) dX = -(g_X + G'(g_W + (Q^-1 + B_W'') r)),
 *     lambda = g_W + (Q^-1 + B_W'') dW
 *
 * is again block-tridiagonal. t grows from 1 by factors of 10 (a first guess is kept from the last
 * solution); a step is shortened so that it stays inside and that the residual of the optimality
 * conditions falls. */
#include <stddef.h>

#include "coordinated_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"

enum { MOST_STEPS = 60, MOST_HALVINGS = 40 };

/* The parts of local->newton; all but the first two have N nx reals each. */
struct barrier {
    dse_real *W, *lambda; /* beside local->newton_X, the point itself */
    dse_real *X;
    dse_real *dX, *dW, *dlambda;
    dse_real *rX, *rW, *r; /* residuals: g_X + G'lambda, g_W - lambda, G X - W - h */
    dse_real *hX, *hW;     /* curvature of the barrier */
    dse_real *v;           /* scratch */
};

static struct barrier parts_of(const struct dse_mhe_local *local)
{
    const int size = local->N * local->nx;
    dse_real *at = local->newton;
    struct barrier b;
    dse_real **all[] = {&b.X,  &b.W,  &b.lambda, &b.dX, &b.dW, &b.dlambda,
                        &b.rX, &b.rW, &b.r,      &b.hX, &b.hW, &b.v};
    for (int i = 0; i < (int)(sizeof all / sizeof all[0]); i++)
        *all[i] = at + i * size;
    return b;
}

static dse_real lower_of(const dse_real *bound, int i)
{
    return bound ? bound[i] : -DSE_REAL_MAX;
}

static dse_real upper_of(const dse_real *bound, int i)
{
    return bound ? bound[i] : DSE_REAL_MAX;
}

/* ---- the barrier ---- */

/* gradient += B', curvature = B'', for count blocks. */
static void add_barrier(int count, int nx, const dse_real *z, const dse_real *lower,
                        const dse_real *upper, dse_real t, dse_real *gradient, dse_real *curvature)
{
    for (int k = 0; k < count * nx; k++) {
        const dse_real low = lower_of(lower, k % nx), high = upper_of(upper, k % nx);
        const dse_real down = low > -DSE_REAL_MAX ? 1 / (z[k] - low) : 0;
        const dse_real up = high < DSE_REAL_MAX ? 1 / (high - z[k]) : 0;
        gradient[k] += (up - down) / t;
        curvature[k] = (up * up + down * down) / t;
    }
}

/* The longest step, at most 1, that leaves a hundredth of the way to each bound. */
static dse_real longest(int count, int nx, const dse_real *z, const dse_real *d,
                        const dse_real *lower, const dse_real *upper, dse_real alpha)
{
    const dse_real share = DSE_REAL(0.99);
    for (int k = 0; k < count * nx; k++) {
        const dse_real low = lower_of(lower, k % nx), high = upper_of(upper, k % nx);
        if (d[k] > 0 && high < DSE_REAL_MAX)
            alpha = dse_min(alpha, share * (high - z[k]) / d[k]);
        if (d[k] < 0 && low > -DSE_REAL_MAX)
            alpha = dse_min(alpha, share * (low - z[k]) / d[k]);
    }
    return alpha;
}

/* A point inside: zero where it is not close to a bound, else the middle. */
static void start_inside(int count, int nx, const dse_real *lower, const dse_real *upper,
                         dse_real *z)
{
    for (int k = 0; k < count * nx; k++) {
        const dse_real low = lower_of(lower, k % nx), high = upper_of(upper, k % nx);
        const bool below = low > -DSE_REAL_MAX, above = high < DSE_REAL_MAX;
        z[k] = 0;
        if (below && above) {
            const dse_real margin = (high - low) / 100;
            if (!(low + margin < 0 && 0 < high - margin))
                z[k] = low + (high - low) / 2;
        } else if (below && !(low < 0)) {
            z[k] = low + (low > 1 ? low : 1);
        } else if (above && !(high > 0)) {
            z[k] = high - (high < -1 ? -high : 1);
        }
    }
}

/* ---- Newton ---- */

/* g_X of the quadratic part: M X - rhs. */
static void add_quadratic(struct dse_mhe_local *local, const struct barrier *b)
{
    const struct dse_mhe_subsystem *s = local->subsystem;
    const int nx = local->nx, H = local->length;
    for (int t = 0; t < H; t++) {
        dse_real *g = b->rX + t * nx;
        const dse_real *x = b->X + t * nx;
        mhe_outputs_apply(&local->outputs, local->has + t * local->ny, x, g);
        for (int i = 0; i < nx; i++) {
            g[i] -= local->rhs[t * nx + i];
            g[i] += t == 0 && s->prior ? dse_dot(nx, s->prior + i * nx, x) : 0;
            g[i] += t < H - 1 && s->stage_cost ? dse_dot(nx, s->stage_cost + i * nx, x) : 0;
        }
    }
}

static dse_real norm_of(int count, const dse_real *v)
{
    return dse_dot(count, v, v);
}

/* All residuals and curvatures at the point; the norm. */
static dse_real evaluate(struct dse_mhe_local *local, const struct barrier *b, const dse_real *h,
                         dse_real t)
{
    const struct dse_mhe_subsystem *s = local->subsystem;
    const int nx = local->nx, H = local->length, m = (H - 1) * nx;
    add_quadratic(local, b);
    add_barrier(H, nx, b->X, s->x_min, s->x_max, t, b->rX, b->hX);
    mhe_differences_transposed(s, H, 1, b->lambda, b->rX);
    for (int k = 0; k < H - 1; k++)
        dse_mat_vec(nx, nx, local->disturbance.S, b->W + k * nx, b->rW + k * nx);
    add_barrier(H - 1, nx, b->W, s->w_min, s->w_max, t, b->rW, b->hW);
    dse_axpy(m, -1, b->lambda, b->rW);
    mhe_differences(s, H, b->X, b->r);
    dse_axpy(m, -1, b->W, b->r);
    if (h)
        dse_axpy(m, -1, h, b->r);
    return dse_sqrt(norm_of(H * nx, b->rX) + norm_of(m, b->rW) + norm_of(m, b->r));
}

/* v = (Q^-1 + B_W'') u at each transition. */
static void weigh(const struct dse_mhe_local *local, const struct barrier *b, const dse_real *u,
                  dse_real *v)
{
    const int nx = local->nx;
    for (int t = 0; t < local->length - 1; t++) {
        dse_mat_vec(nx, nx, local->disturbance.S, u + t * nx, v + t * nx);
        for (int i = 0; i < nx; i++)
            v[t * nx + i] += b->hW[t * nx + i] * u[t * nx + i];
    }
}

/* M + B_X'' + G'(Q^-1 + B_W'')G. */
static enum dse_status factor(struct dse_mhe_local *local, const struct barrier *b)
{
    struct dse_mhe_chain *K = &local->barrier_chain;
    const dse_real *A = local->subsystem->A;
    const int nx = local->nx, size = nx * nx;
    mhe_window_matrix(K, local->length, &local->outputs, local->has, &local->disturbance);
    for (int t = 0; t < local->length; t++) {
        dse_real *D = K->D + t * size, *U = K->U + t * size;
        for (int i = 0; i < nx; i++) {
            D[i * nx + i] += b->hX[t * nx + i] + (t > 0 ? b->hW[(t - 1) * nx + i] : 0);
            for (int p = 0; p < nx && t < local->length - 1; p++) {
                const dse_real weighted = A[p * nx + i] * b->hW[t * nx + p];
                dse_axpy(nx, weighted, A + p * nx, D + i * nx);
                U[i * nx + p] -= weighted;
            }
        }
    }
    return mhe_chain_factor(K);
}

/* dX, dW, dlambda; returns the square of the Newton decrement, negative when there is no factor. */
static dse_real find_step(struct dse_mhe_local *local, const struct barrier *b)
{
    const struct dse_mhe_subsystem *s = local->subsystem;
    const int nx = local->nx, H = local->length, m = (H - 1) * nx;
    if (factor(local, b) != DSE_OK)
        return -1;
    /* With the residuals g_X + G'lambda and g_W - lambda in place of the gradients, the step of the
     * multiplier comes out. */
    weigh(local, b, b->r, b->v);
    dse_axpy(m, 1, b->rW, b->v);
    for (int e = 0; e < H * nx; e++)
        b->dX[e] = -b->rX[e];
    mhe_differences_transposed(s, H, -1, b->v, b->dX);
    mhe_chain_solve(&local->barrier_chain, b->dX);
    mhe_differences(s, H, b->dX, b->dW);
    dse_axpy(m, 1, b->r, b->dW);
    weigh(local, b, b->dW, b->dlambda);
    dse_axpy(m, 1, b->rW, b->dlambda);
    dse_real decrement = 0;
    for (int t = 0; t < H; t++) {
        mhe_chain_multiply_row(&local->barrier_chain, b->dX, t, local->work);
        decrement += dse_dot(nx, b->dX + t * nx, local->work);
    }
    return decrement;
}

static void move(const struct dse_mhe_local *local, const struct barrier *b, dse_real alpha)
{
    const int m = (local->length - 1) * local->nx;
    dse_axpy(m + local->nx, alpha, b->dX, b->X);
    dse_axpy(m, alpha, b->dW, b->W);
    dse_axpy(m, alpha, b->dlambda, b->lambda);
}

/* Newton steps at this t until the decrement is below `enough` or rounding ends them; true when the
 * first happened or nothing but rounding is left. */
static bool centre(struct dse_mhe_local *local, const struct barrier *b, const dse_real *h,
                   dse_real t, dse_real enough)
{
    const struct dse_mhe_subsystem *s = local->subsystem;
    const int nx = local->nx, H = local->length;
    dse_real norm = evaluate(local, b, h, t);
    for (int step = 0; step < MOST_STEPS; step++) {
        const dse_real decrement = find_step(local, b);
        if (!(decrement >= 0))
            return false;
        dse_real alpha = longest(H, nx, b->X, b->dX, s->x_min, s->x_max, 1);
        alpha = longest(H - 1, nx, b->W, b->dW, s->w_min, s->w_max, alpha);
        const dse_real before = norm;
        dse_real tried = 0;
        for (int halving = 0; halving < MOST_HALVINGS; halving++) {
            move(local, b, alpha - tried);
            tried = alpha;
            norm = evaluate(local, b, h, t);
            if (norm <= (1 - alpha / 100) * before)
                break;
            if (decrement <= enough)
                break;
            alpha /= 2;
        }
        if (decrement <= enough && tried > DSE_REAL(0.9))
            return true;
        if (!(norm < before)) /* rounding */
            return decrement <= DSE_REAL(1e6) * enough;
    }
    return false;
}

/* Relative to the terms: rhs and G'lambda. */
static dse_real certify(const struct dse_mhe_local *local, const struct barrier *b)
{
    const int nx = local->nx, H = local->length;
    const dse_real terms = dse_norm_max(H * nx, local->rhs) + dse_norm_max((H - 1) * nx, b->lambda);
    const dse_real states = dse_norm_max(H * nx, b->X);
    return dse_max(dse_max(dse_norm_max(H * nx, b->rX), dse_norm_max((H - 1) * nx, b->rW)) /
                       (terms + DSE_REAL_MIN),
                   dse_norm_max((H - 1) * nx, b->r) / (states + DSE_REAL_MIN));
}

static bool from_outside(struct dse_mhe_local *local, const struct barrier *b, const dse_real *h,
                         dse_real enough)
{
    const struct dse_mhe_subsystem *s = local->subsystem;
    const int nx = local->nx, H = local->length;
    start_inside(H, nx, s->x_min, s->x_max, b->X);
    start_inside(H - 1, nx, s->w_min, s->w_max, b->W);
    for (int e = 0; e < (H - 1) * nx; e++)
        b->lambda[e] = 0;
    dse_real t = 1;
    while (t < local->settings->barrier) {
        if (!centre(local, b, h, t, DSE_REAL(1e-3)))
            return false;
        t *= 10;
    }
    return centre(local, b, h, local->settings->barrier, enough);
}

enum dse_status mhe_barrier_solve(struct dse_mhe_local *local, const dse_real *h)
{
    const struct barrier b = parts_of(local);
    const int nx = local->nx, H = local->length;
    const dse_real enough = DSE_REAL_EPSILON * DSE_REAL_EPSILON * DSE_REAL(1e9);
    const bool warm = local->barrier_length == H;
    local->barrier_length = 0;
    if (!(warm && centre(local, &b, h, local->settings->barrier, enough)) &&
        !from_outside(local, &b, h, enough))
        return local->own_status != DSE_OK ? local->own_status : DSE_ENOCONV;
    local->barrier_length = H;
    for (int e = 0; e < H * nx; e++)
        local->current.X[e] = b.X[e];
    for (int e = 0; e < (H - 1) * nx; e++) {
        local->current.W[e] = b.W[e];
        local->current.other[e] = b.lambda[e];
    }
    local->certificate = certify(local, &b);
    return dse_all_finite(b.X, H * nx) ? DSE_OK : DSE_ENONFINITE;
}
