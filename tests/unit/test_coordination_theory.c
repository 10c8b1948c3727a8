/* The coordination schemes without bounds: what they converge to, and the identities between
 * prices, multipliers and costs that the theory states. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "coordination_plant.h"
#include "dse/linalg.h"
#include "near.h"
#include "random_matrix.h"

/* The coordinator's test, and agreement of what has converged. */
#define EPS       TOLERANCE(1e-11, 1e-4)
#define AGREEMENT TOLERANCE(1e-8, 2e-3)
#define COUPLING  DSE_REAL(0.15)

static struct coordination_plant plant;
static struct coordination_window window;
static struct coordination net;

static void run_to(long k)
{
    for (long j = 0; j <= k; j++)
        coordination_sample(&net, j, plant.y[j], NULL);
}

static void start(enum dse_mhe_scheme scheme, dse_real eps)
{
    coordination_plant_network(&plant, scheme, eps, &net);
}

static void begin(void)
{
    assert_int_equal(coordination_start(&net), DSE_OK);
}

/* ---- what they converge to (R-10) ---- */

static void prediction_converges_to_the_centralised_window_at_every_length(void **state)
{
    (void)state;
    dse_real X[PLANT_X], expected[PLANT_X];
    coordination_plant_make(&plant, COUPLING);
    start(DSE_MHE_PREDICTION, EPS);
    begin();
    for (long k = 0; k < 20; k++) {
        coordination_sample(&net, k, plant.y[k], NULL);
        if (k == 0)
            continue;
        const int H = k + 1 < PLANT_H ? (int)k + 1 : PLANT_H;
        coordination_window_make(&plant, H, k, &window);
        coordination_window_solve(&window, false, expected);
        coordination_stack(&net, X);
        assert_all_near(window.states, X, expected, AGREEMENT);
    }
    coordination_free(&net);
}

static void price_converges_to_centralised_with_D_in_two_rounds_for_any_D_and_price(void **state)
{
    (void)state;
    static const dse_real penalties[] = {DSE_REAL(0.03), 1, 30};
    dse_real X[PLANT_X], expected[PLANT_X];
    for (size_t d = 0; d < 3; d++) {
        coordination_plant_make(&plant, COUPLING);
        coordination_plant_penalise(&plant, penalties[d]);
        start(DSE_MHE_PRICE, TOLERANCE(1e-9, 2e-3));
        net.config.price_start = DSE_MHE_START_PREVIOUS;
        begin();
        for (long k = 0; k < 20; k++) {
            for (int e = 0; e < PLANT_W; e++)
                net.coordinator.p[e] += uniform(); /* any price to start from */
            coordination_sample(&net, k, plant.y[k], NULL);
            if (k == 0)
                continue;
            assert_int_equal(dse_mhe_coordinator_iterations(&net.coordinator), 2);
            const int H = k + 1 < PLANT_H ? (int)k + 1 : PLANT_H;
            coordination_window_make(&plant, H, k, &window);
            coordination_window_solve(&window, true, expected);
            coordination_stack(&net, X);
            assert_all_near(window.states, X, expected, AGREEMENT);
        }
        coordination_free(&net);
    }
}

