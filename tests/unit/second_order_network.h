/* A network of second-order filters in one process: messages handed over in memory. A test fills
 * `base`, the adjacency, the sensors and the starts, calls network_make, and then for each sample
 * network_sample. */
#ifndef SECOND_ORDER_NETWORK_H
#define SECOND_ORDER_NETWORK_H

#include <stddef.h>

#include "dse/distributed_second_order.h"

#ifndef NETWORK_NODES /* who has little memory says less beforehand */
#define NETWORK_NODES 6
#define NETWORK_NX    10
#define NETWORK_NY    3
#endif
enum { NETWORK_STORAGE = DSE_DSO_STORAGE(NETWORK_NX, NETWORK_NY, NETWORK_NODES - 1) };

struct second_order_network {
    /* filled by the test: */
    struct dse_dso_config base; /* what all nodes share; n_neighbours and nodes are set by make */
    int nodes;
    bool hears[NETWORK_NODES][NETWORK_NODES];
    dse_real C[NETWORK_NODES][NETWORK_NY * NETWORK_NX];
    dse_real w0[NETWORK_NODES][NETWORK_NX];

    /* per sample: */
    bool lost[NETWORK_NODES][NETWORK_NODES]; /* i does not hear j */
    bool off[NETWORK_NODES];                 /* node's sensor */
    bool mute[NETWORK_NODES];

    struct dse_dso_config config[NETWORK_NODES];
    struct dse_dso node[NETWORK_NODES];
    dse_real memory[NETWORK_NODES][NETWORK_STORAGE];
    dse_real message[NETWORK_NODES][DSE_DSO_MESSAGE(NETWORK_NX, NETWORK_NY)];
};

static inline enum dse_status network_make(struct second_order_network *network)
{
    for (int i = 0; i < network->nodes; i++) {
        struct dse_dso_config *config = &network->config[i];
        struct dse_arena arena;
        *config = network->base;
        config->filter.C = network->C[i];
        config->filter.x0 = network->w0[i];
        config->nodes = network->nodes;
        config->n_neighbours = 0;
        for (int j = 0; j < network->nodes; j++)
            config->n_neighbours += network->hears[i][j];
        dse_arena_init(&arena, network->memory[i], NETWORK_STORAGE);
        const enum dse_status status = dse_dso_init(&network->node[i], config, &arena);
        if (status != DSE_OK)
            return status;
    }
    return DSE_OK;
}

static inline void network_hand_over(struct second_order_network *network)
{
    int count[NETWORK_NODES] = {0};
    for (int i = 0; i < network->nodes; i++)
        count[i] = dse_dso_message(&network->node[i], network->message[i]);
    for (int i = 0; i < network->nodes; i++) {
        int place = 0;
        for (int j = 0; j < network->nodes; j++) {
            if (!network->hears[i][j])
                continue;
            if (count[j] > 0 && !network->lost[i][j] && !network->mute[j])
                dse_dso_receive(&network->node[i], place, network->message[j], count[j]);
            place++;
        }
    }
}

/* m: nodes x ny. The first error of any node; the others go on. */
static inline enum dse_status network_sample(struct second_order_network *network, dse_real t,
                                             const dse_real *m)
{
    static const bool nothing[NETWORK_NY] = {false};
    const int ny = network->node[0].filter.ny;
    enum dse_status worst = DSE_OK;
    for (int i = 0; i < network->nodes; i++) {
        const struct dse_measurement measurement = {m + i * ny, network->off[i] ? nothing : NULL};
        const enum dse_status status = dse_dso_begin(&network->node[i], t, NULL, &measurement);
        worst = worst == DSE_OK ? status : worst;
    }
    for (int r = 0; r < dse_dso_rounds(&network->node[0]); r++) {
        network_hand_over(network);
        for (int i = 0; i < network->nodes; i++) {
            const enum dse_status status = dse_dso_end_round(&network->node[i]);
            worst = worst == DSE_OK ? status : worst;
        }
    }
    return worst;
}

#endif
