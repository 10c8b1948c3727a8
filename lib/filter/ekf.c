/* Extended Kalman filter: set-up and read access. The steps are in ekf_predict.c, ekf_update.c. */
#include "ekf_internal.h"

#include <stddef.h>

#include "dse/linalg.h"
#include "dse/math.h"

static enum dse_status check_config(const struct dse_ekf_config *config)
{
    const struct dse_model *model = config->model;
    if (!model || model->nx < 1 || model->ny < 0 || !model->f || !model->dfdx)
        return DSE_EINVAL;
    if (model->ny > 0 && (!model->h || !model->dhdx || !config->R))
        return DSE_EINVAL;
    if (!config->P0 || config->panels < 0 || !(config->max_panel >= 0) || !(config->gate >= 0))
        return DSE_EINVAL;
    if (!dse_is_finite(config->max_panel) || !dse_is_finite(config->gate))
        return DSE_EINVAL;
    return dse_is_finite(config->t0) ? DSE_OK : DSE_ENONFINITE;
}

static bool is_diagonal(int n, const dse_real *M)
{
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            if (i != j && M[i * n + j] != 0)
                return false;
    return true;
}

/* R = L L', and Q >= 0, which predict reads itself. */
static enum dse_status prepare_noise(struct dse_ekf *ekf)
{
    const struct dse_ekf_config *config = ekf->config;
    if (ekf->ny > 0) {
        enum dse_status status = dse_sym_check(ekf->ny, config->R);
        if (status == DSE_OK)
            status = dse_cholesky(ekf->ny, config->R, ekf->R_factor);
        if (status != DSE_OK)
            return status;
        ekf->R_diagonal = is_diagonal(ekf->ny, config->R);
    }
    if (!config->Q)
        return DSE_OK;
    const enum dse_status status = dse_sym_check(ekf->nx, config->Q);
    if (status != DSE_OK)
        return status;
    return dse_factored_from(ekf->nx, config->Q, ekf->T, ekf->d, ekf->scratch);
}

static enum dse_status take_memory(struct dse_ekf *ekf, struct dse_arena *arena)
{
    const int nx = ekf->nx, ny = ekf->ny;
    /* Matrices with rows of whole blocks first, so that blocks do not straddle cache lines when the
     * arena begins at one. */
    ekf->T = dse_arena_take(arena, DSE_FACTORED_SIZE(nx));
    ekf->T_next = dse_arena_take(arena, DSE_FACTORED_SIZE(nx));
    ekf->scratch = dse_arena_take(arena, DSE_EKF_SCRATCH(nx, ny));
    ekf->x = dse_arena_take(arena, nx);
    ekf->d = dse_arena_take(arena, nx);
    ekf->x_next = dse_arena_take(arena, nx);
    ekf->d_next = dse_arena_take(arena, nx);
    ekf->R_factor = dse_arena_take(arena, ny * ny);
    ekf->innovation = dse_arena_take(arena, ny);
    ekf->channel = dse_arena_take(arena, ny);
    ekf->ode = NULL;
    if (!ekf->T || !ekf->T_next || !ekf->scratch || !ekf->x || !ekf->d || !ekf->x_next ||
        !ekf->d_next || !ekf->R_factor || !ekf->innovation || !ekf->channel)
        return DSE_ESTORAGE;
    if (ekf->config->model->time == DSE_CONTINUOUS) {
        ekf->ode = dse_arena_take(arena, DSE_EKF_ODE(nx));
        if (!ekf->ode)
            return DSE_ESTORAGE;
    }
    return DSE_OK;
}

enum dse_status dse_ekf_init(struct dse_ekf *ekf, const struct dse_ekf_config *config,
                             struct dse_arena *arena)
{
    enum dse_status status = check_config(config);
    if (status != DSE_OK)
        return status;
    const int nx = config->model->nx, ny = config->model->ny;
    *ekf = (struct dse_ekf){.config = config, .nx = nx, .ny = ny};
    status = take_memory(ekf, arena);
    if (status != DSE_OK)
        return status;

    status = prepare_noise(ekf);
    if (status == DSE_OK)
        status = dse_sym_check(nx, config->P0);
    if (status != DSE_OK)
        return status;
    for (int j = 0; j < ny; j++)
        ekf->channel[j] = DSE_CHANNEL_MISSING;
    for (int i = 0; i < nx; i++)
        ekf->x_next[i] = config->x0 ? config->x0[i] : 0;
    return dse_ekf_set(ekf, config->t0, ekf->x_next, config->P0);
}

enum dse_status dse_ekf_set(struct dse_ekf *ekf, dse_real t, const dse_real *x, const dse_real *P)
{
    if (!dse_is_finite(t) || !dse_all_finite(x, ekf->nx))
        return DSE_ENONFINITE;
    const enum dse_status status =
        dse_factored_from(ekf->nx, P, ekf->T_next, ekf->d_next, ekf->scratch);
    if (status != DSE_OK)
        return status;
    for (int i = 0; i < ekf->nx; i++)
        ekf->x_next[i] = x[i];
    dse_ekf_commit(ekf);
    ekf->time = t;
    ekf->predicted = false;
    ekf->health = DSE_HEALTH_INITIALISING;
    return DSE_OK;
}

void dse_ekf_commit(struct dse_ekf *ekf)
{
    dse_real *x = ekf->x, *T = ekf->T, *d = ekf->d;
    ekf->x = ekf->x_next;
    ekf->T = ekf->T_next;
    ekf->d = ekf->d_next;
    ekf->x_next = x;
    ekf->T_next = T;
    ekf->d_next = d;
}

enum dse_status dse_ekf_fail(struct dse_ekf *ekf, enum dse_status status)
{
    for (int i = 0; i < DSE_FACTORED_SIZE(ekf->nx); i++)
        ekf->T_next[i] = 0; /* a NaN may have got left of the diagonal */
    ekf->health = DSE_HEALTH_DIVERGED;
    ekf->counts.failed++;
    return status;
}

const dse_real *dse_ekf_state(const struct dse_ekf *ekf)
{
    return ekf->x;
}

dse_real dse_ekf_time(const struct dse_ekf *ekf)
{
    return ekf->time;
}

void dse_ekf_covariance(const struct dse_ekf *ekf, dse_real *P)
{
    dse_factored_expand(ekf->nx, ekf->T, ekf->d, P);
}

void dse_ekf_variance(const struct dse_ekf *ekf, dse_real *variance)
{
    dse_factored_diagonal(ekf->nx, ekf->T, ekf->d, variance);
}

const dse_real *dse_ekf_innovation(const struct dse_ekf *ekf)
{
    return ekf->innovation;
}

enum dse_channel dse_ekf_channel(const struct dse_ekf *ekf, int j)
{
    return (enum dse_channel)ekf->channel[j];
}

int dse_ekf_used(const struct dse_ekf *ekf)
{
    return ekf->used;
}

dse_real dse_ekf_nis(const struct dse_ekf *ekf)
{
    return ekf->nis;
}

enum dse_health dse_ekf_health(const struct dse_ekf *ekf)
{
    return ekf->health;
}

const struct dse_ekf_counts *dse_ekf_counts(const struct dse_ekf *ekf)
{
    return &ekf->counts;
}
