/* The adapter of the high-gain EKF: combinations of keys, recorded networks, and what a node hears
 * through a lossy link. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "dse/link.h"
#include "methods/method.h"

enum { NODES = 2, SAMPLES = 200, THETA = 0, J_SUM = 2, AGE = 4, SENT = 5 };

#define HEAD                                                                                       \
    "name: method\nseed: 3\ntime: {period_s: 1, duration_s: 200}\nplant: {name: cstr2, set: "      \
    "ch4}\nnetworks:\n  - name: one\n    guess: [396, 2.1, 352, 9.7]\n%s    high_gain_ekf:\n"      \
    "      {d: 0.01, DeltaT: 0.001, beta: 5, m: 1, lambda: 1000, theta_m: 10,\n"                   \
    "       coordinates: physical, scaling: plain, Q: [50, 5, 50, 5], R: [1, 1],\n       "

/* All nodes of the network, and the plant beside them. */
struct rig {
    struct scenario *scenario;
    const struct method *method;
    dse_real values[DSE_PLANT_MAX_PARAMETERS], prepared[512];
    struct method_setup setup[NODES];
    struct method_info info[NODES];
    void *node[NODES];
    struct method_estimate estimate[NODES];
    int nodes;
};

static void close_rig(struct rig *rig)
{
    for (int i = 0; i < rig->nodes; i++)
        if (rig->node[i] != NULL)
            rig->method->destroy(rig->node[i]);
    scenario_free(rig->scenario);
}

/* The scenario with `keys` in its section, and in its network what follows "link: " in them; false
 * and an error text when a node cannot be made. */
static bool open_rig(struct rig *rig, const char *file, const char *keys, struct error *error)
{
    char yaml[2000], link[200] = "", section[400];
    const char *mark = strstr(keys, " link: ");
    memset(rig, 0, sizeof *rig);
    snprintf(section, sizeof section, "%s", keys);
    if (mark != NULL) {
        snprintf(link, sizeof link, "   %s\n", mark);
        section[mark - keys] = '\0';
    }
    snprintf(yaml, sizeof yaml, HEAD "%s}\n", link, section);
    rig->scenario = scenario_parse(yaml, file, NULL, 0, error);
    if (rig->scenario == NULL)
        return false;
    rig->method = method_find("high_gain_ekf");
    const struct scenario_network *network = &rig->scenario->networks[0];
    assert_true(rig->scenario->process->prepared_size <= 512);
    bool ok = scenario_prepare_plant(rig->scenario, network, rig->values, rig->prepared, error);
    for (int i = 0; i < NODES; i++)
        rig->setup[i] = (struct method_setup){.scenario = rig->scenario,
                                              .network = network,
                                              .section = network->section[scenario_method(network)],
                                              .link = scenario_link_fates(network),
                                              .process = rig->scenario->process,
                                              .prepared = rig->prepared,
                                              .period = scenario_period(rig->scenario),
                                              .node = i};
    int nodes = rig->method->nodes(&rig->setup[0]);
    for (int i = 0; ok && i < nodes; i++) {
        rig->node[i] = rig->method->create(&rig->setup[i], &rig->info[i], error);
        ok = rig->node[i] != NULL;
        rig->nodes = i + 1;
    }
    if (!ok)
        close_rig(rig);
    return ok;
}

static void must_open(struct rig *rig, const char *file, const char *keys)
{
    struct error error = {.text = ""};
    if (!open_rig(rig, file, keys, &error))
        fail_msg("%s", error.text);
}

static void must_fail(const char *file, const char *keys, const char *wanted)
{
    static struct rig rig;
    struct error error = {.text = ""};
    if (open_rig(&rig, file, keys, &error)) {
        close_rig(&rig);
        fail_msg("accepted: %s", keys);
    }
    if (strstr(error.text, wanted) == NULL)
        fail_msg("\n  message:  %s\n  expected: %s", error.text, wanted);
}

