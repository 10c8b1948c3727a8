/* The flow benchmark seen through the modes of its reduced models: the true plant behind
 * cavity_free and cavity_forced when a scenario asks for `integrator: {kind: flow}`. The fields are
 * integrated, states are their projections on the modes, and sensors read the fields themselves. */
#ifndef DSE_SIM_FLOW_MODES_H
#define DSE_SIM_FLOW_MODES_H

#include <stdbool.h>

#include "sim/flow.h"

#define SIM_FLOW_MODES         10 /* 4 of velocity, 3 of contaminant, 3 of temperature */
#define SIM_FLOW_OUTPUTS       12 /* 4 sensors: u + v, c, T */
#define SIM_FLOW_ALL_SNAPSHOTS ((SIM_FLOW_RUNS - 1) * SIM_FLOW_SNAPSHOTS)

/* mode = sum of weight times snapshot, snapshots in the order of runs 1 to 3. */
extern const double sim_flow_weights_free[SIM_FLOW_MODES][SIM_FLOW_ALL_SNAPSHOTS];
extern const double sim_flow_weights_forced[SIM_FLOW_MODES][SIM_FLOW_ALL_SNAPSHOTS];

struct sim_flow_plant;

/* The flow of the plant of that name at the start of a run. Simulates the snapshots' runs anew to
 * have the modes. NULL: the plant is no flow, there is no such run or no memory. */
struct sim_flow_plant *sim_flow_plant_create(const char *plant, int run);
void sim_flow_plant_destroy(struct sim_flow_plant *flow); /* may be NULL */
/* In equal Runge-Kutta steps of at most SIM_FLOW_DT. */
void sim_flow_plant_advance(struct sim_flow_plant *flow, double period);
/* x (SIM_FLOW_MODES): projections; y (SIM_FLOW_OUTPUTS): what the sensors read, without noise. */
void sim_flow_plant_state(const struct sim_flow_plant *flow, double *x);
void sim_flow_plant_outputs(const struct sim_flow_plant *flow, double *y);

#endif
