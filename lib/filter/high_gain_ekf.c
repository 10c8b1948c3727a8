/* Distributed adaptive high-gain EKF: set-up, the course of a tick, and what is read from outside.
 * The numerical step is in high_gain_ekf_step.c, the innovation in high_gain_ekf_innovation.c. */
#include "dse/high_gain_ekf.h"

#include <stddef.h>

#include "dse/linalg.h"
#include "dse/math.h"
#include "dse/ode.h"
#include "high_gain_ekf_internal.h"

/* ---- set-up ---- */

static enum dse_status check_model(const struct dse_high_gain_ekf_config *config)
{
    const struct dse_model *model = config->model;
    const struct dse_normal_form *form = config->form;
    if (model == NULL || form == NULL || form->n_i == NULL || model->f == NULL ||
        model->h == NULL || model->time != DSE_CONTINUOUS || form->p < 1) {
        return DSE_EINVAL;
    }
    int n = 0;
    for (int j = 0; j < form->p; j++) {
        if (form->n_i[j] < 1) {
            return DSE_EDIM;
        }
        n += form->n_i[j];
    }
    if (n != form->n || form->n != model->nx || model->ny < form->p || model->nu != form->nu) {
        return DSE_EDIM;
    }
    if (config->coords == DSE_HIGH_GAIN_PHYSICAL) {
        return model->dfdx != NULL ? DSE_OK : DSE_EINVAL;
    }
    return form->encode != NULL && form->decode != NULL && form->field != NULL &&
                   form->jacobian != NULL && form->map_jacobian != NULL
               ? DSE_OK
               : DSE_EINVAL;
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
           (unsigned)config->communication <= DSE_HIGH_GAIN_NONE &&
           (unsigned)config->predictor <= DSE_HIGH_GAIN_HOLD;
}

static enum dse_status check_options(const struct dse_high_gain_ekf_config *config)
{
    const struct dse_normal_form *form = config->form;
    if (!known_options(config) || config->i < 0 || config->i >= form->p || !(config->period > 0) ||
        !dse_is_finite(config->period) || !(config->R > 0) || !dse_is_finite(config->R) ||
        config->horizon < 0 || config->comm_every_ticks < 0 || config->x0 == NULL ||
        config->P0 == NULL || config->Q == NULL) {
        return DSE_EINVAL;
    }
    if (config->communication == DSE_HIGH_GAIN_STAGES &&
        (config->comm_every_ticks > 1 || config->predictor != DSE_HIGH_GAIN_PREDICT)) {
        return DSE_EINVAL;
    }
    /* a sum needs somebody to say it */
    if (config->communication == DSE_HIGH_GAIN_NONE && form->p > 1 &&
        config->innovation == DSE_HIGH_GAIN_SUM) {
        return DSE_EINVAL;
    }
    return DSE_OK;
}

/* The matrices need n_i x n_i of scratch: filter->FP. */
static enum dse_status check_weights(const struct dse_high_gain_ekf *filter)
{
    const struct dse_high_gain_ekf_config *config = filter->config;
    const int n_P = filter->n_i * filter->n_i;
    if (!dse_all_finite(config->x0, filter->n) || !dse_all_finite(config->P0, n_P) ||
        !dse_all_finite(config->Q, n_P)) {
        return DSE_ENONFINITE;
    }
    for (int r = 0; r < filter->n_i; r++) {
        for (int c = 0; c < r; c++) {
            const int rc = r * filter->n_i + c, cr = c * filter->n_i + r;
            if (dse_abs(config->P0[rc] - config->P0[cr]) > 0 ||
                dse_abs(config->Q[rc] - config->Q[cr]) > 0) {
                return DSE_EINVAL;
            }
        }
        if (config->Q[r * filter->n_i + r] < 0) {
            return DSE_EINVAL;
        }
    }
    return dse_cholesky(filter->n_i, config->P0, filter->FP);
}

static int block_offset(const struct dse_normal_form *form, int j)
{
    int offset = 0;
    for (int l = 0; l < j; l++) {
        offset += form->n_i[l];
    }
    return offset;
}

