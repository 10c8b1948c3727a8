/* The extended Kalman filter: equations, continuous prediction, trouble with data and models. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "dense_filter.h"
#include "dse/ekf.h"
#include "dse/linalg.h"
#include "dse/math.h"
#include "near.h"
#include "random_matrix.h"

#define EPS      DSE_REAL_EPSILON
#define NAN_REAL ((dse_real)__builtin_nan(""))
#define INF_REAL ((dse_real)__builtin_inf())

static dse_real memory[DSE_EKF_STORAGE_CONTINUOUS(4, 3)];

/* ---- a pendulum that can be told to misbehave; outputs sin(angle), angle^2, rate ---- */

enum trouble { NONE, FAIL, NOT_FINITE };

struct faults {
    enum trouble f, dfdx, h, dhdx;
};

static enum dse_status misbehave(enum trouble trouble, int n, dse_real *out)
{
    if (trouble == NOT_FINITE)
        out[n - 1] = INF_REAL;
    return trouble == FAIL ? DSE_EMODEL : DSE_OK;
}

#define STEP DSE_REAL(0.1) /* of the discrete model */

static enum dse_status pendulum_f(const struct dse_model *model, dse_real t, const dse_real *x,
                                  const dse_real *u, dse_real *dx)
{
    const struct faults *faults = model->parameters;
    const bool discrete = model->time == DSE_DISCRETE;
    const dse_real rate = x[1], acceleration = -4 * dse_sin(x[0]) - DSE_REAL(0.2) * x[1] + u[0];
    (void)t;
    dx[0] = discrete ? x[0] + STEP * rate : rate;
    dx[1] = discrete ? x[1] + STEP * acceleration : acceleration;
    return misbehave(faults->f, 2, dx);
}

static enum dse_status pendulum_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                     const dse_real *u, dse_real *F)
{
    const struct faults *faults = model->parameters;
    const bool discrete = model->time == DSE_DISCRETE;
    (void)t;
    (void)u;
    F[0] = discrete ? 1 : 0;
    F[1] = discrete ? STEP : 1;
    F[2] = discrete ? -4 * STEP * dse_cos(x[0]) : -4 * dse_cos(x[0]);
    F[3] = discrete ? 1 - DSE_REAL(0.2) * STEP : -DSE_REAL(0.2);
    return misbehave(faults->dfdx, 4, F);
}

static enum dse_status pendulum_h(const struct dse_model *model, dse_real t, const dse_real *x,
                                  const dse_real *u, dse_real *y)
{
    const struct faults *faults = model->parameters;
    (void)t;
    (void)u;
    y[0] = dse_sin(x[0]);
    y[1] = x[0] * x[0];
    y[2] = x[1];
    return misbehave(faults->h, 3, y);
}

static enum dse_status pendulum_dhdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                     const dse_real *u, dse_real *H)
{
    const struct faults *faults = model->parameters;
    (void)t;
    (void)u;
    H[0] = dse_cos(x[0]);
    H[1] = 0;
    H[2] = 2 * x[0];
    H[3] = 0;
    H[4] = 0;
    H[5] = 1;
    return misbehave(faults->dhdx, 6, H);
}

static struct faults faults;
static struct dse_model pendulum;
static const dse_real Q[4] = {DSE_REAL(1e-4), 0, 0, DSE_REAL(1e-3)};
static const dse_real R[9] = {
    DSE_REAL(0.04), DSE_REAL(0.01), 0, DSE_REAL(0.01), DSE_REAL(0.09), 0, 0, 0, DSE_REAL(0.25)};
static const dse_real P0[4] = {DSE_REAL(0.5), DSE_REAL(0.1), DSE_REAL(0.1), DSE_REAL(0.5)};
static const dse_real x0[2] = {DSE_REAL(0.8), DSE_REAL(-0.3)};
static const dse_real no_input[1] = {0};

static struct dse_ekf_config pendulum_config(enum dse_time_kind time)
{
    faults = (struct faults){NONE, NONE, NONE, NONE};
    pendulum = (struct dse_model){.time = time,
                                  .nx = 2,
                                  .nu = 1,
                                  .ny = 3,
                                  .parameters = &faults,
                                  .f = pendulum_f,
                                  .h = pendulum_h,
                                  .dfdx = pendulum_dfdx,
                                  .dhdx = pendulum_dhdx};
    return (struct dse_ekf_config){.model = &pendulum, .x0 = x0, .P0 = P0, .Q = Q, .R = R};
}

