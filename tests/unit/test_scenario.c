/* The scenario reader on what is right: values, defaults, overrides, hash, and what follows. What
 * is wrong is in test_scenario_errors.c. */
#include <dirent.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#include "methods/high_gain_ekf_section.h"
#include "methods/method.h"
#include "runtime/scenario_internal.h"

#define NETWORK                                                                                    \
    "  - name: one\n"                                                                              \
    "    guess: &guess [396, 2.6, 352, 10.5]\n"                                                    \
    "    high_gain_ekf: &tuning {d: 0.02, DeltaT: 0.001, beta: 5, m: 4, lambda: 100,\n"            \
    "      theta_m: 20, Q: [150, 5, 150, 5], R: [1, 2]}\n"

static const char smallest[] = "name: smallest\n"
                               "time: {period_s: 1, duration_s: 10}\n"
                               "plant: {name: cstr2}\n"
                               "networks:\n" NETWORK;

static const char full[] = "name: full\n"
                           "title: 'a title: with a colon'\n"
                           "source: somewhere\n"
                           "seed: 18446744073709551615\n"
                           "time: {period_s: 1.8, duration_s: 36}\n"
                           "plant:\n"
                           "  name: cstr2\n"
                           "  set: ch4\n"
                           "  parameters: [{name: Fr, value: 35}, {name: Qh1, value: 1e4}]\n"
                           "  x0: [350, 2, 310, 1]\n"
                           "  inputs: [5, 0]\n"
                           "  integrator: {kind: rk4, rtol: 1e-8, atol: 1e-9}\n"
                           "noise:\n"
                           "  process: {distribution: gaussian, scale: [1, 2, 3, 4]}\n"
                           "  measurement: {distribution: uniform, scale: [0.5, 0]}\n"
                           "  missing: 0.25\n"
                           "networks:\n" NETWORK "  - name: two\n"
                           "    title: the second\n"
                           "    guess: *guess\n"
                           "    set: ch2\n"
                           "    parameters: [{name: Fr, value: 36}]\n"
                           "    high_gain_ekf:\n"
                           "      <<: *tuning\n"
                           "      gain: one\n"
                           "      communication: {kind: tick, every: 36, predictor: false}\n"
                           "timeouts: {repeat_s: 0.1, give_up_s: 5}\n";

static struct scenario *parse_with(const char *yaml, const char *override)
{
    struct error error = {.text = ""};
    struct scenario *scenario =
        scenario_parse(yaml, "test.yaml", &override, override != NULL ? 1 : 0, &error);
    if (scenario == NULL)
        fail_msg("%s", error.text);
    return scenario;
}

static const struct high_gain_ekf_section *section(const struct scenario *scenario, int network)
{
    const struct scenario_network *n = &scenario->networks[network];
    return n->section[scenario_method(n)];
}

static uint64_t hash_of(const char *yaml, const char *override)
{
    struct scenario *scenario = parse_with(yaml, override);
    uint64_t hash = scenario->hash;
    scenario_free(scenario);
    return hash;
}

/* ---- values ---- */

static void every_stated_value_arrives(void **state)
{
    (void)state;
    struct scenario *s = parse_with(full, NULL);
    assert_string_equal(s->name, "full");
    assert_string_equal(s->title, "a title: with a colon");
    assert_string_equal(s->source, "somewhere");
    assert_true(s->seed == UINT64_MAX);
    assert_true(s->time.period_s == 1.8 && s->time.duration_s == 36);
    assert_string_equal(s->plant.set, "ch4");
    assert_int_equal(s->plant.parameters_count, 2);
    assert_string_equal(s->plant.parameters[1].name, "Qh1");
    assert_true(s->plant.parameters[1].value == 1e4);
    assert_int_equal(s->plant.x0_count, 4);
    assert_true(s->plant.x0[0] == 350 && s->plant.x0[3] == 1);
    assert_int_equal(s->plant.inputs_count, 2);
    assert_int_equal(s->plant.integrator.kind, SCENARIO_RK4);
    assert_true(s->plant.integrator.rtol == 1e-8 && s->plant.integrator.atol == 1e-9);
    assert_int_equal(s->noise.process.distribution, SCENARIO_GAUSSIAN);
    assert_true(s->noise.process.scale[3] == 4);
    assert_int_equal(s->noise.measurement.distribution, SCENARIO_UNIFORM);
    assert_true(s->noise.missing == 0.25);
    assert_int_equal(s->networks_count, 2);
    assert_string_equal(s->networks[1].title, "the second");
    assert_string_equal(s->networks[1].set, "ch2");
    assert_true(s->networks[1].parameters[0].value == 36);
    assert_true(s->networks[1].guess[3] == 10.5);
    assert_true(s->timeouts.repeat_s == 0.1 && s->timeouts.give_up_s == 5);
    assert_ptr_equal(s->process, dse_plant_find("cstr2"));
    assert_string_equal(s->file, "test.yaml");
    assert_string_equal(s->yaml, full);
    scenario_free(s);
}

