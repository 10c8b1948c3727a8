/* networks[].link: what a method gets, what becomes of messages at a node, and what is refused. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "methods/lossy_link.h"
#include "runtime/networks.h"

#define COUNT(array) ((int)(sizeof(array) / sizeof(array)[0]))

enum { NODES = 4, SAMPLES = 40 };

static const char text[] = "name: linked\nseed: 7\n"                       /* 1, 2 */
                           "time: {period_s: 0.1, duration_s: 4}\n"        /* 3 */
                           "plant: {name: cstr4}\n"                        /* 4 */
                           "networks:\n"                                   /* 5 */
                           "  - name: one\n"                               /* 6 */
                           "    guess: [360, 2, 360, 2, 360, 2, 360, 2]\n" /* 7 */
                           "    link: %s\n"                                /* 8 */
                           "    high_gain_ekf: {d: 0.02, DeltaT: 0.1,\n"   /* 9 */
                           "      beta: 5, m: 4, lambda: 100, theta_m: 20,\n"
                           "      Q: [1, 1, 1, 1, 1, 1, 1, 1], R: [1, 1, 1, 1]}\n";

static struct scenario *read_link(const char *link, const char *recording, struct error *error)
{
    char yaml[2048];
    snprintf(yaml, sizeof yaml, text, link);
    const struct scenario_part part = {.name = "network.csv", .text = (char *)recording};
    return scenario_parse_recorded(yaml, "x.yaml", &part, recording != NULL, NULL, 0, error);
}

static struct scenario *must_read(const char *link, const char *recording,
                                  struct method_setup *setup)
{
    struct error error = {.text = ""};
    struct scenario *scenario = read_link(link, recording, &error);
    if (scenario == NULL)
        fail_msg("%s", error.text);
    assert_non_null(network_method(scenario, 0, setup, &error));
    return scenario;
}

/* ---- what a method gets ---- */

static void a_method_gets_the_numbers_of_the_link_with_outages_in_samples(void **state)
{
    (void)state;
    struct method_setup setup;
    struct scenario *scenario =
        must_read("{D: 3, T_m: 2, loss: 0.4, seed: 5, outages: [{from: 0, to: -1, start_s: 0.3, "
                  "end_s: 0.7}, {from: -1, to: 3, start_s: 1.05}]}",
                  NULL, &setup);
    assert_non_null(setup.link);
    assert_int_equal(setup.link->max_delay, 3);
    assert_int_equal(setup.link->max_losses, 2);
    assert_true(setup.link->loss >= 0.4 && setup.link->loss <= 0.4);
    assert_int_equal(setup.link->seed, 12); /* on top of the scenario's */
    assert_int_equal(setup.link->nodes, NODES);
    assert_int_equal(setup.link->n_outages, 2);
    const struct dse_link_outage *first = &setup.link->outages[0], *second = first + 1;
    /* 0.3 / 0.1 and 0.7 / 0.1 are no whole numbers in binary */
    assert_true(first->from == 0 && first->to == -1 && first->first == 3 && first->end == 7);
    assert_true(second->from == -1 && second->to == 3 && second->first == 11 &&
                second->end == INT64_MAX);
    scenario_free(scenario);
}

static void a_network_without_link_gets_none(void **state)
{
    (void)state;
    struct method_setup setup;
    struct error error = {.text = ""};
    char yaml[2048], *line = NULL;
    snprintf(yaml, sizeof yaml, text, "{}");
    line = strstr(yaml, "    link: {}");
    memset(line, ' ', strlen("    link: {}"));
    struct scenario *scenario = scenario_parse(yaml, "x.yaml", NULL, 0, &error);
    if (scenario == NULL)
        fail_msg("%s", error.text);
    assert_non_null(network_method(scenario, 0, &setup, &error));
    assert_null(setup.link);
    scenario_free(scenario);
}

