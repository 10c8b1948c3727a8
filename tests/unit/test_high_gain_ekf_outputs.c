/* Adaptive high-gain EKF with several outputs per filter, and the centralised one (eq 3.6). */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "dse/high_gain_ekf.h"
#include "dse/linalg.h"
#include "dse/math.h"
#include "dse/ode.h"
#include "dse/plant.h"

#ifdef DSE_REAL_IS_float
#define TOLERANCE(in_double, in_float) DSE_REAL(in_float)
#else
#define TOLERANCE(in_double, in_float) DSE_REAL(in_double)
#endif

static void assert_near(dse_real got, dse_real want, dse_real tolerance)
{
    if (!(dse_abs(got - want) <= tolerance)) {
        fail_msg("%.17g is not %.17g within %g", (double)got, (double)want, (double)tolerance);
    }
}

/* ---- weights ---- */

static const int chains[3] = {2, 1, 3};
enum { CHAINS = 3, BLOCK = 6, N_MAX = 4 };

static int position(int r, int *chain)
{
    *chain = 0;
    while (r >= chains[*chain]) {
        r -= chains[(*chain)++];
    }
    return r;
}

/* Theta of state r: theta^-(n* - n_l + position) in its chain l. */
static dse_real scale_of(dse_real theta, int r)
{
    int l;
    const int at = position(r, &l);
    return 1 / dse_pow(theta, (dse_real)(N_MAX - chains[l] + at));
}

/* (2.14): Theta A = theta A Theta, A Theta^-1 = theta Theta^-1 A, with one shift matrix per chain.
 */
static void chains_shift_by_one_power_of_theta(void **state)
{
    (void)state;
    const dse_real theta = 7;
    for (int r = 0; r < BLOCK; r++) {
        for (int c = 0; c < BLOCK; c++) {
            int in_row, in_column;
            const int a = position(r, &in_row), b = position(c, &in_column);
            const dse_real A = in_row == in_column && b == a + 1 ? 1 : 0;
            const dse_real left = scale_of(theta, r) * A, right = theta * A * scale_of(theta, c);
            assert_near(left, right, TOLERANCE(1e-15, 1e-7));
            const dse_real up = A / scale_of(theta, c), down = theta / scale_of(theta, r) * A;
            assert_near(up, down, TOLERANCE(1e-12, 1e-4) * (1 + up));
        }
    }
}

/* Theta^-1 C' R_th^-1 C Theta^-1 = theta C' R^-1 C, and Q_th = theta Theta^-1 Q Theta^-1. */
static void full_weights_of_several_chains_satisfy_the_scaling_identities(void **state)
{
    (void)state;
    const dse_real theta = 3;
    const dse_real R[9] = {2, DSE_REAL(0.5), 0, DSE_REAL(0.5), 1, DSE_REAL(0.2),
                           0, DSE_REAL(0.2), 3};
    static const int start[3] = {0, 2, 3};
    dse_real Q[BLOCK * BLOCK], R_th[9], Q_th[BLOCK * BLOCK], inverse[9], want[9], LU[9];
    int pivots[3];
    for (int k = 0; k < BLOCK * BLOCK; k++) {
        Q[k] = 1 + (dse_real)(k % 7);
    }
    dse_high_gain_weights(DSE_HIGH_GAIN_FULL, CHAINS, chains, N_MAX, theta, R, Q, R_th, Q_th);
    memcpy(LU, R_th, sizeof LU);
    dse_mat_identity(3, inverse);
    assert_int_equal(dse_lu(3, LU, pivots), DSE_OK);
    dse_lu_solve(3, LU, pivots, 3, inverse);
    memcpy(LU, R, sizeof LU);
    dse_mat_identity(3, want);
    assert_int_equal(dse_lu(3, LU, pivots), DSE_OK);
    dse_lu_solve(3, LU, pivots, 3, want);
    for (int a = 0; a < 3; a++) {
        for (int b = 0; b < 3; b++) {
            const dse_real scaled =
                inverse[a * 3 + b] / scale_of(theta, start[a]) / scale_of(theta, start[b]);
            assert_near(scaled, theta * want[a * 3 + b], TOLERANCE(1e-12, 1e-4));
        }
    }
    for (int r = 0; r < BLOCK; r++) {
        for (int c = 0; c < BLOCK; c++) {
            const dse_real q = theta * Q[r * BLOCK + c] / scale_of(theta, r) / scale_of(theta, c);
            assert_near(Q_th[r * BLOCK + c], q, TOLERANCE(1e-12, 1e-5) * q);
        }
    }
}

