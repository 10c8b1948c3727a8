/* Two filters exchanging the stages of their Runge-Kutta steps. */
#include "cstr2_network.h"

#include "dse/ode.h"
#include "golden_high_gain.h"

enum { PREPARED = 256 };

#define STORAGE                                                                                    \
    DSE_HIGH_GAIN_EKF_STORAGE(CSTR2_STATES, CSTR2_INPUTS, CSTR2_FILTERS, CSTR2_FILTERS,            \
                              CSTR2_BLOCK, GOLDEN_HORIZON)

static dse_real memory[CSTR2_FILTERS][STORAGE];
static dse_real prepared[PREPARED];

int cstr2_network_storage(void)
{
    return STORAGE;
}

static void configure(struct cstr2_network *network, int i)
{
    network->config[i] = (struct dse_high_gain_ekf_config){
        .model = &network->model,
        .form = &network->form,
        .i = i,
        .period = GOLDEN_PERIOD,
        .innovation = DSE_HIGH_GAIN_SUM,
        .communication = DSE_HIGH_GAIN_STAGES,
        .x0 = golden_guess,
        .P0 = golden_P0[i],
        .Q = golden_Q[i],
        .R = golden_R[i],
        .adaptation = {.theta_m = GOLDEN_THETA_M,
                       .rise_time = GOLDEN_RISE_TIME,
                       .relaxation = GOLDEN_RELAXATION,
                       .sharpness = GOLDEN_SHARPNESS,
                       .threshold = GOLDEN_THRESHOLD},
        .horizon = GOLDEN_HORIZON,
    };
}

enum dse_status cstr2_network_start(struct cstr2_network *network)
{
    const struct dse_plant *plant = dse_plant_find("cstr2");
    if (!plant || plant->prepared_size > PREPARED || plant->nx != CSTR2_STATES ||
        plant->nu != CSTR2_INPUTS)
        return DSE_EDIM;
    enum dse_status status = plant->prepare(plant->sets[0].values, prepared);
    if (status)
        return status;
    plant->model(prepared, &network->model);
    plant->normal_form(prepared, &network->form);
    for (int j = 0; j < CSTR2_STATES; j++)
        network->x[j] = golden_plant_x0[j];
    for (int j = 0; j < CSTR2_INPUTS; j++)
        network->u[j] = plant->inputs[j].nominal;
    network->k = 0;
    for (int i = 0; i < CSTR2_FILTERS; i++) {
        struct dse_arena arena;
        dse_arena_init(&arena, memory[i], STORAGE);
        configure(network, i);
        status = dse_high_gain_ekf_init(&network->filter[i], &network->config[i], &arena);
        if (status)
            return status;
    }
    return DSE_OK;
}

static enum dse_status begin(struct cstr2_network *network, dse_real t)
{
    dse_real y[CSTR2_FILTERS];
    enum dse_status status = network->model.h(&network->model, t, network->x, network->u, y);
    for (int i = 0; i < CSTR2_FILTERS && !status; i++) {
        const struct dse_measurement own = {.y = &y[i]};
        status = dse_high_gain_ekf_begin(&network->filter[i], network->k, t, network->u, &own);
    }
    return status;
}

/* Everybody hears everybody, then all close the round. */
static enum dse_status exchange(struct cstr2_network *network, int round)
{
    enum dse_status status = DSE_OK;
    for (int from = 0; from < CSTR2_FILTERS; from++) {
        dse_real message[DSE_HIGH_GAIN_EKF_MESSAGE(CSTR2_BLOCK)];
        int count = dse_high_gain_ekf_message(&network->filter[from], round, message);
        for (int to = 0; to < CSTR2_FILTERS && !status; to++) {
            if (to != from)
                status =
                    dse_high_gain_ekf_receive(&network->filter[to], round, from, message, count);
        }
    }
    for (int i = 0; i < CSTR2_FILTERS && !status; i++)
        status = dse_high_gain_ekf_advance(&network->filter[i], round);
    return status;
}

static void collect_estimates(struct cstr2_network *network)
{
    for (int i = 0; i < CSTR2_FILTERS; i++) {
        const dse_real *own = dse_high_gain_ekf_estimate(&network->filter[i]);
        for (int j = 0; j < CSTR2_BLOCK; j++)
            network->xhat[i * CSTR2_BLOCK + j] = own[j];
    }
}

enum dse_status cstr2_network_tick(struct cstr2_network *network)
{
    dse_real t = GOLDEN_PERIOD * (dse_real)network->k;
    enum dse_status status = begin(network, t);
    for (int round = 0; !status && round < dse_high_gain_ekf_rounds(&network->filter[0]); round++)
        status = exchange(network, round);
    for (int i = 0; i < CSTR2_FILTERS && !status; i++)
        status = dse_high_gain_ekf_finish(&network->filter[i]);
    if (status)
        return status;
    collect_estimates(network);
    dse_real scratch[DSE_RK4_SCRATCH(CSTR2_STATES)];
    network->k++;
    return dse_rk4_model_step(&network->model, t, GOLDEN_PERIOD, network->u, network->x, scratch);
}
