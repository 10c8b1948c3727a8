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
}

/* ---- valves ---- */

enum { VALVES = 9 };

static dse_real *value_of(const struct dse_plant *plant, dse_real *values, const char *name)
{
    for (int k = 0; k < plant->n_parameters; k++) {
        if (strcmp(plant->parameters[k].name, name) == 0) {
            return &values[k];
        }
    }
    fail_msg("no parameter %s", name);
    return values;
}

/* The rig with some of the valves v1 to v9 open; "145" for example. */
static void open_valves(struct bench *bench, int set, const char *open)
{
    dse_real values[DSE_PLANT_MAX_PARAMETERS];
    set_up(bench, dse_plant_find("three_tank"), set);
    memcpy(values, bench->plant->sets[set].values,
           (size_t)bench->plant->n_parameters * sizeof *values);
    for (int v = '1'; v <= '9'; v++) {
        const char name[] = {'v', (char)v, '\0'};
        *value_of(bench->plant, values, name) = strchr(open, v) != NULL ? 1 : 0;
    }
    assert_int_equal(bench->plant->prepare(values, bench->prepared), DSE_OK);
    bench->plant->model(bench->prepared, &bench->model);
    bench->plant->normal_form(bench->prepared, &bench->form);
}

/* The flow that a valve lets through, at levels 70, 50, 65 cm of tanks 1, 2, 3: by Torricelli with
 * a = 3.43 (pipes) and 18.15, 10.54, 18.98 (drains), 60 S_x sqrt(2g)/S = 8.6288. */
static void each_valve_lets_its_own_flow_through(void **state)
{
    (void)state;
    static const struct {
        int from, to; /* rows of x', -1: out */
        double flow;
    } cases[VALVES] = {
        {0, 2, 29.596759 * 4.472135955},  {0, 2, 29.596759 * 4.472135955}, /* 40 - 20 */
        {0, 2, 29.596759 * 3.16227766},                                    /* 10 - 0 */
        {3, 2, 29.596759 * 3.872983346},  {3, 2, 29.596759 * 3.872983346},
        {3, 2, 29.596759 * 2.236067977},  {0, -1, 156.612587 * 8.366600265},
        {2, -1, 90.959487 * 7.071067812}, {3, -1, 163.774485 * 8.062257748},
    };
    const dse_real x[5] = {70, 20, 50, 65, 15};
    struct bench bench;
    dse_real none[5], dx[5];
    open_valves(&bench, RIG, "");
    assert_int_equal(bench.model.f(&bench.model, 0, x, bench.u, none), DSE_OK);
    for (int v = 0; v < VALVES; v++) {
        const char open[] = {(char)('1' + v), '\0'};
        open_valves(&bench, RIG, open);
        assert_int_equal(bench.model.f(&bench.model, 0, x, bench.u, dx), DSE_OK);
        for (int row = 0; row < 5; row++) {
            const double in = row == cases[v].to ? 1 : row == cases[v].from ? -1 : 0;
            if (row != 1 && row != 4) {
                assert_near_scaled(dx[row] - none[row], (dse_real)(in * cases[v].flow), 100,
                                   TOLERANCE(1e-7, 1e-5));
            }
        }
    }
    /* water that stands below a pipe does not flow through it, and it flows to the lower side */
    const dse_real low[5] = {29, 9, 20, 40, 20}, back[5] = {40, -5, 45, 40, -5};
    dse_real shut[5];
    open_valves(&bench, RIG, "2");
    assert_int_equal(bench.model.f(&bench.model, 0, low, bench.u, dx), DSE_OK);
    open_valves(&bench, RIG, "");
    assert_int_equal(bench.model.f(&bench.model, 0, low, bench.u, shut), DSE_OK);
    assert_memory_equal(dx, shut, sizeof dx);
    open_valves(&bench, RIG, "2");
    assert_int_equal(bench.model.f(&bench.model, 0, back, bench.u, dx), DSE_OK);
    assert_true(dx[0] > none[0] && dx[2] < 0);
}

