/* Keys, limits and combinations of the section second_order. */
#include "methods/second_order_section.h"

#define WORD    (CYAML_FLAG_OPTIONAL | CYAML_FLAG_STRICT)
#define SECTION struct second_order_section

static const cyaml_strval_t schemes[] = {{"B_information", DSE_DSO_B_INFORMATION},
                                         {"C_information", DSE_DSO_C_INFORMATION},
                                         {"A_information", DSE_DSO_A_INFORMATION},
                                         {"B", DSE_DSO_B},
                                         {"C", DSE_DSO_C},
                                         {"A_covariance", DSE_DSO_A_COVARIANCE},
                                         {"none", DSE_DSO_ALONE},
                                         {"central", SECOND_ORDER_CENTRAL},
                                         {"A_literal", DSE_DSO_A_LITERAL},
                                         {"B_literal", DSE_DSO_B_LITERAL},
                                         {"C_literal", DSE_DSO_C_LITERAL}};
static const cyaml_strval_t kinds[] = {{"second_order", DSE_SECOND_ORDER},
                                       {"extended", DSE_SECOND_ORDER_EXTENDED},
                                       {"unscented", DSE_SECOND_ORDER_UNSCENTED}};
static const cyaml_strval_t memories[] = {
    {"average", DSE_DSO_AVERAGE}, {"restart", DSE_DSO_RESTART}, {"persistent", DSE_DSO_PERSISTENT}};

const cyaml_schema_field_t second_order_fields[] = {
    CYAML_FIELD_ENUM("scheme", WORD, SECTION, scheme, schemes, CYAML_ARRAY_LEN(schemes)),
    CYAML_FIELD_ENUM("kind", WORD, SECTION, kind, kinds, CYAML_ARRAY_LEN(kinds)),
    CYAML_FIELD_ENUM("memory", WORD, SECTION, memory, memories, CYAML_ARRAY_LEN(memories)),
    CYAML_FIELD_FLOAT("delta", CYAML_FLAG_OPTIONAL, SECTION, delta),
    CYAML_FIELD_BOOL("normalised", CYAML_FLAG_OPTIONAL, SECTION, normalised),
    SENSOR_NODE_FIELDS(SECTION),
    CYAML_FIELD_FLOAT("gate", CYAML_FLAG_OPTIONAL, SECTION, gate),
    CYAML_FIELD_UINT("substeps", CYAML_FLAG_OPTIONAL, SECTION, substeps),
    CYAML_FIELD_END};

const struct scenario_rule second_order_rules[] = {
    {.key = "scheme",
     SCENARIO_ANY,
     .absent = "B_information",
     .meaning = "what the nodes agree on and how; none and central to compare with; *_literal as "
                "printed in the source, wrong"},
    {.key = "kind",
     SCENARIO_ANY,
     .absent = "second_order",
     .meaning = "the filter of each node: with trace term, extended or unscented Kalman filter"},
    {.key = "memory",
     SCENARIO_ANY,
     .absent = "average",
     .meaning = "A_covariance: what its filters start a sample with; A_information: persistent "
                "keeps what losses in one direction leave, others begin anew"},
    {.key = "delta",
     SCENARIO_ABOVE(0),
     .absent = "B 0.1, C 0.25",
     .meaning = "B, C: weight of the neighbours' estimates"},
    {.key = "normalised",
     SCENARIO_ANY,
     .absent = "false",
     .meaning = "C: delta / (1 + |S|) in place of delta"},
    SENSOR_NODE_RULES("diagonal of the process noise's intensity; for truncated models"),
    {.key = "epsilon",
     SCENARIO_ABOVE(0),
     .absent = "0.1",
     .meaning = "A: step of the consensus filters, at most 1 / (largest degree)"},
    {.key = "rounds",
     .min = 1,
     .max = 1000,
     .absent = "1",
     .meaning = "A_information, A_covariance with memory average: rounds per sample"},
    {.key = "gate",
     SCENARIO_ABOVE(0),
     .absent = "none",
     .meaning = "innovations beyond so many standard deviations are refused"},
    {.key = "substeps",
     .min = 1,
     .max = 100000,
     .absent = "adaptive",
     .meaning = "Runge-Kutta steps of a prediction; they are halved where they are too coarse"},
    {.key = NULL}};

struct sensor_node_place second_order_place(const struct second_order_section *section)
{
    const bool central = section->scheme == SECOND_ORDER_CENTRAL;
    return (struct sensor_node_place){.alone = central || section->scheme == DSE_DSO_ALONE,
                                      .central = central};
}

/* The schemes that sum or average the sensors' values. */
static bool check_equal_outputs(const struct method_setup *setup, struct error *error)
{
    const struct second_order_section *section = setup->section;
    const struct sensor_network sensors = {.group = section->keys.sensors,
                                           .count = section->keys.sensors_count};
    if (section->scheme < DSE_DSO_A_LITERAL || section->scheme == SECOND_ORDER_CENTRAL)
        return true;
    const int nodes = sensor_node_nodes(setup, &section->keys, second_order_place(section));
    for (int i = 1; i < nodes; i++)
        if (sensor_network_group(setup, &sensors, i)->n_outputs !=
            sensor_network_group(setup, &sensors, 0)->n_outputs)
            return error_set(error,
                             "%s: networks.%s.second_order.scheme: the literal ones need as many "
                             "outputs at every node",
                             setup->scenario->file, setup->network->name);
    return true;
}

bool second_order_section_check(const struct method_setup *setup, struct error *error)
{
    const struct second_order_section *section = setup->section;
    struct dse_model model;
    setup->process->model(setup->prepared, &model);
    if (dse_quadratic_of(&model) == NULL)
        return error_set(error,
                         "%s: networks.%s.second_order: plant %s is not a quadratic system "
                         "x' = d + A x + sum e_k x'F_k x",
                         setup->scenario->file, setup->network->name, setup->process->name);
    return sensor_node_check(setup, &section->keys, second_order_place(section), error) &&
           check_equal_outputs(setup, error);
}