/* ---- a linear plant of five states with three outputs, cut in different ways ---- */

enum { N = 5, OUTPUTS = 3, HORIZON = 6 };

struct linear {
    dse_real A[N * N];
};

static const int outputs_at[OUTPUTS] = {0, 2, 3};

static enum dse_status multiply(const struct linear *linear, const dse_real *x, dse_real *dx)
{
    dse_mat_vec(N, N, linear->A, x, dx);
    return DSE_OK;
}

static enum dse_status f(const struct dse_model *model, dse_real t, const dse_real *x,
                         const dse_real *u, dse_real *dx)
{
    (void)t;
    (void)u;
    return multiply(model->parameters, x, dx);
}

static enum dse_status h(const struct dse_model *model, dse_real t, const dse_real *x,
                         const dse_real *u, dse_real *y)
{
    (void)model;
    (void)t;
    (void)u;
    for (int l = 0; l < OUTPUTS; l++) {
        y[l] = x[outputs_at[l]];
    }
    return DSE_OK;
}

static enum dse_status dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                            const dse_real *u, dse_real *F)
{
    const struct linear *linear = model->parameters;
    (void)t;
    (void)x;
    (void)u;
    memcpy(F, linear->A, sizeof linear->A);
    return DSE_OK;
}

static enum dse_status same(const struct dse_normal_form *form, dse_real t, const dse_real *in,
                            const dse_real *u, dse_real *out)
{
    (void)form;
    (void)t;
    (void)u;
    memcpy(out, in, N * sizeof *out);
    return DSE_OK;
}

static enum dse_status field(const struct dse_normal_form *form, dse_real t, const dse_real *z,
                             const dse_real *u, dse_real *dz)
{
    (void)t;
    (void)u;
    return multiply(form->parameters, z, dz);
}

static enum dse_status jacobian(const struct dse_normal_form *form, int i, dse_real t,
                                const dse_real *z, const dse_real *u, dse_real *F)
{
    const struct linear *linear = form->parameters;
    int offset = 0;
    (void)t;
    (void)z;
    (void)u;
    for (int j = 0; j < i; j++) {
        offset += form->n_i[j];
    }
    for (int r = 0; r < form->n_i[i]; r++) {
        for (int c = 0; c < form->n_i[i]; c++) {
            F[r * form->n_i[i] + c] = linear->A[(offset + r) * N + offset + c];
        }
    }
    return DSE_OK;
}

static enum dse_status map_jacobian(const struct dse_normal_form *form, int i, dse_real t,
                                    const dse_real *chi, const dse_real *u, dse_real *M)
{
    (void)t;
    (void)chi;
    (void)u;
    dse_mat_identity(form->n_i[i], M);
    return DSE_OK;
}

static enum dse_status push(const struct dse_normal_form *form, dse_real t, const dse_real *chi,
                            const dse_real *u, const dse_real *dchi, dse_real *dz)
{
    (void)chi;
    return same(form, t, dchi, u, dz);
}

static enum dse_status field_jacobian(const struct dse_normal_form *form, dse_real t,
                                      const dse_real *z, const dse_real *u, dse_real *F)
{
    const struct linear *linear = form->parameters;
    (void)t;
    (void)z;
    (void)u;
    memcpy(F, linear->A, sizeof linear->A);
    return DSE_OK;
}

/* Three chains of 2, 1 and 2 states, all coupled. */
static const struct linear coupled = {.A = {0, 1,      0,      0,  0, /**/ -8, -4,     1, 0,
                                            0, /**/ 1, 0,      -3, 1, 0,       /**/ 0, 0, 0,
                                            0, 1,      /**/ 1, 0,  2, -9,      -5}};