static void valves_as_in_the_source_are_the_default(void **state)
{
    (void)state;
    for (int set = 0; set < 2; set++) {
        struct bench bench, open;
        dse_real dx[5], same[5];
        set_up(&bench, dse_plant_find("three_tank"), set);
        open_valves(&open, set, "14789");
        assert_int_equal(bench.model.f(&bench.model, 0, bench.x, bench.u, dx), DSE_OK);
        assert_int_equal(open.model.f(&open.model, 0, bench.x, bench.u, same), DSE_OK);
        assert_memory_equal(dx, same, sizeof dx);
    }
}

static void jacobian_with_all_valves_open_agrees_with_differences(void **state)
{
    (void)state;
    static const dse_real points[][5] = {
        {70, 20, 50, 65, 15}, {45, 20, 20, 70, 50}, {25, 10, 20, 31, 11}, {40, -5, 45, 80, 35}};
    dse_real scratch[DSE_MODEL_CHECK_SCRATCH(5, 3)];
    for (int k = 0; k < 4; k++) {
        struct bench bench;
        dse_real worst = 1;
        open_valves(&bench, RIG, "123456789");
        assert_int_equal(
            dse_model_check_jacobians(&bench.model, 0, points[k], bench.u, scratch, &worst, NULL),
            DSE_OK);
        assert_true(worst < TOLERANCE(1e-4, 3e-2));
    }
    /* levels that are equal above a pipe: a straight line, no infinite slope */
    struct bench bench;
    dse_real F[25];
    const dse_real level[5] = {50, 0, 50, 50, 0};
    open_valves(&bench, RIG, "2356");
    assert_int_equal(bench.model.dfdx(&bench.model, 0, level, bench.u, F), DSE_OK);
    assert_true(dse_all_finite(F, 25) && F[0] < 0 && F[2] > 0);
}

static void only_bottom_pipes_and_any_drains_have_a_normal_form(void **state)
{
    (void)state;
    static const struct {
        const char *open;
        bool has;
    } cases[] = {{"14789", true},   {"14", true},      {"147", true},     {"4789", false},
                 {"1789", false},   {"124789", false}, {"134789", false}, {"145789", false},
                 {"146789", false}, {"", false}};
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++) {
        struct bench bench;
        dse_real z[5], chi[5];
        open_valves(&bench, IDENTIFIED, cases[c].open);
        const struct dse_normal_form *form = &bench.form;
        assert_true((form->encode != NULL) == cases[c].has);
        assert_true((form->field_jacobian != NULL) == cases[c].has);
        assert_true(form->n == 5 && form->p == 3 && form->n_i[0] == 2);
        if (cases[c].has) {
            assert_int_equal(form->encode(form, 0, bench.x, bench.u, z), DSE_OK);
            assert_int_equal(form->decode(form, 0, z, bench.u, chi), DSE_OK);
            for (int k = 0; k < 5; k++) {
                assert_near_scaled(chi[k], bench.x[k], 0, TOLERANCE(1e-12, 1e-4));
            }
        }
    }
}

static void a_valve_is_open_or_shut(void **state)
{
    (void)state;
    static const char *const names[] = {"reverse", "v1", "v2", "v3", "v4",
                                        "v5",      "v6", "v7", "v8", "v9"};
    const struct dse_plant *plant = dse_plant_find("three_tank");
    for (size_t k = 0; k < sizeof names / sizeof names[0]; k++) {
        dse_real values[DSE_PLANT_MAX_PARAMETERS], prepared[MAX_PREPARED];
        memcpy(values, plant->sets[RIG].values, (size_t)plant->n_parameters * sizeof *values);
        *value_of(plant, values, names[k]) = DSE_REAL(0.5);
        assert_int_equal(plant->prepare(values, prepared), DSE_EINVAL);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rig_rests_at_its_initial_state),
        cmocka_unit_test(interactions_move_like_the_differences_of_the_levels),
        cmocka_unit_test(flows_between_the_tanks_reverse_in_the_rig_only),
        cmocka_unit_test(decoded_levels_stay_within_the_tanks),
        cmocka_unit_test(tanks_refuse_what_is_not_a_number),
        cmocka_unit_test(each_valve_lets_its_own_flow_through),
        cmocka_unit_test(valves_as_in_the_source_are_the_default),
        cmocka_unit_test(jacobian_with_all_valves_open_agrees_with_differences),
        cmocka_unit_test(only_bottom_pipes_and_any_drains_have_a_normal_form),
        cmocka_unit_test(a_valve_is_open_or_shut),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
