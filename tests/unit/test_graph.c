/* Digraphs: lists, matrices and properties, on graphs whose answers are known by hand. */
#include "dse/graph.h"

#include "near.h"

enum { ROOM = 4096, MOST = 64 };

static dse_real memory[ROOM];
static int scratch[DSE_GRAPH_SCRATCH(MOST)];

static enum dse_status make(struct dse_graph *graph, int nodes, int count, const int *pairs,
                            bool undirected)
{
    struct dse_arena arena;
    const int edges = undirected ? 2 * count : count;
    const int size = DSE_GRAPH_STORAGE(nodes > 0 ? nodes : 0, edges);
    assert_true(size <= ROOM);
    dse_arena_init(&arena, memory, size);
    const enum dse_status status = dse_graph_make(graph, nodes, count, pairs, undirected, &arena);
    if (status == DSE_OK)
        assert_int_equal(arena.used, size);
    return status;
}

/* Vertices a .. e of the consensus source's figure 2.2; j -> i. */
static const int five[] = {3, 4, 1, 0, 1, 4, 2, 0, 0, 2, 3, 0, 2, 3, 1, 2};
enum { FIVE = sizeof five / sizeof five[0] / 2 };

static const dse_real five_adjacency[25] = {0, 1, 1, 1, 0, 0, 0, 0, 0, 0, 1, 1, 0,
                                            0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 0};

static void lists_are_ascending_and_opposite(void **state)
{
    (void)state;
    struct dse_graph graph;
    assert_int_equal(make(&graph, 5, FIVE, five, false), DSE_OK);
    assert_int_equal(graph.edges, FIVE);
    int found = 0;
    for (int i = 0; i < 5; i++) {
        for (int k = graph.in_first[i]; k < graph.in_first[i + 1]; k++) {
            const int j = graph.in[k];
            if (k > graph.in_first[i])
                assert_true(graph.in[k - 1] < j);
            assert_int_equal(dse_graph_in_place(&graph, i, j), k - graph.in_first[i]);
            const int there = dse_graph_out_place(&graph, j, i);
            assert_int_equal(graph.out[graph.out_first[j] + there], i);
            found++;
        }
        for (int k = graph.out_first[i] + 1; k < graph.out_first[i + 1]; k++)
            assert_true(graph.out[k - 1] < graph.out[k]);
    }
    assert_int_equal(found, FIVE);
    assert_int_equal(dse_graph_in_place(&graph, 1, 0), -1);
    assert_int_equal(dse_graph_out_place(&graph, 4, 0), -1);
}

static void matrices_of_the_five_vertices_are_those_of_the_figure(void **state)
{
    (void)state;
    static const dse_real degrees[5] = {3, 0, 2, 1, 2};
    struct dse_graph graph;
    dse_real adjacency[25], L[25];
    assert_int_equal(make(&graph, 5, FIVE, five, false), DSE_OK);
    dse_graph_adjacency(&graph, adjacency);
    dse_graph_laplacian(&graph, L);
    for (int k = 0; k < 25; k++) {
        assert_true(adjacency[k] == five_adjacency[k]);
        const dse_real degree = k % 6 == 0 ? degrees[k / 6] : 0;
        assert_true(L[k] == degree - five_adjacency[k]);
    }
    assert_int_equal(dse_graph_largest_in_degree(&graph), 3);
    assert_int_equal(dse_graph_in_degree(&graph, 2), 2);
    assert_int_equal(dse_graph_out_degree(&graph, 1), 3);
}

static void five_vertices_have_a_spanning_tree_and_no_more(void **state)
{
    (void)state;
    struct dse_graph graph;
    assert_int_equal(make(&graph, 5, FIVE, five, false), DSE_OK);
    assert_int_equal(dse_graph_root(&graph, scratch), 1); /* b */
    assert_int_equal(dse_graph_reached(&graph, 1, scratch), 5);
    assert_int_equal(dse_graph_reached(&graph, 4, scratch), 1);
    assert_int_equal(dse_graph_reached(&graph, 0, scratch), 4); /* all but b */
    assert_false(dse_graph_is_strongly_connected(&graph, scratch));
    assert_true(dse_graph_is_weakly_connected(&graph, scratch));
    assert_false(dse_graph_is_balanced(&graph));
    assert_false(dse_graph_is_undirected(&graph));
}

