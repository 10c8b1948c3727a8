/* The plant called linear: from the scenario's matrices to samples, and what is refused with which
 * words. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "dse/model.h"
#include "runtime/clock.h"
#include "runtime/scenario.h"

#define COUNT(array) ((int)(sizeof(array) / sizeof(array)[0]))

/* Two states, one input, three outputs in groups of one, none and two sensors. */
static const char good[] = "name: written\n"                                      /* 1 */
                           "seed: 4\n"                                            /* 2 */
                           "time: {period_s: 0.5, duration_s: 20}\n"              /* 3 */
                           "plant:\n"                                             /* 4 */
                           "  name: linear\n"                                     /* 5 */
                           "  linear:\n"                                          /* 6 */
                           "    time: discrete\n"                                 /* 7 */
                           "    nx: 2\n"                                          /* 8 */
                           "    nu: 1\n"                                          /* 9 */
                           "    A: [1, 0.5, -0.25, 0.5]\n"                        /* 10 */
                           "    B: [0, 2]\n"                                      /* 11 */
                           "    C: [1, 0, 0, 1, 1, 1]\n"                          /* 12 */
                           "    groups: [1, 0, 2]\n"                              /* 13 */
                           "  x0: [1, -1]\n"                                      /* 14 */
                           "  inputs: [0.25]\n"                                   /* 15 */
                           "networks:\n"                                          /* 16 */
                           "  - name: one\n"                                      /* 17 */
                           "    guess: [0, 0]\n"                                  /* 18 */
                           "    high_gain_ekf: {d: 0.02, DeltaT: 0.1, beta: 5,\n" /* 19 */
                           "      m: 4, lambda: 100, theta_m: 20, Q: [1, 1],\n"   /* 20 */
                           "      R: [1, 1, 1]}\n";                               /* 21 */

static struct scenario *parse(const char *override)
{
    struct error error = {.text = ""};
    struct scenario *scenario =
        scenario_parse(good, "x.yaml", &override, override != NULL ? 1 : 0, &error);
    if (scenario == NULL)
        fail_msg("%s", error.text);
    return scenario;
}

/* The scenario with the first `from` replaced, freed by the caller. */
static char *change(const char *from, const char *to)
{
    const char *at = strstr(good, from);
    assert_non_null(at);
    size_t size = sizeof good + strlen(to);
    char *yaml = malloc(size);
    assert_non_null(yaml);
    snprintf(yaml, size, "%.*s%s%s", (int)(at - good), good, to, at + strlen(from));
    return yaml;
}

static void a_written_plant_is_a_plant_like_the_others(void **state)
{
    (void)state;
    struct scenario *scenario = parse(NULL);
    const struct dse_plant *plant = scenario->process;
    assert_string_equal(plant->name, "linear");
    assert_string_equal(plant->time_unit, "s");
    assert_int_equal(plant->nx, 2);
    assert_int_equal(plant->nu, 1);
    assert_int_equal(plant->ny, 3);
    assert_string_equal(plant->states[1].name, "x2");
    assert_string_equal(plant->inputs[0].name, "u1");
    assert_string_equal(plant->outputs[2].name, "y3");
    assert_true(plant->states[0].scale > 0);
    assert_null(plant->normal_form);
    assert_int_equal(plant->n_parameters, 0);

    static const int outputs[] = {1, 0, 2};
    assert_int_equal(plant->n_subsystems, COUNT(outputs));
    for (int g = 0; g < COUNT(outputs); g++)
        assert_int_equal(plant->subsystems[g].n_outputs, outputs[g]);
    assert_int_equal(plant->subsystems[0].outputs[0], 0);
    assert_int_equal(plant->subsystems[2].outputs[0], 1);
    assert_int_equal(plant->subsystems[2].outputs[1], 2);
    assert_string_equal(plant->subsystems[2].name, "group 3");
    scenario_free(scenario);
}

static void blocks_are_the_states_of_the_groups(void **state)
{
    (void)state;
    struct scenario *plain = parse(NULL), *cut = parse("plant.linear.blocks=[0, 1, 1]");
    for (int g = 0; g < 3; g++) {
        assert_int_equal(plain->process->subsystems[g].n_states, 0);
        assert_int_equal(cut->process->subsystems[g].n_states, g > 0);
    }
    assert_int_equal(cut->process->subsystems[1].states[0], 0);
    assert_int_equal(cut->process->subsystems[2].states[0], 1);
    assert_true(plain->hash != cut->hash);
    scenario_free(plain);
    scenario_free(cut);
}

