#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "high_gain_rig.h"

#include "dse/ode.h"
#include "dse/plant.h"

#define HOUR_PER_SECOND (DSE_REAL(1) / 3600)

/* ---- configurations ---- */

const struct dse_gain_adaptation ch2_gain = {
    .theta_m = 20, .rise_time = DSE_REAL(0.001), .relaxation = 100, .sharpness = 5, .threshold = 4};

const enum dse_high_gain_communication ways[2] = {DSE_HIGH_GAIN_TICK, DSE_HIGH_GAIN_STAGES};

struct dse_high_gain_ekf_config linear_config(void)
{
    return (struct dse_high_gain_ekf_config){.period = DSE_REAL(0.01),
                                             .innovation = DSE_HIGH_GAIN_SUM,
                                             .R = 1,
                                             .adaptation = {.theta_m = 4,
                                                            .rise_time = DSE_REAL(0.02),
                                                            .relaxation = 2,
                                                            .sharpness = 50,
                                                            .threshold = DSE_REAL(0.05)},
                                             .horizon = LINEAR_HORIZON};
}

struct dse_high_gain_ekf_config cstr_config(void)
{
    return (struct dse_high_gain_ekf_config){.period = HOUR_PER_SECOND,
                                             .innovation = DSE_HIGH_GAIN_SUM,
                                             .communication = DSE_HIGH_GAIN_STAGES,
                                             .R = 1,
                                             .adaptation = ch2_gain,
                                             .horizon = CSTR_HORIZON};
}

struct dse_high_gain_ekf_config late_config(void)
{
    return (struct dse_high_gain_ekf_config){.period = HOUR_PER_SECOND,
                                             .coords = DSE_HIGH_GAIN_PHYSICAL,
                                             .scaling = DSE_HIGH_GAIN_PLAIN,
                                             .comm_every_ticks = MAX_EVERY,
                                             .max_delay = MAX_DELAY,
                                             .R = 1,
                                             .adaptation = {.theta_m = 10,
                                                            .rise_time = DSE_REAL(0.001),
                                                            .relaxation = 1000,
                                                            .sharpness = 5,
                                                            .threshold = 1},
                                             .horizon = LATE_HORIZON};
}

/* ---- networks ---- */

void init_filters(struct network *network, const struct dse_high_gain_ekf_config *config)
{
    for (int i = 0; i < network->p; i++) {
        struct dse_arena arena;
        const bool single = network->form.n_i[i] == 1;
        network->config[i] = *config;
        network->config[i].model = &network->model;
        network->config[i].form = &network->form;
        network->config[i].i = i;
        network->config[i].x0 = network->x0;
        network->config[i].P0 = single ? network->P0_single : network->P0;
        network->config[i].Q = single ? network->Q_single : network->Q;
        dse_arena_init(&arena, network->memory[i],
                       (int)(sizeof network->memory[i] / sizeof(dse_real)));
        assert_int_equal(dse_high_gain_ekf_init(&network->filter[i], &network->config[i], &arena),
                         DSE_OK);
    }
}

void linear_network(struct network *network, const struct dse_high_gain_ekf_config *config)
{
    *network = (struct network){.linear = coupled,
                                .n = LINEAR_N,
                                .p = LINEAR_P,
                                .x = {1, 0, -1, 2, 1},
                                .x0 = {3, 1, 1, -1, 0},
                                .P0 = {2, DSE_REAL(0.5), DSE_REAL(0.5), 3},
                                .P0_single = {2},
                                .Q = {5, 0, 0, 5},
                                .Q_single = {5}};
    linear_plant(&network->linear, LINEAR_P, &network->model, &network->form);
    init_filters(network, config);
}

void cstr_network(struct network *network, const struct dse_high_gain_ekf_config *config)
{
    const struct dse_plant *plant = dse_plant_find("cstr2");
    *network = (struct network){.n = 4,
                                .p = 2,
                                .x = {360, 3, 320, DSE_REAL(2.5)},
                                .u = {DSE_REAL(4.998), 0},
                                .x0 = {396, DSE_REAL(2.6), 352, DSE_REAL(10.5)},
                                .P0 = {1, 0, 0, 1},
                                .Q = {150, 0, 0, 5}};
    assert_true(plant->prepared_size <= 256);
    assert_int_equal(plant->prepare(plant->sets[0].values, network->prepared), DSE_OK);
    plant->model(network->prepared, &network->model);
    plant->normal_form(network->prepared, &network->form);
    init_filters(network, config);
}

void prepare_late_plant(dse_real *prepared, const char *parameter, dse_real change)
{
    const struct dse_plant *plant = dse_plant_find("cstr2");
    dse_real values[DSE_PLANT_MAX_PARAMETERS];
    memcpy(values, plant->sets[1].values, (size_t)plant->n_parameters * sizeof *values);
    for (int i = 0; i < plant->n_parameters; i++) {
        values[i] += strcmp(plant->parameters[i].name, parameter) == 0 ? change : 0;
    }
    assert_int_equal(plant->prepare(values, prepared), DSE_OK);
}