/* An agent alone with the plant whose stage cost is A_off'D^-1 A_off. */
static void interaction_cost_makes_the_centralised_estimator_that_of_the_prices(void **state)
{
    (void)state;
    dse_real cost[PLANT_N * PLANT_N], scratch[PLANT_N * PLANT_N + PLANT_BLOCK];
    dse_real C[PLANT_PARTS * PLANT_N] = {0}, Q[PLANT_N * PLANT_N] = {0};
    dse_real R[PLANT_PARTS * PLANT_PARTS] = {0}, x[PLANT_N];
    struct coordination_alone alone = {.memory = NULL};
    coordination_plant_make(&plant, COUPLING);
    assert_int_equal(
        dse_mhe_interaction_cost(PLANT_N, plant.A, PLANT_PARTS, plant.subsystems, cost, scratch),
        DSE_OK);
    for (int i = 0; i < PLANT_PARTS; i++) {
        C[i * PLANT_N + i * PLANT_NX] = 1;
        R[i * PLANT_PARTS + i] = plant.R[i][0];
        for (int e = 0; e < PLANT_BLOCK; e++)
            Q[(i * PLANT_NX + e / PLANT_NX) * PLANT_N + i * PLANT_NX + e % PLANT_NX] =
                plant.Q[i][e];
    }
    const struct dse_mhe_subsystem whole = {.nx = PLANT_N,
                                            .ny = PLANT_PARTS,
                                            .A = plant.A,
                                            .C = C,
                                            .Q = Q,
                                            .R = R,
                                            .x0 = plant.x0,
                                            .stage_cost = cost};
    assert_int_equal(coordination_alone_start(&alone, PLANT_H, 2, 0, &whole), DSE_OK);
    start(DSE_MHE_PRICE, TOLERANCE(1e-9, 2e-3));
    begin();
    for (long k = 0; k < 15; k++) {
        coordination_sample(&net, k, plant.y[k], NULL);
        coordination_alone_sample(&alone, k, plant.y[k], NULL);
        coordination_state(&net, x);
        assert_all_near(PLANT_N, x, dse_mhe_local_state(&alone.local), AGREEMENT);
    }
    free(alone.memory);
    coordination_free(&net);
}

static void re_centring_removes_the_bias_of_the_penalty(void **state)
{
    (void)state;
    dse_real X[PLANT_X], expected[PLANT_X], before = 0;
    coordination_plant_make(&plant, COUPLING);
    coordination_plant_penalise(&plant, 10);
    coordination_window_make(&plant, PLANT_H, 12, &window);
    coordination_window_solve(&window, false, expected);
    for (int passes = 0; passes < 4; passes++) {
        dse_real worst = 0;
        start(DSE_MHE_PRICE, TOLERANCE(1e-10, 2e-3));
        net.config.recentrings = passes;
        begin();
        run_to(12);
        coordination_stack(&net, X);
        for (int e = 0; e < window.states; e++)
            worst = dse_max(worst, dse_abs(X[e] - expected[e]));
        if (passes > 0 && before > TOLERANCE(1e-8, 1e-3))
            assert_true(worst < before / 2);
        before = worst;
        coordination_free(&net);
    }
}

/* ---- prices and multipliers (R-12) ---- */

static void multiplier(const dse_real *weights, const dse_real *w, dse_real *lambda)
{
    dse_mat_vec(window.transitions, window.transitions, weights, w, lambda);
}

static void price_is_the_multiplier_of_the_coupled_model(void **state)
{
    (void)state;
    dse_real X[PLANT_X], W[PLANT_W], expected[PLANT_W], H[PLANT_W], bias[PLANT_W];
    coordination_plant_make(&plant, COUPLING);
    coordination_window_make(&plant, PLANT_H, 12, &window);

    start(DSE_MHE_PREDICTION, EPS); /* p = Q^-1 W */
    begin();
    run_to(12);
    coordination_stack(&net, X);
    dse_mat_vec(window.transitions, window.states, window.GA, X, W);
    multiplier(window.Qi, W, expected);
    assert_agree(window.transitions, dse_mhe_coordinator_price(&net.coordinator), expected,
                 AGREEMENT);
    coordination_free(&net);

    start(DSE_MHE_PRICE, TOLERANCE(1e-9, 2e-3)); /* p = Q^-1 W - D^-1 H */
    begin();
    run_to(12);
    coordination_stack(&net, X);
    dse_mat_vec(window.transitions, window.states, window.GA, X, W);
    multiplier(window.Qi, W, expected);
    dse_mat_vec(window.transitions, window.states, window.Th, X, H);
    multiplier(window.Di, H, bias); /* H = -Th X */
    dse_axpy(window.transitions, 1, bias, expected);
    assert_agree(window.transitions, dse_mhe_coordinator_price(&net.coordinator), expected,
                 AGREEMENT);
    coordination_free(&net);
}