static void its_model_has_the_matrices_of_the_scenario(void **state)
{
    (void)state;
    static const dse_real A[] = {1, 0.5, -0.25, 0.5}, C[] = {1, 0, 0, 1, 1, 1};
    static const dse_real x[] = {0, 0}, u[] = {1};
    struct scenario *scenario = parse(NULL);
    const struct dse_plant *plant = scenario->process;
    struct error error = {.text = ""};
    struct dse_model model;
    dse_real values[1], prepared[8], F[4], H[6], dx[2];
    assert_true(plant->prepared_size <= COUNT(prepared));
    assert_true(scenario_prepare_plant(scenario, &scenario->networks[0], values, prepared, &error));
    plant->model(prepared, &model);
    assert_int_equal(model.time, DSE_DISCRETE);
    assert_int_equal(model.dfdx(&model, 0, x, u, F), DSE_OK);
    assert_int_equal(model.dhdx(&model, 0, x, u, H), DSE_OK);
    assert_int_equal(model.f(&model, 0, x, u, dx), DSE_OK); /* B */
    assert_memory_equal(F, A, sizeof A);
    assert_memory_equal(H, C, sizeof C);
    assert_true(dx[0] >= 0 && dx[0] <= 0 && dx[1] >= 2 && dx[1] <= 2);
    scenario_free(scenario);
}

static void what_is_left_out_has_a_default(void **state)
{
    (void)state;
    static const char plain[] = "name: plain\n"
                                "time: {period_s: 36, duration_s: 360}\n"
                                "plant:\n"
                                "  name: linear\n"
                                "  linear: {unit_s: 3600, nx: 2, A: [0, 1, -1, 0], C: [1, 0],\n"
                                "           states: [place, speed]}\n"
                                "networks:\n"
                                "  - name: one\n"
                                "    guess: [0, 0]\n"
                                "    high_gain_ekf: {d: 0.02, DeltaT: 0.1, beta: 5, m: 4,\n"
                                "      lambda: 100, theta_m: 20, Q: [1, 1], R: [1]}\n";
    struct error error = {.text = ""};
    struct scenario *scenario = scenario_parse(plain, "x.yaml", NULL, 0, &error);
    assert_string_equal(error.text, "");
    assert_non_null(scenario);
    const struct dse_plant *plant = scenario->process;
    struct dse_model model;
    dse_real values[1], prepared[8];
    assert_true(scenario_prepare_plant(scenario, NULL, values, prepared, &error));
    plant->model(prepared, &model);
    assert_int_equal(model.time, DSE_CONTINUOUS);
    assert_string_equal(plant->time_unit, "h");
    assert_true(scenario_period(scenario) > 0.00999 && scenario_period(scenario) < 0.01001);
    assert_int_equal(plant->nu, 0);
    assert_int_equal(plant->n_subsystems, 1);
    assert_int_equal(plant->subsystems[0].n_outputs, 1);
    assert_string_equal(plant->states[1].name, "speed");
    scenario_free(scenario);
}

/* All numbers are exact in binary: x(k+1) = A x(k) + B u bit for bit, and y = C x. */
static void the_samples_of_a_discrete_plant_follow_its_matrices(void **state)
{
    (void)state;
    struct scenario *scenario = parse(NULL);
    struct error error = {.text = ""};
    struct sample_source source;
    char reason[256] = "";
    if (!plant_source(scenario, &source, &error))
        fail_msg("%s", error.text);
    double x[] = {1, -1};
    for (int k = 0; k < 12; k++) {
        struct sample_data data = {0};
        if (!source.next(source.self, k, &data, reason, sizeof reason))
            fail_msg("%s", reason);
        const double y[] = {x[0], x[1], x[0] + x[1]};
        const double next[] = {x[0] + 0.5 * x[1], -0.25 * x[0] + 0.5 * x[1] + 0.5};
        assert_memory_equal(data.x, x, sizeof x);
        assert_memory_equal(data.y, y, sizeof y);
        assert_true(data.t >= 0.5 * k && data.t <= 0.5 * k);
        memcpy(x, next, sizeof x);
    }
    source.destroy(source.self);
    scenario_free(scenario);
}