static void recorded_fates_lie_where_receiver_sender_and_stamp_say(void **state)
{
    (void)state;
    struct method_setup setup;
    struct scenario *scenario =
        must_read("{D: 3, file: network.csv}",
                  "# head\r\nto,from,stamp,delay\r\n\r\n0,1,0,2\r\n3,2,1,0\r\n1,0,2,-1\r\n"
                  "2,3,400,1\n0,2,1,3",
                  &setup);
    const struct dse_link_config *link = setup.link;
    assert_non_null(link->table);
    assert_int_equal(link->stamps, 3); /* stamp 400 is behind the end of the run */
    for (int to = 0; to < NODES; to++)
        for (int from = 0; from < NODES; from++)
            for (int s = 0; s < link->stamps; s++) {
                const int wanted = to == 0 && from == 1 && s == 0   ? 2
                                   : to == 3 && from == 2 && s == 1 ? 0
                                   : to == 0 && from == 2 && s == 1 ? 3
                                                                    : DSE_LINK_LOST;
                assert_int_equal(link->table[(to * NODES + from) * link->stamps + s], wanted);
            }
    assert_int_equal(scenario->parts_count, 1);
    assert_string_equal(scenario->parts[0].name, "network.csv");
    scenario_free(scenario);
}

static uint64_t hash_of(const char *link, const char *recording)
{
    struct method_setup setup;
    struct scenario *scenario = must_read(link, recording, &setup);
    const uint64_t hash = scenario->hash;
    scenario_free(scenario);
    return hash;
}

static void every_number_of_the_link_counts_for_the_hash(void **state)
{
    (void)state;
    static const char *const links[] = {
        "{D: 3}",
        "{D: 2}",
        "{D: 3, T_m: 2}",
        "{D: 3, T_m: 2, loss: 0.4}",
        "{D: 3, T_m: 2, loss: 0.4, seed: 1}",
        "{D: 3, outages: [{from: 0, to: 1, start_s: 1}]}",
        "{D: 3, outages: [{from: 1, to: 0, start_s: 1}]}",
        "{D: 3, outages: [{from: 0, to: 1, start_s: 2}]}",
        "{D: 3, outages: [{from: 0, to: 1, start_s: 1, end_s: 2}]}",
    };
    uint64_t hash[COUNT(links)];
    for (int i = 0; i < COUNT(links); i++) {
        hash[i] = hash_of(links[i], NULL);
        for (int j = 0; j < i; j++)
            assert_true(hash[i] != hash[j]);
    }
}

static void the_numbers_in_a_recorded_network_count_for_the_hash_its_comments_do_not(void **state)
{
    (void)state;
    static const char link[] = "{D: 3, file: network.csv}";
    const uint64_t hash = hash_of(link, "0,1,0,0\n1,0,0,2\n");
    assert_true(hash == hash_of(link, "# of Monday\nto,from,stamp,delay\n1,0,0,2\n0,1,0,0\n"));
    assert_true(hash != hash_of(link, "0,1,0,0\n1,0,0,1\n"));
    assert_true(hash != hash_of(link, "0,1,0,0\n1,0,0,2\n2,0,0,0\n"));
    assert_true(hash != hash_of(link, "0,1,0,0\n1,0,0,2\n1,0,1,-1\n"));
}

/* ---- messages of a node ---- */

static void an_outage_in_seconds_holds_back_what_is_sent_at_its_instants(void **state)
{
    (void)state;
    static const int sizes[NODES] = {1, 1, 1, 1};
    enum { EVERY = 4 }; /* instants at 0, 0.4, 0.8, 1.2, .. s */
    struct method_setup setup;
    struct error error = {.text = ""};
    struct scenario *scenario =
        must_read("{outages: [{from: 2, to: 1, start_s: 0.5, end_s: 1.2}]}", NULL, &setup);
    setup.node = 1;
    struct lossy_link *links = lossy_link_create(&setup, sizes, EVERY, &error);
    assert_non_null(links);
    for (int64_t now = 0; now < SAMPLES / EVERY; now++) {
        const dse_real value = (dse_real)now;
        int64_t stamp = -1;
        lossy_link_put(links, 2, now, &value);
        const dse_real *heard = lossy_link_take(links, 2, now, &stamp);
        if (now == 2) { /* 0.8 s */
            assert_null(heard);
        } else {
            assert_non_null(heard);
            assert_int_equal(stamp, now);
        }
    }
    lossy_link_destroy(links);
    scenario_free(scenario);
}