/* The same without coupling between {2, 1} and {2}. */
static const struct linear halves = {.A = {0, 1,      0,      0,  0, /**/ -8, -4,     1, 0,
                                           0, /**/ 1, 0,      -3, 0, 0,       /**/ 0, 0, 0,
                                           0, 1,      /**/ 0, 0,  0, -9,      -5}};

static const int three_blocks[3] = {2, 1, 2}, two_blocks[2] = {3, 2}, one_block[1] = {5};
static const int two_counts[2] = {2, 1}, one_count[1] = {3};

static struct dse_normal_form form_of(const struct linear *linear, int p)
{
    return (struct dse_normal_form){.n = N,
                                    .p = p,
                                    .n_i = p == 3   ? three_blocks
                                           : p == 2 ? two_blocks
                                                    : one_block,
                                    .n_outputs = p == 3   ? NULL
                                                 : p == 2 ? two_counts
                                                          : one_count,
                                    .chains = p == 3 ? NULL : three_blocks,
                                    .parameters = linear,
                                    .encode = same,
                                    .decode = same,
                                    .field = field,
                                    .jacobian = jacobian,
                                    .map_jacobian = map_jacobian,
                                    .push = push,
                                    .field_jacobian = field_jacobian};
}

static struct dse_model model_of(const struct linear *linear)
{
    return (struct dse_model){.time = DSE_CONTINUOUS,
                              .nx = N,
                              .ny = OUTPUTS,
                              .parameters = linear,
                              .f = f,
                              .h = h,
                              .dfdx = dfdx};
}

struct run {
    struct dse_model model;
    struct dse_normal_form form;
    struct dse_high_gain_ekf_config config[2];
    struct dse_high_gain_ekf filter[2];
    dse_real memory[2][DSE_HIGH_GAIN_EKF_STORAGE(N, 0, OUTPUTS, 3, N, HORIZON)];
    dse_real P0[2][N * N], Q[2][N * N], R[OUTPUTS * OUTPUTS];
    dse_real x[N];
    int filters;
    int64_t k;
};

static const dse_real guess[N] = {3, 1, 1, -1, 0};

static struct dse_high_gain_ekf_config base_config(void)
{
    return (struct dse_high_gain_ekf_config){.period = DSE_REAL(0.01),
                                             .innovation = DSE_HIGH_GAIN_SUM,
                                             .adaptation = {.theta_m = 4,
                                                            .rise_time = DSE_REAL(0.02),
                                                            .relaxation = 2,
                                                            .sharpness = 50,
                                                            .threshold = DSE_REAL(0.05)},
                                             .horizon = HORIZON};
}

/* Symmetric definite matrices; `of` is where the block lies in the whole. */
static void fill(int n, int of, dse_real diagonal, dse_real beside, dse_real *A)
{
    for (int r = 0; r < n; r++) {
        for (int c = 0; c < n; c++) {
            A[r * n + c] = r == c ? diagonal + (dse_real)(r + of) / 4
                                  : (r == c + 1 || c == r + 1 ? beside : 0);
        }
    }
}

static void open_run(struct run *run, const struct linear *linear, int p,
                     const struct dse_high_gain_ekf_config *config, dse_real beside)
{
    *run = (struct run){.x = {1, 0, -1, 2, 1}, .filters = config->whole ? 1 : p};
    run->model = model_of(linear);
    run->form = form_of(linear, p);
    for (int i = 0, offset = 0; i < run->filters; offset += run->form.n_i[i++]) {
        struct dse_arena arena;
        struct dse_high_gain_ekf_config *own = &run->config[i];
        const int n_i = config->whole ? N : run->form.n_i[i];
        fill(n_i, offset, 2, beside, run->P0[i]);
        fill(n_i, offset, 5, beside, run->Q[i]);
        *own = *config;
        own->model = &run->model;
        own->form = &run->form;
        own->i = i;
        own->x0 = guess;
        own->P0 = run->P0[i];
        own->Q = run->Q[i];
        dse_arena_init(&arena, run->memory[i], (int)(sizeof run->memory[i] / sizeof(dse_real)));
        assert_int_equal(dse_high_gain_ekf_init(&run->filter[i], own, &arena), DSE_OK);
    }
}

