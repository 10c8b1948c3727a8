/* A scenario's networks: which method, how many nodes. */
#ifndef DSE_RUNTIME_NETWORKS_H
#define DSE_RUNTIME_NETWORKS_H

#include <stdbool.h>

#include "methods/method.h"

/* The method of a network, and what its nodes have in common; `prepared` and `node` are left to be
 * filled. NULL and an error text when the network names no method. */
const struct method *network_method(const struct scenario *scenario, int network,
                                    struct method_setup *setup, struct error *error);

/* Number of nodes of a network, the coordinator included; *coordinator (may be NULL): whether the
 * last one is a coordinator. -1 and an error text on failure. */
int network_nodes(const struct scenario *scenario, int network, bool *coordinator,
                  struct error *error);

#endif
