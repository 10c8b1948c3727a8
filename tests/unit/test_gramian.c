/* Gramians: closed forms, and the assumptions of distributed filters on the swinging plant. */
#include "dse/gramian.h"

#include "dse/linalg.h"
#include "kalman_network.h"
#include "near.h"

static dse_real scratch[DSE_GRAMIAN_SCRATCH(2, 2)];

/* A double integrator: Phi = [1 t; 0 1], so that C = [1 0] gives M = [T, T^2/2; T^2/2, T^3/3]. */
static const dse_real integrators[4] = {0, 1, 0, 0}, position[2] = {1, 0}, speed[2] = {0, 1};

static struct dse_model linear(const struct dse_linear *parts, enum dse_time_kind time)
{
    struct dse_model model;
    dse_linear_model(&model, time, 2, 0, 0, parts);
    return model;
}

static void observability_of_a_double_integrator_is_its_closed_form(void **state)
{
    (void)state;
    const struct dse_linear parts = {.A = integrators};
    const struct dse_model model = linear(&parts, DSE_CONTINUOUS);
    const struct dse_window window = {&model, 0, 3, 6};
    const dse_real want[4] = {3, DSE_REAL(4.5), DSE_REAL(4.5), 9};
    dse_real M[4];
    assert_int_equal(dse_observability_gramian(&window, 1, position, M, scratch), DSE_OK);
    assert_all_near(4, M, want, TOLERANCE(1e-12, 1e-4));
    assert_true(dse_gramian_quality(2, M, scratch) > DSE_REAL(0.01));
}

static void speed_alone_does_not_tell_the_position(void **state)
{
    (void)state;
    const struct dse_linear parts = {.A = integrators};
    const struct dse_model model = linear(&parts, DSE_CONTINUOUS);
    const struct dse_window window = {&model, 0, 3, 6};
    dse_real M[4];
    assert_int_equal(dse_observability_gramian(&window, 1, speed, M, scratch), DSE_OK);
    assert_true(dse_gramian_quality(2, M, scratch) == 0);
}

/* W = int_0^T [s 1]' [s 1] ds for a force: [T^3/3, T^2/2; T^2/2, T]. */
static void controllability_of_a_double_integrator_is_its_closed_form(void **state)
{
    (void)state;
    const struct dse_linear parts = {.A = integrators};
    const struct dse_model model = linear(&parts, DSE_CONTINUOUS);
    const struct dse_window window = {&model, 0, 3, 6};
    const dse_real force[4] = {0, 0, 0, 1}, push[4] = {1, 0, 0, 0};
    const dse_real want[4] = {9, DSE_REAL(4.5), DSE_REAL(4.5), 3};
    dse_real W[4];
    assert_int_equal(dse_controllability_gramian(&window, force, W, scratch), DSE_OK);
    assert_all_near(4, W, want, TOLERANCE(1e-12, 1e-4));
    assert_int_equal(dse_controllability_gramian(&window, push, W, scratch), DSE_OK);
    assert_true(dse_gramian_quality(2, W, scratch) == 0); /* the speed is never reached */
}

static void discrete_sums_are_those_by_hand(void **state)
{
    (void)state;
    const dse_real A[4] = {1, 1, 0, 1}, G[4] = {0, 0, 0, 1};
    const struct dse_linear parts = {.A = A};
    const struct dse_model model = linear(&parts, DSE_DISCRETE);
    const struct dse_window window = {&model, 0, 0, 3};
    /* rows C A^k = [1 k], k = 0, 1, 2; columns A^k g = [k 1]' */
    const dse_real M_want[4] = {3, 3, 3, 5}, W_want[4] = {5, 3, 3, 3};
    dse_real M[4], W[4];
    assert_int_equal(dse_observability_gramian(&window, 1, position, M, scratch), DSE_OK);
    assert_all_near(4, M, M_want, TOLERANCE(1e-14, 1e-6));
    assert_int_equal(dse_controllability_gramian(&window, G, W, scratch), DSE_OK);
    assert_all_near(4, W, W_want, TOLERANCE(1e-14, 1e-6));
}

/* Assumptions 2.2 and 2.3: every node observes the plant alone, the noise excites all of it. */
static void swinging_plant_meets_the_assumptions_for_both_sensors(void **state)
{
    (void)state;
    const struct dse_model model = swinging_plant();
    const dse_real noise[4] = {1, 0, 0, 1};
    dse_real X[4];
    for (int k = 0; k < 8; k++) {
        const struct dse_window window = {&model, (dse_real)k, 1, 50};
        assert_int_equal(dse_observability_gramian(&window, 1, position, X, scratch), DSE_OK);
        assert_true(dse_gramian_quality(2, X, scratch) > DSE_REAL(0.1));
        assert_int_equal(dse_observability_gramian(&window, 1, speed, X, scratch), DSE_OK);
        assert_true(dse_gramian_quality(2, X, scratch) > DSE_REAL(0.1));
        assert_int_equal(dse_controllability_gramian(&window, noise, X, scratch), DSE_OK);
        assert_true(dse_gramian_quality(2, X, scratch) > DSE_REAL(0.1));
    }
}

static void windows_that_are_none_are_refused(void **state)
{
    (void)state;
    const struct dse_model model = swinging_plant();
    struct dse_model blind = model;
    blind.dfdx = NULL;
    const struct dse_window bad[] = {
        {NULL, 0, 1, 5}, {&blind, 0, 1, 5}, {&model, 0, 0, 5}, {&model, 0, 1, 0}};
    dse_real M[4];
    for (size_t k = 0; k < sizeof bad / sizeof bad[0]; k++) {
        assert_int_equal(dse_observability_gramian(&bad[k], 1, position, M, scratch), DSE_EINVAL);
        assert_int_equal(dse_controllability_gramian(&bad[k], M, M, scratch), DSE_EINVAL);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(observability_of_a_double_integrator_is_its_closed_form),
        cmocka_unit_test(speed_alone_does_not_tell_the_position),
        cmocka_unit_test(controllability_of_a_double_integrator_is_its_closed_form),
        cmocka_unit_test(discrete_sums_are_those_by_hand),
        cmocka_unit_test(swinging_plant_meets_the_assumptions_for_both_sensors),
        cmocka_unit_test(windows_that_are_none_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
