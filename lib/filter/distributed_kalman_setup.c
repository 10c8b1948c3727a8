/* Distributed Kalman filter: what a configuration may say, and the filter's memory. */
#include "distributed_kalman_internal.h"
#include "dse/math.h"

enum { DEFAULT_HOLD = 3 };

static bool at_least_zero(dse_real value)
{
    return value >= 0 && dse_is_finite(value);
}

static bool is_discrete(const struct dse_dkf_config *config)
{
    return config->model->time == DSE_DISCRETE;
}

static bool adaptive(const struct dse_dkf_config *config)
{
    return config->scheme == DSE_DKF_EDGE || config->scheme == DSE_DKF_NODE ||
           config->scheme == DSE_DKF_GLOBAL;
}

/* Scheme, direction, gain and time go together. */
static bool fits(const struct dse_dkf_config *config)
{
    const bool given = config->K != NULL, discrete = is_discrete(config);
    if (config->scheme == DSE_DKF_ALONE)
        return true;
    if (config->scheme == DSE_DKF_STANDARD)
        return !given && !discrete && config->direction == DSE_DKF_COVARIANCE;
    if (config->scheme == DSE_DKF_GLOBAL && discrete)
        return false;
    switch (config->direction) {
    case DSE_DKF_COVARIANCE:
        return !given;
    case DSE_DKF_GAIN:
        return !given && !discrete;
    case DSE_DKF_LYAPUNOV:
        return !discrete && config->S != NULL;
    case DSE_DKF_GIVEN:
        return config->D != NULL || config->sensor.ny == 0;
    case DSE_DKF_FILTERED:
        return !given && discrete;
    default:
        return false;
    }
}

static bool numbers_in_range(const struct dse_dkf_config *config)
{
    const bool discrete = is_discrete(config);
    return at_least_zero(config->gamma) && at_least_zero(config->beta) &&
           at_least_zero(config->sigma) && at_least_zero(config->limit) && config->hold >= -1 &&
           (discrete ? config->sigma < 1 : config->period > 0 && dse_is_finite(config->period));
}

static bool says_whole_states(const struct dse_dkf_config *config)
{
    return config->message == DSE_DKF_FULL || config->scheme == DSE_DKF_STANDARD;
}

static bool sensors_are_there(const struct dse_dkf_config *config)
{
    if (config->sensor.ny < 0 || (config->sensor.ny > 0 && config->sensor.C == NULL))
        return false;
    if (config->n_neighbours < 0 || config->n_listeners < 0)
        return false;
    if (says_whole_states(config) || config->n_listeners == 0)
        return true;
    if (config->listeners == NULL)
        return false;
    for (int l = 0; l < config->n_listeners; l++)
        if (config->listeners[l].ny < 0 ||
            (config->listeners[l].ny > 0 && config->listeners[l].C == NULL))
            return false;
    return true;
}

static enum dse_status check(const struct dse_dkf_config *config)
{
    const struct dse_model *model = config->model;
    if (model == NULL || model->nx < 1 || model->nu < 0)
        return DSE_EINVAL;
    const bool lyapunov = adaptive(config) && config->direction == DSE_DKF_LYAPUNOV;
    if (model->dfdx == NULL && (model->f == NULL || config->K == NULL || lyapunov))
        return DSE_EINVAL;
    if ((unsigned)model->time > DSE_DISCRETE || (unsigned)config->scheme > DSE_DKF_STANDARD ||
        (unsigned)config->message > DSE_DKF_FULL)
        return DSE_EINVAL;
    if (!sensors_are_there(config) || !numbers_in_range(config) || !fits(config))
        return DSE_EINVAL;
    if (config->K == NULL && (config->P0 == NULL || (config->sensor.ny > 0 && config->R == NULL)))
        return DSE_EINVAL;
    return DSE_OK;
}

/* ---- memory ---- */

static int scratch_size(const struct dse_dkf *dkf)
{
    const int n = dkf->nx, m = dkf->ny;
    if (dkf->discrete)
        return DSE_DKF_SCRATCH_DISCRETE(n, m);
    const int rates = DSE_RK4_SCRATCH(dkf->n_state) + 2 * n * n + 2 * m * n + 6 * m + n;
    return dkf->riccati ? DSE_DKF_LARGER(rates, DSE_DKF_SCRATCH_UPDATE(n, m)) : rates;
}

static bool take_memory(struct dse_dkf *dkf, struct dse_arena *arena)
{
    const struct dse_dkf_config *config = dkf->config;
    const int n = dkf->nx, m = dkf->ny, neighbours = config->n_neighbours;
    const bool corrects = dkf->discrete && dkf->riccati;
    dkf->now = dse_arena_take(arena, dkf->n_state);
    dkf->next = dse_arena_take(arena, dkf->n_state);
    dkf->said = dse_arena_take(arena, neighbours * dkf->width);
    dkf->age = dse_arena_take(arena, neighbours);
    dkf->y = dse_arena_take(arena, m);
    dkf->has = dse_arena_take(arena, m);
    dkf->residual = dse_arena_take(arena, m);
    dkf->filtered = corrects ? dse_arena_take(arena, n) : NULL;
    dkf->direction = corrects ? dse_arena_take(arena, n * m) : NULL;
    dkf->adapts = corrects ? dse_arena_take(arena, m) : dkf->has;
    dkf->A_before = corrects && config->direction == DSE_DKF_FILTERED && adaptive(config)
                        ? dse_arena_take(arena, n * n)
                        : NULL;
    dkf->R_inverse = dkf->discrete ? NULL : dse_arena_take(arena, m * m);
    dkf->R_present = dkf->discrete ? NULL : dse_arena_take(arena, m * m);
    dkf->global = config->scheme == DSE_DKF_GLOBAL ? dse_arena_take(arena, m * m) : NULL;
    dkf->scratch = dse_arena_take(arena, scratch_size(dkf));
    return dkf->scratch != NULL; /* what comes last does not fit when anything before did not */
}