static enum dse_status start(struct dse_ekf *ekf, const struct dse_ekf_config *config)
{
    struct dse_arena arena;
    dse_arena_init(&arena, memory, (int)(sizeof memory / sizeof memory[0]));
    return dse_ekf_init(ekf, config, &arena);
}

static void sequential_updates_equal_one_batch_update(void **state)
{
    (void)state;
    const struct dse_ekf_config config = pendulum_config(DSE_DISCRETE);
    struct dse_ekf ekf;
    assert_int_equal(start(&ekf, &config), DSE_OK);
    dse_real x[2] = {x0[0], x0[1]}, P[4], F[4], H[6], next[2], result[4];
    for (int i = 0; i < 4; i++)
        P[i] = P0[i];
    for (int k = 1; k <= 200; k++) {
        const dse_real u = uniform(), y[3] = {uniform(), 2 + uniform(), uniform()};
        dse_real predicted[3], e[3];
        const struct dse_measurement measurement = {y, NULL};
        assert_int_equal(dse_ekf_predict(&ekf, (dse_real)k, &u), DSE_OK);
        (void)pendulum_f(&pendulum, 0, x, &u, next);
        (void)pendulum_dfdx(&pendulum, 0, x, &u, F);
        dense_predict(2, F, Q, P);
        (void)pendulum_h(&pendulum, 0, next, &u, predicted);
        (void)pendulum_dhdx(&pendulum, 0, next, &u, H);
        for (int j = 0; j < 3; j++)
            e[j] = y[j] - predicted[j];
        for (int i = 0; i < 2; i++)
            x[i] = next[i];
        assert_all_near(2, dse_ekf_state(&ekf), x, 1000 * EPS);
        const dse_real nis = dense_update(2, 3, H, R, e, x, P);
        assert_int_equal(dse_ekf_update(&ekf, (dse_real)k, &u, &measurement), DSE_OK);
        assert_all_near(2, dse_ekf_state(&ekf), x, 1000 * EPS);
        assert_all_near(3, dse_ekf_innovation(&ekf), e, 2000 * EPS);
        assert_all_near(1, &(dse_real){dse_ekf_nis(&ekf)}, &nis, 2000 * EPS * (1 + nis));
        dse_ekf_covariance(&ekf, result);
        assert_all_near(4, result, P, 1000 * EPS);
        for (int i = 0; i < 2; i++) /* both go on from the same point */
            x[i] = dse_ekf_state(&ekf)[i];
        dse_ekf_covariance(&ekf, P);
    }
}

/* ---- prediction in continuous time ---- */

static const dse_real A[9] = {DSE_REAL(-0.5), 1, 0, -2, DSE_REAL(-0.3), 1, 0, 0, -1};
static const dse_real B[3] = {0, 1, 2};
static const dse_real intensity[9] = {DSE_REAL(0.2), 0, 0, 0, DSE_REAL(0.5), DSE_REAL(0.1), 0,
                                      DSE_REAL(0.1), 1};
static const dse_real prior[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};

