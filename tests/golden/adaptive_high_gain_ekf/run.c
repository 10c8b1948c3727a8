/* run_*.json: a plant and its p filters in one process. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dse/high_gain_ekf.h"
#include "dse/ode.h"
#include "parts.h"

enum {
    MAX_P = 4,
    MAX_N = 2 * MAX_P,
    MAX_HORIZON = 200,
    MAX_ROWS = 256,
    MAX_DELAY = 8,
    MAX_EVERY = 60,
    MAX_INSTANTS = 1024,
    MAX_SENT = 4096
};

struct run {
    struct golden_plant plant;
    int n, p, continuous, every;
    double tolerance;
    double period;
    double x[MAX_N]; /* the plant */
    double *W, *V;   /* stored noise, or NULL */
    int n_W, n_V;
    double *x0, *Q, *R, *P0, *k; /* from the file */
    int rows;                    /* recorded ticks */
    double blocks[MAX_P][4];     /* Q_i */
    struct dse_high_gain_ekf_config config[MAX_P];
    struct dse_high_gain_ekf filter[MAX_P];
    /* the network */
    int D;              /* largest delay, -1: no network is given */
    double *delays;     /* [i][j][stamp], -1: lost */
    int stamps, n_ages; /* of the sequences; recorded instants */
    struct dse_line line[MAX_P][MAX_P];
    double H[MAX_N]; /* weights of the trigger */
    int sent;        /* entries in rec_sent */
};

static double memory[MAX_P][DSE_HIGH_GAIN_EKF_STORAGE(MAX_N, 2, MAX_P, MAX_P, 2, MAX_HORIZON) +
                            DSE_HIGH_GAIN_EKF_DELAY_STORAGE(MAX_N, 2, MAX_P, MAX_DELAY, MAX_EVERY)];
static double line_memory[MAX_P * MAX_P * DSE_LINE_STORAGE(MAX_DELAY, 2)];

/* What the file records, in its own order. */
static double rec_x[MAX_ROWS * MAX_N], rec_y[MAX_ROWS * MAX_P], rec_theta[MAX_ROWS * MAX_P],
    rec_J[MAX_ROWS * MAX_P], rec_xhat[MAX_ROWS * MAX_N], rec_z[MAX_ROWS * MAX_P * MAX_N],
    rec_P[MAX_ROWS * MAX_P * 4], rec_ages[MAX_INSTANTS * MAX_P * MAX_P], rec_sent[MAX_SENT * 2];

/* ---- set-up ---- */

/* Everything but the blocks; returns 0 when the file asks for what is not there. */
static int options(struct run *run, const json_t *config, struct dse_high_gain_ekf_config *out)
{
    const int triggered = golden_is(config, "mode", "trig");
    run->continuous = golden_is(config, "mode", "cont");
    run->every = run->continuous ? 1 : (int)golden_number(config, "comm_every_ticks", 1);
    if ((!golden_is(config, "mode", "disc") && !golden_is(config, "mode", "delay") && !triggered &&
         !run->continuous) ||
        run->n > MAX_N || run->D > MAX_DELAY || run->every > MAX_EVERY ||
        golden_number(config, "Nd", 0) > MAX_HORIZON) {
        return 0;
    }
    *out = (struct dse_high_gain_ekf_config){
        .model = &run->plant.model,
        .form = &run->plant.form,
        .period = run->period,
        .coords = golden_is(config, "coords", "phys")  ? DSE_HIGH_GAIN_PHYSICAL
                  : golden_is(config, "coords", "map") ? DSE_HIGH_GAIN_MAPPED
                                                       : DSE_HIGH_GAIN_NORMAL,
        .scaling = golden_is(config, "scaling", "plain") ? DSE_HIGH_GAIN_PLAIN : DSE_HIGH_GAIN_FULL,
        .gain = golden_is(config, "gain", "one")   ? DSE_HIGH_GAIN_ONE
                : golden_is(config, "gain", "max") ? DSE_HIGH_GAIN_MAX
                                                   : DSE_HIGH_GAIN_ADAPT,
        .innovation = golden_is(config, "J_mode", "sum") ? DSE_HIGH_GAIN_SUM : DSE_HIGH_GAIN_OWN,
        .communication = run->continuous ? DSE_HIGH_GAIN_STAGES
                         : triggered     ? DSE_HIGH_GAIN_TRIGGERED
                                         : DSE_HIGH_GAIN_TICK,
        .predictor = run->continuous || json_is_true(json_object_get(config, "predictor"))
                         ? DSE_HIGH_GAIN_PREDICT
                         : DSE_HIGH_GAIN_HOLD,
        .comm_every_ticks = run->every,
        .max_delay = run->D > 0 ? run->D : 0,
        .adaptation = {.theta_m = golden_number(config, "theta_m", 0),
                       .rise_time = golden_number(config, "dT", 0),
                       .relaxation = golden_number(config, "lam", 0),
                       .sharpness = golden_number(config, "beta", 0),
                       .threshold = golden_number(config, "m", 0)},
        .horizon = (int)golden_number(config, "Nd", 0),
    };
    return 1;
}

