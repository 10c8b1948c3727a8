/* What the parts of the distributed second-order filter share. */
#ifndef DSE_DISTRIBUTED_SECOND_ORDER_INTERNAL_H
#define DSE_DISTRIBUTED_SECOND_ORDER_INTERNAL_H

#include <stddef.h>

#include "dse/distributed_second_order.h"
#include "second_order_internal.h"

/* Schemes by what they do in a sample. */
static inline bool dso_fuses_information(const struct dse_dso *node)
{
    const enum dse_dso_scheme scheme = node->config->scheme;
    return scheme == DSE_DSO_B_INFORMATION || scheme == DSE_DSO_C_INFORMATION ||
           scheme == DSE_DSO_A_INFORMATION;
}

static inline bool dso_filters_covariance(const struct dse_dso *node)
{
    return node->config->scheme == DSE_DSO_A_COVARIANCE ||
           node->config->scheme == DSE_DSO_A_LITERAL;
}

/* psi first, then consensus on it. */
static inline bool dso_mixes_corrected(const struct dse_dso *node)
{
    const enum dse_dso_scheme scheme = node->config->scheme;
    return scheme == DSE_DSO_B_INFORMATION || scheme == DSE_DSO_B || scheme == DSE_DSO_B_LITERAL;
}

/* Consensus on the predictions, in the correction. */
static inline bool dso_mixes_predicted(const struct dse_dso *node)
{
    const enum dse_dso_scheme scheme = node->config->scheme;
    return scheme == DSE_DSO_C_INFORMATION || scheme == DSE_DSO_C || scheme == DSE_DSO_C_LITERAL;
}

static inline bool dso_sums_measurements(const struct dse_dso *node)
{
    return node->config->scheme == DSE_DSO_B_LITERAL || node->config->scheme == DSE_DSO_C_LITERAL;
}

/* The lower triangle of S (n x n) by rows, and back. */
void dso_pack(int n, const dse_real *S, dse_real *packed);
void dso_unpack(int n, const dse_real *packed, dse_real *S);

/* Fills node->own with this node's message of the present round. */
void dso_compose(struct dse_dso *node);

/* One Euler step of the consensus filters v with what was heard. */
void dso_step_filters(struct dse_dso *node);

/* y = S x with the covariance S in front of the consensus on predictions: S_i, or the sum of the
 * neighbourhood's as the source's box of C-I has it. scratch: packed and nx squares. */
void dso_weigh(const struct dse_dso *node, const dse_real *x, dse_real *y, dse_real *scratch);

/* The estimate and covariance from what was fused: x_next, Z_next of the filter, exchanged. */
enum dse_status dso_correct(struct dse_dso *node);

#endif
