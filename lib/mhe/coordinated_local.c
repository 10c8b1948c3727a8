/* Coordinated moving horizon estimation: set-up of an agent, its window of data, read access. */
#include "coordinated_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"

/* ---- set-up ---- */

static enum dse_status check(const struct dse_mhe_local_config *config)
{
    if (!config->settings || !config->subsystem || config->max_active < 0)
        return DSE_EINVAL;
    const enum dse_status status = mhe_settings_check(config->settings);
    return status != DSE_OK ? status : mhe_subsystem_check(config->subsystem);
}

int dse_mhe_local_storage(const struct dse_mhe_local_config *config)
{
    if (check(config) != DSE_OK)
        return 0;
    const int nx = config->subsystem->nx, ny = config->subsystem->ny;
    const int N = config->settings->horizon;
    const int active = config->max_active > 0 ? config->max_active : 2 * N * nx;
    const bool bounded = mhe_subsystem_is_bounded(config->subsystem);
    if (config->settings->scheme == DSE_MHE_PRICE)
        return bounded ? DSE_MHE_LOCAL_PRICE_BOUNDED_STORAGE(nx, ny, N, active)
                       : DSE_MHE_LOCAL_PRICE_STORAGE(nx, ny, N);
    if (!bounded)
        return DSE_MHE_LOCAL_STORAGE(nx, ny, N);
    return config->settings->barrier > 0 ? DSE_MHE_LOCAL_BARRIER_STORAGE(nx, ny, N)
                                         : DSE_MHE_LOCAL_BOUNDED_STORAGE(nx, ny, N, active);
}

static void take_solution(struct dse_mhe_solution *s, int nx, int N, struct dse_arena *arena)
{
    s->X = dse_arena_take(arena, N * nx);
    s->W = dse_arena_take(arena, (N - 1) * nx);
    s->other = dse_arena_take(arena, (N - 1) * nx);
}

static void take_memory(struct dse_mhe_local *local, struct dse_arena *arena)
{
    const int nx = local->nx, ny = local->ny, N = local->N;
    mhe_outputs_take(&local->outputs, nx, ny, arena);
    mhe_penalty_take(&local->disturbance, nx, arena);
    mhe_chain_take(&local->own_chain, nx, N, arena);
    local->y = dse_arena_take(arena, N * ny);
    local->has = dse_arena_take(arena, N * ny);
    local->factored = dse_arena_take(arena, N * ny);
    local->c = dse_arena_take(arena, N * nx);
    local->past = dse_arena_take(arena, N * nx);
    local->xbar = dse_arena_take(arena, nx);
    local->g = dse_arena_take(arena, (N - 1) * nx);
    local->d = dse_arena_take(arena, (N - 1) * nx);
    local->sent = dse_arena_take(arena, N * nx);
    local->rhs = dse_arena_take(arena, N * nx);
    local->work = dse_arena_take(arena, N * nx);
    local->x = dse_arena_take(arena, N * nx);
    take_solution(&local->current, nx, N, arena);
    take_solution(&local->kept, nx, N, arena);
    if (local->settings->scheme == DSE_MHE_PRICE) {
        mhe_penalty_take(&local->price, nx, arena);
        mhe_penalty_take(&local->interaction, nx, arena);
        mhe_chain_take(&local->price_chain, nx, N, arena);
    }
    if (local->bounded && local->settings->barrier > 0) {
        mhe_chain_take(&local->barrier_chain, nx, N, arena);
        local->newton = dse_arena_take(arena, DSE_MHE_BARRIER_SIZE(nx, N));
    }
}

static enum dse_status prepare(struct dse_mhe_local *local)
{
    const struct dse_mhe_subsystem *s = local->subsystem;
    dse_real *scratch = local->own_chain.D; /* 2 nx nx; filled when the first window is */
    enum dse_status status = mhe_outputs_set(&local->outputs, s);
    if (status == DSE_OK)
        status = mhe_penalty_set(&local->disturbance, MHE_PENALTY_DISTURBANCE, s, scratch);
    if (status != DSE_OK || local->settings->scheme != DSE_MHE_PRICE)
        return status;
    status = mhe_penalty_set(&local->price, MHE_PENALTY_PRICE, s, scratch);
    if (status == DSE_OK)
        status = mhe_penalty_set(&local->interaction, MHE_PENALTY_INTERACTION, s, scratch);
    return status;
}

enum dse_status dse_mhe_local_init(struct dse_mhe_local *local,
                                   const struct dse_mhe_local_config *config,
                                   struct dse_arena *arena)
{
    enum dse_status status = check(config);
    if (status != DSE_OK)
        return status;
    if (arena->capacity - arena->used < dse_mhe_local_storage(config))
        return DSE_ESTORAGE;
    const struct dse_mhe_subsystem *s = config->subsystem;
    *local = (struct dse_mhe_local){.config = config,
                                    .settings = config->settings,
                                    .subsystem = s,
                                    .nx = s->nx,
                                    .ny = s->ny,
                                    .N = config->settings->horizon,
                                    .bounded = mhe_subsystem_is_bounded(s)};
    take_memory(local, arena);
    status = prepare(local);
    if (status == DSE_OK && local->bounded && local->settings->barrier == 0)
        status = mhe_bounded_init(local, arena);
    for (int i = 0; i < s->nx; i++)
        local->x[i] = local->xbar[i] = s->x0 ? s->x0[i] : 0;
    local->finished_length = 1;
    return status;
}

