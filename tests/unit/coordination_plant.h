/* A random plant of subsystems in a chain, its data, and its windows as dense matrices: what the
 * tests of the coordination schemes compare with. */
#ifndef COORDINATION_PLANT_H
#define COORDINATION_PLANT_H

#include "coordination_rig.h"

enum {
    PLANT_PARTS = 3,
    PLANT_NX = 2,                     /* of a subsystem */
    PLANT_N = PLANT_PARTS * PLANT_NX, /* of the plant */
    PLANT_SAMPLES = 40,
    PLANT_H = 6,                       /* longest window */
    PLANT_X = PLANT_H * PLANT_N,       /* stacked states */
    PLANT_W = (PLANT_H - 1) * PLANT_N, /* stacked disturbances */
    PLANT_BLOCK = PLANT_NX * PLANT_NX
};

struct coordination_plant {
    dse_real A[PLANT_N * PLANT_N];
    dse_real A_ii[PLANT_PARTS][PLANT_BLOCK], C[PLANT_PARTS][PLANT_NX];
    dse_real Q[PLANT_PARTS][PLANT_BLOCK], R[PLANT_PARTS][1], D[PLANT_PARTS][PLANT_BLOCK];
    dse_real x0[PLANT_N];
    struct dse_mhe_subsystem subsystems[PLANT_PARTS];
    dse_real y[PLANT_SAMPLES][PLANT_PARTS]; /* outputs, */
    dse_real x[PLANT_SAMPLES][PLANT_N];     /* and the states behind them */
};

/* Not the same plant each time: draws from the program's random sequence. coupling: size of the
 * blocks beside the diagonal. */
void coordination_plant_make(struct coordination_plant *plant, dse_real coupling);
/* Sets D = d I for all. */
void coordination_plant_penalise(struct coordination_plant *plant, dse_real d);
/* net, zeroed but for what belongs to the plant; horizon PLANT_H, min_horizon 2. */
void coordination_plant_network(const struct coordination_plant *plant, enum dse_mhe_scheme scheme,
                                dse_real eps, struct coordination *net);

/* A full window of H samples up to k, stacked by subsystem; all outputs there. Leading dimension of
 * everything: its number of columns. */
struct coordination_window {
    int H, states, transitions;
    dse_real GA[PLANT_W * PLANT_X]; /* G_A X = W */
    dse_real Gb[PLANT_W * PLANT_X]; /* its part within subsystems */
    dse_real Th[PLANT_W * PLANT_X]; /* GA - Gb */
    dse_real MC[PLANT_X * PLANT_X];
    dse_real Qi[PLANT_W * PLANT_W], Di[PLANT_W * PLANT_W];
    dse_real c[PLANT_X];
    dse_real Psi[PLANT_X * PLANT_X]; /* MC + GA' Qi GA */
};
void coordination_window_make(const struct coordination_plant *plant, int H, long k,
                              struct coordination_window *window);
/* X with (Psi + with_D Th'Di Th) X = c. */
void coordination_window_solve(const struct coordination_window *window, bool with_D, dse_real *X);
/* The agents' windows as a stack. */
void coordination_stack(const struct coordination *net, dse_real *X);

#endif
