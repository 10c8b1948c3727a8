/* Keys, meanings and limits of the section `coordinated_mhe`. */
#include "methods/coordinated_mhe_section.h"

#define WORD         (CYAML_FLAG_OPTIONAL | CYAML_FLAG_STRICT)
#define LIST         CYAML_FLAG_POINTER
#define OPTIONAL     CYAML_FLAG_OPTIONAL
#define LONGEST_LIST 100000
#define LONGEST      10000 /* horizons, iterations */

static const cyaml_schema_value_t number = {CYAML_VALUE_FLOAT(CYAML_FLAG_DEFAULT, double)};

static const cyaml_strval_t schemes[] = {{"prediction", COORDINATED_MHE_PREDICTION},
                                         {"price", COORDINATED_MHE_PRICE},
                                         {"decentralised", COORDINATED_MHE_DECENTRALISED},
                                         {"centralised", COORDINATED_MHE_CENTRALISED}};
static const cyaml_strval_t starts[] = {{"default", DSE_MHE_START_DEFAULT},
                                        {"zero", DSE_MHE_START_ZERO},
                                        {"previous", DSE_MHE_START_PREVIOUS},
                                        {"closed_form", DSE_MHE_START_CLOSED_FORM}};
static const cyaml_strval_t warm_starts[] = {{"hold", COORDINATED_MHE_HOLD},
                                             {"shift", COORDINATED_MHE_SHIFT}};

