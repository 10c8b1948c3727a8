/* Keys, meanings and limits of the section `high_gain_ekf`. */
#include "methods/high_gain_ekf_section.h"

#include <math.h>

#define WORD             (CYAML_FLAG_OPTIONAL | CYAML_FLAG_STRICT)
#define OPTIONAL_POINTER (CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL)
#define LONGEST_LIST     100000
#define LONGEST_HORIZON  100000

static const cyaml_schema_value_t number = {CYAML_VALUE_FLOAT(CYAML_FLAG_DEFAULT, double)};

static const cyaml_strval_t coordinates[] = {{"normal", DSE_HIGH_GAIN_NORMAL},
                                             {"mapped", DSE_HIGH_GAIN_MAPPED},
                                             {"physical", DSE_HIGH_GAIN_PHYSICAL}};
static const cyaml_strval_t scalings[] = {{"full", DSE_HIGH_GAIN_FULL},
                                          {"plain", DSE_HIGH_GAIN_PLAIN}};
static const cyaml_strval_t gains[] = {{"adaptive", DSE_HIGH_GAIN_ADAPT},
                                       {"one", DSE_HIGH_GAIN_ONE},
                                       {"permanent", DSE_HIGH_GAIN_MAX}};
static const cyaml_schema_value_t gain_word = {
    CYAML_VALUE_ENUM(CYAML_FLAG_STRICT, enum dse_high_gain_gain, gains, CYAML_ARRAY_LEN(gains))};
static const cyaml_strval_t frameworks[] = {{"distributed", HIGH_GAIN_EKF_DISTRIBUTED},
                                            {"centralised", HIGH_GAIN_EKF_CENTRALISED}};
static const cyaml_strval_t innovations[] = {{"own", DSE_HIGH_GAIN_OWN},
                                             {"sum", DSE_HIGH_GAIN_SUM}};
static const cyaml_strval_t kinds[] = {{"tick", DSE_HIGH_GAIN_TICK},
                                       {"stages", DSE_HIGH_GAIN_STAGES},
                                       {"none", DSE_HIGH_GAIN_NONE},
                                       {"triggered", DSE_HIGH_GAIN_TRIGGERED}};
static const cyaml_strval_t norms[] = {{"absolute", DSE_TRIGGER_ABSOLUTE},
                                       {"relative", DSE_TRIGGER_RELATIVE}};
static const cyaml_strval_t predictors[] = {{"true", DSE_HIGH_GAIN_PREDICT},
                                            {"false", DSE_HIGH_GAIN_HOLD}};

static const cyaml_schema_field_t trigger_fields[] = {
    CYAML_FIELD_ENUM("norm", WORD, struct high_gain_ekf_trigger, norm, norms,
                     CYAML_ARRAY_LEN(norms)),
    CYAML_FIELD_FLOAT("L", CYAML_FLAG_DEFAULT, struct high_gain_ekf_trigger, L),
    CYAML_FIELD_SEQUENCE("H", OPTIONAL_POINTER, struct high_gain_ekf_trigger, H, &number, 1,
                         LONGEST_LIST),
    CYAML_FIELD_END};

static const cyaml_schema_field_t parameter_fields[] = {
    CYAML_FIELD_STRING_PTR("name", CYAML_FLAG_POINTER, struct scenario_parameter, name, 1, 63),
    CYAML_FIELD_FLOAT("value", CYAML_FLAG_DEFAULT, struct scenario_parameter, value),
    CYAML_FIELD_END};
static const cyaml_schema_value_t parameter = {
    CYAML_VALUE_MAPPING(CYAML_FLAG_DEFAULT, struct scenario_parameter, parameter_fields)};

static const cyaml_schema_field_t communication_fields[] = {
    CYAML_FIELD_ENUM("kind", WORD, struct high_gain_ekf_communication, kind, kinds,
                     CYAML_ARRAY_LEN(kinds)),
    CYAML_FIELD_UINT("every", CYAML_FLAG_OPTIONAL, struct high_gain_ekf_communication, every),
    CYAML_FIELD_ENUM("predictor", WORD, struct high_gain_ekf_communication, predictor, predictors,
                     CYAML_ARRAY_LEN(predictors)),
    CYAML_FIELD_MAPPING_PTR("trigger", OPTIONAL_POINTER, struct high_gain_ekf_communication,
                            trigger, trigger_fields),
    CYAML_FIELD_END};