static void the_matrices_count_for_the_hash(void **state)
{
    (void)state;
    static const char *const overrides[] = {
        NULL, "plant.linear.A=[1, 0.5, -0.25, 0.75]", "plant.linear.groups=[2, 0, 1]",
        "plant.linear.origin=[2, 0]", "plant.linear.time=continuous"};
    uint64_t hash[COUNT(overrides)];
    for (int i = 0; i < COUNT(overrides); i++) {
        struct scenario *scenario = parse(overrides[i]);
        hash[i] = scenario->hash;
        scenario_free(scenario);
        for (int j = 0; j < i; j++)
            assert_true(hash[i] != hash[j]);
    }
}

static void what_does_not_fit_is_refused_with_its_line(void **state)
{
    (void)state;
    static const struct {
        const char *from, *to, *expected;
    } cases[] = {
        {"A: [1, 0.5, -0.25, 0.5]", "A: [1, 0.5, -0.25]",
         "x.yaml:10: plant.linear.A: has 3 values; it must have 4: nx x nx = 2 x 2, row by row"},
        {"B: [0, 2]", "B: [0, 2, 1]",
         "x.yaml:11: plant.linear.B: has 3 values; it must have 2: nx x nu = 2 x 1"},
        {"    B: [0, 2]\n", "", "plant.linear.B: has 0 values; it must have 2: nx x nu = 2 x 1"},
        {"C: [1, 0, 0, 1, 1, 1]", "C: [1, 0, 0]",
         "x.yaml:12: plant.linear.C: has 3 values; it must have whole rows of nx = 2"},
        {"groups: [1, 0, 2]", "groups: [1, 1]",
         "x.yaml:13: plant.linear.groups: counts 2 outputs; there are 3, the rows of C"},
        {"groups: [1, 0, 2]", "groups: [256, 256]",
         "x.yaml:13: plant.linear.groups: counts 512 outputs; there are 3"},
        {"groups: [1, 0, 2]", "groups: [257]", "plant.linear.groups[0]: 257 is out of range"},
        {"nx: 2", "nx: 0",
         "x.yaml:8: plant.linear.nx: 0 is out of range; it must be >= 1 and <= 1"},
        {"nx: 2", "nx: 161", "plant.linear.nx: 161 is out of range; it must be >= 1 and <= 160"},
        {"nu: 1", "nu: 33", "plant.linear.nu: 33 is out of range; it must be >= 0 and <= 32"},
        {"time: discrete", "time: sometimes", "'sometimes' is not one of: continuous, discrete"},
        {"time: discrete", "unit_s: 0", "plant.linear.unit_s: 0 is out of range; it must be > 0"},
        {"    nx: 2\n", "", "plant.linear.nx: is missing (number of states)"},
        {"-0.25", ".nan", "x.yaml:10: plant.linear.A[2]: '.nan' is not a finite number"},
        {"time: discrete", "states: [a]",
         "x.yaml:7: plant.linear.states: has 1 names; it must have nx = 2"},
        {"time: discrete", "states: [a, a]",
         "x.yaml:7: plant.linear.states[1]: 'a' is the name of states[0] too"},
        {"time: discrete", "states: [a, b c]", "plant.linear.states[1]: 'b c' is not a name"},
        {"time: discrete", "origin: [1]",
         "x.yaml:7: plant.linear.origin: has 1 values; it must have nx = 2, one per state"},
        {"time: discrete", "A_sin: [1, 0, 0, 1]",
         "plant.linear: A_sin and omega belong together; one of them is missing"},
        {"time: discrete", "omega: 1",
         "plant.linear: A_sin and omega belong together; one of them is missing"},
        {"time: discrete", "A_sin: [1]", "plant.linear.A_sin: has 1 values; it must have 4"},
        {"time: discrete", "blocks: [1, 1]",
         "x.yaml:7: plant.linear.blocks: has 2 values; it must have 3, one per group"},
        {"time: discrete", "blocks: [1, 0, 2]",
         "x.yaml:7: plant.linear.blocks: counts 3 states; there are nx = 2"},
        {"time: discrete", "unknown: 2",
         "x.yaml:7: plant.linear.unknown: 2 of nu = 1 inputs cannot be unknown"},
        {"x0: [1, -1]", "x0: [1]",
         "x.yaml:14: plant.x0: has 1 values; it must have 2, one per state of linear: x1, x2"},
        {"R: [1, 1, 1]", "R: [1, 1]", "R: has 2 values; it must have 3, one per output of linear"},
        {"name: linear\n", "name: cstr2\n", "must have 4, one per state of cstr2"},
        {"  linear:\n    time", "  notes:\n    time", "plant.notes: unknown key"},
    };
    for (int i = 0; i < COUNT(cases); i++) {
        struct error error = {.text = ""};
        char *yaml = change(cases[i].from, cases[i].to);
        struct scenario *scenario = scenario_parse(yaml, "x.yaml", NULL, 0, &error);
        free(yaml);
        if (scenario != NULL)
            fail_msg("was accepted; expected: %s", cases[i].expected);
        if (strstr(error.text, cases[i].expected) == NULL)
            fail_msg("\n  message:  %s\n  expected: %s", error.text, cases[i].expected);
    }
}

