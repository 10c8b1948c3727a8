/* A network of consensus Kalman filters in one process: messages handed over in memory. A test
 * fills `base`, the sensors and the starts, calls ckf_network_make, and then for each sample
 * ckf_network_sample (the states are then those of the sample) and ckf_network_advance. */
#ifndef CONSENSUS_NETWORK_H
#define CONSENSUS_NETWORK_H

#include <stddef.h>

#include "dse/consensus_kalman.h"
#include "dse/graph.h"
#include "dse/random.h"

#ifndef CKF_NODES /* who has little memory says less beforehand */
#define CKF_NODES 20
#define CKF_NX    4
#define CKF_NY    2
#endif
enum {
    CKF_EDGES = CKF_NODES * (CKF_NODES - 1),
    CKF_ROOM = DSE_CKF_STORAGE(CKF_NX, CKF_NY, CKF_NODES - 1, CKF_NODES)
};

struct ckf_network {
    /* filled by the test: */
    struct dse_ckf_config base; /* what all nodes share; ny is that of all */
    dse_real A[CKF_NX * CKF_NX];
    int nodes;
    dse_real C[CKF_NODES][CKF_NY * CKF_NX];

    /* during a run: */
    bool deaf[CKF_NODES][CKF_NODES]; /* [i][j]: i does not hear j */

    struct dse_linear linear;
    struct dse_model model;
    struct dse_graph graph;
    struct dse_ckf_config config[CKF_NODES];
    struct dse_ckf node[CKF_NODES];
    dse_real memory[CKF_NODES][CKF_ROOM];
    dse_real graph_memory[DSE_GRAPH_STORAGE(CKF_NODES, CKF_EDGES)];
};

/* Nodes along the `count` undirected links of `pairs`; largest_degree and nodes are filled in. */
static inline enum dse_status ckf_network_make(struct ckf_network *network, int nx, int count,
                                               const int *pairs)
{
    struct dse_arena arena;
    dse_arena_init(&arena, network->graph_memory, DSE_GRAPH_STORAGE(CKF_NODES, CKF_EDGES));
    enum dse_status status =
        dse_graph_make(&network->graph, network->nodes, count, pairs, true, &arena);
    if (status != DSE_OK)
        return status;
    network->linear = (struct dse_linear){.A = network->A};
    dse_linear_model(&network->model, DSE_DISCRETE, nx, 0, 0, &network->linear);
    network->base.model = &network->model;
    network->base.nodes = network->nodes;
    network->base.largest_degree = dse_graph_largest_in_degree(&network->graph);
    for (int i = 0; i < network->nodes && status == DSE_OK; i++) {
        network->config[i] = network->base;
        network->config[i].C = network->C[i];
        network->config[i].self = i;
        network->config[i].n_neighbours = dse_graph_in_degree(&network->graph, i);
        dse_arena_init(&arena, network->memory[i], CKF_ROOM);
        status = dse_ckf_init(&network->node[i], &network->config[i], &arena);
    }
    return status;
}

/* One round of all nodes; the first status that is not OK. */
static inline enum dse_status ckf_network_round(struct ckf_network *network)
{
    const struct dse_graph *graph = &network->graph;
    enum dse_status first = DSE_OK;
    for (int i = 0; i < network->nodes; i++) {
        for (int k = graph->in_first[i]; k < graph->in_first[i + 1]; k++) {
            dse_real message[DSE_CKF_MESSAGE(CKF_NX, CKF_NODES)];
            const int j = graph->in[k];
            const int count = dse_ckf_message(&network->node[j], message);
            if (network->deaf[i][j] || count == 0)
                continue;
            const enum dse_status status =
                dse_ckf_receive(&network->node[i], k - graph->in_first[i], message, count);
            first = first == DSE_OK ? status : first;
        }
    }
    for (int i = 0; i < network->nodes; i++) {
        const enum dse_status status = dse_ckf_end_round(&network->node[i]);
        first = first == DSE_OK ? status : first;
    }
    return first;
}

/* Sample k with the measurements y (nodes x ny; NaN: missing) and all its rounds. */
static inline enum dse_status ckf_network_sample(struct ckf_network *network, long k,
                                                 const dse_real *y)
{
    const int ny = network->base.ny;
    enum dse_status first = DSE_OK;
    for (int i = 0; i < network->nodes; i++) {
        const struct dse_measurement sample = {y + i * ny, NULL};
        const enum dse_status status =
            dse_ckf_begin(&network->node[i], k, (dse_real)k, NULL, &sample);
        first = first == DSE_OK ? status : first;
    }
    for (int r = 0; r < dse_ckf_rounds(&network->node[0]); r++) {
        const enum dse_status status = ckf_network_round(network);
        first = first == DSE_OK ? status : first;
    }
    return first;
}

static inline enum dse_status ckf_network_advance(struct ckf_network *network)
{
    enum dse_status first = DSE_OK;
    for (int i = 0; i < network->nodes; i++) {
        const enum dse_status status = dse_ckf_advance(&network->node[i]);
        first = first == DSE_OK ? status : first;
    }
    return first;
}

#endif
