/* Consensus Kalman filter: what a configuration may say, and the filter's memory. */
#include "consensus_kalman_internal.h"
#include "dse/factored.h"
#include "dse/math.h"

static bool at_least_zero(dse_real value)
{
    return value >= 0 && dse_is_finite(value);
}

static int network_degree(const struct dse_ckf_config *config)
{
    return config->largest_degree > 0 ? config->largest_degree : config->n_neighbours;
}

static bool plant_is_there(const struct dse_ckf_config *config)
{
    const struct dse_model *model = config->model;
    if (model == NULL || model->nx < 1 || model->nu < 0 || model->time != DSE_DISCRETE)
        return false;
    if (model->dfdx == NULL || config->P0 == NULL || config->ny < 0)
        return false;
    return config->ny == 0 || (config->C != NULL && config->R != NULL);
}

static bool network_in_range(const struct dse_ckf_config *config)
{
    if ((unsigned)config->scheme > DSE_CKF_A_LITERAL || config->n_neighbours < 0)
        return false;
    if (!at_least_zero(config->epsilon) || !at_least_zero(config->alpha) ||
        !at_least_zero(config->multiplicity) || config->rounds < 0 || config->restart < 0)
        return false;
    if (!ckf_averages(config->scheme))
        return true;
    if ((unsigned)config->counting > DSE_CKF_IN_ALL)
        return false;
    if (ckf_weighs(config) && (config->self < 0 || config->self >= config->nodes))
        return false;
    return config->nodes > config->n_neighbours && network_degree(config) >= config->n_neighbours;
}

/* ---- steps ---- */

static dse_real default_step(const struct dse_ckf *ckf)
{
    const struct dse_ckf_config *config = ckf->config;
    const int degree = network_degree(config);
    if (ckf_low_pass(config->scheme))
        return dse_consensus_largest_step(DSE_CONSENSUS_LOW_PASS, degree) / dse_max(ckf->alpha, 1);
    if (ckf_averages(config->scheme))
        return DSE_REAL(1.0) / (dse_real)(1 + degree);
    if (config->scheme == DSE_CKF_C_LITERAL)
        return DSE_REAL(0.5);
    const dse_real usual = config->scheme == DSE_CKF_C ? DSE_REAL(0.5) : DSE_REAL(0.1);
    return dse_min(usual, dse_consensus_largest_step(DSE_CONSENSUS_AVERAGE, ckf->n_neighbours));
}

static enum dse_status set_steps(struct dse_ckf *ckf)
{
    const struct dse_ckf_config *config = ckf->config;
    const dse_real slack = 1 + 4 * DSE_REAL_EPSILON; /* for the bound itself, rounded otherwise */
    ckf->alpha = config->alpha > 0 ? config->alpha : 1;
    ckf->epsilon = config->epsilon > 0 ? config->epsilon : default_step(ckf);
    if (config->scheme == DSE_CKF_C_LITERAL || config->scheme == DSE_CKF_ALONE)
        return DSE_OK; /* its bound depends on P */
    const int degree = ckf_averages(config->scheme) ? network_degree(config) : ckf->n_neighbours;
    const dse_real high = dse_consensus_largest_step(DSE_CONSENSUS_HIGH_PASS, degree);
    const dse_real low = dse_consensus_largest_step(DSE_CONSENSUS_LOW_PASS, degree);
    if (!(ckf->epsilon <= high * slack))
        return DSE_EINVAL;
    if (!ckf_low_pass(config->scheme))
        return DSE_OK;
    return ckf->epsilon * dse_max(ckf->alpha, 1) <= low * slack ? DSE_OK : DSE_EINVAL;
}

/* A node whose step is within its bound gives no neighbour more than eps in a round, itself
 * 1 - eps n_neighbours, and rounds that follow do not raise the largest weight of a row. */
static dse_real multiplicity_of(const struct dse_ckf *ckf)
{
    const struct dse_ckf_config *config = ckf->config;
    if (config->scheme != DSE_CKF_A || config->counting == DSE_CKF_IN_ALL)
        return (dse_real)config->nodes;
    if (config->multiplicity > 0)
        return config->multiplicity;
    const dse_real eps = config->n_neighbours > 0 ? ckf->epsilon : 0;
    return 1 / dse_max(1 - eps * (dse_real)config->n_neighbours, eps);
}

static int rounds_of(const struct dse_ckf_config *config)
{
    if (ckf_averages(config->scheme))
        return config->rounds > 0 ? config->rounds : 5;
    if (config->scheme == DSE_CKF_ALONE)
        return 0;
    return config->scheme == DSE_CKF_B ? 2 : 1;
}

/* ---- memory ---- */

