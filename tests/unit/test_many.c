/* What is computed for many at once has the bits of what is computed one by one. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "dse/math.h"
#include "dse/plant.h"
#include "dse/random.h"

enum { MOST = 75 };

static void exponentials_of_many_have_the_bits_of_single_ones(void **state)
{
    (void)state;
    static const double size[] = {1, 100, 720, 2000};
    static const dse_real special[] = {
        (dse_real)NAN, (dse_real)INFINITY, (dse_real)-INFINITY, 0, -700, 700, -745, 710};
    struct dse_random random;
    dse_real x[MOST], y[MOST];
    dse_random_init(&random, 7, 0);
    for (int k = 0; k < 4000; k++) {
        const int n = k % (MOST + 1);
        for (int i = 0; i < n; i++) {
            x[i] = (dse_real)((2 * dse_random_uniform(&random) - 1) * size[k % 4]);
        }
        if (k % 5 == 0 && n > 0) {
            x[k % n] = special[k % 8];
        }
        dse_exp_many(n, x, y);
        for (int i = 0; i < n; i++) {
            const dse_real one = dse_exp(x[i]);
            assert_memory_equal(&one, &y[i], sizeof one);
        }
        dse_exp_many(n, x, x); /* in place */
        assert_memory_equal(x, y, (size_t)n * sizeof *x);
    }
}

static void derivatives_of_many_states_have_the_bits_of_single_ones(void **state)
{
    (void)state;
    int seen = 0;
    for (int p = 0; dse_plant_at(p) != NULL; p++) {
        const struct dse_plant *plant = dse_plant_at(p);
        dse_real prepared[512], u[DSE_PLANT_MAX_INPUTS];
        static dse_real x[20 * DSE_PLANT_MAX_STATES], many[20 * DSE_PLANT_MAX_STATES],
            one[DSE_PLANT_MAX_STATES];
        struct dse_model model;
        struct dse_random random;
        if (plant->prepared_size > 512) {
            continue;
        }
        assert_int_equal(plant->prepare(plant->sets[0].values, prepared), DSE_OK);
        plant->model(prepared, &model);
        if (model.f_many == NULL) {
            continue;
        }
        seen++;
        dse_random_init(&random, 3, (uint64_t)p);
        for (int j = 0; j < plant->nu; j++) {
            u[j] = plant->inputs[j].nominal + plant->inputs[j].scale;
        }
        for (int k = 0; k < 20 * plant->nx; k++) {
            x[k] = plant->sets[0].x0[k % plant->nx] *
                   (DSE_REAL(0.9) + DSE_REAL(0.2) * (dse_real)dse_random_uniform(&random));
        }
        for (int count = 1; count <= 20; count++) {
            assert_int_equal(model.f_many(&model, 0, count, x, u, many), DSE_OK);
            for (int c = 0; c < count; c++) {
                assert_int_equal(model.f(&model, 0, x + c * plant->nx, u, one), DSE_OK);
                assert_memory_equal(one, many + c * plant->nx, (size_t)plant->nx * sizeof *one);
            }
        }
        x[13 * plant->nx] = (dse_real)NAN; /* one that cannot be evaluated */
        assert_int_equal(model.f_many(&model, 0, 13, x, u, many), DSE_OK);
        assert_int_not_equal(model.f_many(&model, 0, 14, x, u, many), DSE_OK);
    }
    assert_true(seen >= 2);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(exponentials_of_many_have_the_bits_of_single_ones),
        cmocka_unit_test(derivatives_of_many_states_have_the_bits_of_single_ones),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
