/* The reactors cstr2 and cstr4. */
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

/* ---- cstr2 ---- */

static void cstr2_rests_in_its_steady_states(void **state)
{
    (void)state;
    static const dse_real rest[2][4] = {
        {DSE_REAL(305.715512), DSE_REAL(2.497447), DSE_REAL(304.172640), DSE_REAL(2.283483)},
        {DSE_REAL(305.051578), DSE_REAL(2.497514), DSE_REAL(303.914218), DSE_REAL(2.283534)}};
    for (int set = 0; set < 2; set++) {
        struct bench bench;
        dse_real u[2] = {DSE_REAL(4.998), 0}, dx[4];
        set_up(&bench, dse_plant_find("cstr2"), set);
        assert_int_equal(bench.model.f(&bench.model, 0, rest[set], u, dx), DSE_OK);
        for (int k = 0; k < 4; k++) {
            /* six printed decimals times rates of 55 per hour */
            assert_true(dse_abs(dx[k]) < TOLERANCE(1e-4, 2e-2));
        }
    }
}

static void reactor_without_a_temperature_is_a_model_error(void **state)
{
    (void)state;
    struct bench bench;
    set_up(&bench, dse_plant_find("cstr2"), 0);
    const struct dse_model *m = &bench.model;
    const struct dse_normal_form *form = &bench.form;
    const dse_real bad[] = {0, -1, (dse_real)INFINITY, (dse_real)-INFINITY, (dse_real)NAN};
    dse_real out[16];
    for (int b = 0; b < 5; b++) {
        dse_real x[4];
        memcpy(x, bench.x, sizeof x);
        x[2] = bad[b];
        assert_int_equal(m->f(m, 0, x, bench.u, out), DSE_EMODEL);
        assert_int_equal(m->dfdx(m, 0, x, bench.u, out), DSE_EMODEL);
        assert_int_equal(form->encode(form, 0, x, bench.u, out), DSE_EMODEL);
        assert_int_equal(form->decode(form, 0, x, bench.u, out), DSE_EMODEL);
        assert_int_equal(form->field(form, 0, x, bench.u, out), DSE_EMODEL);
        assert_int_equal(form->jacobian(form, 0, 0, x, bench.u, out), DSE_EMODEL);
        assert_int_equal(form->map_jacobian(form, 1, 0, x, bench.u, out), DSE_EMODEL);
    }
    /* so cold that no reaction runs: the concentration cannot be decoded */
    dse_real cold[4] = {DSE_REAL(1), 0, DSE_REAL(1), 0};
    assert_int_equal(form->decode(form, 0, cold, bench.u, out), DSE_EMODEL);
    assert_int_equal(form->field(form, 0, cold, bench.u, out), DSE_EMODEL);
    assert_int_equal(form->jacobian(form, 0, 0, cold, bench.u, out), DSE_EMODEL);
}

static void feed_without_a_value_is_refused(void **state)
{
    (void)state;
    struct bench bench;
    dse_real out[16];
    set_up(&bench, dse_plant_find("cstr2"), 0);
    const struct dse_normal_form *form = &bench.form;
    assert_int_equal(bench.model.f(&bench.model, 0, bench.x, NULL, out), DSE_EINVAL);
    assert_int_equal(bench.model.dfdx(&bench.model, 0, bench.x, NULL, out), DSE_EINVAL);
    assert_int_equal(form->encode(form, 0, bench.x, NULL, out), DSE_EINVAL);
    assert_int_equal(form->decode(form, 0, bench.x, NULL, out), DSE_EINVAL);
    assert_int_equal(form->field(form, 0, bench.x, NULL, out), DSE_EINVAL);
    assert_int_equal(form->jacobian(form, 0, 0, bench.x, NULL, out), DSE_EINVAL);
    assert_int_equal(form->map_jacobian(form, 0, 0, bench.x, NULL, out), DSE_EINVAL);
}

