/* Two stirred tanks and a flash separator with recycle: section 3.5, (3.63), Table 3.2 of the
 * coordinated MHE source.
 *
 *     F10 -> [1] --F1 = F10 + Fr--> [2] <- F20,   [2] --F2 = F1 + F20--> [3] --Fr--> [1], Fp purged
 *
 * A -> B -> C in the tanks. The printed table does not have the printed steady state; with cp = 4.2
 * kJ/(kg K), molar masses of 250 (liquid) and 500 kg/kmol (vapour), and pure A in the second feed,
 * which the balances themselves ask for, all its digits come out. */
#include "dse/plant.h"

#include "dse/math.h"
#include "sep3_internal.h"

extern const struct dse_plant dse_plant_sep3;

static const struct dse_signal states[] = {
    {"xA1", "kg/kg", DSE_REAL(0.03133), DSE_REAL(0.02), "fraction of A in reactor 1"},
    {"xB1", "kg/kg", DSE_REAL(0.260198), DSE_REAL(0.05), "fraction of B in reactor 1"},
    {"T1", "K", DSE_REAL(549.768557), DSE_REAL(10), "temperature of reactor 1"},
    {"xA2", "kg/kg", DSE_REAL(0.120284), DSE_REAL(0.02), "fraction of A in reactor 2"},
    {"xB2", "kg/kg", DSE_REAL(0.349924), DSE_REAL(0.05), "fraction of B in reactor 2"},
    {"T2", "K", DSE_REAL(499.458993), DSE_REAL(10), "temperature of reactor 2"},
    {"xA3", "kg/kg", DSE_REAL(0.034802), DSE_REAL(0.02), "fraction of A in the separator"},
    {"xB3", "kg/kg", DSE_REAL(0.285513), DSE_REAL(0.05), "fraction of B in the separator"},
    {"T3", "K", DSE_REAL(535.519909), DSE_REAL(10), "temperature of the separator"},
};

static const struct dse_signal inputs[] = {
    {"Q1", "kJ/h", DSE_REAL(2.9e6), DSE_REAL(1e5), "heat into reactor 1"},
    {"Q2", "kJ/h", DSE_REAL(1.0e6), DSE_REAL(1e5), "heat into reactor 2"},
    {"Q3", "kJ/h", DSE_REAL(2.9e6), DSE_REAL(1e5), "heat into the separator"},
};

static const struct dse_signal outputs[] = {
    {"y1", "K", DSE_REAL(549.768557), DSE_REAL(10), "measured temperature of reactor 1"},
    {"y2", "K", DSE_REAL(499.458993), DSE_REAL(10), "measured temperature of reactor 2"},
    {"y3", "K", DSE_REAL(535.519909), DSE_REAL(10), "measured temperature of the separator"},
};

enum {
    F_10,
    F_20,
    F_R,
    F_P,
    V_1,
    V_2,
    V_3,
    K_1,
    K_2,
    E_1,
    E_2,
    GAS,
    RHO,
    C_P,
    MW_R,
    MW_V,
    T_10,
    T_20,
    X_A10,
    X_B10,
    X_A20,
    X_B20,
    ALPHA_A,
    ALPHA_B,
    ALPHA_C,
    DH_1,
    DH_2,
    DH_V1,
    DH_V2,
    DH_V3,
    PARAMETERS
};

