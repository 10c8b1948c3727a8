/* Four stirred tanks with two recycles: section 3.7, eq 3.65, Table 3.1 of the adaptive high-gain
 * source (and its chapter 5).
 *
 *     F_01 -> [1] --F_1--> [2] --F_2 - F_r1--> [3] --F_3--> [4] -> out
 *
 * with further feeds F_02, F_03, F_04 into [2], [3], [4] and the recycles F_r1 from [2] to [1] and
 * F_r2 from [4] to [1]. Flows between the reactors close the balances: F_1 = F_01 + F_r1 + F_r2,
 * F_2 = F_1 + F_02, F_3 = F_2 - F_r1 + F_03. The plant has no varying input. */
#include "dse/plant.h"

#include "cstr_network_internal.h"
#include "dse/math.h"

extern const struct dse_plant dse_plant_cstr4;

enum { REACTORS = 4 };

static const struct dse_signal states[] = {
    {"T1", "K", DSE_REAL(340), DSE_REAL(10), "temperature of reactor 1"},
    {"C1", "kmol/m3", DSE_REAL(2), DSE_REAL(1), "concentration of A in reactor 1"},
    {"T2", "K", DSE_REAL(350), DSE_REAL(10), "temperature of reactor 2"},
    {"C2", "kmol/m3", DSE_REAL(3), DSE_REAL(1), "concentration of A in reactor 2"},
    {"T3", "K", DSE_REAL(345), DSE_REAL(10), "temperature of reactor 3"},
    {"C3", "kmol/m3", DSE_REAL(2.5), DSE_REAL(1), "concentration of A in reactor 3"},
    {"T4", "K", DSE_REAL(360), DSE_REAL(10), "temperature of reactor 4"},
    {"C4", "kmol/m3", DSE_REAL(4), DSE_REAL(1), "concentration of A in reactor 4"},
};

static const struct dse_signal outputs[] = {
    {"y1", "K", DSE_REAL(340), DSE_REAL(10), "measured temperature of reactor 1"},
    {"y2", "K", DSE_REAL(350), DSE_REAL(10), "measured temperature of reactor 2"},
    {"y3", "K", DSE_REAL(345), DSE_REAL(10), "measured temperature of reactor 3"},
    {"y4", "K", DSE_REAL(360), DSE_REAL(10), "measured temperature of reactor 4"},
};

/* Of each group of four, reactor i has the first plus i - 1. */
enum {
    V_1,
    F_01 = V_1 + REACTORS,
    T_01 = F_01 + REACTORS,
    C_A01 = T_01 + REACTORS,
    Q_H1 = C_A01 + REACTORS,
    F_R1 = Q_H1 + REACTORS,
    F_R2,
    RHO,
    C_P,
    GAS,
    DH_1,
    K_10 = DH_1 + DSE_CSTR_REACTIONS,
    E_1 = K_10 + DSE_CSTR_REACTIONS,
    PARAMETERS = E_1 + DSE_CSTR_REACTIONS
};

