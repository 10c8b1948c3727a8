/* Keys, limits and combinations of the section distributed_kalman. */
#include "methods/distributed_kalman_section.h"

#include "methods/method.h"

#define WORD             (CYAML_FLAG_OPTIONAL | CYAML_FLAG_STRICT)
#define OPTIONAL_POINTER (CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL)
#define LONGEST_LIST     100000

static const cyaml_schema_value_t number = {CYAML_VALUE_FLOAT(CYAML_FLAG_DEFAULT, double)};
static const cyaml_schema_value_t whole_number = {CYAML_VALUE_UINT(CYAML_FLAG_DEFAULT, unsigned)};
static const cyaml_strval_t schemes[] = {{"none", DSE_DKF_ALONE},
                                         {"edge", DSE_DKF_EDGE},
                                         {"node", DSE_DKF_NODE},
                                         {"global", DSE_DKF_GLOBAL},
                                         {"standard", DSE_DKF_STANDARD}};
static const cyaml_strval_t directions[] = {{"covariance", DSE_DKF_COVARIANCE},
                                            {"gain", DSE_DKF_GAIN},
                                            {"lyapunov", DSE_DKF_LYAPUNOV},
                                            {"given", DSE_DKF_GIVEN},
                                            {"filtered", DSE_DKF_FILTERED}};
static const cyaml_strval_t messages[] = {{"projected", DSE_DKF_PROJECTED}, {"full", DSE_DKF_FULL}};

