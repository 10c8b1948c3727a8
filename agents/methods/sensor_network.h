/* What methods share whose nodes are sensors on a graph: who reads which sensor group, who hears
 * whom. */
#ifndef DSE_METHODS_SENSOR_NETWORK_H
#define DSE_METHODS_SENSOR_NETWORK_H

#include "methods/method.h"

/* The key `sensors` of a section: the sensor group that each node reads; values NULL: node i reads
 * group i. */
struct sensor_network {
    const unsigned *group;
    unsigned count;
};

/* As many as the graph has; without one: as there are entries, or groups of the plant. */
int sensor_network_nodes(const struct method_setup *setup, const struct sensor_network *sensors);
/* Do graph, list and plant fit together? Errors name the key of the method's section. */
bool sensor_network_check(const struct method_setup *setup, const struct sensor_network *sensors,
                          struct error *error);
/* The group that a node reads, as the plant describes it. */
const struct dse_subsystem *sensor_network_group(const struct method_setup *setup,
                                                 const struct sensor_network *sensors, int node);
/* Name and sensors of setup->node; its neighbours and listeners by the graph. */
void sensor_network_describe(const struct method_setup *setup, const struct sensor_network *sensors,
                             struct method_info *info);
/* The key `hold` of a section: 0 is none, left out (NULL) the library's default; in the library's
 * words. */
int sensor_network_hold(const unsigned *hold);
/* Place of `node` in an ascending list, -1: it is not there. */
int sensor_network_place(const int *list, int count, int node);

#endif