/* ---- data ---- */

/* The oldest of `count` blocks leaves. */
static void drop_oldest(int count, int size, dse_real *blocks)
{
    for (int i = 0; i < (count - 1) * size; i++)
        blocks[i] = blocks[i + size];
}

/* A new sample without data. */
static void advance(struct dse_mhe_local *local)
{
    const int nx = local->nx, ny = local->ny;
    if (local->length == local->N) {
        drop_oldest(local->N, ny, local->y);
        drop_oldest(local->N, ny, local->has);
        drop_oldest(local->N, nx, local->c);
        drop_oldest(local->N, nx, local->past);
        for (int i = 0; i < nx && local->N > 1; i++)
            local->xbar[i] = local->past[i];
        if (local->own_qp.qp.config)
            dse_window_qp_slide(&local->own_qp.qp);
        if (local->price_qp.qp.config)
            dse_window_qp_slide(&local->price_qp.qp);
    } else {
        local->length++;
    }
    const int last = local->length - 1;
    for (int j = 0; j < ny; j++)
        local->has[last * ny + j] = 0;
    for (int i = 0; i < nx; i++) {
        local->c[last * nx + i] = 0;
        /* until there is an estimate: prediction by A_ii */
        local->past[last * nx + i] =
            last > 0 ? dse_dot(nx, local->subsystem->A + i * nx, local->past + (last - 1) * nx)
                     : local->xbar[i];
    }
}

enum dse_status dse_mhe_local_measure(struct dse_mhe_local *local, int age,
                                      const struct dse_measurement *measurement)
{
    if (age < 0 || !measurement)
        return DSE_EINVAL;
    if (age >= local->length)
        return DSE_ENODATA;
    const int at = local->length - 1 - age, ny = local->ny;
    for (int j = 0; j < ny; j++) {
        if (!dse_measurement_has(measurement, j))
            continue;
        local->y[at * ny + j] = measurement->y[j];
        local->has[at * ny + j] = 1;
    }
    mhe_outputs_project(&local->outputs, local->has + at * ny, local->y + at * ny,
                        local->c + at * local->nx);
    return DSE_OK;
}

enum dse_status dse_mhe_local_begin(struct dse_mhe_local *local, long k,
                                    const struct dse_measurement *measurement)
{
    if (k < 0 || (local->begun && k <= local->newest))
        return DSE_EINVAL;
    const long gap = local->begun ? k - local->newest : 1;
    for (long i = 0; i < gap && i < local->N; i++)
        advance(local);
    local->begun = true;
    local->newest = k;
    local->fresh = local->heard = local->stopped = local->has_kept = false;
    local->used_held = local->used_nothing = false;
    local->round = -1;
    local->flags = local->solved = local->active = 0;
    local->sends = false;
    local->last_status = DSE_ENODATA;
    return measurement ? dse_mhe_local_measure(local, 0, measurement) : DSE_OK;
}

/* ---- read access ---- */

const dse_real *dse_mhe_local_state(const struct dse_mhe_local *local)
{
    return local->x + (local->finished_length - 1) * local->nx;
}

long dse_mhe_local_sample(const struct dse_mhe_local *local)
{
    return local->finished_sample;
}

const dse_real *dse_mhe_local_window(const struct dse_mhe_local *local)
{
    return local->x;
}

int dse_mhe_local_length(const struct dse_mhe_local *local)
{
    return local->finished_length;
}

enum dse_mhe_status dse_mhe_local_status(const struct dse_mhe_local *local)
{
    return local->status;
}

enum dse_health dse_mhe_local_health(const struct dse_mhe_local *local)
{
    return local->health;
}

int dse_mhe_local_iterations(const struct dse_mhe_local *local)
{
    return local->solved;
}

bool dse_mhe_local_has_sent(const struct dse_mhe_local *local)
{
    return local->sends;
}

int dse_mhe_local_active(const struct dse_mhe_local *local)
{
    return local->active;
}

dse_real dse_mhe_local_certificate(const struct dse_mhe_local *local)
{
    return local->certificate;
}

dse_real dse_mhe_local_cost(const struct dse_mhe_local *local)
{
    return local->cost;
}

enum dse_status dse_mhe_local_covariance(const struct dse_mhe_local *local, dse_real *P)
{
    const int nx = local->nx;
    if (!local->has_covariance)
        return DSE_ENODATA;
    /* The last block of Omega_ii^-1 is (L L')^-1 of the last Schur complement. */
    dse_mat_identity(nx, P);
    dse_cholesky_solve(nx, local->own_chain.L + (local->length - 1) * nx * nx, nx, P);
    dse_sym_enforce(nx, P);
    return DSE_OK;
}
