/* The keys of a scenario: where libcyaml puts them, what they mean and which values they take. */
#include <string.h>

#include "methods/method.h"
#include "runtime/scenario_internal.h"

#define OPTIONAL         CYAML_FLAG_OPTIONAL
#define OPTIONAL_POINTER (CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL)
#define LONGEST_LIST     100000

static const cyaml_schema_value_t number = {CYAML_VALUE_FLOAT(CYAML_FLAG_DEFAULT, double)};

static const cyaml_schema_field_t time_fields[] = {
    CYAML_FIELD_FLOAT("period_s", CYAML_FLAG_DEFAULT, struct scenario_time, period_s),
    CYAML_FIELD_FLOAT("duration_s", CYAML_FLAG_DEFAULT, struct scenario_time, duration_s),
    CYAML_FIELD_END};

static const cyaml_schema_field_t parameter_fields[] = {
    CYAML_FIELD_STRING_PTR("name", CYAML_FLAG_POINTER, struct scenario_parameter, name, 1, 63),
    CYAML_FIELD_FLOAT("value", CYAML_FLAG_DEFAULT, struct scenario_parameter, value),
    CYAML_FIELD_END};
static const cyaml_schema_value_t parameter = {
    CYAML_VALUE_MAPPING(CYAML_FLAG_DEFAULT, struct scenario_parameter, parameter_fields)};

static const cyaml_strval_t integrator_words[] = {
    {"cvode", SCENARIO_CVODE}, {"rk4", SCENARIO_RK4}, {"flow", SCENARIO_FLOW}};
static const cyaml_schema_field_t integrator_fields[] = {
    CYAML_FIELD_ENUM("kind", OPTIONAL | CYAML_FLAG_STRICT, struct scenario_integrator, kind,
                     integrator_words, CYAML_ARRAY_LEN(integrator_words)),
    CYAML_FIELD_FLOAT("rtol", OPTIONAL, struct scenario_integrator, rtol),
    CYAML_FIELD_FLOAT("atol", OPTIONAL, struct scenario_integrator, atol), CYAML_FIELD_END};

static const cyaml_schema_field_t step_fields[] = {
    CYAML_FIELD_FLOAT("at_s", CYAML_FLAG_DEFAULT, struct scenario_step, at_s),
    CYAML_FIELD_FLOAT("value", CYAML_FLAG_DEFAULT, struct scenario_step, value), CYAML_FIELD_END};
static const cyaml_schema_value_t step = {
    CYAML_VALUE_MAPPING(CYAML_FLAG_DEFAULT, struct scenario_step, step_fields)};

static const cyaml_schema_field_t pid_fields[] = {
    CYAML_FIELD_FLOAT("kp", CYAML_FLAG_DEFAULT, struct scenario_pid, kp),
    CYAML_FIELD_FLOAT("ti_s", OPTIONAL, struct scenario_pid, ti_s),
    CYAML_FIELD_FLOAT("td_s", OPTIONAL, struct scenario_pid, td_s), CYAML_FIELD_END};
static const cyaml_schema_field_t loop_fields[] = {
    CYAML_FIELD_STRING_PTR("output", CYAML_FLAG_POINTER, struct scenario_loop, output, 1, 63),
    CYAML_FIELD_MAPPING("outer", CYAML_FLAG_DEFAULT, struct scenario_loop, outer, pid_fields),
    CYAML_FIELD_MAPPING_PTR("inner", OPTIONAL_POINTER, struct scenario_loop, inner, pid_fields),
    CYAML_FIELD_FLOAT("low", CYAML_FLAG_DEFAULT, struct scenario_loop, low),
    CYAML_FIELD_FLOAT("high", CYAML_FLAG_DEFAULT, struct scenario_loop, high),
    CYAML_FIELD_FLOAT("lag_s", OPTIONAL, struct scenario_loop, lag_s),
    CYAML_FIELD_END};

static const cyaml_strval_t signal_words[] = {{"constant", SCENARIO_CONSTANT},
                                              {"steps", SCENARIO_STEPS},
                                              {"sinusoid", SCENARIO_SINUSOID},
                                              {"prbs", SCENARIO_PRBS}};
