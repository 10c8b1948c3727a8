/* Adjacency and Laplacian of a digraph, and what their entries say of it. */
#include "dse/graph.h"
#include "dse/math.h"

static dse_real weight(const struct dse_graph *graph, int k)
{
    return graph->weight ? graph->weight[k] : 1;
}

void dse_graph_adjacency(const struct dse_graph *graph, dse_real *adjacency)
{
    const int n = graph->nodes;
    for (int k = 0; k < n * n; k++)
        adjacency[k] = 0;
    for (int i = 0; i < n; i++)
        for (int k = graph->in_first[i]; k < graph->in_first[i + 1]; k++)
            adjacency[i * n + graph->in[k]] = weight(graph, k);
}

void dse_graph_laplacian(const struct dse_graph *graph, dse_real *L)
{
    const int n = graph->nodes;
    for (int k = 0; k < n * n; k++)
        L[k] = 0;
    for (int i = 0; i < n; i++) {
        for (int k = graph->in_first[i]; k < graph->in_first[i + 1]; k++) {
            L[i * n + graph->in[k]] = -weight(graph, k);
            L[i * n + i] += weight(graph, k);
        }
    }
}

void dse_graph_laplacian_times(const struct dse_graph *graph, int size, const dse_real *x,
                               dse_real *y)
{
    for (int i = 0; i < graph->nodes; i++) {
        const dse_real *own = x + i * size;
        dse_real *sum = y + i * size;
        for (int c = 0; c < size; c++)
            sum[c] = 0;
        for (int k = graph->in_first[i]; k < graph->in_first[i + 1]; k++) {
            const dse_real *other = x + graph->in[k] * size;
            for (int c = 0; c < size; c++)
                sum[c] += weight(graph, k) * (own[c] - other[c]);
        }
    }
}

bool dse_graph_is_undirected(const struct dse_graph *graph)
{
    for (int i = 0; i < graph->nodes; i++) {
        for (int k = graph->in_first[i]; k < graph->in_first[i + 1]; k++) {
            const int j = graph->in[k], back = dse_graph_in_place(graph, j, i);
            if (back < 0 || weight(graph, graph->in_first[j] + back) != weight(graph, k))
                return false;
        }
    }
    return true;
}

bool dse_graph_is_balanced(const struct dse_graph *graph)
{
    for (int i = 0; i < graph->nodes; i++) {
        dse_real difference = 0, size = 0;
        for (int k = graph->in_first[i]; k < graph->in_first[i + 1]; k++) {
            difference += weight(graph, k);
            size += dse_abs(weight(graph, k));
        }
        for (int k = graph->out_first[i]; k < graph->out_first[i + 1]; k++) {
            const int j = graph->out[k];
            const dse_real w = weight(graph, graph->in_first[j] + dse_graph_in_place(graph, j, i));
            difference -= w;
            size += dse_abs(w);
        }
        if (dse_abs(difference) > DSE_REAL_EPSILON * (dse_real)graph->nodes * size)
            return false;
    }
    return true;
}
