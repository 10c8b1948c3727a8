/* One estimator node as an agent: joins the run, collects the inputs and measurements of a sample,
 * runs the method's rounds with its neighbours, publishes the estimate. */
#ifndef DSE_RUNTIME_NODE_H
#define DSE_RUNTIME_NODE_H

#include <stdint.h>

#include "methods/method.h"
#include "runtime/agent.h"
#include "runtime/scenario.h"

struct node_config {
    const struct scenario *scenario; /* outlives the node */
    int network;                     /* index in scenario->networks */
    int node;                        /* index within the network */
    int pace;                        /* DSE_CLOCK_T_PACE_* */
    double speed;                    /* realtime: plant seconds per second, 0: 1 */
    int64_t run_id;                  /* 0: that of the first run of this scenario that asks to join;
                                        in replay: one derived from the recorded run */
};

/* Fills `agent`. False and an error text when the node cannot be made. */
bool node_create(const struct node_config *config, struct bus *bus, struct agent *agent,
                 struct error *error);

/* What the node estimates, hears and needs. */
const struct method_info *node_info(const struct agent *agent);
/* FNV-1a over the bits of all its estimates so far, and how many there are. */
uint64_t node_estimate_hash(const struct agent *agent, int64_t *samples);

#endif
