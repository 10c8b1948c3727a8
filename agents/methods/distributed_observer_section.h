/* The section `distributed_observer` of a network: matrices of the nodes as `dse design uio`,
 * `functional` and `luenberger` write them, under the names of dse/distributed_observer.h, and the
 * coupling. Times are in the plant's time unit. */
#ifndef DSE_METHODS_DISTRIBUTED_OBSERVER_SECTION_H
#define DSE_METHODS_DISTRIBUTED_OBSERVER_SECTION_H

#include "dse/distributed_observer.h"
#include "methods/sensor_network.h"
#include "runtime/error.h"
#include "runtime/scenario.h"

/* Matrices of a node, row by row; NULL where left out. nz, and the rows of C2 and D, follow from
 * the numbers of values. */
struct distributed_observer_design {
    double *Lambda; /* nz x nz */
    unsigned Lambda_count;
    double *L; /* nz x ny */
    unsigned L_count;
    double *H; /* nz x nu */
    unsigned H_count;
    double *M; /* nx x nz */
    unsigned M_count;
    double *N; /* nx x ny */
    unsigned N_count;
    double *J; /* nx x nu */
    unsigned J_count;
    double *z0; /* nz */
    unsigned z0_count;
    double *Pi; /* nz x nz */
    unsigned Pi_count;
    double *C2; /* rows x nx */
    unsigned C2_count;
    double *D; /* nr x nz */
    unsigned D_count;
    double *D_y; /* nr x ny */
    unsigned D_y_count;
    double *D_u; /* nr x nu */
    unsigned D_u_count;
};

enum distributed_observer_compare { DISTRIBUTED_OBSERVER_C2, DISTRIBUTED_OBSERVER_ALL };

struct distributed_observer_section {
    enum dse_observer_residual residual;
    enum dse_observer_gain gain;
    enum distributed_observer_compare compare;
    double gamma, leak, gain_max;
    unsigned *hold;   /* NULL: 3 */
    unsigned *states; /* estimated plant states, NULL: all */
    unsigned states_count;
    unsigned *sensors; /* one per node, NULL: node i reads group i */
    unsigned sensors_count;
    struct distributed_observer_design *nodes;
    unsigned nodes_count;
};

/* What follows from a node's matrices. */
struct distributed_observer_size {
    int nz, nu, ny, nx;
    int rows; /* of C2; nx where whole estimates are compared */
    int nr;   /* of the residual */
};

extern const cyaml_schema_field_t distributed_observer_fields[];
extern const struct scenario_rule distributed_observer_rules[];

struct sensor_network
distributed_observer_sensors(const struct distributed_observer_section *section);
/* Does the section fit plant and graph? */
bool distributed_observer_section_check(const struct method_setup *setup, struct error *error);
struct distributed_observer_size distributed_observer_size(const struct method_setup *setup,
                                                           int node);
/* The rows in which a node is compared. */
struct dse_observer_rows distributed_observer_rows(const struct method_setup *setup, int node);

#endif
