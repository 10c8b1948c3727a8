/* Agents and coordinator: what they refuse, in configurations and in messages, and what they say
 * when a problem has no solution. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "coordination_plant.h"
#include "near.h"

#define AGREEMENT TOLERANCE(1e-8, 2e-3)
enum { SAMPLE, ROUND, LENGTH, FLAGS }; /* of a message's header */

static struct coordination_plant plant;
static struct coordination net;
static dse_real down[DSE_MHE_DOWN_SIZE(PLANT_NX, PLANT_H)];
static dse_real up[DSE_MHE_UP_SIZE(PLANT_NX, 1, PLANT_H)];

static void start(enum dse_mhe_scheme scheme)
{
    coordination_plant_make(&plant, DSE_REAL(0.15));
    coordination_plant_network(&plant, scheme, TOLERANCE(1e-9, 1e-3), &net);
}

/* All agents at the first round of sample k, no message exchanged in it yet. */
static void open_round(long k)
{
    for (long j = 0; j < k; j++)
        coordination_sample(&net, j, plant.y[j], NULL);
    assert_int_equal(dse_mhe_coordinator_begin(&net.coordinator, k), DSE_OK);
    for (int i = 0; i < PLANT_PARTS; i++) {
        const struct dse_measurement y = {&plant.y[k][i], NULL};
        assert_int_equal(dse_mhe_local_begin(&net.local[i], k, &y), DSE_OK);
    }
}

static int ask(int i)
{
    return dse_mhe_coordinator_message_down(&net.coordinator, i, down);
}

static int answer(int i)
{
    assert_int_equal(dse_mhe_local_receive_down(&net.local[i], down, ask(i)), DSE_OK);
    dse_mhe_local_solve(&net.local[i]);
    return dse_mhe_local_message_up(&net.local[i], up);
}

/* ---- messages ---- */

static void messages_fit_their_documented_sizes(void **state)
{
    (void)state;
    static const enum dse_mhe_scheme schemes[] = {DSE_MHE_PREDICTION, DSE_MHE_PRICE};
    for (int s = 0; s < 2; s++) {
        start(schemes[s]);
        for (int i = 0; i < PLANT_PARTS; i++)
            plant.subsystems[i].trigger = DSE_REAL(1e-3);
        assert_int_equal(coordination_start(&net), DSE_OK);
        open_round(8);
        assert_true(ask(0) <= DSE_MHE_DOWN_SIZE(PLANT_NX, PLANT_H));
        assert_true(answer(0) <= DSE_MHE_UP_SIZE(PLANT_NX, 1, PLANT_H));
        coordination_free(&net);
    }
}

struct defect {
    int field; /* of the header, or -1: the last number of the message */
    dse_real value;
    int count; /* added to the length */
    enum dse_status expected;
};

static void agent_refuses_what_is_not_for_it_and_stays_as_it_is(void **state)
{
    (void)state;
    static const struct defect defects[] = {{SAMPLE, 7, 0, DSE_ENODATA},
                                            {SAMPLE, 9, 0, DSE_ENODATA},
                                            {SAMPLE, -1, 0, DSE_EFORMAT},
                                            {ROUND, DSE_REAL(0.5), 0, DSE_EFORMAT},
                                            {FLAGS, (dse_real)1e30, 0, DSE_EFORMAT},
                                            {LENGTH, (dse_real)NAN, 0, DSE_EFORMAT},
                                            {LENGTH, 3, 0, DSE_EFORMAT},
                                            {ROUND, 0, -1, DSE_EFORMAT},
                                            {ROUND, 0, 1, DSE_EFORMAT},
                                            {ROUND, 0, -1000, DSE_EFORMAT},
                                            {-1, (dse_real)INFINITY, 0, DSE_ENONFINITE}};
    for (size_t d = 0; d < sizeof defects / sizeof defects[0]; d++) {
        start(DSE_MHE_PREDICTION);
        assert_int_equal(coordination_start(&net), DSE_OK);
        open_round(8);
        const int count = ask(0);
        dse_real message[DSE_MHE_DOWN_SIZE(PLANT_NX, PLANT_H) + 1] = {0};
        memcpy(message, down, sizeof down);
        message[defects[d].field >= 0 ? defects[d].field : count - 1] = defects[d].value;
        const int length = count + defects[d].count > 0 ? count + defects[d].count : 0;
        struct dse_mhe_local *local = &net.local[0];
        assert_int_equal(dse_mhe_local_receive_down(local, message, length), defects[d].expected);
        assert_false(local->heard);
        assert_false(dse_mhe_local_is_finished(local));
        /* and takes the right one, once */
        assert_int_equal(dse_mhe_local_receive_down(local, down, count), DSE_OK);
        assert_int_equal(dse_mhe_local_receive_down(local, down, count), DSE_ENODATA);
        coordination_free(&net);
    }
}