static const struct dse_parameter parameters[PARAMETERS] = {
    [V_1] = {"V1", "m3", DSE_REAL(1e-6), DSE_REAL(1e6), "volume of reactor 1"},
    {"V2", "m3", DSE_REAL(1e-6), DSE_REAL(1e6), "volume of reactor 2"},
    {"V3", "m3", DSE_REAL(1e-6), DSE_REAL(1e6), "volume of reactor 3"},
    {"V4", "m3", DSE_REAL(1e-6), DSE_REAL(1e6), "volume of reactor 4"},
    [F_01] = {"F01", "m3/h", DSE_REAL(0), DSE_REAL(1e6), "feed flow into reactor 1"},
    {"F02", "m3/h", DSE_REAL(0), DSE_REAL(1e6), "feed flow into reactor 2"},
    {"F03", "m3/h", DSE_REAL(0), DSE_REAL(1e6), "feed flow into reactor 3"},
    {"F04", "m3/h", DSE_REAL(0), DSE_REAL(1e6), "feed flow into reactor 4"},
    [T_01] = {"T01", "K", DSE_REAL(200), DSE_REAL(1000), "temperature of feed F01"},
    {"T02", "K", DSE_REAL(200), DSE_REAL(1000), "temperature of feed F02"},
    {"T03", "K", DSE_REAL(200), DSE_REAL(1000), "temperature of feed F03"},
    {"T04", "K", DSE_REAL(200), DSE_REAL(1000), "temperature of feed F04"},
    [C_A01] = {"CA01", "kmol/m3", DSE_REAL(0), DSE_REAL(1000), "concentration of feed F01"},
    {"CA02", "kmol/m3", DSE_REAL(0), DSE_REAL(1000), "concentration of feed F02"},
    {"CA03", "kmol/m3", DSE_REAL(0), DSE_REAL(1000), "concentration of feed F03"},
    {"CA04", "kmol/m3", DSE_REAL(0), DSE_REAL(1000), "concentration of feed F04"},
    [Q_H1] = {"Qh1", "kJ/h", DSE_REAL(-1e9), DSE_REAL(1e9), "heat into reactor 1"},
    {"Qh2", "kJ/h", DSE_REAL(-1e9), DSE_REAL(1e9), "heat into reactor 2"},
    {"Qh3", "kJ/h", DSE_REAL(-1e9), DSE_REAL(1e9), "heat into reactor 3"},
    {"Qh4", "kJ/h", DSE_REAL(-1e9), DSE_REAL(1e9), "heat into reactor 4"},
    [F_R1] = {"Fr1", "m3/h", DSE_REAL(0), DSE_REAL(1e6), "recycle flow from reactor 2 to 1"},
    [F_R2] = {"Fr2", "m3/h", DSE_REAL(0), DSE_REAL(1e6), "recycle flow from reactor 4 to 1"},
    [RHO] = {"rho", "kg/m3", DSE_REAL(1), DSE_REAL(1e5), "density"},
    [C_P] = {"cp", "kJ/(kg K)", DSE_REAL(1e-3), DSE_REAL(1e2), "specific heat"},
    [GAS] = {"R", "kJ/(kmol K)", DSE_REAL(8), DSE_REAL(9), "gas constant"},
    [DH_1] = {"dH1", "kJ/kmol", DSE_REAL(-1e7), DSE_REAL(-1e-3), "enthalpy of reaction 1"},
    {"dH2", "kJ/kmol", DSE_REAL(-1e7), DSE_REAL(-1e-3), "enthalpy of reaction 2"},
    {"dH3", "kJ/kmol", DSE_REAL(-1e7), DSE_REAL(-1e-3), "enthalpy of reaction 3"},
    [K_10] = {"k10", "1/h", DSE_REAL(1e-3), DSE_REAL(1e15), "rate constant of reaction 1"},
    {"k20", "1/h", DSE_REAL(0), DSE_REAL(1e15), "rate constant of reaction 2"},
    {"k30", "1/h", DSE_REAL(0), DSE_REAL(1e15), "rate constant of reaction 3"},
    [E_1] = {"E1", "kJ/kmol", DSE_REAL(1), DSE_REAL(1e6), "activation energy of reaction 1"},
    {"E2", "kJ/kmol", DSE_REAL(1), DSE_REAL(1e6), "activation energy of reaction 2"},
    {"E3", "kJ/kmol", DSE_REAL(1), DSE_REAL(1e6), "activation energy of reaction 3"},
};

static const dse_real values_ch3[PARAMETERS] = {
    [V_1] = DSE_REAL(1),
    DSE_REAL(3),
    DSE_REAL(4),
    DSE_REAL(6),
    [F_01] = DSE_REAL(5),
    DSE_REAL(10),
    DSE_REAL(8),
    DSE_REAL(12),
    [T_01] = DSE_REAL(300),
    DSE_REAL(300),
    DSE_REAL(300),
    DSE_REAL(300),
    [C_A01] = DSE_REAL(4),
    DSE_REAL(2),
    DSE_REAL(3),
    DSE_REAL(3.5),
    [Q_H1] = DSE_REAL(1e4),
    DSE_REAL(2e4),
    DSE_REAL(2.5e4),
    DSE_REAL(1e4),
    [F_R1] = DSE_REAL(20),
    DSE_REAL(10),
    [RHO] = DSE_REAL(1000),
    [C_P] = DSE_REAL(0.231),
    [GAS] = DSE_REAL(8.314),
    [DH_1] = DSE_REAL(-5.0e4),
    DSE_REAL(-5.2e4),
    DSE_REAL(-5.04e4),
    [K_10] = DSE_REAL(3.0e6),
    DSE_REAL(3.0e5),
    DSE_REAL(3.0e5),
    [E_1] = DSE_REAL(5.0e4),
    DSE_REAL(7.53e4),
    DSE_REAL(7.53e4),
};
static const dse_real x0_ch3[] = {DSE_REAL(340), DSE_REAL(2),   DSE_REAL(350), DSE_REAL(3),
                                  DSE_REAL(345), DSE_REAL(2.5), DSE_REAL(360), DSE_REAL(4)};

