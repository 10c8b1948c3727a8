/* Three tanks in a row, the outer two fed by pumps: sections 6.2 and 6.3, eq 6.1-6.8, Table 6.1 of
 * the adaptive high-gain source.
 *
 *     u_1 -> [1] --p_1--> [2] <--p_2-- [3] <- u_2        and out of every tank: d_1, d_2, d_3
 *
 * The level differences x_2 = x_1 - x_3, x_4 = x_5 - x_3 ("interactions") are states of their own
 * (6.6), so that x_2 - (x_1 - x_3) and x_4 - (x_5 - x_3) are invariants of the motion. States are
 * stacked block by block, r = (x_1, x_2 | x_3 | x_5, x_4):
 *
 *     x_1' = b_1 u_1 - q_1 - d_1 sqrt x_1            q_1 = p_1 sqrt x_2
 *     x_3' = q_1 + q_2 - d_2 sqrt x_3                q_2 = p_2 sqrt x_4
 *     x_5' = b_2 u_2 - q_2 - d_3 sqrt x_5
 *     x_2' = x_1' - x_3',   x_4' = x_5' - x_3',      y = (x_1, x_3, x_5)
 *
 * in cm and h, with p = 60 a_p S_p sqrt(2g)/S, d = 60 a_d S_d sqrt(2g)/S, b = 60e6 b/S: the
 * identified a are read in s/min and b u in m3/min.
 *
 * The estimators' model takes the flows as going towards tank 2, as its normal form does, and
 * every square root at no less than 0.01 cm. For the rig itself the parameter `reverse` lets the
 * flows follow the sign of the level difference (6.1) and stops the outflow of an empty tank.
 *
 * Nine solenoid valves, open or shut, make other plants of it (6.1, Fig 6.1): v1 to v3 in the pipes
 * between tanks 1 and 2 at the bottom, in the middle and at the top, v4 to v6 in those between
 * tanks 3 and 2, v7 to v9 in the drains. The source does not say which ones are where, nor how high
 * the pipes are: this numbering, the heights and the same coefficient for the pipes of a side are
 * ours. The equations above are those with the bottom pipes and the drains open. */
#include "dse/plant.h"

#include <stddef.h>

#include "dse/math.h"
#include "three_tank_internal.h"

extern const struct dse_plant dse_plant_three_tank;

static const struct dse_signal states[STATES] = {
    [X1] = {"x1", "cm", DSE_REAL(51.08), DSE_REAL(5), "level of tank 1"},
    [X2] = {"x2", "cm", DSE_REAL(35.03), DSE_REAL(5), "level of tank 1 above that of tank 2"},
    [X3] = {"x3", "cm", DSE_REAL(16.05), DSE_REAL(5), "level of tank 2"},
    [X5] = {"x5", "cm", DSE_REAL(56.93), DSE_REAL(5), "level of tank 3"},
    [X4] = {"x4", "cm", DSE_REAL(40.88), DSE_REAL(5), "level of tank 3 above that of tank 2"},
};

/* The flows that keep the levels above where they are when d_2 is that of the rig. */
static const struct dse_signal inputs[INPUTS] = {
    [U1] = {"u1", "", DSE_REAL(7.286216517786794), DSE_REAL(1), "flow injected into tank 1"},
    [U2] = {"u2", "", DSE_REAL(8.791727762795189), DSE_REAL(1), "flow injected into tank 3"},
};

static const struct dse_signal outputs[OUTPUTS] = {
    [Y1] = {"y1", "cm", DSE_REAL(51.08), DSE_REAL(5), "measured level of tank 1"},
    [Y2] = {"y2", "cm", DSE_REAL(16.05), DSE_REAL(5), "measured level of tank 2"},
    [Y3] = {"y3", "cm", DSE_REAL(56.93), DSE_REAL(5), "measured level of tank 3"},
};

enum { A_P1, A_P2, A_D1, A_D2, A_D3, B_1, B_2, AREA, AREA_P, AREA_D, G, REVERSE };
enum { H_MIDDLE = REVERSE + 1, H_TOP, V_1, V_4 = V_1 + 3, V_7 = V_4 + 3, PARAMETERS = V_7 + 3 };

