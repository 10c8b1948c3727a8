/* The section `second_order` of a network: tunables of the distributed second-order filters under
 * the names of dse/distributed_second_order.h. Times are in the plant's time unit. */
#ifndef DSE_METHODS_SECOND_ORDER_SECTION_H
#define DSE_METHODS_SECOND_ORDER_SECTION_H

#include "dse/distributed_second_order.h"
#include "methods/sensor_node.h"

/* Like none, with one node for all sensors: not a scheme of the library's. */
#define SECOND_ORDER_CENTRAL 100

struct second_order_section {
    struct sensor_node_keys keys;
    int scheme; /* enum dse_dso_scheme or SECOND_ORDER_CENTRAL */
    enum dse_second_order_kind kind;
    enum dse_dso_memory memory;
    bool normalised;
    double delta, gate;
    unsigned substeps;
};

extern const cyaml_schema_field_t second_order_fields[];
extern const struct scenario_rule second_order_rules[];

struct sensor_node_place second_order_place(const struct second_order_section *section);
bool second_order_section_check(const struct method_setup *setup, struct error *error);

#endif
