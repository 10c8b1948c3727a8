/* Adaptive high-gain EKF: what a configuration may say, and the filter's memory. */
#include <stddef.h>

#include "dse/linalg.h"
#include "dse/math.h"
#include "dse/ode.h"
#include "high_gain_ekf_internal.h"

/* Blocks sum to the state, chains to the blocks, and every chain has its output in the model. */
static enum dse_status check_sizes(const struct dse_high_gain_ekf_config *config)
{
    const struct dse_normal_form *form = config->form;
    const struct dse_model *model = config->model;
    int n = 0, outputs = 0;
    for (int j = 0; j < form->p; j++) {
        const int m = form->n_outputs != NULL ? form->n_outputs[j] : 1;
        int sum = 0;
        if (form->n_i[j] < 1 || m < 1 || (m > 1 && form->chains == NULL)) {
            return DSE_EDIM;
        }
        for (int l = 0; l < m; l++) {
            const int chain = form->chains != NULL ? form->chains[outputs + l] : form->n_i[j];
            if (chain < 1) {
                return DSE_EDIM;
            }
            sum += chain;
        }
        if (sum != form->n_i[j]) {
            return DSE_EDIM;
        }
        n += form->n_i[j];
        outputs += m;
    }
    return n == form->n && n == model->nx && model->ny >= outputs && model->nu == form->nu
               ? DSE_OK
               : DSE_EDIM;
}

static enum dse_status check_model(const struct dse_high_gain_ekf_config *config)
{
    const struct dse_model *model = config->model;
    const struct dse_normal_form *form = config->form;
    if (model == NULL || form == NULL || form->n_i == NULL || model->f == NULL ||
        model->h == NULL || model->time != DSE_CONTINUOUS || form->p < 1) {
        return DSE_EINVAL;
    }
    const enum dse_status status = check_sizes(config);
    if (status != DSE_OK) {
        return status;
    }
    if (config->coords == DSE_HIGH_GAIN_PHYSICAL) {
        return model->dfdx != NULL ? DSE_OK : DSE_EINVAL;
    }
    const bool maps = form->encode != NULL && form->decode != NULL && form->field != NULL;
    const bool slopes = config->whole ? form->field_jacobian != NULL && form->push != NULL
                                      : form->jacobian != NULL && form->map_jacobian != NULL;
    return maps && slopes ? DSE_OK : DSE_EINVAL;
}

static enum dse_status check_predictor(const struct dse_high_gain_ekf_config *config)
{
    const struct dse_model *model = config->predictor_model;
    if (model == NULL) {
        return DSE_OK;
    }
    if (model->f == NULL || model->time != DSE_CONTINUOUS ||
        (config->coords == DSE_HIGH_GAIN_NORMAL && config->form->push == NULL)) {
        return DSE_EINVAL;
    }
    return model->nx == config->model->nx && model->nu == config->model->nu ? DSE_OK : DSE_EDIM;
}

static enum dse_status check_adaptation(const struct dse_high_gain_ekf_config *config)
{
    const struct dse_gain_adaptation *a = &config->adaptation;
    if (config->gain == DSE_HIGH_GAIN_ONE) {
        return DSE_OK;
    }
    if (!(a->theta_m > DSE_REAL(0.5)) || !dse_is_finite(a->theta_m)) {
        return DSE_EINVAL;
    }
    if (config->gain == DSE_HIGH_GAIN_MAX) {
        return DSE_OK;
    }
    return a->rise_time > 0 && a->relaxation >= 0 && a->sharpness > 0 &&
                   dse_is_finite(a->rise_time) && dse_is_finite(a->relaxation) &&
                   dse_is_finite(a->sharpness) && dse_is_finite(a->threshold) &&
                   config->horizon >= 1
               ? DSE_OK
               : DSE_EINVAL;
}

static bool known_options(const struct dse_high_gain_ekf_config *config)
{
    return (unsigned)config->coords <= DSE_HIGH_GAIN_PHYSICAL &&
           (unsigned)config->scaling <= DSE_HIGH_GAIN_PLAIN &&
           (unsigned)config->gain <= DSE_HIGH_GAIN_MAX &&
           (unsigned)config->innovation <= DSE_HIGH_GAIN_SUM &&
           (unsigned)config->communication <= DSE_HIGH_GAIN_TRIGGERED &&
           (unsigned)config->predictor <= DSE_HIGH_GAIN_HOLD;
}

static enum dse_status check_communication(const struct dse_high_gain_ekf_config *config)
{
    const enum dse_high_gain_communication kind = config->communication;
    const bool alone = config->whole || config->form->p == 1;
    if (config->comm_every_ticks < 0 || config->max_delay < 0 || (config->whole && config->heard) ||
        (config->max_delay > 0 && kind != DSE_HIGH_GAIN_TICK)) {
        return DSE_EINVAL;
    }
    if (kind == DSE_HIGH_GAIN_STAGES &&
        (config->comm_every_ticks > 1 || config->predictor != DSE_HIGH_GAIN_PREDICT)) {
        return DSE_EINVAL;
    }
    /* a sum needs somebody to say it */
    return kind == DSE_HIGH_GAIN_NONE && !alone && config->innovation == DSE_HIGH_GAIN_SUM
               ? DSE_EINVAL
               : DSE_OK;
}

