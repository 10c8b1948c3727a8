/* Distributed second-order filter: consensus filters, and the correction with what was fused. */
#include "distributed_second_order_internal.h"

#include "dse/linalg.h"
#include "dse/math.h"

static const dse_real *said_by(const struct dse_dso *node, int j)
{
    return node->said + j * node->width;
}

/* v += eps sum_N (g_j - g_i): messages begin with g.                        (high-pass filter) */
static void step_high_pass(struct dse_dso *node, int count)
{
    for (int j = 0; j < node->n_neighbours; j++) {
        if (node->heard[j] == 0)
            continue;
        const dse_real *g = said_by(node, j);
        for (int k = 0; k < count; k++)
            node->v[k] += node->epsilon * (g[k] - node->own[k]);
    }
}

/* b += eps alpha (sum_N (b_j - b_i) + sum_J (g_j - b_i))                            (4.48) */
static void step_band_pass(struct dse_dso *node, int count)
{
    const dse_real rate = node->epsilon * node->alpha;
    dse_real *b = node->v + count;
    const dse_real *g_own = node->own, *b_own = node->own + count; /* before this step */
    for (int k = 0; k < count; k++)
        b[k] += rate * (g_own[k] - b_own[k]);
    for (int j = 0; j < node->n_neighbours; j++) {
        if (node->heard[j] == 0)
            continue;
        const dse_real *g = said_by(node, j), *b_j = g + count;
        for (int k = 0; k < count; k++)
            b[k] += rate * (b_j[k] - b_own[k] + g[k] - b_own[k]);
    }
}

/* c += eps (sum_N (c_j - c_i) + sum_J (m_j - c_i)), without the measurements that are missing. */
static void step_low_pass(struct dse_dso *node, int offset)
{
    const int m = node->filter.ny;
    const dse_real *has_own = node->own + offset, *y_own = has_own + m, *c_own = y_own + m;
    dse_real *c = node->v + offset;
    for (int l = 0; l < m; l++)
        c[l] += node->epsilon * (has_own[l] > 0 ? y_own[l] - c_own[l] : 0);
    for (int j = 0; j < node->n_neighbours; j++) {
        if (node->heard[j] == 0)
            continue;
        const dse_real *has = said_by(node, j) + offset, *y = has + m, *c_j = y + m;
        for (int l = 0; l < m; l++)
            c[l] += node->epsilon * (c_j[l] - c_own[l] + (has[l] > 0 ? y[l] - c_own[l] : 0));
    }
}

void dso_step_filters(struct dse_dso *node)
{
    const int n = node->filter.nx, packed = DSE_DSO_PACKED(n);
    if (node->config->scheme == DSE_DSO_A_INFORMATION)
        step_high_pass(node, n + packed);
    if (dso_filters_covariance(node)) {
        step_high_pass(node, packed);
        step_band_pass(node, packed);
    }
    if (node->config->scheme == DSE_DSO_A_LITERAL)
        step_low_pass(node, 2 * packed);
}

/* ---- correction ---- */

/* to = own + the sum over the neighbours that were heard, `count` reals from `offset` on. */
static void sum_inclusive(const struct dse_dso *node, int offset, int count, dse_real *to)
{
    second_order_copy(count, node->own + offset, to);
    for (int j = 0; j < node->n_neighbours; j++)
        if (node->heard[j] != 0)
            dse_axpy(count, 1, said_by(node, j) + offset, to);
}

void dso_weigh(const struct dse_dso *node, const dse_real *x, dse_real *y, dse_real *scratch)
{
    const int n = node->filter.nx, m = node->filter.ny, packed = DSE_DSO_PACKED(n);
    if (!dso_sums_measurements(node)) {
        dse_mat_vec(n, n, node->filter.S, x, y);
        return;
    }
    dse_real *S = scratch + packed;
    sum_inclusive(node, 2 * m, packed, scratch);
    dso_unpack(n, scratch, S);
    dse_mat_vec(n, n, S, x, y);
}

