/* A plant and a network of distributed observers, integrated as one system: for the claims about
 * the laws themselves, apart from sampling. */
#ifndef OBSERVER_RIG_H
#define OBSERVER_RIG_H

#include "dse/distributed_observer.h"

enum {
    RIG_NODES = 6,
    RIG_DEGREE = 5,  /* neighbours of a node */
    RIG_STATES = 4,  /* of the plant, observer states and estimates */
    RIG_OUTPUTS = 2, /* measurements of every node, and inputs */
    RIG_ROWS = 4,    /* compared rows, rows of a residual */
    RIG_GAINS = RIG_DEGREE * RIG_ROWS * RIG_ROWS,
    RIG_STORAGE = DSE_DISTRIBUTED_OBSERVER_STORAGE(RIG_STATES, RIG_OUTPUTS, RIG_OUTPUTS, RIG_STATES,
                                                   RIG_DEGREE, RIG_DEGREE *RIG_ROWS, RIG_ROWS)
};

/* E x' = A x + B u + F v solved for its differential states. */
struct rig_plant {
    int nx, nd; /* states, differential ones among them (the first) */
    /* u (2) at t; a jump within the step that begins at t0 comes only behind it. */
    void (*input)(dse_real t, dse_real t0, dse_real *u);
    /* x (nx) from the differential states xd. */
    void (*state)(const dse_real *xd, const dse_real *u, dse_real *x);
    /* xd' */
    void (*derivative)(dse_real t, const dse_real *x, const dse_real *u, dse_real *dxd);
};

extern const struct rig_plant rig_descriptor_uio; /* spec 5.2 */
extern const struct rig_plant rig_descriptor_fo;  /* spec 5.3 */
extern const struct rig_plant rig_full_order_uio; /* the chosen example of 4.6 */
extern const struct rig_plant rig_full_order_fo;  /* and of 4.9 */

struct rig {
    const struct rig_plant *plant;
    int n; /* nodes */
    struct dse_distributed_observer_config config[RIG_NODES];
    struct dse_distributed_observer node[RIG_NODES];
    struct dse_observer_rows theirs[RIG_NODES][RIG_DEGREE];
    const dse_real *C[RIG_NODES];         /* 2 x nx: sensors */
    int neighbour[RIG_NODES][RIG_DEGREE]; /* whom a node hears, ascending */
    dse_real t, t0;                       /* now, and where the step began */
    dse_real state[RIG_STATES + RIG_NODES * (RIG_STATES + RIG_GAINS)]; /* plant, then nodes */
    dse_real memory[RIG_NODES][RIG_STORAGE];
};

/* Directed edges (from, to): fills neighbours in config and lists, and theirs from C2 and the rows
 * of each node. C2[i] NULL: all of the estimate. */
void rig_connect(struct rig *rig, int edges, const int (*edge)[2], const dse_real *const *C2,
                 const int *rows);
/* Initialises the nodes and puts the plant at xd0. */
enum dse_status rig_start(struct rig *rig, const dse_real *xd0);
/* One Runge-Kutta step of everything. */
enum dse_status rig_step(struct rig *rig, dse_real h);

/* Where node i's z and Gamma are. */
dse_real *rig_node(struct rig *rig, int i);
/* The plant's state and inputs, node i's measurements and estimate, now. */
void rig_truth(struct rig *rig, dse_real *x, dse_real *u);
void rig_measure(struct rig *rig, int i, dse_real *y);
void rig_estimate(struct rig *rig, int i, dse_real *xh);

#endif
