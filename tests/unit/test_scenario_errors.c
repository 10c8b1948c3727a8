/* The scenario reader on what is wrong: every message names file, line, key and value and says what
 * is allowed; nothing crashes or leaks. Cases are one change each to a scenario that is right. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "methods/high_gain_ekf_section.h"
#include "methods/method.h"
#include "runtime/scenario_internal.h"

/* Line numbers in the cases count from the first line here. */
static const char good[] = "name: good\n"                                  /* 1 */
                           "seed: 1\n"                                     /* 2 */
                           "time:\n"                                       /* 3 */
                           "  period_s: 1\n"                               /* 4 */
                           "  duration_s: 10\n"                            /* 5 */
                           "plant:\n"                                      /* 6 */
                           "  name: cstr2\n"                               /* 7 */
                           "  set: ch2\n"                                  /* 8 */
                           "  parameters: [{name: Fr, value: 35}]\n"       /* 9 */
                           "  x0: [360, 3, 320, 2.5]\n"                    /* 10 */
                           "  inputs: [5, 0]\n"                            /* 11 */
                           "noise:\n"                                      /* 12 */
                           "  process:\n"                                  /* 13 */
                           "    distribution: uniform\n"                   /* 14 */
                           "    scale: [1, 1, 1, 1]\n"                     /* 15 */
                           "networks:\n"                                   /* 16 */
                           "  - name: one\n"                               /* 17 */
                           "    guess: [396, 2.6, 352, 10.5]\n"            /* 18 */
                           "    high_gain_ekf:\n"                          /* 19 */
                           "      communication: {kind: tick, every: 2}\n" /* 20 */
                           "      d: 0.02\n"                               /* 21 */
                           "      DeltaT: 0.001\n"                         /* 22 */
                           "      beta: 5\n"                               /* 23 */
                           "      m: 4\n"                                  /* 24 */
                           "      lambda: 100\n"                           /* 25 */
                           "      theta_m: 20\n"                           /* 26 */
                           "      Q: [150, 5, 150, 5]\n"                   /* 27 */
                           "      R: [1, 1]\n"                             /* 28 */
                           "timeouts: {repeat_s: 0.1}\n";                  /* 29 */

/* `text` with the first `from` replaced, freed by the caller. */
static char *replace(const char *text, const char *from, const char *to)
{
    const char *at = strstr(text, from);
    if (at == NULL)
        fail_msg("'%s' is not in the scenario", from);
    size_t before = (size_t)(at - text), size = strlen(text) + strlen(to) + 1;
    char *result = malloc(size);
    assert_non_null(result);
    snprintf(result, size, "%.*s%s%s", (int)before, text, to, at + strlen(from));
    return result;
}

static void expect(const char *yaml, const char *override, const char *expected)
{
    struct error error = {.text = ""};
    struct scenario *scenario =
        scenario_parse(yaml, "x.yaml", &override, override != NULL ? 1 : 0, &error);
    if (scenario != NULL)
        fail_msg("was accepted; expected: %s", expected);
    if (strstr(error.text, expected) == NULL)
        fail_msg("\n  message:  %s\n  expected: %s", error.text, expected);
}

struct change {
    const char *from, *to, *expected;
};

static void expect_all(const struct change *cases, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        char *yaml = replace(good, cases[i].from, cases[i].to);
        expect(yaml, NULL, cases[i].expected);
        free(yaml);
    }
}

#define EXPECT_ALL(cases) expect_all(cases, sizeof(cases) / sizeof(cases)[0])

static void the_unchanged_scenario_is_accepted(void **state)
{
    (void)state;
    struct error error = {.text = ""};
    struct scenario *scenario = scenario_parse(good, "x.yaml", NULL, 0, &error);
    assert_string_equal(error.text, "");
    assert_non_null(scenario);
    scenario_free(scenario);
}

static void a_message_reads_as_documented(void **state)
{
    (void)state;
    struct error error = {.text = ""};
    char *yaml = replace(good, "theta_m: 20", "theta_m: -3");
    assert_null(scenario_parse(yaml, "x.yaml", NULL, 0, &error));
    assert_string_equal(error.text,
                        "x.yaml:26: networks[0].high_gain_ekf.theta_m: -3 is out of range; it must "
                        "be > 1 (half of the largest gain parameter theta)");
    free(yaml);
}

