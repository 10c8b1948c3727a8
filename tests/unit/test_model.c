/* Model interface: missing measurements, the linear model, and the check of Jacobians. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "dse/math.h"
#include "dse/model.h"

/* What the check may find in a right Jacobian. */
#define RIGHT (sizeof(dse_real) == sizeof(float) ? DSE_REAL(2e-2) : DSE_REAL(2e-5))

/* ---- measurements ---- */

static void a_channel_is_there_when_flagged_and_finite(void **state)
{
    (void)state;
    const dse_real nan = (dse_real)NAN, inf = (dse_real)INFINITY;
    const dse_real y[6] = {1, 2, nan, inf, -inf, DSE_REAL_MAX};
    const bool valid[6] = {true, false, true, true, true, true};
    const bool expected[6] = {true, false, false, false, false, true};
    const struct dse_measurement measurement = {y, valid};
    for (int j = 0; j < 6; j++)
        assert_true(dse_measurement_has(&measurement, j) == expected[j]);
}

static void without_flags_every_finite_channel_is_there(void **state)
{
    (void)state;
    const dse_real y[3] = {0, (dse_real)NAN, -5};
    const struct dse_measurement measurement = {y, NULL};
    assert_true(dse_measurement_has(&measurement, 0));
    assert_false(dse_measurement_has(&measurement, 1));
    assert_true(dse_measurement_has(&measurement, 2));
}

/* ---- linear model ---- */

static const dse_real A[9] = {1, 2, 3, 4, 5, 6, 7, 8, 10};
static const dse_real B[6] = {1, 0, -1, 2, 0, 3};
static const dse_real C[6] = {1, 0, 2, 0, -1, 1};
static const dse_real D[4] = {2, 1, 0, -3};

static void assert_values(int n, const dse_real *got, const dse_real *expected)
{
    for (int i = 0; i < n; i++)
        assert_true(got[i] == expected[i]);
}

static void linear_model_is_its_matrices(void **state)
{
    (void)state;
    const struct dse_linear linear = {A, B, C, D};
    struct dse_model model;
    dse_linear_model(&model, DSE_DISCRETE, 3, 2, 2, &linear);
    assert_int_equal(model.time, DSE_DISCRETE);
    assert_true(model.nx == 3 && model.nu == 2 && model.ny == 2);

    const dse_real x[3] = {1, -1, 2}, u[2] = {3, 5};
    dse_real dx[4], y[3], F[10], H[7];
    dx[3] = y[2] = F[9] = H[6] = 12345; /* guards */
    assert_int_equal(model.f(&model, 0, x, u, dx), DSE_OK);
    assert_values(3, dx, (const dse_real[]){5 + 3, 11 + 7, 19 + 15});
    assert_int_equal(model.h(&model, 0, x, u, y), DSE_OK);
    assert_values(2, y, (const dse_real[]){5 + 11, 3 - 15});
    assert_int_equal(model.dfdx(&model, 0, x, u, F), DSE_OK);
    assert_values(9, F, A);
    assert_int_equal(model.dhdx(&model, 0, x, u, H), DSE_OK);
    assert_values(6, H, C);
    assert_true(dx[3] == 12345 && y[2] == 12345 && F[9] == 12345 && H[6] == 12345);
}

static void linear_model_needs_neither_inputs_nor_feedthrough(void **state)
{
    (void)state;
    const dse_real x[3] = {1, -1, 2}, u[2] = {3, 5};
    dse_real dx[3], y[2];
    struct dse_model model;

    const struct dse_linear autonomous = {.A = A, .C = C};
    dse_linear_model(&model, DSE_CONTINUOUS, 3, 0, 2, &autonomous);
    assert_int_equal(model.time, DSE_CONTINUOUS);
    assert_int_equal(model.f(&model, 0, x, NULL, dx), DSE_OK);
    assert_values(3, dx, (const dse_real[]){5, 11, 19});
    assert_int_equal(model.h(&model, 0, x, NULL, y), DSE_OK);
    assert_values(2, y, (const dse_real[]){5, 3});

    const struct dse_linear no_feedthrough = {.A = A, .B = B, .C = C};
    dse_linear_model(&model, DSE_CONTINUOUS, 3, 2, 2, &no_feedthrough);
    assert_int_equal(model.h(&model, 0, x, u, y), DSE_OK);
    assert_values(2, y, (const dse_real[]){5, 3});
}

/* ---- check of Jacobians ---- */

/* A reactor-like model with states and derivatives of very different sizes:
 *   f1 = 1e13 exp(-8000 / T) c - 0.1 T,  f2 = -1e9 exp(-8000 / T) c + u,  c ~ 1e-3, T ~ 400
 *   h1 = c T, h2 = T, h3 = 7 */
enum { NX = 2, NY = 3, HEAT = 10000 };

static dse_real rate(dse_real T)
{
    return DSE_REAL(1e9) * dse_exp(-8000 / T);
}

