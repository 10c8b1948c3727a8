/* Making a node: its method's object, its memory, its subscriptions. */
#include <stdio.h>
#include <stdlib.h>
#include <sys/random.h>
#include <unistd.h>

#include "runtime/channels.h"
#include "runtime/fingerprint.h"
#include "runtime/networks.h"
#include "runtime/node_internal.h"

static void destroy(void *self)
{
    struct node *node = self;
    if (node == NULL)
        return;
    if (node->instance != NULL && node->method != NULL)
        node->method->destroy(node->instance);
    node_samples_destroy(node);
    node_rounds_destroy(node);
    announcement_free(&node->announcement);
    free(node->values);
    free(node->prepared);
    free(node);
}

static bool subscribe(struct node *node, struct error *error)
{
    char channel[CHANNEL_LENGTH];
    bool ok = bus_subscribe(node->bus, CHANNEL_CLOCK, node_on_clock, node, error) &&
              bus_subscribe(node->bus, CHANNEL_STATUS, node_on_status, node, error) &&
              bus_subscribe(node->bus, CHANNEL_INPUT, node_on_input, node, error);
    for (int g = 0; ok && g < node->info.n_groups; g++) {
        snprintf(channel, sizeof channel, CHANNEL_MEASUREMENT, node->info.groups[g]);
        ok = bus_subscribe(node->bus, channel, node_on_measurement, node, error);
    }
    /* Those that it hears, and those that hear it: they may ask for what they missed. */
    bool *linked = calloc(METHOD_MAX_NODES, sizeof *linked);
    ok = ok && linked != NULL;
    for (int j = 0; ok && j < node->info.n_neighbours; j++)
        linked[node->info.neighbours[j]] = true;
    for (int j = 0; ok && j < node->info.n_listeners; j++)
        linked[node->info.listeners[j]] = true;
    for (int j = 0; ok && j < METHOD_MAX_NODES; j++) {
        if (!linked[j])
            continue;
        snprintf(channel, sizeof channel, CHANNEL_EXCHANGE, node->config.network, j);
        ok = bus_subscribe(node->bus, channel, node_on_exchange, node, error);
    }
    free(linked);
    return ok;
}

static bool make_instance(struct node *node, struct error *error)
{
    const struct dse_plant *process = node->setup.process;
    node->values = calloc((size_t)process->n_parameters + 1, sizeof *node->values);
    node->prepared = calloc((size_t)process->prepared_size + 1, sizeof *node->prepared);
    if (node->values == NULL || node->prepared == NULL)
        return error_set(error, "out of memory");
    if (!scenario_prepare_plant(node->config.scenario, node->network, node->values, node->prepared,
                                error))
        return false;
    node->setup.prepared = node->prepared;
    node->setup.node = node->config.node;
    node->instance = node->method->create(&node->setup, &node->info, error);
    if (node->instance == NULL)
        return error_set(error, "cannot make node %d of network %s", node->config.node,
                         node->network->name);
    return true;
}

static bool set_identity(struct node *node, struct error *error)
{
    bool coordinator;
    int nodes = network_nodes(node->config.scenario, node->config.network, &coordinator, error);
    if (nodes < 0)
        return false;
    if (node->config.node < 0 || node->config.node >= nodes)
        return error_set(error, "network %s has the nodes 0 to %d: there is no node %d",
                         node->network->name, nodes - 1, node->config.node);
    bool is_coordinator = coordinator && node->config.node == nodes - 1;
    node->sender.bus = node->bus;
    node->sender.id.run_id = node->config.run_id;
    node->sender.id.network = (int8_t)node->config.network;
    node->sender.id.node = (int16_t)node->config.node;
    node->sender.id.role =
        is_coordinator ? DSE_HEADER_T_ROLE_COORDINATOR : DSE_HEADER_T_ROLE_ESTIMATOR;
    if (node->config.pace != DSE_CLOCK_T_PACE_REPLAY)
        node->source_run = node->config.run_id;
    node->estimate_hash = FINGERPRINT_START;
    if (getrandom(&node->instance_id, sizeof node->instance_id, 0) < 0)
        node->instance_id = (int64_t)getpid();
    return true;
}

bool node_create(const struct node_config *config, struct bus *bus, struct agent *agent,
                 struct error *error)
{
    struct node *node = calloc(1, sizeof *node);
    if (node == NULL)
        return error_set(error, "out of memory");
    node->config = *config;
    node->bus = bus;
    node->network = &config->scenario->networks[config->network];
    node->method = network_method(config->scenario, config->network, &node->setup, error);
    bool ok = node->method != NULL && set_identity(node, error) && make_instance(node, error) &&
              node_samples_create(node, error) && node_rounds_create(node, error) &&
              subscribe(node, error);
    if (!ok) {
        destroy(node);
        return error_set(error, "cannot make node %d of network %d", config->node, config->network);
    }
    snprintf(node->name, sizeof node->name, "node %d (%.40s) of network %.20s", config->node,
             node->info.name, node->network->name);
    snprintf(agent->name, sizeof agent->name, "%s", node->name);
    agent->self = node;
    agent->poll = node_poll;
    agent->state = node_state;
    agent->reason = node_reason;
    agent->stop = node_stop;
    agent->destroy = destroy;
    return true;
}

const struct method_info *node_info(const struct agent *agent)
{
    return &((const struct node *)agent->self)->info;
}

uint64_t node_estimate_hash(const struct agent *agent, int64_t *samples)
{
    const struct node *node = agent->self;
    *samples = node->k;
    return node->estimate_hash;
}
