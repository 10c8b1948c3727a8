/* Flow, contaminant and temperature in a square cavity as POD-Galerkin models: the benchmark of
 * section 5.3 of the consensus-based second-order observers' source, once decaying freely and once
 * driven by a force and two sources. The fields are
 *
 *     v = sum_k a_k alpha_k,   c = sum_l b_l phi_l,   T = sum_m h_m theta_m
 *
 * with modes from snapshots of three simulations, and x = (a, b, h) obeys x' = d + A x + q(x). Four
 * sensors read the sum of the velocity components, the contaminant and the temperature at a point.
 * All quantities are dimensionless, time is in passages of the unit length at unit velocity. */
#include "dse/plant.h"

#include "cavity_internal.h"

extern const struct dse_plant dse_plant_cavity_free;
extern const struct dse_plant dse_plant_cavity_forced;

static const struct dse_signal states[DSE_CAVITY_NX] = {
    {"a1", "", DSE_REAL(0.37), DSE_REAL(0.2), "velocity mode 1"},
    {"a2", "", DSE_REAL(0.04), DSE_REAL(0.1), "velocity mode 2"},
    {"a3", "", DSE_REAL(0.11), DSE_REAL(0.1), "velocity mode 3"},
    {"a4", "", DSE_REAL(0), DSE_REAL(0.05), "velocity mode 4"},
    {"b1", "", DSE_REAL(0.2), DSE_REAL(0.1), "contaminant mode 1"},
    {"b2", "", DSE_REAL(0), DSE_REAL(0.05), "contaminant mode 2"},
    {"b3", "", DSE_REAL(0), DSE_REAL(0.05), "contaminant mode 3"},
    {"h1", "", DSE_REAL(0.45), DSE_REAL(0.2), "temperature mode 1"},
    {"h2", "", DSE_REAL(0), DSE_REAL(0.05), "temperature mode 2"},
    {"h3", "", DSE_REAL(0), DSE_REAL(0.05), "temperature mode 3"},
};

static const struct dse_signal outputs[DSE_CAVITY_NY] = {
    {"w1", "", DSE_REAL(0), DSE_REAL(0.5), "sum of velocities at (0.30, 0.30)"},
    {"c1", "", DSE_REAL(0), DSE_REAL(0.2), "contaminant at (0.30, 0.30)"},
    {"T1", "", DSE_REAL(0), DSE_REAL(0.5), "temperature at (0.30, 0.30)"},
    {"w2", "", DSE_REAL(0), DSE_REAL(0.5), "sum of velocities at (0.70, 0.30)"},
    {"c2", "", DSE_REAL(0), DSE_REAL(0.2), "contaminant at (0.70, 0.30)"},
    {"T2", "", DSE_REAL(0), DSE_REAL(0.5), "temperature at (0.70, 0.30)"},
    {"w3", "", DSE_REAL(0), DSE_REAL(0.5), "sum of velocities at (0.70, 0.70)"},
    {"c3", "", DSE_REAL(0), DSE_REAL(0.2), "contaminant at (0.70, 0.70)"},
    {"T3", "", DSE_REAL(0), DSE_REAL(0.5), "temperature at (0.70, 0.70)"},
    {"w4", "", DSE_REAL(0), DSE_REAL(0.5), "sum of velocities at (0.30, 0.70)"},
    {"c4", "", DSE_REAL(0), DSE_REAL(0.2), "contaminant at (0.30, 0.70)"},
    {"T4", "", DSE_REAL(0), DSE_REAL(0.5), "temperature at (0.30, 0.70)"},
};

static const int all_states[DSE_CAVITY_NX] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9};
static const int rows[DSE_CAVITY_NY] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11};
static const struct dse_subsystem sensors[] = {
    {"sensor 1", DSE_CAVITY_NX, all_states, 3, rows},
    {"sensor 2", DSE_CAVITY_NX, all_states, 3, rows + 3},
    {"sensor 3", DSE_CAVITY_NX, all_states, 3, rows + 6},
    {"sensor 4", DSE_CAVITY_NX, all_states, 3, rows + 9},
};

/* There are no parameters to choose: `values` is any pointer but NULL. */
static const struct dse_parameter_set free_sets[DSE_CAVITY_STARTS] = {
    {"test", "test run", dse_cavity_free_data.x0[0], dse_cavity_free_data.x0[0]},
    {"train1", "first run of the snapshots", dse_cavity_free_data.x0[1],
     dse_cavity_free_data.x0[1]},
    {"train2", "second run of the snapshots", dse_cavity_free_data.x0[2],
     dse_cavity_free_data.x0[2]},
    {"train3", "third run of the snapshots", dse_cavity_free_data.x0[3],
     dse_cavity_free_data.x0[3]},
};
static const struct dse_parameter_set forced_sets[DSE_CAVITY_STARTS] = {
    {"test", "test run", dse_cavity_forced_data.x0[0], dse_cavity_forced_data.x0[0]},
    {"train1", "first run of the snapshots", dse_cavity_forced_data.x0[1],
     dse_cavity_forced_data.x0[1]},
    {"train2", "second run of the snapshots", dse_cavity_forced_data.x0[2],
     dse_cavity_forced_data.x0[2]},
    {"train3", "third run of the snapshots", dse_cavity_forced_data.x0[3],
     dse_cavity_forced_data.x0[3]},
};

static enum dse_status prepare(const dse_real *values, dse_real *prepared)
{
    (void)values;
    prepared[0] = 0; /* nothing to choose */
    return DSE_OK;
}

static void free_model(const dse_real *prepared, struct dse_model *out)
{
    (void)prepared;
    dse_quadratic_model(out, DSE_CAVITY_NX, 0, DSE_CAVITY_NY, &dse_cavity_free_data.system);
}

static void forced_model(const dse_real *prepared, struct dse_model *out)
{
    (void)prepared;
    dse_quadratic_model(out, DSE_CAVITY_NX, 0, DSE_CAVITY_NY, &dse_cavity_forced_data.system);
}

#define COMMON                                                                                     \
    .source = "consensus-based second-order observers, section 5.3", .time_unit = "s",             \
    .time_unit_s = DSE_REAL(1), .nx = DSE_CAVITY_NX, .ny = DSE_CAVITY_NY, .states = states,        \
    .outputs = outputs, .n_sets = DSE_CAVITY_STARTS, .n_subsystems = 4, .subsystems = sensors,     \
    .prepared_size = 1, .prepare = prepare

const struct dse_plant dse_plant_cavity_free = {
    .name = "cavity_free",
    .title = "flow in a cavity, left to itself: POD model",
    COMMON,
    .sets = free_sets,
    .model = free_model,
};

const struct dse_plant dse_plant_cavity_forced = {
    .name = "cavity_forced",
    .title = "flow in a cavity, driven: POD model",
    COMMON,
    .sets = forced_sets,
    .model = forced_model,
};
