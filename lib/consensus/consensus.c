/* Consensus filters with their memory: configuration, messages, rounds. */
#include "dse/consensus.h"

#include <stddef.h>

#include "dse/math.h"

static bool has_low_pass(enum dse_consensus_kind kind)
{
    return kind == DSE_CONSENSUS_LOW_PASS || kind == DSE_CONSENSUS_BAND_PASS;
}

/* v and b, else one state. */
static int state_size(const struct dse_consensus_config *config)
{
    return config->kind == DSE_CONSENSUS_BAND_PASS ? 2 * config->size : config->size;
}

static int network_degree(const struct dse_consensus_config *config)
{
    return config->largest_degree > 0 ? config->largest_degree : config->n_neighbours;
}

static enum dse_status check(const struct dse_consensus_config *config)
{
    if ((unsigned)config->kind > DSE_CONSENSUS_BAND_PASS || config->size < 1)
        return DSE_EINVAL;
    if (config->n_neighbours < 0 || network_degree(config) < config->n_neighbours)
        return DSE_EINVAL;
    const bool finite = dse_is_finite(config->epsilon) && dse_is_finite(config->alpha);
    return finite && config->epsilon >= 0 && config->alpha >= 0 ? DSE_OK : DSE_EINVAL;
}

/* Steps with their defaults; DSE_EINVAL beyond their bounds. */
static enum dse_status set_steps(struct dse_consensus *filter)
{
    const struct dse_consensus_config *config = filter->config;
    const int degree = network_degree(config);
    const dse_real low = dse_consensus_largest_step(DSE_CONSENSUS_LOW_PASS, degree);
    const dse_real high = dse_consensus_largest_step(DSE_CONSENSUS_HIGH_PASS, degree);
    filter->alpha = config->alpha > 0 ? config->alpha : 1;
    filter->epsilon = config->epsilon;
    if (!(filter->epsilon > 0)) {
        filter->epsilon = DSE_REAL(1.0) / (dse_real)(1 + degree);
        if (has_low_pass(config->kind))
            filter->epsilon = low / dse_max(filter->alpha, 1);
    }
    /* a step computed as the bound by other operations is not beyond it */
    const dse_real slack = 1 + 4 * DSE_REAL_EPSILON;
    switch (config->kind) {
    case DSE_CONSENSUS_LOW_PASS:
        return filter->epsilon <= low * slack ? DSE_OK : DSE_EINVAL;
    case DSE_CONSENSUS_BAND_PASS:
        if (!(filter->epsilon * filter->alpha <= low * slack))
            return DSE_EINVAL;
        return filter->epsilon <= high * slack ? DSE_OK : DSE_EINVAL;
    default:
        return filter->epsilon <= high * slack ? DSE_OK : DSE_EINVAL;
    }
}

enum dse_status dse_consensus_init(struct dse_consensus *filter,
                                   const struct dse_consensus_config *config,
                                   struct dse_arena *arena)
{
    enum dse_status status = check(config);
    if (status != DSE_OK)
        return status;
    *filter = (struct dse_consensus){
        .config = config,
        .width = has_low_pass(config->kind) ? 2 * config->size : config->size,
    };
    status = set_steps(filter);
    if (status != DSE_OK)
        return status;
    filter->u = dse_arena_take(arena, config->size);
    filter->state = dse_arena_take(arena, state_size(config));
    filter->next = dse_arena_take(arena, state_size(config));
    filter->output = dse_arena_take(arena, config->size);
    filter->said = dse_arena_take(arena, config->n_neighbours * filter->width);
    filter->heard = dse_arena_take(arena, config->n_neighbours);
    return filter->heard != NULL && filter->said != NULL && filter->output != NULL &&
                   filter->next != NULL && filter->state != NULL && filter->u != NULL
               ? DSE_OK
               : DSE_ESTORAGE;
}

/* The filter's value from its state. */
static void set_output(struct dse_consensus *filter)
{
    const int size = filter->config->size;
    const dse_real *value = filter->state;
    if (filter->config->kind == DSE_CONSENSUS_BAND_PASS)
        value += size; /* b */
    for (int e = 0; e < size; e++) {
        filter->output[e] = value[e];
        if (filter->config->kind == DSE_CONSENSUS_HIGH_PASS)
            filter->output[e] += filter->u[e];
    }
}