/* Graphs and what is known of them. */
static void properties_are_those_known(void **state)
{
    (void)state;
    static const int ring[] = {0, 1, 1, 2, 2, 3, 3, 0};
    static const int two_roots[] = {2, 1, 1, 2, 1, 0, 2, 3};
    static const int two_parts[] = {0, 1, 1, 0, 2, 3, 3, 2};
    static const int into_one[] = {0, 3, 1, 3, 2, 3};
    static const int lollipop[] = {0, 1, 1, 2, 2, 0, 0, 3};
    static const struct known {
        const int *pairs;
        int count;
        bool undirected;
        int root;
        bool strong, weak, balanced, symmetric;
    } known[] = {
        {ring, 4, false, 0, true, true, true, false},
        {ring, 4, true, 0, true, true, true, true},
        {two_roots, 4, false, 1, false, true, false, false},
        {two_parts, 4, false, -1, false, false, true, true},
        {into_one, 3, false, -1, false, true, false, false},
        {into_one, 3, true, 0, true, true, true, true},
        {lollipop, 4, false, 0, false, true, false, false},
        {NULL, 0, false, -1, false, false, true, true},
    };
    for (size_t c = 0; c < sizeof known / sizeof known[0]; c++) {
        struct dse_graph graph;
        assert_int_equal(make(&graph, 4, known[c].count, known[c].pairs, known[c].undirected),
                         DSE_OK);
        assert_int_equal(dse_graph_root(&graph, scratch), known[c].root);
        assert_true(dse_graph_is_strongly_connected(&graph, scratch) == known[c].strong);
        assert_true(dse_graph_is_weakly_connected(&graph, scratch) == known[c].weak);
        assert_true(dse_graph_is_balanced(&graph) == known[c].balanced);
        assert_true(dse_graph_is_undirected(&graph) == known[c].symmetric);
    }
}

static void weights_count_in_balance_and_symmetry(void **state)
{
    (void)state;
    static const int ring[] = {0, 1, 1, 2, 2, 0};
    static const dse_real even[3] = {2, 2, 2}, uneven[3] = {2, 2, 1};
    struct dse_graph graph;
    assert_int_equal(make(&graph, 3, 3, ring, false), DSE_OK);
    graph.weight = even;
    assert_true(dse_graph_is_balanced(&graph));
    graph.weight = uneven;
    assert_false(dse_graph_is_balanced(&graph));

    static const int link[] = {0, 1};
    assert_int_equal(make(&graph, 2, 1, link, true), DSE_OK);
    graph.weight = even;
    assert_true(dse_graph_is_undirected(&graph));
    graph.weight = uneven + 1;
    assert_false(dse_graph_is_undirected(&graph));
}

static void laplacian_times_is_the_product_with_the_matrix(void **state)
{
    (void)state;
    static const dse_real weight[FIVE] = {1, 2, 3, DSE_REAL(0.5), 1, 4, DSE_REAL(0.25), 1};
    dse_real x[10], y[10], L[25];
    struct dse_graph graph;
    assert_int_equal(make(&graph, 5, FIVE, five, false), DSE_OK);
    graph.weight = weight;
    for (int k = 0; k < 10; k++)
        x[k] = (dse_real)(k * k - 7 * k);
    dse_graph_laplacian(&graph, L);
    dse_graph_laplacian_times(&graph, 2, x, y);
    for (int i = 0; i < 5; i++) {
        for (int c = 0; c < 2; c++) {
            dse_real sum = 0;
            for (int j = 0; j < 5; j++)
                sum += L[i * 5 + j] * x[j * 2 + c];
            assert_near(y[i * 2 + c], sum, TOLERANCE(1e-12, 1e-4));
        }
    }
}

static void what_is_no_graph_is_refused(void **state)
{
    (void)state;
    static const int itself[] = {0, 1, 1, 1}, far[] = {0, 3}, negative[] = {-1, 0};
    static const int twice[] = {0, 1, 1, 2, 0, 1}, back[] = {0, 1, 1, 0};
    struct dse_graph graph;
    assert_int_equal(make(&graph, 3, 2, itself, false), DSE_EINVAL);
    assert_int_equal(make(&graph, 3, 1, far, false), DSE_EINVAL);
    assert_int_equal(make(&graph, 3, 1, negative, false), DSE_EINVAL);
    assert_int_equal(make(&graph, 3, 3, twice, false), DSE_EINVAL);
    assert_int_equal(make(&graph, 3, 2, back, false), DSE_OK);
    assert_int_equal(make(&graph, 3, 2, back, true), DSE_EINVAL);
    assert_int_equal(make(&graph, 0, 0, NULL, false), DSE_EINVAL);

    struct dse_arena arena;
    dse_arena_init(&arena, memory, DSE_GRAPH_STORAGE(3, 2) - 1);
    assert_int_equal(dse_graph_make(&graph, 3, 2, back, false, &arena), DSE_ESTORAGE);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lists_are_ascending_and_opposite),
        cmocka_unit_test(matrices_of_the_five_vertices_are_those_of_the_figure),
        cmocka_unit_test(five_vertices_have_a_spanning_tree_and_no_more),
        cmocka_unit_test(properties_are_those_known),
        cmocka_unit_test(weights_count_in_balance_and_symmetry),
        cmocka_unit_test(laplacian_times_is_the_product_with_the_matrix),
        cmocka_unit_test(what_is_no_graph_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
