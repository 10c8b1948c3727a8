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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rounds_that_move_apart_leave_decentralised_estimates),
        cmocka_unit_test(acceleration_keeps_the_rounds_together),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
