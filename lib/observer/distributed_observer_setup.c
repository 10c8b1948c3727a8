/* Checks of a distributed observer's configuration, its memory and what is computed once. */
#include "distributed_observer_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"
#include "dse/ode.h"

/* Of a matrix that may be left out. */
static bool finite(const dse_real *A, int size)
{
    return A == NULL || dse_all_finite(A, size);
}

static bool not_negative(dse_real value)
{
    return value >= 0 && dse_is_finite(value);
}

static enum dse_status check_observer(const struct dse_distributed_observer_config *c)
{
    if (c->time != DSE_CONTINUOUS && c->time != DSE_DISCRETE)
        return DSE_EINVAL;
    if (c->nz < 1 || c->nx < 1 || c->nu < 0 || c->ny < 0 || c->neighbours < 0)
        return DSE_EINVAL;
    if (c->Lambda == NULL || (c->M == NULL && c->nx != c->nz))
        return DSE_EINVAL;
    if (c->time == DSE_DISCRETE && c->neighbours > 0)
        return DSE_EINVAL;
    const bool good = finite(c->Lambda, c->nz * c->nz) && finite(c->L, c->nz * c->ny) &&
                      finite(c->H, c->nz * c->nu) && finite(c->M, c->nx * c->nz) &&
                      finite(c->N, c->nx * c->ny) && finite(c->J, c->nx * c->nu) &&
                      finite(c->z0, c->nz);
    return good ? DSE_OK : DSE_ENONFINITE;
}

static enum dse_status check_rows(const struct dse_observer_rows *rows, int nx)
{
    if (rows->C2 != NULL && rows->rows < 0)
        return DSE_EINVAL;
    return rows->C2 == NULL || dse_all_finite(rows->C2, rows->rows * nx) ? DSE_OK : DSE_ENONFINITE;
}

/* The coupling whose residual is what the neighbours measure. */
static enum dse_status check_theirs(const struct dse_distributed_observer_config *c)
{
    if (c->gain != DSE_OBSERVER_EDGE || c->theirs == NULL)
        return DSE_EINVAL;
    enum dse_status status = DSE_OK;
    for (int j = 0; j < c->neighbours && status == DSE_OK; j++)
        status = check_rows(&c->theirs[j], c->nx);
    return status;
}

/* The coupling with the node's own residual. */
static enum dse_status check_own(const struct dse_distributed_observer_config *c)
{
    if (c->residual != DSE_OBSERVER_OWN || c->nr < 0 || (c->nr > 0 && c->D == NULL))
        return DSE_EINVAL;
    if (c->gain != DSE_OBSERVER_EDGE && c->gain != DSE_OBSERVER_NODE)
        return DSE_EINVAL;
    if (!finite(c->D, c->nr * c->nz) || !finite(c->D_y, c->nr * c->ny) ||
        !finite(c->D_u, c->nr * c->nu))
        return DSE_ENONFINITE;
    return check_rows(&c->own, c->nx);
}

static enum dse_status check_coupling(const struct dse_distributed_observer_config *c)
{
    if (c->neighbours == 0)
        return DSE_OK;
    if (c->Pi == NULL || c->hold < -1)
        return DSE_EINVAL;
    if (!not_negative(c->gamma) || !not_negative(c->leak) || !not_negative(c->gain_max))
        return DSE_EINVAL;
    const enum dse_status status = dse_sym_check(c->nz, c->Pi);
    if (status != DSE_OK)
        return status;
    return c->residual == DSE_OBSERVER_NEIGHBOURS ? check_theirs(c) : check_own(c);
}

/* injection = Pi^-1 M' or Pi^-1 D' */
static enum dse_status make_injection(struct dse_distributed_observer *observer, dse_real *factor)
{
    const struct dse_distributed_observer_config *c = observer->config;
    const int n = observer->n_inject;
    const dse_real *rows = c->residual == DSE_OBSERVER_OWN ? c->D : c->M;
    if (n == 0)
        return DSE_OK;
    if (rows != NULL)
        dse_mat_transpose(n, c->nz, rows, observer->injection);
    else
        dse_mat_identity(n, observer->injection);
    const enum dse_status status = dse_cholesky(c->nz, c->Pi, factor);
    if (status == DSE_OK)
        dse_cholesky_solve(c->nz, factor, n, observer->injection);
    return status;
}