/* ---- keys ---- */

static void unknown_keys_are_answered_with_the_allowed_ones(void **state)
{
    (void)state;
    static const struct change cases[] = {
        {"period_s", "perod_s",
         "x.yaml:4: time.perod_s: unknown key; allowed here: period_s, duration_s (did you mean "
         "period_s?)"},
        {"seed", "sede", "x.yaml:2: sede: unknown key; allowed here: name, title, source, seed,"},
        {"high_gain_ekf", "high_gain_efk",
         "x.yaml:19: networks[0].high_gain_efk: unknown key; allowed here: name, "},
        {"high_gain_ekf", "high_gain_efk", "(did you mean high_gain_ekf?)"},
        {"every: 2", "evry: 2", "x.yaml:20: networks[0].high_gain_ekf.communication.evry: unknown"},
        {"value: 35", "vlaue: 35", "x.yaml:9: plant.parameters[0].vlaue: unknown key"},
        {"seed: 1", "'': 1", "x.yaml:2: '': unknown key"},
        {"seed: 1", "\"\\x01\\n\": 1", "x.yaml:2: "},
    };
    EXPECT_ALL(cases);
}

static void missing_required_keys_are_named_with_their_meaning(void **state)
{
    (void)state;
    static const struct change cases[] = {
        {"name: good\n", "", "x.yaml:1: name: is missing (name of the experiment"},
        {"  period_s: 1\n", "", "x.yaml:4: time.period_s: is missing (sampling period in seconds)"},
        {"      theta_m: 20\n", "", "networks[0].high_gain_ekf.theta_m: is missing (half of"},
        {"{name: Fr, value: 35}", "{name: Fr}", "x.yaml:9: plant.parameters[0].value: is missing"},
        {"    distribution: uniform\n", "", "noise.process.distribution: is missing"},
    };
    EXPECT_ALL(cases);
}

static void keys_given_twice_are_refused(void **state)
{
    (void)state;
    static const struct change cases[] = {
        {"seed: 1", "seed: 1\nseed: 2", "x.yaml:3: seed: given twice"},
        {"      m: 4\n", "      m: 4\n      d: 1\n", "x.yaml:25: d: given twice"},
        {"[{name: Fr, value: 35}]", "[{name: Fr, value: 35}, {name: Fr, value: 36}]",
         "x.yaml:9: plant.parameters[1]: Fr is given twice"},
    };
    EXPECT_ALL(cases);
}

/* ---- values ---- */

static void values_of_a_wrong_kind_are_refused(void **state)
{
    (void)state;
    static const struct change cases[] = {
        {"period_s: 1", "period_s: soon",
         "x.yaml:4: time.period_s: 'soon' is not a number (sampling period in seconds)"},
        {"period_s: 1", "period_s: 1 s", "'1 s' is not a number"},
        {"period_s: 1", "period_s: 0x10", "'0x10' is not a number"},
        {"period_s: 1", "period_s: 1,5", "'1,5' is not a number"},
        {"period_s: 1", "period_s: 1e", "'1e' is not a number"},
        {"period_s: 1", "period_s:", "time.period_s: must be a number, not nothing"},
        {"period_s: 1", "period_s: [1]", "time.period_s: must be a number, not a list"},
        {"period_s: 1", "period_s: {s: 1}", "must be a number, not a group of keys"},
        {"R: [1, 1]", "R: 1", "x.yaml:28: networks[0].high_gain_ekf.R: must be a list, not '1'"},
        {"R: [1, 1]", "R: [1, [1]]", "high_gain_ekf.R[1]: must be a number, not a list"},
        {"R: [1, 1]", "R: {a: 1}", "high_gain_ekf.R: must be a list, not a group of keys"},
        {"seed: 1", "seed: 1.5", "x.yaml:2: seed: must be a whole number >= 0, not '1.5'"},
        {"seed: 1", "seed: -1", "seed: must be a whole number >= 0, not '-1'"},
        {"seed: 1", "seed: 010", "seed: must be a whole number >= 0, not '010'"},
        {"seed: 1", "seed: 18446744073709551616",
         "is too large; the largest is 184467440737095516"},
        {"every: 2", "every: 4294967296", "4294967296 is too large; the largest is 4294967295"},
        {"name: good", "name: [a]", "x.yaml:1: name: must be a text, not a list"},
        {"name: good", "name: ''", "name: must be a text, not nothing"},
        {"plant:\n", "plant: cstr2\n", "x.yaml:7: not valid YAML"},
        {"timeouts: {repeat_s: 0.1}", "timeouts: [1]", "timeouts: must be a group of keys"},
        {"kind: tick", "kind: ticks",
         "x.yaml:20: networks[0].high_gain_ekf.communication.kind: 'ticks' is not one of: tick, "
         "stages, none, triggered (did you mean tick?)"},
        {"distribution: uniform", "distribution: 1", "'1' is not one of: none, uniform, gaussian"},
        {"distribution: uniform", "distribution: []", "a list is not one of: none, uniform"},
        {"every: 2", "every: 2, predictor: maybe", "'maybe' is not one of: true, false"},
    };
    EXPECT_ALL(cases);
}