static void coordinator_refuses_what_is_not_for_it_and_stays_as_it_is(void **state)
{
    (void)state;
    static const struct defect defects[] = {
        {SAMPLE, 7, 0, DSE_ENODATA},    {SAMPLE, -1, 0, DSE_EFORMAT},
        {ROUND, 1, 0, DSE_ENODATA},     {ROUND, -1, 0, DSE_EFORMAT},
        {LENGTH, 0, 0, DSE_EFORMAT},    {ROUND, 0, -1, DSE_EFORMAT},
        {ROUND, 0, -1000, DSE_EFORMAT}, {-1, (dse_real)NAN, 0, DSE_ENONFINITE}};
    for (size_t d = 0; d < sizeof defects / sizeof defects[0]; d++) {
        start(DSE_MHE_PRICE);
        assert_int_equal(coordination_start(&net), DSE_OK);
        open_round(8);
        const int count = answer(0);
        dse_real message[DSE_MHE_UP_SIZE(PLANT_NX, 1, PLANT_H)], before[PLANT_X];
        memcpy(message, up, sizeof up);
        memcpy(before, net.coordinator.X, sizeof before);
        message[defects[d].field >= 0 ? defects[d].field : count - 1] = defects[d].value;
        const int length = count + defects[d].count > 0 ? count + defects[d].count : 0;
        assert_int_equal(dse_mhe_coordinator_receive_up(&net.coordinator, 0, message, length),
                         defects[d].expected);
        assert_memory_equal(before, net.coordinator.X, sizeof before);
        assert_int_equal(dse_mhe_coordinator_uplinks(&net.coordinator), 0);
        assert_int_equal(dse_mhe_coordinator_receive_up(&net.coordinator, 0, up, count), DSE_OK);
        assert_int_equal(dse_mhe_coordinator_uplinks(&net.coordinator), 1);
        coordination_free(&net);
    }
}

/* An interaction that an agent cannot fit: the coordinator comes back half-way. */
static void coordinator_steps_back_from_an_infeasible_interaction(void **state)
{
    (void)state;
    static const dse_real wide[PLANT_NX] = {-50, -50}, far[PLANT_NX] = {50, 50};
    start(DSE_MHE_PREDICTION);
    for (int i = 0; i < PLANT_PARTS; i++) {
        plant.subsystems[i].x_min = wide;
        plant.subsystems[i].x_max = far;
    }
    assert_int_equal(coordination_start(&net), DSE_OK);
    open_round(8);
    dse_real asked[2][PLANT_X], plain[PLANT_X];
    for (int round = 0; round < 3; round++) {
        memcpy(asked[round == 2], net.coordinator.asked, sizeof asked[0]);
        for (int i = 0; i < PLANT_PARTS; i++) {
            int count = answer(i);
            if (round == 1 && i == 1) {
                up[FLAGS] = 1 + 4; /* fresh, infeasible: no data */
                count -= (2 * PLANT_H - 1) * PLANT_NX;
            }
            assert_int_equal(dse_mhe_coordinator_receive_up(&net.coordinator, i, up, count),
                             DSE_OK);
        }
        if (round == 0) {
            memcpy(plain, net.coordinator.X, sizeof plain);
            memcpy(asked[1], net.coordinator.asked, sizeof asked[1]);
        }
        assert_int_equal(dse_mhe_coordinator_advance(&net.coordinator), DSE_MHE_CONTINUE);
        if (round == 1) {
            for (int e = 0; e < PLANT_X; e++) /* between the first question and its answer */
                assert_near(net.coordinator.asked[e], (asked[1][e] + plain[e]) / 2,
                            TOLERANCE(1e-12, 1e-5) * (1 + dse_abs(plain[e])));
        }
    }
    coordination_free(&net);
}

/* ---- schemes without a solution ---- */