/* Deviation of mean and covariance after 1 time unit from the exact discretisation. */
static void linear_error(int panels, dse_real max_panel, dse_real *mean, dse_real *covariance)
{
    const struct dse_linear linear = {A, B, NULL, NULL};
    const dse_real start_state[3] = {1, -1, 2}, u = DSE_REAL(0.7);
    struct dse_model model;
    struct dse_ekf ekf;
    dse_linear_model(&model, DSE_CONTINUOUS, 3, 1, 0, &linear);
    const struct dse_ekf_config config = {.model = &model,
                                          .x0 = start_state,
                                          .P0 = prior,
                                          .Q = intensity,
                                          .panels = panels,
                                          .max_panel = max_panel};
    assert_int_equal(start(&ekf, &config), DSE_OK);
    assert_int_equal(dse_ekf_predict(&ekf, 1, &u), DSE_OK);

    dse_real Ad[9], Bd[3], Qd[9], x[3], P[9], result[9];
    dse_real scratch[DSE_VAN_LOAN_SCRATCH(3) + DSE_DISCRETISE_SCRATCH(3, 1)];
    assert_int_equal(dse_van_loan(3, A, intensity, 1, Ad, Qd, scratch), DSE_OK);
    assert_int_equal(dse_discretise(3, 1, A, B, 1, Ad, Bd, scratch), DSE_OK);
    dse_mat_vec(3, 3, Ad, start_state, x);
    dse_axpy(3, u, Bd, x);
    for (int i = 0; i < 9; i++)
        P[i] = prior[i];
    dense_predict(3, Ad, Qd, P);
    dse_ekf_covariance(&ekf, result);
    dse_axpy(9, -1, P, result);
    dse_axpy(3, -1, dse_ekf_state(&ekf), x);
    *mean = dse_norm_max(3, x);
    *covariance = dse_norm_max(9, result);
}

static void continuous_prediction_converges_to_the_exact_discretisation(void **state)
{
    (void)state;
    dse_real mean, covariance, finer_mean, finer_covariance;
    linear_error(4, 0, &mean, &covariance);
    linear_error(8, 0, &finer_mean, &finer_covariance);
    assert_true(mean < DSE_REAL(2e-4) && covariance < DSE_REAL(2e-3));
    assert_true(mean / finer_mean > 13);            /* order 4: 16 */
    assert_true(covariance / finer_covariance > 6); /* order 3: 8 */
    linear_error(200, 0, &mean, &covariance);
    const dse_real floor = 2000 * EPS;
    assert_true(mean < DSE_REAL(1e-10) + floor && covariance < DSE_REAL(1e-7) + floor);
}

static void longest_panel_bounds_the_step_of_a_long_prediction(void **state)
{
    (void)state;
    dse_real mean, covariance, same_mean, same_covariance;
    linear_error(8, 0, &mean, &covariance);
    linear_error(0, DSE_REAL(0.125), &same_mean, &same_covariance); /* 8 panels, not 9 */
    assert_true(mean == same_mean && covariance == same_covariance);
    linear_error(0, DSE_REAL(0.13), &same_mean, &same_covariance); /* rounds up to 8 */
    assert_true(mean == same_mean && covariance == same_covariance);
    linear_error(8, 1, &same_mean, &same_covariance);
    assert_true(mean == same_mean && covariance == same_covariance);
}

static void continuous_prediction_stays_definite_where_the_step_is_far_too_long(void **state)
{
    (void)state;
    const dse_real stiff[4] = {-10, 0, 3, -1}, none[4] = {0, 0, 0, 0};
    const struct dse_linear linear = {stiff, NULL, NULL, NULL};
    const dse_real P[4] = {1, DSE_REAL(0.999), DSE_REAL(0.999), 1};
    struct dse_model model;
    struct dse_ekf ekf;
    dse_real variance[2];
    dse_linear_model(&model, DSE_CONTINUOUS, 2, 0, 0, &linear);
    const struct dse_ekf_config config = {.model = &model, .P0 = P, .Q = none};
    assert_int_equal(start(&ekf, &config), DSE_OK);
    for (int k = 1; k <= 5; k++) {
        assert_int_equal(dse_ekf_predict(&ekf, (dse_real)k, NULL), DSE_OK);
        dse_ekf_variance(&ekf, variance);
        assert_true(ekf.d[0] >= 0 && ekf.d[1] >= 0 && variance[0] > 0 && variance[1] > 0);
    }
}

static void continuous_prediction_to_the_present_changes_nothing(void **state)
{
    (void)state;
    const struct dse_ekf_config config = pendulum_config(DSE_CONTINUOUS);
    struct dse_ekf ekf;
    dse_real before[4], after[4];
    assert_int_equal(start(&ekf, &config), DSE_OK);
    assert_int_equal(dse_ekf_predict(&ekf, 1, no_input), DSE_OK);
    dse_ekf_covariance(&ekf, before);
    assert_int_equal(dse_ekf_predict(&ekf, 1, no_input), DSE_OK);
    dse_ekf_covariance(&ekf, after);
    assert_all_near(4, before, after, 0);
    assert_int_equal(dse_ekf_predict(&ekf, DSE_REAL(0.5), no_input), DSE_EINVAL);
    assert_int_equal(dse_ekf_predict(&ekf, NAN_REAL, no_input), DSE_EINVAL);
    assert_true(dse_ekf_time(&ekf) == 1);
}

