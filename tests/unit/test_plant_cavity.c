/* The reduced flow models: certified stable, the flow carries the scalars and does not feel them,
 * and every sensor shows each of the three fields. */
#include "dse/ode.h"
#include "dse/plant.h"
#include "dse/quadratic.h"
#include "near.h"

enum { NX = 10, NY = 12, VELOCITY = 4, CONTAMINANT = 7 };

static const char *const names[] = {"cavity_free", "cavity_forced"};

static const struct dse_quadratic *open_plant(int which, struct dse_model *model,
                                              const struct dse_plant **plant)
{
    static const dse_real prepared[1];
    *plant = dse_plant_find(names[which]);
    assert_non_null(*plant);
    (*plant)->model(prepared, model);
    const struct dse_quadratic *system = dse_quadratic_of(model);
    assert_non_null(system);
    assert_int_equal(dse_quadratic_check(NX, 0, NY, system), DSE_OK);
    return system;
}

static void reduced_flow_models_are_certified_stable(void **state)
{
    (void)state;
    for (int which = 0; which < 2; which++) {
        const struct dse_plant *plant;
        struct dse_model model;
        const struct dse_quadratic *system = open_plant(which, &model, &plant);
        struct dse_quadratic_certificate certificate;
        dse_real scratch[DSE_QUADRATIC_CERTIFICATE_SCRATCH(NX)];
        assert_int_equal(dse_quadratic_certify(NX, system, &certificate, scratch), DSE_OK);
        assert_true(certificate.dissipative);
        assert_true(certificate.lossless);
        assert_int_equal(system->d != NULL, which);
    }
}

/* Rows of the velocity have velocities only; rows of a scalar are linear in that scalar, with one
 * velocity in each quadratic term. */
static void the_flow_carries_the_scalars_and_does_not_feel_them(void **state)
{
    (void)state;
    for (int which = 0; which < 2; which++) {
        const struct dse_plant *plant;
        struct dse_model model;
        const struct dse_quadratic *system = open_plant(which, &model, &plant);
        for (int s = 0; s < system->terms; s++) {
            const struct dse_quadratic_term *term = &system->term[s];
            assert_true(term->i < VELOCITY);
            assert_int_equal(term->j < VELOCITY, term->k < VELOCITY);
            if (term->k >= VELOCITY)
                assert_int_equal(term->j < CONTAMINANT, term->k < CONTAMINANT);
        }
        assert_true(system->terms > 60);
    }
}

static void every_sensor_shows_each_field_and_one_field_by_output(void **state)
{
    (void)state;
    for (int which = 0; which < 2; which++) {
        const struct dse_plant *plant;
        struct dse_model model;
        const struct dse_quadratic *system = open_plant(which, &model, &plant);
        static const int first[] = {0, VELOCITY, CONTAMINANT, NX};
        for (int row = 0; row < NY; row++)
            for (int j = 0; j < NX; j++) {
                const bool own = j >= first[row % 3] && j < first[row % 3 + 1];
                assert_int_equal(system->C[row * NX + j] != 0, own);
            }
    }
}

/* |x|^2 is the energy of the fields. */
static void left_to_itself_every_run_loses_energy(void **state)
{
    (void)state;
    const struct dse_plant *plant;
    struct dse_model model;
    open_plant(0, &model, &plant);
    assert_int_equal(plant->n_sets, 4);
    for (int set = 0; set < plant->n_sets; set++) {
        dse_real x[NX], scratch[DSE_RK4_SCRATCH(NX)], before = 0;
        for (int i = 0; i < NX; i++) {
            x[i] = plant->sets[set].x0[i];
            before += x[i] * x[i];
        }
        for (int k = 0; k < 100; k++) {
            dse_real after = 0;
            assert_int_equal(dse_rk4_model_step(&model, 0, DSE_REAL(0.1), NULL, x, scratch),
                             DSE_OK);
            for (int i = 0; i < NX; i++)
                after += x[i] * x[i];
            assert_true(after < before);
            before = after;
        }
        assert_true(before > DSE_REAL(0.01));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(reduced_flow_models_are_certified_stable),
        cmocka_unit_test(the_flow_carries_the_scalars_and_does_not_feel_them),
        cmocka_unit_test(every_sensor_shows_each_field_and_one_field_by_output),
        cmocka_unit_test(left_to_itself_every_run_loses_energy),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