static const struct dse_parameter parameters[PARAMETERS] = {
    [A_P1] = {"ap1", "s/min", DSE_REAL(1e-3), DSE_REAL(1e3), "outflow coefficient, tank 1 to 2"},
    [A_P2] = {"ap2", "s/min", DSE_REAL(1e-3), DSE_REAL(1e3), "outflow coefficient, tank 3 to 2"},
    [A_D1] = {"ad1", "s/min", DSE_REAL(0), DSE_REAL(1e3), "outflow coefficient out of tank 1"},
    [A_D2] = {"ad2", "s/min", DSE_REAL(0), DSE_REAL(1e3), "outflow coefficient out of tank 2"},
    [A_D3] = {"ad3", "s/min", DSE_REAL(0), DSE_REAL(1e3), "outflow coefficient out of tank 3"},
    [B_1] = {"b1", "m3/min", DSE_REAL(0), DSE_REAL(1), "flow into tank 1 per unit of u1"},
    [B_2] = {"b2", "m3/min", DSE_REAL(0), DSE_REAL(1), "flow into tank 3 per unit of u2"},
    [AREA] = {"S", "cm2", DSE_REAL(1e-3), DSE_REAL(1e6), "cross section of a tank"},
    [AREA_P] = {"Sp", "cm2", DSE_REAL(1e-6), DSE_REAL(1e3), "cross section of a connecting pipe"},
    [AREA_D] = {"Sd", "cm2", DSE_REAL(1e-6), DSE_REAL(1e3), "cross section of a drain"},
    [G] = {"g", "cm/s2", DSE_REAL(900), DSE_REAL(1000), "gravity"},
    [REVERSE] = {"reverse", "", DSE_REAL(0), DSE_REAL(1),
                 "1: flows between tanks follow the sign of the difference; 0: towards tank 2"},
    [H_MIDDLE] = {"hm", "cm", DSE_REAL(0), DSE_REAL(1e3), "height of the middle pipes"},
    [H_TOP] = {"ht", "cm", DSE_REAL(0), DSE_REAL(1e3), "height of the top pipes"},
    [V_1] = {"v1", "", DSE_REAL(0), DSE_REAL(1),
             "valve, tank 1 to 2 at the bottom: 1 open, 0 shut"},
    [V_1 + 1] = {"v2", "", DSE_REAL(0), DSE_REAL(1), "valve, tank 1 to 2 in the middle"},
    [V_1 + 2] = {"v3", "", DSE_REAL(0), DSE_REAL(1), "valve, tank 1 to 2 at the top"},
    [V_4] = {"v4", "", DSE_REAL(0), DSE_REAL(1), "valve, tank 3 to 2 at the bottom"},
    [V_4 + 1] = {"v5", "", DSE_REAL(0), DSE_REAL(1), "valve, tank 3 to 2 in the middle"},
    [V_4 + 2] = {"v6", "", DSE_REAL(0), DSE_REAL(1), "valve, tank 3 to 2 at the top"},
    [V_7] = {"v7", "", DSE_REAL(0), DSE_REAL(1), "valve, drain of tank 1"},
    [V_7 + 1] = {"v8", "", DSE_REAL(0), DSE_REAL(1), "valve, drain of tank 2"},
    [V_7 + 2] = {"v9", "", DSE_REAL(0), DSE_REAL(1), "valve, drain of tank 3"},
};

#define COMMON                                                                                     \
    [A_P1] = DSE_REAL(3.43), [A_P2] = DSE_REAL(3.43), [A_D1] = DSE_REAL(18.15),                    \
    [A_D3] = DSE_REAL(18.98), [B_1] = DSE_REAL(4.56e-4), [B_2] = DSE_REAL(4.16e-4),                \
    [AREA] = DSE_REAL(154), [AREA_P] = DSE_REAL(0.5), [AREA_D] = DSE_REAL(0.5),                    \
    [G] = DSE_REAL(981), [H_MIDDLE] = DSE_REAL(30), [H_TOP] = DSE_REAL(60), [V_1] = DSE_REAL(1),   \
    [V_4] = DSE_REAL(1), [V_7] = DSE_REAL(1), [V_7 + 1] = DSE_REAL(1), [V_7 + 2] = DSE_REAL(1)

static const dse_real values_identified[PARAMETERS] = {
    COMMON, [A_D2] = DSE_REAL(7.78), [REVERSE] = DSE_REAL(0)};
static const dse_real values_rig[PARAMETERS] = {
    COMMON, [A_D2] = DSE_REAL(10.541392035982543), [REVERSE] = DSE_REAL(1)};
static const dse_real x0[STATES] = {DSE_REAL(51.08), DSE_REAL(35.03), DSE_REAL(16.05),
                                    DSE_REAL(56.93), DSE_REAL(40.88)};