/* More outputs than a plant may have: one state, so that C is a column. */
static void more_outputs_than_there_may_be_are_refused(void **state)
{
    (void)state;
    char yaml[4096], ones[2048] = "";
    struct error error = {.text = ""};
    for (int i = 0; i <= DSE_PLANT_MAX_OUTPUTS; i++)
        strcat(ones, i > 0 ? ", 1" : "1");
    snprintf(yaml, sizeof yaml,
             "name: wide\ntime: {period_s: 1, duration_s: 2}\nplant: {name: linear, linear: {nx: "
             "1, A: [1], C: [%s]}}\nnetworks: []\n",
             ones);
    assert_null(scenario_parse(yaml, "x.yaml", NULL, 0, &error));
    assert_non_null(strstr(error.text, "plant.linear.C: has 257 rows; it must have 1 to 256"));
}

static void the_section_and_the_name_go_together(void **state)
{
    (void)state;
    static const char text[] = "name: odd\n"
                               "time: {period_s: 1, duration_s: 2}\n"
                               "plant: {name: %s}\n"
                               "networks:\n"
                               "  - name: one\n"
                               "    guess: [0, 0, 0, 0]\n"
                               "    high_gain_ekf: {d: 0.02, DeltaT: 0.1, beta: 5, m: 4,\n"
                               "      lambda: 100, theta_m: 20, Q: [1, 1, 1, 1], R: [1, 1]}\n";
    static const char *const plants[][2] = {
        {"linear", "x.yaml:3: plant.linear: is missing: the matrices of the plant called linear"},
        {"cstr2, linear: {nx: 1, A: [1], C: [1]}",
         "x.yaml:3: plant.linear: belongs to the plant called linear, not to cstr2"}};
    for (int i = 0; i < COUNT(plants); i++) {
        char yaml[1024];
        struct error error = {.text = ""};
        snprintf(yaml, sizeof yaml, text, plants[i][0]);
        assert_null(scenario_parse(yaml, "x.yaml", NULL, 0, &error));
        if (strstr(error.text, plants[i][1]) == NULL)
            fail_msg("\n  message:  %s\n  expected: %s", error.text, plants[i][1]);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_written_plant_is_a_plant_like_the_others),
        cmocka_unit_test(blocks_are_the_states_of_the_groups),
        cmocka_unit_test(its_model_has_the_matrices_of_the_scenario),
        cmocka_unit_test(what_is_left_out_has_a_default),
        cmocka_unit_test(the_samples_of_a_discrete_plant_follow_its_matrices),
        cmocka_unit_test(the_matrices_count_for_the_hash),
        cmocka_unit_test(what_does_not_fit_is_refused_with_its_line),
        cmocka_unit_test(more_outputs_than_there_may_be_are_refused),
        cmocka_unit_test(the_section_and_the_name_go_together),
    };
    return cmocka_run_group_tests_name("scenario_linear", tests, NULL, NULL);
}
