/* run_ch6_threetank.json: the rig's stand-in and its three filters, in four ways of communication.
 * Filter 2 keeps theta = 1; each filter has its own innovation. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dse/high_gain_ekf.h"
#include "dse/ode.h"
#include "parts.h"

enum { N = 5, P = 3, HORIZON = 108, ROWS = 128, TICKS = 512 };

struct run {
    struct golden_plant rig, nominal;
    double period;
    double x[N];
    int ticks, rows;
    double *u, *V, *k;       /* from the file: ticks x 2, ticks x P, rows */
    double *Q, *R, *P0, *x0; /* from the file */
    double blocks[P][4], starts[P][4];
    struct dse_high_gain_ekf_config config[P];
    struct dse_high_gain_ekf filter[P];
};

static double memory[P][DSE_HIGH_GAIN_EKF_STORAGE(N, 2, P, P, 2, HORIZON)];

static double rec_r[ROWS * N], rec_r_hat[ROWS * N], rec_theta[ROWS * P], rec_J[ROWS * P];

static const struct way {
    const char *key;
    enum dse_high_gain_communication communication;
    enum dse_high_gain_predictor predictor;
    enum dse_high_gain_gain gain;
    int every;
} ways[] = {
    {"cont", DSE_HIGH_GAIN_STAGES, DSE_HIGH_GAIN_PREDICT, DSE_HIGH_GAIN_ADAPT, 1},
    {"hold90", DSE_HIGH_GAIN_TICK, DSE_HIGH_GAIN_HOLD, DSE_HIGH_GAIN_ADAPT, 90},
    {"none", DSE_HIGH_GAIN_NONE, DSE_HIGH_GAIN_HOLD, DSE_HIGH_GAIN_ADAPT, 1},
    {"cont_ekf", DSE_HIGH_GAIN_STAGES, DSE_HIGH_GAIN_PREDICT, DSE_HIGH_GAIN_ONE, 1},
};

static enum dse_status set_up_filter(struct run *run, const json_t *root, const struct way *way,
                                     int i, int offset)
{
    const json_t *params = json_object_get(root, "params");
    const int n_i = run->nominal.form.n_i[i];
    struct dse_arena arena;
    memset(run->blocks[i], 0, sizeof run->blocks[i]);
    memset(run->starts[i], 0, sizeof run->starts[i]);
    for (int s = 0; s < n_i; s++) {
        run->blocks[i][s * n_i + s] = run->Q[offset + s];
        run->starts[i][s * n_i + s] = run->P0[s];
    }
    run->config[i] = (struct dse_high_gain_ekf_config){
        .model = &run->nominal.model,
        .form = &run->nominal.form,
        .i = i,
        .period = run->period,
        .coords = DSE_HIGH_GAIN_NORMAL,
        .scaling = DSE_HIGH_GAIN_FULL,
        .gain = n_i == 1 ? DSE_HIGH_GAIN_ONE : way->gain,
        .innovation = DSE_HIGH_GAIN_OWN,
        .communication = way->communication,
        .predictor = way->predictor,
        .comm_every_ticks = way->every,
        .x0 = run->x0,
        .P0 = run->starts[i],
        .Q = run->blocks[i],
        .R = run->R[i],
        .adaptation = {.theta_m = golden_number(params, "thm", 0),
                       .rise_time = golden_number(params, "dT", 0),
                       .relaxation = golden_number(params, "lam", 0),
                       .sharpness = golden_number(params, "beta", 0),
                       .threshold = golden_number(params, "m", 0)},
        .horizon = (int)golden_number(root, "Nd", 0),
    };
    dse_arena_init(&arena, memory[i], (int)(sizeof memory[i] / sizeof memory[i][0]));
    return dse_high_gain_ekf_init(&run->filter[i], &run->config[i], &arena);
}

static enum dse_status set_up_way(struct run *run, const json_t *root, const struct way *way)
{
    enum dse_status status = DSE_OK;
    for (int i = 0, offset = 0; i < P && status == DSE_OK; offset += run->nominal.form.n_i[i++]) {
        status = set_up_filter(run, root, way, i, offset);
    }
    memcpy(run->x, run->rig.set->x0, sizeof run->x);
    return status;
}

static void exchange(struct run *run, int round)
{
    double out[P][DSE_HIGH_GAIN_EKF_MESSAGE(2)];
    int count[P];
    for (int i = 0; i < P; i++) {
        count[i] = dse_high_gain_ekf_message(&run->filter[i], round, out[i]);
    }
    for (int i = 0; i < P; i++) {
        for (int j = 0; j < P; j++) {
            if (j != i && count[j] > 0) {
                dse_high_gain_ekf_receive(&run->filter[i], round, j, out[j], count[j]);
            }
        }
    }
}