static void keys_left_out_are_zero_or_null(void **state)
{
    (void)state;
    struct scenario *s = parse_with(smallest, NULL);
    assert_null(s->title);
    assert_null(s->plant.set);
    assert_null(s->plant.x0);
    assert_null(s->plant.inputs);
    assert_int_equal(s->plant.parameters_count, 0);
    assert_int_equal(s->plant.integrator.kind, SCENARIO_CVODE);
    assert_int_equal(s->noise.process.distribution, SCENARIO_NONE);
    assert_true(s->seed == 0 && s->timeouts.repeat_s == 0 && s->plant.integrator.rtol == 0);
    const struct high_gain_ekf_section *h = section(s, 0);
    assert_int_equal(h->coordinates, DSE_HIGH_GAIN_NORMAL);
    assert_int_equal(h->gain, DSE_HIGH_GAIN_ADAPT);
    assert_int_equal(h->communication.kind, DSE_HIGH_GAIN_TICK);
    assert_int_equal(h->communication.every, 0);
    assert_int_equal(h->communication.predictor, DSE_HIGH_GAIN_PREDICT);
    assert_null(h->P0);
    scenario_free(s);
}

static void a_merge_key_repeats_a_section_and_own_keys_win(void **state)
{
    (void)state;
    struct scenario *s = parse_with(full, NULL);
    const struct high_gain_ekf_section *one = section(s, 0), *two = section(s, 1);
    assert_int_equal(one->gain, DSE_HIGH_GAIN_ADAPT);
    assert_int_equal(two->gain, DSE_HIGH_GAIN_ONE);
    assert_true(two->theta_m == 20 && two->R[1] == 2 && two->Q_count == 4);
    assert_int_equal(two->communication.every, 36);
    assert_int_equal(two->communication.predictor, DSE_HIGH_GAIN_HOLD);
    scenario_free(s);
}

/* ---- what follows ---- */

static void samples_are_the_duration_in_periods_rounded(void **state)
{
    (void)state;
    static const struct {
        const char *override;
        int64_t samples;
    } cases[] = {{"time={period_s: 1, duration_s: 1800}", 1800},
                 {"time={period_s: 3.6, duration_s: 864}", 240},
                 {"time={period_s: 0.1, duration_s: 0.3}", 3},
                 {"time={period_s: 2, duration_s: 2}", 1},
                 {"time={period_s: 1, duration_s: 2.6}", 3}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct scenario *s = parse_with(smallest, cases[i].override);
        assert_int_equal(scenario_samples(s), cases[i].samples);
        scenario_free(s);
    }
}

static void period_is_in_the_plants_time_unit(void **state)
{
    (void)state;
    struct scenario *s = parse_with(smallest, NULL);
    assert_true(scenario_period(s) == 1.0 / 3600);
    assert_int_equal(high_gain_ekf_horizon(section(s, 0), scenario_period(s)), 72);
    scenario_free(s);
}

static dse_real parameter_of(const struct scenario *s, int network, const char *name)
{
    struct error error = {.text = ""};
    dse_real values[DSE_PLANT_MAX_PARAMETERS];
    dse_real *prepared = calloc((size_t)s->process->prepared_size, sizeof *prepared);
    const struct scenario_network *n = network >= 0 ? &s->networks[network] : NULL;
    assert_true(scenario_prepare_plant(s, n, values, prepared, &error));
    free(prepared);
    for (int i = 0; i < s->process->n_parameters; i++)
        if (strcmp(s->process->parameters[i].name, name) == 0)
            return values[i];
    fail_msg("no parameter %s", name);
    return 0;
}