static const struct dse_parameter parameters[PARAMETERS] = {
    [F_10] = {"F10", "m3/h", DSE_REAL(0), DSE_REAL(1e6), "feed into reactor 1"},
    [F_20] = {"F20", "m3/h", DSE_REAL(0), DSE_REAL(1e6), "feed into reactor 2"},
    [F_R] = {"Fr", "m3/h", DSE_REAL(0), DSE_REAL(1e6), "recycle from the separator to reactor 1"},
    [F_P] = {"Fp", "m3/h", DSE_REAL(0), DSE_REAL(1e6), "purge of the overhead"},
    [V_1] = {"V1", "m3", DSE_REAL(1e-6), DSE_REAL(1e6), "volume of reactor 1"},
    [V_2] = {"V2", "m3", DSE_REAL(1e-6), DSE_REAL(1e6), "volume of reactor 2"},
    [V_3] = {"V3", "m3", DSE_REAL(1e-6), DSE_REAL(1e6), "volume of the separator"},
    [K_1] = {"k1", "1/h", DSE_REAL(0), DSE_REAL(1e15), "rate constant of A -> B"},
    [K_2] = {"k2", "1/h", DSE_REAL(0), DSE_REAL(1e15), "rate constant of B -> C"},
    [E_1] = {"E1", "kJ/kmol", DSE_REAL(1), DSE_REAL(1e6), "activation energy of A -> B"},
    [E_2] = {"E2", "kJ/kmol", DSE_REAL(1), DSE_REAL(1e6), "activation energy of B -> C"},
    [GAS] = {"R", "kJ/(kmol K)", DSE_REAL(8), DSE_REAL(9), "gas constant"},
    [RHO] = {"rho", "kg/m3", DSE_REAL(1), DSE_REAL(1e5), "density"},
    [C_P] = {"cp", "kJ/(kg K)", DSE_REAL(1e-3), DSE_REAL(1e2), "specific heat"},
    [MW_R] = {"MWr", "kg/kmol", DSE_REAL(1), DSE_REAL(1e5), "molar mass in the reactors"},
    [MW_V] = {"MWv", "kg/kmol", DSE_REAL(1), DSE_REAL(1e5), "molar mass of the vapour"},
    [T_10] = {"T10", "K", DSE_REAL(200), DSE_REAL(1000), "temperature of feed F10"},
    [T_20] = {"T20", "K", DSE_REAL(200), DSE_REAL(1000), "temperature of feed F20"},
    [X_A10] = {"xA10", "kg/kg", DSE_REAL(0), DSE_REAL(1), "fraction of A in feed F10"},
    [X_B10] = {"xB10", "kg/kg", DSE_REAL(0), DSE_REAL(1), "fraction of B in feed F10"},
    [X_A20] = {"xA20", "kg/kg", DSE_REAL(0), DSE_REAL(1), "fraction of A in feed F20"},
    [X_B20] = {"xB20", "kg/kg", DSE_REAL(0), DSE_REAL(1), "fraction of B in feed F20"},
    [ALPHA_A] = {"aA", "", DSE_REAL(1e-3), DSE_REAL(1e3), "relative volatility of A"},
    [ALPHA_B] = {"aB", "", DSE_REAL(1e-3), DSE_REAL(1e3), "relative volatility of B"},
    [ALPHA_C] = {"aC", "", DSE_REAL(1e-3), DSE_REAL(1e3), "relative volatility of C"},
    [DH_1] = {"dH1", "kJ/kmol", DSE_REAL(-1e7), DSE_REAL(1e7), "enthalpy of A -> B"},
    [DH_2] = {"dH2", "kJ/kmol", DSE_REAL(-1e7), DSE_REAL(1e7), "enthalpy of B -> C"},
    [DH_V1] = {"dHv1", "kJ/kmol", DSE_REAL(-1e7), DSE_REAL(1e7),
               "minus enthalpy of evaporation, A"},
    [DH_V2] = {"dHv2", "kJ/kmol", DSE_REAL(-1e7), DSE_REAL(1e7),
               "minus enthalpy of evaporation, B"},
    [DH_V3] = {"dHv3", "kJ/kmol", DSE_REAL(-1e7), DSE_REAL(1e7),
               "minus enthalpy of evaporation, C"},
};

static const dse_real values[PARAMETERS] = {
    [F_10] = DSE_REAL(5.04),     [F_20] = DSE_REAL(5.04),     [F_R] = DSE_REAL(5.04),
    [F_P] = DSE_REAL(5.04),      [V_1] = DSE_REAL(1.0),       [V_2] = DSE_REAL(0.5),
    [V_3] = DSE_REAL(1.0),       [K_1] = DSE_REAL(9.972e6),   [K_2] = DSE_REAL(9.36e6),
    [E_1] = DSE_REAL(5e4),       [E_2] = DSE_REAL(6e4),       [GAS] = DSE_REAL(8.314),
    [RHO] = DSE_REAL(1000),      [C_P] = DSE_REAL(4.2),       [MW_R] = DSE_REAL(250),
    [MW_V] = DSE_REAL(500),      [T_10] = DSE_REAL(300),      [T_20] = DSE_REAL(300),
    [X_A10] = DSE_REAL(1),       [X_B10] = DSE_REAL(0),       [X_A20] = DSE_REAL(1),
    [X_B20] = DSE_REAL(0),       [ALPHA_A] = DSE_REAL(3.5),   [ALPHA_B] = DSE_REAL(1.0),
    [ALPHA_C] = DSE_REAL(0.5),   [DH_1] = DSE_REAL(-6e4),     [DH_2] = DSE_REAL(-7e4),
    [DH_V1] = DSE_REAL(-3.53e4), [DH_V2] = DSE_REAL(-1.57e4), [DH_V3] = DSE_REAL(-4.068e4),
};