/* The own one is used in place of fused numbers that are not positive. */
static void fall_back(struct dse_dso *node)
{
    node->counts.fallback++;
    node->refused = true;
}

/* With u, Y of the neighbourhood, or nodes times the network's averages. */
static enum dse_status correct_by_information(struct dse_dso *node)
{
    struct dse_second_order *filter = &node->filter;
    const int n = filter->nx, packed = DSE_DSO_PACKED(n);
    dse_real *u = node->scratch, *Y = u + n + packed; /* u has packed Y behind it */
    if (node->config->scheme == DSE_DSO_A_INFORMATION) {
        for (int k = 0; k < n + packed; k++)
            u[k] = (dse_real)node->config->nodes *
                   (node->v[k] + (k < n ? node->u[k] : node->Y[k - n]));
    } else {
        sum_inclusive(node, 0, n + packed, u);
    }
    dso_unpack(n, u + n, Y);
    enum dse_status status = second_order_inform(filter, u, Y);
    if (status != DSE_OK) {
        fall_back(node);
        dso_unpack(n, node->Y, Y);
        status = second_order_inform(filter, node->u, Y);
    }
    return status;
}

/* With a gain of fused covariances S (packed) instead of the own one. */
static enum dse_status correct_by_covariance(struct dse_dso *node, const dse_real *packed,
                                             const dse_real *y)
{
    struct dse_second_order *filter = &node->filter;
    const int n = filter->nx;
    dse_real *S = node->scratch + DSE_DSO_PACKED(n) + n, *Z = S + n * n, *d = Z + n * n;
    dso_unpack(n, packed, S);
    if (second_order_root(n, S, Z, d) == DSE_OK)
        return second_order_correct(filter, Z, y);
    fall_back(node);
    return second_order_correct(filter, filter->Z, filter->y);
}

/* S = b + U, or b where b began as U. */
static enum dse_status correct_by_filters(struct dse_dso *node)
{
    const int m = node->filter.ny, packed = DSE_DSO_PACKED(node->filter.nx);
    const struct dse_dso_config *config = node->config;
    const dse_real *b = node->v + packed, *c = b + packed;
    const bool literal = config->scheme == DSE_DSO_A_LITERAL;
    const bool added = literal || config->memory != DSE_DSO_AVERAGE;
    dse_real *S = node->scratch, *y = node->fused;
    for (int k = 0; k < packed; k++)
        S[k] = b[k] + (added ? node->Y[k] : 0);
    for (int l = 0; l < m; l++)
        y[l] = node->filter.y[l] + (literal ? c[l] : 0);
    return correct_by_covariance(node, S, y);
}

/* y = sum_J m_j of those who have one, S = sum_J S_j. */
static enum dse_status correct_by_sums(struct dse_dso *node)
{
    const int m = node->filter.ny;
    dse_real *S = node->scratch, *y = node->fused;
    sum_inclusive(node, 2 * m, DSE_DSO_PACKED(node->filter.nx), S);
    second_order_copy(m, node->filter.y, y); /* 0 where there is none */
    for (int j = 0; j < node->n_neighbours; j++)
        for (int l = 0; l < m && node->heard[j] != 0; l++)
            y[l] += said_by(node, j)[l] > 0 ? said_by(node, j)[m + l] : 0;
    return correct_by_covariance(node, S, y);
}

enum dse_status dso_correct(struct dse_dso *node)
{
    struct dse_second_order *filter = &node->filter;
    enum dse_status status;
    if (dso_fuses_information(node))
        status = correct_by_information(node);
    else if (dso_filters_covariance(node))
        status = correct_by_filters(node);
    else if (dso_sums_measurements(node))
        status = correct_by_sums(node);
    else
        status = second_order_correct(filter, filter->Z, filter->y);
    if (status == DSE_OK)
        second_order_exchange(filter);
    return status;
}