/* missing: an output that does not come, -1: none. */
static void tick(struct run *run, int missing)
{
    dse_real y[OUTPUTS], scratch[DSE_RK4_SCRATCH(N)];
    dse_real message[2][DSE_HIGH_GAIN_EKF_MESSAGE(N)];
    bool valid[OUTPUTS];
    int count[2] = {0};
    const dse_real t = (dse_real)run->k * run->config[0].period;
    h(&run->model, t, run->x, NULL, y);
    for (int i = 0, first = 0; i < run->filters; first += run->filter[i++].m) {
        const struct dse_measurement own = {.y = y + first, .valid = valid + first};
        for (int l = 0; l < OUTPUTS; l++) {
            valid[l] = l != missing;
        }
        assert_int_equal(dse_high_gain_ekf_begin(&run->filter[i], run->k, t, NULL, &own), DSE_OK);
        count[i] = dse_high_gain_ekf_message(&run->filter[i], 0, message[i]);
    }
    for (int i = 0; i < run->filters; i++) {
        if (run->filters == 2) {
            assert_int_equal(
                dse_high_gain_ekf_receive(&run->filter[i], 0, 1 - i, message[1 - i], count[1 - i]),
                DSE_OK);
            assert_int_equal(dse_high_gain_ekf_advance(&run->filter[i], 0), DSE_OK);
        }
        assert_int_equal(dse_high_gain_ekf_finish(&run->filter[i]), DSE_OK);
    }
    assert_int_equal(
        dse_rk4_model_step(&run->model, t, run->config[0].period, NULL, run->x, scratch), DSE_OK);
    run->k++;
}

/* ---- several outputs ---- */

static void centralised_filter_is_the_one_block_with_all_chains(void **state)
{
    (void)state;
    static struct run whole, block;
    for (int c = 0; c < 3; c++) {
        struct dse_high_gain_ekf_config config = base_config();
        config.R = 1;
        config.coords = (enum dse_high_gain_coords)c;
        open_run(&block, &coupled, 1, &config, DSE_REAL(0.5));
        config.whole = true;
        open_run(&whole, &coupled, 3, &config, DSE_REAL(0.5));
        for (int k = 0; k < 60; k++) {
            tick(&whole, k % 7 == 3 ? 1 : -1);
            tick(&block, k % 7 == 3 ? 1 : -1);
            assert_memory_equal(dse_high_gain_ekf_picture(&whole.filter[0]),
                                dse_high_gain_ekf_picture(&block.filter[0]), N * sizeof(dse_real));
            assert_memory_equal(dse_high_gain_ekf_covariance(&whole.filter[0]),
                                dse_high_gain_ekf_covariance(&block.filter[0]),
                                N * N * sizeof(dse_real));
        }
        assert_true(dse_high_gain_ekf_theta(&whole.filter[0]) > 1);
        for (int s = 0; s < N; s++) {
            assert_near(dse_high_gain_ekf_picture(&whole.filter[0])[s], whole.x[s], DSE_REAL(0.35));
        }
    }
}

/* Without coupling there is nothing to be gained from knowing all. */
static void uncoupled_subsystems_estimate_as_the_centralised_filter(void **state)
{
    (void)state;
    static struct run whole, parts;
    struct dse_high_gain_ekf_config config = base_config();
    config.R = 2;
    open_run(&parts, &halves, 2, &config, 0);
    config.whole = true;
    open_run(&whole, &halves, 2, &config, 0);
    for (int r = 0; r < N; r++) { /* the weights of the whole are those of the parts */
        for (int c = 0; c < N; c++) {
            const bool first = r < 3 && c < 3, second = r >= 3 && c >= 3;
            whole.filter[0].P[r * N + c] = first    ? parts.P0[0][r * 3 + c]
                                           : second ? parts.P0[1][(r - 3) * 2 + c - 3]
                                                    : 0;
            whole.Q[0][r * N + c] = first    ? parts.Q[0][r * 3 + c]
                                    : second ? parts.Q[1][(r - 3) * 2 + c - 3]
                                             : 0;
        }
    }
    for (int k = 0; k < 80; k++) {
        tick(&whole, -1);
        tick(&parts, -1);
        assert_near(dse_high_gain_ekf_theta(&whole.filter[0]),
                    dse_high_gain_ekf_theta(&parts.filter[1]), TOLERANCE(1e-10, 1e-2));
        for (int s = 0; s < N; s++) {
            assert_near(dse_high_gain_ekf_picture(&whole.filter[0])[s],
                        dse_high_gain_ekf_picture(&parts.filter[s / 3])[s], TOLERANCE(1e-11, 1e-3));
        }
    }
}