static double *sized(const json_t *object, const char *key, int expected, int *ok)
{
    int count;
    double *numbers = golden_numbers(json_object_get(object, key), &count);
    if (count != expected) {
        printf("  '%s' has %d numbers, %d expected\n", key, count, expected);
        *ok = 0;
    }
    return numbers;
}

/* Delays and losses, and the recorded ages. */
static int network(struct run *run, const json_t *root, int *ok)
{
    const json_t *net = json_object_get(root, "network");
    struct dse_arena arena;
    int count;
    dse_arena_init(&arena, line_memory, (int)(sizeof line_memory / sizeof line_memory[0]));
    run->D = net == NULL ? -1 : (int)golden_number(net, "D", 0);
    if (net == NULL || run->D > MAX_DELAY) {
        return 0;
    }
    run->delays = golden_numbers(json_object_get(net, "delay_i_from_j_stamp"), &count);
    run->stamps = count / (run->p * run->p);
    run->n_ages = (int)json_array_size(json_object_get(root, "age_per_comm_instant"));
    *ok = *ok && count == run->stamps * run->p * run->p && run->n_ages <= MAX_INSTANTS;
    for (int i = 0; i < run->p * run->p; i++) {
        *ok = *ok && dse_line_init(&run->line[i / run->p][i % run->p], run->D, 2, &arena) == DSE_OK;
    }
    return 1;
}

static void trigger(struct run *run, const json_t *root, struct dse_trigger_config *out)
{
    const json_t *config = json_object_get(root, "trigger");
    int count;
    double *H = golden_numbers(json_object_get(config, "H"), &count);
    for (int k = 0; k < count && k < MAX_N; k++) {
        run->H[k] = H[k];
    }
    free(H);
    if (config != NULL) {
        *out = (struct dse_trigger_config){.norm = DSE_TRIGGER_RELATIVE,
                                           .threshold = golden_number(config, "Lz", 0),
                                           .weights = run->H};
    }
}

static int set_up(struct run *run, const json_t *root)
{
    const json_t *config = json_object_get(root, "config");
    const json_t *record = json_object_get(root, "record");
    int result =
        golden_plant_load(&run->plant, json_string_value(json_object_get(config, "model")));
    if (result != GOLDEN_PASS) {
        return result;
    }
    run->n = run->plant.model.nx;
    run->p = run->plant.form.p;
    run->period = golden_number(config, "Ts_h", 0);
    run->tolerance = 1e-6;
    int ok = 1;
    if (network(run, root, &ok) && golden_is(config, "coords", "normal")) {
        run->tolerance = 1e-5; /* rounding grows 3e4-fold */
    }
    struct dse_high_gain_ekf_config common;
    if (!options(run, config, &common)) {
        printf("  mode '%s' is not supported\n",
               json_string_value(json_object_get(config, "mode")));
        return GOLDEN_UNSUPPORTED;
    }
    trigger(run, root, &common.trigger);
    run->x0 = sized(config, "x0_filter_guess", run->n, &ok);
    run->Q = sized(config, "Q_diag", run->n, &ok);
    run->R = sized(config, "R", run->p, &ok);
    run->P0 = sized(config, "P0", 4 * run->p, &ok);
    run->W = golden_numbers(json_object_get(root, "W_per_h"), &run->n_W);
    run->V = golden_numbers(json_object_get(root, "V"), &run->n_V);
    run->k = golden_numbers(json_object_get(record, "k"), &run->rows);
    double *start = sized(root, "plant_x0", run->n, &ok);
    for (int k = 0; ok && k < run->n; k++) {
        run->x[k] = start[k];
    }
    free(start);
    for (int i = 0; ok && i < run->p; i++) {
        struct dse_arena arena;
        run->blocks[i][0] = run->Q[2 * i];
        run->blocks[i][3] = run->Q[2 * i + 1];
        run->config[i] = common;
        run->config[i].i = i;
        run->config[i].x0 = run->x0;
        run->config[i].Q = run->blocks[i];
        run->config[i].P0 = run->P0 + 4 * i;
        run->config[i].R = run->R[i];
        dse_arena_init(&arena, memory[i], (int)(sizeof memory[i] / sizeof memory[i][0]));
        const enum dse_status status =
            dse_high_gain_ekf_init(&run->filter[i], &run->config[i], &arena);
        if (status != DSE_OK) {
            printf("  filter %d: %s\n", i + 1, dse_status_text(status));
            ok = 0;
        }
    }
    return ok && run->rows >= 1 && run->rows <= MAX_ROWS ? GOLDEN_PASS : GOLDEN_FAIL;
}

