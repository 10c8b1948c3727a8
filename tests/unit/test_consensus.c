/* Consensus filters: where they end, how large their steps may be, and what lost, late and broken
 * messages do to them. */
#include "dse/consensus.h"

#include "dse/linalg.h"
#include "near.h"
#include "random_matrix.h"

enum { NODES = 8, EDGES = NODES * (NODES - 1), SIZE = 21 /* more than is summed at once */ };

/* ---- graphs ---- */

struct links {
    const char *name;
    int nodes, count;
    int pairs[EDGES];
};

static struct links ring(int nodes)
{
    struct links links = {.name = "ring", .nodes = nodes, .count = nodes};
    for (int i = 0; i < nodes; i++) {
        links.pairs[2 * i] = i;
        links.pairs[2 * i + 1] = (i + 1) % nodes;
    }
    return links;
}

static struct links complete(int nodes)
{
    struct links links = {.name = "complete", .nodes = nodes};
    for (int i = 0; i < nodes; i++) {
        for (int j = 0; j < i; j++) {
            links.pairs[2 * links.count] = i;
            links.pairs[2 * links.count + 1] = j;
            links.count++;
        }
    }
    return links;
}

/* A triangle with a tail of two. */
static struct links kite(void)
{
    return (struct links){
        .name = "kite", .nodes = 5, .count = 5, .pairs = {0, 1, 0, 2, 1, 2, 2, 3, 3, 4}};
}

/* ---- all nodes of a graph ---- */

static struct dse_graph graph;
static dse_real graph_memory[DSE_GRAPH_STORAGE(NODES, EDGES)];
static struct dse_consensus_config config[NODES];
static struct dse_consensus node[NODES];
static dse_real memory[NODES][DSE_CONSENSUS_STORAGE(SIZE, NODES - 1)];
static bool deaf[NODES][NODES]; /* [i][j]: i does not hear j */

static enum dse_status make(const struct links *links, struct dse_consensus_config base)
{
    struct dse_arena arena;
    dse_arena_init(&arena, graph_memory, DSE_GRAPH_STORAGE(NODES, EDGES));
    assert_int_equal(dse_graph_make(&graph, links->nodes, links->count, links->pairs, true, &arena),
                     DSE_OK);
    base.largest_degree = dse_graph_largest_in_degree(&graph);
    for (int i = 0; i < links->nodes; i++) {
        config[i] = base;
        config[i].n_neighbours = dse_graph_in_degree(&graph, i);
        const int room = DSE_CONSENSUS_STORAGE(base.size, config[i].n_neighbours);
        dse_arena_init(&arena, memory[i], room);
        const enum dse_status status = dse_consensus_init(&node[i], &config[i], &arena);
        if (status != DSE_OK)
            return status;
        for (int j = 0; j < links->nodes; j++)
            deaf[i][j] = false;
    }
    return DSE_OK;
}

static void set_inputs(const dse_real *u /* nodes x size */)
{
    for (int i = 0; i < graph.nodes; i++)
        assert_int_equal(dse_consensus_input(&node[i], u + i * config[i].size), DSE_OK);
}

static void rounds(int count)
{
    for (int r = 0; r < count; r++) {
        for (int i = 0; i < graph.nodes; i++) {
            for (int k = graph.in_first[i]; k < graph.in_first[i + 1]; k++) {
                dse_real message[DSE_CONSENSUS_MESSAGE(SIZE)];
                const int reals = dse_consensus_message(&node[graph.in[k]], message);
                if (!deaf[i][graph.in[k]])
                    assert_int_equal(
                        dse_consensus_receive(&node[i], k - graph.in_first[i], message, reals),
                        DSE_OK);
            }
        }
        for (int i = 0; i < graph.nodes; i++)
            assert_int_equal(dse_consensus_end_round(&node[i]), DSE_OK);
    }
}