static void estimators_know_the_plant_unless_their_network_says_otherwise(void **state)
{
    (void)state;
    struct scenario *s = parse_with(full, NULL);
    assert_true(parameter_of(s, -1, "Fr") == 35);     /* the plant's own change */
    assert_true(parameter_of(s, -1, "Qh1") == 1e4);   /* of set ch4, changed */
    assert_true(parameter_of(s, -1, "Qh2") == 1.4e4); /* of set ch4 */
    assert_true(parameter_of(s, 0, "Fr") == 35);      /* network one: as the plant */
    assert_true(parameter_of(s, 0, "Qh1") == 1e4);
    assert_true(parameter_of(s, 1, "Fr") == 36); /* network two: set ch2 and its own change */
    assert_true(parameter_of(s, 1, "Qh1") == 1.8e4);
    scenario_free(s);
}

/* ---- overrides ---- */

static void overrides_work_whether_or_not_the_file_has_the_key(void **state)
{
    (void)state;
    struct error error = {.text = ""};
    const char *const overrides[] = {"seed=7",
                                     "plant.x0=[360, 3, 320, 2.5]",
                                     "plant.parameters.Fr=36",
                                     "plant.parameters.Fr=37",
                                     "noise.measurement={distribution: uniform, scale: [1, 1]}",
                                     "noise.measurement.scale[1]=2",
                                     "time.duration_s=60",
                                     "networks.one.high_gain_ekf.theta_m=8",
                                     "networks[0].high_gain_ekf.communication.kind=stages",
                                     "networks.0.name=renamed",
                                     "networks.renamed.high_gain_ekf.R.0=3"};
    unsigned count = sizeof overrides / sizeof overrides[0];
    struct scenario *s = scenario_parse(smallest, "test.yaml", overrides, count, &error);
    assert_string_equal(error.text, "");
    assert_non_null(s);
    assert_true(s->seed == 7 && s->time.duration_s == 60 && s->time.period_s == 1);
    assert_true(s->plant.x0_count == 4 && s->plant.x0[3] == 2.5);
    assert_int_equal(s->plant.parameters_count, 1);
    assert_string_equal(s->plant.parameters[0].name, "Fr");
    assert_true(s->plant.parameters[0].value == 37);
    assert_true(s->noise.measurement.scale[0] == 1 && s->noise.measurement.scale[1] == 2);
    assert_string_equal(s->networks[0].name, "renamed");
    assert_true(section(s, 0)->theta_m == 8 && section(s, 0)->R[0] == 3);
    assert_int_equal(section(s, 0)->communication.kind, DSE_HIGH_GAIN_STAGES);
    assert_int_equal(s->overrides_count, count);
    assert_string_equal(s->overrides[0], "seed=7");
    scenario_free(s);
}

static void an_override_changes_one_network_although_they_share_an_alias(void **state)
{
    (void)state;
    struct scenario *s = parse_with(full, "networks.one.high_gain_ekf.R[0]=9");
    assert_true(section(s, 0)->R[0] == 9);
    assert_true(section(s, 1)->R[0] == 1);
    scenario_free(s);
    s = parse_with(full, "networks.two.guess[0]=300");
    assert_true(s->networks[0].guess[0] == 396);
    assert_true(s->networks[1].guess[0] == 300);
    scenario_free(s);
}

/* ---- hash ---- */

static void hash_ignores_what_cannot_change_a_result(void **state)
{
    (void)state;
    static const char same[] = "# a comment\n"
                               "title: with a title\n"
                               "plant:\n    name: \"cstr2\"\n"
                               "seed: 0\n"
                               "noise: {process: {distribution: none}}\n"
                               "networks:\n"
                               "- high_gain_ekf:\n"
                               "    R: [1.0, 2e0]\n"
                               "    Q: [150, 5.0,\n      150, 5]\n"
                               "    theta_m: 2.0e1\n"
                               "    lambda: 100\n"
                               "    m: 4.\n"
                               "    beta: 5\n"
                               "    DeltaT: 1e-3\n"
                               "    d: 2e-2\n"
                               "    gain: adaptive\n"
                               "  guess: [396, 2.6, 352, 10.5]\n"
                               "  name: one\n"
                               "time: {duration_s: 10.0, period_s: 1}\n"
                               "timeouts: {give_up_s: 3}\n"
                               "name: smallest\n";
    assert_true(hash_of(same, NULL) == hash_of(smallest, NULL));
    assert_true(hash_of(full, "title=other") == hash_of(full, NULL));
    assert_true(hash_of(full, "source=other") == hash_of(full, NULL));
    assert_true(hash_of(full, "timeouts.repeat_s=1") == hash_of(full, NULL));
    assert_true(hash_of(full, "networks.two.title=other") == hash_of(full, NULL));
}

