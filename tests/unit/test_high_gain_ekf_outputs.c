/* Adaptive high-gain EKF with several outputs per filter, and the centralised one (eq 3.6). */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "dse/high_gain_ekf.h"
#include "dse/linalg.h"
#include "dse/ode.h"
#include "dse/plant.h"
#include "high_gain_rig.h"
#include "near.h"

/* The linear plant without coupling between {2, 1} and {2}. */
/* clang-format off */
static const struct linear halves = {.A = {0,  1,  0,  0,  0,
                                           -8, -4, 1,  0,  0,
                                           1,  0,  -3, 0,  0,
                                           0,  0,  0,  0,  1,
                                           0,  0,  0,  -9, -5}};
/* clang-format on */

struct run {
    struct dse_model model;
    struct dse_normal_form form;
    struct dse_high_gain_ekf_config config[2];
    struct dse_high_gain_ekf filter[2];
    dse_real memory[2]
                   [DSE_HIGH_GAIN_EKF_STORAGE(LINEAR_N, 0, LINEAR_P, 3, LINEAR_N, LINEAR_HORIZON)];
    dse_real P0[2][LINEAR_N * LINEAR_N], Q[2][LINEAR_N * LINEAR_N], R[LINEAR_P * LINEAR_P];
    dse_real x[LINEAR_N];
    int filters;
    int64_t k;
};