static int widest(const struct dse_ckf *ckf)
{
    int width = 0;
    for (int r = 0; r < ckf->rounds; r++)
        width = DSE_CKF_LARGER(width, dse_ckf_message_size(ckf, r));
    return width;
}

static bool take(dse_real **piece, struct dse_arena *arena, int count)
{
    *piece = dse_arena_take(arena, count);
    return *piece != NULL;
}

static bool take_memory(struct dse_ckf *ckf, struct dse_arena *arena)
{
    const int n = ckf->nx, packed = ckf->size - n;
    const bool filters = ckf_averages(ckf->config->scheme);
    const bool band_pass = ckf_low_pass(ckf->config->scheme);
    return take(&ckf->x, arena, n) && take(&ckf->P, arena, n * n) && take(&ckf->x_next, arena, n) &&
           take(&ckf->P_next, arena, n * n) && take(&ckf->own, arena, ckf->carried) &&
           take(&ckf->fused, arena, ckf->size) &&
           take(&ckf->v, arena, filters ? ckf->carried : 0) &&
           take(&ckf->b, arena, band_pass ? packed : 0) &&
           take(&ckf->said, arena, ckf->n_neighbours * ckf->width) &&
           take(&ckf->heard, arena, ckf->n_neighbours) && take(&ckf->innovation, arena, ckf->ny) &&
           take(&ckf->scratch, arena, DSE_CKF_SCRATCH(n, ckf->ny));
}

/* ---- values ---- */

/* Symmetric and positive semidefinite; rows and weights of it are left in the scratch. */
static enum dse_status check_semidefinite(struct dse_ckf *ckf, const dse_real *S)
{
    const int n = ckf->nx;
    const enum dse_status status = dse_sym_check(n, S);
    return status != DSE_OK ? status
                            : dse_semidefinite_rows(n, n, S, ckf->scratch, ckf->scratch + n * n);
}

static enum dse_status check_sensors(const struct dse_ckf *ckf)
{
    const struct dse_ckf_config *config = ckf->config;
    if (ckf->ny == 0)
        return DSE_OK;
    if (!dse_all_finite(config->C, ckf->ny * ckf->nx))
        return DSE_ENONFINITE;
    const enum dse_status status = dse_sym_check(ckf->ny, config->R);
    /* the scratch is that of an update, which has room for it */
    return status != DSE_OK ? status : dse_cholesky(ckf->ny, config->R, ckf->scratch);
}

static enum dse_status start(struct dse_ckf *ckf)
{
    const struct dse_ckf_config *config = ckf->config;
    enum dse_status status = check_sensors(ckf);
    if (status == DSE_OK && config->Q != NULL)
        status = check_semidefinite(ckf, config->Q);
    if (status != DSE_OK)
        return status;
    return dse_ckf_set(ckf, config->x0 != NULL ? config->x0 : ckf->x, config->P0);
}

enum dse_status dse_ckf_init(struct dse_ckf *ckf, const struct dse_ckf_config *config,
                             struct dse_arena *arena)
{
    if (!plant_is_there(config) || !network_in_range(config))
        return DSE_EINVAL;
    const int n = config->model->nx;
    *ckf = (struct dse_ckf){
        .config = config,
        .nx = n,
        .ny = config->ny,
        .n_neighbours = config->n_neighbours,
        .rounds = rounds_of(config),
        .size = n + DSE_SYM_PACKED(n),
        .carried = n + DSE_SYM_PACKED(n) + (ckf_weighs(config) ? config->nodes : 0),
        .health = DSE_HEALTH_INITIALISING,
    };
    ckf->width = widest(ckf);
    const enum dse_status status = set_steps(ckf);
    if (status != DSE_OK)
        return status;
    ckf->multiplicity = multiplicity_of(ckf);
    return take_memory(ckf, arena) ? start(ckf) : DSE_ESTORAGE;
}

enum dse_status dse_ckf_set(struct dse_ckf *ckf, const dse_real *x, const dse_real *P)
{
    if (!dse_all_finite(x, ckf->nx))
        return DSE_ENONFINITE;
    const enum dse_status status = P != NULL ? check_semidefinite(ckf, P) : DSE_OK;
    if (status != DSE_OK)
        return status;
    ckf_copy(ckf->nx, x, ckf->x);
    if (P != NULL) {
        ckf_copy(ckf->nx * ckf->nx, P, ckf->P);
        dse_sym_enforce(ckf->nx, ckf->P);
    }
    for (int k = 0; k < ckf->size; k++)
        ckf->fused[k] = 0;
    ckf_restart(ckf);
    ckf->open = false;
    ckf->corrected = false;
    return DSE_OK;
}
