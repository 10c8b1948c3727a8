/* Consensus filters and the linear protocol on the reference graph of five vertices. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dse/math.h"
#include "parts.h"

enum { NODES = 5, EDGES = NODES * (NODES - 1), SIZE = 3, ROUNDS = 20 };

int golden_links(int n, const double *adjacency, int *pairs)
{
    int count = 0;
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < i; j++) {
            if (adjacency[i * n + j] == 0)
                continue;
            pairs[2 * count] = i;
            pairs[2 * count + 1] = j;
            count++;
        }
    }
    return count;
}

int golden_worse(int a, int b)
{
    return a == GOLDEN_PASS ? b : a;
}

/* ---- the filters of all nodes ---- */

struct filters {
    struct dse_graph graph;
    struct dse_consensus_config config[NODES];
    struct dse_consensus node[NODES];
    double memory[NODES][DSE_CONSENSUS_STORAGE(SIZE, NODES - 1)];
    double graph_memory[DSE_GRAPH_STORAGE(NODES, EDGES)];
};

static int make(struct filters *filters, const json_t *root, struct dse_consensus_config base)
{
    struct dse_arena arena;
    int count = 0, pairs[EDGES];
    double *adjacency =
        golden_numbers(json_object_get(json_object_get(root, "graph"), "adjacency"), &count);
    dse_arena_init(&arena, filters->graph_memory, DSE_GRAPH_STORAGE(NODES, EDGES));
    bool good = count == NODES * NODES;
    good = good && dse_graph_make(&filters->graph, NODES, golden_links(NODES, adjacency, pairs),
                                  pairs, true, &arena) == DSE_OK;
    free(adjacency);
    if (!good)
        return GOLDEN_FAIL;
    base.largest_degree = dse_graph_largest_in_degree(&filters->graph);
    for (int i = 0; i < NODES; i++) {
        filters->config[i] = base;
        filters->config[i].n_neighbours = dse_graph_in_degree(&filters->graph, i);
        dse_arena_init(&arena, filters->memory[i], DSE_CONSENSUS_STORAGE(SIZE, NODES - 1));
        if (dse_consensus_init(&filters->node[i], &filters->config[i], &arena) != DSE_OK)
            return GOLDEN_FAIL;
    }
    return GOLDEN_PASS;
}

static void run_round(struct filters *filters)
{
    double message[DSE_CONSENSUS_MESSAGE(SIZE)];
    for (int i = 0; i < NODES; i++) {
        const int first = filters->graph.in_first[i];
        for (int k = first; k < filters->graph.in_first[i + 1]; k++) {
            const int count = dse_consensus_message(&filters->node[filters->graph.in[k]], message);
            dse_consensus_receive(&filters->node[i], k - first, message, count);
        }
    }
    for (int i = 0; i < NODES; i++)
        dse_consensus_end_round(&filters->node[i]);
}

/* What a node shows after a round: its states one after the other, or its output. */
static void states(const struct filters *filters, int size, double *out)
{
    for (int i = 0; i < NODES; i++)
        memcpy(out + i * size, filters->node[i].state, (size_t)size * sizeof *out);
}

/* ---- kinds ---- */

static int protocol(const json_t *root)
{
    const json_t *protocol = json_object_get(root, "linear_protocol");
    struct filters filters;
    int count = 0;
    double got[(ROUNDS + 1) * NODES] = {0};
    double *z = golden_numbers(json_object_get(protocol, "z"), &count);
    int verdict = make(&filters, root,
                       (struct dse_consensus_config){.kind = DSE_CONSENSUS_AVERAGE,
                                                     .size = 1,
                                                     .epsilon = golden_number(protocol, "eps", 0)});
    for (int i = 0; verdict == GOLDEN_PASS && i < NODES; i++)
        dse_consensus_input(&filters.node[i], z + i);
    for (int k = 0; verdict == GOLDEN_PASS && k <= ROUNDS; k++) {
        states(&filters, 1, got + (size_t)k * NODES);
        run_round(&filters);
    }
    free(z);
    if (verdict != GOLDEN_PASS)
        return verdict;
    return golden_compare_as("average consensus", protocol, "euler", ROUNDS + 1, NODES, got,
                             GOLDEN_LINEAR);
}

