/* Linear moving horizon estimator: solution of the optimality system with its factors. */
#include <stddef.h>

#include "dse/linalg.h"
#include "dse/linear_mhe.h"
#include "dse/math.h"
#include "linear_mhe_internal.h"

/* Residuals above this many roundings are corrected, at most this often. */
#define REFINE_ABOVE    (64 * DSE_REAL_EPSILON)
#define REFINEMENTS_MAX 2

/* Right-hand side of the optimality system. Sample j of the window is in place (first + j) mod N of
 * b and c. */
struct right_hand_side {
    int first;
    const dse_real *start; /* nx: xbar; without arrival cost lambda_0 of what is to be found */
    const dse_real *b;     /* N x nx: of the transitions to samples 1, 2, .. */
    const dse_real *c;     /* N x nx; NULL: zero */
    bool b_is_zero;
};

static const dse_real *at(const struct dse_linear_mhe *mhe, const dse_real *rows, int place)
{
    return rows + (place < mhe->N ? place : place - mhe->N) * mhe->nx;
}

/* v <- (T' T)^-1 v. */
static void solve_start_alone(int n, const dse_real *T, dse_real *v)
{
    for (int i = 0; i < n; i++) { /* T' */
        v[i] /= T[i * n + i];
        dse_axpy(n - i - 1, -v[i], T + i * n + i + 1, v + i + 1);
    }
    for (int i = n - 1; i >= 0; i--) /* T */
        v[i] = (v[i] - dse_dot(n - i - 1, T + i * n + i + 1, v + i + 1)) / T[i * n + i];
}

/* ghat = g - T' T b:  the linear term of the cost to go of A x + b, as a function of A x. The zeros
 * of the triangle T take part: few long products are faster than many short ones. */
static void shift(int n, const dse_real *T, const dse_real *b, dse_real *work, dse_real *g)
{
    dse_mat_vec(n, n, T, b, work);
    dse_mat_mul_subtract(1, n, n, work, T, g, g);
}

/* x_0 = xbar + start' start (g_0 - T' T xbar), or (T' T)^-1 (g_0 - lambda_0). */
static void solve_start(const struct dse_linear_mhe *mhe, const struct right_hand_side *rhs,
                        dse_real *x)
{
    const int n = mhe->nx;
    const dse_real *T = linear_mhe_stage(mhe, mhe->length - 1).T;
    dse_real *g = mhe->g, *work = mhe->scratch;
    if (mhe->config->arrival == DSE_ARRIVAL_NONE) {
        for (int i = 0; i < n; i++)
            x[i] = g[i] - (rhs->start ? rhs->start[i] : 0);
        solve_start_alone(n, T, x);
        return;
    }
    shift(n, T, rhs->start, work, g);
    dse_mat_vec(mhe->start_rank, n, mhe->start, g, work);
    dse_mat_tvec_add(mhe->start_rank, n, mhe->start, work, rhs->start, x);
}

/* g_j = c_j + F' ghat_{j+1}; beyond the newest sample there is nothing. */
static void pull_back(const struct dse_linear_mhe *mhe, const struct right_hand_side *rhs, int j)
{
    const int n = mhe->nx, H = mhe->length;
    const dse_real *c = rhs->c ? at(mhe, rhs->c, rhs->first + j) : NULL;
    const dse_real *F = linear_mhe_stage(mhe, H - 1 - j).F;
    dse_real *g = mhe->g + j * n;
    if (j == H - 1)
        for (int i = 0; i < n; i++)
            g[i] = c ? c[i] : 0;
    else if (c)
        dse_mat_tvec_add(n, n, F, g + n, c, g);
    else
        dse_mat_tvec(n, n, F, g + n, g);
}

/* Backwards  g_j = c_j + F' ghat_{j+1},  forwards  x_{j+1} = F x_j + b_{j+1} + S ghat_{j+1}. */
static void sweep(const struct dse_linear_mhe *mhe, const struct right_hand_side *rhs, dse_real *x)
{
    const int n = mhe->nx, H = mhe->length;
    for (int j = H - 1; j >= 0; j--) {
        pull_back(mhe, rhs, j);
        if (j > 0 && !rhs->b_is_zero)
            shift(n, linear_mhe_stage(mhe, H - 1 - j).T, at(mhe, rhs->b, rhs->first + j),
                  mhe->scratch, mhe->g + j * n);
    }
    solve_start(mhe, rhs, x);
    for (int j = 1; j < H; j++) {
        const struct dse_linear_mhe_stage stage = linear_mhe_stage(mhe, H - j);
        dse_real *next = x + j * n; /* S is symmetric */
        dse_mat_tvec_add(n, n, stage.S, mhe->g + j * n, at(mhe, rhs->b, rhs->first + j), next);
        dse_mat_vec_add(n, n, stage.F, next - n, next, next);
    }
}

