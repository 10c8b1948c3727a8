/* The coordination schemes with bounds: they reach the centralised optimum with the same bounds,
 * and what happens when there is none. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "coordination_plant.h"
#include "near.h"

#define AGREEMENT TOLERANCE(1e-7, 5e-3)
#define COUPLING  DSE_REAL(0.15)
enum { LENGTH = 30 };

static struct coordination_plant plant;
static struct coordination net;
static struct coordination_alone alone;

/* Bounds of the plant; those of a subsystem are a part of them. */
static dse_real x_min[PLANT_N], x_max[PLANT_N], w_min[PLANT_N], w_max[PLANT_N];

static void bound(dse_real x_size, dse_real w_size)
{
    for (int i = 0; i < PLANT_N; i++) {
        x_min[i] = -x_size;
        x_max[i] = x_size;
        w_min[i] = -w_size;
        w_max[i] = w_size;
    }
    for (int i = 0; i < PLANT_PARTS; i++) {
        plant.subsystems[i].x_min = x_min + i * PLANT_NX;
        plant.subsystems[i].x_max = x_max + i * PLANT_NX;
        plant.subsystems[i].w_min = w_min + i * PLANT_NX;
        plant.subsystems[i].w_max = w_max + i * PLANT_NX;
    }
}

/* The agent alone with the plant. */
static dse_real C[PLANT_PARTS * PLANT_N], Q[PLANT_N * PLANT_N], R[PLANT_PARTS * PLANT_PARTS];
static dse_real cost[PLANT_N * PLANT_N];
static struct dse_mhe_subsystem whole;

static void start_alone(bool with_D, dse_real barrier)
{
    dse_real scratch[PLANT_N * PLANT_N + PLANT_BLOCK];
    memset(Q, 0, sizeof Q);
    for (int i = 0; i < PLANT_PARTS; i++) {
        C[i * PLANT_N + i * PLANT_NX] = 1;
        R[i * PLANT_PARTS + i] = plant.R[i][0];
        for (int e = 0; e < PLANT_BLOCK; e++)
            Q[(i * PLANT_NX + e / PLANT_NX) * PLANT_N + i * PLANT_NX + e % PLANT_NX] =
                plant.Q[i][e];
    }
    assert_int_equal(
        dse_mhe_interaction_cost(PLANT_N, plant.A, PLANT_PARTS, plant.subsystems, cost, scratch),
        DSE_OK);
    whole = (struct dse_mhe_subsystem){.nx = PLANT_N,
                                       .ny = PLANT_PARTS,
                                       .A = plant.A,
                                       .C = C,
                                       .Q = Q,
                                       .R = R,
                                       .x0 = plant.x0,
                                       .x_min = x_min,
                                       .x_max = x_max,
                                       .w_min = w_min,
                                       .w_max = w_max,
                                       .stage_cost = with_D ? cost : NULL};
    memset(&alone, 0, sizeof alone);
    assert_int_equal(coordination_alone_start(&alone, PLANT_H, 2, (double)barrier, &whole), DSE_OK);
}

/* Both side by side; how many samples had active bounds. */
static int compare(bool with_D)
{
    dse_real x[PLANT_N];
    int bounded = 0;
    start_alone(with_D, net.settings.barrier);
    assert_int_equal(coordination_start(&net), DSE_OK);
    for (long k = 0; k < LENGTH; k++) {
        const enum dse_mhe_outcome outcome = coordination_sample(&net, k, plant.y[k], NULL);
        coordination_alone_sample(&alone, k, plant.y[k], NULL);
        assert_int_equal(outcome, k == 0 ? DSE_MHE_OUTCOME_STARTING : DSE_MHE_OUTCOME_CONVERGED);
        coordination_state(&net, x);
        assert_all_near(PLANT_N, x, dse_mhe_local_state(&alone.local), AGREEMENT);
        bounded += dse_mhe_local_active(&alone.local) > 0;
    }
    coordination_free(&net);
    free(alone.memory);
    return bounded;
}

static void prices_reach_the_bounded_optimum_from_every_start(void **state)
{
    (void)state;
    static const enum dse_mhe_price_start starts[] = {DSE_MHE_START_DEFAULT, DSE_MHE_START_ZERO,
                                                      DSE_MHE_START_PREVIOUS};
    for (size_t s = 0; s < 3; s++) {
        coordination_plant_make(&plant, COUPLING);
        bound(DSE_REAL(1.5), DSE_REAL(0.5));
        coordination_plant_network(&plant, DSE_MHE_PRICE, TOLERANCE(1e-9, 1e-3), &net);
        net.config.price_start = starts[s];
        assert_true(compare(true) > LENGTH / 2);
    }
}

static void bounds_that_are_not_reached_change_nothing(void **state)
{
    (void)state;
    coordination_plant_make(&plant, COUPLING);
    bound(1000, 1000);
    coordination_plant_network(&plant, DSE_MHE_PRICE, TOLERANCE(1e-9, 1e-3), &net);
    net.config.price_start = DSE_MHE_START_CLOSED_FORM;
    assert_int_equal(compare(true), 0);
    /* and the closed-form price is it: the question without bounds, and the test of the answer */
    assert_int_equal(dse_mhe_coordinator_iterations(&net.coordinator), 2);
}

static void prices_reach_the_bounded_optimum_after_re_centring(void **state)
{
    (void)state;
    coordination_plant_make(&plant, COUPLING);
    coordination_plant_penalise(&plant, 100);
    bound(DSE_REAL(1.5), DSE_REAL(0.5));
    coordination_plant_network(&plant, DSE_MHE_PRICE, TOLERANCE(1e-10, 1e-3), &net);
    net.config.recentrings = 4;
    net.config.max_iter = 1000;
    assert_true(compare(false) > LENGTH / 2);
}

