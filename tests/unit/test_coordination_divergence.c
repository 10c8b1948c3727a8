/* The prediction-driven scheme where its iteration does not converge: subsystems that are coupled
 * too strongly. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "coordination_plant.h"
#include "near.h"

#define EPS      TOLERANCE(1e-10, 1e-4)
#define COUPLING DSE_REAL(0.9)
enum { LENGTH = 24, FULL = PLANT_H - 1 };

static struct coordination_plant plant;
static struct coordination net;
static struct coordination_alone alone[PLANT_PARTS];

static void start(int anderson)
{
    coordination_plant_make(&plant, COUPLING);
    coordination_plant_network(&plant, DSE_MHE_PREDICTION, EPS, &net);
    net.config.anderson = anderson;
    assert_int_equal(coordination_start(&net), DSE_OK);
    memset(alone, 0, sizeof alone);
    for (int i = 0; i < PLANT_PARTS; i++)
        assert_int_equal(coordination_alone_start(&alone[i], PLANT_H, 2, 0, &plant.subsystems[i]),
                         DSE_OK);
}

static enum dse_mhe_outcome sample(long k)
{
    for (int i = 0; i < PLANT_PARTS; i++)
        coordination_alone_sample(&alone[i], k, &plant.y[k][i], NULL);
    return coordination_sample(&net, k, plant.y[k], NULL);
}

static void finish(void)
{
    coordination_free(&net);
    for (int i = 0; i < PLANT_PARTS; i++)
        free(alone[i].memory);
}

static void rounds_that_move_apart_leave_decentralised_estimates(void **state)
{
    (void)state;
    int diverged = 0;
    start(0);
    for (long k = 0; k < LENGTH; k++) {
        if (sample(k) != DSE_MHE_OUTCOME_DIVERGED)
            continue;
        diverged++;
        for (int i = 0; i < PLANT_PARTS; i++) {
            const struct dse_mhe_local *local = &net.local[i];
            assert_int_equal(dse_mhe_local_status(local), DSE_MHE_LOCAL_ONLY);
            assert_int_equal(dse_mhe_local_health(local), DSE_HEALTH_ALONE);
            for (int a = 0; a < PLANT_NX; a++)
                assert_true(dse_mhe_local_state(local)[a] ==
                            dse_mhe_local_state(&alone[i].local)[a]);
        }
    }
    assert_true(diverged > LENGTH / 2);
    finish();
}

static void acceleration_keeps_the_rounds_together(void **state)
{
    (void)state;
    start(8);
    for (long k = 0; k < LENGTH; k++) {
        enum dse_mhe_outcome outcome = sample(k);
        assert_true(k < FULL || outcome != DSE_MHE_OUTCOME_DIVERGED);
    }
    finish();
}

/* An agent that has no finite solution says that it has none; without bounds that can be nothing
 * else. */
static void an_answer_that_is_not_finite_ends_the_sample(void **state)
{
    (void)state;
    start(0);
    assert_int_equal(sample(0), DSE_MHE_OUTCOME_STARTING);
    struct dse_mhe_coordinator *c = &net.coordinator;
    assert_int_equal(dse_mhe_coordinator_begin(c, 1), DSE_OK);
    for (int i = 0; i < PLANT_PARTS; i++) {
        struct dse_mhe_local *local = &net.local[i];
        const struct dse_measurement measurement = {&plant.y[1][i], NULL};
        assert_int_equal(dse_mhe_local_begin(local, 1, &measurement), DSE_OK);
        int count = dse_mhe_coordinator_message_down(c, i, net.down[i]);
        for (int e = DSE_MHE_HEADER; e < count && i == 1; e++)
            net.down[i][e] = DSE_REAL_MAX; /* finite, but no sum with it is */
        assert_int_equal(dse_mhe_local_receive_down(local, net.down[i], count), DSE_OK);
        dse_mhe_local_solve(local);
        count = dse_mhe_local_message_up(local, net.up);
        assert_int_equal(dse_mhe_coordinator_receive_up(c, i, net.up, count), DSE_OK);
    }
    assert_int_equal(dse_mhe_coordinator_advance(c), DSE_MHE_OUTCOME_DIVERGED);
    for (int i = 0; i < PLANT_PARTS; i++) {
        const int count = dse_mhe_coordinator_message_down(c, i, net.down[i]);
        assert_int_equal(dse_mhe_local_receive_down(&net.local[i], net.down[i], count), DSE_OK);
        dse_mhe_local_finish(&net.local[i]);
        coordination_alone_sample(&alone[i], 1, &plant.y[1][i], NULL);
        assert_int_equal(dse_mhe_local_health(&net.local[i]), DSE_HEALTH_ALONE);
        for (int a = 0; a < PLANT_NX; a++)
            assert_true(dse_mhe_local_state(&net.local[i])[a] ==
                        dse_mhe_local_state(&alone[i].local)[a]);
    }
    finish();
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rounds_that_move_apart_leave_decentralised_estimates),
        cmocka_unit_test(acceleration_keeps_the_rounds_together),
        cmocka_unit_test(an_answer_that_is_not_finite_ends_the_sample),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
