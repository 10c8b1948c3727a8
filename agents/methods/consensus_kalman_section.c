/* Keys, limits and combinations of the section consensus_kalman. */
#include "methods/consensus_kalman_section.h"

#define SECTION struct consensus_kalman_section

static const cyaml_strval_t schemes[] = {{"A", DSE_CKF_A},
                                         {"B", DSE_CKF_B},
                                         {"C", DSE_CKF_C},
                                         {"none", DSE_CKF_ALONE},
                                         {"central", CONSENSUS_KALMAN_CENTRAL},
                                         {"A_low_pass", DSE_CKF_A_LOW_PASS},
                                         {"A_literal", DSE_CKF_A_LITERAL},
                                         {"C_literal", DSE_CKF_C_LITERAL}};

static const cyaml_strval_t countings[] = {
    {"once", DSE_CKF_ONCE}, {"bounded", DSE_CKF_BOUNDED}, {"in_all", DSE_CKF_IN_ALL}};

const cyaml_schema_field_t consensus_kalman_fields[] = {
    CYAML_FIELD_ENUM("scheme", CYAML_FLAG_OPTIONAL | CYAML_FLAG_STRICT, SECTION, scheme, schemes,
                     CYAML_ARRAY_LEN(schemes)),
    SENSOR_NODE_FIELDS(SECTION),
    CYAML_FIELD_ENUM("counting", CYAML_FLAG_OPTIONAL | CYAML_FLAG_STRICT, SECTION, counting,
                     countings, CYAML_ARRAY_LEN(countings)),
    CYAML_FIELD_FLOAT("multiplicity", CYAML_FLAG_OPTIONAL, SECTION, multiplicity),
    CYAML_FIELD_UINT("restart", CYAML_FLAG_OPTIONAL, SECTION, restart),
    CYAML_FIELD_END};

const struct scenario_rule consensus_kalman_rules[] = {
    {.key = "scheme",
     SCENARIO_ANY,
     .absent = "A",
     .meaning = "A: agreement on information; B, C: on estimates; none and central to compare "
                "with; *_literal as printed in the source, overconfident or unstable"},
    SENSOR_NODE_RULES("diagonal of the covariance of the process noise of a step"),
    {.key = "epsilon",
     SCENARIO_ABOVE(0),
     .absent = "A 1 / (1 + degree), B 0.1, C 0.5",
     .meaning = "step of A's filters; weight of the neighbours' estimates"},
    {.key = "rounds", .min = 1, .max = 1000, .absent = "5", .meaning = "A: rounds per sample"},
    {.key = "counting",
     SCENARIO_ANY,
     .absent = "once",
     .meaning =
         "A: once: no measurement counts more than once; bounded: the same without weights "
         "in the messages; in_all: filters are kept from sample to sample, as in the source"},
    {.key = "multiplicity",
     SCENARIO_ABOVE(0),
     .absent = "what a node knows by itself",
     .meaning = "A, bounded: how often the average counts"},
    {.key = "restart",
     .min = 1,
     .max = 1000000,
     .absent = "never",
     .meaning = "A, in_all: filters start from zero every so many samples; for links that fail"},
    {.key = NULL}};

struct sensor_node_place consensus_kalman_place(const struct consensus_kalman_section *section)
{
    const bool central = section->scheme == CONSENSUS_KALMAN_CENTRAL;
    return (struct sensor_node_place){.alone = central || section->scheme == DSE_CKF_ALONE,
                                      .central = central};
}

bool consensus_kalman_section_check(const struct method_setup *setup, struct error *error)
{
    const struct consensus_kalman_section *section = setup->section;
    struct dse_model model;
    setup->process->model(setup->prepared, &model);
    if (model.time != DSE_DISCRETE || model.dfdx == NULL)
        return error_set(error,
                         "%s: networks.%s.consensus_kalman: plant %s is not a linear plant with "
                         "`time: discrete`",
                         setup->scenario->file, setup->network->name, setup->process->name);
    return sensor_node_check(setup, &section->keys, consensus_kalman_place(section), error);
}
