/* Sensors on a graph. */
#include <stdio.h>

#include "methods/sensor_network.h"

static int group_index(const struct sensor_network *sensors, int node)
{
    return sensors->group != NULL ? (int)sensors->group[node] : node;
}

int sensor_network_nodes(const struct method_setup *setup, const struct sensor_network *sensors)
{
    if (setup->graph != NULL)
        return setup->graph->nodes;
    return sensors->group != NULL ? (int)sensors->count : setup->process->n_subsystems;
}

bool sensor_network_check(const struct method_setup *setup, const struct sensor_network *sensors,
                          struct error *error)
{
    const char *file = setup->scenario->file, *network = setup->network->name;
    int nodes = sensor_network_nodes(setup, sensors);
    int groups = setup->process->n_subsystems;
    if (sensors->group != NULL && (int)sensors->count != nodes)
        return error_set(error, "%s: networks.%s: sensors has %u entries; the graph has %d nodes",
                         file, network, sensors->count, nodes);
    for (int i = 0; i < nodes; i++)
        if (group_index(sensors, i) >= groups)
            return error_set(error,
                             "%s: networks.%s: node %d reads sensor group %d; plant %s has the "
                             "groups 0 to %d%s",
                             file, network, i, group_index(sensors, i), setup->process->name,
                             groups - 1, sensors->group == NULL ? " (see sensors)" : "");
    return true;
}

const struct dse_subsystem *sensor_network_group(const struct method_setup *setup,
                                                 const struct sensor_network *sensors, int node)
{
    return &setup->process->subsystems[group_index(sensors, node)];
}

void sensor_network_describe(const struct method_setup *setup, const struct sensor_network *sensors,
                             struct method_info *info)
{
    const struct method_graph *graph = setup->graph;
    int i = setup->node;
    snprintf(info->name, sizeof info->name, "sensor %d", i);
    info->n_groups = 1;
    info->groups[0] = group_index(sensors, i);
    if (graph == NULL)
        return;
    for (int k = graph->in_first[i]; k < graph->in_first[i + 1]; k++)
        info->neighbours[info->n_neighbours++] = graph->in[k];
    for (int k = graph->out_first[i]; k < graph->out_first[i + 1]; k++)
        info->listeners[info->n_listeners++] = graph->out[k];
}

int sensor_network_hold(const unsigned *hold)
{
    if (hold == NULL)
        return 0;
    return *hold > 0 ? (int)*hold : -1;
}

int sensor_network_place(const int *list, int count, int node)
{
    int low = 0, high = count;
    while (low < high) {
        int middle = low + (high - low) / 2;
        if (list[middle] < node)
            low = middle + 1;
        else
            high = middle;
    }
    return low < count && list[low] == node ? low : -1;
}
