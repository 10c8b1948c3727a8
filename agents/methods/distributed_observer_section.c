/* Keys, limits and combinations of the section distributed_observer. */
#include "methods/distributed_observer_section.h"

#include <math.h>

#include "methods/method.h"

#define WORD             (CYAML_FLAG_OPTIONAL | CYAML_FLAG_STRICT)
#define OPTIONAL_POINTER (CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL)
#define LONGEST_LIST     100000

static const cyaml_schema_value_t number = {CYAML_VALUE_FLOAT(CYAML_FLAG_DEFAULT, double)};
static const cyaml_schema_value_t whole_number = {CYAML_VALUE_UINT(CYAML_FLAG_DEFAULT, unsigned)};
static const cyaml_strval_t residuals[] = {{"neighbours", DSE_OBSERVER_NEIGHBOURS},
                                           {"own", DSE_OBSERVER_OWN}};
static const cyaml_strval_t gains[] = {{"edge", DSE_OBSERVER_EDGE}, {"node", DSE_OBSERVER_NODE}};
static const cyaml_strval_t compared[] = {{"C2", DISTRIBUTED_OBSERVER_C2},
                                          {"all", DISTRIBUTED_OBSERVER_ALL}};

#define DESIGN  struct distributed_observer_design
#define SECTION struct distributed_observer_section
#define MATRIX(key)                                                                                \
    CYAML_FIELD_SEQUENCE(#key, OPTIONAL_POINTER, DESIGN, key, &number, 1, LONGEST_LIST)

static const cyaml_schema_field_t design_fields[] = {
    CYAML_FIELD_SEQUENCE("Lambda", CYAML_FLAG_POINTER, DESIGN, Lambda, &number, 1, LONGEST_LIST),
    MATRIX(L),
    MATRIX(H),
    MATRIX(M),
    MATRIX(N),
    MATRIX(J),
    MATRIX(z0),
    MATRIX(Pi),
    MATRIX(C2),
    MATRIX(D),
    MATRIX(D_y),
    MATRIX(D_u),
    CYAML_FIELD_END};
static const cyaml_schema_value_t design = {
    CYAML_VALUE_MAPPING(CYAML_FLAG_DEFAULT, DESIGN, design_fields)};

const cyaml_schema_field_t distributed_observer_fields[] = {
    CYAML_FIELD_ENUM("residual", WORD, SECTION, residual, residuals, CYAML_ARRAY_LEN(residuals)),
    CYAML_FIELD_ENUM("gain", WORD, SECTION, gain, gains, CYAML_ARRAY_LEN(gains)),
    CYAML_FIELD_ENUM("compare", WORD, SECTION, compare, compared, CYAML_ARRAY_LEN(compared)),
    CYAML_FIELD_FLOAT("gamma", CYAML_FLAG_OPTIONAL, SECTION, gamma),
    CYAML_FIELD_FLOAT("leak", CYAML_FLAG_OPTIONAL, SECTION, leak),
    CYAML_FIELD_FLOAT("gain_max", CYAML_FLAG_OPTIONAL, SECTION, gain_max),
    CYAML_FIELD_UINT_PTR("hold", OPTIONAL_POINTER, SECTION, hold),
    CYAML_FIELD_SEQUENCE("states", OPTIONAL_POINTER, SECTION, states, &whole_number, 1,
                         DSE_PLANT_MAX_STATES),
    CYAML_FIELD_SEQUENCE("sensors", OPTIONAL_POINTER, SECTION, sensors, &whole_number, 1,
                         METHOD_MAX_NODES),
    CYAML_FIELD_SEQUENCE("nodes", CYAML_FLAG_POINTER, SECTION, nodes, &design, 1, METHOD_MAX_NODES),
    CYAML_FIELD_END};

const struct scenario_rule distributed_observer_rules[] = {
    {.key = "residual",
     SCENARIO_ANY,
     .absent = "neighbours",
     .meaning = "what gains adapt to: C2_j (x_j - x_i), which node j measures; or an own residual"},
    {.key = "gain",
     SCENARIO_ANY,
     .absent = "edge",
     .meaning = "a Gamma per neighbour, or per node"},
    {.key = "compare",
     SCENARIO_ANY,
     .absent = "C2",
     .meaning = "what nodes compare (residual own): C2_i (x_j - x_i), or all of it"},
    {.key = "gamma",
     SCENARIO_AT_LEAST(0),
     .absent = "0",
     .meaning = "adaptation rate of the gains"},
    {.key = "leak", SCENARIO_AT_LEAST(0), .absent = "0", .meaning = "leak of the gains, 1 / time"},
    {.key = "gain_max",
     SCENARIO_AT_LEAST(0),
     .absent = "0: none",
     .meaning = "largest Frobenius norm of a gain"},
    {.key = "hold",
     .min = 0,
     .max = 1000000,
     .absent = "3",
     .meaning = "samples for which a silent neighbour's last word is used, its gain frozen"},
    {.key = "states",
     SCENARIO_ANY,
     .absent = "all",
     .meaning = "the plant states that the nodes estimate, from 0: functionals pick some"},
    {.key = "sensors",
     SCENARIO_ANY,
     .absent = "node i reads group i",
     .meaning = "the sensor group that each node reads, from 0"},
    {.key = "nodes",
     SCENARIO_ANY,
     .meaning = "the matrices of each node, as dse design writes them"},
    {.key = "nodes[].Lambda", SCENARIO_ANY, .meaning = "nz x nz: z' = Lambda z + L y + H u + .."},
    {.key = "nodes[].L", SCENARIO_ANY, .absent = "0", .meaning = "nz x ny, y: the node's outputs"},
    {.key = "nodes[].H", SCENARIO_ANY, .absent = "0", .meaning = "nz x nu, u: the known inputs"},
    {.key = "nodes[].M",
     SCENARIO_ANY,
     .absent = "identity",
     .meaning = "nx x nz: x = M z + N y + J u, nx: as many as states"},
    {.key = "nodes[].N", SCENARIO_ANY, .absent = "0", .meaning = "nx x ny"},
    {.key = "nodes[].J", SCENARIO_ANY, .absent = "0", .meaning = "nx x nu"},
    {.key = "nodes[].z0", SCENARIO_ANY, .absent = "0", .meaning = "nz, initial z"},
    {.key = "nodes[].Pi",
     SCENARIO_ANY,
     .absent = "none; needed where there are neighbours",
     .meaning = "nz x nz, positive definite: weight of the error in the Lyapunov function"},
    {.key = "nodes[].C2",
     SCENARIO_ANY,
     .absent = "whole estimates",
     .meaning = "rows of nx values in which estimates are compared"},
    {.key = "nodes[].D",
     SCENARIO_ANY,
     .absent = "none",
     .meaning = "rows of nz values: own residual r = D z + D_y y + D_u u"},
    {.key = "nodes[].D_y", SCENARIO_ANY, .absent = "0", .meaning = "as many rows of ny values"},
    {.key = "nodes[].D_u", SCENARIO_ANY, .absent = "0", .meaning = "as many rows of nu values"},
    {.key = NULL}};

struct sensor_network
distributed_observer_sensors(const struct distributed_observer_section *section)
{
    return (struct sensor_network){.group = section->sensors, .count = section->sensors_count};
}

struct dse_observer_rows distributed_observer_rows(const struct method_setup *setup, int node)
{
    const struct distributed_observer_section *section = setup->section;
    const struct distributed_observer_design *own = &section->nodes[node];
    const int nx = section->states != NULL ? (int)section->states_count : setup->process->nx;
    if (section->compare == DISTRIBUTED_OBSERVER_ALL || own->C2 == NULL)
        return (struct dse_observer_rows){.rows = nx};
    return (struct dse_observer_rows){.rows = (int)own->C2_count / nx, .C2 = own->C2};
}

struct distributed_observer_size distributed_observer_size(const struct method_setup *setup,
                                                           int node)
{
    const struct distributed_observer_section *section = setup->section;
    const struct distributed_observer_design *own = &section->nodes[node];
    const struct sensor_network sensors = distributed_observer_sensors(section);
    struct distributed_observer_size size = {
        .nz = (int)lround(sqrt((double)own->Lambda_count)),
        .nu = setup->process->nu - setup->process->n_unknown,
        .ny = sensor_network_group(setup, &sensors, node)->n_outputs,
        .nx = section->states != NULL ? (int)section->states_count : setup->process->nx};
    size.rows = distributed_observer_rows(setup, node).rows;
    size.nr = (int)own->D_count / size.nz;
    return size;
}

/* ---- combinations ---- */

struct shape {
    const char *key;
    const double *values;
    unsigned count;
    int rows, columns;
};

static bool check_shape(const struct method_setup *setup, int node, const struct shape *shape,
                        struct error *error)
{
    int wanted = shape->rows * shape->columns;
    if (shape->values == NULL || ((int)shape->count == wanted && wanted > 0))
        return true;
    return error_set(error,
                     "%s: networks.%s.distributed_observer.nodes[%d].%s has %u values; it must "
                     "have %d x %d, row by row",
                     setup->scenario->file, setup->network->name, node, shape->key, shape->count,
                     shape->rows, shape->columns);
}

/* Rows that a list of whole rows has; 1 where it is too short for one, which no list is long enough
 * for then. */
static int rows_of(unsigned count, int columns)
{
    return columns > 0 && (int)count > columns ? (int)count / columns : 1;
}

static bool check_node(const struct method_setup *setup, int node, struct error *error)
{
    const struct distributed_observer_section *section = setup->section;
    const struct distributed_observer_design *own = &section->nodes[node];
    const struct distributed_observer_size n = distributed_observer_size(setup, node);
    const struct shape shapes[] = {
        {"Lambda", own->Lambda, own->Lambda_count, n.nz, n.nz},
        {"L", own->L, own->L_count, n.nz, n.ny},
        {"H", own->H, own->H_count, n.nz, n.nu},
        {"M", own->M, own->M_count, n.nx, n.nz},
        {"N", own->N, own->N_count, n.nx, n.ny},
        {"J", own->J, own->J_count, n.nx, n.nu},
        {"z0", own->z0, own->z0_count, n.nz, 1},
        {"Pi", own->Pi, own->Pi_count, n.nz, n.nz},
        {"C2", own->C2, own->C2_count, rows_of(own->C2_count, n.nx), n.nx},
        {"D", own->D, own->D_count, rows_of(own->D_count, n.nz), n.nz},
        {"D_y", own->D_y, own->D_y_count, n.nr, n.ny},
        {"D_u", own->D_u, own->D_u_count, n.nr, n.nu}};
    for (size_t k = 0; k < sizeof shapes / sizeof shapes[0]; k++)
        if (!check_shape(setup, node, &shapes[k], error))
            return false;
    if (own->M == NULL && n.nx != n.nz)
        return error_set(error,
                         "%s: networks.%s.distributed_observer.nodes[%d].M is missing: z has %d "
                         "values, the estimate %d",
                         setup->scenario->file, setup->network->name, node, n.nz, n.nx);
    return true;
}

static bool check_states(const struct method_setup *setup, struct error *error)
{
    const struct distributed_observer_section *section = setup->section;
    for (unsigned s = 0; s < section->states_count; s++)
        if ((int)section->states[s] >= setup->process->nx)
            return error_set(error,
                             "%s: networks.%s.distributed_observer.states[%u]: there is no state "
                             "%u: states are 0 to %d",
                             setup->scenario->file, setup->network->name, s, section->states[s],
                             setup->process->nx - 1);
    return true;
}

bool distributed_observer_section_check(const struct method_setup *setup, struct error *error)
{
    const struct distributed_observer_section *section = setup->section;
    const struct sensor_network sensors = distributed_observer_sensors(section);
    const int nodes = (int)section->nodes_count;
    if ((setup->graph != NULL && setup->graph->nodes != nodes) ||
        (section->sensors != NULL && (int)section->sensors_count != nodes))
        return error_set(error,
                         "%s: networks.%s.distributed_observer.nodes has %d entries; graph and "
                         "sensors must have as many nodes",
                         setup->scenario->file, setup->network->name, nodes);
    if (!check_states(setup, error))
        return false;
    for (int i = 0; i < nodes; i++)
        if (sensors.group == NULL && i >= setup->process->n_subsystems)
            return error_set(error,
                             "%s: networks.%s.distributed_observer.nodes: plant %s has %d sensor "
                             "groups for %d nodes (see sensors)",
                             setup->scenario->file, setup->network->name, setup->process->name,
                             setup->process->n_subsystems, nodes);
    if (!sensor_network_check(setup, &sensors, error))
        return false;
    for (int i = 0; i < nodes; i++)
        if (!check_node(setup, i, error))
            return false;
    return true;
}
