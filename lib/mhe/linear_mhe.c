/* Linear moving horizon estimator: set-up and read access. */
#include "dse/linear_mhe.h"

#include <stddef.h>

#include "dse/linalg.h"
#include "dse/math.h"
#include "linear_mhe_internal.h"

static enum dse_status check_config(const struct dse_linear_mhe_config *config)
{
    const struct dse_linear *linear = &config->linear;
    if (config->nx < 1 || config->nu < 0 || config->ny < 1 || config->horizon < 1)
        return DSE_EINVAL;
    if (!linear->A || !linear->C || !config->R || (config->nu > 0 && !linear->B))
        return DSE_EINVAL;
    if (config->min_horizon < 0 || config->min_horizon > config->horizon)
        return DSE_EINVAL;
    if (config->arrival != DSE_ARRIVAL_KALMAN && config->arrival != DSE_ARRIVAL_CONSTANT &&
        config->arrival != DSE_ARRIVAL_NONE)
        return DSE_EINVAL;
    if (config->arrival != DSE_ARRIVAL_NONE && !config->P0)
        return DSE_EINVAL;
    if (!(config->tolerance >= 0) || !dse_is_finite(config->tolerance))
        return DSE_EINVAL;
    const int nx = config->nx, nu = config->nu, ny = config->ny;
    if (!dse_all_finite(linear->A, nx * nx) || !dse_all_finite(linear->C, ny * nx) ||
        (nu > 0 && !dse_all_finite(linear->B, nx * nu)) ||
        (nu > 0 && linear->D && !dse_all_finite(linear->D, ny * nu)) ||
        (config->x0 && !dse_all_finite(config->x0, nx)))
        return DSE_ENONFINITE;
    return linear_mhe_check_bounds(config);
}

static void take_memory(struct dse_linear_mhe *mhe, struct dse_arena *arena)
{
    const int nx = mhe->nx, ny = mhe->ny, N = mhe->N;
    mhe->prior_T = dse_arena_take(arena, DSE_FACTORED_SIZE(nx));
    mhe->scratch = dse_arena_take(arena, DSE_LINEAR_MHE_SCRATCH(nx, ny));
    mhe->complete = dse_arena_take(arena, N * 3 * nx * nx);
    mhe->partial = dse_arena_take(arena, N * 3 * nx * nx);
    mhe->V = dse_arena_take(arena, nx * nx);
    mhe->prior_V = dse_arena_take(arena, nx * nx);
    mhe->start = dse_arena_take(arena, nx * nx);
    mhe->L = dse_arena_take(arena, ny * ny);
    mhe->E = dse_arena_take(arena, ny * nx);
    mhe->spread = dse_arena_take(arena, nx * nx);
    mhe->A_transposed = dse_arena_take(arena, nx * nx);
    mhe->E_transposed = dse_arena_take(arena, nx * ny);
    mhe->xbar = dse_arena_take(arena, nx);
    mhe->xbar_next = dse_arena_take(arena, nx);
    mhe->prior_d = dse_arena_take(arena, nx);
    mhe->y = dse_arena_take(arena, N * ny);
    mhe->has = dse_arena_take(arena, N * ny);
    mhe->white = dse_arena_take(arena, N * ny);
    mhe->rows = dse_arena_take(arena, N * ny * nx);
    mhe->c = dse_arena_take(arena, N * nx);
    mhe->b = dse_arena_take(arena, N * nx);
    mhe->past = dse_arena_take(arena, N * nx);
    mhe->x = dse_arena_take(arena, N * nx);
    mhe->x_next = dse_arena_take(arena, N * nx);
    mhe->g = dse_arena_take(arena, N * nx);
    mhe->lambda = dse_arena_take(arena, N * nx);
    mhe->residual = dse_arena_take(arena, N * nx);
    mhe->errors = dse_arena_take(arena, N * ny);
}

/* R = L L',  E = L^-1 C,  Q = V' V. */
static enum dse_status prepare_noise(struct dse_linear_mhe *mhe)
{
    const struct dse_linear_mhe_config *config = mhe->config;
    const int nx = mhe->nx, ny = mhe->ny;
    enum dse_status status = dse_sym_check(ny, config->R);
    if (status == DSE_OK)
        status = dse_cholesky(ny, config->R, mhe->L);
    if (status != DSE_OK)
        return status;
    for (int i = 0; i < ny * nx; i++)
        mhe->E[i] = config->linear.C[i];
    dse_lower_solve(ny, mhe->L, nx, mhe->E);
    dse_mat_transpose(ny, nx, mhe->E, mhe->E_transposed);
    dse_mat_transpose(nx, nx, config->linear.A, mhe->A_transposed);

