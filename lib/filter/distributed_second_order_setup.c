/* Distributed second-order filter: what a configuration may say, and the node's memory. */
#include "distributed_second_order_internal.h"
#include "dse/math.h"

static bool at_least_zero(dse_real value)
{
    return value >= 0 && dse_is_finite(value);
}

static bool in_range(const struct dse_dso_config *config)
{
    if ((unsigned)config->scheme > DSE_DSO_C_LITERAL ||
        (unsigned)config->memory > DSE_DSO_PERSISTENT)
        return false;
    if (!at_least_zero(config->delta) || !at_least_zero(config->epsilon) ||
        !at_least_zero(config->alpha))
        return false;
    if (config->scheme == DSE_DSO_A_INFORMATION && config->nodes < 1)
        return false;
    return config->n_neighbours >= 0 && config->rounds >= 0;
}

static int rounds_of(const struct dse_dso_config *config)
{
    switch (config->scheme) {
    case DSE_DSO_ALONE:
        return 0;
    case DSE_DSO_B_INFORMATION:
    case DSE_DSO_B_LITERAL:
        return 2;
    case DSE_DSO_A_INFORMATION:
        return config->rounds > 0 ? config->rounds : 1;
    case DSE_DSO_A_COVARIANCE:
        return config->rounds > 0 && config->memory == DSE_DSO_AVERAGE ? config->rounds : 1;
    default:
        return 1;
    }
}

/* Reals of the consensus filters. */
static int filters_of(const struct dse_dso *node)
{
    const int n = node->filter.nx, packed = DSE_DSO_PACKED(n);
    switch (node->config->scheme) {
    case DSE_DSO_A_INFORMATION:
        return n + packed;
    case DSE_DSO_A_COVARIANCE:
        return 2 * packed;
    case DSE_DSO_A_LITERAL:
        return 2 * packed + node->filter.ny;
    default:
        return 0;
    }
}

static bool take_memory(struct dse_dso *node, struct dse_arena *arena)
{
    const int n = node->filter.nx;
    node->said = dse_arena_take(arena, node->n_neighbours * node->width);
    node->heard = dse_arena_take(arena, node->n_neighbours);
    node->own = dse_arena_take(arena, node->width);
    node->u = dse_arena_take(arena, n);
    node->Y = dse_arena_take(arena, DSE_DSO_PACKED(n));
    node->v = dse_arena_take(arena, filters_of(node));
    node->before = dse_arena_take(arena, n);
    node->fused = dse_arena_take(arena, node->filter.ny);
    node->scratch = dse_arena_take(arena, DSE_DSO_SCRATCH(n));
    return node->scratch != NULL; /* what comes last does not fit when anything before did not */
}

enum dse_status dse_dso_init(struct dse_dso *node, const struct dse_dso_config *config,
                             struct dse_arena *arena)
{
    if (!in_range(config))
        return DSE_EINVAL;
    *node = (struct dse_dso){
        .config = config,
        .n_neighbours = config->n_neighbours,
        .rounds = rounds_of(config),
        .epsilon = config->epsilon > 0 ? config->epsilon : DSE_REAL(0.1),
        .alpha = config->alpha > 0 ? config->alpha : 1,
        .health = DSE_HEALTH_INITIALISING,
    };
    const enum dse_status status = dse_second_order_init(&node->filter, &config->filter, arena);
    if (status != DSE_OK)
        return status;
    node->delta = DSE_REAL(dso_mixes_predicted(node) ? 0.25 : 0.1);
    if (config->delta > 0)
        node->delta = config->delta;
    for (int r = 0; r < node->rounds && r < 2; r++)
        if (dse_dso_message_size(node, r) > node->width)
            node->width = dse_dso_message_size(node, r);
    return take_memory(node, arena) ? DSE_OK : DSE_ESTORAGE;
}

enum dse_status dse_dso_set(struct dse_dso *node, dse_real t, const dse_real *x, const dse_real *S)
{
    const enum dse_status status = dse_second_order_set(&node->filter, t, x, S);
    if (status != DSE_OK)
        return status;
    for (int k = 0; k < filters_of(node); k++)
        node->v[k] = 0;
    node->open = false;
    return DSE_OK;
}