void linear_mhe_correction(struct dse_linear_mhe *mhe, dse_real *dx)
{
    const int count = mhe->length * mhe->nx;
    for (int i = 0; i < count; i++)
        mhe->residual[i] = -mhe->residual[i];
    const struct right_hand_side rhs = {.start = mhe->residual, .b = mhe->residual};
    sweep(mhe, &rhs, dx);
}

/* One correction of x_next by its residual; keeps the better of the two. */
static void refine(struct dse_linear_mhe *mhe, dse_real *certificate)
{
    const int count = mhe->length * mhe->nx;
    dse_real *correction = mhe->lambda; /* read only by the residual itself */
    linear_mhe_correction(mhe, correction);
    dse_axpy(count, 1, correction, mhe->x_next);
    for (int i = 0; i < count; i++) /* of the correction, before lambda is overwritten */
        mhe->g[i] = correction[i];
    const dse_real better = dse_linear_mhe_certify(mhe, mhe->x_next);
    mhe->counts.refinements++;
    if (better < *certificate)
        *certificate = better;
    else
        dse_axpy(count, -1, mhe->g, mhe->x_next);
}

/* x_next: the states that satisfy the optimality system, and how well they do. */
static void solve_window(struct dse_linear_mhe *mhe, dse_real *certificate)
{
    const bool none = mhe->config->arrival == DSE_ARRIVAL_NONE;
    const struct right_hand_side rhs = {.first = linear_mhe_place(mhe, 0),
                                        .start = none ? NULL : mhe->xbar,
                                        .b = mhe->b,
                                        .c = mhe->c,
                                        .b_is_zero = mhe->nu == 0};
    sweep(mhe, &rhs, mhe->x_next);
    *certificate = dse_linear_mhe_certify(mhe, mhe->x_next);
    for (int r = 0; r<REFINEMENTS_MAX && * certificate> REFINE_ABOVE; r++) {
        const dse_real before = *certificate;
        refine(mhe, certificate);
        if (!(*certificate < before / 2))
            break;
    }
}

/* x_0 of each column of X, whose first rows are g_0. */
static void start_columns(const struct dse_linear_mhe *mhe, int count, dse_real *X)
{
    const int n = mhe->nx;
    const dse_real *T = linear_mhe_stage(mhe, mhe->length - 1).T;
    dse_real *g = mhe->scratch, *x = g + n;
    for (int c = 0; c < count; c++) {
        for (int i = 0; i < n; i++) {
            g[i] = X[i * count + c];
            x[i] = mhe->config->arrival == DSE_ARRIVAL_NONE ? g[i] : 0;
        }
        if (mhe->config->arrival == DSE_ARRIVAL_NONE)
            solve_start_alone(n, T, x);
        else
            for (int p = 0; p < mhe->start_rank; p++)
                dse_axpy(n, dse_dot(n, mhe->start + p * n, g), mhe->start + p * n, x);
        for (int i = 0; i < n; i++)
            X[i * count + c] = x[i];
    }
}

/* The sweep for several linear terms at once: backwards  g_j = c_j + F' g_{j+1},  forwards
 * x_j = F x_{j-1} + S g_j. */
enum dse_status linear_mhe_apply(void *context, int count, int newest, dse_real *X)
{
    struct dse_linear_mhe *mhe = context;
    const int n = mhe->nx, H = mhe->length, block = n * count;
    dse_real *work = mhe->product;
    for (int j = newest - 1; j >= 0; j--) {
        const struct dse_linear_mhe_stage stage = linear_mhe_stage(mhe, H - 1 - j);
        dse_mat_mul_tn(n, n, count, stage.F, X + (j + 1) * block, work);
        dse_axpy(block, 1, work, X + j * block);
    }
    start_columns(mhe, count, X);
    for (int j = 1; j < H; j++) {
        const struct dse_linear_mhe_stage stage = linear_mhe_stage(mhe, H - j);
        dse_real *x = X + j * block;
        dse_mat_mul(n, n, count, stage.F, x - block, work);
        if (j <= newest)
            dse_mat_mul(n, n, count, stage.S, x, mhe->product_S);
        for (int i = 0; i < block; i++)
            x[i] = work[i] + (j <= newest ? mhe->product_S[i] : 0);
    }
    return DSE_OK;
}

