/* Distributed second-order filter: what nodes say to each other.
 *
 *     B_INFORMATION   [u; Y], [psi]           C_INFORMATION   [u; Y; w]
 *     A_INFORMATION   [g of u; g of Y]        A_COVARIANCE    [g; b]
 *     B               [psi]                   C               [w]
 *     B_LITERAL       [has; m; S], [psi]      C_LITERAL       [has; m; S; w]
 *     A_LITERAL       [g; b; has; m; c] */
#include "distributed_second_order_internal.h"

#include "dse/math.h"

void dso_pack(int n, const dse_real *S, dse_real *packed)
{
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++)
            *packed++ = S[i * n + j];
}

void dso_unpack(int n, const dse_real *packed, dse_real *S)
{
    for (int i = 0; i < n; i++) {
        for (int j = 0; j <= i; j++) {
            S[i * n + j] = *packed;
            S[j * n + i] = *packed++;
        }
    }
}

int dse_dso_message_size(const struct dse_dso *node, int r)
{
    const int n = node->filter.nx, m = node->filter.ny, packed = DSE_DSO_PACKED(n);
    if (r < 0 || r >= node->rounds)
        return 0;
    if (r == 1 && dso_mixes_corrected(node))
        return n;
    switch (node->config->scheme) {
    case DSE_DSO_B_INFORMATION:
    case DSE_DSO_A_INFORMATION:
        return n + packed;
    case DSE_DSO_C_INFORMATION:
        return 2 * n + packed;
    case DSE_DSO_B:
    case DSE_DSO_C:
        return n;
    case DSE_DSO_A_COVARIANCE:
        return 2 * packed;
    case DSE_DSO_A_LITERAL:
        return 2 * packed + 3 * m;
    case DSE_DSO_B_LITERAL:
        return 2 * m + packed;
    case DSE_DSO_C_LITERAL:
        return 2 * m + packed + n;
    default:
        return 0;
    }
}

static dse_real *append(int count, const dse_real *from, dse_real *to)
{
    second_order_copy(count, from, to);
    return to + count;
}

/* g = v + input. */
static dse_real *append_sum(int count, const dse_real *v, const dse_real *input, dse_real *to)
{
    for (int k = 0; k < count; k++)
        to[k] = v[k] + input[k];
    return to + count;
}

void dso_compose(struct dse_dso *node)
{
    const struct dse_second_order *filter = &node->filter;
    const int n = filter->nx, m = filter->ny, packed = DSE_DSO_PACKED(n);
    dse_real *to = node->own;
    if (dso_mixes_corrected(node) && node->round == node->rounds - 1) {
        append(n, filter->x, to);
        return;
    }
    if (node->config->scheme == DSE_DSO_A_INFORMATION) {
        to = append_sum(n, node->v, node->u, to);
        append_sum(packed, node->v + n, node->Y, to);
        return;
    }
    if (dso_fuses_information(node)) {
        to = append(n, node->u, to);
        to = append(packed, node->Y, to);
    }
    if (dso_filters_covariance(node)) { /* Y has U = S */
        to = append_sum(packed, node->v, node->Y, to);
        to = append(packed, node->v + packed, to);
    }
    if (node->config->scheme == DSE_DSO_A_LITERAL) {
        to = append(m, filter->has, to);
        to = append(m, filter->y, to);
        append(m, node->v + 2 * packed, to);
    }
    if (dso_sums_measurements(node)) {
        to = append(m, filter->has, to);
        to = append(m, filter->y, to);
        to = append(packed, node->Y, to);
    }
    if (dso_mixes_predicted(node))
        append(n, filter->x, to);
}

int dse_dso_message(const struct dse_dso *node, dse_real *message)
{
    const int count = node->open ? dse_dso_message_size(node, node->round) : 0;
    second_order_copy(count, node->own, message);
    return count;
}

enum dse_status dse_dso_receive(struct dse_dso *node, int neighbour, const dse_real *message,
                                int count)
{
    if (neighbour < 0 || neighbour >= node->n_neighbours || !node->open)
        return DSE_EINVAL;
    const bool fits = count == dse_dso_message_size(node, node->round);
    if (!fits || !dse_all_finite(message, count)) {
        node->counts.refused++;
        node->refused = true;
        return fits ? DSE_ENONFINITE : DSE_EDIM;
    }
    second_order_copy(count, message, node->said + neighbour * node->width);
    node->heard[neighbour] = 1;
    return DSE_OK;
}