static enum dse_status take_memory(struct dse_high_gain_ekf *filter, struct dse_arena *arena)
{
    const struct dse_high_gain_ekf_config *config = filter->config;
    const int n = filter->n, p = filter->p, n_i = filter->n_i, nu = config->model->nu;
    const int needed = DSE_HIGH_GAIN_EKF_STORAGE(n, nu, config->model->ny, p, n_i, config->horizon);
    if (arena == NULL || arena->capacity - arena->used < needed) {
        return DSE_ESTORAGE;
    }
    dse_real **const states[] = {&filter->x,  &filter->base,  &filter->xs,  &filter->kx,
                                 &filter->sx, &filter->inbox, &filter->chi, &filter->z};
    dse_real **const blocks[] = {&filter->P,  &filter->Ps,   &filter->kP,
                                 &filter->sP, &filter->Q_th, &filter->F,
                                 &filter->FP, &filter->M,    &filter->estimate_covariance};
    dse_real **const inputs[] = {&filter->u, &filter->du, &filter->u_stage, &filter->u_next};
    for (int k = 0; k < (int)(sizeof states / sizeof states[0]); k++) {
        *states[k] = dse_arena_take(arena, n);
    }
    for (int k = 0; k < (int)(sizeof blocks / sizeof blocks[0]); k++) {
        *blocks[k] = dse_arena_take(arena, n_i * n_i);
    }
    for (int k = 0; k < (int)(sizeof inputs / sizeof inputs[0]); k++) {
        *inputs[k] = dse_arena_take(arena, nu);
    }
    filter->rk = dse_arena_take(arena, DSE_RK4_SCRATCH(n));
    filter->estimate = dse_arena_take(arena, n_i);
    filter->K = dse_arena_take(arena, n_i);
    filter->J = dse_arena_take(arena, p);
    filter->y_all = dse_arena_take(arena, config->model->ny);
    filter->dfdx = dse_arena_take(arena, n * n);
    filter->received = (int *)(void *)dse_arena_take(arena, DSE_ARENA_INTS(p));
    filter->pivots = (int *)(void *)dse_arena_take(arena, DSE_ARENA_INTS(n_i));
    filter->ring = dse_arena_take(arena, (config->horizon + 1) * (n + 1));
    return filter->ring != NULL ? DSE_OK : DSE_ESTORAGE;
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
    const struct dse_normal_form *form = config->form;
    *filter = (struct dse_high_gain_ekf){.config = config,
                                         .n = form->n,
                                         .p = form->p,
                                         .n_i = form->n_i[config->i],
                                         .offset = block_offset(form, config->i),
                                         .health = DSE_HEALTH_INITIALISING};
    for (int j = 0; j < form->p; j++) {
        filter->n_max = form->n_i[j] > filter->n_max ? form->n_i[j] : filter->n_max;
    }
    status = take_memory(filter, arena);
    status = status != DSE_OK ? status : check_weights(filter);
    if (status != DSE_OK) {
        return status;
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
    return DSE_OK;
}

/* ---- the course of a tick ---- */

/* Gives the tick up. Everything committed is as it was. */
static enum dse_status fail(struct dse_high_gain_ekf *filter, enum dse_status status)
{
    filter->open = false;
    filter->theta_tick = filter->theta;
    filter->health = DSE_HEALTH_DIVERGED;
    filter->counters.failed_ticks++;
    return status;
}

/* u at t_k and its rates, where inputs have one. */
static enum dse_status take_inputs(struct dse_high_gain_ekf *filter, const dse_real *u)
{
    const struct dse_normal_form *form = filter->config->form;
    if (form->nu > 0 && u == NULL) {
        return DSE_EINVAL;
    }
    if (form->nu > 0 && !dse_all_finite(u, form->nu)) {
        return DSE_ENONFINITE;
    }
    filter->moving = false;
    for (int k = 0; k < form->nu; k++) {
        const int rate = form->rates != NULL ? form->rates[k] : -1;
        filter->u[k] = u[k];
        filter->du[k] = rate >= 0 ? u[rate] : 0;
        filter->moving = filter->moving || dse_abs(filter->du[k]) > 0;
    }
    return DSE_OK;
}

static bool inputs_as_expected(const struct dse_high_gain_ekf *filter)
{
    for (int k = 0; k < filter->config->form->nu; k++) {
        if (dse_abs(filter->u[k] - filter->u_next[k]) > 0) {
            return false;
        }
    }
    return true;
}

/* base = the picture at t_k. In normal coordinates the map may depend on u: where u is not what the
 * last tick ended with, the same physical state gets new coordinates (4.1). */
static enum dse_status open_picture(struct dse_high_gain_ekf *filter)
{
    const struct dse_normal_form *form = filter->config->form;
    const bool normal = filter->config->coords == DSE_HIGH_GAIN_NORMAL;
    const dse_real *physical = filter->x;

