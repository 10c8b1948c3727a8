/* Two stirred tanks with recycle: section 2.6, eq 2.59, Table 2.1 of the adaptive high-gain source,
 * the operating case of section 4.7, and the one of the coordinated MHE source (Table 4.1), which
 * has another third enthalpy and no heating.
 *
 *     F_0 -> [1] --F_1 = F_0 + F_r--> [2] <- F_3,   [2] --F_r--> [1]
 *
 * The feed F_0 is a known input, with its time derivative as a second one, because section 4.7
 * lets it vary; its nominal value is the constant of section 2.6. Where only samples of F_0 are
 * known, its derivative stays 0 and F_0 counts as held over a sample. */
#include "dse/plant.h"

#include <stddef.h>

#include "cstr_network_internal.h"
#include "dse/math.h"

extern const struct dse_plant dse_plant_cstr2;

static const struct dse_signal states[] = {
    {"T1", "K", DSE_REAL(360), DSE_REAL(10), "temperature of reactor 1"},
    {"C1", "kmol/m3", DSE_REAL(3), DSE_REAL(1), "concentration of A in reactor 1"},
    {"T2", "K", DSE_REAL(320), DSE_REAL(10), "temperature of reactor 2"},
    {"C2", "kmol/m3", DSE_REAL(2.5), DSE_REAL(1), "concentration of A in reactor 2"},
};

static const struct dse_signal inputs[DSE_CSTR_INPUTS] = {
    {"F0", "m3/h", DSE_REAL(4.998), DSE_REAL(1), "feed flow into reactor 1"},
    {"dF0", "m3/h2", DSE_REAL(0), DSE_REAL(100), "time derivative of the feed flow F0"},
};

static const struct dse_signal outputs[] = {
    {"y1", "K", DSE_REAL(360), DSE_REAL(10), "measured temperature of reactor 1"},
    {"y2", "K", DSE_REAL(320), DSE_REAL(10), "measured temperature of reactor 2"},
};

enum {
    V_1,
    V_2,
    T_0,
    C_A0,
    F_3,
    T_03,
    C_A03,
    F_R,
    F_R_MISMATCH,
    Q_H1,
    Q_H2,
    RHO,
    C_P,
    GAS,
    DH_1,
    DH_2,
    DH_3,
    K_10,
    K_20,
    K_30,
    E_1,
    E_2,
    E_3,
    PARAMETERS
};

/* The mismatch is the plus of the recycle flow that a wrong predictor believes in (section 4.7): it
 * enters reactor 1 but, as there, does not leave it through F_1. */