/* Section 4.7, Fig 4.8: a predictor with a wrong recycle flow; F_1 stays. */
static void recycle_mismatch_moves_reactor_1_only(void **state)
{
    (void)state;
    const struct dse_plant *plant = dse_plant_find("cstr2");
    struct bench right, wrong;
    dse_real values[DSE_PLANT_MAX_PARAMETERS], f[4], g[4];
    int mismatch = 0;
    while (strcmp(plant->parameters[mismatch].name, "dFr") != 0) {
        mismatch++;
        assert_true(mismatch < plant->n_parameters);
    }
    set_up(&right, plant, 1);
    set_up(&wrong, plant, 1);
    memcpy(values, plant->sets[1].values, (size_t)plant->n_parameters * sizeof *values);
    values[mismatch] = 5;
    assert_int_equal(plant->prepare(values, wrong.prepared), DSE_OK);
    plant->model(wrong.prepared, &wrong.model);
    assert_int_equal(right.model.f(&right.model, 0, right.x, right.u, f), DSE_OK);
    assert_int_equal(wrong.model.f(&wrong.model, 0, right.x, right.u, g), DSE_OK);
    /* 5 m3/h into 1 m3: 5 (T_2 - T_1), 5 (C_2 - C_1) */
    assert_near_scaled(g[0] - f[0], 5 * (right.x[2] - right.x[0]), 1, TOLERANCE(1e-11, 1e-4));
    assert_near_scaled(g[1] - f[1], 5 * (right.x[3] - right.x[1]), 1, TOLERANCE(1e-11, 1e-4));
    assert_memory_equal(&g[2], &f[2], 2 * sizeof *g);
}

/* ---- cstr4 ---- */

static void cstr4_rests_in_its_steady_state(void **state)
{
    (void)state;
    static const dse_real rest[8] = {
        DSE_REAL(310.837553), DSE_REAL(3.031726), DSE_REAL(310.832851), DSE_REAL(2.800238),
        DSE_REAL(312.466274), DSE_REAL(2.844137), DSE_REAL(311.157564), DSE_REAL(3.014166)};
    struct bench bench;
    dse_real dx[8];
    set_up(&bench, dse_plant_find("cstr4"), 0);
    assert_int_equal(bench.model.f(&bench.model, 0, rest, NULL, dx), DSE_OK);
    for (int k = 0; k < 8; k++) {
        assert_true(dse_abs(dx[k]) < TOLERANCE(1e-4, 2e-2));
    }
}

/* F_3 = F_01 + F_02 + F_03 + F_r2 flows from 3 to 4, and with F_04 out of it, whatever the feeds
 * and recycles are. */
static void cstr4_balances_its_flows_for_any_feeds(void **state)
{
    (void)state;
    const struct dse_plant *plant = dse_plant_find("cstr4");
    static const char *const flows[] = {"F01", "F02", "F03", "F04", "Fr1", "Fr2"};
    static const dse_real m3h[] = {DSE_REAL(7.5), 25, 28, 54, 110, 65};
    dse_real values[DSE_PLANT_MAX_PARAMETERS], prepared[MAX_PREPARED], x[8], F[64];
    struct dse_model m;
    memcpy(values, plant->sets[0].values, (size_t)plant->n_parameters * sizeof *values);
    for (int k = 0; k < plant->n_parameters; k++) {
        for (int f = 0; f < 6; f++) {
            if (strcmp(plant->parameters[k].name, flows[f]) == 0) {
                values[k] = m3h[f];
            }
        }
    }
    for (int i = 0; i < 4; i++) {
        x[2 * i] = 300;
        x[2 * i + 1] = 0; /* nothing to react: the Jacobian of the temperatures is the mixing */
    }
    assert_int_equal(plant->prepare(values, prepared), DSE_OK);
    plant->model(prepared, &m);
    assert_int_equal(m.dfdx(&m, 0, x, NULL, F), DSE_OK);
    const dse_real F_3 = m3h[0] + m3h[1] + m3h[2] + m3h[5];
    assert_near_scaled(F[6 * 8 + 4], F_3 / 6, 0, TOLERANCE(1e-13, 1e-5));
    assert_near_scaled(F[6 * 8 + 6], -(F_3 + m3h[3]) / 6, 0, TOLERANCE(1e-13, 1e-5));
    /* F_1 = F_01 + F_r1 + F_r2 from 1 to 2, F_2 - F_r1 = F_01 + F_02 + F_r2 from 2 to 3 */
    assert_near_scaled(F[2 * 8], (m3h[0] + m3h[4] + m3h[5]) / 3, 0, TOLERANCE(1e-13, 1e-5));
    assert_near_scaled(F[4 * 8 + 2], (m3h[0] + m3h[1] + m3h[5]) / 4, 0, TOLERANCE(1e-13, 1e-5));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cstr2_rests_in_its_steady_states),
        cmocka_unit_test(reactor_without_a_temperature_is_a_model_error),
        cmocka_unit_test(feed_without_a_value_is_refused),
        cmocka_unit_test(recycle_mismatch_moves_reactor_1_only),
        cmocka_unit_test(cstr4_rests_in_its_steady_state),
        cmocka_unit_test(cstr4_balances_its_flows_for_any_feeds),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