static void tear_down(struct run *run)
{
    golden_plant_free(&run->plant);
    free(run->x0);
    free(run->Q);
    free(run->R);
    free(run->P0);
    free(run->W);
    free(run->V);
    free(run->k);
    free(run->delays);
}

/* ---- one tick ---- */

/* Into the pair's line, and out of it what has arrived. */
static void through_network(struct run *run, int i, int j, int k, const double *state)
{
    const int64_t instant = k / run->every;
    int64_t stamp;
    const double *arrived;
    if (instant < run->stamps) {
        dse_line_put(&run->line[i][j], instant,
                     (int)run->delays[(i * run->p + j) * run->stamps + instant], state);
    }
    while ((arrived = dse_line_take(&run->line[i][j], instant, &stamp)) != NULL) {
        dse_high_gain_ekf_deliver(&run->filter[i], j, stamp * run->every, arrived, 2);
    }
}

static void exchange(struct run *run, int round, int k)
{
    double message[MAX_P][DSE_HIGH_GAIN_EKF_MESSAGE(2)] = {{0}};
    int count[MAX_P] = {0};
    for (int j = 0; j < run->p; j++) {
        count[j] = dse_high_gain_ekf_message(&run->filter[j], round, message[j]);
    }
    for (int i = 0; i < run->p; i++) {
        for (int j = 0; j < run->p; j++) {
            const int delayed = run->D >= 0 && count[j] > 1;
            if (j != i) {
                dse_high_gain_ekf_receive(&run->filter[i], round, j, message[j],
                                          delayed ? 1 : count[j]);
            }
            if (j != i && delayed) {
                through_network(run, i, j, k, message[j] + 1);
            }
        }
    }
}

/* What the network has done to the filters at an instant: ages, and who has sent. */
static void record_network(struct run *run, int k)
{
    const int instant = k / run->every, p = run->p;
    for (int i = 0; i < p && k % run->every == 0; i++) {
        for (int j = 0; j < p && instant < MAX_INSTANTS; j++) {
            rec_ages[(instant * p + i) * p + j] =
                j == i ? 0 : dse_high_gain_ekf_age(&run->filter[i], j);
        }
        if (dse_high_gain_ekf_tells(&run->filter[i]) && run->sent < MAX_SENT) {
            rec_sent[2 * run->sent] = k;
            rec_sent[2 * run->sent++ + 1] = i;
        }
    }
}

static enum dse_status filters_tick(struct run *run, int k, const double *y)
{
    enum dse_status status = DSE_OK;
    for (int i = 0; i < run->p && status == DSE_OK; i++) {
        const struct dse_measurement own = {.y = y + i};
        status = dse_high_gain_ekf_begin(&run->filter[i], k, k * run->period, run->plant.nominal_u,
                                         &own);
    }
    for (int r = 0; status == DSE_OK && r < dse_high_gain_ekf_rounds(&run->filter[0]); r++) {
        exchange(run, r, k);
        record_network(run, k);
        for (int i = 0; i < run->p && status == DSE_OK; i++) {
            status = dse_high_gain_ekf_advance(&run->filter[i], r);
        }
    }
    for (int i = 0; i < run->p && status == DSE_OK; i++) {
        status = dse_high_gain_ekf_finish(&run->filter[i]);
    }
    return status;
}

struct disturbed {
    const struct run *run;
    const double *w;
};

static enum dse_status disturbed_plant(void *context, dse_real t, const dse_real *x, dse_real *dx)
{
    const struct disturbed *d = context;
    const struct dse_model *model = &d->run->plant.model;
    const enum dse_status status = model->f(model, t, x, d->run->plant.nominal_u, dx);
    for (int k = 0; d->w != NULL && k < model->nx; k++) {
        dx[k] += d->w[k];
    }
    return status;
}