static void average_of(int nodes, int size, const dse_real *u, dse_real *average)
{
    for (int e = 0; e < size; e++) {
        average[e] = 0;
        for (int i = 0; i < nodes; i++)
            average[e] += u[i * size + e] / (dse_real)nodes;
    }
}

/* ---- where they end ---- */

static void three_kinds_end_at_the_average_whatever_loops_there_are(void **state)
{
    (void)state;
    static const enum dse_consensus_kind kinds[] = {DSE_CONSENSUS_AVERAGE, DSE_CONSENSUS_HIGH_PASS,
                                                    DSE_CONSENSUS_BAND_PASS};
    const struct links graphs[] = {ring(6), complete(5), kite()};
    dse_real u[NODES * SIZE], average[SIZE];
    for (size_t g = 0; g < sizeof graphs / sizeof graphs[0]; g++) {
        for (size_t k = 0; k < sizeof kinds / sizeof kinds[0]; k++) {
            fill(NODES * SIZE, u);
            average_of(graphs[g].nodes, SIZE, u, average);
            assert_int_equal(
                make(&graphs[g], (struct dse_consensus_config){.kind = kinds[k], .size = SIZE}),
                DSE_OK);
            set_inputs(u);
            rounds(600);
            for (int i = 0; i < graphs[g].nodes; i++)
                assert_all_near(SIZE, dse_consensus_output(&node[i]), average,
                                TOLERANCE(1e-14, 5e-6));
        }
    }
}

/* (I + D + L) c = (I + Adj) u. */
static void solve_low_pass(const dse_real *u, int size, dse_real *c)
{
    const int n = graph.nodes;
    dse_real adjacency[NODES * NODES], M[NODES * NODES];
    int pivots[NODES];
    dse_graph_adjacency(&graph, adjacency);
    dse_graph_laplacian(&graph, M);
    for (int i = 0; i < n; i++) {
        M[i * n + i] += 1 + (dse_real)dse_graph_in_degree(&graph, i);
        adjacency[i * n + i] = 1;
    }
    dse_mat_mul(n, n, size, adjacency, u, c);
    assert_int_equal(dse_lu(n, M, pivots), DSE_OK);
    dse_lu_solve(n, M, pivots, size, c);
}

static void low_pass_ends_at_its_formula_which_is_no_average_but_on_complete_graphs(void **state)
{
    (void)state;
    enum { TWO = 2 };
    const struct links graphs[] = {ring(6), complete(5), kite()};
    for (size_t g = 0; g < sizeof graphs / sizeof graphs[0]; g++) {
        dse_real u[NODES * TWO], c[NODES * TWO], average[TWO], off = 0;
        const struct dse_consensus_config base = {.kind = DSE_CONSENSUS_LOW_PASS, .size = TWO};
        fill(NODES * TWO, u);
        assert_int_equal(make(&graphs[g], base), DSE_OK);
        average_of(graphs[g].nodes, TWO, u, average);
        solve_low_pass(u, TWO, c);
        set_inputs(u);
        rounds(400);
        for (int i = 0; i < graphs[g].nodes; i++) {
            assert_all_near(TWO, dse_consensus_output(&node[i]), c + i * TWO,
                            TOLERANCE(1e-14, 2e-6));
            for (int e = 0; e < TWO; e++)
                off = dse_max(off, dse_abs(c[i * TWO + e] - average[e]));
        }
        assert_int_equal(off < TOLERANCE(1e-14, 2e-6), graphs[g].count == 10);
    }
}

/* A round of the low-pass is slower than its input: of a constant from zero it shows
 * 1 - (1 - eps (1 + degree))^rounds. */
