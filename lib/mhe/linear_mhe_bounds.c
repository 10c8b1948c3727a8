/* Linear moving horizon estimator: bounds on states and disturbances, by their active set on the
 * Riccati factors. K of dse/active_set.h is the map from a linear term c to the states, which
 * exists for singular Q and P, too; a bound that a direction without noise cannot move then depends
 * on others or has no force. */
#include <stddef.h>

#include "active_set_internal.h"
#include "dse/linalg.h"
#include "dse/linear_mhe.h"
#include "dse/math.h"
#include "linear_mhe_internal.h"

#define PASSES          20
#define REFINE_ABOVE    (64 * DSE_REAL_EPSILON)
#define REFINEMENTS_MAX 2

bool linear_mhe_wants_bounds(const struct dse_linear_mhe_config *config)
{
    return config->x_min || config->x_max || config->w_min || config->w_max;
}

int linear_mhe_max_active(const struct dse_linear_mhe_config *config)
{
    return config->max_active > 0 ? config->max_active : config->nx * config->horizon;
}

/* Neither NaN nor lower > upper, and a bound below +infinity. */
static enum dse_status check_pair(int n, const dse_real *lower, const dse_real *upper)
{
    for (int i = 0; i < n; i++) {
        const dse_real a = lower ? lower[i] : -DSE_REAL_MAX, b = upper ? upper[i] : DSE_REAL_MAX;
        if (a != a || b != b)
            return DSE_ENONFINITE;
        if (a > b || a >= DSE_REAL_MAX || b <= -DSE_REAL_MAX)
            return DSE_EINVAL;
    }
    return DSE_OK;
}

enum dse_status linear_mhe_check_bounds(const struct dse_linear_mhe_config *config)
{
    if (config->max_active < 0 || config->max_active > config->nx * config->horizon)
        return DSE_EINVAL;
    const enum dse_status status = check_pair(config->nx, config->x_min, config->x_max);
    return status != DSE_OK ? status : check_pair(config->nx, config->w_min, config->w_max);
}

void linear_mhe_prepare_bounds(struct dse_linear_mhe *mhe, struct dse_arena *arena)
{
    const struct dse_linear_mhe_config *config = mhe->config;
    const int nx = mhe->nx, N = mhe->N;
    active_set_init(&mhe->set, nx, nx, N, linear_mhe_max_active(config), arena);
    mhe->set.apply = linear_mhe_apply;
    mhe->set.context = mhe;
    mhe->minus_A = dse_arena_take(arena, nx * nx);
    mhe->lower = dse_arena_take(arena, N * nx);
    mhe->upper = dse_arena_take(arena, N * nx);
    mhe->w_lower = dse_arena_take(arena, N * nx);
    mhe->w_upper = dse_arena_take(arena, N * nx);
    mhe->free = dse_arena_take(arena, N * nx);
    mhe->product = dse_arena_take(arena, nx * DSE_ACTIVE_SET_BATCH);
    mhe->product_S = dse_arena_take(arena, nx * DSE_ACTIVE_SET_BATCH);
    mhe->forces = dse_arena_take(arena, 2 * N * nx);
    for (int i = 0; i < nx * nx; i++)
        mhe->minus_A[i] = -config->linear.A[i];
    for (int i = 0; i < N * nx; i++) {
        mhe->lower[i] = config->x_min ? config->x_min[i % nx] : -DSE_REAL_MAX;
        mhe->upper[i] = config->x_max ? config->x_max[i % nx] : DSE_REAL_MAX;
    }
    for (int i = 0; i < nx; i++)
        mhe->set.unit[i] = config->Q ? dse_sqrt(config->Q[i * nx + i]) : 0;
    mhe->bounds = (struct dse_window_bounds){
        .lower = config->x_min || config->x_max ? mhe->lower : NULL,
        .upper = config->x_min || config->x_max ? mhe->upper : NULL,
        .E = mhe->minus_A,
        .row_lower = config->w_min || config->w_max ? mhe->w_lower : NULL,
        .row_upper = config->w_min || config->w_max ? mhe->w_upper : NULL};
    mhe->bounded = true;
}