static const dse_real x0[] = {DSE_REAL(0.0443), DSE_REAL(0.3052), DSE_REAL(557.2686),
                              DSE_REAL(0.1413), DSE_REAL(0.4129), DSE_REAL(508.7090),
                              DSE_REAL(0.0578), DSE_REAL(0.3325), DSE_REAL(542.8199)};

static const struct dse_parameter_set sets[] = {
    {"source", "section 3.5, Table 3.2, corrected", values, x0},
};

static const int index[] = {0, 1, 2, 3, 4, 5, 6, 7, 8};
static const struct dse_subsystem subsystems[] = {
    {"reactor 1", 3, index, 1, index},
    {"reactor 2", 3, index + 3, 1, index + 1},
    {"separator", 3, index + 6, 1, index + 2},
};

static void prepare_flows(const dse_real *p, struct dse_sep3 *out)
{
    const dse_real F_1 = p[F_10] + p[F_R], F_2 = F_1 + p[F_20];
    out->feed_1 = p[F_10] / p[V_1];
    out->recycle_1 = p[F_R] / p[V_1];
    out->from_1 = F_1 / p[V_2];
    out->feed_2 = p[F_20] / p[V_2];
    out->from_2 = F_2 / p[V_3];
    out->overhead_3 = (p[F_R] + p[F_P]) / p[V_3];
}

static enum dse_status prepare(const dse_real *p, dse_real *prepared)
{
    struct dse_sep3 *out = (struct dse_sep3 *)prepared;
    for (int k = 0; k < PARAMETERS; k++)
        if (!(p[k] >= parameters[k].min && p[k] <= parameters[k].max))
            return DSE_EINVAL;
    prepare_flows(p, out);
    for (int i = 0; i < 2; i++) {
        out->T_feed[i] = p[T_10 + i];
        out->xA_feed[i] = p[X_A10 + 2 * i];
        out->xB_feed[i] = p[X_B10 + 2 * i];
        out->k[i] = p[K_1 + i];
        out->s[i] = p[E_1 + i] / p[GAS];
        out->g[i] = -p[DH_1 + i] / (p[C_P] * p[MW_R]);
    }
    for (int i = 0; i < 3; i++) {
        out->a[i] = p[ALPHA_A + i];
        out->evaporation[i] = out->overhead_3 * p[DH_V1 + i] / (p[C_P] * p[MW_V]);
        out->heat[i] = 1 / (p[RHO] * p[C_P] * p[V_1 + i]);
    }
    return dse_all_finite(prepared, DSE_SEP3_SIZE) ? DSE_OK : DSE_EINVAL;
}

const struct dse_plant dse_plant_sep3 = {
    .name = "sep3",
    .title = "two stirred tanks and a separator with recycle",
    .source = "coordinated MHE, section 3.5, Table 3.2, corrected",
    .time_unit = "h",
    .time_unit_s = DSE_REAL(3600),
    .nx = DSE_SEP3_NX,
    .nu = DSE_SEP3_NU,
    .ny = DSE_SEP3_NY,
    .states = states,
    .inputs = inputs,
    .outputs = outputs,
    .n_parameters = PARAMETERS,
    .parameters = parameters,
    .n_sets = 1,
    .sets = sets,
    .n_subsystems = 3,
    .subsystems = subsystems,
    .prepared_size = DSE_SEP3_SIZE,
    .prepare = prepare,
    .model = dse_sep3_model,
};
