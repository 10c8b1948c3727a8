/* What a node of the distributed Kalman filters says to whom: its listeners' projections of the
 * estimate, those for equal sensors once, and where in a neighbour's message its own stands. */
#include <stdlib.h>
#include <string.h>

#include "methods/distributed_kalman_node.h"

const struct dse_subsystem *distributed_kalman_group(const struct method_setup *setup, int node)
{
    const struct sensor_network sensors = distributed_kalman_sensors(setup->section);
    return sensor_network_group(setup, &sensors, node);
}

static bool same_sensors(const struct distributed_kalman_node *node,
                         const struct method_setup *setup, int a, int b)
{
    const struct dse_subsystem *one = distributed_kalman_group(setup, a),
                               *other = distributed_kalman_group(setup, b);
    const int nx = setup->process->nx;
    bool same = one->n_outputs == other->n_outputs;
    for (int l = 0; same && l < one->n_outputs; l++)
        same = memcmp(node->C + one->outputs[l] * nx, node->C + other->outputs[l] * nx,
                      (size_t)nx * sizeof *node->C) == 0;
    return same;
}

/* The listeners of node i whose sensors differ, in the order in which it speaks of them. */
static int voices_of(const struct distributed_kalman_node *node, const struct method_setup *setup,
                     int i, int *voices)
{
    const struct method_graph *graph = setup->graph;
    int n = 0;
    for (int k = graph->out_first[i]; k < graph->out_first[i + 1]; k++) {
        int v = 0;
        while (v < n && !same_sensors(node, setup, voices[v], graph->out[k]))
            v++;
        if (v == n)
            voices[n++] = graph->out[k];
    }
    return n;
}

/* Where a message of `from` has the values for this node. */
static int offset_in(const struct distributed_kalman_node *node, const struct method_setup *setup,
                     int from, int *voices)
{
    int n = voices_of(node, setup, from, voices);
    int offset = 0;
    for (int v = 0; v < n && !same_sensors(node, setup, voices[v], setup->node); v++)
        offset += distributed_kalman_group(setup, voices[v])->n_outputs;
    return offset;
}

bool distributed_kalman_says_states(const struct distributed_kalman_section *section)
{
    return section->message == DSE_DKF_FULL || section->scheme == DSE_DKF_STANDARD;
}

/* Everything that differs between listeners in one message. */
static bool message_fits(const struct distributed_kalman_node *node,
                         const struct method_setup *setup, struct error *error)
{
    int values = 0;
    for (int v = 0; v < node->n_voices; v++)
        values += distributed_kalman_group(setup, node->voices[v])->n_outputs;
    return values <= METHOD_MESSAGE_CAPACITY || distributed_kalman_says_states(node->section) ||
           error_set(error,
                     "%s: networks.%s: node %d would say %d values to its listeners; at most %d "
                     "fit into a message; use message: full",
                     setup->scenario->file, setup->network->name, setup->node, values,
                     METHOD_MESSAGE_CAPACITY);
}

bool distributed_kalman_find_voices(struct distributed_kalman_node *node,
                                    const struct method_setup *setup, struct error *error)
{
    const struct method_graph *graph = setup->graph;
    const int i = setup->node;
    if (node->section->scheme == DSE_DKF_ALONE)
        return true;
    int *voices = calloc((size_t)node->nodes + 1, sizeof *voices);
    node->voices = calloc((size_t)node->nodes + 1, sizeof *node->voices);
    node->ears = calloc((size_t)node->nodes + 1, sizeof *node->ears);
    bool ok = voices != NULL && node->voices != NULL && node->ears != NULL;
    if (ok)
        node->n_voices = voices_of(node, setup, i, node->voices);
    for (int k = graph->in_first[i]; ok && k < graph->in_first[i + 1]; k++) {
        struct distributed_kalman_ear *ear = &node->ears[node->n_ears++];
        ear->from = graph->in[k];
        ear->offset = distributed_kalman_says_states(node->section)
                          ? 0
                          : offset_in(node, setup, graph->in[k], voices);
    }
    free(voices);
    if (!ok)
        return error_set(error, "out of memory");
    return message_fits(node, setup, error);
}
