/* plant.drive: from the file to the samples of the plant, and what is refused with which words. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "runtime/clock.h"
#include "runtime/plant_drive.h"
#include "runtime/scenario.h"

#define COUNT(array) ((int)(sizeof(array) / sizeof(array)[0]))

static const char head[] = "name: driven\n"
                           "seed: 1\n"
                           "time: {period_s: 2, duration_s: 400}\n";
static const char networks[] =
    "networks:\n"
    "  - name: one\n"
    "    guess: %s\n"
    "    high_gain_ekf: {d: 0.02, DeltaT: 0.001, beta: 5, m: 4, lambda: 100, theta_m: 20,\n"
    "      Q: %s, R: %s}\n";

static const char tank[] = "plant:\n"
                           "  name: three_tank\n"
                           "  set: rig\n"
                           "  inputs: [7, 9]\n"
                           "  drive:\n";

/* The whole text of a scenario with the given drives, freed by the caller. */
static char *text_of(const char *plant, const char *drives)
{
    const int cstr = strstr(plant, "cstr2") != NULL;
    char *text = malloc(8192), tail[1024];
    assert_non_null(text);
    snprintf(tail, sizeof tail, networks, cstr ? "[1, 1, 1, 1]" : "[1, 1, 1, 1, 1]",
             cstr ? "[1, 1, 1, 1]" : "[1, 1, 1, 1, 1]", cstr ? "[1, 1]" : "[1, 1, 1]");
    snprintf(text, 8192, "%s%s%s%s", head, plant, drives, tail);
    return text;
}

static struct scenario *parse(const char *plant, const char *drives, const char *override)
{
    struct error error = {.text = ""};
    char *text = text_of(plant, drives);
    struct scenario *scenario =
        scenario_parse(text, "x.yaml", &override, override != NULL ? 1 : 0, &error);
    free(text);
    if (scenario == NULL)
        fail_msg("%s", error.text);
    return scenario;
}

/* ---- what arrives ---- */

/* u of the first samples of input `input`. */
static void run(struct scenario *scenario, int input, double *u, int samples)
{
    struct error error = {.text = ""};
    struct sample_source source;
    char reason[256] = "";
    if (!plant_source(scenario, &source, &error))
        fail_msg("%s", error.text);
    for (int k = 0; k < samples; k++) {
        struct sample_data data = {0};
        if (!source.next(source.self, k, &data, reason, sizeof reason))
            fail_msg("%s", reason);
        u[k] = data.u[input];
    }
    source.destroy(source.self);
}

static void steps_arrive_at_the_first_sample_not_before_them(void **state)
{
    (void)state;
    /* samples at 0, 2, 4, .. s: 3 s is sample 2, 8 s is sample 4 */
    struct scenario *scenario = parse(tank,
                                      "    - name: u2\n"
                                      "      signal: steps\n"
                                      "      value: 9\n"
                                      "      steps: [{at_s: 3, value: 10}, {at_s: 8, value: 8}]\n",
                                      NULL);
    const double want[] = {9, 9, 10, 10, 8, 8};
    double u[6];
    run(scenario, 1, u, 6);
    assert_memory_equal(u, want, sizeof want);
    run(scenario, 0, u, 6); /* the other input stays where plant.inputs put it */
    for (int k = 0; k < 6; k++)
        assert_true(fabs(u[k] - 7) <= 0);
    scenario_free(scenario);
}

static void a_sinusoid_counts_in_seconds_and_brings_its_rate(void **state)
{
    (void)state;
    struct scenario *scenario = parse("plant:\n  name: cstr2\n  set: ch4\n  drive:\n",
                                      "    - name: F0\n"
                                      "      signal: sinusoid\n"
                                      "      value: 10\n"
                                      "      amplitude: 9\n"
                                      "      omega: 0.008\n"
                                      "      phase: 0.25\n",
                                      NULL);
    double feed[20], rate[20];
    run(scenario, 0, feed, 20);
    run(scenario, 1, rate, 20);
    for (int k = 0; k < 20; k++) {
        /* per hour, as the plant has it */
        assert_true(fabs(feed[k] - 10 * (1 + 0.9 * sin(0.008 * 2 * k + 0.25))) < 1e-12);
        assert_true(fabs(rate[k] - 9 * 0.008 * 3600 * cos(0.008 * 2 * k + 0.25)) < 1e-9);
    }
    scenario_free(scenario);
}