static enum dse_status filters_tick(struct run *run, int k, const double *u, const double *y)
{
    enum dse_status status = DSE_OK;
    for (int i = 0; i < P && status == DSE_OK; i++) {
        const struct dse_measurement own = {.y = y + i};
        status = dse_high_gain_ekf_begin(&run->filter[i], k, k * run->period, u, &own);
    }
    for (int r = 0; status == DSE_OK && r < dse_high_gain_ekf_rounds(&run->filter[0]); r++) {
        exchange(run, r);
        for (int i = 0; i < P && status == DSE_OK; i++) {
            status = dse_high_gain_ekf_advance(&run->filter[i], r);
        }
    }
    for (int i = 0; i < P && status == DSE_OK; i++) {
        status = dse_high_gain_ekf_finish(&run->filter[i]);
    }
    return status;
}

struct driven {
    const struct dse_model *model;
    const double *u;
};

static enum dse_status rhs(void *context, dse_real t, const dse_real *x, dse_real *dx)
{
    const struct driven *driven = context;
    return driven->model->f(driven->model, t, x, driven->u, dx);
}

static void record(const struct run *run, int row)
{
    memcpy(rec_r + row * N, run->x, sizeof run->x);
    for (int i = 0, offset = 0; i < P; offset += run->nominal.form.n_i[i++]) {
        const struct dse_high_gain_ekf *f = &run->filter[i];
        memcpy(rec_r_hat + row * N + offset, dse_high_gain_ekf_estimate(f),
               (size_t)run->nominal.form.n_i[i] * sizeof *rec_r_hat);
        rec_theta[row * P + i] = dse_high_gain_ekf_theta(f);
        rec_J[row * P + i] = dse_high_gain_ekf_innovation(f);
    }
}

static enum dse_status tick(struct run *run, int k, int row)
{
    double y[P], scratch[DSE_RK4_SCRATCH(N)];
    const double *u = run->u + 2 * k;
    struct driven driven = {&run->rig.model, u};
    enum dse_status status = run->rig.model.h(&run->rig.model, k * run->period, run->x, u, y);
    for (int i = 0; i < P; i++) {
        y[i] += run->V[k * P + i];
    }
    status = status != DSE_OK ? status : filters_tick(run, k, u, y);
    if (status == DSE_OK && row < run->rows && (int)run->k[row] == k) {
        record(run, row);
    }
    return status != DSE_OK
               ? status
               : dse_rk4_step(rhs, &driven, k * run->period, run->period, N, run->x, scratch);
}

static int run_way(struct run *run, const json_t *root, const struct way *way)
{
    const json_t *reference = json_object_get(root, way->key);
    enum dse_status status = set_up_way(run, root, way);
    int row = 0;
    for (int k = 0; k < run->ticks && status == DSE_OK; k++) {
        status = tick(run, k, row);
        row += row < run->rows && (int)run->k[row] == k;
    }
    printf("  %s\n", way->key);
    if (status != DSE_OK) {
        printf("  %s\n", dse_status_text(status));
        return GOLDEN_FAIL;
    }
    return golden_compare(root, "r_true", run->rows, N, rec_r, 1e-6) |
           golden_compare(reference, "r_hat", run->rows, N, rec_r_hat, 1e-6) |
           golden_compare(reference, "theta", run->rows, P, rec_theta, 1e-6) |
           golden_compare(reference, "J", run->rows, P, rec_J, 1e-6);
}

int golden_three_tank_run_file(const json_t *root)
{
    static struct run run;
    int n_u, n_V, n_Q, n_R, n_P0, n_x0;
    run = (struct run){0};
    int result = golden_plant_load(&run.nominal, "threetank");
    if (result != GOLDEN_PASS || golden_plant_load(&run.rig, "threetank_rig") != GOLDEN_PASS) {
        golden_plant_free(&run.nominal);
        return result != GOLDEN_PASS ? result : GOLDEN_FAIL;
    }
    run.period = golden_number(root, "Ts_h", 0);
    run.u = golden_numbers(json_object_get(root, "u"), &n_u);
    run.V = golden_numbers(json_object_get(root, "V"), &n_V);
    run.k = golden_numbers(json_object_get(root, "k"), &run.rows);
    run.Q = golden_numbers(json_object_get(root, "Q_diag"), &n_Q);
    run.R = golden_numbers(json_object_get(root, "R"), &n_R);
    run.P0 = golden_numbers(json_object_get(root, "P0"), &n_P0);
    run.x0 = golden_numbers(json_object_get(root, "guess_r"), &n_x0);
    run.ticks = n_u / 2;
    const int fits = n_V == run.ticks * P && run.rows >= 1 && run.rows <= ROWS && n_Q == N &&
                     n_R == P && n_P0 == 2 && n_x0 == N && run.ticks <= TICKS &&
                     golden_number(root, "Nd", 0) <= HORIZON;
    if (!fits) {
        printf("  the run has other sizes\n");
        result = GOLDEN_FAIL;
    }
    for (size_t w = 0; fits && w < sizeof ways / sizeof ways[0]; w++) {
        result |= run_way(&run, root, &ways[w]);
    }
    double *const owned[] = {run.u, run.V, run.k, run.Q, run.R, run.P0, run.x0};
    for (size_t o = 0; o < sizeof owned / sizeof owned[0]; o++) {
        free(owned[o]);
    }
    golden_plant_free(&run.rig);
    golden_plant_free(&run.nominal);
    return result;
}
