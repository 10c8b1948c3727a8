/* The linear moving horizon estimator: windows that grow, with gaps and late values. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "linear_mhe_dense.h"

static void short_windows_without_arrival_cost_are_predicted_from_x0(void **state)
{
    (void)state;
    enum { nx = 3, N = 6 };
    random_state = 7;
    struct system s;
    struct data data;
    struct dse_linear_mhe mhe;
    random_system(&s, nx, 1, nx, nx, 1);
    simulate(&s, 0, &data);
    struct dse_linear_mhe_config config = config_of(&s, N, DSE_ARRIVAL_NONE);
    dse_real x[nx], next[nx], expected[N * nx] = {0}, P[nx * nx];
    for (int least = 0; least <= 5; least += 5) { /* 0: nx samples */
        config.min_horizon = least;
        assert_int_equal(start(&mhe, &config), DSE_OK);
        assert_agree(nx, dse_linear_mhe_state(&mhe), s.x0, 0);
        for (int i = 0; i < nx; i++)
            x[i] = s.x0[i];
        for (int k = 0; k < N; k++) {
            step(&mhe, &data, k);
            const bool solved = k + 1 >= (least ? least : nx);
            assert_int_equal(dse_linear_mhe_length(&mhe), k + 1);
            assert_int_equal(dse_linear_mhe_health(&mhe),
                             solved ? DSE_HEALTH_TRACKING : DSE_HEALTH_INITIALISING);
            assert_int_equal(dse_linear_mhe_covariance(&mhe, P), solved ? DSE_OK : DSE_ENODATA);
            if (solved) {
                dense_window(&s, &data, 0, k + 1, NULL, expected);
                assert_agree((k + 1) * nx, dse_linear_mhe_window(&mhe), expected, AGREEMENT * 100);
            } else {
                assert_agree(nx, dse_linear_mhe_state(&mhe), x, 100 * EPS);
            }
            dense_product(nx, nx, 1, s.A, x, 0, next);
            for (int i = 0; i < nx; i++)
                x[i] = next[i] + s.B[i] * data.u[k];
        }
    }
}

/* The factors made at init and those made for an incomplete window are the same thing. */
static void a_gap_that_is_filled_leaves_no_trace(void **state)
{
    (void)state;
    random_state = 8;
    static dse_real other_memory[DSE_LINEAR_MHE_STORAGE(5, 2, 6)];
    struct system s;
    struct data data, gappy;
    struct dse_linear_mhe mhe, other;
    struct dse_arena arena;
    random_system(&s, 5, 2, 3, 5, 1);
    simulate(&s, 0, &data);
    gappy = data;
    for (int k = 0; k < STEPS; k++)
        gappy.valid[k][k % 2] = k % 3 > 0;
    const struct dse_linear_mhe_config config = config_of(&s, 6, DSE_ARRIVAL_CONSTANT);
    assert_int_equal(start(&mhe, &config), DSE_OK);
    dse_arena_init(&arena, other_memory, DSE_LINEAR_MHE_STORAGE(5, 2, 6));
    assert_int_equal(dse_linear_mhe_init(&other, &config, &arena), DSE_OK);
    for (int k = 0; k < STEPS; k++) {
        step(&mhe, &data, k);
        const struct dse_measurement first = sample_of(&gappy, k), second = sample_of(&data, k);
        if (k > 0)
            assert_int_equal(dse_linear_mhe_advance(&other, &data.u[k - 1]), DSE_OK);
        assert_int_equal(dse_linear_mhe_measure(&other, 0, &data.u[k], &first), DSE_OK);
        assert_int_equal(dse_linear_mhe_solve(&other), DSE_OK);
        assert_int_equal(dse_linear_mhe_measure(&other, 0, &data.u[k], &second), DSE_OK);
        assert_int_equal(dse_linear_mhe_solve(&other), DSE_OK);
        assert_memory_equal(dse_linear_mhe_window(&other), dse_linear_mhe_window(&mhe),
                            sizeof(dse_real) * 5 * (size_t)dse_linear_mhe_length(&mhe));
    }
}

