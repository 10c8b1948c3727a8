/* The linear moving horizon estimator: what cannot be estimated, and what is refused. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "linear_mhe_rig.h"

static void a_window_that_does_not_determine_the_states_says_so(void **state)
{
    (void)state;
    const dse_real A[4] = {1, 1, 0, 1}, C[2] = {1, 0}, R[1] = {1}, Q[4] = {1, 0, 0, 1};
    const struct dse_linear_mhe_config config = {.nx = 2,
                                                 .ny = 1,
                                                 .linear = {A, NULL, C, NULL},
                                                 .horizon = 3,
                                                 .arrival = DSE_ARRIVAL_NONE,
                                                 .Q = Q,
                                                 .R = R};
    struct dse_linear_mhe mhe;
    assert_int_equal(start(&mhe, &config), DSE_OK);
    dse_real x[2] = {0, 0};
    for (int k = 0; k < 12; k++) {
        const dse_real y = uniform();
        const bool valid = k < 4 || k > 7; /* two of three samples are too few, one is missing */
        const struct dse_measurement sample = {&y, &valid};
        if (k > 0)
            assert_int_equal(dse_linear_mhe_advance(&mhe, NULL), DSE_OK);
        assert_int_equal(dse_linear_mhe_measure(&mhe, 0, NULL, &sample), DSE_OK);
        const bool determined = k < 5 || k > 8;
        assert_int_equal(dse_linear_mhe_solve(&mhe), determined ? DSE_OK : DSE_ESINGULAR);
        if (determined) {
            for (int i = 0; i < 2; i++)
                x[i] = dse_linear_mhe_state(&mhe)[i];
        } else {
            assert_int_equal(dse_linear_mhe_health(&mhe), DSE_HEALTH_UNOBSERVABLE);
            assert_true(dse_linear_mhe_sample(&mhe) == 4);
            assert_agree(2, dse_linear_mhe_state(&mhe), x, 0);
        }
    }
}

/* A state that the outputs never see, mixed with the others: only rounding makes the window
 * regular. */
