/* The plant three_tank: the rig and the model identified on it. */
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

enum { IDENTIFIED = 0, RIG = 1 };

static void rig_rests_at_its_initial_state(void **state)
{
    (void)state;
    struct bench bench;
    dse_real u[2], dx[5];
    set_up(&bench, dse_plant_find("three_tank"), RIG);
    for (int k = 0; k < 2; k++) {
        u[k] = bench.plant->inputs[k].nominal;
    }
    assert_int_equal(bench.model.f(&bench.model, 0, bench.x, u, dx), DSE_OK);
    for (int k = 0; k < 5; k++) {
        assert_true(dse_abs(dx[k]) < TOLERANCE(1e-9, 1e-2));
    }
    /* the identified model is off there by 95 cm/h in tank 2 */
    set_up(&bench, dse_plant_find("three_tank"), IDENTIFIED);
    assert_int_equal(bench.model.f(&bench.model, 0, bench.x, u, dx), DSE_OK);
    assert_near_scaled(dx[2], 95, 0, DSE_REAL(0.01));
}

static void interactions_move_like_the_differences_of_the_levels(void **state)
{
    (void)state;
    struct bench bench;
    dse_real dx[5];
    for (int set = 0; set < 2; set++) {
        set_up(&bench, dse_plant_find("three_tank"), set);
        bench.x[1] += 3; /* off the differences: the interaction is a state of its own */
        assert_int_equal(bench.model.f(&bench.model, 0, bench.x, bench.u, dx), DSE_OK);
        assert_near_scaled(dx[1], dx[0] - dx[2], 1, TOLERANCE(1e-13, 1e-4));
        assert_near_scaled(dx[4], dx[3] - dx[2], 1, TOLERANCE(1e-13, 1e-4));
    }
}

static void flows_between_the_tanks_reverse_in_the_rig_only(void **state)
{
    (void)state;
    struct bench bench;
    dse_real up[5], down[5], empty[5];
    const dse_real x[5] = {20, -5, 25, 20, -5};
    const dse_real mirrored[5] = {20, 5, 25, 20, 5};
    const dse_real dry[5] = {-1, 5, -1, -1, 5};
    set_up(&bench, dse_plant_find("three_tank"), RIG);
    assert_int_equal(bench.model.f(&bench.model, 0, x, bench.u, up), DSE_OK);
    assert_int_equal(bench.model.f(&bench.model, 0, mirrored, bench.u, down), DSE_OK);
    /* q and -q: their mean is the flow without q */
    const struct dse_model *m = &bench.model;
    const dse_real level[5] = {20, 0, 25, 20, 0};
    dse_real none[5];
    assert_int_equal(m->f(m, 0, level, bench.u, none), DSE_OK);
    for (int k = 0; k < 5; k++) {
        assert_near_scaled((up[k] + down[k]) / 2, none[k], 1, TOLERANCE(1e-12, 1e-4));
    }
    assert_true(up[0] > down[0] && up[2] < down[2]);
    /* an empty tank has no outflow */
    assert_int_equal(m->f(m, 0, dry, bench.u, empty), DSE_OK);
    assert_near_scaled(empty[0] + empty[2] + empty[3],
                       DSE_REAL(177.662338) * bench.u[0] + DSE_REAL(162.077922) * bench.u[1], 0,
                       TOLERANCE(1e-8, 1e-5));
    /* the estimators' model knows one direction, and no level below 0.01 cm */
    const dse_real least[5] = {20, DSE_REAL(0.01), 25, 20, DSE_REAL(0.01)};
    set_up(&bench, dse_plant_find("three_tank"), IDENTIFIED);
    assert_int_equal(m->f(m, 0, x, bench.u, up), DSE_OK);
    assert_int_equal(m->f(m, 0, least, bench.u, down), DSE_OK);
    assert_memory_equal(up, down, sizeof up);
}