static void missing_values_are_counted_and_told_apart(void **state)
{
    (void)state;
    enum { nx = 2, ny = 3, N = 3 };
    random_state = 9;
    struct system s;
    struct dse_linear_mhe mhe;
    random_system(&s, nx, ny, nx, nx, 1);
    const struct dse_linear_mhe_config config = config_of(&s, N, DSE_ARRIVAL_KALMAN);
    assert_int_equal(start(&mhe, &config), DSE_OK);
    const dse_real u = 1, y[ny] = {1, (dse_real)__builtin_nan(""), 2};
    const bool valid[ny] = {true, true, false}, nothing[ny] = {false, false, false};
    const struct dse_measurement some = {y, valid}, none = {y, nothing};
    const struct dse_linear_mhe_counts *counts = dse_linear_mhe_counts(&mhe);
    assert_int_equal(dse_linear_mhe_solve(&mhe), DSE_OK); /* the prior alone */
    assert_int_equal(dse_linear_mhe_health(&mhe), DSE_HEALTH_INITIALISING);
    assert_agree(nx, dse_linear_mhe_state(&mhe), s.x0, EPS);
    assert_int_equal(dse_linear_mhe_measure(&mhe, 0, &u, &some), DSE_OK);
    assert_int_equal(dse_linear_mhe_measure(&mhe, 0, &u, &some), DSE_OK);
    assert_true(counts->used == 2 && counts->replaced == 1 && counts->nonfinite == 2);
    assert_true(counts->missing == 2 && counts->late == 0);
    assert_int_equal(dse_linear_mhe_solve(&mhe), DSE_OK);
    assert_int_equal(dse_linear_mhe_health(&mhe), DSE_HEALTH_TRACKING);
    assert_int_equal(dse_linear_mhe_advance(&mhe, &u), DSE_OK);
    assert_int_equal(dse_linear_mhe_measure(&mhe, 0, &u, &none), DSE_OK);
    assert_int_equal(dse_linear_mhe_solve(&mhe), DSE_OK);
    assert_int_equal(dse_linear_mhe_health(&mhe), DSE_HEALTH_COASTING);
    assert_int_equal(dse_linear_mhe_measure(&mhe, 1, &u, &some), DSE_OK);
    assert_true(counts->late == 1 && counts->outdated == 0);
    assert_int_equal(dse_linear_mhe_measure(&mhe, 2, &u, &some), DSE_ENODATA);
    assert_int_equal(dse_linear_mhe_measure(&mhe, -1, &u, &some), DSE_EINVAL);
    assert_int_equal(dse_linear_mhe_measure(&mhe, 0, &y[1], &some), DSE_ENONFINITE);
    assert_true(counts->outdated == 1 && counts->used == 3);
    assert_int_equal(dse_linear_mhe_advance(&mhe, &y[1]), DSE_ENONFINITE);
    assert_int_equal(dse_linear_mhe_advance(&mhe, NULL), DSE_EINVAL);
}

/* A replaced value is the last one that came, in a window of its own as in the filter. */
static void a_value_that_comes_again_replaces_the_earlier_one(void **state)
{
    (void)state;
    enum { nx = 3, N = 4 };
    random_state = 10;
    struct system s;
    struct data data;
    struct filtered expected;
    struct dse_linear_mhe mhe;
    random_system(&s, nx, 2, nx, nx, 1);
    simulate(&s, 0, &data);
    filter(&s, &data, &expected);
    const struct dse_linear_mhe_config config = config_of(&s, N, DSE_ARRIVAL_KALMAN);
    assert_int_equal(start(&mhe, &config), DSE_OK);
    const dse_real wrong[2] = {100, -100};
    const struct dse_measurement mistake = {wrong, NULL};
    for (int k = 0; k < STEPS; k++) {
        if (k > 0)
            assert_int_equal(dse_linear_mhe_advance(&mhe, &data.u[k - 1]), DSE_OK);
        assert_int_equal(dse_linear_mhe_measure(&mhe, 0, &data.u[k], &mistake), DSE_OK);
        for (int age = k < N - 1 ? k : N - 1; age >= 0; age -= N - 1) {
            const struct dse_measurement right = sample_of(&data, k - age);
            assert_int_equal(dse_linear_mhe_measure(&mhe, age, &data.u[k - age], &right), DSE_OK);
        }
        const struct dse_measurement right = sample_of(&data, k);
        assert_int_equal(dse_linear_mhe_measure(&mhe, 0, &data.u[k], &right), DSE_OK);
        assert_int_equal(dse_linear_mhe_solve(&mhe), DSE_OK);
        assert_agree(nx, dse_linear_mhe_state(&mhe), expected.x[k], AGREEMENT);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(short_windows_without_arrival_cost_are_predicted_from_x0),
        cmocka_unit_test(a_gap_that_is_filled_leaves_no_trace),
        cmocka_unit_test(missing_values_are_counted_and_told_apart),
        cmocka_unit_test(a_value_that_comes_again_replaces_the_earlier_one),
    };
    return cmocka_run_group_tests_name("linear_mhe_windows", tests, NULL, NULL);
}
