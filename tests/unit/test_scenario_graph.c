/* networks[].graph: from the edges to the lists that a method gets, and what is refused. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "runtime/networks.h"

#define COUNT(array) ((int)(sizeof(array) / sizeof(array)[0]))

static const char text[] = "name: linked\n"                              /* 1 */
                           "time: {period_s: 1, duration_s: 10}\n"       /* 2 */
                           "plant: {name: cstr2}\n"                      /* 3 */
                           "networks:\n"                                 /* 4 */
                           "  - name: one\n"                             /* 5 */
                           "    guess: [396, 2.6, 352, 10.5]\n"          /* 6 */
                           "    graph: %s\n"                             /* 7 */
                           "    high_gain_ekf: {d: 0.02, DeltaT: 0.1,\n" /* 8 */
                           "      beta: 5, m: 4, lambda: 100, theta_m: 20,\n"
                           "      Q: [1, 1, 1, 1], R: [1, 1]}\n";

static struct scenario *read_graph(const char *graph, struct error *error)
{
    char yaml[2048];
    snprintf(yaml, sizeof yaml, text, graph);
    return scenario_parse(yaml, "x.yaml", NULL, 0, error);
}

/* The scenario, and what its network's method gets. */
static struct scenario *open_graph(const char *graph, struct method_setup *setup)
{
    struct error error = {.text = ""};
    struct scenario *scenario = read_graph(graph, &error);
    if (scenario == NULL)
        fail_msg("%s", error.text);
    assert_non_null(network_method(scenario, 0, setup, &error));
    return scenario;
}

/* Neighbours of node i as text: "0 2 ". */
static const char *list(const int *first, const int *nodes, int i, char *line, size_t size)
{
    size_t n = 0;
    line[0] = '\0';
    for (int k = first[i]; k < first[i + 1] && n < size; k++)
        n += (size_t)snprintf(line + n, size - n, "%d ", nodes[k]);
    return line;
}

static void expect_lists(const char *graph, int nodes, const char *const *in,
                         const char *const *out)
{
    struct method_setup setup;
    char line[64];
    struct scenario *scenario = open_graph(graph, &setup);
    assert_non_null(setup.graph);
    assert_int_equal(setup.graph->nodes, nodes);
    for (int i = 0; i < nodes; i++) {
        assert_string_equal(list(setup.graph->in_first, setup.graph->in, i, line, sizeof line),
                            in[i]);
        assert_string_equal(list(setup.graph->out_first, setup.graph->out, i, line, sizeof line),
                            out[i]);
    }
    scenario_free(scenario);
}

static void a_directed_edge_is_heard_at_its_end_only(void **state)
{
    (void)state;
    static const char *const in[] = {"1 2 ", "", "0 ", ""};
    static const char *const out[] = {"2 ", "0 ", "0 ", ""};
    expect_lists("{nodes: 4, edges: [2, 0, 0, 2, 1, 0]}", 4, in, out);
}

static void an_undirected_edge_is_heard_at_both_ends(void **state)
{
    (void)state;
    static const char *const both[] = {"1 4 ", "0 2 ", "1 3 ", "2 4 ", "0 3 "};
    expect_lists("{nodes: 5, edges: [0, 1, 1, 2, 2, 3, 3, 4, 4, 0], undirected: true}", 5, both,
                 both);
}

static void a_graph_may_have_no_edges(void **state)
{
    (void)state;
    static const char *const none[] = {"", ""};
    expect_lists("{nodes: 2, edges: []}", 2, none, none);
}

static void edges_count_for_the_hash(void **state)
{
    (void)state;
    static const char *const graphs[] = {"{nodes: 3, edges: [0, 1]}", "{nodes: 3, edges: [1, 0]}",
                                         "{nodes: 4, edges: [0, 1]}",
                                         "{nodes: 3, edges: [0, 1], undirected: true}"};
    uint64_t hash[COUNT(graphs)];
    for (int i = 0; i < COUNT(graphs); i++) {
        struct method_setup setup;
        struct scenario *scenario = open_graph(graphs[i], &setup);
        hash[i] = scenario->hash;
        scenario_free(scenario);
        for (int j = 0; j < i; j++)
            assert_true(hash[i] != hash[j]);
    }
}

static void what_is_no_graph_is_refused_with_its_line(void **state)
{
    (void)state;
    static const char *const cases[][2] = {
        {"{nodes: 3, edges: [0, 1, 2]}",
         "x.yaml:7: networks[0].graph.edges: has 3 entries; it must have pairs: from, to"},
        {"{nodes: 3, edges: [0, 1, 1, 3]}",
         "x.yaml:7: networks[0].graph.edges[3]: there is no node 3: nodes are 0 to 2"},
        {"{nodes: 3, edges: [7, 1]}", "networks[0].graph.edges[0]: there is no node 7"},
        {"{nodes: 3, edges: [0, 1, 2, 2]}",
         "networks[0].graph.edges[2]: the edge 2, 2 leads from a node to itself"},
        {"{nodes: 3, edges: [0, 1, 0, 1]}",
         "networks[0].graph.edges[2]: the edge 0, 1 is given twice"},
        {"{nodes: 3, edges: [0, 1, 1, 0], undirected: true}",
         "networks[0].graph.edges[2]: the edge 1, 0 is given twice"},
        {"{nodes: 0, edges: []}", "graph.nodes: 0 is out of range; it must be >= 1 and <= 1024"},
        {"{nodes: 1025, edges: []}", "networks[0].graph.nodes: 1025 is out of range"},
        {"{nodes: 3, edges: [0, -1]}", "networks[0].graph.edges[1]: must be a whole number >= 0"},
        {"{edges: [0, 1]}", "networks[0].graph.nodes: is missing (number of nodes)"},
        {"{nodes: 3}", "networks[0].graph.edges: is missing (from, to"},
    };
    for (int i = 0; i < COUNT(cases); i++) {
        struct error error = {.text = ""};
        struct scenario *scenario = read_graph(cases[i][0], &error);
        if (scenario != NULL)
            fail_msg("was accepted; expected: %s", cases[i][1]);
        if (strstr(error.text, cases[i][1]) == NULL)
            fail_msg("\n  message:  %s\n  expected: %s", error.text, cases[i][1]);
    }
}

static void the_high_gain_ekf_refuses_a_graph_that_leaves_somebody_out(void **state)
{
    (void)state;
    struct method_setup setup;
    struct error error = {.text = ""};
    static struct method_info info;
    dse_real values[DSE_PLANT_MAX_PARAMETERS], prepared[512];
    struct scenario *scenario = open_graph("{nodes: 2, edges: [0, 1]}", &setup);
    assert_true(scenario->process->prepared_size <= COUNT(prepared));
    assert_true(scenario_prepare_plant(scenario, &scenario->networks[0], values, prepared, &error));
    setup.prepared = prepared;
    assert_null(method_find("high_gain_ekf")->create(&setup, &info, &error));
    assert_non_null(
        strstr(error.text, "x.yaml: networks.one.graph: subsystem 1 acts on subsystem 0: node 0 "));
    scenario_free(scenario);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_directed_edge_is_heard_at_its_end_only),
        cmocka_unit_test(an_undirected_edge_is_heard_at_both_ends),
        cmocka_unit_test(a_graph_may_have_no_edges),
        cmocka_unit_test(edges_count_for_the_hash),
        cmocka_unit_test(what_is_no_graph_is_refused_with_its_line),
        cmocka_unit_test(the_high_gain_ekf_refuses_a_graph_that_leaves_somebody_out),
    };
    return cmocka_run_group_tests_name("scenario_graph", tests, NULL, NULL);
}