static const struct dse_parameter parameters[PARAMETERS] = {
    [V_1] = {"V1", "m3", DSE_REAL(1e-6), DSE_REAL(1e6), "volume of reactor 1"},
    [V_2] = {"V2", "m3", DSE_REAL(1e-6), DSE_REAL(1e6), "volume of reactor 2"},
    [T_0] = {"T0", "K", DSE_REAL(200), DSE_REAL(1000), "temperature of feed F0"},
    [C_A0] = {"CA0", "kmol/m3", DSE_REAL(0), DSE_REAL(1000), "concentration of feed F0"},
    [F_3] = {"F3", "m3/h", DSE_REAL(0), DSE_REAL(1e6), "feed flow into reactor 2"},
    [T_03] = {"T03", "K", DSE_REAL(200), DSE_REAL(1000), "temperature of feed F3"},
    [C_A03] = {"CA03", "kmol/m3", DSE_REAL(0), DSE_REAL(1000), "concentration of feed F3"},
    [F_R] = {"Fr", "m3/h", DSE_REAL(0), DSE_REAL(1e6), "recycle flow from reactor 2 to 1"},
    [F_R_MISMATCH] = {"dFr", "m3/h", DSE_REAL(-1e3), DSE_REAL(1e3),
                      "model mismatch: surplus of Fr into reactor 1 only"},
    [Q_H1] = {"Qh1", "kJ/h", DSE_REAL(-1e9), DSE_REAL(1e9), "heat into reactor 1"},
    [Q_H2] = {"Qh2", "kJ/h", DSE_REAL(-1e9), DSE_REAL(1e9), "heat into reactor 2"},
    [RHO] = {"rho", "kg/m3", DSE_REAL(1), DSE_REAL(1e5), "density"},
    [C_P] = {"cp", "kJ/(kg K)", DSE_REAL(1e-3), DSE_REAL(1e2), "specific heat"},
    [GAS] = {"R", "kJ/(kmol K)", DSE_REAL(8), DSE_REAL(9), "gas constant"},
    [DH_1] = {"dH1", "kJ/kmol", DSE_REAL(-1e7), DSE_REAL(-1e-3), "enthalpy of reaction 1"},
    [DH_2] = {"dH2", "kJ/kmol", DSE_REAL(-1e7), DSE_REAL(-1e-3), "enthalpy of reaction 2"},
    [DH_3] = {"dH3", "kJ/kmol", DSE_REAL(-1e7), DSE_REAL(-1e-3), "enthalpy of reaction 3"},
    [K_10] = {"k10", "1/h", DSE_REAL(1e-3), DSE_REAL(1e15), "rate constant of reaction 1"},
    [K_20] = {"k20", "1/h", DSE_REAL(0), DSE_REAL(1e15), "rate constant of reaction 2"},
    [K_30] = {"k30", "1/h", DSE_REAL(0), DSE_REAL(1e15), "rate constant of reaction 3"},
    [E_1] = {"E1", "kJ/kmol", DSE_REAL(1), DSE_REAL(1e6), "activation energy of reaction 1"},
    [E_2] = {"E2", "kJ/kmol", DSE_REAL(1), DSE_REAL(1e6), "activation energy of reaction 2"},
    [E_3] = {"E3", "kJ/kmol", DSE_REAL(1), DSE_REAL(1e6), "activation energy of reaction 3"},
};

#define COMMON                                                                                     \
    [V_1] = DSE_REAL(1.0), [V_2] = DSE_REAL(3.0), [T_0] = DSE_REAL(300), [C_A0] = DSE_REAL(4.0),   \
    [F_3] = DSE_REAL(30.0), [T_03] = DSE_REAL(300), [C_A03] = DSE_REAL(2.0),                       \
    [F_R] = DSE_REAL(34.998), [F_R_MISMATCH] = DSE_REAL(0), [RHO] = DSE_REAL(1000),                \
    [C_P] = DSE_REAL(0.231), [GAS] = DSE_REAL(8.314), [DH_1] = DSE_REAL(-5.0e4),                   \
    [DH_2] = DSE_REAL(-5.2e4), [K_10] = DSE_REAL(3.0e6), [K_20] = DSE_REAL(3.0e5),                 \
    [K_30] = DSE_REAL(3.0e5), [E_1] = DSE_REAL(5.0e4), [E_2] = DSE_REAL(7.53e4),                   \
    [E_3] = DSE_REAL(7.53e4)

static const dse_real values_ch2[PARAMETERS] = {
    COMMON, [DH_3] = DSE_REAL(-5.04e4), [Q_H1] = DSE_REAL(1.8e4), [Q_H2] = DSE_REAL(1.2e4)};
static const dse_real values_ch4[PARAMETERS] = {
    COMMON, [DH_3] = DSE_REAL(-5.04e4), [Q_H1] = DSE_REAL(1.4e4), [Q_H2] = DSE_REAL(1.4e4)};
static const dse_real values_cdm[PARAMETERS] = {
    COMMON, [DH_3] = DSE_REAL(-5.4e4), [Q_H1] = DSE_REAL(0), [Q_H2] = DSE_REAL(0)};
static const dse_real x0_ch2[] = {DSE_REAL(360), DSE_REAL(3), DSE_REAL(320), DSE_REAL(2.5)};
static const dse_real x0_ch4[] = {DSE_REAL(360), DSE_REAL(3), DSE_REAL(320), DSE_REAL(3)};

