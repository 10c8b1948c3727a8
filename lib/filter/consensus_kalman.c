/* Consensus Kalman filter: a sample's passage through a node, and what can be read of it. */
#include "dse/consensus_kalman.h"

#include "consensus_kalman_internal.h"
#include "dse/math.h"

/* x_next, P_next become x, P when they are finite. */
static enum dse_status accept(struct dse_ckf *ckf)
{
    const int n = ckf->nx;
    if (!dse_all_finite(ckf->x_next, n) || !dse_all_finite(ckf->P_next, n * n))
        return DSE_ENONFINITE;
    dse_real *x = ckf->x_next, *P = ckf->P_next;
    ckf->x_next = ckf->x;
    ckf->P_next = ckf->P;
    ckf->x = x;
    ckf->P = P;
    return DSE_OK;
}

static enum dse_status failed(struct dse_ckf *ckf, enum dse_status status)
{
    ckf->counts.failed++;
    ckf->health = DSE_HEALTH_DIVERGED;
    return status;
}

static enum dse_health health_now(const struct dse_ckf *ckf)
{
    const bool works_with_others = ckf->rounds > 0 && ckf->n_neighbours > 0;
    if (!ckf->informed)
        return DSE_HEALTH_INITIALISING;
    if (ckf->present == 0)
        return DSE_HEALTH_COASTING;
    if (ckf->refused)
        return DSE_HEALTH_REJECTING;
    return works_with_others && !ckf->any_heard ? DSE_HEALTH_ALONE : DSE_HEALTH_TRACKING;
}

/* ---- correction ---- */

/* P = (N^-1 + Y)^-1, xh = w + P (u - Y w) with information [u; packed Y]. */
static enum dse_status update(struct dse_ckf *ckf, const dse_real *information)
{
    dse_real *Y = ckf->scratch, *rest = Y + ckf->nx * ckf->nx;
    dse_sym_unpack(ckf->nx, information + ckf->nx, Y);
    return dse_information_update(ckf->nx, ckf->x, ckf->P, information, Y, ckf->x_next, ckf->P_next,
                                  rest);
}

/* xh += eps P sum_N (w_j - w), eps / (1 + |P|_F) unless literal; w is still in x. */
static void pull_to_neighbours(struct dse_ckf *ckf)
{
    const int n = ckf->nx;
    const struct dse_consensus_words words = ckf_words(ckf);
    dse_real eps = ckf->epsilon, *sum = ckf->scratch, *pull = sum + n;
    if (ckf->config->scheme == DSE_CKF_C)
        eps /= 1 + dse_norm2(n * n, ckf->P_next);
    dse_consensus_differences(&words, ckf->size, n, ckf->x, sum);
    dse_mat_vec(n, n, ckf->P_next, sum, pull);
    dse_axpy(n, eps, pull, ckf->x_next);
}

enum dse_status ckf_correct(struct dse_ckf *ckf)
{
    ckf_fuse(ckf);
    enum dse_status status =
        dse_all_finite(ckf->fused, ckf->size) ? update(ckf, ckf->fused) : DSE_ENONFINITE;
    if (status != DSE_OK && ckf->rounds > 0) {
        ckf_copy(ckf->size, ckf->own, ckf->fused);
        ckf->counts.fallback++;
        ckf->refused = true;
        status = update(ckf, ckf->own);
    }
    if (status != DSE_OK)
        return status;
    if (ckf_one_step(ckf->config->scheme))
        pull_to_neighbours(ckf);
    ckf->informed = ckf->informed || dse_norm_max(ckf->size, ckf->fused) > 0;
    return accept(ckf);
}

/* xh = psi + eps sum_N (psi_j - psi). */
static enum dse_status mix(struct dse_ckf *ckf)
{
    const struct dse_consensus_words words = ckf_words(ckf);
    ckf_copy(ckf->nx, ckf->x, ckf->x_next);
    ckf_copy(ckf->nx * ckf->nx, ckf->P, ckf->P_next);
    dse_consensus_average(&words, 0, ckf->nx, ckf->epsilon, ckf->x_next);
    return accept(ckf);
}

/* ---- a sample ---- */

static void close_sample(struct dse_ckf *ckf)
{
    ckf->open = false;
    ckf->corrected = true;
}

static void forget_round(struct dse_ckf *ckf)
{
    for (int j = 0; j < ckf->n_neighbours; j++)
        ckf->heard[j] = 0;
}

/* u_i, Y_i, the innovation, and what is counted of the channels. */
static enum dse_status take_channels(struct dse_ckf *ckf, const struct dse_measurement *measurement)
{
    const struct dse_ckf_config *config = ckf->config;
    const int n = ckf->nx, m = ckf->ny;
    dse_real *Y = ckf->scratch, *u = Y + n * n, *rest = u + n;
    const enum dse_status status =
        dse_information_of(n, m, config->C, config->R, measurement, u, Y, &ckf->present, rest);
    if (status != DSE_OK)
        return status;
    ckf_copy(n, u, ckf->own);
    dse_sym_pack(n, Y, ckf->own + n);
    if (ckf_weighs(config))
        ckf->own[ckf->size + config->self] = ckf->present > 0;
    for (int l = 0; l < m; l++) {
        const bool flagged = measurement->valid == NULL || measurement->valid[l];
        const bool has = dse_measurement_has(measurement, l);
        ckf->innovation[l] = has ? measurement->y[l] - dse_dot(n, config->C + l * n, ckf->x) : 0;
        ckf->counts.missing += !flagged;
        ckf->counts.nonfinite += flagged && !has;
    }
    ckf->counts.used += ckf->present;
    return DSE_OK;
}

