/* Quadratic plant of chapter 4 (4.56) of the consensus-based second-order observers' source:
 *
 *     x1' = -x1 - x1 x2        x2' = -x3 + x1^2      x3' = x2
 *     sensor i: y = x1 + x2    sensor j: y = x1 + x3
 *
 * x1 decays, (x2, x3) is left turning at 1 rad/s. The source prints F_1 with all of -x1 x2 in one
 * of its two places; the filters need it symmetric, which a term of dse/quadratic.h is by itself.
 */
#include "dse/plant.h"
#include "dse/quadratic.h"

extern const struct dse_plant dse_plant_quadratic_ex4;
extern const struct dse_plant dse_plant_quadratic_ex4_ring;

enum { NX = 3, NY = 2, RING = 6, TERMS = 2 };

static const struct dse_signal states[NX] = {
    {"x1", "", DSE_REAL(1), DSE_REAL(1), "state 1, decaying"},
    {"x2", "", DSE_REAL(2), DSE_REAL(2), "state 2, turning with state 3"},
    {"x3", "", DSE_REAL(1), DSE_REAL(2), "state 3, turning with state 2"},
};

static const struct dse_signal outputs[NY] = {
    {"y_i", "", DSE_REAL(3), DSE_REAL(2), "x1 + x2 at sensor i"},
    {"y_j", "", DSE_REAL(2), DSE_REAL(2), "x1 + x3 at sensor j"},
};

static const int all_states[NX] = {0, 1, 2};
static const int rows[NY] = {0, 1};
static const struct dse_subsystem sensors[] = {{"sensor i", NX, all_states, 1, rows},
                                               {"sensor j", NX, all_states, 1, rows + 1}};

/* Six of them, alternately of either kind, each with noise of its own. */
static const struct dse_signal ring_outputs[RING] = {
    {"y1", "", DSE_REAL(3), DSE_REAL(2), "x1 + x2 at sensor 1"},
    {"y2", "", DSE_REAL(2), DSE_REAL(2), "x1 + x3 at sensor 2"},
    {"y3", "", DSE_REAL(3), DSE_REAL(2), "x1 + x2 at sensor 3"},
    {"y4", "", DSE_REAL(2), DSE_REAL(2), "x1 + x3 at sensor 4"},
    {"y5", "", DSE_REAL(3), DSE_REAL(2), "x1 + x2 at sensor 5"},
    {"y6", "", DSE_REAL(2), DSE_REAL(2), "x1 + x3 at sensor 6"},
};

static const int ring_rows[RING] = {0, 1, 2, 3, 4, 5};
static const struct dse_subsystem ring_sensors[] = {
    {"sensor 1", NX, all_states, 1, ring_rows},     {"sensor 2", NX, all_states, 1, ring_rows + 1},
    {"sensor 3", NX, all_states, 1, ring_rows + 2}, {"sensor 4", NX, all_states, 1, ring_rows + 3},
    {"sensor 5", NX, all_states, 1, ring_rows + 4}, {"sensor 6", NX, all_states, 1, ring_rows + 5}};

static const dse_real x0[NX] = {1, 2, 1};
static const struct dse_parameter_set sets[] = {{"source", "section 4.5", x0, x0}};

static const dse_real A[NX * NX] = {-1, 0, 0, 0, 0, -1, 0, 1, 0};
static const dse_real C[NY * NX] = {1, 1, 0, 1, 0, 1};
static const struct dse_quadratic_term terms[TERMS] = {{0, 0, 1, -1}, {1, 0, 0, 1}};
static const struct dse_quadratic process = {.A = A, .C = C, .terms = TERMS, .term = terms};
static const dse_real ring_C[RING * NX] = {1, 1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1};
static const struct dse_quadratic ring = {.A = A, .C = ring_C, .terms = TERMS, .term = terms};

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

static void ring_model(const dse_real *prepared, struct dse_model *out)
{
    (void)prepared;
    dse_quadratic_model(out, NX, 0, RING, &ring);
}

const struct dse_plant dse_plant_quadratic_ex4_ring = {
    .name = "quadratic_ex4_ring",
    .title = "decaying and turning quadratic system with six sensors",
    .source = "consensus-based second-order observers, section 4.5, with more sensors",
    .time_unit = "s",
    .time_unit_s = DSE_REAL(1),
    .nx = NX,
    .nu = 0,
    .ny = RING,
    .states = states,
    .outputs = ring_outputs,
    .n_sets = 1,
    .sets = sets,
    .n_subsystems = RING,
    .subsystems = ring_sensors,
    .prepared_size = 1,
    .prepare = prepare,
    .model = ring_model,
};

const struct dse_plant dse_plant_quadratic_ex4 = {
    .name = "quadratic_ex4",
    .title = "decaying and turning quadratic system with two sensors",
    .source = "consensus-based second-order observers, section 4.5",
    .time_unit = "s",
    .time_unit_s = DSE_REAL(1),
    .nx = NX,
    .nu = 0,
    .ny = NY,
    .states = states,
    .outputs = outputs,
    .n_sets = 1,
    .sets = sets,
    .n_subsystems = 2,
    .subsystems = sensors,
    .prepared_size = 1,
    .prepare = prepare,
    .model = model,
};