/* deviation [13, 2, 34, 1.5] from its steady state */
static const dse_real x0_cdm[] = {DSE_REAL(313.38781890182895), DSE_REAL(4.4980582625281658),
                                  DSE_REAL(334.34962011281505), DSE_REAL(3.7840010767830567)};

static const struct dse_parameter_set sets[] = {
    {"ch2", "section 2.6, Table 2.1", values_ch2, x0_ch2},
    {"ch4", "section 4.7", values_ch4, x0_ch4},
    {"cdm", "coordinated MHE, section 4.4, Table 4.1", values_cdm, x0_cdm},
};

static const int states_of_1[] = {0, 1};
static const int states_of_2[] = {2, 3};
static const int outputs_of_1[] = {0};
static const int outputs_of_2[] = {1};
static const struct dse_subsystem subsystems[] = {
    {"reactor 1", 2, states_of_1, 1, outputs_of_1},
    {"reactor 2", 2, states_of_2, 1, outputs_of_2},
};

static enum dse_status prepare(const dse_real *p, dse_real *prepared)
{
    for (int k = 0; k < PARAMETERS; k++) {
        if (!(p[k] >= parameters[k].min && p[k] <= parameters[k].max)) {
            return DSE_EINVAL;
        }
    }
    struct dse_cstr_network *network = dse_cstr_network_clear(prepared);
    struct dse_cstr_mixing *constant = &network->constant;
    struct dse_cstr_mixing *per_feed = &network->per_feed;
    const dse_real rho_cp = p[RHO] * p[C_P];

    dse_cstr_add_feed(constant, 1, p[V_2], p[F_3], p[T_03], p[C_A03]);
    dse_cstr_add_link(constant, 1, 0, p[V_1], p[F_R] + p[F_R_MISMATCH]);
    dse_cstr_add_link(constant, 0, 1, p[V_2], p[F_R]);
    /* F_0 itself and its share of F_1 = F_0 + F_r */
    dse_cstr_add_feed(per_feed, 0, p[V_1], 1, p[T_0], p[C_A0]);
    dse_cstr_add_link(per_feed, 0, 1, p[V_2], 1);

    dse_cstr_add_heat(constant, 0, p[V_1], rho_cp, p[Q_H1]);
    dse_cstr_add_heat(constant, 1, p[V_2], rho_cp, p[Q_H2]);
    for (int l = 0; l < DSE_CSTR_REACTIONS; l++) {
        dse_cstr_add_reaction(network, rho_cp, p[GAS], p[DH_1 + l], p[K_10 + l], p[E_1 + l]);
    }
    return dse_all_finite(prepared, DSE_CSTR_NETWORK_SIZE) ? DSE_OK : DSE_EINVAL;
}

static void model(const dse_real *prepared, struct dse_model *out)
{
    dse_cstr_network_model(prepared, 2, DSE_CSTR_INPUTS, out);
}

static void normal_form(const dse_real *prepared, struct dse_normal_form *form)
{
    dse_cstr_network_normal_form(prepared, 2, DSE_CSTR_INPUTS, form);
}

const struct dse_plant dse_plant_cstr2 = {
    .name = "cstr2",
    .title = "two stirred tanks with recycle",
    .source = "adaptive high-gain EKF, section 2.6, eq 2.59, Table 2.1",
    .time_unit = "h",
    .time_unit_s = DSE_REAL(3600),
    .nx = 4,
    .nu = DSE_CSTR_INPUTS,
    .ny = 2,
    .states = states,
    .inputs = inputs,
    .outputs = outputs,
    .n_parameters = PARAMETERS,
    .parameters = parameters,
    .n_sets = 3,
    .sets = sets,
    .n_subsystems = 2,
    .subsystems = subsystems,
    .prepared_size = DSE_CSTR_NETWORK_SIZE,
    .prepare = prepare,
    .model = model,
    .normal_form = normal_form,
};
