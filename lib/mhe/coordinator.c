/* Coordinator of moving horizon estimators: set-up, begin of a sample, read access. */
#include <stddef.h>

#include "coordinator_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"

/* ---- set-up ---- */

struct sizes {
    int n, ny, nx_max, ny_max;
    bool bounded, with_D;
};

static enum dse_status check_subsystems(const struct dse_mhe_coordinator_config *config,
                                        struct sizes *sizes)
{
    *sizes = (struct sizes){.with_D = true};
    for (int i = 0; i < config->parts; i++) {
        const struct dse_mhe_subsystem *s = &config->subsystems[i];
        const enum dse_status status = mhe_subsystem_check(s);
        if (status != DSE_OK)
            return status;
        sizes->n += s->nx;
        sizes->ny += s->ny;
        sizes->nx_max = s->nx > sizes->nx_max ? s->nx : sizes->nx_max;
        sizes->ny_max = s->ny > sizes->ny_max ? s->ny : sizes->ny_max;
        sizes->bounded = sizes->bounded || mhe_subsystem_is_bounded(s);
        sizes->with_D = sizes->with_D && s->D;
    }
    return dse_all_finite(config->A, sizes->n * sizes->n) ? DSE_OK : DSE_ENONFINITE;
}

static enum dse_status check(const struct dse_mhe_coordinator_config *config, struct sizes *sizes)
{
    if (!config->settings || config->parts < 1 || !config->subsystems || !config->A)
        return DSE_EINVAL;
    enum dse_status status = mhe_settings_check(config->settings);
    if (status == DSE_OK && config->settings->scheme == DSE_MHE_ALONE)
        status = DSE_EINVAL;
    if (status == DSE_OK)
        status = check_subsystems(config, sizes);
    if (status != DSE_OK)
        return status;
    if (!(config->eps > 0) || config->max_iter < 0 || config->dead_after < 0 ||
        config->recentrings < 0 || config->anderson < 0)
        return DSE_EINVAL;
    if (!(config->gradient_step >= 0) || !(config->relaxation >= 0 && config->relaxation <= 1))
        return DSE_EINVAL;
    /* Diverges for the source's own examples: only with the proof that it does not. */
    if (!(config->consistent_certificate >= 0 && config->consistent_certificate < 1))
        return DSE_EINVAL;
    return config->recentrings > 0 && !sizes->with_D ? DSE_EINVAL : DSE_OK;
}

int dse_mhe_coordinator_storage(const struct dse_mhe_coordinator_config *config)
{
    struct sizes s;
    if (check(config, &s) != DSE_OK)
        return 0;
    const int N = config->settings->horizon, parts = config->parts;
    if (config->settings->scheme == DSE_MHE_PREDICTION)
        return s.bounded ? DSE_MHE_COORDINATOR_PREDICTION_BOUNDED_STORAGE(s.n, parts, s.nx_max, N,
                                                                          config->anderson)
                         : DSE_MHE_COORDINATOR_PREDICTION_STORAGE(s.n, parts, s.nx_max, N,
                                                                  config->anderson);
    return s.bounded
               ? DSE_MHE_COORDINATOR_PRICE_BOUNDED_STORAGE(s.n, parts, s.nx_max, s.ny_max, s.ny, N)
               : DSE_MHE_COORDINATOR_PRICE_STORAGE(s.n, parts, s.nx_max, s.ny_max, s.ny, N);
}

static int *take_ints(struct dse_arena *arena, int count)
{
    return (int *)(void *)dse_arena_take(arena, DSE_ARENA_INTS(count));
}

static void take_price(struct dse_mhe_coordinator *c, struct dse_arena *arena)
{
    struct dse_mhe_dual *dual = &c->dual;
    struct dse_mhe_prices *prices = &c->prices;
    const int N = c->N, nx = c->nx_max, m = (N - 1) * c->n;
    const int nz = c->bounded ? 2 * nx : nx;
    dual->has = dse_arena_take(arena, N * c->ny);
    dual->used = dse_arena_take(arena, N * c->ny + c->parts);
    dual->last = take_ints(arena, m);
    dual->matrix = dse_arena_take(arena, m * m);
    if (c->bounded) {
        dual->active = dse_arena_take(arena, m * m);
        dual->factor = dse_arena_take(arena, m * m);
        dual->bits = dse_arena_take(arena, c->parts * DSE_MHE_BIT_WORDS((2 * N - 1) * nx));
    }
    dual->column = dse_arena_take(arena, N * nz);
    dual->response = dse_arena_take(arena, N * nz);
    dual->scratch = dse_arena_take(arena, 2 * nx * nx);
    mhe_chain_take(&dual->chain, nz, N, arena);
    mhe_outputs_take(&dual->outputs, nx, c->ny_max, arena);
    mhe_penalty_take(&dual->penalty, nx, arena);
    mhe_penalty_take(&dual->disturbance, nx, arena);
    prices->E = dse_arena_take(arena, m);
    prices->best = dse_arena_take(arena, m);
    prices->best_E = dse_arena_take(arena, m);
    prices->step = dse_arena_take(arena, m);
    prices->reference = dse_arena_take(arena, m);
}

