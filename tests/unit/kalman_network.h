/* A network of distributed Kalman filters in one process: messages handed over in memory. A test
 * fills `base`, the sensors and the starts, calls network_make, and then for each sample
 * network_hear (the exchange; the states are then those of the sample) and network_advance. */
#ifndef KALMAN_NETWORK_H
#define KALMAN_NETWORK_H

#include <stddef.h>

#include "dse/distributed_kalman.h"
#include "dse/graph.h"
#include "dse/math.h"

enum {
    NETWORK_NODES = 50,
    NETWORK_EDGES = 458,
    NETWORK_IN = 14, /* largest in-degree */
    NETWORK_NX = 4,
    NETWORK_NY = 2,
    NETWORK_STORAGE = DSE_DKF_STORAGE_LYAPUNOV(NETWORK_NX, NETWORK_NY, NETWORK_IN),
    NETWORK_GRAPH = DSE_GRAPH_STORAGE(NETWORK_NODES, NETWORK_EDGES)
};

struct kalman_network {
    /* filled by the test: */
    struct dse_dkf_config base; /* what all nodes share */
    int nodes;
    dse_real C[NETWORK_NODES][NETWORK_NY * NETWORK_NX];
    dse_real R[NETWORK_NODES][NETWORK_NY * NETWORK_NY];
    dse_real x0[NETWORK_NODES][NETWORK_NX];
    const dse_real *K[NETWORK_NODES], *D[NETWORK_NODES]; /* NULL: as in base */

    /* during a run: */
    bool mute[NETWORK_NODES]; /* says nothing */

    struct dse_model model;
    struct dse_graph graph;
    struct dse_dkf_sensor listeners[NETWORK_EDGES];
    struct dse_dkf_config config[NETWORK_NODES];
    struct dse_dkf node[NETWORK_NODES];
    dse_real memory[NETWORK_NODES][NETWORK_STORAGE];
    dse_real graph_memory[NETWORK_GRAPH];
};

/* A(t) = [[-0.15 + 0.4 sin t, -2], [2, 0]]                                                  (5.1)
 */
static inline enum dse_status swinging_A(const struct dse_model *model, dse_real t,
                                         const dse_real *x, const dse_real *u, dse_real *A)
{
    (void)x, (void)u;
    const dse_real *swing = (const dse_real *)model->parameters; /* NULL: time-invariant */
    A[0] = DSE_REAL(-0.15) + (swing != NULL ? *swing * dse_sin(t) : 0);
    A[1] = -2;
    A[2] = 2;
    A[3] = 0;
    return DSE_OK;
}

static inline struct dse_model swinging_plant(void)
{
    static const dse_real swing = DSE_REAL(0.4);
    return (struct dse_model){
        .time = DSE_CONTINUOUS, .nx = 2, .ny = 1, .parameters = &swing, .dfdx = swinging_A};
}

/* Sensor type of the source: 1: C = [1 0], 2: C = [0 1]. */
static inline void network_sense(struct kalman_network *network, int i, int type)
{
    network->C[i][0] = type == 1;
    network->C[i][1] = type == 2;
}

static inline enum dse_status network_make(struct kalman_network *network, int count,
                                           const int *pairs, bool undirected)
{
    struct dse_arena arena;
    struct dse_dkf_sensor sensors[NETWORK_NODES];
    dse_arena_init(&arena, network->graph_memory, NETWORK_GRAPH);
    enum dse_status status =
        dse_graph_make(&network->graph, network->nodes, count, pairs, undirected, &arena);
    const struct dse_graph *graph = &network->graph;
    for (int i = 0; i < network->nodes; i++)
        sensors[i] = (struct dse_dkf_sensor){network->base.sensor.ny, network->C[i]};
    for (int k = 0; status == DSE_OK && k < graph->edges; k++)
        network->listeners[k] = sensors[graph->out[k]];
    for (int i = 0; status == DSE_OK && i < network->nodes; i++) {
        struct dse_dkf_config *config = &network->config[i];
        *config = network->base;
        config->model = &network->model;
        config->sensor = sensors[i];
        config->n_neighbours = dse_graph_in_degree(graph, i);
        config->n_listeners = dse_graph_out_degree(graph, i);
        config->listeners = network->listeners + graph->out_first[i];
        config->x0 = network->x0[i];
        config->R = network->R[i];
        config->K = network->K[i] != NULL ? network->K[i] : network->base.K;
        config->D = network->D[i] != NULL ? network->D[i] : network->base.D;
        dse_arena_init(&arena, network->memory[i], NETWORK_STORAGE);
        status = dse_dkf_init(&network->node[i], config, &arena);
        network->mute[i] = false;
    }
    return status;
}