static void standard_prices_are_singular_and_say_so(void **state)
{
    (void)state;
    struct coordination_alone alone = {.memory = NULL};
    start(DSE_MHE_PRICE);
    for (int i = 0; i < PLANT_PARTS; i++)
        plant.subsystems[i].D = NULL;
    assert_int_equal(coordination_start(&net), DSE_OK);
    assert_int_equal(coordination_alone_start(&alone, PLANT_H, 2, 0, &plant.subsystems[0]), DSE_OK);
    for (long k = 0; k < 9; k++) {
        const enum dse_mhe_outcome outcome = coordination_sample(&net, k, plant.y[k], NULL);
        coordination_alone_sample(&alone, k, &plant.y[k][0], NULL);
        if (k == 0)
            continue;
        assert_int_equal(outcome, DSE_MHE_OUTCOME_SINGULAR);
        assert_int_equal(dse_mhe_local_status(&net.local[0]), DSE_MHE_SINGULAR);
        assert_int_equal(dse_mhe_local_health(&net.local[0]), DSE_HEALTH_UNOBSERVABLE);
        /* the decentralised estimate is there all the same */
        assert_all_near(PLANT_NX, dse_mhe_local_state(&net.local[0]),
                        dse_mhe_local_state(&alone.local), 0);
    }
    free(alone.memory);
    coordination_free(&net);
}

/* With as many outputs as states it is not: then it gives the centralised estimate at once. */
static void standard_prices_work_when_the_outputs_determine_the_states(void **state)
{
    (void)state;
    static const dse_real C[PLANT_BLOCK] = {1, 0, DSE_REAL(0.3), 1}, R[PLANT_BLOCK] = {1, 0, 0, 1};
    struct coordination prediction;
    start(DSE_MHE_PRICE);
    for (int i = 0; i < PLANT_PARTS; i++) {
        plant.subsystems[i].ny = 2;
        plant.subsystems[i].C = C;
        plant.subsystems[i].R = R;
        plant.subsystems[i].D = NULL;
    }
    coordination_plant_network(&plant, DSE_MHE_PREDICTION, TOLERANCE(1e-10, 1e-4), &prediction);
    assert_int_equal(coordination_start(&net), DSE_OK);
    assert_int_equal(coordination_start(&prediction), DSE_OK);
    for (long k = 0; k < 12; k++) {
        dse_real y[2 * PLANT_PARTS], x[PLANT_N], expected[PLANT_N];
        for (int j = 0; j < 2 * PLANT_PARTS; j++)
            y[j] = plant.y[(k + j) % PLANT_SAMPLES][j / 2];
        coordination_sample(&net, k, y, NULL);
        coordination_sample(&prediction, k, y, NULL);
        if (k > 0)
            assert_int_equal(dse_mhe_coordinator_iterations(&net.coordinator), 2);
        coordination_state(&net, x);
        coordination_state(&prediction, expected);
        assert_all_near(PLANT_N, x, expected, AGREEMENT);
    }
    coordination_free(&net);
    coordination_free(&prediction);
}

/* No output for the whole window. */
static void window_without_data_is_singular(void **state)
{
    (void)state;
    static const bool nothing[PLANT_PARTS] = {false};
    start(DSE_MHE_PREDICTION);
    assert_int_equal(coordination_start(&net), DSE_OK);
    enum dse_mhe_outcome outcome = DSE_MHE_CONTINUE;
    for (long k = 0; k < 10 + PLANT_H; k++)
        outcome = coordination_sample(&net, k, plant.y[k], k < 10 ? NULL : nothing);
    assert_int_equal(outcome, DSE_MHE_OUTCOME_SINGULAR);
    assert_int_equal(dse_mhe_local_status(&net.local[1]), DSE_MHE_SINGULAR);
    outcome = coordination_sample(&net, 16, plant.y[16], NULL);
    for (long k = 17; k < 17 + PLANT_H; k++)
        outcome = coordination_sample(&net, k, plant.y[k], NULL);
    assert_int_equal(outcome, DSE_MHE_OUTCOME_CONVERGED); /* and comes back */
    coordination_free(&net);
}

/* ---- configurations ---- */

static enum dse_status start_of(void)
{
    struct coordination_plant *p = &plant;
    const struct dse_mhe_local_config local = {.settings = &net.settings,
                                               .subsystem = &p->subsystems[0]};
    net.config.settings = &net.settings;
    struct dse_arena arena;
    static dse_real memory[20000];
    dse_arena_init(&arena, memory, 20000);
    enum dse_status status = dse_mhe_local_init(&net.local[0], &local, &arena);
    dse_arena_init(&arena, memory, 20000);
    if (status == DSE_OK)
        status = dse_mhe_coordinator_init(&net.coordinator, &net.config, &arena);
    return status;
}