static enum dse_status plant_tick(struct run *run, int k)
{
    double scratch[DSE_RK4_SCRATCH(MAX_N)];
    struct disturbed d = {run, (k + 1) * run->n <= run->n_W ? run->W + k * run->n : NULL};
    return dse_rk4_step(disturbed_plant, &d, k * run->period, run->period, run->n, run->x, scratch);
}

/* Before the tick: the plant at t_k. */
static void record_plant(const struct run *run, int row, const double *y)
{
    memcpy(rec_x + row * run->n, run->x, (size_t)run->n * sizeof *rec_x);
    memcpy(rec_y + row * run->p, y, (size_t)run->p * sizeof *rec_y);
}

/* After the tick: what was reported for t_k, and the pictures at t_{k+1}: one common view, put
 * together from the filters' own blocks, or one view per filter. */
static void record_filters(const struct run *run, int row)
{
    const int n = run->n, p = run->p;
    double *z = rec_z + row * (run->continuous ? n : p * n);
    for (int i = 0; i < p; i++) {
        const struct dse_high_gain_ekf *f = &run->filter[i];
        const double *picture = dse_high_gain_ekf_picture(f);
        rec_theta[row * p + i] = dse_high_gain_ekf_theta(f);
        rec_J[row * p + i] = dse_high_gain_ekf_innovation(f);
        memcpy(rec_xhat + row * n + 2 * i, dse_high_gain_ekf_estimate(f), 2 * sizeof *rec_xhat);
        memcpy(rec_P + (row * p + i) * 4, dse_high_gain_ekf_covariance(f), 4 * sizeof *rec_P);
        if (run->continuous) {
            memcpy(z + 2 * i, picture + 2 * i, 2 * sizeof *z);
        } else {
            memcpy(z + i * n, picture, (size_t)n * sizeof *z);
        }
    }
}

static int simulate(struct run *run)
{
    const int last = (int)run->k[run->rows - 1];
    int row = 0;
    for (int k = 0; k <= last; k++) {
        double y[MAX_P];
        const int recorded = row < run->rows && (int)run->k[row] == k;
        enum dse_status status =
            run->plant.model.h(&run->plant.model, k * run->period, run->x, run->plant.nominal_u, y);
        for (int i = 0; i < run->p && (k + 1) * run->p <= run->n_V; i++) {
            y[i] += run->V[k * run->p + i];
        }
        if (recorded) {
            record_plant(run, row, y);
        }
        status = status != DSE_OK ? status : filters_tick(run, k, y);
        if (recorded) {
            record_filters(run, row++);
        }
        status = status != DSE_OK ? status : plant_tick(run, k);
        if (status != DSE_OK) {
            printf("  tick %d: %s\n", k, dse_status_text(status));
            return GOLDEN_FAIL;
        }
    }
    return GOLDEN_PASS;
}

int golden_run_file(const json_t *root)
{
    static struct run run;
    const json_t *record = json_object_get(root, "record");
    run = (struct run){0};
    int result = set_up(&run, root);
    if (result == GOLDEN_PASS) {
        result = simulate(&run);
    }
    if (result == GOLDEN_PASS) {
        const int rows = run.rows, n = run.n, p = run.p;
        const double tolerance = run.tolerance;
        result = golden_compare(record, "x", rows, n, rec_x, tolerance) |
                 golden_compare(record, "y", rows, p, rec_y, tolerance) |
                 golden_compare(record, "xhat", rows, n, rec_xhat, tolerance) |
                 golden_compare(record, "theta", rows, p, rec_theta, tolerance) |
                 golden_compare(record, "J", rows, p, rec_J, tolerance) |
                 golden_compare(record, "z", rows, run.continuous ? n : p * n, rec_z, tolerance) |
                 golden_compare(record, "P", rows, 4 * p, rec_P, tolerance);
        if (run.n_ages > 0) {
            result |= golden_compare(root, "age_per_comm_instant", run.n_ages, p * p, rec_ages, 0);
        }
        const json_t *sent = json_object_get(root, "trigger");
        if (sent != NULL) {
            result |= golden_compare(sent, "tx_log_tick_source", run.sent, 2, rec_sent, 0);
        }
    }
    tear_down(&run);
    return result;
}