static void prbs_bits_last_as_long_as_asked(void **state)
{
    (void)state;
    struct scenario *scenario =
        parse(tank, "    - {name: u1, signal: prbs, value: 7, amplitude: 0.5, bit_s: 6}\n", NULL);
    double u[150];
    int changes = 0;
    run(scenario, 0, u, COUNT(u));
    for (int k = 0; k < COUNT(u); k++) {
        assert_true(fabs(fabs(u[k] - 7) - 0.5) < 1e-15);
        if (k > 0 && fabs(u[k] - u[k - 1]) > 0) {
            assert_int_equal(k % 3, 0);
            changes++;
        }
    }
    assert_in_range(changes, 10, 40);
    scenario_free(scenario);
}

static const char cascade[] = "    - name: u1\n"
                              "      value: 53\n"
                              "      loop:\n"
                              "        output: y1\n"
                              "        outer: {kp: 0.4, ti_s: 200}\n"
                              "        inner: {kp: 0.5, ti_s: 4}\n"
                              "        low: 0\n"
                              "        high: 20\n"
                              "        lag_s: 5\n";

static void a_cascade_brings_the_level_to_its_set_point(void **state)
{
    (void)state;
    struct scenario *scenario = parse(tank, cascade, "time.duration_s=7200");
    struct error error = {.text = ""};
    struct sample_source source;
    struct sample_data data = {0};
    char reason[256] = "";
    assert_true(plant_source(scenario, &source, &error));
    for (int k = 0; k < 3000; k++)
        if (!source.next(source.self, k, &data, reason, sizeof reason))
            fail_msg("%s", reason);
    if (!(fabs(data.x[0] - 53) < 1e-3))
        fail_msg("level %g", data.x[0]);
    source.destroy(source.self);
    scenario_free(scenario);
}

static void times_of_a_loop_are_in_plant_time(void **state)
{
    (void)state;
    struct scenario *scenario = parse(tank, cascade, NULL);
    struct plant_drives drives;
    assert_true(plant_drives_make(scenario, &drives));
    const struct sim_loop *loop = drives.drives[0].loop;
    assert_non_null(loop);
    assert_int_equal(drives.drives[0].input, 0);
    assert_int_equal(loop->output, 0);
    assert_true(loop->cascaded);
    const double got[] = {loop->outer.kp,   loop->outer.ti * 3600,
                          loop->inner.kp,   loop->inner.ti * 3600,
                          loop->low,        loop->high,
                          loop->lag * 3600, drives.drives[0].signal.value};
    const double want[] = {0.4, 200, 0.5, 4, 0, 20, 5, 53};
    for (int i = 0; i < COUNT(want); i++)
        if (!(fabs(got[i] - want[i]) < 1e-12 * (1 + want[i])))
            fail_msg("number %d: %g is not %g", i, got[i], want[i]);
    plant_drives_free(&drives);
    scenario_free(scenario);
}

static void drives_are_part_of_the_experiment(void **state)
{
    (void)state;
    const char one[] = "    - {name: u1, value: 7}\n";
    struct scenario *plain = parse(tank, one, NULL);
    struct scenario *other = parse(tank, one, "plant.drive.u1.value=8");
    struct scenario *more = parse(tank, one, "plant.drive.u2.value=9");
    assert_true(plain->hash != other->hash);
    assert_true(fabs(other->plant.drive[0].value - 8) <= 0);
    assert_int_equal(more->plant.drive_count, 2);
    assert_string_equal(more->plant.drive[1].name, "u2");
    scenario_free(plain);
    scenario_free(other);
    scenario_free(more);
}

