/* The linear model of a plant in deviations from a steady state, cut into subsystems:
 *
 *     x(k+1) = A x(k) + w(k),   y(k) = C x(k) + v(k),   C block-diagonal.
 *
 * Of a nonlinear plant: its Jacobians at the steady state, discretised exactly. */
#ifndef DSE_METHODS_COORDINATED_MHE_PLANT_H
#define DSE_METHODS_COORDINATED_MHE_PLANT_H

#include "methods/method.h"

struct coordinated_mhe_plant {
    int n, ny, parts;
    int *state;        /* n: the plant's state at each place of the stack; part after part */
    int *output;       /* ny: likewise */
    int *first_state;  /* parts + 1: where each part begins */
    int *first_output; /* parts + 1 */
    dse_real *A;       /* n x n */
    dse_real *C;       /* ny x n */
    dse_real *origin;  /* n: steady state */
    dse_real *y;       /* ny: outputs there */
    void *memory;
};

/* One part per subsystem, or a single one with the whole plant. origin (plant order, may be NULL):
 * the steady state; NULL: that of a linear plant. False and an error text when the plant does not
 * fit. */
bool coordinated_mhe_plant_make(const struct method_setup *setup, bool whole, const double *origin,
                                struct coordinated_mhe_plant *plant, struct error *error);
void coordinated_mhe_plant_free(struct coordinated_mhe_plant *plant);

/* States and outputs of part i. */
int coordinated_mhe_plant_nx(const struct coordinated_mhe_plant *plant, int i);
int coordinated_mhe_plant_ny(const struct coordinated_mhe_plant *plant, int i);

#endif
