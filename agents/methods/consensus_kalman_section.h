/* The section `consensus_kalman` of a network: tunables of the consensus Kalman filters under the
 * names of dse/consensus_kalman.h. */
#ifndef DSE_METHODS_CONSENSUS_KALMAN_SECTION_H
#define DSE_METHODS_CONSENSUS_KALMAN_SECTION_H

#include "dse/consensus_kalman.h"
#include "methods/sensor_node.h"

/* Like none, with one node for all sensors: not a scheme of the library's. */
#define CONSENSUS_KALMAN_CENTRAL 100

struct consensus_kalman_section {
    struct sensor_node_keys keys;
    int scheme;   /* enum dse_ckf_scheme or CONSENSUS_KALMAN_CENTRAL */
    int counting; /* enum dse_ckf_counting */
    double multiplicity;
    unsigned restart;
};

extern const cyaml_schema_field_t consensus_kalman_fields[];
extern const struct scenario_rule consensus_kalman_rules[];

struct sensor_node_place consensus_kalman_place(const struct consensus_kalman_section *section);
bool consensus_kalman_section_check(const struct method_setup *setup, struct error *error);

#endif