static void wrong_configurations_are_refused(void **state)
{
    (void)state;
    static dse_real crooked[PLANT_BLOCK] = {1, DSE_REAL(0.5), 0, 1};
    static dse_real indefinite[PLANT_BLOCK] = {1, 2, 2, 1};
    static const dse_real three[PLANT_NX] = {3, 3}, two[PLANT_NX] = {2, 2};
    for (int wrong = 0; wrong < 17; wrong++) {
        start(wrong == 16 ? DSE_MHE_PRICE : DSE_MHE_PREDICTION);
        enum dse_status expected = DSE_EINVAL;
        switch (wrong) {
        case 0:
            net.settings.horizon = 0;
            break;
        case 1:
            net.settings.min_horizon = 0;
            break;
        case 2:
            net.settings.min_horizon = PLANT_H + 1;
            break;
        case 3:
            net.settings.barrier = -1;
            break;
        case 4:
            net.settings.max_age = -1;
            break;
        case 5:
            net.config.eps = 0;
            break;
        case 6:
            net.config.relaxation = DSE_REAL(1.5);
            break;
        case 7:
            net.config.consistent_certificate = DSE_REAL(1.01);
            break;
        case 8:
            net.config.anderson = -1;
            break;
        case 9:
            net.config.parts = 0;
            break;
        case 10:
            plant.subsystems[0].A = NULL;
            break;
        case 11:
            plant.subsystems[0].Q = crooked;
            break;
        case 12:
            plant.subsystems[0].trigger = (dse_real)NAN;
            break;
        case 13:
            plant.subsystems[0].x_min = three;
            plant.subsystems[0].x_max = two;
            break;
        case 14:
            plant.subsystems[0].Q = indefinite;
            expected = DSE_ENOTPD;
            break;
        case 15:
            plant.A[1] = (dse_real)NAN;
            expected = DSE_ENONFINITE;
            break;
        default:
            net.settings.barrier = 1;
            break;
        }
        assert_int_equal(start_of(), expected);
    }
    start(DSE_MHE_PREDICTION);
    assert_int_equal(start_of(), DSE_OK);
}

/* The consistent variant with its certificate: weakly coupled, it converges to the same. */
static void consistent_variant_needs_its_certificate_and_then_converges(void **state)
{
    (void)state;
    dse_real x[PLANT_N], expected[PLANT_N];
    struct coordination literal;
    coordination_plant_make(&plant, DSE_REAL(0.02));
    coordination_plant_network(&plant, DSE_MHE_PREDICTION, TOLERANCE(1e-9, 1e-3), &net);
    coordination_plant_network(&plant, DSE_MHE_PREDICTION, TOLERANCE(1e-9, 1e-3), &literal);
    net.config.consistent_certificate = DSE_REAL(0.9);
    assert_int_equal(coordination_start(&net), DSE_OK);
    assert_int_equal(coordination_start(&literal), DSE_OK);
    for (long k = 0; k < 12; k++) {
        const enum dse_mhe_outcome outcome = coordination_sample(&net, k, plant.y[k], NULL);
        coordination_sample(&literal, k, plant.y[k], NULL);
        assert_true(k == 0 || outcome == DSE_MHE_OUTCOME_CONVERGED);
        coordination_state(&net, x);
        coordination_state(&literal, expected);
        assert_all_near(PLANT_N, x, expected, AGREEMENT);
    }
    coordination_free(&net);
    coordination_free(&literal);
}

