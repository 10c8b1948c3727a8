/* Directed graphs of networks: who hears whom, in fixed memory.
 *
 * An edge from -> to means that node `to` hears node `from`. Lists are ascending: node i hears
 * in[in_first[i]] .. in[in_first[i + 1] - 1] and is heard by out[out_first[i]] ..
 *
 *     static dse_real memory[DSE_GRAPH_STORAGE(5, 10)];
 *     dse_arena_init(&arena, memory, DSE_GRAPH_STORAGE(5, 10));
 *     dse_graph_make(&graph, 5, 10, edges, false, &arena);
 *     for (int k = graph.in_first[i]; k < graph.in_first[i + 1]; k++)
 *         .. graph.in[k] ..
 *
 * Everything but the matrices costs nodes + edges. */
#ifndef DSE_GRAPH_H
#define DSE_GRAPH_H

#include <stdbool.h>

#include "dse/arena.h"
#include "dse/real.h"
#include "dse/status.h"

struct dse_graph {
    int nodes;
    int edges;
    const int *in_first; /* nodes + 1 */
    const int *in;       /* edges */
    const int *out_first;
    const int *out;
    /* edges, parallel to `in`: a_ij of the edge j -> i. NULL: all 1. May be set after make. */
    const dse_real *weight;
};

/* Reals that dse_graph_make takes; edges: directed ones, two for an undirected link. */
#define DSE_GRAPH_STORAGE(nodes, edges)                                                            \
    (2 * DSE_ARENA_INTS((nodes) + 1) + 2 * DSE_ARENA_INTS(edges))

/* pairs: `count` times {from, to}; undirected: each stands for both directions. DSE_EINVAL: fewer
 * than one node, an end that is no node, a node that hears itself, an edge given twice;
 * DSE_ESTORAGE. */
enum dse_status dse_graph_make(struct dse_graph *graph, int nodes, int count, const int *pairs,
                               bool undirected, struct dse_arena *arena);

int dse_graph_in_degree(const struct dse_graph *graph, int i);
int dse_graph_out_degree(const struct dse_graph *graph, int i);
int dse_graph_largest_in_degree(const struct dse_graph *graph);
/* The place of j among those that i hears, 0 .. in-degree - 1, or -1. */
int dse_graph_in_place(const struct dse_graph *graph, int i, int j);
/* The place of j among those that hear i, or -1. */
int dse_graph_out_place(const struct dse_graph *graph, int i, int j);

/* ---- matrices, nodes x nodes ---- */

/* a_ij: weight of the edge j -> i, 0 where there is none. */
void dse_graph_adjacency(const struct dse_graph *graph, dse_real *adjacency);
/* L = diag(sum_j a_ij) - (a_ij), the in-degree Laplacian: its rows sum to 0. */
void dse_graph_laplacian(const struct dse_graph *graph, dse_real *L);
/* y = L x for node values of `size` reals each (x, y: nodes x size), without the matrix:
 * y_i = sum_j a_ij (x_i - x_j). y does not overlap x. */
void dse_graph_laplacian_times(const struct dse_graph *graph, int size, const dse_real *x,
                               dse_real *y);

/* ---- properties ---- */

/* Every edge has its opposite, with the same weight. */
bool dse_graph_is_undirected(const struct dse_graph *graph);
/* In-degree = out-degree at every node, by weights to rounding. */
bool dse_graph_is_balanced(const struct dse_graph *graph);

/* What the functions below need to work in. */
#define DSE_GRAPH_SCRATCH(nodes) (2 * (nodes)) /* ints */

/* Number of nodes that hear of `root`, directly or not, itself included. */
int dse_graph_reached(const struct dse_graph *graph, int root, int *scratch);
/* A node that all others hear of, directly or not: the root of a spanning tree; the smallest of
 * those, or -1 when there is none. */
int dse_graph_root(const struct dse_graph *graph, int *scratch);
/* Every node hears of every other one. */
bool dse_graph_is_strongly_connected(const struct dse_graph *graph, int *scratch);
/* Connected when the directions are forgotten. */
bool dse_graph_is_weakly_connected(const struct dse_graph *graph, int *scratch);

#endif