/* ---- duality (R-11, R-13) ---- */

/* The dual value after one round at the price in the coordinator, max_iter = 1. */
static dse_real dual_value(long k, const dse_real *p)
{
    dse_real sum = 0;
    start(DSE_MHE_PRICE, TOLERANCE(1e-12, 1e-6));
    net.config.price_start = DSE_MHE_START_PREVIOUS;
    begin();
    run_to(k - 1);
    memcpy(net.coordinator.p, p, (size_t)window.transitions * sizeof *p);
    net.coordinator.max_iter = 1;
    coordination_sample(&net, k, plant.y[k], NULL);
    for (int i = 0; i < PLANT_PARTS; i++)
        sum += dse_mhe_local_cost(&net.local[i]);
    coordination_free(&net);
    return sum;
}

static dse_real primal_value(const dse_real *X)
{
    dse_real sum = 0, v[PLANT_X], w[PLANT_W];
    dse_mat_vec(window.states, window.states, window.Psi, X, v);
    sum += dse_dot(window.states, X, v) / 2 - dse_dot(window.states, window.c, X);
    dse_mat_vec(window.transitions, window.states, window.Th, X, w);
    for (int e = 0; e < window.transitions; e++)
        sum += w[e] * w[e] * window.Di[e * window.transitions + e] / 2;
    return sum;
}

static void dual_value_never_exceeds_the_primal_one_and_meets_it_at_the_optimum(void **state)
{
    (void)state;
    dse_real X[PLANT_X], best[PLANT_W], p[PLANT_W];
    const long k = 12;
    coordination_plant_make(&plant, COUPLING);
    coordination_window_make(&plant, PLANT_H, k, &window);
    coordination_window_solve(&window, true, X);
    const dse_real primal = primal_value(X);
    start(DSE_MHE_PRICE, TOLERANCE(1e-9, 2e-3));
    begin();
    run_to(k);
    memcpy(best, dse_mhe_coordinator_price(&net.coordinator), sizeof best);
    coordination_free(&net);
    assert_near(dual_value(k, best), primal, TOLERANCE(1e-9, 1e-4) * dse_abs(primal));
    dse_real gap = 0;
    static const dse_real sizes[] = {DSE_REAL(0.1), 1, 10};
    for (int s = 0; s < 3; s++) {
        for (int e = 0; e < window.transitions; e++)
            p[e] = best[e] + sizes[s] * uniform();
        const dse_real value = dual_value(k, p);
        assert_true(value < primal);
        assert_true(primal - value > gap); /* and falls with the distance */
        gap = primal - value;
    }
}

static void gradient_of_the_dual_is_the_interaction_error_and_its_steps_converge(void **state)
{
    (void)state;
    coordination_plant_make(&plant, COUPLING);
    coordination_plant_penalise(&plant, DSE_REAL(0.5));
    dse_real error[3];
    static const int rounds[] = {1, 20, 400};
    for (int q = 0; q < 3; q++) {
        start(DSE_MHE_PRICE, TOLERANCE(1e-9, 1e-3));
        net.config.gradient_step = DSE_REAL(0.3);
        net.config.price_start = DSE_MHE_START_ZERO;
        begin();
        net.coordinator.max_iter = 2;
        run_to(11);
        net.coordinator.max_iter = rounds[q];
        coordination_sample(&net, 12, plant.y[12], NULL);
        error[q] = dse_mhe_coordinator_error(&net.coordinator);
        coordination_free(&net);
    }
    assert_true(error[1] < error[0] / 2);
    assert_true(error[2] < error[1] / 100);
}

/* ---- identities of the prediction-driven scheme ---- */

/* p'Th_i X_i = Gamma_i X_i, Gamma_i = (dJ_D/dH)(dH/dX_i): the derivative of the cost of the
 * disturbances with respect to the interactions, by central differences (CDM-19, R-14). */