/* ---- data as in life ---- */

static void missing_and_non_finite_channels_are_left_out_and_counted(void **state)
{
    (void)state;
    const struct dse_ekf_config config = pendulum_config(DSE_DISCRETE);
    struct dse_ekf ekf, other;
    const dse_real y[3] = {NAN_REAL, 5, DSE_REAL(0.1)}, infinite[3] = {INF_REAL, 5, DSE_REAL(0.1)};
    const bool flagged[3] = {true, false, true}, both[3] = {false, false, true};
    const struct dse_measurement spoiled = {y, flagged}, clean = {y, both};
    const struct dse_measurement unflagged = {infinite, flagged};
    assert_int_equal(start(&ekf, &config), DSE_OK);
    assert_int_equal(dse_ekf_health(&ekf), DSE_HEALTH_INITIALISING);
    assert_int_equal(dse_ekf_update(&ekf, 0, no_input, &spoiled), DSE_OK);
    assert_int_equal(dse_ekf_channel(&ekf, 0), DSE_CHANNEL_NONFINITE);
    assert_int_equal(dse_ekf_channel(&ekf, 1), DSE_CHANNEL_MISSING);
    assert_int_equal(dse_ekf_channel(&ekf, 2), DSE_CHANNEL_USED);
    assert_int_equal(dse_ekf_used(&ekf), 1);
    assert_true(dse_ekf_innovation(&ekf)[0] == 0 && dse_ekf_innovation(&ekf)[1] == 0);
    assert_int_equal(dse_ekf_health(&ekf), DSE_HEALTH_TRACKING);
    assert_int_equal(dse_ekf_counts(&ekf)->nonfinite, 1);
    assert_int_equal(dse_ekf_counts(&ekf)->missing, 1);
    assert_int_equal(dse_ekf_counts(&ekf)->used, 1);
    const dse_real x[2] = {dse_ekf_state(&ekf)[0], dse_ekf_state(&ekf)[1]};
    assert_int_equal(start(&other, &config), DSE_OK);
    assert_int_equal(dse_ekf_update(&other, 0, no_input, &clean), DSE_OK);
    assert_all_near(2, dse_ekf_state(&other), x, 0);
    assert_int_equal(start(&other, &config), DSE_OK);
    assert_int_equal(dse_ekf_update(&other, 0, no_input, &unflagged), DSE_OK);
    assert_all_near(2, dse_ekf_state(&other), x, 0);
}

static void without_data_the_filter_coasts_and_its_uncertainty_grows(void **state)
{
    (void)state;
    const struct dse_ekf_config config = pendulum_config(DSE_DISCRETE);
    struct dse_ekf ekf;
    const dse_real y[3] = {DSE_REAL(0.7), DSE_REAL(0.6), 0};
    const bool none[3] = {false, false, false};
    const struct dse_measurement data = {y, NULL}, nothing = {y, none};
    assert_int_equal(start(&ekf, &config), DSE_OK);
    assert_int_equal(dse_ekf_update(&ekf, 0, no_input, &nothing), DSE_OK);
    assert_int_equal(dse_ekf_health(&ekf), DSE_HEALTH_INITIALISING);
    for (int k = 1; k < 100; k++) {
        assert_int_equal(dse_ekf_predict(&ekf, (dse_real)k, no_input), DSE_OK);
        assert_int_equal(dse_ekf_update(&ekf, (dse_real)k, no_input, &data), DSE_OK);
        assert_int_equal(dse_ekf_health(&ekf), DSE_HEALTH_TRACKING);
    }
    dse_real settled[2], variance[2], x[2];
    dse_ekf_variance(&ekf, settled);
    for (int k = 100; k < 110; k++) {
        assert_int_equal(dse_ekf_predict(&ekf, (dse_real)k, no_input), DSE_OK);
        x[0] = dse_ekf_state(&ekf)[0];
        x[1] = dse_ekf_state(&ekf)[1];
        assert_int_equal(dse_ekf_update(&ekf, (dse_real)k, no_input, &nothing), DSE_OK);
        assert_all_near(2, dse_ekf_state(&ekf), x, 0);
        assert_int_equal(dse_ekf_health(&ekf), DSE_HEALTH_COASTING);
        assert_int_equal(dse_ekf_used(&ekf), 0);
        assert_true(dse_ekf_nis(&ekf) == 0);
    }
    dse_ekf_variance(&ekf, variance);
    assert_true(variance[0] > settled[0] && variance[1] > settled[1]);
    assert_int_equal(dse_ekf_predict(&ekf, 110, no_input), DSE_OK);
    assert_int_equal(dse_ekf_update(&ekf, 110, no_input, &data), DSE_OK);
    assert_int_equal(dse_ekf_health(&ekf), DSE_HEALTH_TRACKING);
    assert_int_equal(dse_ekf_predict(&ekf, 111, no_input), DSE_OK);
    assert_int_equal(dse_ekf_health(&ekf), DSE_HEALTH_TRACKING);
    assert_int_equal(dse_ekf_predict(&ekf, 112, no_input), DSE_OK);
    assert_int_equal(dse_ekf_health(&ekf), DSE_HEALTH_COASTING);
}