static void numbers_that_no_double_holds_are_refused(void **state)
{
    (void)state;
    static const struct change cases[] = {
        {"x0: [360", "x0: [.nan", "x.yaml:10: plant.x0[0]: '.nan' is not a finite number"},
        {"x0: [360", "x0: [NaN", "'NaN' is not a finite number"},
        {"x0: [360", "x0: [.inf", "'.inf' is not a finite number"},
        {"x0: [360", "x0: [-.inf", "'-.inf' is not a finite number"},
        {"x0: [360", "x0: [infinity", "'infinity' is not a finite number"},
        {"x0: [360", "x0: [1e400", "plant.x0[0]: '1e400' is too large for a double"},
        {"x0: [360", "x0: [-1e400", "'-1e400' is too large for a double"},
        {"x0: [360", "x0: [1e-400", "'1e-400' is too small for a double"},
    };
    EXPECT_ALL(cases);
}

static void numbers_out_of_their_limits_are_refused(void **state)
{
    (void)state;
    static const struct change cases[] = {
        {"period_s: 1", "period_s: -1",
         "x.yaml:4: time.period_s: -1 is out of range; it must be "
         "> 0 (sampling period in seconds)"},
        {"period_s: 1", "period_s: 0", "time.period_s: 0 is out of range"},
        {"duration_s: 10", "duration_s: 0.5",
         "x.yaml:5: time.duration_s: 0.5 is shorter than one period of 1"},
        {"duration_s: 10", "duration_s: 1e12", "1e+12 makes more than 1e+09 samples of 1"},
        {"scale: [1, 1", "scale: [1, -1",
         "x.yaml:15: noise.process.scale[1]: -1 is out of range; "
         "it must be >= 0"},
        {"R: [1, 1]", "R: [1, 0]", "high_gain_ekf.R[1]: 0 is out of range; it must be > 0"},
        {"Q: [150", "Q: [-150", "high_gain_ekf.Q[0]: -150 is out of range; it must be >= 0"},
        {"d: 0.02", "d: 0", "x.yaml:21: networks[0].high_gain_ekf.d: 0 is out of range"},
        {"every: 2", "every: 0", "every: 0 is out of range; it must be >= 1 and <= 1000000"},
        {"every: 2", "every: 1000001", "every: 1000001 is out of range"},
        {"noise:\n", "noise:\n  missing: 1.5\n",
         "x.yaml:13: noise.missing: 1.5 is out of range; it must be >= 0 and <= 1"},
        {"noise:\n", "noise:\n  dead: [{output: y1, start_s: -1}]\n",
         "x.yaml:13: noise.dead[0].start_s: -1 is out of range; it must be >= 0"},
        {"noise:\n", "noise:\n  dead: [{output: y1, start_s: 2, end_s: 1}]\n",
         "x.yaml:13: noise.dead[0]: ends at 1 s, which is not after its start at 2 s"},
        {"noise:\n", "noise:\n  dead: [{output: y3, start_s: 2}]\n",
         "x.yaml:13: noise.dead[0].output: the plant has no output called y3; there are: y1, y2"},
        {"noise:\n", "noise:\n  dead: [{output: y1, start_s: 1e300}]\n",
         "x.yaml:13: noise.dead[0]: lies beyond the longest run"},
        {"repeat_s: 0.1", "repeat_s: -1", "x.yaml:29: timeouts.repeat_s: -1 is out of range"},
        {"value: 35", "value: -5",
         "x.yaml:9: plant.parameters[0].value: -5 is out of range; Fr must be >= 0 and <= 1000000 "
         "m3/h (recycle flow from reactor 2 to 1)"},
    };
    EXPECT_ALL(cases);
}