static void decoded_levels_stay_within_the_tanks(void **state)
{
    (void)state;
    struct bench bench;
    dse_real chi[5], z[5], dz[5], F[4];
    set_up(&bench, dse_plant_find("three_tank"), IDENTIFIED);
    const struct dse_normal_form *form = &bench.form;
    static const dse_real wild[] = {-1e6, -1e3, -1, 0, 1, 1e3, 1e6};
    for (int a = 0; a < 7; a++) {
        for (int b = 0; b < 7; b++) {
            const dse_real point[5] = {wild[a], wild[b], wild[a], wild[b], wild[a]};
            assert_int_equal(form->decode(form, 0, point, bench.u, chi), DSE_OK);
            for (int k = 0; k < 5; k++) {
                assert_true(chi[k] >= TOLERANCE(0.01 - 1e-15, 0.01 - 1e-8) &&
                            chi[k] <= TOLERANCE(100 + 1e-12, 100.001));
            }
            assert_int_equal(form->field(form, 0, point, bench.u, dz), DSE_OK);
            assert_true(dse_all_finite(dz, 5));
            /* an outer block's chain keeps its own unclipped z: z_1' = z_2 + b u */
            assert_near_scaled(dz[0], point[1] + DSE_REAL(177.662338) * bench.u[0], 1,
                               TOLERANCE(1e-7, 1e-5));
            for (int i = 0; i < 3; i++) {
                assert_int_equal(form->jacobian(form, i, 0, point, bench.u, F), DSE_OK);
                assert_true(dse_all_finite(F, form->n_i[i] * form->n_i[i]));
            }
        }
    }
    /* within the limits nothing is held */
    assert_int_equal(form->encode(form, 0, bench.x, bench.u, z), DSE_OK);
    assert_int_equal(form->decode(form, 0, z, bench.u, chi), DSE_OK);
    for (int k = 0; k < 5; k++) {
        assert_near_scaled(chi[k], bench.x[k], 0, TOLERANCE(1e-13, 1e-4));
    }
}

static void tanks_refuse_what_is_not_a_number(void **state)
{
    (void)state;
    struct bench bench;
    set_up(&bench, dse_plant_find("three_tank"), RIG);
    const struct dse_model *m = &bench.model;
    const struct dse_normal_form *form = &bench.form;
    dse_real out[25];
    for (int k = 0; k < 5; k++) {
        const dse_real bad[] = {(dse_real)NAN, (dse_real)INFINITY};
        for (int b = 0; b < 2; b++) {
            dse_real x[5];
            memcpy(x, bench.x, sizeof x);
            x[k] = bad[b];
            assert_int_equal(m->f(m, 0, x, bench.u, out), DSE_EMODEL);
            assert_int_equal(m->dfdx(m, 0, x, bench.u, out), DSE_EMODEL);
            assert_int_equal(form->encode(form, 0, x, bench.u, out), DSE_EMODEL);
            assert_int_equal(form->decode(form, 0, x, bench.u, out), DSE_EMODEL);
            assert_int_equal(form->field(form, 0, x, bench.u, out), DSE_EMODEL);
            assert_int_equal(form->jacobian(form, 0, 0, x, bench.u, out), DSE_EMODEL);
            assert_int_equal(form->map_jacobian(form, 0, 0, x, bench.u, out), DSE_EMODEL);
        }
    }
    assert_int_equal(m->f(m, 0, bench.x, NULL, out), DSE_EINVAL);
    assert_int_equal(form->field(form, 0, bench.x, NULL, out), DSE_EINVAL);
    assert_int_equal(form->jacobian(form, 0, 0, bench.x, NULL, out), DSE_EINVAL);
    dse_real values[DSE_PLANT_MAX_PARAMETERS], prepared[MAX_PREPARED];
    memcpy(values, bench.plant->sets[RIG].values,
           (size_t)bench.plant->n_parameters * sizeof *values);
    values[bench.plant->n_parameters - 1] = DSE_REAL(0.5);
    assert_int_equal(bench.plant->prepare(values, prepared), DSE_EINVAL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rig_rests_at_its_initial_state),
        cmocka_unit_test(interactions_move_like_the_differences_of_the_levels),
        cmocka_unit_test(flows_between_the_tanks_reverse_in_the_rig_only),
        cmocka_unit_test(decoded_levels_stay_within_the_tanks),
        cmocka_unit_test(tanks_refuse_what_is_not_a_number),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