/* Estimators see the nominal value of an unknown input, the log's truth has what it was. */
static void an_unknown_input_moves_the_plant_and_is_not_told(void **state)
{
    (void)state;
    static const char text[] =
        "name: hidden\n"
        "time: {period_s: 0.01, duration_s: 5}\n"
        "plant:\n"
        "  name: descriptor_uio\n"
        "  drive:\n"
        "    - {name: u1, signal: sinusoid, value: 0, amplitude: 1, omega: 2,\n"
        "       phase: 1.5707963267948966}\n"
        "    - {name: u2, signal: steps, value: 0,\n"
        "       steps: [{at_s: 2, value: 5}, {at_s: 5, value: 2}]}\n"
        "    - {name: v, signal: sinusoid, value: 0, amplitude: 5, omega: 1}\n"
        "networks:\n"
        "  - name: one\n"
        "    guess: [0, 0, 0, 0]\n"
        "    high_gain_ekf: {d: 0.02, DeltaT: 0.001, beta: 5, m: 4, lambda: 100, theta_m: 20,\n"
        "      Q: [1, 1, 1, 1], R: [1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1]}\n";
    struct error error = {.text = ""};
    struct scenario *scenario = scenario_parse(text, "x.yaml", NULL, 0, &error);
    struct sample_source source;
    struct sample_data data = {0};
    char reason[256] = "";
    assert_string_equal(error.text, "");
    if (!plant_source(scenario, &source, &error))
        fail_msg("%s", error.text);
    for (int k = 0; k <= 450; k++) {
        if (!source.next(source.self, k, &data, reason, sizeof reason))
            fail_msg("%s", reason);
        assert_true(data.u[2] >= 0 && data.u[2] <= 0);
        assert_true(fabs(data.u[0] - cos(0.02 * k)) < 1e-13);
        assert_true(fabs(data.x[3] + cos(0.02 * k)) < 1e-13); /* x4 = -u1 */
        assert_true(fabs(data.x[4] - 5 * sin(0.01 * k)) < 1e-12);
    }
    /* reference data at t = 4.5: v has been at work */
    static const double x[] = {6.226658320509743, 4.163549450714199, -3.746200664254506,
                               0.9111302618846769};
    for (int i = 0; i < 4; i++)
        assert_true(fabs(data.x[i] - x[i]) < 1e-7 * (1 + fabs(x[i])));
    source.destroy(source.self);
    scenario_free(scenario);
}

/* ---- what is refused ---- */