static void memory_is_what_the_storage_says_and_no_less_will_do(void **state)
{
    (void)state;
    static const dse_real wide[PLANT_NX] = {-50, -50}, far[PLANT_NX] = {50, 50};
    for (int c = 0; c < 6; c++) {
        start(c % 2 == 0 ? DSE_MHE_PREDICTION : DSE_MHE_PRICE);
        net.settings.barrier = c == 4 ? 100 : 0;
        net.config.anderson = c >= 2 ? 5 : 0;
        for (int i = 0; i < PLANT_PARTS && c >= 2; i++) {
            plant.subsystems[i].x_min = wide;
            plant.subsystems[i].w_max = far;
        }
        net.config.settings = &net.settings;
        const struct dse_mhe_local_config config = {.settings = &net.settings,
                                                    .subsystem = &plant.subsystems[0],
                                                    .max_active = c == 5 ? 9 : 0};
        const int local = dse_mhe_local_storage(&config);
        const int coordinator = dse_mhe_coordinator_storage(&net.config);
        dse_real *memory = calloc((size_t)local + (size_t)coordinator, sizeof *memory);
        struct dse_arena arena;
        dse_arena_init(&arena, memory, local - 1);
        assert_int_equal(dse_mhe_local_init(&net.local[0], &config, &arena), DSE_ESTORAGE);
        dse_arena_init(&arena, memory, local);
        assert_int_equal(dse_mhe_local_init(&net.local[0], &config, &arena), DSE_OK);
        assert_int_equal(arena.used, local);
        dse_arena_init(&arena, memory, coordinator - 1);
        assert_int_equal(dse_mhe_coordinator_init(&net.coordinator, &net.config, &arena),
                         DSE_ESTORAGE);
        dse_arena_init(&arena, memory, coordinator);
        assert_int_equal(dse_mhe_coordinator_init(&net.coordinator, &net.config, &arena), DSE_OK);
        assert_int_equal(arena.used, coordinator);
        free(memory);
    }
}

/* ---- an agent alone ---- */

/* With the exact prior the window of one sample and no more is the Kalman filter's update. */
static void covariance_is_the_inverse_of_what_the_data_say(void **state)
{
    (void)state;
    start(DSE_MHE_ALONE);
    struct coordination_alone alone = {.memory = NULL};
    struct dse_mhe_subsystem s = plant.subsystems[0];
    static const dse_real prior[PLANT_BLOCK] = {2, 0, 0, 4};
    dse_real P[PLANT_BLOCK];
    s.prior = prior;
    assert_int_equal(coordination_alone_start(&alone, 1, 1, 0, &s), DSE_OK);
    coordination_alone_sample(&alone, 0, &plant.y[0][0], NULL);
    assert_int_equal(dse_mhe_local_covariance(&alone.local, P), DSE_OK);
    const dse_real expected[PLANT_BLOCK] = {DSE_REAL(0.25), 0, 0, DSE_REAL(0.25)};
    assert_all_near(PLANT_BLOCK, P, expected, TOLERANCE(1e-14, 1e-6));
    /* x = x0 + P C'R^-1 (y - C x0) */
    const dse_real gain = DSE_REAL(0.25) * 2;
    assert_near(dse_mhe_local_state(&alone.local)[0],
                plant.x0[0] + gain * (plant.y[0][0] - plant.x0[0]), TOLERANCE(1e-14, 1e-6));
    assert_near(dse_mhe_local_state(&alone.local)[1], plant.x0[1], TOLERANCE(1e-14, 1e-6));
    free(alone.memory);

    start(DSE_MHE_PREDICTION);
    assert_int_equal(coordination_start(&net), DSE_OK);
    for (long k = 0; k < 9; k++)
        coordination_sample(&net, k, plant.y[k], NULL);
    assert_int_equal(dse_mhe_local_covariance(&net.local[0], P), DSE_ENODATA);
    coordination_free(&net);
}

static void every_status_has_a_text(void **state)
{
    (void)state;
    for (int i = DSE_MHE_STARTING; i <= DSE_MHE_SINGULAR; i++)
        assert_string_not_equal(dse_mhe_status_text((enum dse_mhe_status)i), "unknown");
    assert_string_equal(dse_mhe_status_text((enum dse_mhe_status)77), "unknown");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(messages_fit_their_documented_sizes),
        cmocka_unit_test(agent_refuses_what_is_not_for_it_and_stays_as_it_is),
        cmocka_unit_test(coordinator_refuses_what_is_not_for_it_and_stays_as_it_is),
        cmocka_unit_test(coordinator_steps_back_from_an_infeasible_interaction),
        cmocka_unit_test(standard_prices_are_singular_and_say_so),
        cmocka_unit_test(standard_prices_work_when_the_outputs_determine_the_states),
        cmocka_unit_test(window_without_data_is_singular),
        cmocka_unit_test(wrong_configurations_are_refused),
        cmocka_unit_test(consistent_variant_needs_its_certificate_and_then_converges),
        cmocka_unit_test(memory_is_what_the_storage_says_and_no_less_will_do),
        cmocka_unit_test(covariance_is_the_inverse_of_what_the_data_say),
        cmocka_unit_test(every_status_has_a_text),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
