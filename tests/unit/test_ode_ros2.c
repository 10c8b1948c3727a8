/* The linearly implicit stepper: order, its matrix, stiffness. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "dse/math.h"
#include "dse/ode.h"
#include "ode_problems.h"

static void ros2_converges_with_order_two(void **state)
{
    (void)state;
    const int steps = sizeof(dse_real) == sizeof(float) ? 40 : 400;
    for (size_t i = 0; i < N_PROBLEMS; i++) {
        struct dse_model model = model_of(&problems[i]);
        check_order(&problems[i], &model, dse_ros2_step, 2, steps);
    }
}

static enum dse_status rough_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                  const dse_real *u, dse_real *F)
{
    (void)t, (void)x, (void)u;
    for (int i = 0; i < model->nx * model->nx; i++)
        F[i] = DSE_REAL(-0.3) + DSE_REAL(0.1) * (dse_real)i;
    return DSE_OK;
}

static void ros2_keeps_order_two_with_a_wrong_jacobian(void **state)
{
    (void)state;
    const int steps = sizeof(dse_real) == sizeof(float) ? 60 : 800;
    for (size_t i = 0; i < N_PROBLEMS; i++) {
        struct dse_model model = model_of(&problems[i]);
        model.dfdx = rough_dfdx;
        check_order(&problems[i], &model, dse_ros2_step, 2, steps);
    }
}

/* ---- failures ---- */

static enum dse_status failing_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                    const dse_real *u, dse_real *F)
{
    (void)model, (void)t, (void)x, (void)u;
    F[0] = 0;
    return DSE_EMODEL;
}

static enum dse_status nan_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                const dse_real *u, dse_real *F)
{
    (void)t, (void)x, (void)u;
    for (int i = 0; i < model->nx * model->nx; i++)
        F[i] = (dse_real)NAN;
    return DSE_OK;
}

static enum dse_status constant_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                     const dse_real *u, dse_real *F)
{
    (void)t, (void)x, (void)u;
    F[0] = *(const dse_real *)model->parameters;
    return DSE_OK;
}

static void ros2_reports_what_is_wrong_with_its_matrix(void **state)
{
    (void)state;
    struct dse_model model = model_of(&problems[2]);
    dse_real x[2] = {1, 2}, scratch[DSE_ROS2_SCRATCH(2)];
    model.dfdx = failing_dfdx;
    assert_int_equal(dse_ros2_step(&model, 0, 1, NULL, x, scratch), DSE_EMODEL);
    model.dfdx = nan_dfdx;
    assert_int_equal(dse_ros2_step(&model, 0, 1, NULL, x, scratch), DSE_ENONFINITE);
    assert_true(x[0] == 1 && x[1] == 2);

    /* gamma h J = 1 exactly for one of the numbers around 1/gamma = 2 + sqrt 2 */
    int singular = 0;
    for (int ulps = -4; ulps <= 4; ulps++) {
        const dse_real J = DSE_REAL(3.41421356237309505) + 2 * EPS * (dse_real)ulps;
        struct dse_model scalar = model_of(&problems[0]);
        scalar.dfdx = constant_dfdx;
        scalar.parameters = &J;
        dse_real before = x[0];
        enum dse_status status = dse_ros2_step(&scalar, 1, 1, NULL, x, scratch);
        if (status == DSE_ESINGULAR)
            assert_true(x[0] == before);
        singular += status == DSE_ESINGULAR;
        x[0] = before;
    }
    assert_true(singular > 0);
}

/* ---- stiffness ---- */

struct stiff {
    dse_real lambda;
};

/* x' = lambda (x - cos t) - sin t: x = cos t + (x0 - 1) exp(lambda t) */
static enum dse_status forced_f(const struct dse_model *model, dse_real t, const dse_real *x,
                                const dse_real *u, dse_real *dx)
{
    (void)u;
    const struct stiff *stiff = model->parameters;
    dx[0] = stiff->lambda * (x[0] - dse_cos(t)) - dse_sin(t);
    return DSE_OK;
}

/* x1' = lambda (x1 - x2^2) - 2 x2^2, x2' = -x2: x1 goes to x2^2 at once and stays there. */
static enum dse_status slow_f(const struct dse_model *model, dse_real t, const dse_real *x,
                              const dse_real *u, dse_real *dx)
{
    (void)t, (void)u;
    const struct stiff *stiff = model->parameters;
    const dse_real square = x[1] * x[1];
    dx[0] = stiff->lambda * (x[0] - square) - 2 * square;
    dx[1] = -x[1];
    return DSE_OK;
}