static enum dse_status reactor_f(const struct dse_model *model, dse_real t, const dse_real *x,
                                 const dse_real *u, dse_real *dx)
{
    (void)model, (void)t;
    const dse_real r = rate(x[0]) * x[1];
    dx[0] = HEAT * r - DSE_REAL(0.1) * x[0];
    dx[1] = -r + u[0];
    return DSE_OK;
}

static enum dse_status reactor_h(const struct dse_model *model, dse_real t, const dse_real *x,
                                 const dse_real *u, dse_real *y)
{
    (void)model, (void)t, (void)u;
    y[0] = x[0] * x[1];
    y[1] = x[0];
    y[2] = 7;
    return DSE_OK;
}

/* Which entry of F or H is wrong, and by what factor; entry -1: none. */
struct mistake {
    int entry_f, entry_h;
    dse_real factor;
};

static enum dse_status reactor_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                    const dse_real *u, dse_real *F)
{
    (void)t, (void)u;
    const struct mistake *mistake = model->parameters;
    const dse_real k = rate(x[0]), dk = k * 8000 / (x[0] * x[0]);
    F[0] = HEAT * dk * x[1] - DSE_REAL(0.1);
    F[1] = HEAT * k;
    F[2] = -dk * x[1];
    F[3] = -k;
    if (mistake->entry_f >= 0)
        F[mistake->entry_f] *= mistake->factor;
    return DSE_OK;
}

static enum dse_status reactor_dhdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                    const dse_real *u, dse_real *H)
{
    (void)t, (void)u;
    const struct mistake *mistake = model->parameters;
    const dse_real right[NY * NX] = {x[1], x[0], 1, 0, 0, 0};
    for (int i = 0; i < NY * NX; i++)
        H[i] = right[i];
    if (mistake->entry_h >= 0)
        H[mistake->entry_h] *= mistake->factor;
    return DSE_OK;
}

static const dse_real point_x[NX] = {400, DSE_REAL(2e-3)}, point_u[1] = {1};

static struct dse_model reactor(const struct mistake *mistake)
{
    return (struct dse_model){.time = DSE_CONTINUOUS,
                              .nx = NX,
                              .nu = 1,
                              .ny = NY,
                              .parameters = mistake,
                              .f = reactor_f,
                              .h = reactor_h,
                              .dfdx = reactor_dfdx,
                              .dhdx = reactor_dhdx};
}

static enum dse_status check(const struct dse_model *model, dse_real *worst_f, dse_real *worst_h)
{
    dse_real scratch[DSE_MODEL_CHECK_SCRATCH(NX, NY)];
    return dse_model_check_jacobians(model, 0, point_x, point_u, scratch, worst_f, worst_h);
}

static void right_jacobians_pass(void **state)
{
    (void)state;
    const struct mistake none = {-1, -1, 1};
    const struct dse_model model = reactor(&none);
    dse_real worst_f = -1, worst_h = -1;
    assert_int_equal(check(&model, &worst_f, &worst_h), DSE_OK);
    assert_true(worst_f >= 0 && worst_f < RIGHT);
    assert_true(worst_h >= 0 && worst_h < RIGHT);
}

/* Every entry that is not zero, large or small, with the wrong sign, forgotten, or a tenth off. */
static void every_wrong_entry_is_found(void **state)
{
    (void)state;
    const dse_real factors[] = {-1, 0, DSE_REAL(1.1)};
    for (int entry = 0; entry < NX * NX; entry++) {
        for (int i = 0; i < 3; i++) {
            const struct mistake in_f = {entry, -1, factors[i]}, in_h = {-1, entry, factors[i]};
            dse_real worst_f, worst_h;
            struct dse_model model = reactor(&in_f);
            assert_int_equal(check(&model, &worst_f, &worst_h), DSE_OK);
            assert_true(worst_f > DSE_REAL(0.08) && worst_h < RIGHT);
            if (entry == 3)
                continue; /* dh2/dc is zero */
            model = reactor(&in_h);
            assert_int_equal(check(&model, &worst_f, &worst_h), DSE_OK);
            assert_true(worst_f < RIGHT && worst_h > DSE_REAL(0.08));
        }
    }
}

static enum dse_status busy_dhdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                 const dse_real *u, dse_real *H)
{
    enum dse_status status = reactor_dhdx(model, t, x, u, H);
    H[5] = 1; /* h3 does not depend on anything */
    return status;
}

static void a_dependence_that_is_not_there_is_found(void **state)
{
    (void)state;
    const struct mistake none = {-1, -1, 1};
    struct dse_model model = reactor(&none);
    model.dhdx = busy_dhdx;
    dse_real worst;
    assert_int_equal(check(&model, NULL, &worst), DSE_OK);
    assert_true(worst == 1);
}

static void linear_models_pass_at_zero_and_elsewhere(void **state)
{
    (void)state;
    const struct dse_linear linear = {A, B, C, D};
    struct dse_model model;
    dse_linear_model(&model, DSE_DISCRETE, 3, 2, 2, &linear);
    const dse_real points[2][3] = {{0, 0, 0}, {3000000, -50, 0}}, u[2] = {1, 2};
    for (int i = 0; i < 2; i++) {
        dse_real scratch[DSE_MODEL_CHECK_SCRATCH(3, 2)], worst_f, worst_h;
        assert_int_equal(
            dse_model_check_jacobians(&model, 0, points[i], u, scratch, &worst_f, &worst_h),
            DSE_OK);
        assert_true(worst_f < RIGHT && worst_h < RIGHT);
    }
}