static void what_makes_no_sense_is_refused_where_it_stands(void **state)
{
    (void)state;
    static const struct {
        const char *drives, *expected;
    } cases[] = {
        {"    - {name: u3, value: 1}\n",
         "x.yaml:9: plant.drive[0].name: the plant has no input called u3; there are: u1, u2"},
        {"    - {name: u1, value: 1}\n    - {name: u1, value: 2}\n",
         "x.yaml:10: plant.drive[1].name: u1 is driven by plant.drive[0] too"},
        {"    - {name: u1}\n", "plant.drive[0].value: is missing"},
        {"    - {name: u1, value: 1, signal: ramp}\n", "'ramp' is not one of: constant, steps"},
        {"    - {name: u1, value: 1, amplitude: 2}\n",
         "plant.drive[0].amplitude: is not used by a signal of kind constant"},
        {"    - {name: u1, value: 1, signal: prbs, amplitude: 2, bit_s: 4, omega: 1}\n",
         "plant.drive[0].omega: is not used by a signal of kind prbs"},
        {"    - {name: u1, value: 1, signal: steps, phase: 1, steps: [{at_s: 4, value: 1}]}\n",
         "plant.drive[0].phase: is not used by a signal of kind steps"},
        {"    - {name: u1, value: 1, signal: prbs, amplitude: 2}\n",
         "plant.drive[0].bit_s: is missing: a signal of kind prbs needs it"},
        {"    - {name: u1, value: 1, signal: prbs, bit_s: 2, amplitude: 0}\n",
         "plant.drive[0].amplitude: 0 is out of range; it must be > 0"},
        {"    - {name: u1, value: 1, signal: prbs, amplitude: 2, bit_s: 5}\n",
         "plant.drive[0].bit_s: 5 are 2.5 periods; it must be a whole number of them"},
        {"    - {name: u1, value: 1, signal: sinusoid, amplitude: 2}\n",
         "plant.drive[0].omega: is missing: a signal of kind sinusoid needs it"},
        {"    - {name: u1, value: 1, signal: steps}\n",
         "plant.drive[0].steps: is missing: a signal of kind steps needs it"},
        {"    - {name: u1, value: 1, signal: steps,\n"
         "       steps: [{at_s: 4, value: 1},\n"
         "               {at_s: 5, value: 1}]}\n",
         "x.yaml:11: plant.drive[0].steps[1].at_s: 5 is not at least one period after"},
        {"    - {name: u1, value: 1, signal: steps, steps: [{at_s: -1, value: 1}]}\n",
         "plant.drive[0].steps[0].at_s: -1 is out of range; it must be >= 0"},
        {"    - {name: u1, value: 1, loop: {output: y4, outer: {kp: 1}, low: 0, high: 1}}\n",
         "plant.drive[0].loop.output: the plant has no output called y4; there are: y1, y2, y3"},
        {"    - {name: u1, value: 1, loop: {output: y1, outer: {kp: 1}, low: 2, high: 1}}\n",
         "plant.drive[0].loop.high: 1 is not above low, 2"},
        {"    - {name: u1, value: 1, loop: {output: y1, outer: {kp: 1}, low: 0, high: 1,\n"
         "       lag_s: 3}}\n",
         "plant.drive[0].loop.lag_s: belongs to a cascade"},
        {"    - {name: u1, value: 1, loop: {output: y1, outer: {kp: 1, ti_s: 0}, low: 0,\n"
         "       high: 1}}\n",
         "plant.drive[0].loop.outer.ti_s: 0 is out of range; it must be > 0"},
        {"    - {name: u1, value: 1, loop: {output: y1, low: 0, high: 1}}\n",
         "plant.drive[0].loop.outer: is missing"},
    };
    for (int c = 0; c < COUNT(cases); c++) {
        struct error error = {.text = ""};
        char *text = text_of(tank, cases[c].drives);
        assert_null(scenario_parse(text, "x.yaml", NULL, 0, &error));
        free(text);
        if (strstr(error.text, cases[c].expected) == NULL)
            fail_msg("\n  message:  %s\n  expected: %s", error.text, cases[c].expected);
    }
}

static void a_rate_input_cannot_be_driven(void **state)
{
    (void)state;
    struct error error = {.text = ""};
    char *text = text_of("plant:\n  name: cstr2\n  drive:\n", "    - {name: dF0, value: 1}\n");
    assert_null(scenario_parse(text, "x.yaml", NULL, 0, &error));
    free(text);
    assert_non_null(strstr(error.text, "dF0 is the time derivative of F0 and follows by itself"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(steps_arrive_at_the_first_sample_not_before_them),
        cmocka_unit_test(a_sinusoid_counts_in_seconds_and_brings_its_rate),
        cmocka_unit_test(prbs_bits_last_as_long_as_asked),
        cmocka_unit_test(a_cascade_brings_the_level_to_its_set_point),
        cmocka_unit_test(times_of_a_loop_are_in_plant_time),
        cmocka_unit_test(drives_are_part_of_the_experiment),
        cmocka_unit_test(an_unknown_input_moves_the_plant_and_is_not_told),
        cmocka_unit_test(what_makes_no_sense_is_refused_where_it_stands),
        cmocka_unit_test(a_rate_input_cannot_be_driven),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