static void forget_round(struct dse_consensus *filter)
{
    for (int j = 0; j < filter->config->n_neighbours; j++)
        filter->heard[j] = 0;
}

static void start(struct dse_consensus *filter)
{
    const bool average = filter->config->kind == DSE_CONSENSUS_AVERAGE;
    for (int e = 0; e < state_size(filter->config); e++)
        filter->state[e] = average ? filter->u[e] : 0;
    set_output(filter);
}

enum dse_status dse_consensus_input(struct dse_consensus *filter, const dse_real *u)
{
    if (!dse_all_finite(u, filter->config->size))
        return DSE_ENONFINITE;
    for (int e = 0; e < filter->config->size; e++)
        filter->u[e] = u[e];
    if (filter->config->kind == DSE_CONSENSUS_AVERAGE)
        start(filter);
    set_output(filter);
    return DSE_OK;
}

void dse_consensus_reset(struct dse_consensus *filter)
{
    forget_round(filter);
    start(filter);
}

int dse_consensus_message_size(const struct dse_consensus *filter)
{
    return filter->width;
}

int dse_consensus_message(const struct dse_consensus *filter, dse_real *message)
{
    const int size = filter->config->size;
    const dse_real *u = filter->u, *state = filter->state;
    for (int e = 0; e < size; e++) {
        switch (filter->config->kind) {
        case DSE_CONSENSUS_HIGH_PASS: /* [g] */
            message[e] = state[e] + u[e];
            break;
        case DSE_CONSENSUS_LOW_PASS: /* [c; u] */
            message[e] = state[e];
            message[size + e] = u[e];
            break;
        case DSE_CONSENSUS_BAND_PASS: /* [g; b] */
            message[e] = state[e] + u[e];
            message[size + e] = state[size + e];
            break;
        default: /* [x] */
            message[e] = state[e];
            break;
        }
    }
    return filter->width;
}

enum dse_status dse_consensus_receive(struct dse_consensus *filter, int neighbour,
                                      const dse_real *message, int count)
{
    if (neighbour < 0 || neighbour >= filter->config->n_neighbours)
        return DSE_EINVAL;
    const bool fits = count == filter->width;
    if (!fits || !dse_all_finite(message, count)) {
        filter->counts.refused++;
        return fits ? DSE_ENONFINITE : DSE_EDIM;
    }
    for (int e = 0; e < count; e++)
        filter->said[neighbour * filter->width + e] = message[e];
    filter->heard[neighbour] = 1;
    filter->counts.heard++;
    return DSE_OK;
}

/* One step of `state`. */
static void step(const struct dse_consensus *filter, dse_real *state)
{
    const int size = filter->config->size;
    const struct dse_consensus_words words = {.count = filter->config->n_neighbours,
                                              .stride = filter->width,
                                              .said = filter->said,
                                              .heard = filter->heard};
    switch (filter->config->kind) {
    case DSE_CONSENSUS_HIGH_PASS:
        dse_consensus_high_pass(&words, 0, size, filter->epsilon, filter->u, state);
        break;
    case DSE_CONSENSUS_LOW_PASS:
        dse_consensus_low_pass(&words, 0, size, size, filter->epsilon, filter->u, state);
        break;
    case DSE_CONSENSUS_BAND_PASS:
        dse_consensus_band_pass(&words, 0, size, size, filter->epsilon, filter->alpha, filter->u,
                                state, state + size);
        break;
    default:
        dse_consensus_average(&words, 0, size, filter->epsilon, state);
        break;
    }
}

enum dse_status dse_consensus_end_round(struct dse_consensus *filter)
{
    const int reals = state_size(filter->config);
    for (int j = 0; j < filter->config->n_neighbours; j++)
        filter->counts.silent += filter->heard[j] == 0;
    for (int e = 0; e < reals; e++)
        filter->next[e] = filter->state[e];
    step(filter, filter->next);
    forget_round(filter);
    if (!dse_all_finite(filter->next, reals)) {
        filter->counts.failed++;
        return DSE_ENONFINITE;
    }
    dse_real *state = filter->next;
    filter->next = filter->state;
    filter->state = state;
    filter->counts.rounds++;
    set_output(filter);
    return DSE_OK;
}

const dse_real *dse_consensus_output(const struct dse_consensus *filter)
{
    return filter->output;
}

const struct dse_consensus_counts *dse_consensus_counts(const struct dse_consensus *filter)
{
    return &filter->counts;
}