const cyaml_schema_field_t high_gain_ekf_fields[] = {
    CYAML_FIELD_ENUM("framework", WORD, struct high_gain_ekf_section, framework, frameworks,
                     CYAML_ARRAY_LEN(frameworks)),
    CYAML_FIELD_ENUM("coordinates", WORD, struct high_gain_ekf_section, coordinates, coordinates,
                     CYAML_ARRAY_LEN(coordinates)),
    CYAML_FIELD_ENUM("scaling", WORD, struct high_gain_ekf_section, scaling, scalings,
                     CYAML_ARRAY_LEN(scalings)),
    CYAML_FIELD_ENUM("gain", WORD, struct high_gain_ekf_section, gain, gains,
                     CYAML_ARRAY_LEN(gains)),
    CYAML_FIELD_SEQUENCE("gains", OPTIONAL_POINTER, struct high_gain_ekf_section, gains, &gain_word,
                         1, LONGEST_LIST),
    CYAML_FIELD_ENUM("innovation", WORD, struct high_gain_ekf_section, innovation, innovations,
                     CYAML_ARRAY_LEN(innovations)),
    CYAML_FIELD_MAPPING("communication", CYAML_FLAG_OPTIONAL, struct high_gain_ekf_section,
                        communication, communication_fields),
    CYAML_FIELD_SEQUENCE("predictor_parameters", OPTIONAL_POINTER, struct high_gain_ekf_section,
                         predictor_parameters, &parameter, 0, DSE_PLANT_MAX_PARAMETERS),
    CYAML_FIELD_FLOAT("d", CYAML_FLAG_DEFAULT, struct high_gain_ekf_section, d),
    CYAML_FIELD_FLOAT("DeltaT", CYAML_FLAG_DEFAULT, struct high_gain_ekf_section, DeltaT),
    CYAML_FIELD_FLOAT("beta", CYAML_FLAG_DEFAULT, struct high_gain_ekf_section, beta),
    CYAML_FIELD_FLOAT("m", CYAML_FLAG_DEFAULT, struct high_gain_ekf_section, m),
    CYAML_FIELD_FLOAT("lambda", CYAML_FLAG_DEFAULT, struct high_gain_ekf_section, lambda),
    CYAML_FIELD_FLOAT("theta_m", CYAML_FLAG_DEFAULT, struct high_gain_ekf_section, theta_m),
    CYAML_FIELD_SEQUENCE("Q", CYAML_FLAG_POINTER, struct high_gain_ekf_section, Q, &number, 1,
                         LONGEST_LIST),
    CYAML_FIELD_SEQUENCE("R", CYAML_FLAG_POINTER, struct high_gain_ekf_section, R, &number, 1,
                         LONGEST_LIST),
    CYAML_FIELD_SEQUENCE("P0", OPTIONAL_POINTER, struct high_gain_ekf_section, P0, &number, 1,
                         LONGEST_LIST),
    CYAML_FIELD_END};

