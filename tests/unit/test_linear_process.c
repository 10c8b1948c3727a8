/* The linear process: around its operating point, with a part that swings. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "dse/math.h"
#include "dse/model.h"
#include "near.h"

enum { NX = 3, NU = 2, NY = 2 };

static const dse_real A[] = {-1, 2, 0, 0, DSE_REAL(-0.5), 1, 3, 0, -2};
static const dse_real B[] = {1, 0, 0, 2, -1, 1};
static const dse_real C[] = {1, 0, 0, 0, 1, 1};
static const dse_real D[] = {0, 1, -1, 0};
static const dse_real swing[] = {DSE_REAL(0.4), 0, 0, 0, 0, 0, 0, 1, 0};
static const dse_real origin[] = {550, DSE_REAL(0.25), 3};
static const dse_real x[] = {552, DSE_REAL(0.5), -1}, u[] = {DSE_REAL(0.5), 4};

static struct dse_model model_of(enum dse_time_kind time, const struct dse_linear_process *process)
{
    struct dse_model model;
    dse_linear_process_model(&model, time, NX, NU, NY, process);
    return model;
}

static void without_origin_and_swing_it_is_the_linear_model(void **state)
{
    (void)state;
    const struct dse_linear_process process = {.linear = {A, B, C, D}};
    const enum dse_time_kind times[] = {DSE_CONTINUOUS, DSE_DISCRETE};
    for (int i = 0; i < 2; i++) {
        struct dse_model linear, mine = model_of(times[i], &process);
        dse_linear_model(&linear, times[i], NX, NU, NY, &process.linear);
        dse_real got[NX], want[NX], y[NY], y_want[NY];
        assert_int_equal(mine.f(&mine, 7, x, u, got), DSE_OK);
        assert_int_equal(linear.f(&linear, 7, x, u, want), DSE_OK);
        assert_int_equal(mine.h(&mine, 7, x, u, y), DSE_OK);
        assert_int_equal(linear.h(&linear, 7, x, u, y_want), DSE_OK);
        assert_memory_equal(got, want, sizeof got);
        assert_memory_equal(y, y_want, sizeof y);
    }
}

/* x' or x(k+1) - o from the definition, term by term. */
static void it_acts_on_the_deviation_from_its_origin(void **state)
{
    (void)state;
    const struct dse_linear_process process = {
        .linear = {A, B, C, NULL}, .origin = origin, .swing = swing, .omega = 2};
    const dse_real t = DSE_REAL(0.75), s = dse_sin(DSE_REAL(1.5));
    const dse_real d[] = {2, DSE_REAL(0.25), -4};
    const dse_real want[] = {-2 + DSE_REAL(0.5) + s * DSE_REAL(0.8) + DSE_REAL(0.5),
                             DSE_REAL(-0.125) - 4 + 8, 6 + 8 + s * d[1] - DSE_REAL(0.5) + 4};
    const enum dse_time_kind times[] = {DSE_CONTINUOUS, DSE_DISCRETE};
    for (int i = 0; i < 2; i++) {
        const struct dse_model model = model_of(times[i], &process);
        dse_real got[NX], y[NY];
        assert_int_equal(model.f(&model, t, x, u, got), DSE_OK);
        for (int j = 0; j < NX; j++)
            assert_near(got[j], want[j] + (times[i] == DSE_DISCRETE ? origin[j] : 0),
                        TOLERANCE(1e-12, 1e-4));
        /* outputs show the process itself */
        assert_int_equal(model.h(&model, t, x, u, y), DSE_OK);
        assert_near(y[0], 552, 0);
        assert_near(y[1], DSE_REAL(-0.5), 0);
    }
}

static void its_jacobian_is_the_matrix_of_the_moment(void **state)
{
    (void)state;
    const struct dse_linear_process process = {
        .linear = {A, B, C, D}, .origin = origin, .swing = swing, .omega = 2};
    const struct dse_model model = model_of(DSE_CONTINUOUS, &process);
    dse_real F[NX * NX], H[NY * NX], scratch[DSE_MODEL_CHECK_SCRATCH(NX, NY)], worst_f, worst_h;
    const dse_real t = DSE_REAL(0.3);
    assert_int_equal(model.dfdx(&model, t, x, u, F), DSE_OK);
    assert_int_equal(model.dhdx(&model, t, x, u, H), DSE_OK);
    for (int k = 0; k < NX * NX; k++)
        assert_near(F[k], A[k] + dse_sin(DSE_REAL(0.6)) * swing[k], TOLERANCE(1e-15, 1e-6));
    assert_memory_equal(H, C, sizeof C);
    assert_int_equal(dse_model_check_jacobians(&model, t, x, u, scratch, &worst_f, &worst_h),
                     DSE_OK);
    assert_true(worst_f < TOLERANCE(1e-4, 5e-2) && worst_h < TOLERANCE(1e-4, 5e-2));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(without_origin_and_swing_it_is_the_linear_model),
        cmocka_unit_test(it_acts_on_the_deviation_from_its_origin),
        cmocka_unit_test(its_jacobian_is_the_matrix_of_the_moment),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