static const dse_real guess[LINEAR_N] = {3, 1, 1, -1, 0};

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
    linear_plant(linear, p, &run->model, &run->form);
    for (int i = 0, offset = 0; i < run->filters; offset += run->form.n_i[i++]) {
        struct dse_arena arena;
        struct dse_high_gain_ekf_config *own = &run->config[i];
        const int n_i = config->whole ? LINEAR_N : run->form.n_i[i];
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
static void step(struct run *run, int missing)
{
    dse_real y[LINEAR_P], scratch[DSE_RK4_SCRATCH(LINEAR_N)];
    dse_real message[2][DSE_HIGH_GAIN_EKF_MESSAGE(LINEAR_N)];
    bool valid[LINEAR_P];
    int count[2] = {0};
    const dse_real t = (dse_real)run->k * run->config[0].period;
    assert_int_equal(run->model.h(&run->model, t, run->x, NULL, y), DSE_OK);
    for (int i = 0, first = 0; i < run->filters; first += run->filter[i++].m) {
        const struct dse_measurement own = {.y = y + first, .valid = valid + first};
        for (int l = 0; l < LINEAR_P; l++) {
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
        struct dse_high_gain_ekf_config config = linear_config();
        config.R = 1;
        config.coords = (enum dse_high_gain_coords)c;
        open_run(&block, &coupled, 1, &config, DSE_REAL(0.5));
        config.whole = true;
        open_run(&whole, &coupled, 3, &config, DSE_REAL(0.5));
        for (int k = 0; k < 60; k++) {
            step(&whole, k % 7 == 3 ? 1 : -1);
            step(&block, k % 7 == 3 ? 1 : -1);
            assert_memory_equal(dse_high_gain_ekf_picture(&whole.filter[0]),
                                dse_high_gain_ekf_picture(&block.filter[0]),
                                LINEAR_N * sizeof(dse_real));
            assert_memory_equal(dse_high_gain_ekf_covariance(&whole.filter[0]),
                                dse_high_gain_ekf_covariance(&block.filter[0]),
                                LINEAR_N * LINEAR_N * sizeof(dse_real));
        }
        assert_true(dse_high_gain_ekf_theta(&whole.filter[0]) > 1);
        for (int s = 0; s < LINEAR_N; s++) {
            assert_near(dse_high_gain_ekf_picture(&whole.filter[0])[s], whole.x[s], DSE_REAL(0.35));
        }
    }
}

/* Without coupling there is nothing to be gained from knowing all. */
static void uncoupled_subsystems_estimate_as_the_centralised_filter(void **state)
{
    (void)state;
    static struct run whole, parts;
    struct dse_high_gain_ekf_config config = linear_config();
    config.R = 2;
    open_run(&parts, &halves, 2, &config, 0);
    config.whole = true;
    open_run(&whole, &halves, 2, &config, 0);
    for (int r = 0; r < LINEAR_N; r++) { /* the weights of the whole are those of the parts */
        for (int c = 0; c < LINEAR_N; c++) {
            const bool first = r < 3 && c < 3, second = r >= 3 && c >= 3;
            whole.filter[0].P[r * LINEAR_N + c] = first    ? parts.P0[0][r * 3 + c]
                                                  : second ? parts.P0[1][(r - 3) * 2 + c - 3]
                                                           : 0;
            whole.Q[0][r * LINEAR_N + c] = first    ? parts.Q[0][r * 3 + c]
                                           : second ? parts.Q[1][(r - 3) * 2 + c - 3]
                                                    : 0;
        }
    }
    for (int k = 0; k < 80; k++) {
        step(&whole, -1);
        step(&parts, -1);
        assert_near(dse_high_gain_ekf_theta(&whole.filter[0]),
                    dse_high_gain_ekf_theta(&parts.filter[1]), TOLERANCE(1e-10, 1e-2));
        for (int s = 0; s < LINEAR_N; s++) {
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
    struct dse_high_gain_ekf_config config = linear_config();
    config.whole = true;
    config.gain = DSE_HIGH_GAIN_ONE;
    config.horizon = 0;
    config.R_block = R;
    open_run(&run, &coupled, 3, &config, DSE_REAL(0.5));
    double P[LINEAR_N][LINEAR_N], z[LINEAR_N], inverse[3][3];
    const double det = 2 * (1 * 3 - 0.09) - 0.8 * (0.8 * 3);
    const double adjugate[3][3] = {{2.91, -2.4, -0.24}, {-2.4, 6, 0.6}, {-0.24, 0.6, 1.36}};
    for (int a = 0; a < 3; a++) {
        for (int b = 0; b < 3; b++) {
            inverse[a][b] = adjugate[a][b] / det;
        }
    }
    for (int r = 0; r < LINEAR_N; r++) {
        z[r] = (double)guess[r];
        for (int c = 0; c < LINEAR_N; c++) {
            P[r][c] = (double)run.P0[0][r * LINEAR_N + c];
        }
    }
    const double y[3] = {(double)run.x[0], (double)run.x[2], (double)run.x[3]};
    enum { STEPS = 2000 };
    for (int s = 0; s < STEPS; s++) {
        double dP[LINEAR_N][LINEAR_N], dz[LINEAR_N], K[LINEAR_N][3];
        for (int r = 0; r < LINEAR_N; r++) {
            for (int a = 0; a < 3; a++) {
                K[r][a] = 0;
                for (int b = 0; b < 3; b++) {
                    K[r][a] += P[r][linear_outputs[b]] * inverse[b][a];
                }
            }
        }
        for (int r = 0; r < LINEAR_N; r++) {
            dz[r] = 0;
            for (int a = 0; a < 3; a++) {
                dz[r] += K[r][a] * (y[a] - z[linear_outputs[a]]);
            }
            for (int c = 0; c < LINEAR_N; c++) {
                dz[r] += (double)coupled.A[r * LINEAR_N + c] * z[c];
                dP[r][c] = (double)run.Q[0][r * LINEAR_N + c];
                for (int m = 0; m < LINEAR_N; m++) {
                    dP[r][c] += (double)coupled.A[r * LINEAR_N + m] * P[m][c] +
                                P[r][m] * (double)coupled.A[c * LINEAR_N + m];
                }
                for (int a = 0; a < 3; a++) {
                    dP[r][c] -= K[r][a] * P[linear_outputs[a]][c];
                }
            }
        }
        for (int r = 0; r < LINEAR_N; r++) {
            z[r] += 0.01 / STEPS * dz[r];
            for (int c = 0; c < LINEAR_N; c++) {
                P[r][c] += 0.01 / STEPS * dP[r][c];
            }
        }
    }
    step(&run, -1);
    for (int r = 0; r < LINEAR_N; r++) {
        assert_near(dse_high_gain_ekf_picture(&run.filter[0])[r], (dse_real)z[r],
                    TOLERANCE(1e-5, 1e-4));
        for (int c = 0; c < LINEAR_N; c++) {
            assert_near(dse_high_gain_ekf_covariance(&run.filter[0])[r * LINEAR_N + c],
                        (dse_real)P[r][c], TOLERANCE(1e-4, 1e-3));
        }
    }
    for (int l = 0; l < LINEAR_P; l++) {
        assert_near(dse_high_gain_ekf_output_error(&run.filter[0])[l],
                    (dse_real)y[l] - guess[linear_outputs[l]], 0);
    }
}

/* An output that is missing leaves the filter that never had it: its row and column of R go. */
static void missing_output_is_left_out_of_the_weights(void **state)
{
    (void)state;
    static struct run a, b;
    static const dse_real R[9] = {2, 1, 0, 1, 2, 0, 0, 0, 1},
                          other[9] = {2, 0, 0, 0, 7, 0, 0, 0, 1}; /* differs in output 1 only */
    struct dse_high_gain_ekf_config config = linear_config();
    config.whole = true;
    config.R_block = R;
    open_run(&a, &coupled, 3, &config, DSE_REAL(0.5));
    config.R_block = other;
    open_run(&b, &coupled, 3, &config, DSE_REAL(0.5));
    for (int k = 0; k < 5; k++) {
        step(&a, 1);
        step(&b, 1);
    }
    assert_memory_equal(dse_high_gain_ekf_picture(&a.filter[0]),
                        dse_high_gain_ekf_picture(&b.filter[0]), LINEAR_N * sizeof(dse_real));
    assert_near(dse_high_gain_ekf_output_error(&a.filter[0])[1], 0, 0);
    assert_int_equal(dse_high_gain_ekf_health(&a.filter[0]), DSE_HEALTH_TRACKING);
    step(&a, -1);
    step(&b, -1);
    assert_memory_not_equal(dse_high_gain_ekf_picture(&a.filter[0]),
                            dse_high_gain_ekf_picture(&b.filter[0]), LINEAR_N * sizeof(dse_real));
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
    struct dse_high_gain_ekf_config config = linear_config();
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
    static const int two_counts[2] = {2, 1};
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
        cmocka_unit_test(centralised_filter_is_the_one_block_with_all_chains),
        cmocka_unit_test(uncoupled_subsystems_estimate_as_the_centralised_filter),
        cmocka_unit_test(correlated_outputs_follow_the_filter_equations),
        cmocka_unit_test(missing_output_is_left_out_of_the_weights),
        cmocka_unit_test(centralised_filter_of_the_reactors_converges),
        cmocka_unit_test(impossible_outputs_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