static void take_prediction(struct dse_mhe_coordinator *c, struct dse_arena *arena)
{
    struct dse_mhe_anderson *a = &c->anderson;
    const int size = (2 * c->N - 1) * c->n, memory = c->config->anderson;
    if (c->bounded) {
        c->question = dse_arena_take(arena, size);
        c->answer = dse_arena_take(arena, size);
    }
    a->memory = memory;
    if (memory == 0)
        return;
    a->f = dse_arena_take(arena, (memory + 1) * size);
    a->r = dse_arena_take(arena, (memory + 1) * size);
    a->QR = dse_arena_take(arena, size * memory);
    a->b = dse_arena_take(arena, size);
    a->tau = dse_arena_take(arena, memory);
    a->gamma = dse_arena_take(arena, memory);
}

static void take_memory(struct dse_mhe_coordinator *c, struct dse_arena *arena)
{
    const int parts = c->parts, N = c->N, n = c->n;
    c->first = take_ints(arena, parts + 1);
    c->first_output = take_ints(arena, parts + 1);
    c->neighbour_first = take_ints(arena, parts + 1);
    c->neighbour = take_ints(arena, parts * parts);
    c->silent = take_ints(arena, parts);
    c->age = take_ints(arena, parts);
    c->state = take_ints(arena, parts);
    c->J = dse_arena_take(arena, parts);
    c->asked = dse_arena_take(arena, N * n);
    c->X = dse_arena_take(arena, N * n);
    c->p = dse_arena_take(arena, (N - 1) * n);
    c->other = dse_arena_take(arena, (N - 1) * n);
    c->work = dse_arena_take(arena, N * n + 2 * c->nx_max * c->nx_max);
    if (c->settings->scheme == DSE_MHE_PRICE)
        take_price(c, arena);
    else
        take_prediction(c, arena);
}

/* A_il has an entry that is not zero. */
static bool acts_on(const struct dse_mhe_coordinator *c, int l, int i)
{
    const dse_real *block = coordinator_block(c, i, l);
    for (int a = 0; a < coordinator_nx(c, i); a++)
        for (int b = 0; b < coordinator_nx(c, l); b++)
            if (block[a * c->n + b] != 0)
                return true;
    return false;
}

static void find_structure(struct dse_mhe_coordinator *c)
{
    for (int i = 0; i < c->parts; i++) {
        c->first[i + 1] = c->first[i] + c->config->subsystems[i].nx;
        c->first_output[i + 1] = c->first_output[i] + c->config->subsystems[i].ny;
    }
    for (int i = 0; i < c->parts; i++) {
        int count = c->neighbour_first[i];
        for (int l = 0; l < c->parts; l++)
            if (l != i && (acts_on(c, l, i) || acts_on(c, i, l)))
                c->neighbour[count++] = l;
        c->neighbour_first[i + 1] = count;
    }
}

enum dse_status dse_mhe_coordinator_init(struct dse_mhe_coordinator *c,
                                         const struct dse_mhe_coordinator_config *config,
                                         struct dse_arena *arena)
{
    struct sizes s;
    enum dse_status status = check(config, &s);
    if (status != DSE_OK)
        return status;
    if (arena->capacity - arena->used < dse_mhe_coordinator_storage(config))
        return DSE_ESTORAGE;
    *c =
        (struct dse_mhe_coordinator){.config = config,
                                     .settings = config->settings,
                                     .n = s.n,
                                     .parts = config->parts,
                                     .N = config->settings->horizon,
                                     .ny = s.ny,
                                     .nx_max = s.nx_max,
                                     .ny_max = s.ny_max,
                                     .bounded = s.bounded,
                                     .max_iter = config->max_iter > 0 ? config->max_iter : 100,
                                     .dead_after = config->dead_after > 0 ? config->dead_after : 8};
    take_memory(c, arena);
    find_structure(c);
    for (int i = 0; i < c->parts; i++)
        c->state[i] = MHE_ALIVE;
    c->length = c->settings->min_horizon;
    return DSE_OK;
}

/* ---- a sample ---- */