static enum dse_status check_options(const struct dse_high_gain_ekf_config *config)
{
    const int filters = config->whole ? 1 : config->form->p;
    if (!known_options(config) || config->i < 0 || config->i >= filters || !(config->period > 0) ||
        !dse_is_finite(config->period) || config->horizon < 0 || config->x0 == NULL ||
        config->P0 == NULL || config->Q == NULL ||
        (config->R_block == NULL && (!(config->R > 0) || !dse_is_finite(config->R)))) {
        return DSE_EINVAL;
    }
    const enum dse_status status = check_communication(config);
    return status != DSE_OK ? status : check_predictor(config);
}

static bool is_symmetric(int n, const dse_real *A)
{
    for (int r = 0; r < n; r++) {
        for (int c = 0; c < r; c++) {
            if (dse_abs(A[r * n + c] - A[c * n + r]) > 0) {
                return false;
            }
        }
    }
    return true;
}

/* R (m x m) of the configuration. */
static void make_R(const struct dse_high_gain_ekf *filter, dse_real *R)
{
    const struct dse_high_gain_ekf_config *config = filter->config;
    for (int a = 0; a < filter->m; a++) {
        for (int b = 0; b < filter->m; b++) {
            const int ab = a * filter->m + b;
            R[ab] = config->R_block != NULL ? config->R_block[ab] : (a == b ? config->R : 0);
        }
    }
}

/* The factors that prove the matrices definite go to FP, which is scratch. */
static enum dse_status check_weights(const struct dse_high_gain_ekf *filter)
{
    const struct dse_high_gain_ekf_config *config = filter->config;
    const int n_i = filter->n_i, m = filter->m;
    make_R(filter, filter->W);
    if (!dse_all_finite(config->x0, filter->n) || !dse_all_finite(config->P0, n_i * n_i) ||
        !dse_all_finite(config->Q, n_i * n_i) || !dse_all_finite(filter->W, m * m)) {
        return DSE_ENONFINITE;
    }
    if (!is_symmetric(n_i, config->P0) || !is_symmetric(n_i, config->Q) ||
        !is_symmetric(m, filter->W)) {
        return DSE_EINVAL;
    }
    for (int r = 0; r < n_i; r++) {
        if (config->Q[r * n_i + r] < 0) {
            return DSE_EINVAL;
        }
    }
    const enum dse_status status = dse_cholesky(m, filter->W, filter->FP);
    return status != DSE_OK ? status : dse_cholesky(n_i, config->P0, filter->FP);
}

/* Own block, own outputs and n*, the longest chain of all. */
static void size_filter(struct dse_high_gain_ekf *filter)
{
    const struct dse_high_gain_ekf_config *config = filter->config;
    const struct dse_normal_form *form = config->form;
    int outputs = 0;
    const int *chains = form->chains != NULL ? form->chains : form->n_i;
    filter->n = form->n;
    filter->p = config->whole ? 1 : form->p;
    filter->n_i = config->whole ? form->n : form->n_i[config->i];
    filter->offset = config->whole ? 0 : dse_high_gain_offset(form, config->i);
    filter->chains = chains;
    for (int j = 0; j < form->p; j++) {
        const int m = form->n_outputs != NULL ? form->n_outputs[j] : 1;
        for (int l = 0; l < m; l++) {
            filter->n_max =
                chains[outputs + l] > filter->n_max ? chains[outputs + l] : filter->n_max;
        }
        if (!config->whole && j == config->i) {
            filter->m = m;
            filter->first_output = outputs;
            filter->chains = chains + outputs;
        }
        outputs += m;
    }
    filter->m = config->whole ? outputs : filter->m;
}

static enum dse_status take_past(struct dse_high_gain_ekf *filter, struct dse_arena *arena)
{
    const struct dse_high_gain_ekf_config *config = filter->config;
    const int D = config->max_delay, span = D * dse_high_gain_every(config) + 1;
    const enum dse_status status =
        dse_mailbox_init(&filter->mailbox, filter->p, config->form->n_i, D, arena);
    if (status == DSE_OK && D > 0) {
        filter->pictures = dse_arena_take(arena, (D + 1) * filter->n);
        filter->inputs = dse_arena_take(arena, span * config->model->nu);
        return filter->inputs != NULL ? DSE_OK : DSE_ESTORAGE;
    }
    return status;
}