static const cyaml_schema_field_t drive_fields[] = {
    CYAML_FIELD_STRING_PTR("name", CYAML_FLAG_POINTER, struct scenario_drive, name, 1, 63),
    CYAML_FIELD_ENUM("signal", OPTIONAL | CYAML_FLAG_STRICT, struct scenario_drive, signal,
                     signal_words, CYAML_ARRAY_LEN(signal_words)),
    CYAML_FIELD_FLOAT("value", CYAML_FLAG_DEFAULT, struct scenario_drive, value),
    CYAML_FIELD_FLOAT("amplitude", OPTIONAL, struct scenario_drive, amplitude),
    CYAML_FIELD_FLOAT("omega", OPTIONAL, struct scenario_drive, omega),
    CYAML_FIELD_FLOAT("phase", OPTIONAL, struct scenario_drive, phase),
    CYAML_FIELD_FLOAT("bit_s", OPTIONAL, struct scenario_drive, bit_s),
    CYAML_FIELD_SEQUENCE("steps", OPTIONAL_POINTER, struct scenario_drive, steps, &step, 0,
                         LONGEST_LIST),
    CYAML_FIELD_MAPPING_PTR("loop", OPTIONAL_POINTER, struct scenario_drive, loop, loop_fields),
    CYAML_FIELD_END};
static const cyaml_schema_value_t drive = {
    CYAML_VALUE_MAPPING(CYAML_FLAG_DEFAULT, struct scenario_drive, drive_fields)};

static const cyaml_schema_value_t signal_name = {
    CYAML_VALUE_STRING(CYAML_FLAG_POINTER, char *, 1, 31)};
static const cyaml_schema_value_t whole_number = {CYAML_VALUE_UINT(CYAML_FLAG_DEFAULT, unsigned)};
static const cyaml_strval_t time_words[] = {{"continuous", SCENARIO_CONTINUOUS},
                                            {"discrete", SCENARIO_DISCRETE}};
static const cyaml_schema_field_t linear_fields[] = {
    CYAML_FIELD_ENUM("time", OPTIONAL | CYAML_FLAG_STRICT, struct scenario_linear, time, time_words,
                     CYAML_ARRAY_LEN(time_words)),
    CYAML_FIELD_FLOAT("unit_s", OPTIONAL, struct scenario_linear, unit_s),
    CYAML_FIELD_UINT("nx", CYAML_FLAG_DEFAULT, struct scenario_linear, nx),
    CYAML_FIELD_UINT("nu", OPTIONAL, struct scenario_linear, nu),
    CYAML_FIELD_UINT("unknown", OPTIONAL, struct scenario_linear, unknown),
    CYAML_FIELD_SEQUENCE("A", CYAML_FLAG_POINTER, struct scenario_linear, A, &number, 1,
                         LONGEST_LIST),
    CYAML_FIELD_SEQUENCE("B", OPTIONAL_POINTER, struct scenario_linear, B, &number, 0,
                         LONGEST_LIST),
    CYAML_FIELD_SEQUENCE("C", CYAML_FLAG_POINTER, struct scenario_linear, C, &number, 1,
                         LONGEST_LIST),
    CYAML_FIELD_SEQUENCE("A_sin", OPTIONAL_POINTER, struct scenario_linear, A_sin, &number, 1,
                         LONGEST_LIST),
    CYAML_FIELD_FLOAT("omega", OPTIONAL, struct scenario_linear, omega),
    CYAML_FIELD_SEQUENCE("origin", OPTIONAL_POINTER, struct scenario_linear, origin, &number, 1,
                         LONGEST_LIST),
    CYAML_FIELD_SEQUENCE("states", OPTIONAL_POINTER, struct scenario_linear, states, &signal_name,
                         1, DSE_PLANT_MAX_STATES),
    CYAML_FIELD_SEQUENCE("groups", OPTIONAL_POINTER, struct scenario_linear, groups, &whole_number,
                         1, DSE_PLANT_MAX_OUTPUTS),
    CYAML_FIELD_SEQUENCE("blocks", OPTIONAL_POINTER, struct scenario_linear, blocks, &whole_number,
                         1, DSE_PLANT_MAX_OUTPUTS),
    CYAML_FIELD_END};