/* One sample with constant measurements. told[j]: node j sent a message that was not withheld. */
static void sample(struct rig *rig, int64_t k, bool *told)
{
    static const double u[2] = {4.998, 0}, y[NODES] = {350, 315};
    static const bool valid[NODES] = {true, true};
    double value[NODES][METHOD_MESSAGE_CAPACITY];
    struct method_message message[NODES] = {{.value = value[0]}, {.value = value[1]}};
    static struct method_plan plan;
    for (int i = 0; i < rig->nodes; i++) {
        struct method_sample in = {
            .k = k, .t = (double)k * rig->setup[0].period, .u = u, .y = y + i, .valid = valid};
        assert_int_equal(rig->method->begin(rig->node[i], &in), DSE_OK);
        told[i] = false;
    }
    for (int round = 0;; round++) {
        int done = 0;
        for (int i = 0; i < rig->nodes; i++) {
            done += rig->method->next(rig->node[i], round, &plan, &message[i]) == METHOD_DONE;
            told[i] = told[i] || !message[i].withheld;
        }
        if (done > 0) {
            assert_int_equal(done, rig->nodes);
            break;
        }
        for (int i = 0; i < rig->nodes; i++)
            assert_int_equal(rig->method->receive(rig->node[i], round, 1 - i, &message[1 - i]),
                             DSE_OK);
    }
    for (int i = 0; i < rig->nodes; i++)
        assert_int_equal(rig->method->finish(rig->node[i], &rig->estimate[i]), DSE_OK);
}

/* ---- keys ---- */

static void keys_that_do_not_go_together_are_refused(void **state)
{
    (void)state;
    static const struct {
        const char *keys, *wanted;
    } cases[] = {
        {"communication: {kind: triggered}", "kind triggered needs it"},
        {"communication: {trigger: {L: 1}}", "it needs kind triggered"},
        {"communication: {kind: stages}, link: {D: 3}", "tick only"},
        {"communication: {every: 100000}, link: {D: 20}", "too long to be kept"},
        {"communication: {kind: triggered, trigger: {L: -1}}", "trigger.L: -1 is out of range"},
        {"communication: {kind: triggered, trigger: {L: 1, H: [1, 2]}}", "it must have 4"},
        {"framework: centralised, link: {D: 1}", "tick only"},
        {"framework: centralised, gains: [one, one]",
         "x.yaml: networks.one.high_gain_ekf.framework: a centralised filter talks to nobody"},
        {"predictor_parameters: [{name: Fx, value: 1}]", "has no parameter 'Fx'"},
        {"predictor_parameters: [{name: V1, value: -1}]", "make no plant"},
    };
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++)
        must_fail("x.yaml", cases[c].keys, cases[c].wanted);
}

/* ---- delays and losses ---- */

static const char lossy[] = "communication: {every: 5}, link: {D: 3, T_m: 2, loss: 0.4}";

static void node_hears_through_the_network_that_the_scenario_asks_for(void **state)
{
    (void)state;
    static struct rig a, b;
    bool told[NODES];
    int oldest = 0;
    must_open(&a, "x.yaml", lossy);
    must_open(&b, "x.yaml", lossy);
    for (int64_t k = 0; k < SAMPLES; k++) {
        sample(&a, k, told);
        sample(&b, k, told);
        for (int i = 0; i < NODES; i++) {
            int age = (int)a.estimate[i].diagnostic[AGE];
            assert_in_range(age, 0, DSE_LINK_MAX_AGE(3, 2));
            oldest = age > oldest ? age : oldest;
            assert_memory_equal(a.estimate[i].state, b.estimate[i].state, 2 * sizeof(double));
        }
    }
    assert_true(oldest >= 2);
    /* another seed of the link alone is another network */
    close_rig(&b);
    must_open(&b, "x.yaml", "communication: {every: 5}, link: {D: 3, T_m: 2, loss: 0.4, seed: 1}");
    for (int64_t k = 0; k < SAMPLES; k++)
        sample(&b, k, told);
    double difference = a.estimate[0].state[0] - b.estimate[0].state[0];
    assert_true(difference > 0 || difference < 0);
    close_rig(&a);
    close_rig(&b);
}

static void write_text(const char *path, const char *text)
{
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fputs(text, file);
    fclose(file);
}

