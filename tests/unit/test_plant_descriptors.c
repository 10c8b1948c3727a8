/* The descriptor plants of the adaptive distributed observers: what the reduced equations, the
 * completed states and the sensors have to do with E x' = A x + B u + F v. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "dse/math.h"
#include "dse/plant.h"
#include "plant_bench.h"

struct equation {
    const char *plant;
    int differential; /* rows with 1 in E, the first ones */
    dse_real A[16];
    dse_real B[12]; /* unknown inputs last */
};

/* As printed: fourth row 0 = x4 + u1. */
static const struct equation uio = {"descriptor_uio",
                                    3,
                                    {-1, 1, 0, 0, -1, 0, 0, 1, 0, -1, -1, 0, 0, 0, 0, 1},
                                    {1, 0, -1, 0, 1, 0, 0, 0, 0, 1, 0, 0}};
static const struct equation fo = {"descriptor_fo",
                                   2,
                                   {1, 0, DSE_REAL(-0.25), 1, 1, -2, 1, 0, 1, 0, 0, 1, 0, 1, -1, 0},
                                   {0, 1, 1, 0, 1, 1, 0, 0}};

static void check_equation(const struct equation *e)
{
    struct bench bench;
    memset(&bench, 0, sizeof bench);
    set_up(&bench, dse_plant_find(e->plant), 0);
    dse_real f[4];
    bench.u[0] = DSE_REAL(0.75);
    bench.u[1] = DSE_REAL(-2.5);
    bench.x[2] = bench.x[3] = 1000; /* of no meaning where they are tied */
    if (e->differential > 2)
        bench.x[2] = DSE_REAL(-7.5);
    bench.plant->complete(bench.prepared, 0, bench.u, bench.x);
    assert_int_equal(bench.model.f(&bench.model, 0, bench.x, bench.u, f), DSE_OK);
    for (int row = 0; row < 4; row++) {
        dse_real sum = 0;
        for (int j = 0; j < 4; j++)
            sum += e->A[row * 4 + j] * bench.x[j];
        for (int j = 0; j < bench.plant->nu; j++)
            sum += e->B[row * bench.plant->nu + j] * bench.u[j];
        /* E x' = A x + B u + F v; what is tied does not move by itself */
        assert_near(row < e->differential ? f[row] : 0, sum, TOLERANCE(1e-13, 1e-5));
        if (row >= e->differential)
            assert_near(f[row], 0, 0);
    }
}

static void completed_states_fulfil_the_descriptor_equation(void **state)
{
    (void)state;
    check_equation(&uio);
    check_equation(&fo);
}

static void every_sensor_group_measures_two_outputs_and_estimates_all(void **state)
{
    (void)state;
    const struct {
        const char *plant;
        int sensors, unknown;
    } cases[] = {{"descriptor_uio", 6, 1}, {"descriptor_fo", 4, 0}};
    for (int c = 0; c < 2; c++) {
        const struct dse_plant *plant = dse_plant_find(cases[c].plant);
        assert_int_equal(plant->n_subsystems, cases[c].sensors);
        assert_int_equal(plant->n_unknown, cases[c].unknown);
        for (int i = 0; i < plant->n_subsystems; i++) {
            assert_int_equal(plant->subsystems[i].n_states, 4);
            assert_int_equal(plant->subsystems[i].n_outputs, 2);
            assert_int_equal(plant->subsystems[i].outputs[0], 2 * i);
            assert_int_equal(plant->subsystems[i].outputs[1], 2 * i + 1);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(completed_states_fulfil_the_descriptor_equation),
        cmocka_unit_test(every_sensor_group_measures_two_outputs_and_estimates_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