static const cyaml_schema_field_t plant_fields[] = {
    CYAML_FIELD_STRING_PTR("name", CYAML_FLAG_POINTER, struct scenario_plant, name, 1, 63),
    CYAML_FIELD_MAPPING_PTR("linear", OPTIONAL_POINTER, struct scenario_plant, linear,
                            linear_fields),
    CYAML_FIELD_STRING_PTR("set", OPTIONAL_POINTER, struct scenario_plant, set, 1, 63),
    CYAML_FIELD_SEQUENCE("parameters", OPTIONAL_POINTER, struct scenario_plant, parameters,
                         &parameter, 0, DSE_PLANT_MAX_PARAMETERS),
    CYAML_FIELD_SEQUENCE("x0", OPTIONAL_POINTER, struct scenario_plant, x0, &number, 1,
                         LONGEST_LIST),
    CYAML_FIELD_SEQUENCE("inputs", OPTIONAL_POINTER, struct scenario_plant, inputs, &number, 0,
                         LONGEST_LIST),
    CYAML_FIELD_SEQUENCE("drive", OPTIONAL_POINTER, struct scenario_plant, drive, &drive, 0,
                         DSE_PLANT_MAX_INPUTS),
    CYAML_FIELD_MAPPING("integrator", OPTIONAL, struct scenario_plant, integrator,
                        integrator_fields),
    CYAML_FIELD_END};

static const cyaml_strval_t distribution_words[] = {
    {"none", SCENARIO_NONE}, {"uniform", SCENARIO_UNIFORM}, {"gaussian", SCENARIO_GAUSSIAN}};
static const cyaml_schema_field_t noise_fields[] = {
    CYAML_FIELD_ENUM("distribution", CYAML_FLAG_STRICT, struct scenario_noise, distribution,
                     distribution_words, CYAML_ARRAY_LEN(distribution_words)),
    CYAML_FIELD_SEQUENCE("scale", OPTIONAL_POINTER, struct scenario_noise, scale, &number, 0,
                         LONGEST_LIST),
    CYAML_FIELD_SEQUENCE("limit", OPTIONAL_POINTER, struct scenario_noise, limit, &number, 0,
                         LONGEST_LIST),
    CYAML_FIELD_END};
static const cyaml_schema_field_t dead_fields[] = {
    CYAML_FIELD_STRING_PTR("output", CYAML_FLAG_POINTER, struct scenario_dead_sensor, output, 1,
                           63),
    CYAML_FIELD_FLOAT("start_s", CYAML_FLAG_DEFAULT, struct scenario_dead_sensor, start_s),
    CYAML_FIELD_FLOAT("end_s", OPTIONAL, struct scenario_dead_sensor, end_s), CYAML_FIELD_END};
static const cyaml_schema_value_t dead = {
    CYAML_VALUE_MAPPING(CYAML_FLAG_DEFAULT, struct scenario_dead_sensor, dead_fields)};
static const cyaml_schema_field_t noises_fields[] = {
    CYAML_FIELD_MAPPING("process", OPTIONAL, struct scenario_noises, process, noise_fields),
    CYAML_FIELD_MAPPING("measurement", OPTIONAL, struct scenario_noises, measurement, noise_fields),
    CYAML_FIELD_FLOAT("missing", OPTIONAL, struct scenario_noises, missing),
    CYAML_FIELD_SEQUENCE("dead", OPTIONAL_POINTER, struct scenario_noises, dead, &dead, 1, 1000),
    CYAML_FIELD_END};

static const cyaml_schema_field_t graph_fields[] = {
    CYAML_FIELD_UINT("nodes", CYAML_FLAG_DEFAULT, struct scenario_graph, nodes),
    CYAML_FIELD_SEQUENCE("edges", CYAML_FLAG_POINTER, struct scenario_graph, edges, &whole_number,
                         0, LONGEST_LIST),
    CYAML_FIELD_BOOL("undirected", OPTIONAL, struct scenario_graph, undirected), CYAML_FIELD_END};

static const cyaml_schema_field_t outage_fields[] = {
    CYAML_FIELD_INT("from", CYAML_FLAG_DEFAULT, struct scenario_outage, from),
    CYAML_FIELD_INT("to", CYAML_FLAG_DEFAULT, struct scenario_outage, to),
    CYAML_FIELD_FLOAT("start_s", CYAML_FLAG_DEFAULT, struct scenario_outage, start_s),
    CYAML_FIELD_FLOAT("end_s", OPTIONAL, struct scenario_outage, end_s), CYAML_FIELD_END};
static const cyaml_schema_value_t outage = {
    CYAML_VALUE_MAPPING(CYAML_FLAG_DEFAULT, struct scenario_outage, outage_fields)};

static const cyaml_schema_field_t link_fields[] = {
    CYAML_FIELD_UINT("D", OPTIONAL, struct scenario_link, D),
    CYAML_FIELD_UINT("T_m", OPTIONAL, struct scenario_link, T_m),
    CYAML_FIELD_FLOAT("loss", OPTIONAL, struct scenario_link, loss),
    CYAML_FIELD_UINT("seed", OPTIONAL, struct scenario_link, seed),
    CYAML_FIELD_STRING_PTR("file", OPTIONAL_POINTER, struct scenario_link, file, 1, 500),
    CYAML_FIELD_SEQUENCE("outages", OPTIONAL_POINTER, struct scenario_link, outages, &outage, 1,
                         1000),
    CYAML_FIELD_END};