static void hash_feels_every_value_that_can_change_a_result(void **state)
{
    (void)state;
    static const char *const overrides[] = {
        "seed=7",
        "time.period_s=1.9",
        "time.duration_s=37",
        "plant.set=ch2",
        "plant.parameters.Fr=36",
        "plant.parameters.Qh2=1e4",
        "plant.x0[3]=1.0000000000000002",
        "plant.inputs[0]=4",
        "plant.integrator.kind=cvode",
        "plant.integrator.rtol=1e-7",
        "noise.process.distribution=uniform",
        "noise.process.scale[2]=3.5",
        "noise.measurement.scale[1]=1",
        "noise.missing=0.5",
        "networks.two.guess[1]=2.7",
        "networks.two.set=ch4",
        "networks.two.high_gain_ekf.gain=permanent",
        "networks.two.high_gain_ekf.communication.every=35",
        "networks.two.high_gain_ekf.P0=[1, 1, 1, 1]",
        "networks.one.name=three",
    };
    enum { COUNT = sizeof overrides / sizeof overrides[0] };
    uint64_t hash[COUNT + 1] = {hash_of(full, NULL)};
    for (int i = 0; i < COUNT; i++)
        hash[i + 1] = hash_of(full, overrides[i]);
    for (int i = 0; i <= COUNT; i++)
        for (int j = 0; j < i; j++)
            if (hash[i] == hash[j])
                fail_msg("same hash: %s and %s", overrides[i - 1], j > 0 ? overrides[j - 1] : "-");
}

/* ---- the table of keys ---- */

static int check_rules(const cyaml_schema_field_t *fields, const char *path)
{
    int count = 0;
    for (; fields->key != NULL; fields++) {
        char below[SCENARIO_PATH_SIZE];
        snprintf(below, sizeof below, "%s%s%s", path, path[0] != '\0' ? "." : "", fields->key);
        const cyaml_schema_value_t *value = &fields->value;
        bool list = value->type == CYAML_SEQUENCE;
        const cyaml_schema_field_t *inner = NULL;
        if (value->type == CYAML_MAPPING)
            inner = value->mapping.fields;
        else if (list && value->sequence.entry->type == CYAML_MAPPING)
            inner = value->sequence.entry->mapping.fields;
        bool is_section = strcmp(path, "networks[]") == 0 && method_find(fields->key) != NULL;
        if (!is_section && scenario_rule_find(below) == NULL)
            fail_msg("%s has no rule", below);
        count += !is_section;
        strcat(below, list && inner != NULL ? "[]" : "");
        if (inner != NULL)
            count += check_rules(inner, below);
    }
    return count;
}

static void every_key_has_a_rule_and_every_rule_a_key(void **state)
{
    (void)state;
    struct scenario_schema schema;
    scenario_schema_make(&schema);
    int rules = 0;
    for (const struct scenario_rule *rule = scenario_rules; rule->key != NULL; rule++)
        rules++;
    for (int i = 0; method_at(i) != NULL; i++)
        for (const struct scenario_rule *rule = method_at(i)->rules; rule->key != NULL; rule++)
            rules++;
    assert_int_equal(check_rules(schema.root.mapping.fields, ""), rules);
}

static void the_table_of_keys_names_type_default_limits_and_meaning(void **state)
{
    (void)state;
    char *text = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);
    scenario_write_keys(out);
    fclose(out);
    static const char *const expected[] = {
        "networks[].high_gain_ekf: ",
        "networks[].high_gain_ekf.communication: ",
        "  theta_m        number          required          > 1 ",
        "  every          whole number    1                 >= 1 and <= 1000000 ",
        "  kind           word            cvode             cvode|rk4|flow ",
        "one per state",
    };
    for (size_t i = 0; i < sizeof expected / sizeof expected[0]; i++)
        if (strstr(text, expected[i]) == NULL)
            fail_msg("'%s' is not in the table:\n%s", expected[i], text);
    free(text);
}

/* ---- finding ---- */

struct folder {
    char path[64];
};

static void touch(const struct folder *folder, const char *name)
{
    char path[128];
    snprintf(path, sizeof path, "%s/%s", folder->path, name);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fclose(file);
}