    mhe->Q_diagonal = true;
    if (!config->Q)
        return DSE_OK;
    status = dse_sym_check(nx, config->Q);
    dse_real *Y = mhe->scratch, *d = Y + nx * nx;
    if (status == DSE_OK)
        status = dse_semidefinite_rows(nx, nx, config->Q, Y, d);
    if (status != DSE_OK)
        return status;
    for (int i = 0; i < nx; i++) {
        for (int j = 0; j < nx; j++) {
            mhe->Q_diagonal = mhe->Q_diagonal && (i == j || config->Q[i * nx + j] == 0);
            if (d[i] > 0)
                mhe->V[mhe->rank * nx + j] = dse_sqrt(d[i]) * Y[i * nx + j];
        }
        mhe->rank += d[i] > 0;
    }
    return DSE_OK;
}

static enum dse_status prepare_arrival(struct dse_linear_mhe *mhe)
{
    const struct dse_linear_mhe_config *config = mhe->config;
    const int nx = mhe->nx;
    for (int i = 0; i < nx; i++) {
        mhe->xbar[i] = config->x0 ? config->x0[i] : 0;
        mhe->x[i] = mhe->xbar[i];
        mhe->b[i] = 0;
    }
    if (config->arrival == DSE_ARRIVAL_NONE)
        return DSE_OK;
    enum dse_status status = dse_sym_check(nx, config->P0);
    if (status == DSE_OK)
        status = dse_factored_from(nx, config->P0, mhe->prior_T, mhe->prior_d, mhe->scratch);
    if (status == DSE_OK)
        linear_mhe_prior_rows(mhe);
    return status;
}

enum dse_status dse_linear_mhe_init(struct dse_linear_mhe *mhe,
                                    const struct dse_linear_mhe_config *config,
                                    struct dse_arena *arena)
{
    enum dse_status status = check_config(config);
    if (status != DSE_OK)
        return status;
    const int nx = config->nx, N = config->horizon;
    const int storage =
        linear_mhe_wants_bounds(config)
            ? DSE_LINEAR_MHE_BOUNDED_STORAGE(nx, config->ny, N, linear_mhe_max_active(config))
            : DSE_LINEAR_MHE_STORAGE(nx, config->ny, N);
    if (arena->capacity - arena->used < storage)
        return DSE_ESTORAGE;
    *mhe = (struct dse_linear_mhe){.config = config,
                                   .nx = nx,
                                   .nu = config->nu,
                                   .ny = config->ny,
                                   .N = N,
                                   .length = 1,
                                   .incomplete = 1};
    mhe->min_horizon = config->min_horizon > 0 ? config->min_horizon : nx < N ? nx : N;
    mhe->partial_from = N;
    take_memory(mhe, arena);
    status = prepare_noise(mhe);
    if (status == DSE_OK)
        status = prepare_arrival(mhe);
    if (status == DSE_OK)
        status = linear_mhe_factor_complete(mhe);
    linear_mhe_find_spread(mhe);
    if (linear_mhe_wants_bounds(config))
        linear_mhe_prepare_bounds(mhe, arena);
    mhe->health = DSE_HEALTH_INITIALISING;
    return status;
}

const dse_real *dse_linear_mhe_state(const struct dse_linear_mhe *mhe)
{
    return mhe->solved_length > 0 ? mhe->x + (mhe->solved_length - 1) * mhe->nx : mhe->x;
}

long dse_linear_mhe_sample(const struct dse_linear_mhe *mhe)
{
    return mhe->solved_newest;
}

const dse_real *dse_linear_mhe_window(const struct dse_linear_mhe *mhe)
{
    return mhe->x;
}

int dse_linear_mhe_length(const struct dse_linear_mhe *mhe)
{
    return mhe->solved_length;
}

dse_real dse_linear_mhe_certificate(const struct dse_linear_mhe *mhe)
{
    return mhe->certificate;
}

struct dse_linear_mhe_parts dse_linear_mhe_parts(const struct dse_linear_mhe *mhe)
{
    return mhe->parts;
}

enum dse_active_set_path dse_linear_mhe_path(const struct dse_linear_mhe *mhe)
{
    return mhe->path;
}

enum dse_health dse_linear_mhe_health(const struct dse_linear_mhe *mhe)
{
    return mhe->health;
}

const struct dse_linear_mhe_counts *dse_linear_mhe_counts(const struct dse_linear_mhe *mhe)
{
    return &mhe->counts;
}