static const cyaml_schema_field_t network_fields[] = {
    CYAML_FIELD_STRING_PTR("name", CYAML_FLAG_POINTER, struct scenario_network, name, 1, 31),
    CYAML_FIELD_STRING_PTR("title", OPTIONAL_POINTER, struct scenario_network, title, 1, 100),
    CYAML_FIELD_SEQUENCE("guess", OPTIONAL_POINTER, struct scenario_network, guess, &number, 1,
                         LONGEST_LIST),
    CYAML_FIELD_STRING_PTR("set", OPTIONAL_POINTER, struct scenario_network, set, 1, 63),
    CYAML_FIELD_SEQUENCE("parameters", OPTIONAL_POINTER, struct scenario_network, parameters,
                         &parameter, 0, DSE_PLANT_MAX_PARAMETERS),
    CYAML_FIELD_MAPPING_PTR("graph", OPTIONAL_POINTER, struct scenario_network, graph,
                            graph_fields),
    CYAML_FIELD_MAPPING_PTR("link", OPTIONAL_POINTER, struct scenario_network, link, link_fields)};

static const cyaml_schema_field_t timeouts_fields[] = {
    CYAML_FIELD_FLOAT("repeat_s", OPTIONAL, struct scenario_timeouts, repeat_s),
    CYAML_FIELD_FLOAT("give_up_s", OPTIONAL, struct scenario_timeouts, give_up_s),
    CYAML_FIELD_FLOAT("patience_s", OPTIONAL, struct scenario_timeouts, patience_s),
    CYAML_FIELD_END};

static const cyaml_schema_field_t top_fields[] = {
    CYAML_FIELD_STRING_PTR("name", CYAML_FLAG_POINTER, struct scenario, name, 1, 63),
    CYAML_FIELD_STRING_PTR("title", OPTIONAL_POINTER, struct scenario, title, 1, 200),
    CYAML_FIELD_STRING_PTR("source", OPTIONAL_POINTER, struct scenario, source, 1, 400),
    CYAML_FIELD_UINT("seed", OPTIONAL, struct scenario, seed),
    CYAML_FIELD_MAPPING("time", CYAML_FLAG_DEFAULT, struct scenario, time, time_fields),
    CYAML_FIELD_MAPPING("plant", CYAML_FLAG_DEFAULT, struct scenario, plant, plant_fields),
    CYAML_FIELD_MAPPING("noise", OPTIONAL, struct scenario, noise, noises_fields),
    CYAML_FIELD_SEQUENCE("networks", CYAML_FLAG_POINTER, struct scenario, networks, NULL, 1,
                         SCENARIO_MAX_NETWORKS),
    CYAML_FIELD_MAPPING("timeouts", OPTIONAL, struct scenario, timeouts, timeouts_fields),
    CYAML_FIELD_END};