static void lists_have_the_length_that_the_plant_gives_them(void **state)
{
    (void)state;
    static const struct change cases[] = {
        {"x0: [360, 3, 320, 2.5]", "x0: [360, 3, 320]",
         "x.yaml:10: plant.x0: has 3 values; it must have 4, one per state of cstr2: T1, C1, T2, "
         "C2 (true initial state"},
        {"inputs: [5, 0]", "inputs: [5]",
         "plant.inputs: has 1 values; it must have 2, one per "
         "input of cstr2: F0, dF0"},
        {"scale: [1, 1, 1, 1]", "scale: [1, 1]",
         "noise.process.scale: has 2 values; it must have "
         "4, one per state"},
        {"guess: [396, 2.6, 352, 10.5]", "guess: []", "x.yaml:18: networks[0].guess: has 0 values"},
        {"R: [1, 1]", "R: [1]", "R: has 1 values; it must have 2, one per output of cstr2: y1, y2"},
        {"Q: [150, 5, 150, 5]", "Q: [150, 5]", "Q: has 2 values; it must have 4, one per state"},
    };
    EXPECT_ALL(cases);
    expect(
        good, "noise.measurement={distribution: gaussian, scale: [1]}",
        "noise.measurement.scale: has 1 values; it must have 2, one per output of cstr2: y1, y2");
}

/* ---- meaning ---- */

static void names_that_nothing_carries_are_answered_with_what_there_is(void **state)
{
    (void)state;
    static const struct change cases[] = {
        {"name: cstr2", "name: cstr",
         "x.yaml:7: plant.name: there is no plant called cstr; there are: cavity_forced, "},
        {"set: ch2", "set: ch3",
         "x.yaml:8: plant.set: the plant has no set called ch3; there are: ch2, ch4, cdm (did you"},
        {"name: Fr", "name: F_r",
         "x.yaml:9: plant.parameters[0].name: the plant has no parameter "
         "called F_r; there are: V1, V2,"},
        {"- name: one", "- name: one\n    set: ch5",
         "x.yaml:18: networks[0].set: the plant has no"},
        {"- name: one", "- name: one\n    parameters: [{name: X, value: 1}]",
         "x.yaml:18: networks[0].parameters[0].name: the plant has no parameter called X"},
    };
    EXPECT_ALL(cases);
}

static void names_consist_of_plain_letters_and_are_unique(void **state)
{
    (void)state;
    static const struct change cases[] = {
        {"name: good", "name: not good", "x.yaml:1: name: 'not good' is not a name: letters"},
        {"- name: one", "- name: one/two", "x.yaml:17: networks[0].name: 'one/two' is not a name"},
        {"- name: one", "- name: aaaaaaaaaabbbbbbbbbbccccccccccdd",
         "networks[0].name: has 32 characters; it must have 1 to 31"},
    };
    EXPECT_ALL(cases);
    char *two = replace(good, "timeouts",
                        "  - name: one\n"
                        "    guess: [1, 1, 1, 1]\n"
                        "    high_gain_ekf: {d: 0.02, DeltaT: 1, beta: 1, m: 1,\n"
                        "      lambda: 1, theta_m: 2, Q: [1, 1, 1, 1], R: [1, 1]}"
                        "\ntimeouts");
    expect(two, NULL, "x.yaml:29: networks[1].name: 'one' is the name of networks[0] too");
    free(two);
}