/* An outlier in each channel in turn, just inside and just outside of the gate. */
static void gate_rejects_a_channel_beyond_its_own_standard_deviation(void **state)
{
    (void)state;
    struct dse_ekf_config config = pendulum_config(DSE_DISCRETE);
    config.gate = 4;
    dse_real predicted[3], H[6], HP[6], S[9];
    (void)pendulum_h(&pendulum, 0, x0, no_input, predicted);
    (void)pendulum_dhdx(&pendulum, 0, x0, no_input, H);
    dense_product(3, 2, 2, H, P0, 0, HP);
    dense_product(3, 2, 3, HP, H, 1, S);
    for (int j = 0; j < 3; j++) {
        for (int outside = 0; outside < 2; outside++) {
            struct dse_ekf ekf;
            dse_real y[3] = {predicted[0], predicted[1], predicted[2]};
            const dse_real deviation = (dse_real)sqrt((double)(S[j * 3 + j] + R[j * 3 + j]));
            y[j] -= (outside ? DSE_REAL(4.001) : DSE_REAL(3.999)) * deviation;
            const struct dse_measurement measurement = {y, NULL};
            assert_int_equal(start(&ekf, &config), DSE_OK);
            assert_int_equal(dse_ekf_update(&ekf, 0, no_input, &measurement), DSE_OK);
            assert_int_equal(dse_ekf_channel(&ekf, j),
                             outside ? DSE_CHANNEL_REJECTED : DSE_CHANNEL_USED);
            assert_int_equal(dse_ekf_used(&ekf), outside ? 2 : 3);
            assert_int_equal(dse_ekf_counts(&ekf)->rejected, outside);
            assert_int_equal(dse_ekf_health(&ekf),
                             outside ? DSE_HEALTH_REJECTING : DSE_HEALTH_TRACKING);
            assert_true(dse_ekf_innovation(&ekf)[j] != 0); /* still shown */
            if (outside) /* the rest agrees with the prediction: no correction */
                assert_all_near(2, dse_ekf_state(&ekf), x0, 100 * EPS);
        }
    }
}

static void an_update_at_another_time_is_refused(void **state)
{
    (void)state;
    const struct dse_ekf_config config = pendulum_config(DSE_DISCRETE);
    struct dse_ekf ekf;
    const dse_real y[3] = {0, 0, 0};
    const struct dse_measurement measurement = {y, NULL};
    assert_int_equal(start(&ekf, &config), DSE_OK);
    assert_int_equal(dse_ekf_update(&ekf, 1, no_input, &measurement), DSE_EINVAL);
    assert_all_near(2, dse_ekf_state(&ekf), x0, 0);
}

/* ---- failures ---- */