static const struct dse_parameter_set sets[] = {
    {"identified", "section 6.2.2, eq 6.5", values_identified, x0},
    {"rig", "stand-in for the rig: a_d2 that makes the initial state an equilibrium", values_rig,
     x0},
};

static const int states_of_1[] = {X1, X2};
static const int states_of_2[] = {X3};
static const int states_of_3[] = {X5, X4};
static const int outputs_of_1[] = {Y1};
static const int outputs_of_2[] = {Y2};
static const int outputs_of_3[] = {Y3};
static const struct dse_subsystem subsystems[] = {
    {"tank 1", 2, states_of_1, 1, outputs_of_1},
    {"tank 2", 1, states_of_2, 1, outputs_of_2},
    {"tank 3", 2, states_of_3, 1, outputs_of_3},
};

/* ---- derived constants ---- */

/* A flow that is half reversed is no flow, a solenoid valve is open or shut. */
static int is_whole(dse_real value)
{
    return !(value > 0 && value < 1);
}

/* The pipes above the bottom: p as of the bottom pipe of their side where their valve is open. */
static void prepare_upper(const dse_real *p, dse_real speed, struct dse_tanks *tanks)
{
    tanks->is_open = 0;
    for (int h = 0; h < 2; h++) {
        tanks->height[h] = p[H_MIDDLE + h];
        for (int side = 0; side < 2; side++) {
            const dse_real valve = p[(side == 0 ? V_1 : V_4) + 1 + h];
            tanks->upper[side][h] = valve * p[A_P1 + side] * p[AREA_P] * speed;
            tanks->is_open = valve > 0 ? 1 : tanks->is_open;
        }
    }
}

static enum dse_status prepare(const dse_real *p, dse_real *prepared)
{
    for (int k = 0; k < PARAMETERS; k++) {
        if (!(p[k] >= parameters[k].min && p[k] <= parameters[k].max)) {
            return DSE_EINVAL;
        }
    }
    struct dse_tanks *tanks = (struct dse_tanks *)prepared;
    const dse_real speed = 60 * dse_sqrt(2 * p[G]) / p[AREA]; /* s/min to h, sqrt(2g)/S */
    for (int k = 0; k < 2; k++) {
        tanks->p[k] = p[k == 0 ? V_1 : V_4] * p[A_P1 + k] * p[AREA_P] * speed;
        tanks->b[k] = DSE_REAL(60e6) * p[B_1 + k] / p[AREA];
    }
    for (int k = 0; k < 3; k++) {
        tanks->d[k] = p[V_7 + k] * p[A_D1 + k] * p[AREA_D] * speed;
    }
    tanks->reverse = p[REVERSE];
    prepare_upper(p, speed, tanks);
    int whole = is_whole(p[REVERSE]);
    for (int k = V_1; k < PARAMETERS; k++) {
        whole = whole && is_whole(p[k]);
    }
    return whole && dse_all_finite(prepared, DSE_TANKS_SIZE) ? DSE_OK : DSE_EINVAL;
}

/* ---- the model ---- */

/* sqrt of a level difference with its sign, and of the level above a drain. */
static dse_real flow_root(const struct dse_tanks *tanks, dse_real difference)
{
    if (tanks->reverse > 0) {
        return difference < 0 ? -dse_sqrt(-difference) : dse_sqrt(difference);
    }
    return dse_sqrt(difference > DSE_TANKS_LOWEST ? difference : DSE_TANKS_LOWEST);
}

static dse_real drain_root(const struct dse_tanks *tanks, dse_real level)
{
    const dse_real lowest = tanks->reverse > 0 ? 0 : DSE_TANKS_LOWEST;
    return dse_sqrt(level > lowest ? level : lowest);
}

static enum dse_status derivative(const struct dse_model *model, dse_real t, const dse_real *x,
                                  const dse_real *u, dse_real *dx)
{
    const struct dse_tanks *tanks = model->parameters;
    (void)t;
    if (u == NULL) {
        return DSE_EINVAL;
    }
    if (!dse_all_finite(x, STATES)) {
        return DSE_EMODEL;
    }
    dse_real q_1 = tanks->p[0] * flow_root(tanks, x[X2]);
    dse_real q_2 = tanks->p[1] * flow_root(tanks, x[X4]);
    if (tanks->is_open > 0) {
        dse_real upper[2];
        dse_three_tank_upper_flows(tanks, x, upper);
        q_1 += upper[0];
        q_2 += upper[1];
    }
    dx[X1] = tanks->b[0] * u[U1] - q_1 - tanks->d[0] * drain_root(tanks, x[X1]);
    dx[X3] = q_1 + q_2 - tanks->d[1] * drain_root(tanks, x[X3]);
    dx[X5] = tanks->b[1] * u[U2] - q_2 - tanks->d[2] * drain_root(tanks, x[X5]);
    dx[X2] = dx[X1] - dx[X3];
    dx[X4] = dx[X5] - dx[X3];
    return DSE_OK;
}

