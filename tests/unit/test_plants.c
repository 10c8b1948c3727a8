/* What every shipped plant has: tables that describe it, a range for every parameter, derivatives
 * of its model. Agreement with independent reference data is the golden tests' matter. */
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

/* ---- tables ---- */

static void shipped_plants_are_found_by_name(void **state)
{
    (void)state;
    assert_non_null(dse_plant_find("cstr2"));
    for (int i = 0; dse_plant_at(i) != NULL; i++) {
        assert_ptr_equal(dse_plant_find(dse_plant_at(i)->name), dse_plant_at(i));
    }
    assert_null(dse_plant_find("cstr"));
    assert_null(dse_plant_find("cstr22"));
    assert_null(dse_plant_find(""));
    assert_null(dse_plant_find(NULL));
    assert_null(dse_plant_at(-1));
    assert_null(dse_plant_at(1000));
}

static void check_signals(const struct dse_signal *signals, int count)
{
    for (int i = 0; i < count; i++) {
        assert_true(signals[i].name[0] != '\0' && signals[i].title[0] != '\0');
        assert_non_null(signals[i].unit);
        assert_true(dse_is_finite(signals[i].nominal) && signals[i].scale > 0);
        for (int j = 0; j < i; j++) {
            assert_string_not_equal(signals[i].name, signals[j].name);
        }
    }
}

static void check_parameters(const struct dse_plant *plant)
{
    assert_true(plant->n_parameters <= DSE_PLANT_MAX_PARAMETERS && plant->n_sets >= 1);
    for (int i = 0; i < plant->n_parameters; i++) {
        assert_true(plant->parameters[i].name[0] != '\0' && plant->parameters[i].title[0] != '\0');
        for (int j = 0; j < i; j++) {
            assert_string_not_equal(plant->parameters[i].name, plant->parameters[j].name);
        }
        for (int set = 0; set < plant->n_sets; set++) {
            assert_true(plant->sets[set].values[i] >= plant->parameters[i].min &&
                        plant->sets[set].values[i] <= plant->parameters[i].max);
        }
    }
}

static void every_plant_describes_itself(void **state)
{
    (void)state;
    for (int i = 0; dse_plant_at(i) != NULL; i++) {
        const struct dse_plant *plant = dse_plant_at(i);
        check_signals(plant->states, plant->nx);
        check_signals(plant->inputs, plant->nu);
        check_signals(plant->outputs, plant->ny);
        check_parameters(plant);
        assert_true(plant->nx <= DSE_PLANT_MAX_STATES && plant->nu <= DSE_PLANT_MAX_INPUTS &&
                    plant->ny <= DSE_PLANT_MAX_OUTPUTS && plant->time_unit_s > 0);
        int own = 0;
        for (int s = 0; s < plant->n_subsystems; s++) {
            own += plant->subsystems[s].n_states;
            for (int k = 0; k < plant->subsystems[s].n_states; k++) {
                assert_in_range(plant->subsystems[s].states[k], 0, plant->nx - 1);
            }
            for (int k = 0; k < plant->subsystems[s].n_outputs; k++) {
                assert_in_range(plant->subsystems[s].outputs[k], 0, plant->ny - 1);
            }
        }
        assert_true(own >= plant->nx);
    }
}

static void check_bad_values(struct bench *bench)
{
    dse_real values[DSE_PLANT_MAX_PARAMETERS], prepared[MAX_PREPARED];
    const struct dse_plant *plant = bench->plant;
    for (int k = 0; k < plant->n_parameters; k++) {
        const dse_real min = plant->parameters[k].min, max = plant->parameters[k].max;
        const dse_real bad[] = {min - 1 - dse_abs(min), max + 1 + dse_abs(max), (dse_real)NAN};
        for (int b = 0; b < 3; b++) {
            memcpy(values, plant->sets[0].values, (size_t)plant->n_parameters * sizeof *values);
            values[k] = bad[b];
            assert_int_equal(plant->prepare(values, prepared), DSE_EINVAL);
        }
    }
}

static void values_outside_their_range_make_no_plant(void **state)
{
    (void)state;
    for_all_plants(check_bad_values);
}

/* ---- derivatives ---- */

static void check_model_jacobian(struct bench *bench)
{
    const struct dse_model *model = &bench->model;
    const int n = model->nx;
    if (model->dfdx == NULL) {
        return;
    }
    dse_real F[MAX_N * MAX_N], plus[MAX_N], minus[MAX_N], x[MAX_N];
    assert_int_equal(model->dfdx(model, 0, bench->x, bench->u, F), DSE_OK);
    for (int c = 0; c < n; c++) {
        const dse_real step = step_of(bench->x[c]);
        memcpy(x, bench->x, sizeof x);
        x[c] = bench->x[c] + step;
        assert_int_equal(model->f(model, 0, x, bench->u, plus), DSE_OK);
        x[c] = bench->x[c] - step;
        assert_int_equal(model->f(model, 0, x, bench->u, minus), DSE_OK);
        for (int r = 0; r < n; r++) {
            assert_near_scaled(F[r * n + c], (plus[r] - minus[r]) / (2 * step), 1,
                               TOLERANCE(1e-6, 5e-2));
        }
    }
}

static void model_jacobian_agrees_with_differences(void **state)
{
    (void)state;
    for_all_plants(check_model_jacobian);
}

static void check_output_jacobian(struct bench *bench)
{
    const struct dse_model *model = &bench->model;
    if (model->dhdx == NULL) {
        return;
    }
    dse_real H[MAX_N * MAX_N], y0[MAX_N], y[MAX_N], x[MAX_N];
    assert_int_equal(model->dhdx(model, 0, bench->x, bench->u, H), DSE_OK);
    assert_int_equal(model->h(model, 0, bench->x, bench->u, y0), DSE_OK);
    for (int c = 0; c < model->nx; c++) {
        memcpy(x, bench->x, sizeof x);
        x[c] += 1;
        assert_int_equal(model->h(model, 0, x, bench->u, y), DSE_OK);
        for (int r = 0; r < model->ny; r++) {
            assert_near_scaled(H[r * model->nx + c], y[r] - y0[r], 1, TOLERANCE(1e-9, 1e-4));
        }
    }
}

static void output_jacobian_agrees_with_differences(void **state)
{
    (void)state;
    for_all_plants(check_output_jacobian);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(shipped_plants_are_found_by_name),
        cmocka_unit_test(every_plant_describes_itself),
        cmocka_unit_test(values_outside_their_range_make_no_plant),
        cmocka_unit_test(model_jacobian_agrees_with_differences),
        cmocka_unit_test(output_jacobian_agrees_with_differences),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