/* w_min <= x_{j+1} - A x_j - b_{j+1} <= w_max. */
static void place_rows(struct dse_linear_mhe *mhe)
{
    const struct dse_linear_mhe_config *config = mhe->config;
    const int nx = mhe->nx;
    for (int j = 0; j + 1 < mhe->length; j++) {
        const dse_real *b = mhe->b + linear_mhe_place(mhe, j + 1) * nx;
        for (int i = 0; i < nx; i++) {
            const dse_real least = config->w_min ? config->w_min[i] : -DSE_REAL_MAX;
            const dse_real most = config->w_max ? config->w_max[i] : DSE_REAL_MAX;
            mhe->w_lower[j * nx + i] = active_set_is_bounded(least) ? least + b[i] : -DSE_REAL_MAX;
            mhe->w_upper[j * nx + i] = active_set_is_bounded(most) ? most + b[i] : DSE_REAL_MAX;
        }
    }
}

/* The set of the last solution, moved on to the window as it is. */
static void move_set(struct dse_linear_mhe *mhe)
{
    const long oldest = mhe->newest - mhe->length + 1;
    const long before = mhe->set_newest - mhe->set_length + 1;
    if (oldest - before >= mhe->set_length)
        active_set_clear(&mhe->set);
    for (long k = before; k < oldest && mhe->set.count > 0; k++)
        active_set_slide(&mhe->set);
    mhe->set_newest = mhe->newest;
    mhe->set_length = mhe->length;
    if (mhe->factors_new || mhe->partial_from < mhe->length)
        active_set_forget_columns(&mhe->set);
    mhe->factors_new = mhe->partial_from < mhe->length;
}

/* Active bounds of states hold exactly; forces by constraint. */
static void tidy(struct dse_linear_mhe *mhe)
{
    const struct dse_active_set *set = &mhe->set;
    const int nx = mhe->nx;
    for (int k = 0; k < 2 * nx * mhe->length; k++)
        mhe->forces[k] = 0;
    for (int m = 0; m < set->count; m++) {
        const int k = set->member[m], j = k / (2 * nx), i = k % (2 * nx);
        if (i < nx)
            mhe->x_next[j * nx + i] = active_set_bound(set, k, set->side[k]);
        if ((dse_real)set->side[k] * set->y[m] > 0 || active_set_is_equality(set, k))
            mhe->forces[k] = set->y[m];
    }
}

/* primal = max_k violation_k / size_k,  gap = sum_k |y_k (n_k'x - b_k)| / sum_k |y_k| size_k. */
static struct dse_linear_mhe_parts certify(struct dse_linear_mhe *mhe)
{
    struct dse_active_set *set = &mhe->set;
    const dse_real *x = mhe->x_next;
    struct dse_linear_mhe_parts parts = {linear_mhe_certify(mhe, x, mhe->forces), 0, 0};
    dse_real work = 0, size = 0;
    active_set_measure(set, x);
    for (int k = 0; k < active_set_constraints(set); k++) {
        const dse_real lower = active_set_bound(set, k, -1), upper = active_set_bound(set, k, 1);
        if (!active_set_is_bounded(lower) && !active_set_is_bounded(upper))
            continue;
        const dse_real value = active_set_value(set, k, x), y = mhe->forces[k];
        const dse_real excess = dse_max(value - upper, lower - value);
        if (excess > 0)
            parts.primal = dse_max(parts.primal, excess / active_set_size(set, k));
        if (y == 0)
            continue;
        work += dse_abs(y * (value - (y > 0 ? upper : lower)));
        size += dse_abs(y) * active_set_size(set, k);
    }
    parts.gap = work == 0 ? 0 : work / size;
    return parts;
}

static dse_real worst(const struct dse_linear_mhe_parts *parts)
{
    return dse_max(parts->dual, dse_max(parts->primal, parts->gap));
}