static void a_failed_step_leaves_the_estimate_as_it_was(void **state)
{
    (void)state;
    const dse_real y[3] = {DSE_REAL(0.7), DSE_REAL(0.6), 0};
    const struct dse_measurement data = {y, NULL};
    for (int c = 0; c < 16; c++) {
        const struct dse_ekf_config config = pendulum_config(c & 8 ? DSE_CONTINUOUS : DSE_DISCRETE);
        const enum trouble trouble = c & 4 ? FAIL : NOT_FINITE;
        const enum dse_status expected = c & 4 ? DSE_EMODEL : DSE_ENONFINITE;
        struct dse_ekf ekf;
        dse_real x[2], P[4], after[4];
        assert_int_equal(start(&ekf, &config), DSE_OK);
        assert_int_equal(dse_ekf_predict(&ekf, 1, no_input), DSE_OK);
        assert_int_equal(dse_ekf_update(&ekf, 1, no_input, &data), DSE_OK);
        x[0] = dse_ekf_state(&ekf)[0];
        x[1] = dse_ekf_state(&ekf)[1];
        dse_ekf_covariance(&ekf, P);

        faults = (struct faults){c % 4 == 0 ? trouble : NONE, c % 4 == 1 ? trouble : NONE,
                                 c % 4 == 2 ? trouble : NONE, c % 4 == 3 ? trouble : NONE};
        if (c % 4 < 2)
            assert_int_equal(dse_ekf_predict(&ekf, 2, no_input), expected);
        else
            assert_int_equal(dse_ekf_update(&ekf, 1, no_input, &data), expected);
        assert_int_equal(dse_ekf_health(&ekf), DSE_HEALTH_DIVERGED);
        assert_int_equal(dse_ekf_counts(&ekf)->failed, 1);
        assert_true(dse_ekf_time(&ekf) == 1);
        assert_all_near(2, dse_ekf_state(&ekf), x, 0);
        dse_ekf_covariance(&ekf, after);
        assert_all_near(4, after, P, 0);

        faults = (struct faults){NONE, NONE, NONE, NONE}; /* and it can go on from there */
        assert_int_equal(dse_ekf_predict(&ekf, 2, no_input), DSE_OK);
        assert_int_equal(dse_ekf_health(&ekf), DSE_HEALTH_COASTING);
        assert_int_equal(dse_ekf_update(&ekf, 2, no_input, &data), DSE_OK);
        assert_int_equal(dse_ekf_health(&ekf), DSE_HEALTH_TRACKING);
    }
}

static void setting_the_estimate_starts_anew_or_changes_nothing(void **state)
{
    (void)state;
    const struct dse_ekf_config config = pendulum_config(DSE_DISCRETE);
    struct dse_ekf ekf;
    const dse_real x[2] = {3, 4}, spoiled[2] = {0, NAN_REAL}, P[4] = {4, 1, 1, 2};
    const dse_real indefinite[4] = {1, 3, 3, 1};
    dse_real result[4];
    assert_int_equal(start(&ekf, &config), DSE_OK);
    assert_int_equal(dse_ekf_set(&ekf, 7, x, indefinite), DSE_ENOTPD);
    assert_int_equal(dse_ekf_set(&ekf, 7, spoiled, P), DSE_ENONFINITE);
    assert_int_equal(dse_ekf_set(&ekf, INF_REAL, x, P), DSE_ENONFINITE);
    assert_all_near(2, dse_ekf_state(&ekf), x0, 0);
    dse_ekf_covariance(&ekf, result);
    assert_all_near(4, result, P0, 4 * EPS);
    assert_int_equal(dse_ekf_set(&ekf, 7, x, P), DSE_OK);
    assert_all_near(2, dse_ekf_state(&ekf), x, 0);
    dse_ekf_covariance(&ekf, result);
    assert_all_near(4, result, P, 8 * EPS);
    assert_true(dse_ekf_time(&ekf) == 7);
}

