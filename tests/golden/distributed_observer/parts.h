/* From the reference's matrices to a network of observers. */
#ifndef DISTRIBUTED_OBSERVER_PARTS_H
#define DISTRIBUTED_OBSERVER_PARTS_H

#include <jansson.h>

#include "observer_rig.h"

/* Matrices of one node as the library wants them, in raw measurements and inputs. */
struct matrices {
    double Lambda[RIG_STATES * RIG_STATES], L[RIG_STATES * RIG_OUTPUTS];
    double H[RIG_STATES * RIG_OUTPUTS], M[RIG_STATES * RIG_STATES], N[RIG_STATES * RIG_OUTPUTS];
    double J[RIG_STATES * RIG_OUTPUTS], Pi[RIG_STATES * RIG_STATES], C2[RIG_ROWS * RIG_STATES];
    double D[RIG_ROWS * RIG_STATES], D_y[RIG_ROWS * RIG_OUTPUTS], D_u[RIG_ROWS * RIG_OUTPUTS];
    double C[RIG_OUTPUTS * RIG_STATES], z0[RIG_STATES];
};

/* A run of a file: the rig with its nodes configured and connected, not started. False: this file
 * or law is not known. functional: the row of the plant's state that is estimated, or NULL. */
bool make_network(struct rig *rig, struct matrices *store, const json_t *root, const json_t *run,
                  const double **functional);

#endif