const struct scenario_rule scenario_rules[] = {
    {.key = "name", SCENARIO_ANY, .meaning = "name of the experiment: letters, digits, _ and -"},
    {.key = "title", SCENARIO_ANY, .absent = "none", .meaning = "one line for reports"},
    {.key = "source", SCENARIO_ANY, .absent = "none", .meaning = "where the experiment comes from"},
    {.key = "seed", SCENARIO_ANY, .absent = "0", .meaning = "of all random numbers of the run"},
    {.key = "time", SCENARIO_ANY, .meaning = "sampling"},
    {.key = "time.period_s", SCENARIO_ABOVE(0), .meaning = "sampling period in seconds"},
    {.key = "time.duration_s",
     SCENARIO_ABOVE(0),
     .meaning = "length of the run in seconds, at least one period"},
    {.key = "plant", SCENARIO_ANY, .meaning = "the simulated process"},
    {.key = "plant.name", SCENARIO_ANY, .meaning = "one of the shipped plants, or linear"},
    {.key = "plant.linear",
     SCENARIO_ANY,
     .absent = "none",
     .meaning = "the plant called linear: x' or x(k+1) = A x + B u, y = C x, around origin"},
    {.key = "plant.linear.time",
     SCENARIO_ANY,
     .absent = "continuous",
     .meaning = "discrete: one step per sample"},
    {.key = "plant.linear.unit_s",
     SCENARIO_ABOVE(0),
     .absent = "1",
     .meaning = "seconds in one unit of the plant's time"},
    {.key = "plant.linear.nx",
     .min = 1,
     .max = DSE_PLANT_MAX_STATES,
     .meaning = "number of states"},
    {.key = "plant.linear.nu",
     .min = 0,
     .max = DSE_PLANT_MAX_INPUTS,
     .absent = "0",
     .meaning = "number of inputs"},
    {.key = "plant.linear.unknown",
     .min = 0,
     .max = DSE_PLANT_MAX_INPUTS,
     .absent = "0",
     .meaning = "how many inputs, the last ones, are disturbances that estimators are not told"},
    {.key = "plant.linear.A", SCENARIO_ANY, .meaning = "nx x nx numbers, row by row"},
    {.key = "plant.linear.B",
     SCENARIO_ANY,
     .absent = "no inputs",
     .meaning = "nx x nu numbers, row by row"},
    {.key = "plant.linear.C", SCENARIO_ANY, .meaning = "one row of nx numbers per output"},
    {.key = "plant.linear.A_sin",
     SCENARIO_ANY,
     .absent = "A is constant",
     .meaning = "nx x nx numbers: the matrix is A + A_sin sin(omega t)"},
    {.key = "plant.linear.omega",
     SCENARIO_ABOVE(0),
     .absent = "not used",
     .meaning = "of A_sin, rad/s"},
    {.key = "plant.linear.origin",
     SCENARIO_ANY,
     .count = SCENARIO_PER_STATE,
     .absent = "0",
     .meaning = "operating point o of the states: A acts on x - o; inputs are deviations"},
    {.key = "plant.linear.states",
     SCENARIO_ANY,
     .absent = "x1, x2, ..",
     .meaning = "names of the states, in order"},
    {.key = "plant.linear.groups",
     .min = 0,
     .max = DSE_PLANT_MAX_OUTPUTS,
     .absent = "one group",
     .meaning = "how many outputs each sensor group has, in the order of the rows of C"},
    {.key = "plant.linear.blocks",
     .min = 0,
     .max = DSE_PLANT_MAX_STATES,
     .absent = "none",
     .meaning = "how many states belong to each group, in order: the plant's subsystems"},
    {.key = "plant.set",
     SCENARIO_ANY,
     .absent = "the plant's first",
     .meaning = "named set of parameter values and initial state"},
    {.key = "plant.parameters",
     SCENARIO_ANY,
     .absent = "none",
     .meaning = "changes to the set's parameter values"},
    {.key = "plant.parameters[].name", SCENARIO_ANY, .meaning = "a parameter of the plant"},
    {.key = "plant.parameters[].value", SCENARIO_ANY, .meaning = "in the parameter's unit"},
    {.key = "plant.x0",
     SCENARIO_ANY,
     .count = SCENARIO_PER_STATE,
     .absent = "that of the set",
     .meaning =
         "true initial state in the plant's units; that of the linear plant's set is origin"},
    {.key = "plant.inputs",
     SCENARIO_ANY,
     .count = SCENARIO_PER_INPUT,
     .absent = "nominal",
     .meaning = "inputs in the plant's units; constant where nothing drives them"},
    {.key = "plant.drive",
     SCENARIO_ANY,
     .absent = "constant",
     .meaning = "inputs that vary; the estimators get their values at every sample"},
    {.key = "plant.drive[].name", SCENARIO_ANY, .meaning = "an input of the plant"},
    {.key = "plant.drive[].signal",
     SCENARIO_ANY,
     .absent = "constant",
     .meaning = "what the input does, or the set point of its loop"},
    {.key = "plant.drive[].value",
     SCENARIO_ANY,
     .meaning = "constant, value before the first step, or mean of sinusoid and prbs"},
    {.key = "plant.drive[].amplitude",
     SCENARIO_ABOVE(0),
     .absent = "not used",
     .meaning = "of a sinusoid; a prbs is value +- amplitude"},
    {.key = "plant.drive[].omega",
     SCENARIO_ABOVE(0),
     .absent = "not used",
     .meaning = "of a sinusoid, value + amplitude sin(omega t + phase), rad/s"},
    {.key = "plant.drive[].phase", SCENARIO_ANY, .absent = "0", .meaning = "of a sinusoid, rad"},
    {.key = "plant.drive[].bit_s",
     SCENARIO_ABOVE(0),
     .absent = "not used",
     .meaning = "of a prbs: seconds per bit, a whole number of periods"},
    {.key = "plant.drive[].steps",
     SCENARIO_ANY,
     .absent = "not used",
     .meaning = "ascending in time"},
    {.key = "plant.drive[].steps[].at_s",
     SCENARIO_AT_LEAST(0),
     .meaning = "when, in seconds; from the first sample not before it"},
    {.key = "plant.drive[].steps[].value", SCENARIO_ANY, .meaning = "from there on"},
    {.key = "plant.drive[].loop",
     SCENARIO_ANY,
     .absent = "none",
     .meaning = "PID control of an output by this input; the signal is its set point"},
    {.key = "plant.drive[].loop.output",
     SCENARIO_ANY,
     .meaning = "the output that is controlled, as measured"},
    {.key = "plant.drive[].loop.outer",
     SCENARIO_ANY,
     .meaning = "from the output to the input, or to its set point in a cascade"},
    {.key = "plant.drive[].loop.outer.kp",
     SCENARIO_ANY,
     .meaning = "gain, input unit per output unit"},
    {.key = "plant.drive[].loop.outer.ti_s",
     SCENARIO_ABOVE(0),
     .absent = "no integral",
     .meaning = "integral time in seconds"},
    {.key = "plant.drive[].loop.outer.td_s",
     SCENARIO_AT_LEAST(0),
     .absent = "0",
     .meaning = "derivative time in seconds; acts on the output"},
    {.key = "plant.drive[].loop.inner",
     SCENARIO_ANY,
     .absent = "no cascade",
     .meaning = "from the input itself to the command of its actuator"},
    {.key = "plant.drive[].loop.inner.kp", SCENARIO_ANY, .meaning = "gain"},
    {.key = "plant.drive[].loop.inner.ti_s",
     SCENARIO_ABOVE(0),
     .absent = "no integral",
     .meaning = "integral time in seconds"},
    {.key = "plant.drive[].loop.inner.td_s",
     SCENARIO_AT_LEAST(0),
     .absent = "0",
     .meaning = "derivative time in seconds"},
    {.key = "plant.drive[].loop.low", SCENARIO_ANY, .meaning = "smallest value of the input"},
    {.key = "plant.drive[].loop.high", SCENARIO_ANY, .meaning = "largest value of the input"},
    {.key = "plant.drive[].loop.lag_s",
     SCENARIO_AT_LEAST(0),
     .absent = "0",
     .meaning = "time constant of the actuator in a cascade, in seconds"},
    {.key = "plant.integrator",
     SCENARIO_ANY,
     .absent = "cvode",
     .meaning = "how the process is integrated; without meaning for a discrete plant"},
    {.key = "plant.integrator.kind",
     SCENARIO_ANY,
     .absent = "cvode",
     .meaning = "cvode: adaptive and implicit; rk4: one Runge-Kutta step per sample; flow: the "
                "fields behind a reduced flow model, from the run that is called as the set"},
    {.key = "plant.integrator.rtol",
     SCENARIO_ABOVE(0),
     .absent = "1e-10",
     .meaning = "relative tolerance of cvode"},
    {.key = "plant.integrator.atol",
     SCENARIO_ABOVE(0),
     .absent = "1e-12",
     .meaning = "absolute tolerance of cvode, in units of each state's scale"},
    {.key = "noise", SCENARIO_ANY, .absent = "none", .meaning = "drawn anew at every sample"},
    {.key = "noise.process",
     SCENARIO_ANY,
     .absent = "none",
     .meaning = "added to the derivative and held over the sample; to the next state if discrete"},
    {.key = "noise.process.distribution", SCENARIO_ANY, .meaning = "shape of the noise"},
    {.key = "noise.process.scale",
     SCENARIO_AT_LEAST(0),
     .count = SCENARIO_PER_STATE,
     .absent = "none",
     .meaning =
         "bound (uniform) or standard deviation (gaussian), per plant time unit if continuous"},
    {.key = "noise.process.limit",
     SCENARIO_AT_LEAST(0),
     .count = SCENARIO_PER_STATE,
     .absent = "none",
     .meaning = "gaussian noise beyond +- limit is clipped to it"},
    {.key = "noise.measurement", SCENARIO_ANY, .absent = "none", .meaning = "added to the outputs"},
    {.key = "noise.measurement.distribution", SCENARIO_ANY, .meaning = "shape of the noise"},
    {.key = "noise.measurement.scale",
     SCENARIO_AT_LEAST(0),
     .count = SCENARIO_PER_OUTPUT,
     .absent = "none",
     .meaning = "bound (uniform) or standard deviation (gaussian), in the output's unit"},
    {.key = "noise.measurement.limit",
     SCENARIO_AT_LEAST(0),
     .count = SCENARIO_PER_OUTPUT,
     .absent = "none",
     .meaning = "gaussian noise beyond +- limit is clipped to it"},
    {.key = "noise.missing",
     .min = 0,
     .max = 1,
     .absent = "0",
     .meaning = "probability that an output's value is missing, drawn per output and sample"},
    {.key = "noise.dead",
     SCENARIO_ANY,
     .absent = "none",
     .meaning = "sensors that give no value for a time"},
    {.key = "noise.dead[].output", SCENARIO_ANY, .meaning = "an output of the plant"},
    {.key = "noise.dead[].start_s",
     SCENARIO_AT_LEAST(0),
     .meaning = "from the first sample not before it, in seconds"},
    {.key = "noise.dead[].end_s",
     SCENARIO_ABOVE(0),
     .absent = "never ends",
     .meaning = "to the last sample before it, in seconds"},
    {.key = "networks",
     SCENARIO_ANY,
     .meaning = "estimators side by side on the same measurements; each with one method"},
    {.key = "networks[].name", SCENARIO_ANY, .meaning = "unique: letters, digits, _ and -"},
    {.key = "networks[].title",
     SCENARIO_ANY,
     .absent = "the method's",
     .meaning = "a few words for tables and legends"},
    {.key = "networks[].guess",
     SCENARIO_ANY,
     .count = SCENARIO_PER_STATE,
     .absent = "none; methods say so that need it",
     .meaning = "initial guess of the whole state in the plant's units"},
    {.key = "networks[].set",
     SCENARIO_ANY,
     .absent = "as the plant",
     .meaning = "the estimators' own parameter set (model mismatch)"},
    {.key = "networks[].parameters",
     SCENARIO_ANY,
     .absent = "as the plant",
     .meaning = "the estimators' own parameter values (model mismatch)"},
    {.key = "networks[].parameters[].name", SCENARIO_ANY, .meaning = "a parameter of the plant"},
    {.key = "networks[].parameters[].value", SCENARIO_ANY, .meaning = "in the parameter's unit"},
    {.key = "networks[].graph",
     SCENARIO_ANY,
     .absent = "the method's",
     .meaning = "who hears whom, for methods that are made for it"},
    {.key = "networks[].graph.nodes",
     .min = 1,
     .max = METHOD_MAX_NODES,
     .meaning = "number of nodes"},
    {.key = "networks[].graph.edges",
     SCENARIO_ANY,
     .meaning = "from, to, from, to, ..: nodes counted from 0; 'to' hears 'from'"},
    {.key = "networks[].graph.undirected",
     SCENARIO_ANY,
     .absent = "no",
     .meaning = "each edge is meant both ways"},
    {.key = "networks[].link",
     SCENARIO_ANY,
     .absent = "nothing late or lost",
     .meaning = "delays and losses of the network, put in at the receivers"},
    {.key = "networks[].link.D",
     .min = 0,
     .max = SCENARIO_MAX_DELAY,
     .absent = "0",
     .meaning = "largest delay, in communication periods; what comes later is lost"},
    {.key = "networks[].link.T_m",
     .min = 0,
     .max = 1000000,
     .absent = "0",
     .meaning = "most consecutive losses of one sender and receiver"},
    {.key = "networks[].link.loss",
     .min = 0,
     .max = 1,
     .absent = "0",
     .meaning = "probability that a packet is lost, where T_m allows it"},
    {.key = "networks[].link.seed",
     SCENARIO_ANY,
     .absent = "0",
     .meaning = "added to the scenario's seed: other delays with the same noise"},
    {.key = "networks[].link.file",
     SCENARIO_ANY,
     .absent = "random",
     .meaning = "recorded network, a CSV beside the scenario: to,from,stamp,delay"},
    {.key = "networks[].link.outages",
     SCENARIO_ANY,
     .absent = "none",
     .meaning = "times without any message, in addition to delays and losses"},
    {.key = "networks[].link.outages[].from",
     .min = -1,
     .max = METHOD_MAX_NODES - 1,
     .meaning = "node that is not heard, -1: any"},
    {.key = "networks[].link.outages[].to",
     .min = -1,
     .max = METHOD_MAX_NODES - 1,
     .meaning = "node that does not hear it, -1: any"},
    {.key = "networks[].link.outages[].start_s",
     SCENARIO_AT_LEAST(0),
     .meaning = "seconds; what is sent from the first sample not before it is lost"},
    {.key = "networks[].link.outages[].end_s",
     SCENARIO_ABOVE(0),
     .absent = "never",
     .meaning = "seconds; what is sent from the first sample not before it arrives again"},
    {.key = "timeouts",
     SCENARIO_ANY,
     .absent = "0.05, 20, 5",
     .meaning = "of a run over the network"},
    {.key = "timeouts.repeat_s",
     SCENARIO_ABOVE(0),
     .absent = "0.05",
     .meaning = "a missing message is asked for again after this, in seconds"},
    {.key = "timeouts.give_up_s",
     SCENARIO_ABOVE(0),
     .absent = "20",
     .meaning = "nobody waits longer than this for anything, in seconds"},
    {.key = "timeouts.patience_s",
     SCENARIO_ABOVE(0),
     .absent = "5",
     .meaning = "nor longer than this for a node that it can do without, in seconds"},
    {.key = NULL}};