/* Messages of all nodes to all that hear them, in the order of the lists. */
static inline enum dse_status network_exchange(struct kalman_network *network)
{
    const struct dse_graph *graph = &network->graph;
    enum dse_status worst = DSE_OK;
    dse_real message[DSE_DKF_MESSAGE(NETWORK_NX, NETWORK_NY)];
    for (int i = 0; i < network->nodes; i++) {
        for (int k = graph->in_first[i]; k < graph->in_first[i + 1]; k++) {
            const int j = graph->in[k];
            if (network->mute[j])
                continue;
            const int count =
                dse_dkf_message(&network->node[j], dse_graph_out_place(graph, j, i), message);
            const enum dse_status status =
                dse_dkf_receive(&network->node[i], k - graph->in_first[i], message, count);
            worst = status != DSE_OK ? status : worst;
        }
    }
    return worst;
}

static inline enum dse_status network_add_up(struct kalman_network *network)
{
    const int square = network->base.sensor.ny * network->base.sensor.ny;
    dse_real sum[NETWORK_NY * NETWORK_NY] = {0}, term[NETWORK_NY * NETWORK_NY];
    enum dse_status worst = DSE_OK;
    for (int i = 0; i < network->nodes; i++) {
        dse_dkf_global_term(&network->node[i], term);
        for (int k = 0; k < square; k++)
            sum[k] += term[k];
    }
    for (int i = 0; i < network->nodes; i++) {
        const enum dse_status status = dse_dkf_global_sum(&network->node[i], sum);
        worst = status != DSE_OK ? status : worst;
    }
    return worst;
}

/* Sample at t with the measurements y (nodes x ny; NaN: missing) and the whole exchange. The last
 * status that was not OK, else OK. */
static inline enum dse_status network_hear(struct kalman_network *network, dse_real t,
                                           const dse_real *y)
{
    enum dse_status worst = DSE_OK;
    for (int i = 0; i < network->nodes; i++) {
        const struct dse_measurement sample = {y + i * network->base.sensor.ny, NULL};
        const enum dse_status status = dse_dkf_begin(&network->node[i], t, NULL, &sample);
        worst = status != DSE_OK ? status : worst;
    }
    enum dse_status status = network_exchange(network);
    if (status == DSE_OK && network->base.scheme == DSE_DKF_GLOBAL)
        status = network_add_up(network);
    worst = status != DSE_OK ? status : worst;
    for (int i = 0; i < network->nodes; i++) {
        status = dse_dkf_correct(&network->node[i]);
        worst = status != DSE_OK ? status : worst;
    }
    return worst;
}

static inline enum dse_status network_advance(struct kalman_network *network)
{
    enum dse_status worst = DSE_OK;
    for (int i = 0; i < network->nodes; i++) {
        const enum dse_status status = dse_dkf_advance(&network->node[i]);
        worst = status != DSE_OK ? status : worst;
    }
    return worst;
}

/* Noise-free or held-noise plant: x(t + h) of x' = A(t) x + w by one Runge-Kutta step. */
struct noisy_plant {
    const struct dse_model *model;
    const dse_real *w; /* nx, held */
};

static inline enum dse_status noisy_rate(void *context, dse_real t, const dse_real *x, dse_real *dx)
{
    const struct noisy_plant *plant = (const struct noisy_plant *)context;
    dse_real A[NETWORK_NX * NETWORK_NX];
    const int n = plant->model->nx;
    const enum dse_status status = plant->model->dfdx(plant->model, t, x, NULL, A);
    dse_mat_vec(n, n, A, x, dx);
    for (int i = 0; plant->w != NULL && i < n; i++)
        dx[i] += plant->w[i];
    return status;
}

static inline enum dse_status plant_step(const struct dse_model *model, dse_real t, dse_real h,
                                         const dse_real *w, dse_real *x)
{
    struct noisy_plant plant = {model, w};
    dse_real scratch[DSE_RK4_SCRATCH(NETWORK_NX)];
    return dse_rk4_step(noisy_rate, &plant, t, h, model->nx, x, scratch);
}

#endif