static const struct dse_parameter_set sets[] = {
    {"ch3", "section 3.7, Table 3.1; the same in section 5.7", values_ch3, x0_ch3},
};

static const int states_of[REACTORS][2] = {{0, 1}, {2, 3}, {4, 5}, {6, 7}};
static const int outputs_of[REACTORS][1] = {{0}, {1}, {2}, {3}};
static const struct dse_subsystem subsystems[REACTORS] = {
    {"reactor 1", 2, states_of[0], 1, outputs_of[0]},
    {"reactor 2", 2, states_of[1], 1, outputs_of[1]},
    {"reactor 3", 2, states_of[2], 1, outputs_of[2]},
    {"reactor 4", 2, states_of[3], 1, outputs_of[3]},
};

static enum dse_status prepare(const dse_real *p, dse_real *prepared)
{
    for (int k = 0; k < PARAMETERS; k++) {
        if (!(p[k] >= parameters[k].min && p[k] <= parameters[k].max)) {
            return DSE_EINVAL;
        }
    }
    struct dse_cstr_network *network = dse_cstr_network_clear(prepared);
    struct dse_cstr_mixing *mixing = &network->constant;
    const dse_real *V = p + V_1;
    const dse_real rho_cp = p[RHO] * p[C_P];
    const dse_real F_1 = p[F_01] + p[F_R1] + p[F_R2];
    const dse_real F_2 = F_1 + p[F_01 + 1];
    const dse_real F_3 = F_2 - p[F_R1] + p[F_01 + 2];

    for (int i = 0; i < REACTORS; i++) {
        dse_cstr_add_feed(mixing, i, V[i], p[F_01 + i], p[T_01 + i], p[C_A01 + i]);
        dse_cstr_add_heat(mixing, i, V[i], rho_cp, p[Q_H1 + i]);
    }
    dse_cstr_add_link(mixing, 1, 0, V[0], p[F_R1]);
    dse_cstr_add_link(mixing, 3, 0, V[0], p[F_R2]);
    dse_cstr_add_link(mixing, 0, 1, V[1], F_1);
    dse_cstr_add_link(mixing, 1, 2, V[2], F_2 - p[F_R1]);
    dse_cstr_add_link(mixing, 2, 3, V[3], F_3);
    for (int l = 0; l < DSE_CSTR_REACTIONS; l++) {
        dse_cstr_add_reaction(network, rho_cp, p[GAS], p[DH_1 + l], p[K_10 + l], p[E_1 + l]);
    }
    return dse_all_finite(prepared, DSE_CSTR_NETWORK_SIZE) ? DSE_OK : DSE_EINVAL;
}

static void model(const dse_real *prepared, struct dse_model *out)
{
    dse_cstr_network_model(prepared, REACTORS, 0, out);
}

static void normal_form(const dse_real *prepared, struct dse_normal_form *form)
{
    dse_cstr_network_normal_form(prepared, REACTORS, 0, form);
}

const struct dse_plant dse_plant_cstr4 = {
    .name = "cstr4",
    .title = "four stirred tanks with two recycles",
    .source = "adaptive high-gain EKF, section 3.7, eq 3.65, Table 3.1",
    .time_unit = "h",
    .time_unit_s = DSE_REAL(3600),
    .nx = 2 * REACTORS,
    .ny = REACTORS,
    .states = states,
    .outputs = outputs,
    .n_parameters = PARAMETERS,
    .parameters = parameters,
    .n_sets = 1,
    .sets = sets,
    .n_subsystems = REACTORS,
    .subsystems = subsystems,
    .prepared_size = DSE_CSTR_NETWORK_SIZE,
    .prepare = prepare,
    .model = model,
    .normal_form = normal_form,
};