    if (!normal || (filter->started && inputs_as_expected(filter))) {
        for (int k = 0; k < filter->n; k++) {
            filter->base[k] = filter->x[k];
        }
        return DSE_OK;
    }
    if (filter->started) {
        const enum dse_status status =
            form->decode(form, filter->t, filter->x, filter->u_next, filter->chi);
        if (status != DSE_OK) {
            return status;
        }
        physical = filter->chi;
    }
    return form->encode(form, filter->t, physical, filter->u, filter->base);
}

/* P_chi = M^-1 P M^-T by two solves: X = M^-1 P, P_chi = M^-1 X'. */
static enum dse_status physical_covariance(struct dse_high_gain_ekf *filter, const dse_real *chi)
{
    const struct dse_normal_form *form = filter->config->form;
    const int n_i = filter->n_i;
    dse_real *X = filter->FP;

    for (int k = 0; k < n_i * n_i; k++) {
        X[k] = filter->P[k];
    }
    if (filter->config->coords != DSE_HIGH_GAIN_PHYSICAL) {
        enum dse_status status =
            form->map_jacobian(form, filter->config->i, filter->t, chi, filter->u, filter->M);
        status = status != DSE_OK ? status : dse_lu(n_i, filter->M, filter->pivots);
        if (status != DSE_OK) {
            return status;
        }
        dse_lu_solve(n_i, filter->M, filter->pivots, n_i, X);
        dse_mat_transpose(n_i, n_i, X, filter->F);
        dse_lu_solve(n_i, filter->M, filter->pivots, n_i, filter->F);
        dse_sym_enforce(n_i, filter->F);
        X = filter->F;
    }
    for (int k = 0; k < n_i * n_i; k++) {
        filter->estimate_covariance[k] = X[k];
    }
    return DSE_OK;
}

/* Estimate and covariance of t_k from the picture in base. */
static enum dse_status report(struct dse_high_gain_ekf *filter)
{
    enum dse_status status =
        dse_high_gain_decode(filter, filter->t, filter->base, filter->u, filter->chi);
    status = status != DSE_OK ? status : physical_covariance(filter, filter->chi);
    if (status != DSE_OK) {
        return status;
    }
    for (int k = 0; k < filter->n_i; k++) {
        filter->estimate[k] = filter->chi[filter->offset + k];
    }
    return DSE_OK;
}

static void plan_rounds(struct dse_high_gain_ekf *filter)
{
    const struct dse_high_gain_ekf_config *config = filter->config;
    const int every = config->comm_every_ticks > 0 ? config->comm_every_ticks : 1;
    const bool alone = filter->p == 1 || config->communication == DSE_HIGH_GAIN_NONE;

    filter->state_due = !alone && filter->sample % every == 0;
    filter->round = 0;
    if (alone) {
        filter->rounds = 0;
    } else if (config->communication == DSE_HIGH_GAIN_STAGES) {
        filter->rounds = 4;
    } else {
        filter->rounds = filter->state_due || config->innovation == DSE_HIGH_GAIN_SUM ? 1 : 0;
    }
}

static void clear_inbox(struct dse_high_gain_ekf *filter)
{
    for (int j = 0; j < filter->p; j++) {
        filter->received[j] = 0;
    }
}

enum dse_status dse_high_gain_ekf_begin(struct dse_high_gain_ekf *filter, int64_t k, dse_real t,
                                        const dse_real *u,
                                        const struct dse_measurement *measurement)
{
    filter->open = false;
    if (k < 0) {
        return fail(filter, DSE_EINVAL);
    }
    if (!dse_is_finite(t)) {
        return fail(filter, DSE_ENONFINITE);
    }
    filter->sample = k;
    filter->t = t;
    filter->has_y = measurement != NULL && dse_measurement_has(measurement, 0);
    filter->y = filter->has_y ? measurement->y[0] : 0;

    enum dse_status status = take_inputs(filter, u);
    status = status != DSE_OK ? status : open_picture(filter);
    status = status != DSE_OK ? status : report(filter);
    status = status != DSE_OK ? status : dse_high_gain_innovation(filter);
    if (status != DSE_OK) {
        return fail(filter, status);
    }
    filter->counters.missing_measurements += filter->has_y ? 0 : 1;
    plan_rounds(filter);
    clear_inbox(filter);
    filter->open = true;
    return DSE_OK;
}

int dse_high_gain_ekf_rounds(const struct dse_high_gain_ekf *filter)
{
    return filter->open ? filter->rounds : 0;
}

int dse_high_gain_ekf_message(const struct dse_high_gain_ekf *filter, int round, dse_real *out)
{
    if (!filter->open || round != filter->round || round >= filter->rounds) {
        return 0;
    }
    const dse_real *state = (round == 0 ? filter->base : filter->xs) + filter->offset;
    int count = 0;
    if (round == 0) {
        out[count++] = filter->J_own;
    }
    if (round > 0 || filter->state_due) {
        for (int k = 0; k < filter->n_i; k++) {
            out[count++] = state[k];
        }
    }
    return count;
}

static enum dse_status refuse(struct dse_high_gain_ekf *filter, enum dse_status status)
{
    filter->counters.refused++;
    return status;
}

enum dse_status dse_high_gain_ekf_receive(struct dse_high_gain_ekf *filter, int round, int j,
                                          const dse_real *message, int count)
{
    if (!filter->open || round != filter->round || round >= filter->rounds || j < 0 ||
        j >= filter->p || j == filter->config->i || message == NULL) {
        return refuse(filter, DSE_EINVAL);
    }
    const int n_j = filter->config->form->n_i[j];
    const int expected = round > 0 ? n_j : (filter->state_due ? 1 + n_j : 1);
    if (count != expected) {
        return refuse(filter, DSE_EFORMAT);
    }
    if (!dse_all_finite(message, count)) {
        return refuse(filter, DSE_ENONFINITE);
    }
    if (filter->received[j] > 0) {
        filter->counters.duplicates++;
        return DSE_OK;
    }
    filter->received[j] = count;
    const dse_real *state = message;
    if (round == 0) {
        filter->J[j] = message[0];
        state++;
        count--;
    }
    dse_real *block = filter->inbox + block_offset(filter->config->form, j);
    for (int k = 0; k < count; k++) {
        block[k] = state[k];
    }
    return DSE_OK;
}

/* Received blocks into the picture; the others stay as the model predicts them. */
static void merge_states(struct dse_high_gain_ekf *filter, dse_real *picture)
{
    const struct dse_normal_form *form = filter->config->form;
    int offset = 0;
    for (int j = 0; j < filter->p; j++) {
        if (j != filter->config->i) {
            if (filter->received[j] == 0) {
                filter->counters.missing_states++;
            } else {
                for (int k = offset; k < offset + form->n_i[j]; k++) {
                    picture[k] = filter->inbox[k];
                }
            }
        }
        offset += form->n_i[j];
    }
}

/* J that drives theta: J_i or the sum in the order of the subsystems, which gives all filters the
 * same bits (2.10, 3.14). */
static dse_real driving_innovation(struct dse_high_gain_ekf *filter)
{
    filter->J[filter->config->i] = filter->J_own;
    if (filter->config->innovation == DSE_HIGH_GAIN_OWN) {
        return filter->J_own;
    }
    dse_real sum = 0;
    for (int j = 0; j < filter->p; j++) {
        if (j != filter->config->i && filter->received[j] == 0) {
            filter->counters.missing_innovations++;
        }
        sum += filter->J[j];
    }
    return sum;
}

/* Steps 1 to 3 of the tick (4.5): messages, theta, and the weights that follow from it. */
static void start_step(struct dse_high_gain_ekf *filter)
{
    const struct dse_high_gain_ekf_config *config = filter->config;
    if (filter->state_due) {
        merge_states(filter, filter->base);
    }
    filter->J_drive = driving_innovation(filter);
    filter->theta_tick = filter->theta;
    if (config->gain == DSE_HIGH_GAIN_ADAPT) {
        filter->theta_tick = dse_gain_adaptation_step(&config->adaptation, config->period,
                                                      filter->J_drive, filter->theta);
    }
    dse_high_gain_weights(config->scaling, filter->n_i, filter->n_max, filter->theta_tick,
                          config->R, config->Q, &filter->R_th, filter->Q_th);
    dse_high_gain_first_stage(filter);
}

enum dse_status dse_high_gain_ekf_advance(struct dse_high_gain_ekf *filter, int round)
{
    if (!filter->open || round != filter->round || round >= filter->rounds) {
        return DSE_EINVAL;
    }
    const bool stages = filter->config->communication == DSE_HIGH_GAIN_STAGES;
    enum dse_status status = DSE_OK;
    if (round == 0) {
        start_step(filter);
        /* only now the common picture at t_k is complete */
        status = stages ? report(filter) : DSE_OK;
    } else {
        merge_states(filter, filter->xs);
    }
    if (stages && status == DSE_OK) {
        status = dse_high_gain_stage(filter, round);
    }
    if (status != DSE_OK) {
        return fail(filter, status);
    }
    clear_inbox(filter);
    filter->round++;
    return DSE_OK;
}

/* The state of t_{k+1} becomes the filter's state. */
static void commit(struct dse_high_gain_ekf *filter)
{
    const dse_real h = filter->config->period;
    for (int k = 0; k < filter->n; k++) {
        filter->x[k] = filter->xs[k];
    }
    for (int k = 0; k < filter->n_i * filter->n_i; k++) {
        filter->P[k] = filter->Ps[k];
    }
    for (int k = 0; k < filter->config->form->nu; k++) {
        filter->u_next[k] = filter->u[k] + h * filter->du[k];
    }
    filter->theta = filter->theta_tick;
    filter->started = true;
    filter->measured = filter->measured || filter->has_y;
    filter->slot++;
    filter->counters.ticks++;
    filter->open = false;
    filter->health = filter->has_y      ? DSE_HEALTH_TRACKING
                     : filter->measured ? DSE_HEALTH_COASTING
                                        : DSE_HEALTH_INITIALISING;
}

enum dse_status dse_high_gain_ekf_finish(struct dse_high_gain_ekf *filter)
{
    if (!filter->open || filter->round < filter->rounds) {
        return DSE_EINVAL;
    }
    enum dse_status status = DSE_OK;
    if (filter->rounds == 0) {
        start_step(filter);
    }
    if (filter->rounds < 4) {
        for (int s = 0; s < 4 && status == DSE_OK; s++) {
            status = dse_high_gain_stage(filter, s);
        }
    }
    status = status != DSE_OK ? status : dse_high_gain_combine(filter);
    if (status == DSE_OK && filter->config->horizon > 0) {
        status = dse_high_gain_decode(filter, filter->t, filter->base, filter->u, filter->chi);
        status = status != DSE_OK ? status : dse_high_gain_advance_predictions(filter, filter->chi);
    }
    if (status != DSE_OK) {
        return fail(filter, status);
    }
    commit(filter);
    return DSE_OK;
}

/* ---- what is read from outside ---- */

const dse_real *dse_high_gain_ekf_estimate(const struct dse_high_gain_ekf *filter)
{
    return filter->estimate;
}

const dse_real *dse_high_gain_ekf_estimate_covariance(const struct dse_high_gain_ekf *filter)
{
    return filter->estimate_covariance;
}

const dse_real *dse_high_gain_ekf_picture(const struct dse_high_gain_ekf *filter)
{
    return filter->x;
}

const dse_real *dse_high_gain_ekf_covariance(const struct dse_high_gain_ekf *filter)
{
    return filter->P;
}

dse_real dse_high_gain_ekf_theta(const struct dse_high_gain_ekf *filter)
{
    return filter->theta_tick;
}

dse_real dse_high_gain_ekf_innovation(const struct dse_high_gain_ekf *filter)
{
    return filter->J_own;
}

dse_real dse_high_gain_ekf_drive(const struct dse_high_gain_ekf *filter)
{
    return filter->J_drive;
}

dse_real dse_high_gain_ekf_output_error(const struct dse_high_gain_ekf *filter)
{
    return filter->output_error;
}

enum dse_health dse_high_gain_ekf_health(const struct dse_high_gain_ekf *filter)
{
    return filter->health;
}

const struct dse_high_gain_ekf_counters *
dse_high_gain_ekf_counters(const struct dse_high_gain_ekf *filter)
{
    return &filter->counters;
}
