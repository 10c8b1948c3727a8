/* Time of a tick of the adaptive high-gain EKF: one filter of the stirred tanks, two with the
 * tuning of ahg-43 and horizon 72 or (with BENCH_CSTR4) four with the tuning of ahg-46 and horizon
 * 108, messages handed over in memory. Beside it the floor: the Runge-Kutta steps of the bare model
 * that the horizon asks for, and the exponentials in them. Contenders take turns, so that whatever
 * else the machine does hits all alike. Prints a table; exits with 1 only when a filter fails. */
#include "dse/high_gain_ekf.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "dse/math.h"
#include "dse/ode.h"
#include "dse/plant.h"
#include "dse/random.h"

#ifdef BENCH_CSTR4
#define PLANT   "cstr4"
#define FILTERS 4
#define INPUTS  0
#define HORIZON 108
#else
#define PLANT   "cstr2"
#define FILTERS 2
#define INPUTS  2
#define HORIZON 72
#endif
#define STATES        (2 * FILTERS)
#define BLOCK         2
#define SAMPLES       3600 /* measurements, one hour; the last one is repeated for ever */
#define TURNS         151
#define TICKS         40 /* of each filter in a turn */
#define PREPARED_ROOM 256
/* Runge-Kutta steps of the model in a tick: the filter's own picture and the predictions of the
 * horizon; of the N_d + 1 that there are, the one that is read in this tick is not moved on. */
#define STEPS (1 + HORIZON)
/* Activation energies times reactors times stages times steps. */
#define EXPONENTIALS (2 * FILTERS * 4 * STEPS)

static const double period = 1.0 / 3600;

static dse_real prepared[PREPARED_ROOM];
static struct dse_model model;
static struct dse_normal_form form;
static dse_real samples[SAMPLES][FILTERS];
static dse_real inputs[INPUTS + 1];

/* ---- the plant ---- */

static bool make_plant(void)
{
    const struct dse_plant *plant = dse_plant_find(PLANT);
    if (plant == NULL || plant->prepared_size > PREPARED_ROOM ||
        plant->prepare(plant->sets[0].values, prepared) != DSE_OK)
        return false;
    plant->model(prepared, &model);
    plant->normal_form(prepared, &form);
    for (int k = 0; k < INPUTS; k++)
        inputs[k] = plant->inputs[k].nominal;

    dse_real x[STATES], scratch[DSE_RK4_SCRATCH(STATES)];
    struct dse_random random;
    dse_random_init(&random, 1, 0);
    for (int s = 0; s < STATES; s++)
        x[s] = plant->sets[0].x0[s];
    for (int k = 0; k < SAMPLES; k++) {
        for (int i = 0; i < FILTERS; i++)
            samples[k][i] = x[2 * i] + (dse_real)(2 * dse_random_uniform(&random) - 1);
        if (dse_rk4_model_step(&model, (dse_real)(k * period), (dse_real)period, inputs, x,
                               scratch) != DSE_OK)
            return false;
    }
    return true;
}

/* ---- the filters ---- */

#ifdef BENCH_CSTR4
static const dse_real guess[STATES] = {370, DSE_REAL(2.5),  335, DSE_REAL(2.7),
                                       360, DSE_REAL(2.65), 390, DSE_REAL(3.6)};
static const dse_real P0[BLOCK * BLOCK] = {100, 0, 0, DSE_REAL(1e5)};
static const dse_real Q[BLOCK * BLOCK] = {5, 0, 0, 5};
static const struct dse_gain_adaptation adaptation = {.theta_m = 20,
                                                      .rise_time = DSE_REAL(0.001),
                                                      .relaxation = 100,
                                                      .sharpness = 150,
                                                      .threshold = DSE_REAL(0.1)};
#define SCALING    DSE_HIGH_GAIN_PLAIN
#define INNOVATION DSE_HIGH_GAIN_OWN
#else
static const dse_real guess[STATES] = {396, DSE_REAL(2.6), 352, DSE_REAL(10.5)};
static const dse_real P0[BLOCK * BLOCK] = {1, 0, 0, 1};
static const dse_real Q[BLOCK * BLOCK] = {150, 0, 0, 5};
static const struct dse_gain_adaptation adaptation = {
    .theta_m = 20, .rise_time = DSE_REAL(0.001), .relaxation = 100, .sharpness = 5, .threshold = 4};