/* The states that follow from x0. */
static void predict_window(struct dse_linear_mhe *mhe)
{
    const int n = mhe->nx;
    for (int i = 0; i < n; i++)
        mhe->x_next[i] = mhe->xbar[i];
    for (int j = 1; j < mhe->length; j++)
        linear_mhe_move(mhe, mhe->x_next + (j - 1) * n, mhe->b + linear_mhe_place(mhe, j) * n,
                        mhe->x_next + j * n);
}

static enum dse_status fail(struct dse_linear_mhe *mhe, enum dse_status status)
{
    mhe->health = status == DSE_ESINGULAR ? DSE_HEALTH_UNOBSERVABLE : DSE_HEALTH_DIVERGED;
    mhe->counts.failed++;
    return status;
}

static enum dse_health judge(const struct dse_linear_mhe *mhe)
{
    if (!mhe->solved_by_window || mhe->counts.used == 0)
        return DSE_HEALTH_INITIALISING;
    return linear_mhe_has_data(mhe, mhe->newest_place) ? DSE_HEALTH_TRACKING : DSE_HEALTH_COASTING;
}

static void commit(struct dse_linear_mhe *mhe, bool by_window, dse_real certificate)
{
    dse_real *x = mhe->x;
    mhe->x = mhe->x_next;
    mhe->x_next = x;
    mhe->solved_newest = mhe->newest;
    mhe->solved_length = mhe->length;
    mhe->solved_by_window = by_window;
    mhe->factors_hold = by_window;
    mhe->certificate = certificate;
    mhe->health = mhe->path == DSE_PATH_HELD   ? DSE_HEALTH_COASTING
                  : mhe->path == DSE_PATH_FREE ? DSE_HEALTH_REJECTING
                                               : judge(mhe);
    mhe->counts.solved++;
}

enum dse_status dse_linear_mhe_solve(struct dse_linear_mhe *mhe)
{
    const struct dse_linear_mhe_config *config = mhe->config;
    const bool by_window = config->arrival != DSE_ARRIVAL_NONE || mhe->length >= mhe->min_horizon;
    const dse_real tolerance =
        config->tolerance > 0 ? config->tolerance : dse_sqrt(DSE_REAL_EPSILON);
    dse_real certificate = 0;
    mhe->factors_hold = false;
    mhe->parts = (struct dse_linear_mhe_parts){0, 0, 0};
    mhe->path = DSE_PATH_SWAPS;
    if (by_window) {
        const enum dse_status status = linear_mhe_factor_window(mhe);
        if (status != DSE_OK)
            return fail(mhe, status);
        solve_window(mhe, &certificate);
        mhe->parts.dual = certificate;
    } else {
        predict_window(mhe);
    }
    if (!dse_all_finite(mhe->x_next, mhe->length * mhe->nx) || !dse_is_finite(certificate))
        return fail(mhe, DSE_ENONFINITE);
    if (certificate > tolerance)
        return fail(mhe, DSE_ENOCONV);
    if (mhe->bounded && by_window)
        linear_mhe_keep_bounds(mhe, tolerance, &certificate);
    commit(mhe, by_window, certificate);
    return DSE_OK;
}

/* Given all data, x_{j+1} = F x_j + .. + N(0, S) is a Markov chain that starts with the covariance
 * of x_0:  P_{j+1} = F P_j F' + S. */
enum dse_status dse_linear_mhe_covariance(struct dse_linear_mhe *mhe, dse_real *P)
{
    const int n = mhe->nx, H = mhe->solved_length;
    if (!mhe->factors_hold)
        return DSE_ENODATA;
    if (mhe->config->arrival == DSE_ARRIVAL_NONE) {
        dse_real *column = mhe->scratch;
        for (int j = 0; j < n; j++) {
            for (int i = 0; i < n; i++)
                column[i] = i == j;
            solve_start_alone(n, linear_mhe_stage(mhe, H - 1).T, column);
            for (int i = 0; i < n; i++)
                P[i * n + j] = column[i];
        }
        dse_sym_enforce(n, P);
    } else {
        dse_mat_mul_tn(n, mhe->start_rank, n, mhe->start, mhe->start, P);
    }
    for (int d = H - 1; d > 0; d--) {
        const struct dse_linear_mhe_stage stage = linear_mhe_stage(mhe, d);
        dse_sym_congruence(n, n, stage.F, P, stage.S, P, mhe->scratch);
    }
    return DSE_OK;
}