static void a_model_without_what_the_filter_needs_is_refused(void **state)
{
    (void)state;
    struct dse_ekf ekf;
    for (int c = 0; c < 9; c++) {
        struct dse_ekf_config config = pendulum_config(DSE_CONTINUOUS);
        pendulum.f = c == 0 ? NULL : pendulum.f;
        pendulum.dfdx = c == 1 ? NULL : pendulum.dfdx;
        pendulum.h = c == 2 ? NULL : pendulum.h;
        pendulum.dhdx = c == 3 ? NULL : pendulum.dhdx;
        config.panels = c == 4 ? -1 : 0;
        config.max_panel = c == 5 ? -1 : 0;
        config.gate = c == 6 ? -1 : 0;
        config.model = c == 7 ? NULL : config.model;
        config.t0 = c == 8 ? NAN_REAL : 0;
        assert_int_equal(start(&ekf, &config), c == 8 ? DSE_ENONFINITE : DSE_EINVAL);
    }
}

/* A simulated pendulum: the filter, started far off, must come close to what its own covariance
 * promises, and far below the error of prediction alone. */
static void error_of_a_nonlinear_plant_matches_the_own_covariance(void **state)
{
    (void)state;
    const struct dse_ekf_config config = pendulum_config(DSE_DISCRETE);
    struct dse_ekf ekf;
    double error = 0, promised = 0, open_loop = 0;
    for (int run = 0; run < 50; run++) {
        assert_int_equal(start(&ekf, &config), DSE_OK);
        dse_real x[2], blind[2] = {x0[0], x0[1]}, y[3], next[2], variance[2];
        x[1] = x0[1] + DSE_REAL(0.7) * normal();
        x[0] = x0[0] + DSE_REAL(0.5) * normal();
        for (int k = 1; k <= 200; k++) {
            const dse_real u = dse_sin(DSE_REAL(0.05) * (dse_real)k);
            (void)pendulum_f(&pendulum, 0, x, &u, next);
            x[0] = next[0] + DSE_REAL(0.01) * normal();
            x[1] = next[1] + DSE_REAL(0.0316) * normal();
            (void)pendulum_f(&pendulum, 0, blind, &u, next);
            blind[0] = next[0];
            blind[1] = next[1];
            (void)pendulum_h(&pendulum, 0, x, &u, y);
            const dse_real common = normal(); /* correlated noise: R = L L' */
            y[0] += DSE_REAL(0.2) * common;
            y[1] += DSE_REAL(0.05) * common + DSE_REAL(0.29580398915498) * normal();
            y[2] += DSE_REAL(0.5) * normal();
            const struct dse_measurement measurement = {y, NULL};
            assert_int_equal(dse_ekf_predict(&ekf, (dse_real)k, &u), DSE_OK);
            assert_int_equal(dse_ekf_update(&ekf, (dse_real)k, &u, &measurement), DSE_OK);
            if (k <= 100)
                continue;
            dse_ekf_variance(&ekf, variance);
            for (int i = 0; i < 2; i++) {
                const double e = (double)(dse_ekf_state(&ekf)[i] - x[i]);
                const double b = (double)(blind[i] - x[i]);
                error += e * e;
                promised += (double)variance[i];
                open_loop += b * b;
            }
        }
    }
    assert_true(error < 1.5 * promised && error > promised / 1.5);
    assert_true(error < open_loop / 10);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sequential_updates_equal_one_batch_update),
        cmocka_unit_test(continuous_prediction_converges_to_the_exact_discretisation),
        cmocka_unit_test(longest_panel_bounds_the_step_of_a_long_prediction),
        cmocka_unit_test(continuous_prediction_stays_definite_where_the_step_is_far_too_long),
        cmocka_unit_test(continuous_prediction_to_the_present_changes_nothing),
        cmocka_unit_test(missing_and_non_finite_channels_are_left_out_and_counted),
        cmocka_unit_test(without_data_the_filter_coasts_and_its_uncertainty_grows),
        cmocka_unit_test(gate_rejects_a_channel_beyond_its_own_standard_deviation),
        cmocka_unit_test(an_update_at_another_time_is_refused),
        cmocka_unit_test(a_failed_step_leaves_the_estimate_as_it_was),
        cmocka_unit_test(setting_the_estimate_starts_anew_or_changes_nothing),
        cmocka_unit_test(a_model_without_what_the_filter_needs_is_refused),
        cmocka_unit_test(error_of_a_nonlinear_plant_matches_the_own_covariance),
    };
    return cmocka_run_group_tests_name("ekf", tests, NULL, NULL);
}
