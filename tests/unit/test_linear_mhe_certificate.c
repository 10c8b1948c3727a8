/* The linear moving horizon estimator: what its certificate says and does. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "linear_mhe_rig.h"

static void certificate_is_small_at_the_solution_and_large_beside_it(void **state)
{
    (void)state;
    random_state = 5;
    for (int trial = 0; trial < 90; trial++) {
        const enum dse_arrival arrival = (enum dse_arrival)(trial % 3);
        const int nx = 1 + trial % 6, N = 6;
        struct system s;
        struct data data;
        struct dse_linear_mhe mhe;
        random_system(&s, nx, 2, arrival == DSE_ARRIVAL_NONE ? nx : choose(nx + 1), nx, 1);
        simulate(&s, 0, &data);
        const struct dse_linear_mhe_config config = config_of(&s, N, arrival);
        assert_int_equal(start(&mhe, &config), DSE_OK);
        for (int k = 0; k < 12; k++)
            step(&mhe, &data, k);
        dse_real x[6 * NX_MAX], size = 0;
        for (int i = 0; i < N * nx; i++) {
            x[i] = dse_linear_mhe_window(&mhe)[i];
            size = dse_max(size, dse_abs(x[i]));
        }
        assert_true(dse_linear_mhe_certificate(&mhe) < TIGHT);
        assert_true(dse_linear_mhe_certify(&mhe, x) == dse_linear_mhe_certificate(&mhe));
        const dse_real shift = dse_sqrt(EPS) * size; /* 1.5e-8: half of the digits */
        for (int i = 0; i < N * nx; i++) {
            x[i] += shift;
            assert_true(dse_linear_mhe_certify(&mhe, x) > DSE_REAL(1e-3) * dse_sqrt(EPS));
            x[i] -= shift;
        }
    }
}

/* Factors that are wrong in half of their digits still lead to the solution. */
static void errors_of_the_factors_are_corrected_by_the_residual(void **state)
{
    (void)state;
    enum { nx = 4, N = 6 };
    for (int trial = 0; trial < 3; trial++) {
        random_state = 13;
        struct system s;
        struct data data;
        struct dse_linear_mhe mhe;
        dse_real expected[N * nx];
        random_system(&s, nx, 2, nx, nx, 1);
        simulate(&s, 0, &data);
        const struct dse_linear_mhe_config config = config_of(&s, N, (enum dse_arrival)trial);
        for (int pass = 0; pass < 2; pass++) {
            assert_int_equal(start(&mhe, &config), DSE_OK);
            for (int i = 0; i < N * 3 * nx * nx && pass == 1; i++)
                mhe.complete[i] *= 1 + dse_sqrt(EPS) * uniform();
            for (int k = 0; k < 10; k++)
                step(&mhe, &data, k);
            for (int i = 0; i < N * nx && pass == 0; i++)
                expected[i] = dse_linear_mhe_window(&mhe)[i];
        }
        assert_agree(N * nx, dse_linear_mhe_window(&mhe), expected, 1000 * EPS);
        assert_true(dse_linear_mhe_certificate(&mhe) < TIGHT);
        assert_true(dse_linear_mhe_counts(&mhe)->refinements >= 5);
    }
}

static void a_solution_above_the_tolerance_is_refused_and_the_estimate_kept(void **state)
{
    (void)state;
    random_state = 6;
    struct system s;
    struct data data;
    struct dse_linear_mhe mhe;
    random_system(&s, 4, 2, 4, 4, 1);
    simulate(&s, 0, &data);
    struct dse_linear_mhe_config config = config_of(&s, 4, DSE_ARRIVAL_KALMAN);
    assert_int_equal(start(&mhe, &config), DSE_OK);
    for (int k = 0; k < 8; k++)
        step(&mhe, &data, k);
    dse_real before[4 * 4], P[16];
    for (int i = 0; i < 16; i++)
        before[i] = dse_linear_mhe_window(&mhe)[i];
    config.tolerance = DSE_REAL_MIN;
    assert_int_equal(dse_linear_mhe_advance(&mhe, &data.u[7]), DSE_OK);
    const struct dse_measurement sample = sample_of(&data, 8);
    assert_int_equal(dse_linear_mhe_measure(&mhe, 0, &data.u[8], &sample), DSE_OK);
    assert_int_equal(dse_linear_mhe_solve(&mhe), DSE_ENOCONV);
    assert_true(dse_linear_mhe_sample(&mhe) == 7);
    assert_memory_equal(before, dse_linear_mhe_window(&mhe), sizeof before);
    assert_int_equal(dse_linear_mhe_covariance(&mhe, P), DSE_ENODATA);
    assert_int_equal(dse_linear_mhe_health(&mhe), DSE_HEALTH_DIVERGED);
    assert_int_equal((int)dse_linear_mhe_counts(&mhe)->failed, 1);
    config.tolerance = 0;
    assert_int_equal(dse_linear_mhe_solve(&mhe), DSE_OK);
    assert_true(dse_linear_mhe_sample(&mhe) == 8);
    assert_int_equal(dse_linear_mhe_health(&mhe), DSE_HEALTH_TRACKING);
}

/* Also where neither prior nor noise carry a multiplier into a residual. */
static void states_that_are_not_finite_have_no_finite_certificate(void **state)
{
    (void)state;
    enum { N = 5 };
    random_state = 8;
    for (int trial = 0; trial < 24; trial++) {
        const int nx = 1 + trial % 6;
        struct system s;
        struct data data;
        struct dse_linear_mhe mhe;
        random_system(&s, nx, 2, trial % 2 ? nx : 0, trial % 2 ? nx : 0, 1);
        simulate(&s, 10, &data);
        const struct dse_linear_mhe_config config = config_of(&s, N, DSE_ARRIVAL_CONSTANT);
        assert_int_equal(start(&mhe, &config), DSE_OK);
        for (int k = 0; k < 8; k++)
            step(&mhe, &data, k);
        dse_real x[N * NX_MAX];
        for (int i = 0; i < N * nx; i++)
            x[i] = dse_linear_mhe_window(&mhe)[i];
        for (int i = 0; i < N * nx; i++) {
            const dse_real kept = x[i];
            x[i] = (dse_real)NAN;
            assert_false(dse_is_finite(dse_linear_mhe_certify(&mhe, x)));
            x[i] = -(dse_real)INFINITY;
            assert_false(dse_is_finite(dse_linear_mhe_certify(&mhe, x)));
            x[i] = kept;
        }
        assert_true(dse_linear_mhe_certify(&mhe, x) == dse_linear_mhe_certificate(&mhe));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(certificate_is_small_at_the_solution_and_large_beside_it),
        cmocka_unit_test(errors_of_the_factors_are_corrected_by_the_residual),
        cmocka_unit_test(states_that_are_not_finite_have_no_finite_certificate),
        cmocka_unit_test(a_solution_above_the_tolerance_is_refused_and_the_estimate_kept),
    };
    return cmocka_run_group_tests_name("linear_mhe_certificate", tests, NULL, NULL);
}
