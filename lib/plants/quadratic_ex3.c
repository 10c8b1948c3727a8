/* Quadratic plant of chapter 3 (3.54) of the consensus-based second-order observers' source:
 *
 *     x1' = -2 x1 - x1 x2      x2' = -x2 + x1^2      x3' = -x3            y = x1
 *
 * Asymptotically stable. x2 is observable while x1 is not 0, x3 is not at all: its error decays by
 * itself, exp(-t). */
#include "dse/plant.h"
#include "dse/quadratic.h"

extern const struct dse_plant dse_plant_quadratic_ex3;

enum { NX = 3, NY = 1, TERMS = 2 };

static const struct dse_signal states[NX] = {
    {"x1", "", DSE_REAL(1), DSE_REAL(1), "state 1"},
    {"x2", "", DSE_REAL(2), DSE_REAL(1), "state 2"},
    {"x3", "", DSE_REAL(1), DSE_REAL(1), "state 3, which nothing measures"},
};

static const struct dse_signal outputs[NY] = {{"y", "", DSE_REAL(1), DSE_REAL(1), "x1"}};

static const int all_states[NX] = {0, 1, 2};
static const int all_outputs[NY] = {0};
static const struct dse_subsystem sensors[] = {{"sensor", NX, all_states, NY, all_outputs}};

static const dse_real x0[NX] = {1, 2, 1};
static const struct dse_parameter_set sets[] = {{"source", "section 3.3", x0, x0}};

static const dse_real A[NX * NX] = {-2, 0, 0, 0, -1, 0, 0, 0, -1};
static const dse_real C[NY * NX] = {1, 0, 0};
static const struct dse_quadratic_term terms[TERMS] = {{0, 0, 1, -1}, {1, 0, 0, 1}};
static const struct dse_quadratic process = {.A = A, .C = C, .terms = TERMS, .term = terms};

static enum dse_status prepare(const dse_real *values, dse_real *prepared)
{
    (void)values;
    prepared[0] = 0; /* nothing to choose */
    return DSE_OK;
}

static void model(const dse_real *prepared, struct dse_model *out)
{
    (void)prepared;
    dse_quadratic_model(out, NX, 0, NY, &process);
}

const struct dse_plant dse_plant_quadratic_ex3 = {
    .name = "quadratic_ex3",
    .title = "stable quadratic system with one sensor",
    .source = "consensus-based second-order observers, section 3.3",
    .time_unit = "s",
    .time_unit_s = DSE_REAL(1),
    .nx = NX,
    .nu = 0,
    .ny = NY,
    .states = states,
    .outputs = outputs,
    .n_sets = 1,
    .sets = sets,
    .n_subsystems = 1,
    .subsystems = sensors,
    .prepared_size = 1,
    .prepare = prepare,
    .model = model,
};