/* States of the low- or high-pass on vectors of two from round 1 on, and the high-pass' output,
 * which the reference has after a round with the input of that round. */
static int vectors(const json_t *root, const char *name, enum dse_consensus_kind kind)
{
    enum { VECTOR = 2 };
    const json_t *pass = json_object_get(root, name);
    struct filters filters;
    int count = 0;
    double got[(ROUNDS + 1) * NODES * VECTOR] = {0}, output[ROUNDS * NODES * VECTOR] = {0};
    double *u = golden_numbers(json_object_get(pass, "u"), &count);
    int verdict = make(&filters, root,
                       (struct dse_consensus_config){
                           .kind = kind, .size = VECTOR, .epsilon = golden_number(pass, "eps", 0)});
    if (count != ROUNDS * NODES * VECTOR)
        verdict = GOLDEN_FAIL;
    for (int k = 0; verdict == GOLDEN_PASS && k < ROUNDS; k++) {
        for (int i = 0; i < NODES; i++)
            dse_consensus_input(&filters.node[i], u + (k * NODES + i) * VECTOR);
        run_round(&filters);
        states(&filters, VECTOR, got + (size_t)(k + 1) * NODES * VECTOR);
        for (int i = 0; i < NODES; i++)
            memcpy(output + (k * NODES + i) * VECTOR, dse_consensus_output(&filters.node[i]),
                   VECTOR * sizeof *output);
    }
    free(u);
    if (verdict != GOLDEN_PASS)
        return verdict;
    verdict = golden_compare_as(name, pass, "c", ROUNDS + 1, NODES * VECTOR, got, GOLDEN_LINEAR);
    if (kind != DSE_CONSENSUS_HIGH_PASS)
        return verdict;
    return golden_worse(verdict, golden_compare_as("its output", pass, "output", ROUNDS,
                                                   NODES * VECTOR, output, GOLDEN_LINEAR));
}

/* The band-pass on symmetric 2 x 2 matrices, packed here and full in the file. */
static int band_pass(const json_t *root)
{
    enum { N = 2, FULL = N * N, ALL = NODES * FULL };
    const json_t *pass = json_object_get(root, "band_pass");
    struct filters filters;
    int count = 0;
    double v[(ROUNDS + 1) * ALL] = {0}, b[(ROUNDS + 1) * ALL] = {0};
    double *U = golden_numbers(json_object_get(pass, "U"), &count);
    int verdict = make(&filters, root,
                       (struct dse_consensus_config){.kind = DSE_CONSENSUS_BAND_PASS,
                                                     .size = DSE_SYM_PACKED(N),
                                                     .epsilon = golden_number(pass, "eps", 0),
                                                     .alpha = golden_number(pass, "alpha", 0)});
    if (count != ROUNDS * ALL)
        verdict = GOLDEN_FAIL;
    for (int k = 0; verdict == GOLDEN_PASS && k < ROUNDS; k++) {
        for (int i = 0; i < NODES; i++) {
            double packed[DSE_SYM_PACKED(N)];
            dse_sym_pack(N, U + k * ALL + i * FULL, packed);
            dse_consensus_input(&filters.node[i], packed);
        }
        run_round(&filters);
        for (int i = 0; i < NODES; i++) {
            const int at = (k + 1) * ALL + i * FULL;
            dse_sym_unpack(N, filters.node[i].state, v + at);
            dse_sym_unpack(N, dse_consensus_output(&filters.node[i]), b + at);
        }
    }
    free(U);
    if (verdict != GOLDEN_PASS)
        return verdict;
    verdict = golden_compare_as("band-pass v", pass, "v", ROUNDS + 1, ALL, v, GOLDEN_LINEAR);
    return golden_worse(
        verdict, golden_compare_as("band-pass b", pass, "b", ROUNDS + 1, ALL, b, GOLDEN_LINEAR));
}

int golden_consensus_filters(const json_t *root)
{
    int verdict = protocol(root);
    verdict = golden_worse(verdict, vectors(root, "low_pass", DSE_CONSENSUS_LOW_PASS));
    verdict = golden_worse(verdict, vectors(root, "high_pass", DSE_CONSENSUS_HIGH_PASS));
    return golden_worse(verdict, band_pass(root));
}