/* The filter equations with a full R, dense and by small Euler steps: K = P C' R^-1. */
static void correlated_outputs_follow_the_filter_equations(void **state)
{
    (void)state;
    static struct run run;
    static const dse_real R[9] = {2, DSE_REAL(0.8),  0, DSE_REAL(0.8), 1, DSE_REAL(-0.3),
                                  0, DSE_REAL(-0.3), 3};
    struct dse_high_gain_ekf_config config = base_config();
    config.whole = true;
    config.gain = DSE_HIGH_GAIN_ONE;
    config.horizon = 0;
    config.R_block = R;
    open_run(&run, &coupled, 3, &config, DSE_REAL(0.5));
    double P[N][N], z[N], inverse[3][3];
    const double det = 2 * (1 * 3 - 0.09) - 0.8 * (0.8 * 3);
    const double adjugate[3][3] = {{2.91, -2.4, -0.24}, {-2.4, 6, 0.6}, {-0.24, 0.6, 1.36}};
    for (int a = 0; a < 3; a++) {
        for (int b = 0; b < 3; b++) {
            inverse[a][b] = adjugate[a][b] / det;
        }
    }
    for (int r = 0; r < N; r++) {
        z[r] = (double)guess[r];
        for (int c = 0; c < N; c++) {
            P[r][c] = (double)run.P0[0][r * N + c];
        }
    }
    const double y[3] = {(double)run.x[0], (double)run.x[2], (double)run.x[3]};
    enum { STEPS = 2000 };
    for (int s = 0; s < STEPS; s++) {
        double dP[N][N], dz[N], K[N][3];
        for (int r = 0; r < N; r++) {
            for (int a = 0; a < 3; a++) {
                K[r][a] = 0;
                for (int b = 0; b < 3; b++) {
                    K[r][a] += P[r][outputs_at[b]] * inverse[b][a];
                }
            }
        }
        for (int r = 0; r < N; r++) {
            dz[r] = 0;
            for (int a = 0; a < 3; a++) {
                dz[r] += K[r][a] * (y[a] - z[outputs_at[a]]);
            }
            for (int c = 0; c < N; c++) {
                dz[r] += (double)coupled.A[r * N + c] * z[c];
                dP[r][c] = (double)run.Q[0][r * N + c];
                for (int m = 0; m < N; m++) {
                    dP[r][c] += (double)coupled.A[r * N + m] * P[m][c] +
                                P[r][m] * (double)coupled.A[c * N + m];
                }
                for (int a = 0; a < 3; a++) {
                    dP[r][c] -= K[r][a] * P[outputs_at[a]][c];
                }
            }
        }
        for (int r = 0; r < N; r++) {
            z[r] += 0.01 / STEPS * dz[r];
            for (int c = 0; c < N; c++) {
                P[r][c] += 0.01 / STEPS * dP[r][c];
            }
        }
    }
    tick(&run, -1);
    for (int r = 0; r < N; r++) {
        assert_near(dse_high_gain_ekf_picture(&run.filter[0])[r], (dse_real)z[r],
                    TOLERANCE(1e-5, 1e-4));
        for (int c = 0; c < N; c++) {
            assert_near(dse_high_gain_ekf_covariance(&run.filter[0])[r * N + c], (dse_real)P[r][c],
                        TOLERANCE(1e-4, 1e-3));
        }
    }
    for (int l = 0; l < OUTPUTS; l++) {
        assert_near(dse_high_gain_ekf_output_error(&run.filter[0])[l],
                    (dse_real)y[l] - guess[outputs_at[l]], 0);
    }
}