static void accelerated_predictions_reach_the_bounded_optimum(void **state)
{
    (void)state;
    coordination_plant_make(&plant, COUPLING);
    bound(DSE_REAL(1.5), DSE_REAL(0.5));
    coordination_plant_network(&plant, DSE_MHE_PREDICTION, TOLERANCE(1e-9, 1e-3), &net);
    net.config.anderson = 8;
    assert_true(compare(false) > LENGTH / 2);
}

static void under_relaxed_predictions_reach_it_more_slowly(void **state)
{
    (void)state;
    int rounds[2];
    for (int relaxed = 0; relaxed < 2; relaxed++) {
        coordination_plant_make(&plant, DSE_REAL(0.05));
        bound(DSE_REAL(1.5), DSE_REAL(0.5));
        coordination_plant_network(&plant, DSE_MHE_PREDICTION, TOLERANCE(1e-9, 1e-3), &net);
        net.config.relaxation = relaxed ? DSE_REAL(0.5) : 0;
        assert_true(compare(false) > LENGTH / 3);
        rounds[relaxed] = dse_mhe_coordinator_iterations(&net.coordinator);
    }
    assert_true(rounds[1] > rounds[0]);
}

static void predictions_with_a_barrier_reach_the_optimum_with_that_barrier(void **state)
{
    (void)state;
    coordination_plant_make(&plant, DSE_REAL(0.05));
    bound(DSE_REAL(1.5), DSE_REAL(0.5));
    coordination_plant_network(&plant, DSE_MHE_PREDICTION, TOLERANCE(1e-9, 1e-3), &net);
    net.settings.barrier = TOLERANCE(1e6, 1e3);
    (void)compare(false);
}

/* CDM-22: the barrier's estimate comes from inside to that of the hard bounds. */
static void barrier_approaches_hard_bounds_from_inside(void **state)
{
    (void)state;
    static const double steepness[] = {1e2, 1e3, 1e4};
    struct coordination_alone hard = {.memory = NULL};
    dse_real before = 0;
    coordination_plant_make(&plant, COUPLING);
    bound(DSE_REAL(1.5), DSE_REAL(0.5));
    for (int s = 0; s < 3; s++) {
        dse_real worst = 0;
        start_alone(false, (dse_real)steepness[s]);
        assert_int_equal(coordination_alone_start(&hard, PLANT_H, 2, 0, &whole), DSE_OK);
        for (long k = 0; k < LENGTH; k++) {
            coordination_alone_sample(&alone, k, plant.y[k], NULL);
            coordination_alone_sample(&hard, k, plant.y[k], NULL);
            for (int i = 0; i < PLANT_N && k > 0; i++) {
                const dse_real x = dse_mhe_local_state(&alone.local)[i];
                assert_true(x_min[i] < x && x < x_max[i]);
                worst = dse_max(worst, dse_abs(x - dse_mhe_local_state(&hard.local)[i]));
            }
            /* single precision resolves the distance to a bound to about a thousandth */
            assert_true(dse_mhe_local_certificate(&alone.local) < TOLERANCE(1e-10, 2e-2));
        }
        assert_true(s == 0 || worst < before / 2);
        before = worst;
        free(alone.memory);
        free(hard.memory);
    }
}

/* States that have to be large with disturbances that have to be small. */
static void bounds_that_contradict_each_other_are_said_to_be_infeasible(void **state)
{
    (void)state;
    coordination_plant_make(&plant, COUPLING);
    bound(10, DSE_REAL(0.01));
    for (int i = 0; i < PLANT_N; i++)
        x_min[i] = 9;
    start_alone(false, 0);
    for (long k = 0; k < 5; k++) {
        coordination_alone_sample(&alone, k, plant.y[k], NULL);
        assert_int_equal(dse_mhe_local_status(&alone.local),
                         k == 0 ? DSE_MHE_STARTING : DSE_MHE_INFEASIBLE);
        assert_int_equal(dse_mhe_local_health(&alone.local),
                         k == 0 ? DSE_HEALTH_INITIALISING : DSE_HEALTH_REJECTING);
    }
    /* open-loop prediction is all that is left */
    dse_real x[PLANT_N], next[PLANT_N];
    memcpy(x, plant.x0, sizeof x);
    for (int k = 0; k < 4; k++) {
        for (int i = 0; i < PLANT_N; i++) {
            next[i] = 0;
            for (int j = 0; j < PLANT_N; j++)
                next[i] += plant.A[i * PLANT_N + j] * x[j];
        }
        memcpy(x, next, sizeof x);
    }
    assert_all_near(PLANT_N, dse_mhe_local_state(&alone.local), x, TOLERANCE(1e-12, 1e-5));
    free(alone.memory);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(prices_reach_the_bounded_optimum_from_every_start),
        cmocka_unit_test(bounds_that_are_not_reached_change_nothing),
        cmocka_unit_test(prices_reach_the_bounded_optimum_after_re_centring),
        cmocka_unit_test(accelerated_predictions_reach_the_bounded_optimum),
        cmocka_unit_test(under_relaxed_predictions_reach_it_more_slowly),
        cmocka_unit_test(predictions_with_a_barrier_reach_the_optimum_with_that_barrier),
        cmocka_unit_test(barrier_approaches_hard_bounds_from_inside),
        cmocka_unit_test(bounds_that_contradict_each_other_are_said_to_be_infeasible),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