/* Whether the filters of type I start from zero in sample k. */
static bool starts_anew(const struct dse_ckf_config *config, long k)
{
    if (config->scheme == DSE_CKF_A && config->counting != DSE_CKF_IN_ALL)
        return true;
    return config->restart > 0 && k % config->restart == 0;
}

enum dse_status dse_ckf_begin(struct dse_ckf *ckf, long k, dse_real t, const dse_real *input,
                              const struct dse_measurement *measurement)
{
    if (!dse_is_finite(t))
        return DSE_EINVAL;
    ckf->t = t;
    ckf->input = input;
    ckf->round = 0;
    ckf->any_heard = false;
    ckf->refused = false;
    forget_round(ckf);
    if (starts_anew(ckf->config, k))
        ckf_restart(ckf);
    enum dse_status status = take_channels(ckf, measurement);
    if (status == DSE_OK && ckf->rounds > 0) {
        ckf->open = true;
        ckf->corrected = false;
        return DSE_OK;
    }
    if (status == DSE_OK)
        status = ckf_correct(ckf);
    close_sample(ckf);
    if (status != DSE_OK)
        return failed(ckf, status);
    ckf->health = health_now(ckf);
    return DSE_OK;
}

int dse_ckf_rounds(const struct dse_ckf *ckf)
{
    return ckf->rounds;
}

/* What the round is for; type I corrects after the last one, B after the first one. */
static enum dse_status take_round(struct dse_ckf *ckf)
{
    const enum dse_ckf_scheme scheme = ckf->config->scheme;
    if (scheme == DSE_CKF_B && ckf->round == 1)
        return mix(ckf);
    if (ckf_averages(scheme)) {
        ckf_filter_round(ckf);
        if (ckf->round + 1 < ckf->rounds)
            return DSE_OK;
    }
    return ckf_correct(ckf);
}

enum dse_status dse_ckf_end_round(struct dse_ckf *ckf)
{
    if (!ckf->open)
        return DSE_EINVAL;
    for (int j = 0; j < ckf->n_neighbours; j++)
        ckf->counts.silent += ckf->heard[j] == 0;
    const enum dse_status status = take_round(ckf);
    forget_round(ckf);
    if (status != DSE_OK) {
        close_sample(ckf);
        return failed(ckf, status);
    }
    ckf->round++;
    if (ckf->round == ckf->rounds) {
        close_sample(ckf);
        ckf->health = health_now(ckf);
    }
    return DSE_OK;
}

/* N = A P A' + Q, w = f(xh) or A xh. */
static enum dse_status predict(struct dse_ckf *ckf)
{
    const struct dse_model *model = ckf->config->model;
    const int n = ckf->nx;
    dse_real *A = ckf->scratch, *rest = A + n * n;
    enum dse_status status = model->dfdx(model, ckf->t, ckf->x, ckf->input, A);
    if (status != DSE_OK)
        return status;
    if (model->f == NULL)
        dse_mat_vec(n, n, A, ckf->x, ckf->x_next);
    else
        status = model->f(model, ckf->t, ckf->x, ckf->input, ckf->x_next);
    if (status != DSE_OK)
        return status;
    dse_sym_congruence(n, n, A, ckf->P, NULL, ckf->P_next, rest);
    const bool literal = ckf->config->scheme == DSE_CKF_A_LITERAL; /* Q, where M is nodes P */
    const dse_real share = literal ? DSE_REAL(1.0) / (dse_real)ckf->config->nodes : 1;
    if (ckf->config->Q != NULL)
        dse_axpy(n * n, share, ckf->config->Q, ckf->P_next);
    return accept(ckf);
}

enum dse_status dse_ckf_advance(struct dse_ckf *ckf)
{
    if (!ckf->corrected)
        return DSE_EINVAL;
    ckf->corrected = false;
    const enum dse_status status = predict(ckf);
    if (status != DSE_OK)
        return failed(ckf, status);
    ckf->counts.samples++;
    return DSE_OK;
}

/* ---- reading ---- */

const dse_real *dse_ckf_state(const struct dse_ckf *ckf)
{
    return ckf->x;
}

const dse_real *dse_ckf_covariance(const struct dse_ckf *ckf)
{
    return ckf->P;
}

const dse_real *dse_ckf_innovation(const struct dse_ckf *ckf)
{
    return ckf->innovation;
}

dse_real dse_ckf_multiplicity(const struct dse_ckf *ckf)
{
    return ckf->multiplicity;
}

const dse_real *dse_ckf_information(const struct dse_ckf *ckf)
{
    return ckf->fused;
}

enum dse_health dse_ckf_health(const struct dse_ckf *ckf)
{
    return ckf->health;
}

const struct dse_ckf_counts *dse_ckf_counts(const struct dse_ckf *ckf)
{
    return &ckf->counts;
}
