/* Descriptor plant of which one function of the state is asked for: section 5.3 of the adaptive
 * distributed observers' source.
 *
 *     E x' = A x + B u,   E = diag(1, 1, 0, 0),   0 = x1 + x4 + u1 + u2,   0 = x2 - x3
 *
 * and so  x1' = -x2/4 - u1,  x2' = x1 - x2 + u1,  x3 = x2,  x4 = -x1 - u1 - u2.  Four sensors of
 * two outputs each; the function is x3. */
#include "dse/plant.h"

#include <stddef.h>

extern const struct dse_plant dse_plant_descriptor_fo;

enum { NX = 4, NU = 2, NY = 8 };

static const struct dse_signal states[NX] = {
    {"x1", "", DSE_REAL(15), DSE_REAL(10), "state 1"},
    {"x2", "", DSE_REAL(30), DSE_REAL(10), "state 2"},
    {"x3", "", DSE_REAL(30), DSE_REAL(10), "state 3, tied to state 2: x3 = x2"},
    {"x4", "", DSE_REAL(-16), DSE_REAL(10), "state 4, tied to state 1 and the inputs"},
};

static const struct dse_signal inputs[NU] = {
    {"u1", "", DSE_REAL(0), DSE_REAL(1), "input 1"},
    {"u2", "", DSE_REAL(0), DSE_REAL(1), "input 2"},
};

static const struct dse_signal outputs[NY] = {
    {"y1a", "", DSE_REAL(0), DSE_REAL(10), "x1 at sensor 1"},
    {"y1b", "", DSE_REAL(0), DSE_REAL(10), "x2 + x3 at sensor 1"},
    {"y2a", "", DSE_REAL(0), DSE_REAL(10), "x1 + x3 at sensor 2"},
    {"y2b", "", DSE_REAL(0), DSE_REAL(10), "x2 at sensor 2"},
    {"y3a", "", DSE_REAL(0), DSE_REAL(10), "x2 at sensor 3"},
    {"y3b", "", DSE_REAL(0), DSE_REAL(10), "x3 at sensor 3"},
    {"y4a", "", DSE_REAL(0), DSE_REAL(10), "x3 at sensor 4"},
    {"y4b", "", DSE_REAL(0), DSE_REAL(10), "x2 at sensor 4"},
};

static const int all_states[NX] = {0, 1, 2, 3};
static const int rows[NY] = {0, 1, 2, 3, 4, 5, 6, 7};
static const struct dse_subsystem sensors[] = {
    {"sensor 1", NX, all_states, 2, rows},
    {"sensor 2", NX, all_states, 2, rows + 2},
    {"sensor 3", NX, all_states, 2, rows + 4},
    {"sensor 4", NX, all_states, 2, rows + 6},
};

static const dse_real x0[NX] = {15, 30, 30, -16};
static const struct dse_parameter_set sets[] = {{"source", "section 5.3", x0, x0}};

/* With x3 and x4 put in: the differential states alone. */
static const dse_real A[NX * NX] = {0, DSE_REAL(-0.25), 0, 0, 1, -1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0};
static const dse_real B[NX * NU] = {-1, 0, 1, 0, 0, 0, 0, 0};
static const dse_real C[NY * NX] = {
    1, 0, 0, 0, 0, 1, 1, 0, /* sensor 1 */
    1, 0, 1, 0, 0, 1, 0, 0, /* sensor 2 */
    0, 1, 0, 0, 0, 0, 1, 0, /* sensor 3 */
    0, 0, 1, 0, 0, 1, 0, 0, /* sensor 4 */
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
    x[2] = x[1];
    x[3] = -x[0] - u[0] - u[1];
}

const struct dse_plant dse_plant_descriptor_fo = {
    .name = "descriptor_fo",
    .title = "descriptor plant of which one function is asked for",
    .source = "adaptive distributed observers, section 5.3",
    .time_unit = "s",
    .time_unit_s = DSE_REAL(1),
    .nx = NX,
    .nu = NU,
    .ny = NY,
    .states = states,
    .inputs = inputs,
    .outputs = outputs,
    .n_sets = 1,
    .sets = sets,
    .n_subsystems = 4,
    .subsystems = sensors,
    .prepared_size = 1,
    .prepare = prepare,
    .model = model,
    .complete = complete,
};
