/* The key `gains` of the high-gain EKF: a word per filter in place of one for all. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "methods/high_gain_ekf_section.h"
#include "methods/method.h"
#include "runtime/scenario_internal.h"

static const char text[] = "name: gains\n"
                           "time: {period_s: 1, duration_s: 10}\n"
                           "plant: {name: three_tank}\n"
                           "networks:\n"
                           "  - name: one\n"
                           "    guess: [60, 50, 15, 67, 50]\n"
                           "    high_gain_ekf: {d: 0.03, DeltaT: 0.001, beta: 450, m: 0.1,\n"
                           "      lambda: 20, theta_m: 3, gain: permanent,\n"
                           "      Q: [1, 1, 1, 1, 1], R: [1, 1, 1]}\n";

static struct scenario *parse(const char *override, struct error *error)
{
    return scenario_parse(text, "x.yaml", &override, override != NULL ? 1 : 0, error);
}

static const struct high_gain_ekf_section *section_of(const struct scenario *scenario)
{
    return scenario->networks[0].section[scenario_method(&scenario->networks[0])];
}

static void a_word_per_filter_takes_the_place_of_one_for_all(void **state)
{
    (void)state;
    struct error error = {.text = ""};
    struct scenario *same = parse(NULL, &error);
    struct scenario *own =
        parse("networks.one.high_gain_ekf.gains=[adaptive, one, permanent]", &error);
    assert_string_equal(error.text, "");
    for (int i = 0; i < 3; i++)
        assert_int_equal(high_gain_ekf_gain(section_of(same), i), DSE_HIGH_GAIN_MAX);
    assert_int_equal(high_gain_ekf_gain(section_of(own), 0), DSE_HIGH_GAIN_ADAPT);
    assert_int_equal(high_gain_ekf_gain(section_of(own), 1), DSE_HIGH_GAIN_ONE);
    assert_int_equal(high_gain_ekf_gain(section_of(own), 2), DSE_HIGH_GAIN_MAX);
    assert_true(same->hash != own->hash);
    scenario_free(same);
    scenario_free(own);
}

static void wrong_words_and_counts_are_refused(void **state)
{
    (void)state;
    static const struct {
        const char *override, *expected;
    } cases[] = {
        {"networks.one.high_gain_ekf.gains=[one, one]",
         "has 2 values; it must have 3, one per subsystem of three_tank"},
        {"networks.one.high_gain_ekf.gains=[one, two, one]",
         "gains[1]: 'two' is not one of: adaptive, one, permanent"},
        {"networks.one.high_gain_ekf.gains=one", "gains: must be a list"},
    };
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++) {
        struct error error = {.text = ""};
        assert_null(parse(cases[c].override, &error));
        if (strstr(error.text, cases[c].expected) == NULL)
            fail_msg("\n  message:  %s\n  expected: %s", error.text, cases[c].expected);
    }
}

static void the_table_of_keys_lists_the_words(void **state)
{
    (void)state;
    char line[512];
    int found = 0;
    FILE *file = tmpfile();
    assert_non_null(file);
    scenario_write_keys(file);
    rewind(file);
    while (fgets(line, sizeof line, file) != NULL)
        found += strncmp(line, "  gains ", 8) == 0 && strstr(line, "list of words") != NULL &&
                 strstr(line, "adaptive|one|permanent") != NULL;
    fclose(file);
    assert_int_equal(found, 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_word_per_filter_takes_the_place_of_one_for_all),
        cmocka_unit_test(wrong_words_and_counts_are_refused),
        cmocka_unit_test(the_table_of_keys_lists_the_words),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
