/* The linear moving horizon estimator is the Kalman filter where it has to be. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "linear_mhe_rig.h"

static void equals_the_kalman_filter_on_a_thousand_random_systems(void **state)
{
    (void)state;
    random_state = 1;
    for (int trial = 0; trial < 1000; trial++) {
        const int nx = 1 + trial % NX_MAX, ny = 1 + choose(NY_MAX), N = 1 + choose(N_MAX);
        const int noise_rank = trial % 3 == 0 ? nx : choose(nx + 1);
        const int prior_rank = trial % 5 == 0 ? choose(nx + 1) : nx;
        struct system s;
        struct data data;
        struct filtered expected;
        struct dse_linear_mhe mhe;
        dse_real P[NX_MAX * NX_MAX];
        random_system(&s, nx, ny, noise_rank, prior_rank, trial % 2 ? 2 : 1);
        simulate(&s, trial % 4 == 0 ? 0 : 25, &data);
        filter(&s, &data, &expected);
        const struct dse_linear_mhe_config config = config_of(&s, N, DSE_ARRIVAL_KALMAN);
        assert_int_equal(start(&mhe, &config), DSE_OK);
        for (int k = 0; k < STEPS; k++) {
            step(&mhe, &data, k);
            assert_agree(nx, dse_linear_mhe_state(&mhe), expected.x[k], AGREEMENT);
            assert_int_equal(dse_linear_mhe_covariance(&mhe, P), DSE_OK);
            assert_agree(nx * nx, P, expected.P[k], AGREEMENT);
            assert_true(dse_linear_mhe_certificate(&mhe) < TIGHT);
        }
    }
}

/* Samples of the window without a value in some channel. */
static int count_incomplete(const struct dse_linear_mhe *mhe)
{
    int count = 0;
    for (int j = 0; j < mhe->length; j++) {
        const dse_real *has = mhe->has + (mhe->newest - j) % mhe->N * mhe->ny;
        count += has[0] == 0 || has[1] == 0;
    }
    return count;
}

/* Values come up to N - 1 samples late: as soon as all are there, the estimate is that of the
 * filter that had them in time. */
static void late_values_count_as_if_they_had_come_in_time(void **state)
{
    (void)state;
    enum { N = 5, LATE = N - 1 };
    random_state = 2;
    for (int nx = 1; nx <= NX_MAX; nx++) {
        struct system s;
        struct data data, delayed;
        struct filtered expected;
        struct dse_linear_mhe mhe;
        random_system(&s, nx, 2, nx / 2, nx, 1);
        simulate(&s, 10, &data);
        filter(&s, &data, &expected);
        delayed = data;
        for (int k = 0; k < STEPS - LATE; k++) /* channel 1 comes late, or with the others */
            delayed.valid[k][1] = delayed.valid[k][1] && k % 3 == 0;
        const struct dse_linear_mhe_config config = config_of(&s, N, DSE_ARRIVAL_KALMAN);
        assert_int_equal(start(&mhe, &config), DSE_OK);
        for (int k = 0; k < STEPS; k++) {
            step(&mhe, &delayed, k);
            if (k < LATE)
                continue;
            const bool only_late[2] = {false, data.valid[k - LATE][1]};
            const struct dse_measurement late = {data.y[k - LATE], only_late};
            assert_int_equal(mhe.incomplete, count_incomplete(&mhe));
            assert_int_equal(dse_linear_mhe_measure(&mhe, LATE, &data.u[k - LATE], &late), DSE_OK);
            assert_int_equal(mhe.incomplete, count_incomplete(&mhe));
        }
        assert_int_equal(dse_linear_mhe_solve(&mhe), DSE_OK);
        assert_agree(nx, dse_linear_mhe_state(&mhe), expected.x[STEPS - 1], AGREEMENT);
        assert_true(dse_linear_mhe_counts(&mhe)->late > 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(equals_the_kalman_filter_on_a_thousand_random_systems),
        cmocka_unit_test(late_values_count_as_if_they_had_come_in_time),
    };
    return cmocka_run_group_tests_name("linear_mhe", tests, NULL, NULL);
}