#define NUMBERS(key, flags)                                                                        \
    CYAML_FIELD_SEQUENCE(#key, flags, struct coordinated_mhe_section, key, &number, 1, LONGEST_LIST)
#define NUMBER(key) CYAML_FIELD_FLOAT(#key, OPTIONAL, struct coordinated_mhe_section, key)
#define WHOLE(key)  CYAML_FIELD_UINT(#key, OPTIONAL, struct coordinated_mhe_section, key)
#define YES(key)    CYAML_FIELD_BOOL(#key, OPTIONAL, struct coordinated_mhe_section, key)

const cyaml_schema_field_t coordinated_mhe_fields[] = {
    CYAML_FIELD_ENUM("scheme", CYAML_FLAG_STRICT, struct coordinated_mhe_section, scheme, schemes,
                     CYAML_ARRAY_LEN(schemes)),
    CYAML_FIELD_UINT("Hp", CYAML_FLAG_DEFAULT, struct coordinated_mhe_section, Hp),
    CYAML_FIELD_UINT("Hmin", CYAML_FLAG_DEFAULT, struct coordinated_mhe_section, Hmin),
    NUMBERS(Q, LIST),
    NUMBERS(R, LIST),
    NUMBERS(D, LIST | OPTIONAL),
    NUMBERS(P_inv, LIST | OPTIONAL),
    NUMBERS(x_min, LIST | OPTIONAL),
    NUMBERS(x_max, LIST | OPTIONAL),
    NUMBERS(w_min, LIST | OPTIONAL),
    NUMBERS(w_max, LIST | OPTIONAL),
    NUMBER(t),
    NUMBERS(origin, LIST | OPTIONAL),
    NUMBER(eps),
    WHOLE(max_iter),
    YES(fixed_iter),
    YES(stop_on_any),
    WHOLE(max_age),
    CYAML_FIELD_ENUM("price_start", WORD, struct coordinated_mhe_section, price_start, starts,
                     CYAML_ARRAY_LEN(starts)),
    NUMBER(kappa),
    WHOLE(recentrings),
    CYAML_FIELD_ENUM("warm_start", WORD, struct coordinated_mhe_section, warm_start, warm_starts,
                     CYAML_ARRAY_LEN(warm_starts)),
    NUMBER(rho_consistent),
    NUMBER(beta),
    WHOLE(anderson),
    NUMBERS(x_weight, LIST | OPTIONAL),
    NUMBERS(p_weight, LIST | OPTIONAL),
    NUMBERS(eps_i, LIST | OPTIONAL),
    CYAML_FIELD_END};

const struct scenario_rule coordinated_mhe_rules[] = {
    {.key = "scheme",
     SCENARIO_ANY,
     .meaning =
         "coordinated by predictions or prices, each subsystem for itself, or one estimator"},
    {.key = "Hp", .min = 1, .max = LONGEST, .meaning = "samples of a full window"},
    {.key = "Hmin",
     .min = 1,
     .max = LONGEST,
     .meaning = "samples of the shortest window that is solved; before: open-loop prediction"},
    {.key = "Q",
     SCENARIO_ABOVE(0),
     .count = SCENARIO_PER_STATE,
     .meaning = "diagonal: variance of the disturbance w of each state over a sample"},
    {.key = "R",
     SCENARIO_ABOVE(0),
     .count = SCENARIO_PER_OUTPUT,
     .meaning = "diagonal: variance of each output's noise"},
    {.key = "D",
     SCENARIO_ABOVE(0),
     .count = SCENARIO_PER_STATE,
     .absent = "none: price is singular then",
     .meaning = "diagonal: how far interactions may move (price); with centralised: the same cost"},
    {.key = "P_inv",
     SCENARIO_AT_LEAST(0),
     .count = SCENARIO_PER_STATE,
     .absent = "no arrival cost",
     .meaning = "diagonal: weight of the oldest sample's earlier estimate"},
    {.key = "x_min",
     SCENARIO_ANY,
     .count = SCENARIO_PER_STATE,
     .absent = "no bounds",
     .meaning = "lower bound of each state, physical units; -1e30 and below: none"},
    {.key = "x_max",
     SCENARIO_ANY,
     .count = SCENARIO_PER_STATE,
     .absent = "no bounds",
     .meaning = "upper bound of each state, physical units; 1e30 and above: none"},
    {.key = "w_min",
     SCENARIO_ANY,
     .count = SCENARIO_PER_STATE,
     .absent = "no bounds",
     .meaning = "lower bound of each disturbance; -1e30 and below: none"},
    {.key = "w_max",
     SCENARIO_ANY,
     .count = SCENARIO_PER_STATE,
     .absent = "no bounds",
     .meaning = "upper bound of each disturbance; 1e30 and above: none"},
    {.key = "t",
     SCENARIO_ABOVE(0),
     .absent = "hard bounds",
     .meaning = "log barrier (1/t) sum -log(distance to the bound) in place of hard bounds"},
    {.key = "origin",
     SCENARIO_ANY,
     .count = SCENARIO_PER_STATE,
     .absent = "that of a linear plant",
     .meaning = "steady state about which the plant is linearised; needed by nonlinear plants"},
    {.key = "eps",
     SCENARIO_ABOVE(0),
     .absent = "0.001",
     .meaning = "stop when |E| (price) or the change of X (prediction) is below"},
    {.key = "max_iter",
     .min = 1,
     .max = LONGEST,
     .absent = "100",
     .meaning = "rounds of a sample at most; it ends as premature then"},
    {.key = "fixed_iter",
     SCENARIO_ANY,
     .absent = "false",
     .meaning = "true: exactly max_iter rounds, whatever the test says"},
    {.key = "stop_on_any",
     SCENARIO_ANY,
     .absent = "false",
     .meaning = "true: the stopping test does not ask for fresh answers, as in the source"},
    {.key = "max_age",
     .min = 1,
     .max = 1000000000,
     .absent = "Hp",
     .meaning = "samples for which data of who is not heard are held"},
    {.key = "price_start",
     SCENARIO_ANY,
     .absent = "closed_form with bounds, previous without",
     .meaning = "prices of a sample's first round (price)"},
    {.key = "kappa",
     SCENARIO_ABOVE(0),
     .absent = "Newton steps",
     .meaning = "step p + kappa E of a gradient iteration (price)"},
    {.key = "recentrings",
     .min = 0,
     .max = LONGEST,
     .absent = "0",
     .meaning = "passes that remove the bias of D, one round each without bounds (price)"},
    {.key = "warm_start",
     SCENARIO_ANY,
     .absent = "hold",
     .meaning = "first X of a sample: that of the sample before, as it is or shifted (prediction)"},
    {.key = "rho_consistent",
     SCENARIO_ABOVE(0),
     .absent = "the literal Algorithm 2",
     .meaning = "certificate of the consistent variant, which it asks for (prediction)"},
    {.key = "beta",
     .min = 0,
     .max = 1,
     .min_open = true,
     .absent = "1",
     .meaning = "relaxation of new interactions and prices (prediction)"},
    {.key = "anderson",
     .min = 0,
     .max = 100,
     .absent = "0: none",
     .meaning = "memory of Anderson acceleration (prediction)"},
    {.key = "x_weight",
     SCENARIO_ABOVE(0),
     .count = SCENARIO_PER_STATE,
     .absent = "ones",
     .meaning = "weights of the states in its least squares"},
    {.key = "p_weight",
     SCENARIO_ABOVE(0),
     .count = SCENARIO_PER_STATE,
     .absent = "ones",
     .meaning = "weights of the prices in its least squares"},
    {.key = "eps_i",
     SCENARIO_AT_LEAST(0),
     .count = SCENARIO_PER_SUBSYSTEM,
     .absent = "always",
     .meaning = "an agent sends X when it has changed by this norm since it last did (prediction)"},
    {.key = NULL}};

bool coordinated_mhe_is_coordinated(const struct coordinated_mhe_section *section)
{
    return section->scheme == COORDINATED_MHE_PREDICTION ||
           section->scheme == COORDINATED_MHE_PRICE;
}

static bool refuse(struct error *error, const char *key, const char *scheme)
{
    return error_set(error, "coordinated_mhe.%s: it goes with scheme %s only", key, scheme);
}

bool coordinated_mhe_section_check(const struct coordinated_mhe_section *section,
                                   struct error *error)
{
    bool price = section->scheme == COORDINATED_MHE_PRICE;
    bool prediction = section->scheme == COORDINATED_MHE_PREDICTION;
    if (section->Hmin > section->Hp)
        return error_set(error, "coordinated_mhe.Hmin: %u is more than Hp = %u", section->Hmin,
                         section->Hp);
    if (section->D != NULL && !price && section->scheme != COORDINATED_MHE_CENTRALISED)
        return refuse(error, "D", "price or centralised");
    if (section->price_start != DSE_MHE_START_DEFAULT && !price)
        return refuse(error, "price_start", "price");
    if (section->kappa > 0 && !price)
        return refuse(error, "kappa", "price");
    if (section->recentrings > 0 && !price)
        return refuse(error, "recentrings", "price");
    if (section->anderson > 0 && !prediction)
        return refuse(error, "anderson", "prediction");
    if (section->eps_i != NULL && !prediction)
        return refuse(error, "eps_i", "prediction");
    if (section->rho_consistent > 0 && !prediction)
        return refuse(error, "rho_consistent", "prediction");
    if (section->t > 0 && price)
        return refuse(error, "t", "prediction, decentralised or centralised");
    return true;
}