static void low_pass_lags(void **state)
{
    (void)state;
    const struct links links = ring(6);
    const dse_real ones[6] = {1, 1, 1, 1, 1, 1}, eps = DSE_REAL(0.1);
    assert_int_equal(make(&links, (struct dse_consensus_config){.kind = DSE_CONSENSUS_LOW_PASS,
                                                                .size = 1,
                                                                .epsilon = eps}),
                     DSE_OK);
    set_inputs(ones);
    dse_real behind = 1;
    for (int r = 0; r < 10; r++) {
        rounds(1);
        behind *= 1 - 3 * eps;
        assert_near(dse_consensus_output(&node[0])[0], 1 - behind, TOLERANCE(1e-15, 1e-6));
    }
}

static void average_of_a_complete_graph_takes_one_round(void **state)
{
    (void)state;
    const struct links links = complete(6);
    dse_real u[6], average;
    fill(6, u);
    average_of(6, 1, u, &average);
    assert_int_equal(
        make(&links, (struct dse_consensus_config){.kind = DSE_CONSENSUS_HIGH_PASS, .size = 1}),
        DSE_OK); /* the default step is 1 / nodes there */
    set_inputs(u);
    rounds(1);
    for (int i = 0; i < 6; i++)
        assert_near(dse_consensus_output(&node[i])[0], average, TOLERANCE(1e-15, 5e-7));
}

/* ---- steps ---- */

/* Largest value of all nodes of the ring of six after many rounds with this step, with the kernels,
 * which check nothing. The alternating input excites lambda_max(L) = 4. */
static dse_real size_after(enum dse_consensus_kind kind, dse_real eps)
{
    enum { SIX = 6 };
    dse_real x[SIX], u[SIX], said[SIX][2][2], worst = 0;
    for (int i = 0; i < SIX; i++) {
        u[i] = i % 2 == 0 ? 1 : -1;
        x[i] = kind == DSE_CONSENSUS_AVERAGE ? u[i] : 0;
    }
    for (int r = 0; r < 300; r++) {
        for (int i = 0; i < SIX; i++) {
            for (int s = 0; s < 2; s++) {
                const int j = (i + (s == 0 ? 5 : 1)) % SIX;
                const bool high = kind == DSE_CONSENSUS_HIGH_PASS;
                said[i][s][0] = high ? x[j] + u[j] : x[j];
                said[i][s][1] = u[j];
            }
        }
        for (int i = 0; i < SIX; i++) {
            const struct dse_consensus_words words = {.count = 2, .stride = 2, .said = said[i][0]};
            if (kind == DSE_CONSENSUS_AVERAGE)
                dse_consensus_average(&words, 0, 1, eps, &x[i]);
            else if (kind == DSE_CONSENSUS_HIGH_PASS)
                dse_consensus_high_pass(&words, 0, 1, eps, &u[i], &x[i]);
            else
                dse_consensus_low_pass(&words, 0, 1, 1, eps, &u[i], &x[i]);
        }
    }
    for (int i = 0; i < SIX; i++)
        worst = dse_max(worst, dse_abs(x[i]));
    return worst;
}

static void steps_beyond_their_bound_blow_up_and_those_below_do_not(void **state)
{
    (void)state;
    static const struct {
        enum dse_consensus_kind kind;
        double bound; /* 2 / lambda_max, 2 / (1 + degree + lambda_max) */
    } cases[] = {{DSE_CONSENSUS_AVERAGE, 0.5},
                 {DSE_CONSENSUS_HIGH_PASS, 0.5},
                 {DSE_CONSENSUS_LOW_PASS, 2.0 / 7}};
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++) {
        assert_true(size_after(cases[c].kind, DSE_REAL(0.97 * cases[c].bound)) < 2);
        assert_true(size_after(cases[c].kind, DSE_REAL(1.03 * cases[c].bound)) > 1e4);
        assert_true(size_after(cases[c].kind, dse_consensus_largest_step(cases[c].kind, 2)) < 2);
    }
}

