/* Explicit steps of fixed size, and what all steppers share: inputs, refusals, failures that leave
 * x unchanged, memory. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "dse/math.h"
#include "dse/ode.h"
#include "ode_problems.h"

/* ---- RK4 ---- */

static void rk4_converges_with_order_four(void **state)
{
    (void)state;
    static const int steps_double[] = {64, 192, 64}, steps_float[] = {9, 18, 9};
    const int *steps = sizeof(dse_real) == sizeof(float) ? steps_float : steps_double;
    for (size_t i = 0; i < N_PROBLEMS; i++) {
        struct dse_model model = model_of(&problems[i]);
        check_order(&problems[i], &model, dse_rk4_model_step, 4, steps[i]);
    }
}

/* x + h/6 (k1 + 2 k2 + 2 k3 + k4), written out. */
static void rk4_is_the_textbook_formula(void **state)
{
    (void)state;
    struct dse_model model = model_of(&problems[1]);
    dse_real x[2] = {DSE_REAL(0.3), DSE_REAL(1.7)}, k1[2], k2[2], k3[2], k4[2], s[2], expected[2];
    const dse_real t = DSE_REAL(0.7), h = DSE_REAL(0.2);
    model.f(&model, t, x, NULL, k1);
    for (int j = 0; j < 2; j++)
        s[j] = x[j] + h / 2 * k1[j];
    model.f(&model, t + h / 2, s, NULL, k2);
    for (int j = 0; j < 2; j++)
        s[j] = x[j] + h / 2 * k2[j];
    model.f(&model, t + h / 2, s, NULL, k3);
    for (int j = 0; j < 2; j++)
        s[j] = x[j] + h * k3[j];
    model.f(&model, t + h, s, NULL, k4);
    for (int j = 0; j < 2; j++)
        expected[j] = x[j] + h / 6 * (k1[j] + 2 * k2[j] + 2 * k3[j] + k4[j]);

    dse_real scratch[DSE_RK4_SCRATCH(2)];
    assert_int_equal(dse_rk4_model_step(&model, t, h, NULL, x, scratch), DSE_OK);
    for (int j = 0; j < 2; j++)
        assert_true(dse_abs(x[j] - expected[j]) <= 4 * EPS * dse_abs(expected[j]));
}

/* ---- all steppers ---- */

static enum dse_status input_f(const struct dse_model *model, dse_real t, const dse_real *x,
                               const dse_real *u, dse_real *dx)
{
    (void)t, (void)x;
    for (int j = 0; j < model->nx; j++)
        dx[j] = u[j];
    return DSE_OK;
}

static enum dse_status zero_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                 const dse_real *u, dse_real *F)
{
    (void)t, (void)x, (void)u;
    for (int i = 0; i < model->nx * model->nx; i++)
        F[i] = 0;
    return DSE_OK;
}

static void input_is_held_over_the_step(void **state)
{
    (void)state;
    const struct dse_model model = {
        .time = DSE_CONTINUOUS, .nx = 2, .nu = 2, .f = input_f, .dfdx = zero_dfdx};
    const dse_real u[2] = {3, -5};
    dse_real scratch[32];
    const model_step steps[] = {dse_rk4_model_step, dse_ros2_step};
    for (int i = 0; i < 2; i++) {
        dse_real x[2] = {1, 1};
        assert_int_equal(steps[i](&model, 0, DSE_REAL(0.5), u, x, scratch), DSE_OK);
        assert_true(dse_abs(x[0] - DSE_REAL(2.5)) <= 4 * EPS);
        assert_true(dse_abs(x[1] + DSE_REAL(1.5)) <= 4 * EPS);
    }
}

static void discrete_models_are_refused(void **state)
{
    (void)state;
    struct dse_model model = model_of(&problems[0]);
    model.time = DSE_DISCRETE;
    dse_real x[1] = {1}, scratch[32];
    assert_int_equal(dse_rk4_model_step(&model, 0, 1, NULL, x, scratch), DSE_EINVAL);
    assert_int_equal(dse_ros2_step(&model, 0, 1, NULL, x, scratch), DSE_EINVAL);
    model.time = DSE_CONTINUOUS;
    model.dfdx = NULL;
    assert_int_equal(dse_ros2_step(&model, 0, 1, NULL, x, scratch), DSE_EINVAL);
    assert_true(x[0] == 1);
}

/* dx = -x, but the call number `fails_at` (from 1) ends otherwise. */
struct saboteur {
    int calls, fails_at;
    enum dse_status status; /* what it answers then; DSE_OK: a NaN derivative instead */
};

