/* The section `distributed_kalman` of a network: tunables of the adaptive distributed Kalman
 * filters under the names of dse/distributed_kalman.h. Times are in the plant's time unit. */
#ifndef DSE_METHODS_DISTRIBUTED_KALMAN_SECTION_H
#define DSE_METHODS_DISTRIBUTED_KALMAN_SECTION_H

#include "dse/distributed_kalman.h"
#include "methods/sensor_network.h"
#include "runtime/error.h"
#include "runtime/scenario.h"

struct distributed_kalman_section {
    enum dse_dkf_scheme scheme;
    enum dse_dkf_direction direction;
    enum dse_dkf_message message;
    bool discretise;
    unsigned *sensors; /* one per node, NULL: node i reads group i */
    unsigned sensors_count;
    double *guesses; /* nodes x nx, NULL: networks[].guess for all */
    unsigned guesses_count;
    double *P0; /* nx, NULL: identity */
    unsigned P0_count;
    double *Q; /* nx, NULL: zero */
    unsigned Q_count;
    double *R; /* ny, NULL: not needed with given gains */
    unsigned R_count;
    double *K; /* gains of all nodes, each nx x ny_i; NULL: Riccati */
    unsigned K_count;
    double *D; /* likewise, with direction given */
    unsigned D_count;
    double *S; /* nx, with direction lyapunov */
    unsigned S_count;
    double gamma, beta, sigma, limit;
    unsigned *hold; /* NULL: 3 */
};

extern const cyaml_schema_field_t distributed_kalman_fields[];
extern const struct scenario_rule distributed_kalman_rules[];

struct sensor_network distributed_kalman_sensors(const struct distributed_kalman_section *section);
/* Combinations that no limit on a single number covers. */
bool distributed_kalman_section_check(const struct method_setup *setup, struct error *error);

#endif