static void a_network_has_one_method_and_a_scenario_a_network(void **state)
{
    (void)state;
    struct error error = {.text = ""};
    expect("name: a\ntime: {period_s: 1, duration_s: 1}\nplant: {name: cstr2}\nnetworks:\n"
           "  - {name: one, guess: [1, 1, 1, 1]}\n",
           NULL,
           "x.yaml:5: networks[0]: has no method; one of these sections is needed: high_gain_ekf");
    expect(good, "networks=[]", "networks: has 0 entries; it must have 1 to 16");
    expect(good, "networks.one.high_gain_ekf=", "there is no value after =");
    expect(good, "networks.one.high_gain_ekf=''", "must be a group of keys, not nothing");
    assert_string_equal(error.text, "");
}

static void noise_without_scale_is_refused(void **state)
{
    (void)state;
    static const struct change cases[] = {
        {"    scale: [1, 1, 1, 1]\n", "", "noise.process: scale is missing"}};
    EXPECT_ALL(cases);
    /* switched off by an override, the scale may stay */
    struct error error = {.text = ""};
    const char *override = "noise.process.distribution=none";
    struct scenario *scenario = scenario_parse(good, "x.yaml", &override, 1, &error);
    assert_non_null(scenario);
    scenario_free(scenario);
}

/* ---- YAML ---- */

