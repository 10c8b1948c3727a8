/* The plant sep3: its printed steady state, its balances, its limits. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "dse/math.h"
#include "dse/plant.h"
#include "plant_bench.h"

enum { NX = 9 };

static const dse_real nominal[] = {DSE_REAL(2.9e6), DSE_REAL(1e6), DSE_REAL(2.9e6)};

static void set_parameter(const struct dse_plant *plant, dse_real *values, const char *name,
                          dse_real value)
{
    for (int i = 0; i < plant->n_parameters; i++)
        if (strcmp(plant->parameters[i].name, name) == 0)
            values[i] = value;
}

/* Newton's correction -J^-1 f would be below the last printed digit: |f| is judged by the rates
 * that a state off by it would have (eigenvalues up to 181 per hour). */
static void it_rests_at_the_printed_steady_state(void **state)
{
    (void)state;
    static const dse_real printed[NX] = {
        DSE_REAL(0.03133),  DSE_REAL(0.260198), DSE_REAL(549.768557),
        DSE_REAL(0.120284), DSE_REAL(0.349924), DSE_REAL(499.458993),
        DSE_REAL(0.034802), DSE_REAL(0.285513), DSE_REAL(535.519909)};
    struct bench bench;
    dse_real f[NX];
    memset(&bench, 0, sizeof bench);
    set_up(&bench, dse_plant_find("sep3"), 0);
    assert_int_equal(bench.model.f(&bench.model, 0, printed, nominal, f), DSE_OK);
    for (int i = 0; i < NX; i++)
        assert_near(f[i], 0, i % 3 == 2 ? TOLERANCE(2e-2, 0.5) : TOLERANCE(5e-5, 1e-3));
    for (int i = 0; i < NX; i++)
        assert_near(bench.plant->states[i].nominal, printed[i], 0);
}

/* Without reactions only the feeds and the purge move A and B: summed over the vessels,
 *     d/dt sum V x = F10 x10 + F20 x20 - Fp x_r - (what the separator's equation keeps) */
static void without_reactions_all_fractions_follow_the_feeds(void **state)
{
    (void)state;
    const struct dse_plant *plant = dse_plant_find("sep3");
    dse_real values[DSE_PLANT_MAX_PARAMETERS], prepared[MAX_PREPARED], f[NX];
    struct dse_model model;
    memcpy(values, plant->sets[0].values, (size_t)plant->n_parameters * sizeof *values);
    set_parameter(plant, values, "k1", 0);
    set_parameter(plant, values, "k2", 0);
    assert_int_equal(plant->prepare(values, prepared), DSE_OK);
    plant->model(prepared, &model);
    /* pure A everywhere: nothing but A comes in, so no fraction moves */
    const dse_real pure[NX] = {1, 0, 500, 1, 0, 500, 1, 0, 500};
    assert_int_equal(model.f(&model, 0, pure, nominal, f), DSE_OK);
    for (int i = 0; i < NX; i++)
        if (i % 3 != 2)
            assert_near(f[i], 0, 0);
    /* equal volatilities: the overhead is what the liquid is, and takes nothing out of step */
    set_parameter(plant, values, "aA", 1);
    set_parameter(plant, values, "aB", 1);
    set_parameter(plant, values, "aC", 1);
    assert_int_equal(plant->prepare(values, prepared), DSE_OK);
    const dse_real mixed[NX] = {DSE_REAL(0.2), DSE_REAL(0.3),  500,
                                DSE_REAL(0.4), DSE_REAL(0.1),  480,
                                DSE_REAL(0.5), DSE_REAL(0.25), 510};
    assert_int_equal(model.f(&model, 0, mixed, nominal, f), DSE_OK);
    const dse_real F_2 = DSE_REAL(15.12);
    assert_near(f[6], F_2 * DSE_REAL(-0.1), TOLERANCE(1e-12, 1e-5));
    assert_near(f[7], F_2 * DSE_REAL(-0.15), TOLERANCE(1e-12, 1e-5));
}

static void states_that_no_vessel_has_are_refused(void **state)
{
    (void)state;
    struct bench bench;
    dse_real out[NX * NX];
    memset(&bench, 0, sizeof bench);
    set_up(&bench, dse_plant_find("sep3"), 0);
    const struct dse_model *m = &bench.model;
    const struct {
        int state;
        dse_real value;
    } cases[] = {{2, 0},  {2, (dse_real)NAN}, {5, -1}, {5, (dse_real)INFINITY},
                 {6, -2}, {7, (dse_real)NAN}};
    for (int c = 0; c < 6; c++) {
        dse_real x[NX];
        memcpy(x, bench.x, sizeof x);
        x[cases[c].state] = cases[c].value;
        assert_int_equal(m->f(m, 0, x, nominal, out), DSE_EMODEL);
        assert_int_equal(m->dfdx(m, 0, x, nominal, out), DSE_EMODEL);
    }
    assert_int_equal(m->f(m, 0, bench.x, NULL, out), DSE_EINVAL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(it_rests_at_the_printed_steady_state),
        cmocka_unit_test(without_reactions_all_fractions_follow_the_feeds),
        cmocka_unit_test(states_that_no_vessel_has_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