#define SECTION struct distributed_kalman_section
#define LIST(key)                                                                                  \
    CYAML_FIELD_SEQUENCE(#key, OPTIONAL_POINTER, SECTION, key, &number, 1, LONGEST_LIST)

const cyaml_schema_field_t distributed_kalman_fields[] = {
    CYAML_FIELD_ENUM("scheme", CYAML_FLAG_STRICT, SECTION, scheme, schemes,
                     CYAML_ARRAY_LEN(schemes)),
    CYAML_FIELD_ENUM("direction", WORD, SECTION, direction, directions,
                     CYAML_ARRAY_LEN(directions)),
    CYAML_FIELD_ENUM("message", WORD, SECTION, message, messages, CYAML_ARRAY_LEN(messages)),
    CYAML_FIELD_BOOL("discretise", CYAML_FLAG_OPTIONAL, SECTION, discretise),
    CYAML_FIELD_SEQUENCE("sensors", OPTIONAL_POINTER, SECTION, sensors, &whole_number, 1,
                         METHOD_MAX_NODES),
    LIST(guesses),
    LIST(P0),
    LIST(Q),
    LIST(R),
    LIST(K),
    LIST(D),
    LIST(S),
    CYAML_FIELD_FLOAT("gamma", CYAML_FLAG_OPTIONAL, SECTION, gamma),
    CYAML_FIELD_FLOAT("beta", CYAML_FLAG_OPTIONAL, SECTION, beta),
    CYAML_FIELD_FLOAT("sigma", CYAML_FLAG_OPTIONAL, SECTION, sigma),
    CYAML_FIELD_FLOAT("limit", CYAML_FLAG_OPTIONAL, SECTION, limit),
    CYAML_FIELD_UINT_PTR("hold", OPTIONAL_POINTER, SECTION, hold),
    CYAML_FIELD_END};

const struct scenario_rule distributed_kalman_rules[] = {
    {.key = "scheme",
     SCENARIO_ANY,
     .meaning =
         "coupling: none; a gain per edge, per node, for all (global); or without adaptation"},
    {.key = "direction",
     SCENARIO_ANY,
     .absent = "covariance",
     .meaning = "D_i: P C'; K = P C' R^-1; W C'; given in D; P(k) A(k-1)^-T C' (discrete)"},
    {.key = "message",
     SCENARIO_ANY,
     .absent = "projected",
     .meaning = "C_j x_i for each listener j, or the full x_i; scheme standard always says x_i"},
    {.key = "discretise",
     SCENARIO_ANY,
     .absent = "false",
     .meaning = "discrete filters for a continuous plant: A(k) = expm(T A(t_k + T/2)), Q T, R / T"},
    {.key = "sensors",
     SCENARIO_ANY,
     .absent = "node i reads group i",
     .meaning = "the sensor group that each node reads, from 0"},
    {.key = "guesses",
     SCENARIO_ANY,
     .absent = "networks[].guess for all",
     .meaning = "initial estimates of node 0, 1, .. in turn, each with all states"},
    {.key = "P0",
     SCENARIO_ABOVE(0),
     .count = SCENARIO_PER_STATE,
     .absent = "identity",
     .meaning = "diagonal of P(0) of each node"},
    {.key = "Q",
     SCENARIO_AT_LEAST(0),
     .count = SCENARIO_PER_STATE,
     .absent = "zero",
     .meaning = "diagonal of the process noise's intensity (discrete plant: covariance per step)"},
    {.key = "R",
     SCENARIO_ABOVE(0),
     .count = SCENARIO_PER_OUTPUT,
     .absent = "none; needed unless K is given",
     .meaning = "intensity of each output's noise (discrete plant: variance)"},
    {.key = "K",
     SCENARIO_ANY,
     .absent = "by the Riccati equation",
     .meaning = "gains of node 0, 1, .. in turn, each nx x its outputs, row by row"},
    {.key = "D",
     SCENARIO_ANY,
     .absent = "none; needed by direction given",
     .meaning = "D of node 0, 1, .. in turn, each nx x its outputs, row by row"},
    {.key = "S",
     SCENARIO_ABOVE(0),
     .count = SCENARIO_PER_STATE,
     .absent = "identity",
     .meaning = "diagonal of S in W' = (A - K C) W + W (A - K C)' + S (direction lyapunov)"},
    {.key = "gamma",
     SCENARIO_AT_LEAST(0),
     .absent = "0; needed unless scheme is none",
     .meaning = "coupling weight"},
    {.key = "beta", SCENARIO_ABOVE(0), .absent = "1", .meaning = "adaptation rate of the gains"},
    {.key = "sigma",
     SCENARIO_AT_LEAST(0),
     .absent = "0: none",
     .meaning = "leak of the gains, 1 / time (discrete: per step, below 1)"},
    {.key = "limit",
     SCENARIO_ABOVE(0),
     .absent = "none",
     .meaning = "largest Frobenius norm of a gain"},
    {.key = "hold",
     .min = 0,
     .max = 1000000,
     .absent = "3",
     .meaning = "samples for which a silent neighbour's last word is used, its gain frozen"},
    {.key = NULL}};

struct sensor_network distributed_kalman_sensors(const struct distributed_kalman_section *section)
{
    return (struct sensor_network){.group = section->sensors, .count = section->sensors_count};
}

/* ---- combinations ---- */

static bool fail(const struct method_setup *setup, struct error *error, const char *text)
{
    return error_set(error, "%s: networks.%s.distributed_kalman.%s", setup->scenario->file,
                     setup->network->name, text);
}

static bool check_count(const struct method_setup *setup, const char *key, const double *list,
                        unsigned count, int wanted, struct error *error)
{
    if (list == NULL || (int)count == wanted)
        return true;
    return error_set(error, "%s: networks.%s.distributed_kalman.%s has %u values; it must have %d",
                     setup->scenario->file, setup->network->name, key, count, wanted);
}

static bool check_counts(const struct method_setup *setup, struct error *error)
{
    const struct distributed_kalman_section *section = setup->section;
    const struct sensor_network sensors = distributed_kalman_sensors(section);
    int nodes = sensor_network_nodes(setup, &sensors);
    int nx = setup->process->nx, outputs = 0, first = 0;
    for (int i = 0; i < nodes; i++) {
        int ny = sensor_network_group(setup, &sensors, i)->n_outputs;
        first = i == 0 ? ny : first;
        outputs += ny;
        if (section->scheme == DSE_DKF_GLOBAL && ny != first)
            return fail(setup, error, "scheme: global needs as many outputs at every node");
    }
    return check_count(setup, "guesses", section->guesses, section->guesses_count, nodes * nx,
                       error) &&
           check_count(setup, "K", section->K, section->K_count, nx * outputs, error) &&
           check_count(setup, "D", section->D, section->D_count, nx * outputs, error);
}

bool distributed_kalman_section_check(const struct method_setup *setup, struct error *error)
{
    const struct distributed_kalman_section *section = setup->section;
    const struct sensor_network sensors = distributed_kalman_sensors(section);
    bool alone = section->scheme == DSE_DKF_ALONE;
    if (!sensor_network_check(setup, &sensors, error) || !check_counts(setup, error))
        return false;
    if (!alone && setup->graph == NULL)
        return error_set(error,
                         "%s: networks.%s.graph is missing: who hears whom; without one there is "
                         "only scheme none",
                         setup->scenario->file, setup->network->name);
    if (!alone && section->gamma <= 0)
        return fail(setup, error, "gamma is missing: the weight of the coupling, > 0");
    if (section->guesses == NULL && setup->network->guess == NULL)
        return fail(setup, error, "guesses is missing: the initial estimates, or networks[].guess");
    if (section->discretise && setup->process->nu > 0)
        return fail(setup, error, "discretise: is made for plants without inputs");
    if (section->R == NULL && section->K == NULL)
        return fail(setup, error, "R is missing: it can be left out only when gains K are given");
    if ((section->direction == DSE_DKF_GIVEN) != (section->D != NULL))
        return fail(setup, error, "direction: given and D need each other");
    return true;
}
