/* Descriptor plant with an unknown input: section 5.2 of the adaptive distributed observers'
 * source.
 *
 *     E x' = A x + B (u1, u2)' + F v      E = diag(1, 1, 1, 0), fourth row: 0 = x4 + u1
 *
 * and so  x1' = -x1 + x2 + u1 - v,  x2' = -x1 + x4 + u2,  x3' = -x2 - x3,  x4 = -u1.
 * Six sensors of two outputs each; every node estimates the whole state. Estimators do not know v.
 */
#include "dse/plant.h"

#include <stddef.h>

extern const struct dse_plant dse_plant_descriptor_uio;

enum { NX = 4, NU = 3, NY = 12 };

static const struct dse_signal states[NX] = {
    {"x1", "", DSE_REAL(15), DSE_REAL(10), "state 1"},
    {"x2", "", DSE_REAL(30), DSE_REAL(10), "state 2"},
    {"x3", "", DSE_REAL(40), DSE_REAL(10), "state 3"},
    {"x4", "", DSE_REAL(-1), DSE_REAL(1), "state 4, tied to the input: x4 = -u1"},
};

static const struct dse_signal inputs[NU] = {
    {"u1", "", DSE_REAL(0), DSE_REAL(1), "known input 1"},
    {"u2", "", DSE_REAL(0), DSE_REAL(1), "known input 2"},
    {"v", "", DSE_REAL(0), DSE_REAL(5), "unknown input"},
};

static const struct dse_signal outputs[NY] = {
    {"y1a", "", DSE_REAL(0), DSE_REAL(10), "x1 at sensor 1"},
    {"y1b", "", DSE_REAL(0), DSE_REAL(10), "x3 + x4 at sensor 1"},
    {"y2a", "", DSE_REAL(0), DSE_REAL(10), "x1 at sensor 2"},
    {"y2b", "", DSE_REAL(0), DSE_REAL(10), "x1 + x2 at sensor 2"},
    {"y3a", "", DSE_REAL(0), DSE_REAL(10), "x3 at sensor 3"},
    {"y3b", "", DSE_REAL(0), DSE_REAL(10), "x1 at sensor 3"},
    {"y4a", "", DSE_REAL(0), DSE_REAL(10), "x2 + x4 at sensor 4"},
    {"y4b", "", DSE_REAL(0), DSE_REAL(10), "x1 at sensor 4"},
    {"y5a", "", DSE_REAL(0), DSE_REAL(10), "x3 + x4 at sensor 5"},
    {"y5b", "", DSE_REAL(0), DSE_REAL(10), "x1 at sensor 5"},
    {"y6a", "", DSE_REAL(0), DSE_REAL(10), "x1 + x3 at sensor 6"},
    {"y6b", "", DSE_REAL(0), DSE_REAL(10), "x2 at sensor 6"},
};

static const int all_states[NX] = {0, 1, 2, 3};
static const int rows[NY] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11};
static const struct dse_subsystem sensors[] = {
    {"sensor 1", NX, all_states, 2, rows},     {"sensor 2", NX, all_states, 2, rows + 2},
    {"sensor 3", NX, all_states, 2, rows + 4}, {"sensor 4", NX, all_states, 2, rows + 6},
    {"sensor 5", NX, all_states, 2, rows + 8}, {"sensor 6", NX, all_states, 2, rows + 10},
};

static const dse_real x0[NX] = {15, 30, 40, -1};
static const struct dse_parameter_set sets[] = {{"source", "section 5.2", x0, x0}};

/* With x4 = -u1 put in: the differential states alone. */
static const dse_real A[NX * NX] = {-1, 1, 0, 0, -1, 0, 0, 0, 0, -1, -1, 0, 0, 0, 0, 0};
static const dse_real B[NX * NU] = {1, 0, -1, -1, 1, 0, 0, 0, 0, 0, 0, 0};
static const dse_real C[NY * NX] = {
    1, 0, 0, 0, 0, 0, 1, 1, /* sensor 1 */
    1, 0, 0, 0, 1, 1, 0, 0, /* sensor 2 */
    0, 0, 1, 0, 1, 0, 0, 0, /* sensor 3 */
    0, 1, 0, 1, 1, 0, 0, 0, /* sensor 4 */
    0, 0, 1, 1, 1, 0, 0, 0, /* sensor 5 */
    1, 0, 1, 0, 0, 1, 0, 0, /* sensor 6 */
};
static const struct dse_linear_process process = {.linear = {A, B, C, NULL}};

static enum dse_status prepare(const dse_real *values, dse_real *prepared)
{
    (void)values;
    prepared[0] = 0; /* nothing to choose */
    return DSE_OK;
}

static void model(const dse_real *prepared, struct dse_model *out)
{
    (void)prepared;
    dse_linear_process_model(out, DSE_CONTINUOUS, NX, NU, NY, &process);
}

static void complete(const dse_real *prepared, dse_real t, const dse_real *u, dse_real *x)
{
    (void)prepared, (void)t;
    x[3] = -u[0];
}

const struct dse_plant dse_plant_descriptor_uio = {
    .name = "descriptor_uio",
    .title = "descriptor plant with an unknown input",
    .source = "adaptive distributed observers, section 5.2",
    .time_unit = "s",
    .time_unit_s = DSE_REAL(1),
    .nx = NX,
    .nu = NU,
    .ny = NY,
    .states = states,
    .inputs = inputs,
    .outputs = outputs,
    .n_unknown = 1,
    .n_sets = 1,
    .sets = sets,
    .n_subsystems = 6,
    .subsystems = sensors,
    .prepared_size = 1,
    .prepare = prepare,
    .model = model,
    .complete = complete,
};
