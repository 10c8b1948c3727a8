/* Digraphs as ascending lists of neighbours. */
#include "dse/graph.h"

#include <stddef.h>

struct lists {
    int *in_first, *in, *out_first, *out;
};

static int *take_ints(struct dse_arena *arena, int count)
{
    return (int *)(void *)dse_arena_take(arena, DSE_ARENA_INTS(count));
}

/* first[i]: where list i begins, from how many entries each has in first[i + 1]. */
static void accumulate(int nodes, int *first)
{
    for (int i = 0; i < nodes; i++)
        first[i + 1] += first[i];
}

/* Lists `to`, whose counts are accumulated, from the lists `from` of the other direction: visited
 * in ascending order of their owners, so that the new lists are ascending. first[i] serves as the
 * place of the next entry of list i, and is put back afterwards. */
static void transpose(int nodes, const int *from_first, const int *from, int *first, int *list)
{
    for (int i = 0; i < nodes; i++)
        for (int k = from_first[i]; k < from_first[i + 1]; k++)
            list[first[from[k]]++] = i;
    for (int i = nodes; i > 0; i--)
        first[i] = first[i - 1];
    first[0] = 0;
}

static bool good_ends(int nodes, int count, const int *pairs)
{
    for (int k = 0; k < count; k++)
        if (pairs[2 * k] < 0 || pairs[2 * k] >= nodes || pairs[2 * k + 1] < 0 ||
            pairs[2 * k + 1] >= nodes || pairs[2 * k] == pairs[2 * k + 1])
            return false;
    return true;
}

static void fill(struct lists *lists, int nodes, int count, const int *pairs, bool undirected)
{
    for (int k = 0; k < count; k++) {
        for (int way = 0; way <= undirected; way++) {
            lists->out_first[pairs[2 * k + way] + 1]++;
            lists->in_first[pairs[2 * k + 1 - way] + 1]++;
        }
    }
    accumulate(nodes, lists->out_first);
    accumulate(nodes, lists->in_first);
    int *out_first = lists->out_first;
    for (int k = 0; k < count; k++) /* any order at first */
        for (int way = 0; way <= undirected; way++)
            lists->out[out_first[pairs[2 * k + way]]++] = pairs[2 * k + 1 - way];
    for (int i = nodes; i > 0; i--)
        out_first[i] = out_first[i - 1];
    out_first[0] = 0;
    transpose(nodes, out_first, lists->out, lists->in_first, lists->in);
    transpose(nodes, lists->in_first, lists->in, out_first, lists->out);
}

static bool has_twice(const struct lists *lists, int nodes)
{
    for (int i = 0; i < nodes; i++)
        for (int k = lists->in_first[i] + 1; k < lists->in_first[i + 1]; k++)
            if (lists->in[k] == lists->in[k - 1])
                return true;
    return false;
}

enum dse_status dse_graph_make(struct dse_graph *graph, int nodes, int count, const int *pairs,
                               bool undirected, struct dse_arena *arena)
{
    const int edges = undirected ? 2 * count : count;
    if (nodes < 1 || count < 0 || !good_ends(nodes, count, pairs))
        return DSE_EINVAL;
    struct lists lists;
    lists.in_first = take_ints(arena, nodes + 1);
    lists.out_first = take_ints(arena, nodes + 1);
    lists.in = take_ints(arena, edges);
    lists.out = take_ints(arena, edges);
    if (lists.in_first == NULL || lists.out_first == NULL || lists.in == NULL || lists.out == NULL)
        return DSE_ESTORAGE;
    fill(&lists, nodes, count, pairs, undirected);
    if (has_twice(&lists, nodes))
        return DSE_EINVAL;
    *graph = (struct dse_graph){.nodes = nodes,
                                .edges = edges,
                                .in_first = lists.in_first,
                                .in = lists.in,
                                .out_first = lists.out_first,
                                .out = lists.out};
    return DSE_OK;
}

int dse_graph_in_degree(const struct dse_graph *graph, int i)
{
    return graph->in_first[i + 1] - graph->in_first[i];
}

int dse_graph_out_degree(const struct dse_graph *graph, int i)
{
    return graph->out_first[i + 1] - graph->out_first[i];
}

int dse_graph_largest_in_degree(const struct dse_graph *graph)
{
    int largest = 0;
    for (int i = 0; i < graph->nodes; i++)
        if (dse_graph_in_degree(graph, i) > largest)
            largest = dse_graph_in_degree(graph, i);
    return largest;
}

/* Bisection in an ascending list of n. */
static int place(int n, const int *list, int j)
{
    int low = 0, high = n;
    while (low < high) {
        const int middle = low + (high - low) / 2;
        if (list[middle] < j)
            low = middle + 1;
        else
            high = middle;
    }
    return low < n && list[low] == j ? low : -1;
}

int dse_graph_in_place(const struct dse_graph *graph, int i, int j)
{
    return place(dse_graph_in_degree(graph, i), graph->in + graph->in_first[i], j);
}

int dse_graph_out_place(const struct dse_graph *graph, int i, int j)
{
    return place(dse_graph_out_degree(graph, i), graph->out + graph->out_first[i], j);
}