/* An output that is missing leaves the filter that never had it: its row and column of R go. */
static void missing_output_is_left_out_of_the_weights(void **state)
{
    (void)state;
    static struct run a, b;
    static const dse_real R[9] = {2, 1, 0, 1, 2, 0, 0, 0, 1},
                          other[9] = {2, 0, 0, 0, 7, 0, 0, 0, 1}; /* differs in output 1 only */
    struct dse_high_gain_ekf_config config = base_config();
    config.whole = true;
    config.R_block = R;
    open_run(&a, &coupled, 3, &config, DSE_REAL(0.5));
    config.R_block = other;
    open_run(&b, &coupled, 3, &config, DSE_REAL(0.5));
    for (int k = 0; k < 5; k++) {
        tick(&a, 1);
        tick(&b, 1);
    }
    assert_memory_equal(dse_high_gain_ekf_picture(&a.filter[0]),
                        dse_high_gain_ekf_picture(&b.filter[0]), N * sizeof(dse_real));
    assert_near(dse_high_gain_ekf_output_error(&a.filter[0])[1], 0, 0);
    assert_int_equal(dse_high_gain_ekf_health(&a.filter[0]), DSE_HEALTH_TRACKING);
    tick(&a, -1);
    tick(&b, -1);
    assert_memory_not_equal(dse_high_gain_ekf_picture(&a.filter[0]),
                            dse_high_gain_ekf_picture(&b.filter[0]), N * sizeof(dse_real));
}

/* ---- the reactors ---- */

/* Section 2.6, AHG-26: one filter of the whole plant converges at least as well as the network. */
static void centralised_filter_of_the_reactors_converges(void **state)
{
    (void)state;
    static dse_real memory[DSE_HIGH_GAIN_EKF_STORAGE(4, 2, 2, 1, 4, 72)];
    const struct dse_plant *plant = dse_plant_find("cstr2");
    dse_real prepared[256], x[4] = {360, 3, 320, DSE_REAL(2.5)}, P0[16], Q[16] = {0};
    const dse_real u[2] = {DSE_REAL(4.998), 0}, x0[4] = {396, DSE_REAL(2.6), 352, DSE_REAL(10.5)};
    struct dse_model model;
    struct dse_normal_form form;
    assert_int_equal(plant->prepare(plant->sets[0].values, prepared), DSE_OK);
    plant->model(prepared, &model);
    plant->normal_form(prepared, &form);
    dse_mat_identity(4, P0);
    Q[0] = Q[10] = 150;
    Q[5] = Q[15] = 5;
    static const enum dse_high_gain_coords coords[] = {DSE_HIGH_GAIN_NORMAL, DSE_HIGH_GAIN_MAPPED};
    dse_real end[2][4];
    for (int c = 0; c < 2; c++) {
        struct dse_high_gain_ekf_config config = {.model = &model,
                                                  .form = &form,
                                                  .whole = true,
                                                  .period = DSE_REAL(1) / 3600,
                                                  .coords = coords[c],
                                                  .x0 = x0,
                                                  .P0 = P0,
                                                  .Q = Q,
                                                  .R = 1,
                                                  .adaptation = {.theta_m = 20,
                                                                 .rise_time = DSE_REAL(0.001),
                                                                 .relaxation = 100,
                                                                 .sharpness = 5,
                                                                 .threshold = 4},
                                                  .horizon = 72};
        struct dse_high_gain_ekf filter;
        struct dse_arena arena;
        dse_real chi[4] = {x[0], x[1], x[2], x[3]}, scratch[DSE_RK4_SCRATCH(4)];
        dse_arena_init(&arena, memory, (int)(sizeof memory / sizeof memory[0]));
        assert_int_equal(dse_high_gain_ekf_init(&filter, &config, &arena), DSE_OK);
        for (int k = 0; k < 900; k++) {
            const dse_real t = (dse_real)k * config.period;
            const dse_real y[2] = {chi[0], chi[2]};
            const struct dse_measurement own = {.y = y};
            assert_int_equal(dse_high_gain_ekf_begin(&filter, k, t, u, &own), DSE_OK);
            assert_int_equal(dse_high_gain_ekf_rounds(&filter), 0);
            assert_int_equal(dse_high_gain_ekf_finish(&filter), DSE_OK);
            assert_int_equal(dse_rk4_model_step(&model, t, config.period, u, chi, scratch), DSE_OK);
        }
        const dse_real *estimate = dse_high_gain_ekf_estimate(&filter);
        assert_int_equal(dse_high_gain_ekf_largest_age(&filter), 0);
        for (int s = 0; s < 4; s++) {
            assert_near(estimate[s], chi[s], DSE_REAL(0.5));
            end[c][s] = estimate[s];
            assert_true(dse_high_gain_ekf_estimate_covariance(&filter)[s * 5] > 0);
        }
    }
    /* for one undivided filter the two coordinates are the same filter, up to the discretisation */
    for (int s = 0; s < 4; s++) {
        assert_near(end[0][s], end[1][s], DSE_REAL(0.05));
    }
}