void late_network(struct network *network, const struct dse_high_gain_ekf_config *config)
{
    const struct dse_plant *plant = dse_plant_find("cstr2");
    *network = (struct network){.n = 4,
                                .p = 2,
                                .x = {360, 3, 320, 3},
                                .u = {DSE_REAL(4.998), 0},
                                .x0 = {365, DSE_REAL(2.5), 325, DSE_REAL(3.5)},
                                .P0 = {1, 0, 0, 1},
                                .Q = {50, 0, 0, 5},
                                .lose = {{true, true}, {true, true}}};
    prepare_late_plant(network->prepared, "", 0);
    plant->model(network->prepared, &network->model);
    plant->normal_form(network->prepared, &network->form);
    init_filters(network, config);
}

/* ---- ticks ---- */

void exchange(struct network *network, int round)
{
    dse_real message[MAX_P][DSE_HIGH_GAIN_EKF_MESSAGE(2)] = {{0}};
    int count[MAX_P] = {0};
    for (int j = 0; j < network->p; j++) {
        count[j] = dse_high_gain_ekf_message(&network->filter[j], round, message[j]);
    }
    for (int i = 0; i < network->p; i++) {
        for (int l = 0; l < network->p; l++) {
            const int j = network->backwards ? network->p - 1 - l : l;
            if (j != i && !network->lose[i][j]) {
                assert_int_equal(
                    dse_high_gain_ekf_receive(&network->filter[i], round, j, message[j], count[j]),
                    DSE_OK);
            }
        }
    }
}

void begin_tick(struct network *network)
{
    dse_real y[MAX_P];
    const dse_real t = (dse_real)network->k * network->config[0].period;
    assert_int_equal(network->model.h(&network->model, t, network->x, network->u, y), DSE_OK);
    for (int i = 0; i < network->p; i++) {
        const bool valid = !network->blind[i];
        const struct dse_measurement own = {.y = y + i, .valid = &valid};
        assert_int_equal(
            dse_high_gain_ekf_begin(&network->filter[i], network->k, t, network->u, &own), DSE_OK);
    }
}

void end_tick(struct network *network)
{
    dse_real scratch[DSE_RK4_SCRATCH(MAX_N)];
    const int rounds = dse_high_gain_ekf_rounds(&network->filter[0]);
    for (int r = 0; r < rounds; r++) {
        exchange(network, r);
        for (int i = 0; i < network->p; i++) {
            assert_int_equal(dse_high_gain_ekf_advance(&network->filter[i], r), DSE_OK);
        }
    }
    for (int i = 0; i < network->p; i++) {
        assert_int_equal(dse_high_gain_ekf_finish(&network->filter[i]), DSE_OK);
    }
    assert_int_equal(dse_rk4_model_step(&network->model,
                                        (dse_real)network->k * network->config[0].period,
                                        network->config[0].period, network->u, network->x, scratch),
                     DSE_OK);
    network->k++;
}

void tick(struct network *network)
{
    begin_tick(network);
    end_tick(network);
}

void begin_late_tick(struct network *network)
{
    begin_tick(network);
    for (int i = 0; i < network->p; i++) {
        dse_real message[DSE_HIGH_GAIN_EKF_MESSAGE(2)] = {0};
        if (dse_high_gain_ekf_message(&network->filter[i], 0, message) > 1) {
            assert_in_range(network->k / MAX_EVERY, 0, MAX_INSTANTS - 1);
            memcpy(network->said[i][network->k / MAX_EVERY], message + 1, 2 * sizeof *message);
        }
    }
}

enum dse_status deliver(struct network *network, int i, int64_t stamp)
{
    return dse_high_gain_ekf_deliver(&network->filter[i], 1 - i, stamp * MAX_EVERY,
                                     network->said[1 - i][stamp], 2);
}

void late_tick(struct network *network, const int *due, int stamps)
{
    begin_late_tick(network);
    for (int s = 0; s < stamps && network->k % MAX_EVERY == 0; s++) {
        for (int i = 0; i < network->p && due[s] == (int)(network->k / MAX_EVERY); i++) {
            assert_int_equal(deliver(network, i, s), DSE_OK);
        }
    }
    end_tick(network);
}

/* ---- what is the same ---- */

void assert_same_state(const struct network *a, const struct network *b)
{
    for (int i = 0; i < a->p; i++) {
        const struct dse_high_gain_ekf *f = &a->filter[i], *g = &b->filter[i];
        assert_memory_equal(f->x, g->x, (size_t)f->n * sizeof *f->x);
        assert_memory_equal(f->P, g->P, (size_t)(f->n_i * f->n_i) * sizeof *f->P);
        assert_memory_equal(&f->theta, &g->theta, sizeof f->theta);
        assert_memory_equal(f->ring, g->ring,
                            (size_t)((f->config->horizon + 1) * (f->n + 1)) * sizeof *f->ring);
    }
}

void assert_same_pictures(const struct network *a, const struct network *b)
{
    for (int i = 0; i < a->p; i++) {
        const struct dse_high_gain_ekf *f = &a->filter[i], *g = &b->filter[i];
        assert_memory_equal(dse_high_gain_ekf_picture(f), dse_high_gain_ekf_picture(g),
                            (size_t)f->n * sizeof(dse_real));
        assert_memory_equal(dse_high_gain_ekf_covariance(f), dse_high_gain_ekf_covariance(g),
                            (size_t)(f->n_i * f->n_i) * sizeof(dse_real));
    }
}