/* The same fates from the seed and from a file that lies beside the scenario. */
static void recorded_network_gives_the_estimates_of_the_random_one(void **state)
{
    (void)state;
    static struct rig random, recorded;
    char folder[] = "/tmp/dse-method-XXXXXX", network[64], scenario[64];
    bool told[NODES];
    assert_non_null(mkdtemp(folder));
    snprintf(network, sizeof network, "%s/network.csv", folder);
    snprintf(scenario, sizeof scenario, "%s/x.yaml", folder);
    FILE *file = fopen(network, "w");
    assert_non_null(file);
    fputs("# recorded\nto,from,stamp,delay\n", file);
    const struct dse_link_config config = {.max_delay = 3, .max_losses = 2, .loss = 0.4, .seed = 3};
    for (int to = 0; to < NODES; to++) {
        struct dse_link link;
        assert_int_equal(dse_link_init(&link, &config, to, 1 - to), DSE_OK);
        for (int s = 0; s < SAMPLES / 5; s++)
            fprintf(file, "%d,%d,%d,%d\n", to, 1 - to, s, dse_link_fate(&link, s));
    }
    fclose(file);
    must_open(&random, "x.yaml", lossy);
    must_open(&recorded, scenario, "communication: {every: 5}, link: {D: 3, file: network.csv}");
    for (int64_t k = 0; k < SAMPLES; k++) {
        sample(&random, k, told);
        sample(&recorded, k, told);
        for (int i = 0; i < NODES; i++)
            assert_memory_equal(random.estimate[i].state, recorded.estimate[i].state,
                                2 * sizeof(double));
    }
    close_rig(&random);
    close_rig(&recorded);
    unlink(network);
    rmdir(folder);
}

static void recording_that_ends_before_the_run_is_refused(void **state)
{
    (void)state;
    char folder[] = "/tmp/dse-method-XXXXXX", network[64], scenario[64];
    assert_non_null(mkdtemp(folder));
    snprintf(network, sizeof network, "%s/network.csv", folder);
    snprintf(scenario, sizeof scenario, "%s/x.yaml", folder);
    write_text(network, "0,1,3,0\n");
    must_fail(scenario, "communication: {every: 5}, link: {D: 3, file: network.csv}",
              "network.csv ends at stamp 3, but the run has 40 communication instants");
    unlink(network);
    rmdir(folder);
}

/* ---- triggers, centralised ---- */

static void silence_is_withheld_and_states_are_counted(void **state)
{
    (void)state;
    static struct rig rig;
    bool told[NODES];
    int sent[NODES] = {0};
    must_open(&rig, "x.yaml",
              "innovation: sum, communication: {kind: triggered, every: 5, predictor: false, "
              "trigger: {norm: relative, L: 0.02, H: [200, 1, 200, 1]}}");
    for (int64_t k = 0; k < SAMPLES; k++) {
        sample(&rig, k, told);
        for (int i = 0; i < NODES; i++) {
            sent[i] += told[i];
            assert_true(!told[i] || k % 5 == 0);
            assert_int_equal((int)rig.estimate[i].diagnostic[SENT], sent[i]);
        }
        /* J is heard in every sample, also in the silent ones: one theta for both */
        assert_memory_equal(&rig.estimate[0].diagnostic[J_SUM], &rig.estimate[1].diagnostic[J_SUM],
                            sizeof(double));
    }
    assert_true(sent[0] > 3 && sent[0] < SAMPLES / 5);
    close_rig(&rig);
}

static void centralised_network_has_one_node_with_all_outputs(void **state)
{
    (void)state;
    static struct rig rig;
    bool told[NODES];
    must_open(&rig, "x.yaml", "framework: centralised");
    assert_int_equal(rig.nodes, 1);
    assert_int_equal(rig.info[0].n_states, 4);
    assert_int_equal(rig.info[0].n_groups, 2);
    assert_int_equal(rig.info[0].n_neighbours, 0);
    for (int64_t k = 0; k < SAMPLES; k++)
        sample(&rig, k, told);
    /* from 396 K and 352 K to what is measured */
    assert_true(rig.estimate[0].state[0] > 335 && rig.estimate[0].state[0] < 355);
    assert_true(rig.estimate[0].state[2] > 310 && rig.estimate[0].state[2] < 325);
    assert_true(rig.estimate[0].diagnostic[THETA] >= 1);
    close_rig(&rig);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(keys_that_do_not_go_together_are_refused),
        cmocka_unit_test(node_hears_through_the_network_that_the_scenario_asks_for),
        cmocka_unit_test(recorded_network_gives_the_estimates_of_the_random_one),
        cmocka_unit_test(recording_that_ends_before_the_run_is_refused),
        cmocka_unit_test(silence_is_withheld_and_states_are_counted),
        cmocka_unit_test(centralised_network_has_one_node_with_all_outputs),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