static void coordinating_term_is_the_derivative_of_the_neighbours_cost(void **state)
{
    (void)state;
    dse_real X[PLANT_X], direction[PLANT_X] = {0}, W[PLANT_W], p[PLANT_W], ThX[PLANT_W];
    coordination_plant_make(&plant, COUPLING);
    coordination_window_make(&plant, PLANT_H, 12, &window);
    fill(window.states, X);
    const int size = PLANT_H * PLANT_NX, i = 1; /* of subsystem i */
    memcpy(direction + i * size, X + i * size, (size_t)size * sizeof *X);
    dse_mat_vec(window.transitions, window.states, window.GA, X, W);
    multiplier(window.Qi, W, p);
    dse_mat_vec(window.transitions, window.states, window.Th, direction, ThX);
    const dse_real term = dse_dot(window.transitions, p, ThX);
    /* J_D(h) = 1/2 |Gb X - h|^2_{Q^-1} at h = -Th X, moved by -Th_i X_i */
    dse_real J[2];
    const dse_real step = TOLERANCE(1e-4, 1e-2);
    for (int side = 0; side < 2; side++) {
        dse_real moved[PLANT_W], weighted[PLANT_W];
        memcpy(moved, W, sizeof moved);
        dse_axpy(window.transitions, side == 0 ? -step : step, ThX, moved);
        multiplier(window.Qi, moved, weighted);
        J[side] = dse_dot(window.transitions, moved, weighted) / 2;
    }
    assert_near((J[1] - J[0]) / (2 * step), term, TOLERANCE(1e-8, 1e-2));
}

/* CDM-24: with triggers eps_i, at the end the answers that were held back are that close. */
static void triggers_leave_no_more_than_their_bound(void **state)
{
    (void)state;
    const dse_real trigger = DSE_REAL(0.01), eps = DSE_REAL(0.01);
    coordination_plant_make(&plant, COUPLING);
    for (int i = 0; i < PLANT_PARTS; i++)
        plant.subsystems[i].trigger = trigger;
    start(DSE_MHE_PREDICTION, eps);
    begin();
    int held_back = 0;
    for (long k = 0; k < 30; k++) {
        coordination_sample(&net, k, plant.y[k], NULL);
        dse_real sum = 0, bound = eps * eps;
        for (int i = 0; i < PLANT_PARTS && k > 0; i++) {
            const struct dse_mhe_local *local = &net.local[i];
            const dse_real *answer = local->kept.X, *known = dse_mhe_local_window(local);
            assert_all_near(local->length * PLANT_NX,
                            dse_mhe_coordinator_window(&net.coordinator, i), known, 0);
            for (int e = 0; e < local->length * PLANT_NX; e++)
                sum += (answer[e] - known[e]) * (answer[e] - known[e]);
            bound += dse_mhe_local_has_sent(local) ? 0 : trigger * trigger;
            held_back += !dse_mhe_local_has_sent(local);
        }
        assert_true(sum <= bound);
    }
    assert_true(held_back > 10);
    coordination_free(&net);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(prediction_converges_to_the_centralised_window_at_every_length),
        cmocka_unit_test(price_converges_to_centralised_with_D_in_two_rounds_for_any_D_and_price),
        cmocka_unit_test(interaction_cost_makes_the_centralised_estimator_that_of_the_prices),
        cmocka_unit_test(re_centring_removes_the_bias_of_the_penalty),
        cmocka_unit_test(price_is_the_multiplier_of_the_coupled_model),
        cmocka_unit_test(dual_value_never_exceeds_the_primal_one_and_meets_it_at_the_optimum),
        cmocka_unit_test(gradient_of_the_dual_is_the_interaction_error_and_its_steps_converge),
        cmocka_unit_test(coordinating_term_is_the_derivative_of_the_neighbours_cost),
        cmocka_unit_test(triggers_leave_no_more_than_their_bound),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