static enum dse_status take_memory(struct dse_high_gain_ekf *filter, struct dse_arena *arena)
{
    const struct dse_high_gain_ekf_config *config = filter->config;
    const int n = filter->n, n_i = filter->n_i, nu = config->model->nu;
    dse_real **const states[] = {&filter->x,  &filter->base,  &filter->xs,  &filter->kx,
                                 &filter->sx, &filter->inbox, &filter->chi, &filter->z};
    dse_real **const blocks[] = {&filter->P,
                                 &filter->Ps,
                                 &filter->kP,
                                 &filter->sP,
                                 &filter->Q_th,
                                 &filter->F,
                                 &filter->FP,
                                 &filter->M,
                                 &filter->L,
                                 &filter->W,
                                 &filter->R_th,
                                 &filter->CP,
                                 &filter->estimate_covariance};
    dse_real **const own[] = {&filter->estimate, &filter->K, &filter->D,
                              &filter->e,        &filter->y, &filter->output_error};
    dse_real **const inputs[] = {&filter->u, &filter->du, &filter->du_past, &filter->u_stage,
                                 &filter->u_next};
    int **const indices[] = {&filter->pivots, &filter->chosen, &filter->starts};
    int **const counts[] = {&filter->received, &filter->heard};
    for (int k = 0; k < (int)(sizeof states / sizeof states[0]); k++) {
        *states[k] = dse_arena_take(arena, n);
    }
    for (int k = 0; k < (int)(sizeof blocks / sizeof blocks[0]); k++) {
        *blocks[k] = dse_arena_take(arena, n_i * n_i);
    }
    for (int k = 0; k < (int)(sizeof own / sizeof own[0]); k++) {
        *own[k] = dse_arena_take(arena, n_i);
    }
    for (int k = 0; k < (int)(sizeof inputs / sizeof inputs[0]); k++) {
        *inputs[k] = dse_arena_take(arena, nu);
    }
    for (int k = 0; k < (int)(sizeof indices / sizeof indices[0]); k++) {
        *indices[k] = (int *)(void *)dse_arena_take(arena, DSE_ARENA_INTS(n_i));
    }
    for (int k = 0; k < (int)(sizeof counts / sizeof counts[0]); k++) {
        *counts[k] = (int *)(void *)dse_arena_take(arena, DSE_ARENA_INTS(filter->p));
    }
    filter->w = dse_arena_take(arena, 2 * n);
    filter->rk = dse_arena_take(arena, DSE_RK4_SCRATCH(n * DSE_HIGH_GAIN_EKF_LANES));
    filter->J = dse_arena_take(arena, filter->p);
    filter->y_all = dse_arena_take(arena, config->model->ny);
    filter->dfdx = dse_arena_take(arena, n * n);
    filter->ring = dse_arena_take(arena, (config->horizon + 1) * (n + 1));
    return filter->ring != NULL ? take_past(filter, arena) : DSE_ESTORAGE;
}

/* All of the memory or none. */
static enum dse_status reserve(struct dse_high_gain_ekf *filter, struct dse_arena *arena)
{
    const struct dse_high_gain_ekf_config *config = filter->config;
    const int nu = config->model->nu, D = config->max_delay, n = filter->n, p = filter->p;
    int needed =
        DSE_HIGH_GAIN_EKF_STORAGE(n, nu, config->model->ny, p, filter->n_i, config->horizon);
    if (D > 0) {
        needed += DSE_HIGH_GAIN_EKF_DELAY_STORAGE(n, nu, p, D, dse_high_gain_every(config));
    }
    if (arena == NULL || arena->capacity - arena->used < needed) {
        return DSE_ESTORAGE;
    }
    enum dse_status status = take_memory(filter, arena);
    /* a trigger with nothing set fires always, which also suits those who never ask it */
    status = status != DSE_OK
                 ? status
                 : dse_trigger_init(&filter->trigger, &config->trigger, filter->n_i, arena);
    return status;
}

static void start_values(struct dse_high_gain_ekf *filter)
{
    const struct dse_high_gain_ekf_config *config = filter->config;
    for (int l = 0, start = 0; l < filter->m; l++) {
        filter->starts[l] = start;
        start += filter->chains[l];
    }
    for (int k = 0; k < filter->n; k++) {
        filter->x[k] = config->x0[k];
    }
    for (int k = 0; k < filter->n_i * filter->n_i; k++) {
        filter->P[k] = config->P0[k];
    }
    for (int k = 0; k < filter->n_i; k++) {
        filter->estimate[k] = config->x0[filter->offset + k];
    }
    filter->theta =
        config->gain == DSE_HIGH_GAIN_MAX ? 2 * config->adaptation.theta_m : DSE_REAL(1);
    filter->theta_tick = filter->theta;
}

enum dse_status dse_high_gain_ekf_init(struct dse_high_gain_ekf *filter,
                                       const struct dse_high_gain_ekf_config *config,
                                       struct dse_arena *arena)
{
    if (filter == NULL || config == NULL) {
        return DSE_EINVAL;
    }
    enum dse_status status = check_model(config);
    status = status != DSE_OK ? status : check_options(config);
    status = status != DSE_OK ? status : check_adaptation(config);
    if (status != DSE_OK) {
        return status;
    }
    *filter = (struct dse_high_gain_ekf){
        .config = config, .health = DSE_HEALTH_INITIALISING, .last_sample = -1};
    size_filter(filter);
    status = reserve(filter, arena);
    status = status != DSE_OK ? status : check_weights(filter);
    if (status != DSE_OK) {
        return status;
    }
    start_values(filter);
    return DSE_OK;
}