#define SCALING    DSE_HIGH_GAIN_FULL
#define INNOVATION DSE_HIGH_GAIN_SUM
#endif

#define STORAGE DSE_HIGH_GAIN_EKF_STORAGE(STATES, INPUTS, FILTERS, FILTERS, BLOCK, HORIZON)

struct network {
    dse_real memory[FILTERS][STORAGE];
    struct dse_high_gain_ekf_config config[FILTERS];
    struct dse_high_gain_ekf filter[FILTERS];
    int64_t k;
    int used; /* reals of one filter */
};

static bool make_network(struct network *network, enum dse_high_gain_communication communication,
                         int horizon)
{
    network->k = 0;
    for (int i = 0; i < FILTERS; i++) {
        struct dse_arena arena;
        network->config[i] = (struct dse_high_gain_ekf_config){
            .model = &model,
            .form = &form,
            .i = i,
            .period = (dse_real)period,
            .gain = horizon > 0 ? DSE_HIGH_GAIN_ADAPT : DSE_HIGH_GAIN_ONE,
            .scaling = SCALING,
            .innovation = INNOVATION,
            .communication = communication,
            .x0 = guess,
            .P0 = P0,
            .Q = Q,
            .R = 1,
            .adaptation = adaptation,
            .horizon = horizon,
        };
        dse_arena_init(&arena, network->memory[i], STORAGE);
        if (dse_high_gain_ekf_init(&network->filter[i], &network->config[i], &arena) != DSE_OK)
            return false;
        network->used = arena.used;
    }
    return true;
}

static bool exchange(struct network *network, int round)
{
    struct dse_high_gain_ekf *filter = network->filter;
    dse_real message[FILTERS][DSE_HIGH_GAIN_EKF_MESSAGE(BLOCK)];
    int count[FILTERS];
    for (int i = 0; i < FILTERS; i++)
        count[i] = dse_high_gain_ekf_message(&filter[i], round, message[i]);
    for (int i = 0; i < FILTERS; i++) {
        for (int j = 0; j < FILTERS; j++)
            if (j != i &&
                dse_high_gain_ekf_receive(&filter[i], round, j, message[j], count[j]) != DSE_OK)
                return false;
        if (dse_high_gain_ekf_advance(&filter[i], round) != DSE_OK)
            return false;
    }
    return true;
}

static bool tick(struct network *network)
{
    const int64_t k = network->k++;
    struct dse_high_gain_ekf *filter = network->filter;
    for (int i = 0; i < FILTERS; i++) {
        const struct dse_measurement y = {&samples[k < SAMPLES ? k : SAMPLES - 1][i], NULL};
        if (dse_high_gain_ekf_begin(&filter[i], k, (dse_real)((double)k * period), inputs, &y) !=
            DSE_OK)
            return false;
    }
    for (int r = 0; r < dse_high_gain_ekf_rounds(&filter[0]); r++)
        if (!exchange(network, r))
            return false;
    for (int i = 0; i < FILTERS; i++)
        if (dse_high_gain_ekf_finish(&filter[i]) != DSE_OK)
            return false;
    return true;
}

/* ---- contenders: TICKS ticks of FILTERS filters, or the same amount of work of the floor ---- */

static struct network networks[4];
static volatile dse_real sink;

static bool run_filters(int which)
{
    bool ok = true;
    for (int k = 0; k < TICKS && ok; k++)
        ok = tick(&networks[which]);
    return ok;
}

static bool run_steps(int unused)
{
    static dse_real x[STEPS][STATES];
    dse_real scratch[DSE_RK4_SCRATCH(STATES)];
    (void)unused;
    for (int s = 0; s < STEPS; s++)
        for (int j = 0; j < STATES; j++)
            x[s][j] = dse_plant_find(PLANT)->sets[0].x0[j] + (dse_real)(0.01 * s);
    for (int k = 0; k < TICKS * FILTERS; k++)
        for (int s = 0; s < STEPS; s++)
            if (dse_rk4_model_step(&model, 0, (dse_real)period, inputs, x[s], scratch) != DSE_OK)
                return false;
    sink = x[0][0];
    return true;
}