static void steps_are_checked_against_the_largest_degree(void **state)
{
    (void)state;
    static const struct {
        struct dse_consensus_config config;
        enum dse_status status;
    } cases[] = {
        {{.kind = DSE_CONSENSUS_HIGH_PASS, .epsilon = DSE_REAL(1.0 / 3)}, DSE_OK},
        {{.kind = DSE_CONSENSUS_HIGH_PASS, .epsilon = DSE_REAL(0.34)}, DSE_EINVAL},
        {{.kind = DSE_CONSENSUS_AVERAGE, .epsilon = DSE_REAL(0.34)}, DSE_EINVAL},
        {{.kind = DSE_CONSENSUS_LOW_PASS, .epsilon = DSE_REAL(1.0 / 7)}, DSE_OK},
        {{.kind = DSE_CONSENSUS_LOW_PASS, .epsilon = DSE_REAL(0.15)}, DSE_EINVAL},
        {{.kind = DSE_CONSENSUS_BAND_PASS, .epsilon = DSE_REAL(0.28), .alpha = DSE_REAL(0.5)},
         DSE_OK},
        {{.kind = DSE_CONSENSUS_BAND_PASS, .epsilon = DSE_REAL(0.3), .alpha = DSE_REAL(0.5)},
         DSE_EINVAL},
        {{.kind = DSE_CONSENSUS_BAND_PASS, .epsilon = DSE_REAL(0.34), .alpha = DSE_REAL(0.1)},
         DSE_EINVAL},
        {{.kind = DSE_CONSENSUS_BAND_PASS, .alpha = 3}, DSE_OK},
        {{.kind = DSE_CONSENSUS_HIGH_PASS, .epsilon = DSE_REAL(-0.1)}, DSE_EINVAL},
        {{.kind = (enum dse_consensus_kind)4}, DSE_EINVAL},
    };
    const struct links links = kite(); /* degrees 1 to 3 */
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++) {
        struct dse_consensus_config base = cases[c].config;
        base.size = 1;
        assert_int_equal(make(&links, base), cases[c].status);
    }
}

static void other_wrong_settings_are_refused(void **state)
{
    (void)state;
    struct dse_consensus filter;
    struct dse_arena arena;
    dse_arena_init(&arena, memory[0], DSE_CONSENSUS_STORAGE(3, 2));
    const struct dse_consensus_config cases[] = {
        {.size = 0},
        {.size = 3, .n_neighbours = -1},
        {.size = 3, .n_neighbours = 2, .largest_degree = 1}};
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++)
        assert_int_equal(dse_consensus_init(&filter, &cases[c], &arena), DSE_EINVAL);
    const struct dse_consensus_config fits = {
        .kind = DSE_CONSENSUS_BAND_PASS, .size = 3, .n_neighbours = 2};
    arena.used = 1; /* one real short */
    assert_int_equal(dse_consensus_init(&filter, &fits, &arena), DSE_ESTORAGE);
    arena.used = 0;
    assert_int_equal(dse_consensus_init(&filter, &fits, &arena), DSE_OK);
    assert_int_equal(arena.used, arena.capacity);
}

/* ---- losses ---- */

static dse_real sum_of_outputs(void)
{
    dse_real sum = 0;
    for (int i = 0; i < graph.nodes; i++)
        sum += dse_consensus_output(&node[i])[0];
    return sum;
}

static void a_link_lost_both_ways_keeps_the_sum_one_lost_in_one_direction_moves_it(void **state)
{
    (void)state;
    const struct links links = ring(6);
    const dse_real u[6] = {6, 0, 0, 0, 0, 0};
    for (int both = 0; both < 2; both++) {
        assert_int_equal(
            make(&links, (struct dse_consensus_config){.kind = DSE_CONSENSUS_HIGH_PASS, .size = 1}),
            DSE_OK);
        set_inputs(u);
        deaf[1][0] = true;
        deaf[0][1] = both == 1;
        rounds(3);
        deaf[1][0] = deaf[0][1] = false;
        rounds(300);
        if (both == 1) {
            assert_near(sum_of_outputs(), 6, TOLERANCE(1e-14, 1e-5));
        } else {
            assert_true(dse_abs(sum_of_outputs() - 6) > 1);
            for (int i = 0; i < 6; i++) /* reset repairs it */
                dse_consensus_reset(&node[i]);
            rounds(300);
            assert_near(sum_of_outputs(), 6, TOLERANCE(1e-14, 1e-5));
        }
        assert_int_equal(dse_consensus_counts(&node[1])->silent, 3);
        assert_int_equal(dse_consensus_counts(&node[0])->silent, both == 1 ? 3 : 0);
    }
}