static void count(struct dse_distributed_observer *observer, int *largest)
{
    const struct dse_distributed_observer_config *c = observer->config;
    observer->n_rows = observer->n_gain = observer->n_inject = *largest = 0;
    for (int j = 0; j < c->neighbours; j++) {
        const int q = dse_observer_gain_rows(c, j), k = dse_observer_columns(c, j);
        observer->n_rows += k;
        if (c->gain == DSE_OBSERVER_EDGE || j == 0)
            observer->n_gain += q * k;
        *largest = q > *largest ? q : *largest;
    }
    if (c->neighbours > 0)
        observer->n_inject = c->residual == DSE_OBSERVER_OWN ? c->nr : c->nx;
}

static int *take_ints(struct dse_arena *arena, int count)
{
    return (int *)(void *)dse_arena_take(arena, DSE_ARENA_INTS(count));
}

/* Deals out the memory; `factor` is for init only. */
static enum dse_status take(struct dse_distributed_observer *observer, struct dse_arena *arena,
                            dse_real **factor)
{
    const struct dse_distributed_observer_config *c = observer->config;
    int largest;
    count(observer, &largest);
    if (arena->capacity - arena->used < DSE_DISTRIBUTED_OBSERVER_STORAGE(c->nz, c->nu, c->ny, c->nx,
                                                                         c->neighbours,
                                                                         observer->n_rows, largest))
        return DSE_ESTORAGE;
    const int n_state = c->nz + observer->n_gain;
    observer->state = dse_arena_take(arena, n_state);
    observer->next = dse_arena_take(arena, n_state);
    observer->scratch = dse_arena_take(arena, DSE_RK4_SCRATCH(n_state));
    observer->injection = dse_arena_take(arena, c->nz * observer->n_inject);
    observer->sum = dse_arena_take(arena, observer->n_inject);
    observer->messages = dse_arena_take(arena, observer->n_rows);
    observer->difference = dse_arena_take(arena, observer->n_rows);
    observer->residual = dse_arena_take(arena, largest);
    observer->xh = dse_arena_take(arena, c->nx);
    observer->xh_stage = dse_arena_take(arena, c->nx);
    observer->y = dse_arena_take(arena, c->ny);
    observer->y_next = dse_arena_take(arena, c->ny);
    observer->y_stage = dse_arena_take(arena, c->ny);
    observer->u = dse_arena_take(arena, c->nu);
    observer->u_stage = dse_arena_take(arena, c->nu);
    observer->first_row = take_ints(arena, c->neighbours);
    observer->first_gain = take_ints(arena, c->neighbours);
    observer->age = take_ints(arena, c->neighbours);
    observer->seen = take_ints(arena, c->ny);
    *factor = dse_arena_take(arena, c->nz * c->nz);
    return DSE_OK;
}

/* Where each neighbour's rows and its Gamma begin; all share a node-dependent one. */
static void find_places(const struct dse_distributed_observer *observer)
{
    const struct dse_distributed_observer_config *c = observer->config;
    int row = 0, gain = 0;
    for (int j = 0; j < c->neighbours; j++) {
        const int k = dse_observer_columns(c, j);
        observer->first_row[j] = row;
        observer->first_gain[j] = gain;
        row += k;
        gain += c->gain == DSE_OBSERVER_EDGE ? dse_observer_gain_rows(c, j) * k : 0;
    }
}

enum dse_status dse_distributed_observer_init(struct dse_distributed_observer *observer,
                                              const struct dse_distributed_observer_config *config,
                                              struct dse_arena *arena)
{
    enum dse_status status = check_observer(config);
    if (status == DSE_OK)
        status = check_coupling(config);
    if (status != DSE_OK)
        return status;
    *observer = (struct dse_distributed_observer){.config = config,
                                                  .hold = config->hold == 0    ? 3
                                                          : config->hold == -1 ? 0
                                                                               : config->hold};
    dse_real *factor;
    status = take(observer, arena, &factor);
    if (status == DSE_OK)
        status = make_injection(observer, factor);
    if (status != DSE_OK)
        return status;
    find_places(observer);
    for (int i = 0; config->z0 != NULL && i < config->nz; i++)
        observer->state[i] = config->z0[i];
    for (int j = 0; j < config->neighbours; j++)
        observer->age[j] = -1;
    return DSE_OK;
}