static int make_folder(void **state)
{
    static struct folder folder;
    snprintf(folder.path, sizeof folder.path, "scenario_XXXXXX");
    if (mkdtemp(folder.path) == NULL)
        return -1;
    touch(&folder, "zz-4_first.yaml");
    touch(&folder, "zz-43_second.yaml");
    touch(&folder, "zz-43_third.yaml");
    touch(&folder, "zz-44_fourth.yaml");
    touch(&folder, "notes.txt");
    setenv("DSE_SCENARIOS", folder.path, 1);
    *state = &folder;
    return 0;
}

static int remove_folder(void **state)
{
    const struct folder *folder = *state;
    static const char *const names[] = {"zz-4_first.yaml", "zz-43_second.yaml", "zz-43_third.yaml",
                                        "zz-44_fourth.yaml", "notes.txt"};
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        char path[128];
        snprintf(path, sizeof path, "%s/%s", folder->path, names[i]);
        unlink(path);
    }
    unsetenv("DSE_SCENARIOS");
    return rmdir(folder->path);
}

static void a_scenario_is_found_by_the_beginning_of_its_name(void **state)
{
    const struct folder *folder = *state;
    static const struct {
        const char *name, *file;
    } cases[] = {{"zz-44", "zz-44_fourth.yaml"},
                 {"zz-4", "zz-4_first.yaml"}, /* a whole word, though zz-43 begins so too */
                 {"zz-43_s", "zz-43_second.yaml"},
                 {"zz-43_third", "zz-43_third.yaml"},
                 {"zz-43_third.yaml", "zz-43_third.yaml"}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct error error = {.text = ""};
        char path[256], expected[128];
        snprintf(expected, sizeof expected, "%s/%s", folder->path, cases[i].file);
        if (!scenario_find(cases[i].name, path, sizeof path, &error))
            fail_msg("%s", error.text);
        assert_string_equal(path, expected);
    }
}

static void a_readable_file_is_taken_as_it_is(void **state)
{
    const struct folder *folder = *state;
    struct error error = {.text = ""};
    char given[128], path[256];
    snprintf(given, sizeof given, "%s/notes.txt", folder->path);
    assert_true(scenario_find(given, path, sizeof path, &error));
    assert_string_equal(path, given);
}

static void a_name_that_fits_none_or_several_is_answered_with_what_there_is(void **state)
{
    const struct folder *folder = *state;
    static const struct {
        const char *name, *expected;
    } cases[] = {
        {"zz-43", "'zz-43' fits several scenarios: zz-43_second.yaml, zz-43_third.yaml"},
        {"zz44", "(did you mean zz-44?)"},
        {"zz44", "no scenario 'zz44'; there are: "},
        {"notes", "no scenario 'notes'"},
        {"./zz-44", "No such file"},
        {"", "is empty"},
    };
    struct error error;
    char path[256];
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        error.text[0] = '\0';
        assert_false(scenario_find(cases[i].name, path, sizeof path, &error));
        if (strstr(error.text, cases[i].expected) == NULL)
            fail_msg("%s: expected %s", error.text, cases[i].expected);
    }
    char with_slash[80];
    snprintf(with_slash, sizeof with_slash, "./%s", folder->path);
    error.text[0] = '\0';
    assert_false(scenario_find(with_slash, path, sizeof path, &error));
    assert_non_null(strstr(error.text, "is a folder"));
    error.text[0] = '\0';
    assert_false(scenario_find("zz-44", path, 8, &error));
    assert_non_null(strstr(error.text, "too long"));
}

/* ---- the shipped ones ---- */