#define ROOM(array) CYAML_ARRAY_LEN(((struct scenario_schema *)NULL)->array)
_Static_assert(CYAML_ARRAY_LEN(network_fields) + SCENARIO_MAX_METHODS < ROOM(network),
               "no room for the sections and the end mark");
_Static_assert(CYAML_ARRAY_LEN(top_fields) <= ROOM(top), "no room for the top keys");

void scenario_schema_make(struct scenario_schema *schema)
{
    int n = CYAML_ARRAY_LEN(network_fields);
    memcpy(schema->network, network_fields, sizeof network_fields);
    for (int i = 0; i < SCENARIO_MAX_METHODS && method_at(i) != NULL; i++) {
        const struct method *method = method_at(i);
        schema->network[n++] = (cyaml_schema_field_t){
            .key = method->name,
            .data_offset =
                (uint32_t)(offsetof(struct scenario_network, section) + (size_t)i * sizeof(void *)),
            .value = {.type = CYAML_MAPPING,
                      .flags = (enum cyaml_flag)OPTIONAL_POINTER,
                      .data_size = method->section_size,
                      .mapping = {.fields = method->fields}}};
    }
    schema->network[n] = (cyaml_schema_field_t)CYAML_FIELD_END;
    schema->network_entry = (cyaml_schema_value_t){
        CYAML_VALUE_MAPPING(CYAML_FLAG_DEFAULT, struct scenario_network, schema->network)};

    memcpy(schema->top, top_fields, sizeof top_fields);
    for (cyaml_schema_field_t *field = schema->top; field->key != NULL; field++)
        if (strcmp(field->key, "networks") == 0)
            field->value.sequence.entry = &schema->network_entry;
    schema->root = (cyaml_schema_value_t){
        CYAML_VALUE_MAPPING(CYAML_FLAG_POINTER, struct scenario, schema->top)};
}