static enum dse_status slow_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                 const dse_real *u, dse_real *F)
{
    (void)t, (void)u;
    const struct stiff *stiff = model->parameters;
    F[0] = stiff->lambda;
    F[1] = -2 * stiff->lambda * x[1] - 4 * x[1];
    F[2] = 0;
    F[3] = -1;
    return DSE_OK;
}

static enum dse_status decay_f(const struct dse_model *model, dse_real t, const dse_real *x,
                               const dse_real *u, dse_real *dx)
{
    (void)u, (void)t;
    const struct stiff *stiff = model->parameters;
    dx[0] = stiff->lambda * x[0];
    return DSE_OK;
}

static enum dse_status stiff_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                  const dse_real *u, dse_real *F)
{
    (void)x, (void)u, (void)t;
    const struct stiff *stiff = model->parameters;
    F[0] = stiff->lambda;
    return DSE_OK;
}

/* One step multiplies x by R(z) = (1 + (1 - 2 gamma) z) / (1 - gamma z)^2, z = h lambda, which goes
 * to zero for z -> -infinity. */
static void ros2_damps_as_its_stability_function_says(void **state)
{
    (void)state;
    const double gamma = 1 - sqrt(0.5);
    for (int decade = -2; decade <= 8; decade++) {
        const double z = -pow(10, decade);
        const struct stiff stiff = {(dse_real)z};
        const struct dse_model model = {.time = DSE_CONTINUOUS,
                                        .nx = 1,
                                        .parameters = &stiff,
                                        .f = decay_f,
                                        .dfdx = stiff_dfdx};
        dse_real x[1] = {1}, scratch[DSE_ROS2_SCRATCH(1)];
        assert_int_equal(dse_ros2_step(&model, 0, 1, NULL, x, scratch), DSE_OK);
        double expected = (1 + (1 - 2 * gamma) * z) / ((1 - gamma * z) * (1 - gamma * z));
        /* x + h/2 (3 k1 + k2) cancels terms of size 2/gamma */
        assert_true(fabs((double)x[0] - expected) < 50 * (double)EPS);
    }
}

static void ros2_follows_the_slow_solution_with_h_lambda_of_minus_a_million(void **state)
{
    (void)state;
    const dse_real h = DSE_REAL(0.01);
    const struct stiff stiff = {DSE_REAL(-1e8)};
    const struct dse_model model = {
        .time = DSE_CONTINUOUS, .nx = 2, .parameters = &stiff, .f = slow_f, .dfdx = slow_dfdx};
    dse_real x[2] = {3, 1}, scratch[DSE_ROS2_SCRATCH(2)]; /* starts far from x1 = x2^2 */
    for (int k = 0; k < 300; k++) {
        assert_int_equal(dse_ros2_step(&model, (dse_real)k * h, h, NULL, x, scratch), DSE_OK);
        double decayed = exp(-((double)(k + 1) * (double)h));
        assert_true(fabs((double)x[1] - decayed) < 1e-5 + 10 * (double)EPS);
        assert_true(fabs((double)x[0] - decayed * decayed) < 1e-4 + 10 * (double)EPS);
    }
}

static void ros2_errs_by_less_than_h_when_a_stiff_model_depends_on_time(void **state)
{
    (void)state;
    const struct stiff stiff = {DSE_REAL(-1e8)};
    const struct dse_model model = {
        .time = DSE_CONTINUOUS, .nx = 1, .parameters = &stiff, .f = forced_f, .dfdx = stiff_dfdx};
    const dse_real h = DSE_REAL(0.01);
    dse_real x[1] = {2}, scratch[DSE_ROS2_SCRATCH(1)]; /* starts away from cos 0 = 1 */
    for (int k = 0; k < 300; k++) {
        dse_real t = (dse_real)k * h;
        assert_int_equal(dse_ros2_step(&model, t, h, NULL, x, scratch), DSE_OK);
        assert_true(fabs((double)x[0] - cos((double)(t + h))) < (double)h);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ros2_converges_with_order_two),
        cmocka_unit_test(ros2_keeps_order_two_with_a_wrong_jacobian),
        cmocka_unit_test(ros2_reports_what_is_wrong_with_its_matrix),
        cmocka_unit_test(ros2_damps_as_its_stability_function_says),
        cmocka_unit_test(ros2_follows_the_slow_solution_with_h_lambda_of_minus_a_million),
        cmocka_unit_test(ros2_errs_by_less_than_h_when_a_stiff_model_depends_on_time),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