static void the_shipped_scenarios_are_read_and_state_their_experiments(void **state)
{
    (void)state;
    static const struct {
        const char *name;
        unsigned networks;
        double theta_m;
        const char *first, *last;
    } cases[] = {{"ahg-43", 2, 20, "ahg", "ekf"},
                 {"ahg-44", 4, 20, "continuous", "predictor36"},
                 {"ahg-45", 2, 8, "ahg", "permanent"}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct error error = {.text = ""};
        char path[1024];
        bool found = scenario_find(cases[i].name, path, sizeof path, &error);
        struct scenario *s = found ? scenario_read(path, NULL, 0, &error) : NULL;
        if (s == NULL) {
            fail_msg("%s", error.text);
            return;
        }
        assert_int_equal(scenario_samples(s), 1800);
        assert_int_equal(s->networks_count, cases[i].networks);
        assert_string_equal(s->networks[0].name, cases[i].first);
        assert_string_equal(s->networks[s->networks_count - 1].name, cases[i].last);
        for (unsigned n = 0; n < s->networks_count; n++) {
            const struct high_gain_ekf_section *h = section(s, (int)n);
            assert_true(high_gain_ekf_section_check(h, scenario_period(s), &error));
            assert_int_equal(high_gain_ekf_horizon(h, scenario_period(s)), 72);
            assert_true(h->theta_m == cases[i].theta_m);
            assert_int_equal(h->innovation, DSE_HIGH_GAIN_SUM);
        }
        /* the file is named after the experiment */
        assert_non_null(strstr(path, s->name));
        scenario_free(s);
    }
}

static char *read_readme(void)
{
    char *text = calloc(1, 65536);
    FILE *file = fopen(DSE_SCENARIO_FOLDER "/README.md", "r");
    assert_non_null(file);
    assert_true(fread(text, 1, 65535, file) > 0);
    fclose(file);
    return text;
}

static void the_example_in_the_readme_is_a_scenario(void **state)
{
    (void)state;
    char *readme = read_readme();
    char *begin = strstr(readme, "```yaml\n");
    assert_non_null(begin);
    begin += strlen("```yaml\n");
    char *end = strstr(begin, "```");
    assert_non_null(end);
    *end = '\0';
    struct scenario *s = parse_with(begin, NULL);
    assert_true(parameter_of(s, -1, "Fr") == 36 && parameter_of(s, 1, "Fr") == 33);
    assert_int_equal(section(s, 1)->gain, DSE_HIGH_GAIN_ONE);
    scenario_free(s);
    free(readme);
}

static void the_readme_lists_every_shipped_scenario(void **state)
{
    (void)state;
    char *readme = read_readme();
    DIR *folder = opendir(DSE_SCENARIO_FOLDER);
    assert_non_null(folder);
    int count = 0;
    for (const struct dirent *entry; (entry = readdir(folder)) != NULL;) {
        const char *dot = strstr(entry->d_name, ".yaml");
        if (dot == NULL)
            continue;
        char row[300];
        snprintf(row, sizeof row, "| `%.*s` |", (int)(dot - entry->d_name), entry->d_name);
        if (strstr(readme, row) == NULL)
            fail_msg("%s is not in the README's table", entry->d_name);
        count++;
    }
    closedir(folder);
    free(readme);
    assert_true(count >= 3);
}

int main(void)
{
    const struct CMUnitTest values[] = {
        cmocka_unit_test(every_stated_value_arrives),
        cmocka_unit_test(keys_left_out_are_zero_or_null),
        cmocka_unit_test(a_merge_key_repeats_a_section_and_own_keys_win),
        cmocka_unit_test(samples_are_the_duration_in_periods_rounded),
        cmocka_unit_test(period_is_in_the_plants_time_unit),
        cmocka_unit_test(estimators_know_the_plant_unless_their_network_says_otherwise),
        cmocka_unit_test(overrides_work_whether_or_not_the_file_has_the_key),
        cmocka_unit_test(an_override_changes_one_network_although_they_share_an_alias),
        cmocka_unit_test(hash_ignores_what_cannot_change_a_result),
        cmocka_unit_test(hash_feels_every_value_that_can_change_a_result),
        cmocka_unit_test(every_key_has_a_rule_and_every_rule_a_key),
        cmocka_unit_test(the_table_of_keys_names_type_default_limits_and_meaning),
        cmocka_unit_test(the_shipped_scenarios_are_read_and_state_their_experiments),
        cmocka_unit_test(the_example_in_the_readme_is_a_scenario),
        cmocka_unit_test(the_readme_lists_every_shipped_scenario),
    };
    const struct CMUnitTest finding[] = {
        cmocka_unit_test(a_scenario_is_found_by_the_beginning_of_its_name),
        cmocka_unit_test(a_readable_file_is_taken_as_it_is),
        cmocka_unit_test(a_name_that_fits_none_or_several_is_answered_with_what_there_is),
    };
    unsetenv("DSE_SCENARIOS");
    int failed = cmocka_run_group_tests_name("scenario", values, NULL, NULL);
    return failed + cmocka_run_group_tests_name("finding", finding, make_folder, remove_folder);
}