static void who_hears_nobody_keeps_what_it_has(void **state)
{
    (void)state;
    const struct links links = kite();
    dse_real u[5];
    fill(5, u);
    assert_int_equal(
        make(&links, (struct dse_consensus_config){.kind = DSE_CONSENSUS_AVERAGE, .size = 1}),
        DSE_OK);
    set_inputs(u);
    deaf[4][3] = true;
    rounds(5);
    assert_true(dse_consensus_output(&node[4])[0] == u[4]);
    assert_true(dse_consensus_output(&node[3])[0] != u[3]);
}

/* ---- broken messages ---- */

static void broken_messages_are_refused_and_counted(void **state)
{
    (void)state;
    const struct links links = ring(6);
    const dse_real u[12] = {1, 2}, good[2] = {3, 4}, nan[2] = {3, dse_sqrt(-1)};
    assert_int_equal(
        make(&links, (struct dse_consensus_config){.kind = DSE_CONSENSUS_AVERAGE, .size = 2}),
        DSE_OK);
    set_inputs(u);
    assert_int_equal(dse_consensus_receive(&node[0], 2, good, 2), DSE_EINVAL);
    assert_int_equal(dse_consensus_receive(&node[0], -1, good, 2), DSE_EINVAL);
    assert_int_equal(dse_consensus_receive(&node[0], 0, good, 1), DSE_EDIM);
    assert_int_equal(dse_consensus_receive(&node[0], 0, nan, 2), DSE_ENONFINITE);
    assert_int_equal(dse_consensus_end_round(&node[0]), DSE_OK);
    assert_true(dse_consensus_output(&node[0])[0] == 1 && dse_consensus_output(&node[0])[1] == 2);
    assert_int_equal(dse_consensus_counts(&node[0])->refused, 2);
    assert_int_equal(dse_consensus_counts(&node[0])->heard, 0);
    assert_int_equal(dse_consensus_input(&node[0], nan), DSE_ENONFINITE);
    assert_true(dse_consensus_output(&node[0])[1] == 2);
}

static void what_is_said_again_replaces_what_was_said_and_lasts_one_round(void **state)
{
    (void)state;
    const struct links links = ring(6);
    const dse_real u[6] = {0}, first = 100, second = 6;
    assert_int_equal(make(&links, (struct dse_consensus_config){.kind = DSE_CONSENSUS_AVERAGE,
                                                                .size = 1,
                                                                .epsilon = DSE_REAL(0.25)}),
                     DSE_OK);
    set_inputs(u);
    dse_consensus_receive(&node[0], 0, &first, 1);
    dse_consensus_receive(&node[0], 0, &second, 1);
    dse_consensus_end_round(&node[0]);
    assert_true(dse_consensus_output(&node[0])[0] == DSE_REAL(1.5));
    dse_consensus_end_round(&node[0]);
    assert_true(dse_consensus_output(&node[0])[0] == DSE_REAL(1.5));
}

static void a_round_that_overflows_changes_nothing(void **state)
{
    (void)state;
    const struct links links = ring(6);
    const dse_real u[6] = {DSE_REAL_MAX}, other = -DSE_REAL_MAX;
    assert_int_equal(
        make(&links, (struct dse_consensus_config){.kind = DSE_CONSENSUS_AVERAGE, .size = 1}),
        DSE_OK);
    set_inputs(u);
    dse_consensus_receive(&node[0], 0, &other, 1);
    assert_int_equal(dse_consensus_end_round(&node[0]), DSE_ENONFINITE);
    assert_true(dse_consensus_output(&node[0])[0] == DSE_REAL_MAX);
    assert_int_equal(dse_consensus_counts(&node[0])->failed, 1);
    assert_int_equal(dse_consensus_counts(&node[0])->rounds, 0);
}