static enum dse_status output(const struct dse_model *model, dse_real t, const dse_real *x,
                              const dse_real *u, dse_real *y)
{
    (void)model;
    (void)t;
    (void)u;
    y[Y1] = x[X1];
    y[Y2] = x[X3];
    y[Y3] = x[X5];
    return DSE_OK;
}

/* d sqrt(level)/d level; where the root is held its slope is kept, so that no row of a Jacobian
 * vanishes. */
static dse_real root_slope(dse_real level)
{
    const dse_real size = dse_abs(level);
    return DSE_REAL(0.5) / dse_sqrt(size > DSE_TANKS_LOWEST ? size : DSE_TANKS_LOWEST);
}

static enum dse_status derivative_jacobian(const struct dse_model *model, dse_real t,
                                           const dse_real *x, const dse_real *u, dse_real *F)
{
    const struct dse_tanks *tanks = model->parameters;
    (void)t;
    (void)u;
    if (!dse_all_finite(x, STATES)) {
        return DSE_EMODEL;
    }
    const dse_real q_1 = tanks->p[0] * root_slope(x[X2]);
    const dse_real q_2 = tanks->p[1] * root_slope(x[X4]);
    for (int k = 0; k < STATES * STATES; k++) {
        F[k] = 0;
    }
    F[X1 * STATES + X1] = -tanks->d[0] * root_slope(x[X1]);
    F[X1 * STATES + X2] = -q_1;
    F[X3 * STATES + X2] = q_1;
    F[X3 * STATES + X3] = -tanks->d[1] * root_slope(x[X3]);
    F[X3 * STATES + X4] = q_2;
    F[X5 * STATES + X5] = -tanks->d[2] * root_slope(x[X5]);
    F[X5 * STATES + X4] = -q_2;
    if (tanks->is_open > 0) {
        dse_three_tank_upper_slopes(tanks, x, F);
    }
    for (int k = 0; k < STATES; k++) {
        F[X2 * STATES + k] = F[X1 * STATES + k] - F[X3 * STATES + k];
        F[X4 * STATES + k] = F[X5 * STATES + k] - F[X3 * STATES + k];
    }
    return DSE_OK;
}

static enum dse_status output_jacobian(const struct dse_model *model, dse_real t, const dse_real *x,
                                       const dse_real *u, dse_real *H)
{
    (void)model;
    (void)t;
    (void)x;
    (void)u;
    for (int k = 0; k < OUTPUTS * STATES; k++) {
        H[k] = 0;
    }
    H[Y1 * STATES + X1] = 1;
    H[Y2 * STATES + X3] = 1;
    H[Y3 * STATES + X5] = 1;
    return DSE_OK;
}

static void model(const dse_real *prepared, struct dse_model *out)
{
    *out = (struct dse_model){.time = DSE_CONTINUOUS,
                              .nx = STATES,
                              .nu = INPUTS,
                              .ny = OUTPUTS,
                              .parameters = prepared,
                              .f = derivative,
                              .h = output,
                              .dfdx = derivative_jacobian,
                              .dhdx = output_jacobian};
}

const struct dse_plant dse_plant_three_tank = {
    .name = "three_tank",
    .title = "three tanks in a row",
    .source = "adaptive high-gain EKF, sections 6.2, 6.3, eq 6.1-6.8, Table 6.1",
    .time_unit = "h",
    .time_unit_s = DSE_REAL(3600),
    .nx = STATES,
    .nu = INPUTS,
    .ny = OUTPUTS,
    .states = states,
    .inputs = inputs,
    .outputs = outputs,
    .n_parameters = PARAMETERS,
    .parameters = parameters,
    .n_sets = 2,
    .sets = sets,
    .n_subsystems = 3,
    .subsystems = subsystems,
    .prepared_size = DSE_TANKS_SIZE,
    .prepare = prepare,
    .model = model,
    .normal_form = dse_three_tank_normal_form,
};