/* ---- values ---- */

/* X = M, symmetric and positive definite. */
static enum dse_status set_definite(struct dse_dkf *dkf, const dse_real *M, dse_real *X)
{
    const int n = dkf->nx;
    enum dse_status status = dse_sym_check(n, M);
    if (status == DSE_OK)
        status = dse_cholesky(n, M, dkf->scratch);
    if (status != DSE_OK)
        return status;
    for (int k = 0; k < n * n; k++)
        X[k] = M[k];
    dse_sym_enforce(n, X);
    return DSE_OK;
}

static bool finite_or_null(const dse_real *x, int count)
{
    return x == NULL || dse_all_finite(x, count);
}

static enum dse_status start_riccati(struct dse_dkf *dkf)
{
    const struct dse_dkf_config *config = dkf->config;
    const int m = dkf->ny;
    enum dse_status status = set_definite(dkf, config->P0, dkf_parts(dkf, dkf->now).P);
    if (status == DSE_OK && config->Q != NULL)
        status = dse_sym_check(dkf->nx, config->Q);
    if (status == DSE_OK && m > 0)
        status = dse_sym_check(m, config->R);
    if (status == DSE_OK && m > 0)
        status = dse_cholesky(m, config->R, dkf->scratch);
    if (status != DSE_OK || dkf->discrete)
        return status;
    for (int l = 0; l < m; l++)
        dkf->has[l] = 1;
    return dkf_invert_noise(m, config->R, dkf->has, dkf->R_inverse, dkf->scratch);
}

static enum dse_status start_lyapunov(struct dse_dkf *dkf)
{
    const int n = dkf->nx;
    dse_real *W = dkf_parts(dkf, dkf->now).W;
    const enum dse_status status = set_definite(dkf, dkf->config->S, W);
    if (status != DSE_OK)
        return status;
    if (dkf->config->W0 != NULL)
        return set_definite(dkf, dkf->config->W0, W);
    dse_mat_identity(n, W);
    return DSE_OK;
}

static enum dse_status start(struct dse_dkf *dkf)
{
    const struct dse_dkf_config *config = dkf->config;
    const int n = dkf->nx, m = dkf->ny;
    if (!finite_or_null(config->x0, n) || !finite_or_null(config->K, n * m) ||
        !finite_or_null(config->D, n * m) || !finite_or_null(config->sensor.C, m * n))
        return DSE_ENONFINITE;
    for (int i = 0; config->x0 != NULL && i < n; i++)
        dkf->now[i] = config->x0[i];
    for (int j = 0; j < config->n_neighbours; j++)
        dkf->age[j] = DKF_NEVER;
    enum dse_status status = dkf->riccati ? start_riccati(dkf) : DSE_OK;
    if (status == DSE_OK && dkf->lyapunov)
        status = start_lyapunov(dkf);
    return status;
}

static int number_of_gains(const struct dse_dkf_config *config)
{
    if (!adaptive(config))
        return 0;
    return config->scheme == DSE_DKF_EDGE ? config->n_neighbours : 1;
}

enum dse_status dse_dkf_init(struct dse_dkf *dkf, const struct dse_dkf_config *config,
                             struct dse_arena *arena)
{
    const enum dse_status status = check(config);
    if (status != DSE_OK)
        return status;
    const int n = config->model->nx, m = config->sensor.ny;
    *dkf = (struct dse_dkf){
        .config = config,
        .nx = n,
        .ny = m,
        .n_gains = number_of_gains(config),
        .hold = config->hold == 0  ? DEFAULT_HOLD
                : config->hold > 0 ? config->hold
                                   : 0,
        .rate = config->beta > 0 ? config->beta : 1,
        .riccati = config->K == NULL,
        .lyapunov = adaptive(config) && config->direction == DSE_DKF_LYAPUNOV,
        .discrete = is_discrete(config),
        .full = says_whole_states(config),
        .width = config->scheme == DSE_DKF_STANDARD ? n : m,
        .health = DSE_HEALTH_INITIALISING,
    };
    if (dkf->discrete)
        dkf->rate *= config->gamma;
    const int matrices = (dkf->riccati ? 1 : 0) + (dkf->lyapunov ? 1 : 0);
    dkf->n_integrated = n + matrices * n * n;
    dkf->n_state = dkf->n_integrated + dkf->n_gains * m * m;
    if (config->scheme != DSE_DKF_GLOBAL) /* held over a step */
        dkf->n_integrated = dkf->n_state;
    return take_memory(dkf, arena) ? start(dkf) : DSE_ESTORAGE;
}

enum dse_status dse_dkf_set(struct dse_dkf *dkf, const dse_real *x, const dse_real *P)
{
    const struct dkf_parts now = dkf_parts(dkf, dkf->now);
    if (!dse_all_finite(x, dkf->nx))
        return DSE_ENONFINITE;
    const enum dse_status status = P != NULL && dkf->riccati ? set_definite(dkf, P, now.P) : DSE_OK;
    if (status != DSE_OK)
        return status;
    for (int i = 0; i < dkf->nx; i++)
        now.x[i] = x[i];
    for (int k = 0; k < dkf->n_gains * dkf->ny * dkf->ny; k++)
        now.gains[k] = 0;
    for (int l = 0; l < dkf->ny; l++)
        dkf->residual[l] = 0;
    dkf->corrected = false;
    return DSE_OK;
}