/* ---- kernels ---- */

static void sums_and_differences_take_who_is_heard_from_their_place_on(void **state)
{
    (void)state;
    enum { AT = 2, STRIDE = AT + SIZE };
    dse_real said[3 * STRIDE], w[SIZE], sum[SIZE], differences[SIZE];
    const dse_real heard[3] = {1, 0, 1};
    const struct dse_consensus_words words = {3, STRIDE, said, heard};
    fill(3 * STRIDE, said);
    fill(SIZE, w);
    dse_consensus_sum(&words, AT, SIZE, w, sum);
    dse_consensus_differences(&words, AT, SIZE, w, differences);
    for (int e = 0; e < SIZE; e++) {
        const dse_real both = said[AT + e] + said[2 * STRIDE + AT + e];
        assert_near(sum[e], w[e] + both, 4 * DSE_REAL_EPSILON);
        assert_near(differences[e], both - 2 * w[e], 8 * DSE_REAL_EPSILON);
    }
    dse_consensus_sum(&words, AT, SIZE, w, w); /* in place */
    assert_all_near(SIZE, w, sum, 0);
}

static void largest_weight_is_that_of_the_matrix_power(void **state)
{
    (void)state;
    enum { FIVE = 5 };
    const struct links links = kite();
    dse_real L[FIVE * FIVE], W[FIVE * FIVE], power[FIVE * FIVE], next[FIVE * FIVE],
        scratch[2 * FIVE];
    assert_int_equal(make(&links, (struct dse_consensus_config){.size = 1}), DSE_OK);
    const dse_real eps = DSE_REAL(0.25);
    dse_graph_laplacian(&graph, L);
    dse_mat_identity(FIVE, power);
    for (int k = 0; k < FIVE * FIVE; k++)
        W[k] = power[k] - eps * L[k];
    for (int rounds_done = 0; rounds_done < 6; rounds_done++) {
        for (int i = 0; i < FIVE; i++) {
            dse_real largest = 0;
            for (int j = 0; j < FIVE; j++)
                largest = dse_max(largest, power[i * FIVE + j]);
            assert_near(dse_consensus_largest_weight(&graph, i, eps, rounds_done, scratch), largest,
                        4 * DSE_REAL_EPSILON);
        }
        dse_mat_mul(FIVE, FIVE, FIVE, power, W, next);
        for (int k = 0; k < FIVE * FIVE; k++)
            power[k] = next[k];
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(three_kinds_end_at_the_average_whatever_loops_there_are),
        cmocka_unit_test(low_pass_ends_at_its_formula_which_is_no_average_but_on_complete_graphs),
        cmocka_unit_test(low_pass_lags),
        cmocka_unit_test(average_of_a_complete_graph_takes_one_round),
        cmocka_unit_test(steps_beyond_their_bound_blow_up_and_those_below_do_not),
        cmocka_unit_test(steps_are_checked_against_the_largest_degree),
        cmocka_unit_test(other_wrong_settings_are_refused),
        cmocka_unit_test(a_link_lost_both_ways_keeps_the_sum_one_lost_in_one_direction_moves_it),
        cmocka_unit_test(who_hears_nobody_keeps_what_it_has),
        cmocka_unit_test(broken_messages_are_refused_and_counted),
        cmocka_unit_test(what_is_said_again_replaces_what_was_said_and_lasts_one_round),
        cmocka_unit_test(a_round_that_overflows_changes_nothing),
        cmocka_unit_test(sums_and_differences_take_who_is_heard_from_their_place_on),
        cmocka_unit_test(largest_weight_is_that_of_the_matrix_power),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