static void a_hidden_state_is_not_taken_for_an_observed_one(void **state)
{
    (void)state;
    enum { nx = 3 };
    random_state = 15;
    for (int trial = 0; trial < 100; trial++) {
        dse_real T[9], copy[9], inverse[9], A[9], C[3], part[9];
        const dse_real modes[9] = {DSE_REAL(0.5), 1, 0, 0, DSE_REAL(0.7), 0, 0, 0, DSE_REAL(0.9)};
        const dse_real seen[3] = {1, 0, 0}, R[1] = {1}, Q[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
        for (int i = 0; i < 9; i++) { /* diagonally dominant: well conditioned */
            T[i] = (i % 4 == 0 ? 3 : 0) + uniform();
            copy[i] = T[i];
        }
        dense_inverse(nx, copy, inverse); /* z = T^-1 x, z+ = modes z, y = z_0 */
        dense_product(nx, nx, nx, T, modes, 0, part);
        dense_product(nx, nx, nx, part, inverse, 0, A);
        dense_product(1, nx, nx, seen, inverse, 0, C);
        const struct dse_linear_mhe_config config = {.nx = nx,
                                                     .ny = 1,
                                                     .linear = {A, NULL, C, NULL},
                                                     .horizon = 6,
                                                     .arrival = DSE_ARRIVAL_NONE,
                                                     .Q = Q,
                                                     .R = R};
        struct dse_linear_mhe mhe;
        assert_int_equal(start(&mhe, &config), DSE_OK);
        for (int k = 0; k < 8; k++) {
            const dse_real y = uniform();
            const struct dse_measurement sample = {&y, NULL};
            if (k > 0)
                assert_int_equal(dse_linear_mhe_advance(&mhe, NULL), DSE_OK);
            assert_int_equal(dse_linear_mhe_measure(&mhe, 0, NULL, &sample), DSE_OK);
            assert_int_equal(dse_linear_mhe_solve(&mhe), k + 1 < nx ? DSE_OK : DSE_ESINGULAR);
        }
        assert_int_equal(dse_linear_mhe_health(&mhe), DSE_HEALTH_UNOBSERVABLE);
    }
}

static void overflow_is_reported_and_the_estimate_kept(void **state)
{
    (void)state;
    const dse_real huge = DSE_REAL_MAX / 4, A[1] = {huge}, C[1] = {1}, R[1] = {1}, P0[1] = {1};
    const struct dse_linear_mhe_config config = {
        .nx = 1, .ny = 1, .linear = {A, NULL, C, NULL}, .horizon = 1, .P0 = P0, .R = R};
    struct dse_linear_mhe mhe;
    assert_int_equal(start(&mhe, &config), DSE_OK);
    const dse_real y = 100;
    const struct dse_measurement sample = {&y, NULL};
    assert_int_equal(dse_linear_mhe_measure(&mhe, 0, NULL, &sample), DSE_OK);
    assert_int_equal(dse_linear_mhe_solve(&mhe), DSE_OK);
    const dse_real x = dse_linear_mhe_state(&mhe)[0];
    assert_true(dse_abs(x - 50) < 1000 * EPS);
    assert_int_equal(dse_linear_mhe_advance(&mhe, NULL), DSE_ENONFINITE);
    assert_int_equal(dse_linear_mhe_solve(&mhe), DSE_OK); /* nothing has changed */
    assert_true(dse_linear_mhe_state(&mhe)[0] == x && dse_linear_mhe_sample(&mhe) == 0);
}

static void impossible_configurations_are_refused_with_their_own_code(void **state)
{
    (void)state;
    random_state = 11;
    struct system s;
    random_system(&s, 3, 2, 3, 3, 1);
    const struct dse_linear_mhe_config good = config_of(&s, 4, DSE_ARRIVAL_KALMAN);
    const dse_real nan = (dse_real)__builtin_nan("");
    const dse_real indefinite[9] = {1, 2, 0, 2, 1, 0, 0, 0, 1}, spoiled[9] = {nan, 0, 0, 0, 1};
    const dse_real negative[4] = {1, 2, 2, 1},
                   lopsided[9] = {1, 0, 0, DSE_REAL(0.5), 1, 0, 0, 0, 1};
    enum { CASES = 22 };
    struct dse_linear_mhe_config c[CASES];
    enum dse_status expected[CASES];
    for (int i = 0; i < CASES; i++) {
        c[i] = good;
        expected[i] = i < 15 ? DSE_EINVAL : DSE_ENONFINITE;
    }
    c[0].nx = 0;
    c[1].ny = 0;
    c[2].nu = -1;
    c[3].horizon = 0;
    c[4].linear.A = NULL;
    c[5].linear.B = NULL;
    c[6].linear.C = NULL;
    c[7].R = NULL;
    c[8].P0 = NULL;
    c[9].min_horizon = 5;
    c[10].arrival = (enum dse_arrival)3;
    c[11].tolerance = nan;
    c[12].tolerance = -1;
    c[13].P0 = lopsided;
    c[14].Q = lopsided;
    c[15].P0 = spoiled;
    c[16].Q = spoiled;
    c[17].linear.A = spoiled;
    c[18].x0 = spoiled;
    c[19].P0 = indefinite;
    c[20].Q = indefinite;
    c[21].R = negative;
    expected[19] = expected[20] = expected[21] = DSE_ENOTPD;
    struct dse_linear_mhe mhe;
    for (int i = 0; i < CASES; i++)
        assert_int_equal(start(&mhe, &c[i]), expected[i]);
    struct dse_linear_mhe_config free_start = good;
    free_start.arrival = DSE_ARRIVAL_NONE;
    free_start.P0 = NULL;
    free_start.Q = NULL;
    free_start.x0 = NULL;
    assert_int_equal(start(&mhe, &free_start), DSE_OK);
    assert_int_equal(start(&mhe, &good), DSE_OK);
}

static void storage_constant_is_what_init_takes(void **state)
{
    (void)state;
    random_state = 12;
    for (int nx = 1; nx <= NX_MAX; nx += 3) {
        for (int ny = 1; ny <= NY_MAX; ny++) {
            struct system s;
            struct dse_linear_mhe mhe;
            struct dse_arena arena;
            random_system(&s, nx, ny, nx, nx, 1);
            const struct dse_linear_mhe_config config = config_of(&s, 5, DSE_ARRIVAL_KALMAN);
            const int size = DSE_LINEAR_MHE_STORAGE(nx, ny, 5);
            dse_arena_init(&arena, memory, size);
            assert_int_equal(dse_linear_mhe_init(&mhe, &config, &arena), DSE_OK);
            assert_int_equal(arena.used, size);
            dse_arena_init(&arena, memory, size - 1);
            assert_int_equal(dse_linear_mhe_init(&mhe, &config, &arena), DSE_ESTORAGE);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_window_that_does_not_determine_the_states_says_so),
        cmocka_unit_test(a_hidden_state_is_not_taken_for_an_observed_one),
        cmocka_unit_test(overflow_is_reported_and_the_estimate_kept),
        cmocka_unit_test(impossible_configurations_are_refused_with_their_own_code),
        cmocka_unit_test(storage_constant_is_what_init_takes),
    };
    return cmocka_run_group_tests_name("linear_mhe_failures", tests, NULL, NULL);
}
