/* One round of each consensus filter, in place, some reals at a time so that the sums over the
 * neighbours stay in registers. */
#include <stddef.h>

#include "dse/consensus.h"
#include "dse/linalg.h"
#include "dse/math.h"

enum { BLOCK = 16 };

static bool is_heard(const struct dse_consensus_words *words, int j)
{
    return words->heard == NULL || words->heard[j] != 0;
}

/* sum += sum_N (w_j - w); count <= BLOCK, w_j at real number `at` of the messages. */
static void add_differences(const struct dse_consensus_words *words, int at, int count,
                            const dse_real *w, dse_real *restrict sum)
{
    for (int j = 0; j < words->count; j++) {
        if (!is_heard(words, j))
            continue;
        const dse_real *said = words->said + j * words->stride + at;
        for (int e = 0; e < count; e++)
            sum[e] += said[e] - w[e];
    }
}

static int block_size(int first, int size)
{
    return size - first < BLOCK ? size - first : BLOCK;
}

void dse_consensus_differences(const struct dse_consensus_words *words, int at, int size,
                               const dse_real *w, dse_real *s)
{
    for (int k = 0; k < size; k += BLOCK) {
        dse_real sum[BLOCK] = {0};
        const int count = block_size(k, size);
        add_differences(words, at + k, count, w + k, sum);
        for (int e = 0; e < count; e++)
            s[k + e] = sum[e];
    }
}

void dse_consensus_sum(const struct dse_consensus_words *words, int at, int size, const dse_real *w,
                       dse_real *s)
{
    static const dse_real zero[BLOCK] = {0};
    for (int k = 0; k < size; k += BLOCK) {
        dse_real sum[BLOCK] = {0};
        const int count = block_size(k, size);
        for (int e = 0; e < count; e++)
            sum[e] = w[k + e];
        add_differences(words, at + k, count, zero, sum);
        for (int e = 0; e < count; e++)
            s[k + e] = sum[e];
    }
}

void dse_consensus_average(const struct dse_consensus_words *words, int at, int size, dse_real eps,
                           dse_real *x)
{
    for (int k = 0; k < size; k += BLOCK) {
        dse_real sum[BLOCK] = {0};
        const int count = block_size(k, size);
        add_differences(words, at + k, count, x + k, sum);
        for (int e = 0; e < count; e++)
            x[k + e] += eps * sum[e];
    }
}

void dse_consensus_high_pass(const struct dse_consensus_words *words, int at, int size,
                             dse_real eps, const dse_real *u, dse_real *v)
{
    for (int k = 0; k < size; k += BLOCK) {
        dse_real g[BLOCK], sum[BLOCK] = {0};
        const int count = block_size(k, size);
        for (int e = 0; e < count; e++)
            g[e] = v[k + e] + u[k + e];
        add_differences(words, at + k, count, g, sum);
        for (int e = 0; e < count; e++)
            v[k + e] += eps * sum[e];
    }
}

void dse_consensus_low_pass(const struct dse_consensus_words *words, int at_c, int at_u, int size,
                            dse_real eps, const dse_real *u, dse_real *c)
{
    for (int k = 0; k < size; k += BLOCK) {
        dse_real sum[BLOCK] = {0};
        const int count = block_size(k, size);
        add_differences(words, at_c + k, count, c + k, sum);
        add_differences(words, at_u + k, count, c + k, sum);
        for (int e = 0; e < count; e++)
            c[k + e] += eps * (sum[e] + (u[k + e] - c[k + e])); /* u - c: the own input */
    }
}

void dse_consensus_band_pass(const struct dse_consensus_words *words, int at_g, int at_b, int size,
                             dse_real eps, dse_real alpha, const dse_real *u, dse_real *v,
                             dse_real *b)
{
    for (int k = 0; k < size; k += BLOCK) {
        dse_real g[BLOCK];
        const int count = block_size(k, size);
        for (int e = 0; e < count; e++)
            g[e] = v[k + e] + u[k + e]; /* before the round */
        dse_consensus_high_pass(words, at_g + k, count, eps, u + k, v + k);
        dse_consensus_low_pass(words, at_b + k, at_g + k, count, eps * alpha, g, b + k);
    }
}

dse_real dse_consensus_largest_step(enum dse_consensus_kind kind, int degree)
{
    const bool low = kind == DSE_CONSENSUS_LOW_PASS || kind == DSE_CONSENSUS_BAND_PASS;
    if (low)
        return DSE_REAL(1.0) / (dse_real)(1 + 2 * degree);
    return DSE_REAL(1.0) / (dse_real)(degree > 0 ? degree : 1);
}

/* Row i of W^r, W = I - eps L = W', by W applied to unit vector i. */
dse_real dse_consensus_largest_weight(const struct dse_graph *graph, int i, dse_real eps,
                                      int rounds, dse_real *scratch)
{
    dse_real *w = scratch, *Lw = scratch + graph->nodes;
    for (int j = 0; j < graph->nodes; j++)
        w[j] = (dse_real)(j == i);
    for (int r = 0; r < rounds; r++) {
        dse_graph_laplacian_times(graph, 1, w, Lw);
        dse_axpy(graph->nodes, -eps, Lw, w);
    }
    dse_real largest = w[0];
    for (int j = 1; j < graph->nodes; j++)
        largest = dse_max(largest, w[j]);
    return largest;
}