/* Data that have become too old are forgotten. */
static void grow_old(struct dse_mhe_coordinator *c, long gap)
{
    for (int i = 0; i < c->parts; i++) {
        if (!coordinator_has(c, i, MHE_DATA))
            continue;
        c->age[i] += gap < 1000000 ? (int)gap : 1000000;
        if (c->settings->max_age > 0 && c->age[i] > c->settings->max_age)
            c->state[i] &= ~(MHE_DATA | MHE_SYNC);
    }
}

enum dse_status dse_mhe_coordinator_begin(struct dse_mhe_coordinator *c, long k)
{
    if (k < 0 || (c->begun && k <= c->newest))
        return DSE_EINVAL;
    const int N = c->N, length = k + 1 < N ? (int)k + 1 : N;
    grow_old(c, c->begun ? k - c->newest : 0);
    c->begun = true;
    c->newest = k;
    c->round = 0;
    c->uplinks = 0;
    c->error = 0;
    c->first_error = 0;
    c->accepted = false;
    c->relaxed = 1;
    c->anderson.count = 0;
    c->has_answer = false;
    for (int i = 0; i < c->parts; i++)
        c->state[i] &= ~(MHE_ANSWERED | MHE_CURRENT | MHE_INFEASIBLE | MHE_SINGULAR | MHE_SHORT);
    if (length < c->settings->min_horizon) {
        c->outcome = DSE_MHE_OUTCOME_STARTING;
        return DSE_OK;
    }
    c->outcome = DSE_MHE_CONTINUE;
    const bool first = c->last_length == 0;
    c->length = length;
    if (c->settings->scheme == DSE_MHE_PRICE)
        coordinator_start_prices(c, first);
    else
        coordinator_warm_start(c, first);
    c->last_length = length;
    return DSE_OK;
}

void dse_mhe_coordinator_stop(struct dse_mhe_coordinator *c)
{
    if (c->outcome == DSE_MHE_CONTINUE)
        c->outcome = DSE_MHE_OUTCOME_PREMATURE;
}

/* ---- coupling ---- */

void coordinator_interaction(const struct dse_mhe_coordinator *c, dse_real *X, int i, dse_real *h)
{
    const int nx = coordinator_nx(c, i), transitions = c->length - 1;
    for (int e = 0; e < transitions * nx; e++)
        h[e] = 0;
    for (int q = c->neighbour_first[i]; q < c->neighbour_first[i + 1]; q++) {
        const int l = c->neighbour[q], nl = coordinator_nx(c, l);
        const dse_real *block = coordinator_block(c, i, l), *x = coordinator_states(c, X, l);
        for (int t = 0; t < transitions; t++)
            for (int a = 0; a < nx; a++)
                h[t * nx + a] += dse_dot(nl, block + a * c->n, x + t * nl);
    }
}

void coordinator_price_on(const struct dse_mhe_coordinator *c, dse_real *p, int i, dse_real *g)
{
    const int nx = coordinator_nx(c, i), transitions = c->length - 1;
    for (int e = 0; e < transitions * nx; e++)
        g[e] = 0;
    for (int q = c->neighbour_first[i]; q < c->neighbour_first[i + 1]; q++) {
        const int l = c->neighbour[q], nl = coordinator_nx(c, l);
        const dse_real *block = coordinator_block(c, l, i), *pl = coordinator_transitions(c, p, l);
        for (int t = 0; t < transitions; t++)
            for (int a = 0; a < nl; a++)
                dse_axpy(nx, -pl[t * nl + a], block + a * c->n, g + t * nx);
    }
}

/* ---- read access ---- */

enum dse_mhe_outcome dse_mhe_coordinator_outcome(const struct dse_mhe_coordinator *c)
{
    return c->outcome;
}

int dse_mhe_coordinator_length(const struct dse_mhe_coordinator *c)
{
    return c->length;
}

int dse_mhe_coordinator_iterations(const struct dse_mhe_coordinator *c)
{
    return c->round;
}

dse_real dse_mhe_coordinator_error(const struct dse_mhe_coordinator *c)
{
    return c->error;
}

const dse_real *dse_mhe_coordinator_window(const struct dse_mhe_coordinator *c, int i)
{
    return coordinator_has(c, i, MHE_DATA) ? coordinator_states(c, c->X, i) : NULL;
}

const dse_real *dse_mhe_coordinator_price(const struct dse_mhe_coordinator *c)
{
    return c->p;
}

bool dse_mhe_coordinator_hears(const struct dse_mhe_coordinator *c, int i)
{
    return coordinator_has(c, i, MHE_ALIVE);
}

int dse_mhe_coordinator_uplinks(const struct dse_mhe_coordinator *c)
{
    return c->uplinks;
}
