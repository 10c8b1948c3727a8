/* Who hears of whom: breadth-first searches in a digraph. */
#include "dse/graph.h"

enum { FORWARD = 1, BACKWARD = 2 };

/* Marks those of a list that are not marked yet and puts them into the queue. */
static int meet(int count, const int *list, int *marked, int *queue, int waiting)
{
    for (int k = 0; k < count; k++) {
        if (marked[list[k]])
            continue;
        marked[list[k]] = 1;
        queue[waiting++] = list[k];
    }
    return waiting;
}

/* Marks all that are reached from `root` along edges, against them, or both; returns how many were
 * not marked before. */
static int search(const struct dse_graph *graph, int root, int ways, int *marked, int *queue)
{
    int waiting = meet(1, &root, marked, queue, 0);
    for (int head = 0; head < waiting; head++) {
        const int i = queue[head];
        if (ways & FORWARD)
            waiting = meet(dse_graph_out_degree(graph, i), graph->out + graph->out_first[i], marked,
                           queue, waiting);
        if (ways & BACKWARD)
            waiting = meet(dse_graph_in_degree(graph, i), graph->in + graph->in_first[i], marked,
                           queue, waiting);
    }
    return waiting;
}

static int count(const struct dse_graph *graph, int root, int ways, int *scratch)
{
    for (int i = 0; i < graph->nodes; i++)
        scratch[i] = 0;
    return search(graph, root, ways, scratch, scratch + graph->nodes);
}

int dse_graph_reached(const struct dse_graph *graph, int root, int *scratch)
{
    return count(graph, root, FORWARD, scratch);
}

/* Searches are started from every node that those before did not reach. If there is a root, the
 * last node that starts one is a root: the search that reaches the first root reaches everything,
 * so no later one starts, and its start reaches a root, hence all. Roots are then all that reach
 * it. */
int dse_graph_root(const struct dse_graph *graph, int *scratch)
{
    const int n = graph->nodes;
    int candidate = 0;
    for (int i = 0; i < n; i++)
        scratch[i] = 0;
    for (int i = 0; i < n; i++)
        if (search(graph, i, FORWARD, scratch, scratch + n) > 0)
            candidate = i;
    if (count(graph, candidate, FORWARD, scratch) < n)
        return -1;
    count(graph, candidate, BACKWARD, scratch); /* marks all roots */
    for (int i = 0; i < n; i++)
        if (scratch[i])
            return i;
    return candidate;
}

bool dse_graph_is_strongly_connected(const struct dse_graph *graph, int *scratch)
{
    return count(graph, 0, FORWARD, scratch) == graph->nodes &&
           count(graph, 0, BACKWARD, scratch) == graph->nodes;
}

bool dse_graph_is_weakly_connected(const struct dse_graph *graph, int *scratch)
{
    return count(graph, 0, FORWARD | BACKWARD, scratch) == graph->nodes;
}