/* f1 = x1 + a x2, but the Jacobian forgets a. */
static enum dse_status forgetful_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                      const dse_real *u, dse_real *F)
{
    (void)model, (void)t, (void)x, (void)u;
    for (int i = 0; i < 4; i++)
        F[i] = i == 0 ? 1 : 0;
    return DSE_OK;
}

/* The deviation is a / (a + eps^(1/3)): nothing for an effect that differences cannot resolve, 1
 * for an ordinary one. */
static void small_effects_weigh_as_much_as_differences_can_resolve(void **state)
{
    (void)state;
    const dse_real resolution = (dse_real)cbrt((double)DSE_REAL_EPSILON);
    const dse_real sizes[4] = {resolution * resolution, resolution, 3 * resolution, 1};
    for (int i = 0; i < 4; i++) {
        const dse_real unequal[4] = {1, sizes[i], 0, 0};
        const struct dse_linear linear = {.A = unequal};
        struct dse_model model;
        dse_linear_model(&model, DSE_CONTINUOUS, 2, 0, 0, &linear);
        model.dfdx = forgetful_dfdx;
        const dse_real x[2] = {1, 1}, expected = sizes[i] / (sizes[i] + resolution);
        dse_real scratch[DSE_MODEL_CHECK_SCRATCH(2, 0)], worst;
        assert_int_equal(dse_model_check_jacobians(&model, 0, x, NULL, scratch, &worst, NULL),
                         DSE_OK);
        assert_true(dse_abs(worst - expected) < RIGHT);
    }
}

static void check_of_jacobians_keeps_to_its_scratch(void **state)
{
    (void)state;
    enum { SIZE = DSE_MODEL_CHECK_SCRATCH(NX, NY) };
    const struct mistake none = {-1, -1, 1};
    const struct dse_model model = reactor(&none);
    dse_real scratch[SIZE + 4], worst_f, worst_h;
    for (int i = 0; i < SIZE + 4; i++)
        scratch[i] = 12345;
    assert_int_equal(
        dse_model_check_jacobians(&model, 0, point_x, point_u, scratch, &worst_f, &worst_h),
        DSE_OK);
    for (int i = SIZE; i < SIZE + 4; i++)
        assert_true(scratch[i] == 12345);
}

static enum dse_status failing(const struct dse_model *model, dse_real t, const dse_real *x,
                               const dse_real *u, dse_real *result)
{
    (void)model, (void)t, (void)x, (void)u;
    result[0] = 0;
    return DSE_EMODEL;
}

static enum dse_status nan_h(const struct dse_model *model, dse_real t, const dse_real *x,
                             const dse_real *u, dse_real *y)
{
    enum dse_status status = reactor_h(model, t, x, u, y);
    y[1] = (dse_real)NAN;
    return status;
}

static void failures_of_the_check_are_told_apart(void **state)
{
    (void)state;
    const struct mistake none = {-1, -1, 1};
    const struct dse_model good = reactor(&none);
    dse_real worst_f, worst_h;
    struct dse_model model = good;
    model.dfdx = NULL;
    assert_int_equal(check(&model, &worst_f, &worst_h), DSE_EINVAL);
    assert_int_equal(check(&model, NULL, &worst_h), DSE_OK);
    model = good;
    model.dhdx = NULL;
    assert_int_equal(check(&model, &worst_f, &worst_h), DSE_EINVAL);
    assert_int_equal(check(&model, &worst_f, NULL), DSE_OK);
    model = good;
    model.f = failing;
    assert_int_equal(check(&model, &worst_f, &worst_h), DSE_EMODEL);
    model = good;
    model.dhdx = failing;
    assert_int_equal(check(&model, &worst_f, &worst_h), DSE_EMODEL);
    model = good;
    model.h = nan_h;
    assert_int_equal(check(&model, &worst_f, &worst_h), DSE_ENONFINITE);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_channel_is_there_when_flagged_and_finite),
        cmocka_unit_test(without_flags_every_finite_channel_is_there),
        cmocka_unit_test(linear_model_is_its_matrices),
        cmocka_unit_test(linear_model_needs_neither_inputs_nor_feedthrough),
        cmocka_unit_test(right_jacobians_pass),
        cmocka_unit_test(every_wrong_entry_is_found),
        cmocka_unit_test(a_dependence_that_is_not_there_is_found),
        cmocka_unit_test(linear_models_pass_at_zero_and_elsewhere),
        cmocka_unit_test(small_effects_weigh_as_much_as_differences_can_resolve),
        cmocka_unit_test(check_of_jacobians_keeps_to_its_scratch),
        cmocka_unit_test(failures_of_the_check_are_told_apart),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