static void messages_of_rounds_are_lost_by_seed_and_outage(void **state)
{
    (void)state;
    struct method_setup setup;
    struct error error = {.text = ""};
    struct scenario *scenario = must_read(
        "{T_m: 3, loss: 0.5, outages: [{from: 2, to: 1, start_s: 1, end_s: 1.2}]}", NULL, &setup);
    int lost = 0, different = 0;
    setup.node = 1;
    struct lossy_rounds *a = lossy_rounds_create(&setup, &error);
    struct lossy_rounds *b = lossy_rounds_create(&setup, &error);
    setup.node = 0;
    struct lossy_rounds *other = lossy_rounds_create(&setup, &error);
    assert_true(a != NULL && b != NULL && other != NULL);
    for (int64_t k = 0; k < SAMPLES; k++)
        for (int r = 0; r < 6; r++) {
            const bool now = lossy_rounds_lost(a, 2, k, r);
            assert_int_equal(lossy_rounds_lost(b, 2, k, r), now);
            assert_true(now || (k != 10 && k != 11));
            lost += now;
            different += now != lossy_rounds_lost(other, 2, k, r);
        }
    assert_in_range(lost, 6 * SAMPLES / 4, 6 * SAMPLES * 3 / 4);
    assert_true(different > SAMPLES);
    assert_true(lossy_rounds_lost(a, NODES, SAMPLES, 0)); /* nobody */
    assert_true(lossy_rounds_lost(a, -1, SAMPLES, 0));
    lossy_rounds_destroy(a);
    lossy_rounds_destroy(b);
    lossy_rounds_destroy(other);
    scenario_free(scenario);
}

static void rounds_refuse_delays_and_recordings_that_end_early(void **state)
{
    (void)state;
    static const char *const cases[][3] = {
        {"{D: 1}", NULL, "x.yaml: networks.one.link.D: must be 0"},
        {"{file: network.csv}", "0,1,38,0\n",
         "network.csv ends at stamp 38, but the run has 40 samples"},
    };
    for (int i = 0; i < COUNT(cases); i++) {
        struct method_setup setup;
        struct error error = {.text = ""};
        struct scenario *scenario = must_read(cases[i][0], cases[i][1], &setup);
        assert_null(lossy_rounds_create(&setup, &error));
        if (strstr(error.text, cases[i][2]) == NULL)
            fail_msg("\n  message:  %s\n  expected: %s", error.text, cases[i][2]);
        scenario_free(scenario);
    }
}

/* ---- what is refused ---- */

static void what_is_no_link_is_refused_with_its_line(void **state)
{
    (void)state;
    static const char *const cases[][3] = {
        {"{D: 3, loss: 0.4}", NULL,
         "x.yaml:8: networks[0].link.T_m: 0 allows no loss, but loss is 0.4; state T_m >= 1"},
        {"{D: 101}", NULL, "networks[0].link.D: 101 is out of range; it must be >= 0 and <= 100"},
        {"{loss: 1.5, T_m: 1}", NULL, "networks[0].link.loss: 1.5 is out of range"},
        {"{T_m: 1, file: network.csv}", "0,1,0,0\n",
         "networks[0].link.T_m: is not used: the file says what was lost"},
        {"{loss: 0.1, file: network.csv}", "0,1,0,0\n", "networks[0].link.loss: is not used"},
        {"{seed: 1, file: network.csv}", "0,1,0,0\n", "networks[0].link.seed: is not used"},
        {"{outages: [{from: 4, to: 0, start_s: 0}]}", NULL,
         "x.yaml:8: networks[0].link.outages[0].from: there is no node 4: nodes are 0 to 3"},
        {"{outages: [{from: 0, to: 9, start_s: 0}]}", NULL, "link.outages[0].to: there is no node"},
        {"{outages: [{from: -2, to: 0, start_s: 0}]}", NULL, "from: -2 is out of range"},
        {"{outages: [{from: 1, to: 1, start_s: 0}]}", NULL, "outages[0]: node 1 hears itself"},
        {"{outages: [{from: 1, to: 0, start_s: 2, end_s: 2}]}", NULL,
         "outages[0]: ends at 2 s, which is not after its start at 2 s"},
        {"{outages: [{from: 1, to: 0, start_s: 1e12}]}", NULL, "lies beyond the longest run"},
        {"{outages: [{from: 1, to: 0, start_s: -1}]}", NULL, "start_s: -1 is out of range"},
        {"{outages: [{to: 0, start_s: 1}]}", NULL, "outages[0].from: is missing"},
        {"{file: network.csv}", "to,from,stamp,delay\n0,1,0\n",
         "x.yaml:8: networks[0].link.file: network.csv:2: '0,1,0' is not to,from,stamp,delay"},
        {"{file: network.csv}", "0,0,0,0\n", "network.csv:1: '0,0,0,0'"},
        {"{file: network.csv}", "0,4,0,0\n", "network.csv:1: '0,4,0,0'"},
        {"{file: network.csv}", "0,1,0,-2\n", "network.csv:1: '0,1,0,-2'"},
        {"{file: network.csv}", "0,1,0,101\n", "network.csv:1: '0,1,0,101'"},
        {"{file: network.csv}", "0,1,-1,0\n", "network.csv:1: '0,1,-1,0'"},
        {"{file: network.csv}", "0,1,0,0,7\n", "network.csv:1: '0,1,0,0,7'"},
        {"{file: network.csv}", "# nothing\n", "network.csv: has no row to,from,stamp,delay"},
        {"{file: no/such.csv}", NULL, "networks[0].link.file: no/such.csv: No such file"},
    };
    for (int i = 0; i < COUNT(cases); i++) {
        struct error error = {.text = ""};
        struct scenario *scenario = read_link(cases[i][0], cases[i][1], &error);
        if (scenario != NULL)
            fail_msg("was accepted; expected: %s", cases[i][2]);
        if (strstr(error.text, cases[i][2]) == NULL)
            fail_msg("\n  message:  %s\n  expected: %s", error.text, cases[i][2]);
    }
}

