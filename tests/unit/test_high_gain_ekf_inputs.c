/* The high-gain EKF when inputs jump, on the three tanks: their coordinates do not depend on the
 * inputs, and the levels that are decoded from them are held within the tanks, the coordinates are
 * not. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "dse/high_gain_ekf.h"
#include "dse/math.h"
#include "dse/plant.h"

enum { N = 5, P = 3, HORIZON = 4 };

struct bench {
    dse_real prepared[64];
    struct dse_model model;
    struct dse_normal_form form;
    struct dse_high_gain_ekf_config config;
    struct dse_high_gain_ekf filter;
    dse_real memory[DSE_HIGH_GAIN_EKF_STORAGE(N, 2, P, P, 2, HORIZON)];
};

/* Far above the rim: no level is decoded there. */
static const dse_real guess[N] = {150, 50, 15, 67, 50};
static const dse_real unit[4] = {1, 0, 0, 1};

static void set_up(struct bench *bench, bool map_without_inputs)
{
    const struct dse_plant *plant = dse_plant_find("three_tank");
    struct dse_arena arena;
    assert_non_null(plant);
    assert_true(plant->prepared_size <= 64);
    assert_int_equal(plant->prepare(plant->sets[0].values, bench->prepared), DSE_OK);
    plant->model(bench->prepared, &bench->model);
    plant->normal_form(bench->prepared, &bench->form);
    assert_true(bench->form.map_without_inputs);
    bench->form.map_without_inputs = map_without_inputs;
    bench->config = (struct dse_high_gain_ekf_config){
        .model = &bench->model,
        .form = &bench->form,
        .period = (dse_real)1 / 3600,
        .gain = DSE_HIGH_GAIN_ONE,
        .communication = DSE_HIGH_GAIN_NONE,
        .predictor = DSE_HIGH_GAIN_HOLD,
        .x0 = guess,
        .P0 = unit,
        .Q = unit,
        .R = 1,
        .horizon = HORIZON,
    };
    dse_arena_init(&arena, bench->memory, (int)(sizeof bench->memory / sizeof *bench->memory));
    assert_int_equal(dse_high_gain_ekf_init(&bench->filter, &bench->config, &arena), DSE_OK);
}

static void tick(struct bench *bench, int k, const dse_real *u)
{
    const struct dse_measurement nothing = {.y = guess, .valid = (const bool[]){false}};
    struct dse_high_gain_ekf *f = &bench->filter;
    assert_int_equal(dse_high_gain_ekf_begin(f, k, (dse_real)k / 3600, u, &nothing), DSE_OK);
    assert_int_equal(dse_high_gain_ekf_finish(f), DSE_OK);
}

static void a_jump_of_an_input_leaves_coordinates_without_inputs_alone(void **state)
{
    (void)state;
    static struct bench bench;
    const dse_real before[2] = {7, 9}, after[2] = {8, 10};
    set_up(&bench, true);
    tick(&bench, 0, before);
    tick(&bench, 1, after);
    /* z_1 has moved by less than a cm in 2 s; what is decoded is the rim */
    assert_true(dse_high_gain_ekf_picture(&bench.filter)[0] > 149);
    assert_true(dse_abs(dse_high_gain_ekf_estimate(&bench.filter)[0] - 100) < (dse_real)1e-4);
}

static void otherwise_they_are_computed_anew_from_the_physical_state(void **state)
{
    (void)state;
    static struct bench bench;
    const dse_real before[2] = {7, 9}, after[2] = {8, 10};
    set_up(&bench, false);
    tick(&bench, 0, before);
    tick(&bench, 1, before);
    assert_true(dse_high_gain_ekf_picture(&bench.filter)[0] > 149);
    tick(&bench, 2, after);
    assert_true(dse_high_gain_ekf_picture(&bench.filter)[0] < 101);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_jump_of_an_input_leaves_coordinates_without_inputs_alone),
        cmocka_unit_test(otherwise_they_are_computed_anew_from_the_physical_state),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