static enum dse_status sabotaged_f(const struct dse_model *model, dse_real t, const dse_real *x,
                                   const dse_real *u, dse_real *dx)
{
    (void)t, (void)u;
    struct saboteur *saboteur = *(struct saboteur *const *)model->parameters;
    dx[0] = -x[0];
    dx[1] = -x[1];
    if (++saboteur->calls == saboteur->fails_at) {
        dx[1] = (dse_real)NAN;
        return saboteur->status;
    }
    return DSE_OK;
}

static void check_sabotaged_step(model_step step, int stages, int fails_at, enum dse_status answer)
{
    struct saboteur saboteur = {0, fails_at, answer}, *parameters = &saboteur;
    const struct dse_model model = {.time = DSE_CONTINUOUS,
                                    .nx = 2,
                                    .parameters = &parameters,
                                    .f = sabotaged_f,
                                    .dfdx = zero_dfdx};
    dse_real x[2] = {1, 2}, scratch[32];
    enum dse_status status = step(&model, 0, DSE_REAL(0.1), NULL, x, scratch);
    if (fails_at > stages) { /* not reached: the step is as good as ever */
        assert_int_equal(status, DSE_OK);
        assert_true(x[0] != 1 && x[1] != 2);
    } else {
        assert_int_equal(status, answer == DSE_OK ? DSE_ENONFINITE : answer);
        assert_true(x[0] == 1 && x[1] == 2);
    }
}

static void a_failed_step_leaves_x_unchanged(void **state)
{
    (void)state;
    const enum dse_status answers[] = {DSE_EMODEL, DSE_EINVAL, DSE_OK};
    for (int i = 0; i < 3; i++) {
        for (int fails_at = 1; fails_at <= 5; fails_at++)
            check_sabotaged_step(dse_rk4_model_step, 4, fails_at, answers[i]);
        for (int fails_at = 1; fails_at <= 3; fails_at++)
            check_sabotaged_step(dse_ros2_step, 2, fails_at, answers[i]);
    }
}

/* The steppers of a problem with n = 2 touch x[0..1] and the scratch that their macros ask for. */
static void nothing_beyond_x_and_scratch_is_touched(void **state)
{
    (void)state;
    enum { GUARD = 4, MOST = 32 };
    const int sizes[3] = {DSE_RK4_SCRATCH(2), DSE_ROS2_SCRATCH(2), DSE_RK45_SCRATCH(2)};
    struct dse_model model = model_of(&problems[2]);
    struct dse_held_model held = {&model, NULL};
    for (int method = 0; method < 3; method++) {
        dse_real x[2 + GUARD], scratch[MOST + GUARD];
        for (int i = 0; i < 2 + GUARD; i++)
            x[i] = 12345;
        for (int i = 0; i < MOST + GUARD; i++)
            scratch[i] = 12345;
        if (method == 0)
            dse_rk4_model_step(&model, 0, DSE_REAL(0.1), NULL, x, scratch);
        else if (method == 1)
            dse_ros2_step(&model, 0, DSE_REAL(0.1), NULL, x, scratch);
        else
            dse_rk45_integrate(dse_held_model_rhs, &held, NULL, 0, 1, 2, x, scratch, NULL);
        assert_true(x[0] != 12345 && x[1] != 12345);
        for (int i = 2; i < 2 + GUARD; i++)
            assert_true(x[i] == 12345);
        for (int i = sizes[method]; i < MOST + GUARD; i++)
            assert_true(scratch[i] == 12345);
    }
}

static void scratch_may_hold_anything(void **state)
{
    (void)state;
    dse_real clean[2][32] = {{0}}, x[2][2];
    for (int i = 0; i < 32; i++)
        clean[1][i] = (dse_real)NAN;
    struct dse_model model = model_of(&problems[2]);
    struct dse_held_model held = {&model, NULL};
    for (int i = 0; i < 2; i++) {
        x[i][0] = 1;
        x[i][1] = 2;
        dse_rk4_model_step(&model, 0, DSE_REAL(0.1), NULL, x[i], clean[i]);
        dse_ros2_step(&model, 0, DSE_REAL(0.1), NULL, x[i], clean[i]);
        dse_rk45_integrate(dse_held_model_rhs, &held, NULL, 0, 1, 2, x[i], clean[i], NULL);
    }
    assert_true(dse_is_finite(x[0][0]) && x[0][0] != 1);
    assert_memory_equal(x[0], x[1], sizeof x[0]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rk4_converges_with_order_four),
        cmocka_unit_test(rk4_is_the_textbook_formula),
        cmocka_unit_test(input_is_held_over_the_step),
        cmocka_unit_test(discrete_models_are_refused),
        cmocka_unit_test(a_failed_step_leaves_x_unchanged),
        cmocka_unit_test(nothing_beyond_x_and_scratch_is_touched),
        cmocka_unit_test(scratch_may_hold_anything),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