static void copy(int n, const dse_real *from, dse_real *to)
{
    for (int i = 0; i < n; i++)
        to[i] = from[i];
}

/* Corrections of x_next and the forces by their residual, as long as they help. */
static struct dse_linear_mhe_parts polish(struct dse_linear_mhe *mhe)
{
    struct dse_active_set *set = &mhe->set;
    const int all = mhe->length * mhe->nx;
    tidy(mhe);
    struct dse_linear_mhe_parts parts = certify(mhe);
    for (int r = 0; r < REFINEMENTS_MAX && worst(&parts) > REFINE_ABOVE; r++) {
        dse_real *correction = mhe->lambda, *before = mhe->g;
        linear_mhe_correction(mhe, correction);
        copy(set->count, set->y, set->kept);
        active_set_correct(set, mhe->x_next, correction);
        copy(all, mhe->x_next, before); /* the sweep no longer needs it */
        dse_axpy(all, 1, correction, mhe->x_next);
        tidy(mhe);
        const struct dse_linear_mhe_parts better = certify(mhe);
        mhe->counts.refinements++;
        if (worst(&better) < worst(&parts)) {
            parts = better;
            continue;
        }
        copy(all, before, mhe->x_next);
        copy(set->count, set->kept, set->y);
        tidy(mhe);
        break;
    }
    return parts;
}

/* x_next: the last solution, moved on by the model; false: there is none, or bounds are violated.
 */
static bool hold_last(struct dse_linear_mhe *mhe)
{
    const int nx = mhe->nx, H = mhe->length;
    const long oldest = mhe->newest - H + 1;
    const long before = mhe->solved_newest - mhe->solved_length + 1;
    if (mhe->solved_length == 0 || oldest < before || oldest > mhe->solved_newest)
        return false;
    const int kept = (int)(mhe->solved_newest - oldest) + 1;
    for (int j = 0; j < H; j++) {
        dse_real *x = mhe->x_next + j * nx;
        if (j < kept)
            copy(nx, mhe->x + (oldest - before + j) * nx, x);
        else
            linear_mhe_move(mhe, x - nx, mhe->b + linear_mhe_place(mhe, j) * nx, x);
    }
    active_set_clear(&mhe->set);
    return active_set_judge(&mhe->set, mhe->x_next).violated == 0;
}

void linear_mhe_keep_bounds(struct dse_linear_mhe *mhe, dse_real tolerance, dse_real *certificate)
{
    struct dse_active_set *set = &mhe->set;
    const int all = mhe->length * mhe->nx;
    copy(all, mhe->x_next, mhe->free);
    place_rows(mhe);
    move_set(mhe);
    active_set_begin(set, mhe->length, &mhe->bounds);
    enum dse_status status =
        active_set_search(set, mhe->free, PASSES, 5 * set->max_active + 20, mhe->x_next);
    if (status == DSE_OK && set->count > 0) {
        mhe->parts = polish(mhe);
        *certificate = worst(&mhe->parts);
        status = *certificate <= tolerance ? DSE_OK : DSE_ENOCONV;
    }
    if (status == DSE_OK) {
        mhe->counts.bounded += set->count > 0;
        mhe->path = set->steps > 0 ? DSE_PATH_DUAL : DSE_PATH_SWAPS;
        return;
    }
    mhe->counts.infeasible += status == DSE_EINFEASIBLE;
    mhe->counts.fallbacks++;
    mhe->path = hold_last(mhe) ? DSE_PATH_HELD : DSE_PATH_FREE;
    if (mhe->path == DSE_PATH_FREE)
        copy(all, mhe->free, mhe->x_next);
    active_set_clear(set);
    tidy(mhe);
    mhe->parts = certify(mhe); /* as it is: far from optimal, or beyond the bounds */
    *certificate = worst(&mhe->parts);
}

int dse_linear_mhe_active(const struct dse_linear_mhe *mhe, int j, int i)
{
    return mhe->bounded ? mhe->set.side[2 * j * mhe->nx + i] : 0;
}