const struct scenario_rule high_gain_ekf_rules[] = {
    {.key = "framework",
     SCENARIO_ANY,
     .absent = "distributed",
     .meaning = "a filter for each subsystem, or one for the whole plant with all outputs"},
    {.key = "coordinates",
     SCENARIO_ANY,
     .absent = "normal",
     .meaning = "where the filter state lives: z_i; chi_i with mapped gain; chi_i throughout"},
    {.key = "scaling",
     SCENARIO_ANY,
     .absent = "full",
     .meaning = "how theta enters Q and R: with powers per chain entry, or as a factor"},
    {.key = "gain",
     SCENARIO_ANY,
     .absent = "adaptive",
     .meaning = "theta adapted; theta = 1: regular EKF; theta = 2 theta_m: permanent high gain"},
    {.key = "gains",
     SCENARIO_ANY,
     .count = SCENARIO_PER_SUBSYSTEM,
     .absent = "all as gain",
     .meaning = "the same word for each filter, where they differ"},
    {.key = "innovation",
     SCENARIO_ANY,
     .absent = "own",
     .meaning = "what drives theta: J_i, or the sum of all J_i, exchanged at every tick"},
    {.key = "communication",
     SCENARIO_ANY,
     .absent = "every tick",
     .meaning = "when the filters exchange their states"},
    {.key = "communication.kind",
     SCENARIO_ANY,
     .absent = "tick",
     .meaning = "at ticks; at every Runge-Kutta stage; never; at ticks where a trigger fires"},
    {.key = "communication.every",
     .min = 1,
     .max = 1000000,
     .absent = "1",
     .meaning = "ticks between exchanges, or between checks of the trigger"},
    {.key = "communication.predictor",
     SCENARIO_ANY,
     .absent = "true",
     .meaning = "between exchanges the neighbours' states follow the model; false: they are held"},
    {.key = "communication.trigger",
     SCENARIO_ANY,
     .absent = "none; needed by kind triggered",
     .meaning = "when a filter sends its state (kind triggered)"},
    {.key = "communication.trigger.norm",
     SCENARIO_ANY,
     .absent = "absolute",
     .meaning = "|H (z - z_q)|; |H (x - x_q)/x_q| of the physical estimate; q: last sent"},
    {.key = "communication.trigger.L",
     SCENARIO_AT_LEAST(0),
     .meaning = "threshold: it sends when the norm is at least L"},
    {.key = "communication.trigger.H",
     SCENARIO_AT_LEAST(0),
     .count = SCENARIO_PER_STATE,
     .absent = "ones",
     .meaning = "diagonals of H_1, H_2, .. in turn: weights of the norm"},
    {.key = "predictor_parameters",
     SCENARIO_ANY,
     .absent = "those of the filters",
     .meaning = "plant parameters that the predictor of the neighbours' states believes in"},
    {.key = "predictor_parameters[].name", SCENARIO_ANY, .meaning = "a parameter of the plant"},
    {.key = "predictor_parameters[].value", SCENARIO_ANY, .meaning = "in the parameter's unit"},
    {.key = "d",
     SCENARIO_ABOVE(0),
     .meaning = "horizon of the innovation J, plant time; a whole number of periods"},
    {.key = "DeltaT", SCENARIO_ABOVE(0), .meaning = "rise time of theta, plant time"},
    {.key = "beta", SCENARIO_ABOVE(0), .meaning = "sharpness of the switch, 1 / unit of J"},
    {.key = "m",
     SCENARIO_AT_LEAST(0),
     .meaning = "J at which theta rises, (output unit)^2 times plant time"},
    {.key = "lambda", SCENARIO_AT_LEAST(0), .meaning = "rate of theta's return to 1, 1 / time"},
    {.key = "theta_m", SCENARIO_ABOVE(1), .meaning = "half of the largest gain parameter theta"},
    {.key = "Q",
     SCENARIO_AT_LEAST(0),
     .count = SCENARIO_PER_STATE,
     .meaning = "diagonals of Q_1, Q_2, .. in turn: process noise weight at theta = 1"},
    {.key = "R",
     SCENARIO_ABOVE(0),
     .count = SCENARIO_PER_OUTPUT,
     .meaning = "R_1, R_2, ..: measurement noise weight of each output at theta = 1"},
    {.key = "P0",
     SCENARIO_ABOVE(0),
     .count = SCENARIO_PER_STATE,
     .absent = "identity",
     .meaning = "diagonals of P_1(0), P_2(0), .. in turn"},
    {.key = NULL}};

enum dse_high_gain_gain high_gain_ekf_gain(const struct high_gain_ekf_section *section, int i)
{
    return section->gains != NULL ? section->gains[i] : section->gain;
}

int high_gain_ekf_horizon(const struct high_gain_ekf_section *section, double period)
{
    return (int)lround(section->d / period);
}

static bool check_kind(const struct high_gain_ekf_communication *communication, struct error *error)
{
    bool triggered = communication->kind == DSE_HIGH_GAIN_TRIGGERED;
    if (triggered != (communication->trigger != NULL))
        return error_set(error, triggered ? "high_gain_ekf.communication.trigger: kind triggered "
                                            "needs it, with a threshold L"
                                          : "high_gain_ekf.communication.trigger: it needs kind "
                                            "triggered");
    if (communication->kind != DSE_HIGH_GAIN_STAGES)
        return true;
    if (communication->every > 1)
        return error_set(error,
                         "high_gain_ekf.communication.every: %u does not go with kind stages, "
                         "which exchanges within every tick; use kind tick",
                         communication->every);
    if (communication->predictor != DSE_HIGH_GAIN_PREDICT)
        return error_set(error, "high_gain_ekf.communication.predictor: there is nothing between "
                                "exchanges to predict or hold with kind stages; use kind tick");
    return true;
}

bool high_gain_ekf_section_check(const struct high_gain_ekf_section *section, double period,
                                 struct error *error)
{
    const struct high_gain_ekf_communication *communication = &section->communication;
    double ticks = section->d / period;
    if (ticks < 0.5 || ticks > LONGEST_HORIZON)
        return error_set(error,
                         "high_gain_ekf.d: %.10g are %.3g sampling periods; it must be 1 to %d",
                         section->d, ticks, LONGEST_HORIZON);
    if (section->framework == HIGH_GAIN_EKF_CENTRALISED &&
        (communication->trigger != NULL || section->gains != NULL ||
         section->predictor_parameters != NULL))
        return error_set(error, "high_gain_ekf.framework: a centralised filter talks to nobody; "
                                "trigger, gains and predictor_parameters do not go with it");
    return check_kind(communication, error);
}