const cyaml_schema_field_t *scenario_schema_field(const cyaml_schema_field_t *fields,
                                                  const char *key)
{
    for (; fields->key != NULL; fields++)
        if (strcmp(fields->key, key) == 0)
            return fields;
    return NULL;
}

static const struct scenario_rule *find(const struct scenario_rule *rules, const char *key)
{
    for (; rules->key != NULL; rules++)
        if (strcmp(rules->key, key) == 0)
            return rules;
    return NULL;
}

/* networks[0].kalman.Q[1] -> networks[].kalman.Q: the name under which rules are kept. */
static void rule_key(const char *path, char *key, size_t size)
{
    size_t n = 0;
    for (; *path != '\0' && n + 1 < size; path++) {
        if (*path < '0' || *path > '9' || n == 0 || key[n - 1] != '[')
            key[n++] = *path;
    }
    if (n >= 2 && key[n - 2] == '[' && key[n - 1] == ']')
        n -= 2;
    key[n] = '\0';
}

const struct scenario_rule *scenario_rule_find(const char *path)
{
    static const char prefix[] = "networks[].";
    char key[SCENARIO_PATH_SIZE];
    rule_key(path, key, sizeof key);
    if (strncmp(key, prefix, strlen(prefix)) == 0) {
        char *section = key + strlen(prefix);
        char *dot = strchr(section, '.');
        if (dot != NULL) {
            *dot = '\0';
            const struct method *method = method_find(section);
            if (method != NULL)
                return find(method->rules, dot + 1);
            *dot = '.';
        }
    }
    return find(scenario_rules, key);
}
