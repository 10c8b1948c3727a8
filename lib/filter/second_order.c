/* Second-order filter: what a configuration may say, the filter's memory, and what can be read. */
#include "dse/second_order.h"

#include "dse/linalg.h"
#include "dse/math.h"
#include "second_order_internal.h"

enum dse_status second_order_root(int n, const dse_real *S, dse_real *Z, dse_real *d)
{
    const enum dse_status status = dse_semidefinite_rows(n, n, S, Z, d);
    if (status != DSE_OK)
        return status;
    for (int r = 0; r < n; r++) {
        const dse_real root = dse_sqrt(d[r]);
        for (int i = 0; i < n; i++)
            Z[r * n + i] *= root;
    }
    return DSE_OK;
}

void second_order_array(int n, int m, dse_real *A, dse_real *Z)
{
    dse_real *L = A + n * m; /* behind it, n x n: lq_lower may not write into A */
    dse_lq_lower(n, m, A, L);
    dse_mat_transpose(n, n, L, Z);
}

void second_order_exchange(struct dse_second_order *filter)
{
    const int n = filter->nx;
    dse_real *x = filter->x, *Z = filter->Z;
    filter->x = filter->x_next;
    filter->Z = filter->Z_next;
    filter->x_next = x;
    filter->Z_next = Z;
    dse_mat_mul_tn(n, n, n, filter->Z, filter->Z, filter->S);
    dse_sym_enforce(n, filter->S);
}

/* ---- configuration ---- */

static bool at_least_zero(dse_real value)
{
    return value >= 0 && dse_is_finite(value);
}

static enum dse_status check(const struct dse_second_order_config *config, int ny)
{
    const struct dse_quadratic *system =
        config->model != NULL ? dse_quadratic_of(config->model) : NULL;
    if (system == NULL || (unsigned)config->kind > DSE_SECOND_ORDER_UNSCENTED)
        return DSE_EINVAL;
    if (ny < 0 || config->S0 == NULL || (ny > 0 && config->R == NULL))
        return DSE_EINVAL;
    if (!at_least_zero(config->gate) || !at_least_zero(config->rtol) ||
        !at_least_zero(config->atol) || config->substeps < 0 || config->max_steps < 0 ||
        !dse_is_finite(config->t0))
        return DSE_EINVAL;
    const bool sensors_elsewhere = config->C != NULL;
    return dse_quadratic_check(config->model->nx, config->model->nu, sensors_elsewhere ? 0 : ny,
                               system);
}

static bool take_memory(struct dse_second_order *filter, struct dse_arena *arena)
{
    const int n = filter->nx, m = filter->ny;
    filter->x = dse_arena_take(arena, n);
    filter->x_next = dse_arena_take(arena, n);
    filter->Z = dse_arena_take(arena, n * n);
    filter->Z_next = dse_arena_take(arena, n * n);
    filter->S = dse_arena_take(arena, n * n);
    filter->y = dse_arena_take(arena, m);
    filter->has = dse_arena_take(arena, m);
    filter->innovation = dse_arena_take(arena, m);
    filter->scratch = dse_arena_take(arena, DSE_SECOND_ORDER_SCRATCH(n, m));
    return filter->scratch != NULL; /* what comes last does not fit when anything before did not */
}

/* Whether |w|^2 + tr S cannot grow between samples. */
static bool is_bounded(const struct dse_second_order *filter)
{
    const struct dse_quadratic *system = filter->system;
    struct dse_quadratic_certificate certificate;
    if (filter->config->Q != NULL)
        return false;
    for (int k = 0; system->d != NULL && k < filter->nx; k++)
        if (system->d[k] != 0)
            return false;
    return dse_quadratic_certify(filter->nx, system, &certificate, filter->scratch) == DSE_OK &&
           certificate.dissipative && certificate.lossless;
}

static bool is_diagonal(int m, const dse_real *R)
{
    for (int l = 0; l < m; l++)
        for (int k = 0; k < m; k++)
            if (k != l && R[l * m + k] != 0)
                return false;
    return true;
}

static enum dse_status start(struct dse_second_order *filter)
{
    const struct dse_second_order_config *config = filter->config;
    const int n = filter->nx, m = filter->ny;
    enum dse_status status = DSE_OK;
    if (config->C != NULL && !dse_all_finite(config->C, m * n))
        return DSE_ENONFINITE;
    if (m > 0)
        status = dse_sym_check(m, config->R);
    if (status == DSE_OK && m > 0)
        status = dse_cholesky(m, config->R, filter->scratch);
    if (status == DSE_OK && config->Q != NULL)
        status = dse_sym_check(n, config->Q);
    if (status == DSE_OK && config->Q != NULL)
        status = second_order_root(n, config->Q, filter->scratch, filter->scratch + n * n);
    if (status != DSE_OK)
        return status;
    filter->R_diagonal = is_diagonal(m, config->R);
    /* x is zero so far: memory of an arena is */
    return dse_second_order_set(filter, config->t0, config->x0 != NULL ? config->x0 : filter->x,
                                config->S0);
}

enum dse_status dse_second_order_init(struct dse_second_order *filter,
                                      const struct dse_second_order_config *config,
                                      struct dse_arena *arena)
{
    const bool own = config->C != NULL;
    const int ny = own ? config->ny : (config->model != NULL ? config->model->ny : 0);
    const enum dse_status status = check(config, ny);
    if (status != DSE_OK)
        return status;
    const struct dse_quadratic *system = dse_quadratic_of(config->model);
    *filter = (struct dse_second_order){
        .config = config,
        .system = system,
        .C = own ? config->C : system->C,
        .nx = config->model->nx,
        .ny = ny,
        .form = dse_quadratic_norm(system),
        .health = DSE_HEALTH_INITIALISING,
    };
    if (!take_memory(filter, arena))
        return DSE_ESTORAGE;
    filter->bounded = config->substeps > 0 && is_bounded(filter);
    return start(filter);
}

enum dse_status dse_second_order_set(struct dse_second_order *filter, dse_real t, const dse_real *x,
                                     const dse_real *S)
{
    const int n = filter->nx;
    if (!dse_is_finite(t) || !dse_all_finite(x, n))
        return DSE_ENONFINITE;
    enum dse_status status = S != NULL ? dse_sym_check(n, S) : DSE_OK;
    if (status == DSE_OK && S != NULL)
        status = second_order_root(n, S, filter->Z_next, filter->scratch);
    if (status != DSE_OK)
        return status;
    if (S == NULL)
        second_order_copy(n * n, filter->Z, filter->Z_next);
    second_order_copy(n, x, filter->x_next);
    second_order_exchange(filter);
    filter->time = t;
    filter->integration.h0 = 0;
    filter->predicted = false;
    return DSE_OK;
}

/* ---- reading ---- */

dse_real dse_second_order_time(const struct dse_second_order *filter)
{
    return filter->time;
}

const dse_real *dse_second_order_state(const struct dse_second_order *filter)
{
    return filter->x;
}

const dse_real *dse_second_order_covariance(const struct dse_second_order *filter)
{
    return filter->S;
}

const dse_real *dse_second_order_innovation(const struct dse_second_order *filter)
{
    return filter->innovation;
}

int dse_second_order_used(const struct dse_second_order *filter)
{
    return filter->used;
}

enum dse_health dse_second_order_health(const struct dse_second_order *filter)
{
    return filter->health;
}

const struct dse_second_order_counts *dse_second_order_counts(const struct dse_second_order *filter)
{
    return &filter->counts;
}
