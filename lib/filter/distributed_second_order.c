/* Distributed second-order filter: a sample's passage through a node, and what can be read of it.
 */
#include "dse/distributed_second_order.h"

#include "distributed_second_order_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"

static void forget_messages(struct dse_dso *node)
{
    for (int j = 0; j < node->n_neighbours; j++)
        node->heard[j] = 0;
}

static enum dse_status end_sample(struct dse_dso *node, enum dse_status status)
{
    node->open = false;
    if (status != DSE_OK) {
        node->counts.failed++;
        node->health = DSE_HEALTH_DIVERGED;
        return status;
    }
    const struct dse_second_order *filter = &node->filter;
    node->counts.samples++;
    node->informed = node->informed || node->any_heard || filter->used > 0;
    if (!node->informed)
        node->health = DSE_HEALTH_INITIALISING;
    else if (filter->used == 0)
        node->health = DSE_HEALTH_COASTING;
    else if (node->refused || filter->rejected)
        node->health = DSE_HEALTH_REJECTING;
    else if (node->n_neighbours > 0 && node->rounds > 0 && !node->any_heard)
        node->health = DSE_HEALTH_ALONE;
    else
        node->health = DSE_HEALTH_TRACKING;
    return DSE_OK;
}

/* What the consensus filters have to start from, and their input U. */
static void start_filters(struct dse_dso *node)
{
    const int n = node->filter.nx, packed = DSE_DSO_PACKED(n);
    if (dso_filters_covariance(node) || dso_sums_measurements(node))
        dso_pack(n, node->filter.S, node->Y);
    const enum dse_dso_memory memory = node->config->memory;
    if (node->config->scheme == DSE_DSO_A_INFORMATION && memory != DSE_DSO_PERSISTENT)
        for (int k = 0; k < n + packed; k++)
            node->v[k] = 0;
    if (node->config->scheme != DSE_DSO_A_COVARIANCE || memory == DSE_DSO_PERSISTENT)
        return;
    const bool average = memory == DSE_DSO_AVERAGE;
    for (int k = 0; k < packed; k++) {
        node->v[k] = 0;
        node->v[packed + k] = average ? node->Y[k] : 0;
    }
}

enum dse_status dse_dso_begin(struct dse_dso *node, dse_real t, const dse_real *u,
                              const struct dse_measurement *measurement)
{
    struct dse_second_order *filter = &node->filter;
    const enum dse_dso_scheme scheme = node->config->scheme;
    node->round = 0;
    node->any_heard = false;
    node->refused = false;
    enum dse_status status = dse_second_order_predict(filter, t, u);
    if (status != DSE_OK)
        return end_sample(node, status);
    second_order_take(filter, measurement);
    if (dso_fuses_information(node)) {
        second_order_information(filter, node->u, node->scratch);
        dso_pack(filter->nx, node->scratch, node->Y);
    }
    if (scheme == DSE_DSO_B || scheme == DSE_DSO_ALONE)
        status = dso_correct(node);
    if (status != DSE_OK || node->rounds == 0)
        return end_sample(node, status);
    start_filters(node);
    dso_compose(node);
    forget_messages(node);
    node->open = true;
    return DSE_OK;
}

/* ---- consensus on estimates ---- */

/* sum_N (x_j - x_i), x_j and the own x_i at `offset` of the messages. */
static void sum_of_differences(const struct dse_dso *node, int offset, dse_real *sum)
{
    const int n = node->filter.nx;
    for (int i = 0; i < n; i++)
        sum[i] = 0;
    for (int j = 0; j < node->n_neighbours; j++) {
        const dse_real *x_j = node->said + j * node->width + offset;
        for (int i = 0; i < n && node->heard[j] != 0; i++)
            sum[i] += x_j[i] - node->own[offset + i];
    }
}

/* xh_i = psi_i + delta sum_N (psi_j - psi_i)                                           (4.62) */
static enum dse_status mix_corrected(struct dse_dso *node)
{
    const int n = node->filter.nx;
    dse_real *x = node->scratch;
    sum_of_differences(node, 0, x);
    for (int i = 0; i < n; i++)
        x[i] = node->filter.x[i] + node->delta * x[i];
    if (!dse_all_finite(x, n)) {
        second_order_exchange(&node->filter); /* back to the prediction */
        return DSE_ENONFINITE;
    }
    second_order_copy(n, x, node->filter.x);
    return DSE_OK;
}

static dse_real consensus_gain(const struct dse_dso *node)
{
    const int n = node->filter.nx;
    if (!node->config->normalised)
        return node->delta;
    return node->delta / (1 + dse_norm2(n * n, node->filter.S));
}

/* xh_i = (its correction) + delta S_i sum_N (w_j - w_i)                                (4.63) */
static enum dse_status correct_and_mix(struct dse_dso *node)
{
    struct dse_second_order *filter = &node->filter;
    const int n = filter->nx, offset = dse_dso_message_size(node, node->round) - n;
    const dse_real gain = consensus_gain(node);
    sum_of_differences(node, offset, node->scratch);
    dso_weigh(node, node->scratch, node->before, node->scratch + n);
    const enum dse_status status = dso_correct(node);
    if (status != DSE_OK)
        return status;
    dse_axpy(n, gain, node->before, filter->x);
    if (dse_all_finite(filter->x, n))
        return DSE_OK;
    second_order_exchange(filter); /* back to the prediction */
    return DSE_ENONFINITE;
}

static void count_messages(struct dse_dso *node)
{
    for (int j = 0; j < node->n_neighbours; j++) {
        const bool heard = node->heard[j] != 0;
        node->counts.heard += heard;
        node->counts.silent += !heard;
        node->any_heard = node->any_heard || heard;
    }
}

static enum dse_status work(struct dse_dso *node)
{
    const bool last = node->round == node->rounds - 1;
    if (dso_mixes_predicted(node))
        return correct_and_mix(node);
    if (dso_mixes_corrected(node))
        return last ? mix_corrected(node) : dso_correct(node);
    dso_step_filters(node);
    return last ? dso_correct(node) : DSE_OK;
}

enum dse_status dse_dso_end_round(struct dse_dso *node)
{
    if (!node->open)
        return DSE_EINVAL;
    count_messages(node);
    const enum dse_status status = work(node);
    node->round++;
    if (status != DSE_OK || node->round == node->rounds)
        return end_sample(node, status);
    dso_compose(node);
    forget_messages(node);
    return DSE_OK;
}

/* ---- reading ---- */

int dse_dso_rounds(const struct dse_dso *node)
{
    return node->rounds;
}

const dse_real *dse_dso_state(const struct dse_dso *node)
{
    return node->filter.x;
}

const dse_real *dse_dso_covariance(const struct dse_dso *node)
{
    return node->filter.S;
}

const dse_real *dse_dso_innovation(const struct dse_dso *node)
{
    return node->filter.innovation;
}

dse_real dse_dso_time(const struct dse_dso *node)
{
    return node->filter.time;
}

dse_real dse_dso_loop_gain(const struct dse_dso *node)
{
    const int n = node->filter.nx;
    const dse_real neighbours = (dse_real)node->n_neighbours;
    if (dso_mixes_predicted(node))
        return 2 * consensus_gain(node) * neighbours * dse_norm2(n * n, node->filter.S);
    return dso_mixes_corrected(node) ? node->delta * neighbours : 0;
}

enum dse_health dse_dso_health(const struct dse_dso *node)
{
    return node->health;
}

const struct dse_dso_counts *dse_dso_counts(const struct dse_dso *node)
{
    return &node->counts;
}