static void text_that_is_not_a_scenario_is_refused(void **state)
{
    (void)state;
    static const char *const cases[][2] = {
        {"", "x.yaml:1: there is nothing in it"},
        {"# only a comment\n", "there is nothing in it"},
        {"---\n...\n", "must be a group of keys, not nothing (dse-run --keys lists all keys)"},
        {"just text\n", "x.yaml:1: must be a group of keys, not 'just text'"},
        {"- a\n- b\n", "x.yaml:1: must be a group of keys, not a list"},
        {"a: 1\n---\nb: 2\n", "x.yaml:3: a second document begins"},
        {"a: 1\n---\nb: [\n", "x.yaml:4: not valid YAML"},
        {"time:\n\tperiod_s: 1\n", "x.yaml:2: not valid YAML: while scanning for the next token, "
                                   "found character that cannot start any token, column 1 (a tab: "
                                   "indent with spaces)"},
        {"a: [1, 2\nb: 3\n", "x.yaml:2: not valid YAML"},
        {"a: 'x\n", "not valid YAML"},
        {"a: *nowhere\n", "x.yaml:1: not valid YAML: found undefined alias"},
        {"a: 1\nb: \xff\xfe\n", "x.yaml:2: invalid leading UTF-8 octet (byte 8)"},
        {"? [a, b]\n: 1\n", "x.yaml:1: a key must be a word"},
        {"name: \"a\\0b\"\n", "x.yaml:1: a text contains a zero character"},
        {"<<: 3\n", "x.yaml:1: << must name a mapping"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        expect(cases[i][0], NULL, cases[i][1]);
}

static void aliases_cannot_blow_up_or_contain_themselves(void **state)
{
    (void)state;
    char bomb[1024] = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n", line[96];
    for (int i = 1; i < 10; i++) {
        snprintf(line, sizeof line, "a%d: &a%d [*a%d, *a%d, *a%d, *a%d, *a%d, *a%d, *a%d]\n", i, i,
                 i - 1, i - 1, i - 1, i - 1, i - 1, i - 1, i - 1);
        strcat(bomb, line);
    }
    expect(bomb, NULL, "too many values");

    char merges[1024] = "a0: &a0 {x: 1}\n";
    for (int i = 1; i < 12; i++) {
        snprintf(line, sizeof line, "a%d: &a%d {<<: [*a%d, *a%d, *a%d, *a%d, *a%d]}\n", i, i, i - 1,
                 i - 1, i - 1, i - 1, i - 1);
        strcat(merges, line);
    }
    expect(merges, NULL, "too many values");
    expect("a: &a [*a]\n", NULL, "x.yaml:1: nested too deeply; does an alias contain itself?");
    expect("a: &a {b: 1, <<: *a}\n", NULL, "nested too deeply");

    char deep[257];
    memset(deep, '[', 128);
    memset(deep + 128, ']', 128);
    deep[256] = '\0';
    expect(deep, NULL, "nested too deeply");
}

static void a_mapping_with_thousands_of_keys_is_refused(void **state)
{
    (void)state;
    char *yaml = malloc(16 * 2000 + 1), *end = yaml;
    assert_non_null(yaml);
    for (int i = 0; i < 2000; i++)
        end += sprintf(end, "k%d: 1\n", i);
    expect(yaml, NULL, "x.yaml:1: too many keys in one place");
    free(yaml);
}

/* A reader that stops anywhere gives a message or a scenario, never a crash (run with ASan). */
static void every_truncation_is_answered(void **state)
{
    (void)state;
    char cut[sizeof good];
    for (size_t n = 0; n < sizeof good - 1; n++) {
        struct error error = {.text = ""};
        memcpy(cut, good, n);
        cut[n] = '\0';
        struct scenario *scenario = scenario_parse(cut, "x.yaml", NULL, 0, &error);
        assert_true((scenario == NULL) == (error.text[0] != '\0'));
        scenario_free(scenario);
    }
}

static void every_flipped_character_is_answered(void **state)
{
    (void)state;
    static const char flips[] = "\t:[]{}&*-#'\"\\!|>%@`0\x01\x80";
    char changed[sizeof good];
    for (size_t n = 0; n < sizeof good - 1; n++) {
        struct error error = {.text = ""};
        memcpy(changed, good, sizeof good);
        changed[n] = flips[n % (sizeof flips - 1)];
        struct scenario *scenario = scenario_parse(changed, "x.yaml", NULL, 0, &error);
        assert_true((scenario == NULL) == (error.text[0] != '\0'));
        scenario_free(scenario);
    }
}

/* ---- overrides ---- */

static void overrides_that_do_not_fit_are_answered_like_lines_of_the_file(void **state)
{
    (void)state;
    static const char *const cases[][2] = {
        {"seed", "x.yaml (--set seed): expected key=value"},
        {"=3", "expected key=value"},
        {"seed=", "x.yaml (--set seed=): there is no value after ="},
        {"seed=x", "x.yaml (--set seed=x): seed: must be a whole number >= 0, not 'x'"},
        {"tme.period_s=2", "x.yaml (--set tme.period_s=2): tme: unknown key; allowed here: name,"},
        {"time.perod_s=2", "x.yaml (--set time.perod_s=2): time.perod_s: unknown key; allowed "
                           "here: period_s, duration_s (did you mean period_s?)"},
        {"networks.one.high_gain_ekf.theta_m=-3",
         "x.yaml (--set networks.one.high_gain_ekf.theta_m=-3): networks[0].high_gain_ekf.theta_m: "
         "-3 is out of range; it must be > 1"},
        {"networks.oen.guess=[1]", "networks has no entry oen; there are: one (did you mean one?)"},
        {"networks[1].guess=[1]", "networks has no entry 1; there are: one"},
        {"networks[-1].guess=[1]", "networks has no entry -1"},
        {"networks.99999999999999999999.name=a", "networks has no entry 99999999999999999999"},
        {"plant.x0[4]=1", "plant.x0 has no entry 4; there are: 4 entries"},
        {"plant.x0=[1, 2]", "x.yaml (--set plant.x0=[1, 2]): plant.x0: has 2 values"},
        {"plant.x0=[1, 2", "x.yaml (--set plant.x0=[1, 2): not valid YAML"},
        {"plant.x0=*a", "not valid YAML: found undefined alias"},
        {"plant.name.x=1", "plant.name is a single value, nothing lies below it"},
        {"plant..name=1", "a key is written as in plant.x0 or networks[0].name"},
        {"plant.=1", "a key is written as in"},
        {".=1", "a key is written as in"},
        {"plant.parameters.Fx=1", "x.yaml (--set plant.parameters.Fx=1): "
                                  "plant.parameters[1].name: the plant has no parameter called Fx"},
        {"plant.parameters.Fr=-1", "plant.parameters[0].value: -1 is out of range; Fr must be"},
        {"plant.parameters.Fr=[1]", "plant.parameters[0].value: must be a number, not a list"},
        {"time={a: 1, a: 2}", "x.yaml (--set time={a: 1, a: 2}): a: given twice"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        expect(good, cases[i][0], cases[i][1]);
    char far[400];
    memset(far, 'a', sizeof far);
    memcpy(far + sizeof far - 3, "=1", 3);
    expect(good, far, "expected key=value");
    expect(good, far + 200, "a key is written as in");
}

static void the_first_wrong_override_is_named(void **state)
{
    (void)state;
    struct error error = {.text = ""};
    const char *const overrides[] = {"seed=5", "plant.set=ch3", "time.period_s=2"};
    assert_null(scenario_parse(good, "x.yaml", overrides, 3, &error));
    assert_non_null(
        strstr(error.text, "x.yaml (--set plant.set=ch3): plant.set: the plant has no"));
}

/* ---- files ---- */

static void files_that_cannot_be_read_are_named(void **state)
{
    (void)state;
    struct error error = {.text = ""};
    assert_null(scenario_read("does/not/exist.yaml", NULL, 0, &error));
    assert_string_equal(error.text, "does/not/exist.yaml: No such file or directory");
    error.text[0] = '\0';
    assert_null(scenario_read(".", NULL, 0, &error));
    assert_string_equal(error.text, ".: Is a directory");
}

static void read_file(const char *bytes, size_t size, size_t repeat, const char *expected)
{
    struct error error = {.text = ""};
    char path[] = "scenario_XXXXXX";
    int handle = mkstemp(path);
    assert_true(handle >= 0);
    FILE *file = fdopen(handle, "wb");
    for (size_t i = 0; i < repeat; i++)
        assert_int_equal(fwrite(bytes, 1, size, file), size);
    fclose(file);
    struct scenario *scenario = scenario_read(path, NULL, 0, &error);
    unlink(path);
    if (expected == NULL) {
        assert_non_null(scenario);
        assert_string_equal(scenario->file, path);
        scenario_free(scenario);
        return;
    }
    assert_null(scenario);
    if (strstr(error.text, expected) == NULL)
        fail_msg("%s: expected %s", error.text, expected);
}

static void files_that_are_no_text_are_refused(void **state)
{
    (void)state;
    read_file(good, strlen(good), 1, NULL);
    read_file("a: 1\0b", 6, 1, "contains a zero byte");
    read_file("# a long comment\n", 17, 70000, "is larger than 1048576 bytes");
}

/* ---- the section's own check ---- */

static void combinations_that_make_no_filter_are_refused(void **state)
{
    (void)state;
    const double period = 1.0 / 3600;
    static const struct {
        struct high_gain_ekf_section section;
        const char *expected; /* NULL: allowed */
    } cases[] = {
        {{.d = 0.02}, NULL},
        {{.d = 0.02, .communication = {.kind = DSE_HIGH_GAIN_STAGES, .every = 1}}, NULL},
        {{.d = 0.02, .communication = {.kind = DSE_HIGH_GAIN_STAGES, .every = 2}},
         "high_gain_ekf.communication.every: 2 does not go with kind stages"},
        {{.d = 0.02,
          .communication = {.kind = DSE_HIGH_GAIN_STAGES, .predictor = DSE_HIGH_GAIN_HOLD}},
         "high_gain_ekf.communication.predictor: "},
        {{.d = 1e-5}, "high_gain_ekf.d: 1e-05 are 0.036 sampling periods; it must be 1 to 100000"},
        {{.d = 1e5}, "high_gain_ekf.d: 100000 are 3.6e+08 sampling periods"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct error error = {.text = ""};
        bool allowed = high_gain_ekf_section_check(&cases[i].section, period, &error);
        const char *expected = cases[i].expected != NULL ? cases[i].expected : "";
        assert_true(allowed == (cases[i].expected == NULL));
        if (!allowed && strstr(error.text, expected) == NULL)
            fail_msg("%s: expected %s", error.text, expected);
    }
}

/* ---- kinds of values that no shipped section uses yet ---- */

struct other {
    bool flag;
    int8_t small;
    double pair[2];
};

static void other_kinds_of_values_are_checked_too(void **state)
{
    (void)state;
    static const cyaml_schema_value_t number = {CYAML_VALUE_FLOAT(CYAML_FLAG_DEFAULT, double)};
    static const cyaml_schema_field_t fields[] = {
        CYAML_FIELD_BOOL("flag", CYAML_FLAG_OPTIONAL, struct other, flag),
        CYAML_FIELD_INT("small", CYAML_FLAG_OPTIONAL, struct other, small),
        CYAML_FIELD_SEQUENCE_FIXED("pair", CYAML_FLAG_OPTIONAL, struct other, pair, &number, 2),
        CYAML_FIELD_IGNORE("ignored", CYAML_FLAG_OPTIONAL), CYAML_FIELD_END};
    static const cyaml_schema_value_t schema = {
        CYAML_VALUE_MAPPING(CYAML_FLAG_POINTER, struct other, fields)};
    static const char *const cases[][2] = {
        {"flag: yes", ""},
        {"flag: false", ""},
        {"small: -127", ""},
        {"pair: [1, 2]", ""},
        {"flag: maybe", "x.yaml:1: flag: 'maybe' is not one of: true, false, yes, no, on, off"},
        {"small: 128", "small: 128 is too large; the largest is 127"},
        {"small: 1e2", "small: must be a whole number, not '1e2'"},
        {"small: '-'", "small: must be a whole number, not '-'"},
        {"pair: [1]", "pair: has 1 entries; it must have 2 to 2"},
        {"ignored: 1", "ignored: has a kind of value that scenarios do not use"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct error error = {.text = ""};
        struct scenario_tree tree;
        assert_true(scenario_tree_load(&tree, cases[i][0], "x.yaml", NULL, 0, &error));
        bool right = scenario_check(&tree, &schema, &error);
        scenario_tree_free(&tree);
        assert_true(right == (cases[i][1][0] == '\0'));
        if (strstr(error.text, cases[i][1]) == NULL)
            fail_msg("%s: expected %s", error.text, cases[i][1]);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_unchanged_scenario_is_accepted),
        cmocka_unit_test(a_message_reads_as_documented),
        cmocka_unit_test(unknown_keys_are_answered_with_the_allowed_ones),
        cmocka_unit_test(missing_required_keys_are_named_with_their_meaning),
        cmocka_unit_test(keys_given_twice_are_refused),
        cmocka_unit_test(values_of_a_wrong_kind_are_refused),
        cmocka_unit_test(numbers_that_no_double_holds_are_refused),
        cmocka_unit_test(numbers_out_of_their_limits_are_refused),
        cmocka_unit_test(lists_have_the_length_that_the_plant_gives_them),
        cmocka_unit_test(names_that_nothing_carries_are_answered_with_what_there_is),
        cmocka_unit_test(names_consist_of_plain_letters_and_are_unique),
        cmocka_unit_test(a_network_has_one_method_and_a_scenario_a_network),
        cmocka_unit_test(noise_without_scale_is_refused),
        cmocka_unit_test(text_that_is_not_a_scenario_is_refused),
        cmocka_unit_test(aliases_cannot_blow_up_or_contain_themselves),
        cmocka_unit_test(a_mapping_with_thousands_of_keys_is_refused),
        cmocka_unit_test(every_truncation_is_answered),
        cmocka_unit_test(every_flipped_character_is_answered),
        cmocka_unit_test(overrides_that_do_not_fit_are_answered_like_lines_of_the_file),
        cmocka_unit_test(the_first_wrong_override_is_named),
        cmocka_unit_test(files_that_cannot_be_read_are_named),
        cmocka_unit_test(files_that_are_no_text_are_refused),
        cmocka_unit_test(combinations_that_make_no_filter_are_refused),
        cmocka_unit_test(other_kinds_of_values_are_checked_too),
    };
    return cmocka_run_group_tests_name("scenario errors", tests, NULL, NULL);
}