static void impossible_outputs_are_refused(void **state)
{
    (void)state;
    static struct run run;
    struct dse_high_gain_ekf_config config = base_config();
    static const dse_real indefinite[9] = {1, 2, 0, 2, 1, 0, 0, 0, 1},
                          skew[9] = {1, DSE_REAL(0.1), 0, 0, 1, 0, 0, 0, 1},
                          nan[9] = {(dse_real)NAN, 0, 0, 0, 1, 0, 0, 0, 1};
    config.whole = true;
    config.R = 1;
    open_run(&run, &coupled, 3, &config, 0);
    struct dse_high_gain_ekf filter;
    struct dse_arena arena;
    const struct dse_high_gain_ekf_config good = run.config[0];
#define INIT(change, status)                                                                       \
    do {                                                                                           \
        struct dse_high_gain_ekf_config config_ = good;                                            \
        struct dse_normal_form form_ = run.form;                                                   \
        config_.form = &form_;                                                                     \
        change;                                                                                    \
        dse_arena_init(&arena, run.memory[1], (int)(sizeof run.memory[1] / sizeof(dse_real)));     \
        assert_int_equal(dse_high_gain_ekf_init(&filter, &config_, &arena), status);               \
    } while (0)
    INIT((void)0, DSE_OK);
    INIT(config_.i = 1, DSE_EINVAL);
    INIT(config_.R = 0, DSE_EINVAL);
    INIT(config_.R_block = indefinite, DSE_ENOTPD);
    INIT(config_.R_block = skew, DSE_EINVAL);
    INIT(config_.R_block = nan, DSE_ENONFINITE);
    INIT(form_.push = NULL, DSE_EINVAL);
    INIT(form_.field_jacobian = NULL, DSE_EINVAL);
    INIT(form_.field_jacobian = NULL; config_.coords = DSE_HIGH_GAIN_PHYSICAL, DSE_OK);
    static const int short_chains[3] = {1, 1, 2}, empty[3] = {0, 1, 2}, none[3] = {1, 0, 1};
    INIT(form_.chains = short_chains, DSE_EDIM);
    INIT(form_.chains = empty, DSE_EDIM);
    INIT(form_.n_outputs = none, DSE_EDIM);
    INIT(form_.n_outputs = two_counts, DSE_EDIM); /* two outputs without chains */
#undef INIT
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(chains_shift_by_one_power_of_theta),
        cmocka_unit_test(full_weights_of_several_chains_satisfy_the_scaling_identities),
        cmocka_unit_test(centralised_filter_is_the_one_block_with_all_chains),
        cmocka_unit_test(uncoupled_subsystems_estimate_as_the_centralised_filter),
        cmocka_unit_test(correlated_outputs_follow_the_filter_equations),
        cmocka_unit_test(missing_output_is_left_out_of_the_weights),
        cmocka_unit_test(centralised_filter_of_the_reactors_converges),
        cmocka_unit_test(impossible_outputs_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