static bool run_exponentials(int unused)
{
    dse_real sum = 0;
    (void)unused;
    for (int k = 0; k < TICKS * FILTERS; k++)
        for (int s = 0; s < EXPONENTIALS; s++)
            sum += dse_exp(DSE_REAL(-18) - (dse_real)s / 1024);
    sink = sum;
    return true;
}

static const struct contender {
    const char *name;
    bool (*run)(int which);
    int which;
    enum dse_high_gain_communication communication;
    int horizon;
} contenders[] = {
    {"filter, stages, with innovation", run_filters, 0, DSE_HIGH_GAIN_STAGES, HORIZON},
    {"filter, stages, no innovation", run_filters, 1, DSE_HIGH_GAIN_STAGES, 0},
    {"filter, tick, with innovation", run_filters, 2, DSE_HIGH_GAIN_TICK, HORIZON},
    {"filter, tick, no innovation", run_filters, 3, DSE_HIGH_GAIN_TICK, 0},
    {"floor: the model's steps alone", run_steps, 0, DSE_HIGH_GAIN_NONE, 0},
    {"  their exponentials alone", run_exponentials, 0, DSE_HIGH_GAIN_NONE, 0},
};
enum {
    STAGES_ALL,
    STAGES_0,
    TICK_ALL,
    TICK_0,
    FLOOR,
    CONTENDERS = sizeof contenders / sizeof contenders[0]
};

/* ---- measuring ---- */

static double now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

static int compare(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double ns[CONTENDERS][TURNS]; /* per tick of one filter */

static bool measure(void)
{
    for (int turn = -2; turn < TURNS; turn++) {
        for (int c = 0; c < CONTENDERS; c++) {
            const double begin = now_ns();
            if (!contenders[c].run(contenders[c].which)) {
                printf("%s: failed\n", contenders[c].name);
                return false;
            }
            if (turn >= 0)
                ns[c][turn] = (now_ns() - begin) / (TICKS * FILTERS);
        }
    }
    for (int c = 0; c < CONTENDERS; c++)
        qsort(ns[c], TURNS, sizeof ns[c][0], compare);
    return true;
}

static void print_share(const char *mode, int with, int without)
{
    const double middle = ns[with][TURNS / 2];
    printf("%s: the innovation takes %.0f %% of the tick; tick / floor %.2f (fastest %.2f)\n", mode,
           100 * (1 - ns[without][TURNS / 2] / middle), middle / ns[FLOOR][TURNS / 2],
           ns[with][0] / ns[FLOOR][0]);
}

int main(void)
{
    bool ok = make_plant();
    for (int c = 0; c < CONTENDERS && ok; c++)
        if (contenders[c].run == run_filters)
            ok = make_network(&networks[contenders[c].which], contenders[c].communication,
                              contenders[c].horizon);
    if (!ok || !measure())
        return 1;
    printf("Tick of one high-gain EKF of %s (2 of %d states, horizon %d, %s), fastest and median "
           "of %d "
           "turns of %d\n%-32s fastest ns   median ns    ticks/s     bytes\n",
           PLANT, STATES, HORIZON, sizeof(dse_real) == sizeof(double) ? "double" : "float", TURNS,
           TICKS, "");
    for (int c = 0; c < CONTENDERS; c++) {
        printf("%-32s %10.0f  %10.0f %10.0f", contenders[c].name, ns[c][0], ns[c][TURNS / 2],
               1e9 / ns[c][TURNS / 2]);
        if (contenders[c].run == run_filters)
            printf("  %8zu", sizeof(struct dse_high_gain_ekf) +
                                 sizeof(dse_real) * (size_t)networks[contenders[c].which].used);
        printf("\n");
    }
    print_share("stages", STAGES_ALL, STAGES_0);
    print_share("tick", TICK_ALL, TICK_0);
    return 0;
}
