/* The graph of a network: checked, and turned into the lists of who hears whom. */
#include <stdlib.h>
#include <string.h>

#include "methods/method.h"
#include "runtime/scenario_internal.h"

/* A graph and the room of its lists in one piece. */
struct graph {
    struct method_graph graph;
    int index[];
};

/* networks[].graph while it is read; linked[from * nodes + to]. */
struct place {
    struct scenario_tree *tree;
    const struct scenario_graph *section;
    struct error *error;
    bool *linked;
    const char *path; /* networks[i].graph */
};

/* About edges[k], or about all of them when k < 0. */
static bool fail(const struct place *p, int k, const char *format, int a, int b)
    __attribute__((format(printf, 3, 0)));

static bool fail(const struct place *p, int k, const char *format, int a, int b)
{
    char path[SCENARIO_PATH_SIZE], message[160], entry[16] = "";
    if (k >= 0)
        snprintf(entry, sizeof entry, "[%d]", k);
    snprintf(path, sizeof path, "%s.edges%s", p->path, entry);
    snprintf(message, sizeof message, format, a, b);
    return scenario_fail(p->tree, scenario_tree_find(p->tree, path), path, p->error, "%s", message);
}

/* The edge edges[k] -> edges[k + 1]. */
static bool add_edge(const struct place *p, int k)
{
    const int nodes = (int)p->section->nodes;
    for (int end = k; end < k + 2; end++)
        if (p->section->edges[end] >= p->section->nodes)
            return fail(p, end, "there is no node %d: nodes are 0 to %d",
                        (int)p->section->edges[end], nodes - 1);
    const int from = (int)p->section->edges[k], to = (int)p->section->edges[k + 1];
    if (from == to)
        return fail(p, k, "the edge %d, %d leads from a node to itself", from, to);
    if (p->linked[from * nodes + to])
        return fail(p, k, "the edge %d, %d is given twice", from, to);
    p->linked[from * nodes + to] = true;
    if (p->section->undirected)
        p->linked[to * nodes + from] = true;
    return true;
}

static bool add_edges(const struct place *p)
{
    const int count = (int)p->section->edges_count;
    if (count % 2 != 0)
        return fail(p, -1, "has %d entries; it must have pairs: from, to, from, to, ..", count, 0);
    for (int k = 0; k < count; k += 2)
        if (!add_edge(p, k))
            return false;
    return true;
}

/* Row i of the lists: all j whose linked[i * by_node + j * by_other] is set, ascending. */
static int *fill_lists(const bool *linked, int nodes, int by_node, int by_other, int *first,
                       int *list)
{
    int n = 0;
    for (int i = 0; i < nodes; i++) {
        first[i] = n;
        for (int j = 0; j < nodes; j++)
            if (linked[i * by_node + j * by_other])
                list[n++] = j;
    }
    first[nodes] = n;
    return list + n;
}

static struct method_graph *make_lists(const bool *linked, int nodes)
{
    int links = 0;
    for (int k = 0; k < nodes * nodes; k++)
        links += linked[k];
    struct graph *made =
        malloc(sizeof *made + 2 * (size_t)(nodes + 1 + links) * sizeof *made->index);
    if (made == NULL)
        return NULL;
    int *in_first = made->index, *in = in_first + nodes + 1;
    int *out_first = fill_lists(linked, nodes, 1, nodes, in_first, in);
    int *out = out_first + nodes + 1;
    fill_lists(linked, nodes, nodes, 1, out_first, out);
    made->graph = (struct method_graph){
        .nodes = nodes, .in_first = in_first, .in = in, .out_first = out_first, .out = out};
    return &made->graph;
}

bool scenario_graph_make(struct scenario_tree *tree, const char *path,
                         struct scenario_network *network, struct error *error)
{
    if (network->graph == NULL)
        return true;
    const size_t nodes = network->graph->nodes;
    struct place place = {.tree = tree,
                          .section = network->graph,
                          .error = error,
                          .linked = calloc(nodes * nodes, sizeof *place.linked),
                          .path = path};
    bool good = place.linked != NULL && add_edges(&place);
    if (good)
        network->neighbours = make_lists(place.linked, (int)nodes);
    const bool memory = place.linked != NULL && (!good || network->neighbours != NULL);
    free(place.linked);
    return memory ? good : error_set(error, "%s: out of memory", tree->file);
}

void scenario_graph_free(struct method_graph *graph)
{
    free(graph);
}