/* Beside the scenario, not beside the caller. */
static void a_recorded_network_is_looked_for_beside_the_scenario(void **state)
{
    (void)state;
    struct error error = {.text = ""};
    char folder[] = "/tmp/dse-link-XXXXXX", network[64], file[64], yaml[2048];
    assert_non_null(mkdtemp(folder));
    snprintf(network, sizeof network, "%s/network.csv", folder);
    snprintf(file, sizeof file, "%s/x.yaml", folder);
    FILE *stream = fopen(network, "w");
    assert_non_null(stream);
    fputs("0,1,0,3\n", stream);
    fclose(stream);
    snprintf(yaml, sizeof yaml, text, "{D: 3, file: network.csv}");
    struct scenario *scenario = scenario_parse(yaml, file, NULL, 0, &error);
    assert_string_equal(error.text, "");
    const struct dse_link_config *link =
        scenario != NULL ? scenario_link_fates(&scenario->networks[0]) : NULL;
    assert_true(link != NULL && link->table[1] == 3);
    scenario_free(scenario);
    stream = fopen(network, "w");
    assert_non_null(stream);
    fputs("# of M\xfcller\n0,1,0,3\n", stream); /* Latin-1: a log could not carry it */
    fclose(stream);
    assert_null(scenario_parse(yaml, file, NULL, 0, &error));
    assert_non_null(strstr(error.text, "network.csv: is not UTF-8 text"));
    unlink(network);
    rmdir(folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_method_gets_the_numbers_of_the_link_with_outages_in_samples),
        cmocka_unit_test(a_network_without_link_gets_none),
        cmocka_unit_test(recorded_fates_lie_where_receiver_sender_and_stamp_say),
        cmocka_unit_test(every_number_of_the_link_counts_for_the_hash),
        cmocka_unit_test(the_numbers_in_a_recorded_network_count_for_the_hash_its_comments_do_not),
        cmocka_unit_test(an_outage_in_seconds_holds_back_what_is_sent_at_its_instants),
        cmocka_unit_test(messages_of_rounds_are_lost_by_seed_and_outage),
        cmocka_unit_test(rounds_refuse_delays_and_recordings_that_end_early),
        cmocka_unit_test(what_is_no_link_is_refused_with_its_line),
        cmocka_unit_test(a_recorded_network_is_looked_for_beside_the_scenario),
    };
    return cmocka_run_group_tests_name("scenario_link", tests, NULL, NULL);
}
