/* The distributed Kalman filters as a method: node i is a filter of the whole plant with the
 * sensors of one group. A sample has one round, in which it says what its listeners need of its
 * estimate; with one gain for the network a second one, in which all say their terms of the sum. */
#include <math.h>
#include <string.h>

#include "methods/distributed_kalman_node.h"

enum { ROUND_ESTIMATES, ROUND_TERMS };

static int nodes(const struct method_setup *setup)
{
    const struct sensor_network sensors = distributed_kalman_sensors(setup->section);
    return sensor_network_nodes(setup, &sensors);
}

static enum dse_status begin(void *self, const struct method_sample *sample)
{
    struct distributed_kalman_node *node = self;
    struct dse_measurement measurement = {.y = sample->y, .valid = sample->valid};
    node->k = sample->k;
    for (int i = 0; node->has_term != NULL && i < node->nodes; i++)
        node->has_term[i] = false;
    return dse_dkf_begin(&node->filter, (dse_real)sample->t, sample->u, &measurement);
}

/* ---- the exchange ---- */

/* What differs from listener to listener, one after the other; a full state serves all. A filter
 * whose last step failed has an old estimate: it keeps silent, and counts as not heard. */
static void say_estimate(struct distributed_kalman_node *node, struct method_message *message)
{
    int n_voices = node->config.listeners != NULL ? node->n_voices : node->n_voices > 0;
    message->count = 0;
    message->withheld = !node->ok;
    for (int l = 0; !message->withheld && l < n_voices; l++)
        message->count += dse_dkf_message(&node->filter, l, message->value + message->count);
}

static void say_term(struct distributed_kalman_node *node, struct method_message *message)
{
    int size = node->filter.ny * node->filter.ny;
    dse_dkf_global_term(&node->filter, message->value);
    memcpy(node->terms + node->node * size, message->value, (size_t)size * sizeof *node->terms);
    node->has_term[node->node] = true;
    message->count = size;
}

/* sum_i eps_i s_i' in the order of the nodes: the same bits at all of them. Those who said nothing
 * are left out. */
static void add_terms(struct distributed_kalman_node *node)
{
    int size = node->filter.ny * node->filter.ny;
    for (int k = 0; k < size; k++) {
        node->sum[k] = 0;
        for (int i = 0; i < node->nodes; i++)
            if (node->has_term[i])
                node->sum[k] += node->terms[i * size + k];
    }
    dse_dkf_global_sum(&node->filter, node->sum);
}

/* Estimates are heard from the neighbours of the graph, terms from all. */
static enum method_step next(void *self, int round, struct method_plan *plan,
                             struct method_message *message)
{
    struct distributed_kalman_node *node = self;
    bool global = node->section->scheme == DSE_DKF_GLOBAL;
    if (node->section->scheme == DSE_DKF_ALONE)
        return METHOD_DONE;
    if (round == ROUND_ESTIMATES) {
        plan->n_wait = node->n_ears;
        for (int j = 0; j < node->n_ears; j++)
            plan->wait[j] = node->ears[j].from;
        plan->speak = node->n_voices > 0;
        say_estimate(node, message);
        return METHOD_ROUND;
    }
    if (global && round == ROUND_TERMS) {
        say_term(node, message);
        return METHOD_ROUND;
    }
    if (global)
        add_terms(node);
    return METHOD_DONE;
}

static enum dse_status hear_estimate(struct distributed_kalman_node *node, int from,
                                     const struct method_message *message)
{
    int size = dse_dkf_message_size(&node->filter);
    int j = 0;
    while (j < node->n_ears && node->ears[j].from != from)
        j++;
    if (j == node->n_ears || message->count == 0)
        return DSE_OK;
    if (node->ears[j].offset + size > message->count)
        return DSE_EDIM;
    return dse_dkf_receive(&node->filter, j, message->value + node->ears[j].offset, size);
}

static enum dse_status receive(void *self, int round, int from,
                               const struct method_message *message)
{
    struct distributed_kalman_node *node = self;
    int size = node->filter.ny * node->filter.ny;
    if (node->links != NULL && lossy_rounds_lost(node->links, from, node->k, round))
        return DSE_OK;
    if (round == ROUND_ESTIMATES)
        return hear_estimate(node, from, message);
    if (node->terms == NULL || from < 0 || from >= node->nodes || message->count != size)
        return DSE_EDIM;
    memcpy(node->terms + from * size, message->value, (size_t)size * sizeof *node->terms);
    node->has_term[from] = true;
    return DSE_OK;
}

/* ---- the estimate ---- */

static double norm(const dse_real *v, int n)
{
    double sum = 0;
    for (int k = 0; k < n; k++)
        sum += (double)v[k] * (double)v[k];
    return sqrt(sum);
}

static void tell(const struct distributed_kalman_node *node, double *diagnostic)
{
    const struct dse_dkf *filter = &node->filter;
    const struct dse_dkf_counts *counts = dse_dkf_counts(filter);
    int used = 0;
    for (int j = 0; j < node->n_ears; j++)
        used += dse_dkf_uses(filter, j);
    diagnostic[DIAGNOSTIC_GAIN] = (double)dse_dkf_largest_gain(filter);
    diagnostic[DIAGNOSTIC_LOOP_GAIN] = (double)dse_dkf_loop_gain(filter);
    diagnostic[DIAGNOSTIC_RESIDUAL] = norm(dse_dkf_residual(filter), filter->ny);
    diagnostic[DIAGNOSTIC_USED] = used;
    diagnostic[DIAGNOSTIC_REFUSED] = (double)counts->refused;
    diagnostic[DIAGNOSTIC_LIMITED] = (double)counts->limited;
}

/* The estimate of t_k, before the step to t_(k+1) (section 3, agent mode). P is a covariance only
 * where nothing couples, and of what is told only where the time is continuous. */
static enum dse_status finish(void *self, struct method_estimate *estimate)
{
    struct distributed_kalman_node *node = self;
    struct dse_dkf *filter = &node->filter;
    enum dse_status status = dse_dkf_correct(filter);
    const dse_real *state = dse_dkf_state(filter);
    const dse_real *P = dse_dkf_covariance(filter);
    bool is_covariance = P != NULL && node->section->scheme == DSE_DKF_ALONE && !filter->discrete;
    for (int s = 0; s < filter->nx; s++) {
        estimate->state[s] = (double)state[s];
        estimate->variance[s] = is_covariance ? (double)P[s * filter->nx + s] : NAN;
    }
    tell(node, estimate->diagnostic);
    if (status == DSE_OK)
        status = dse_dkf_advance(filter);
    node->ok = status == DSE_OK;
    estimate->health = dse_dkf_health(filter);
    return status;
}

const struct method distributed_kalman_method = {
    .name = "distributed_kalman",
    .title = "distributed Kalman filter",
    .fields = distributed_kalman_fields,
    .section_size = sizeof(struct distributed_kalman_section),
    .rules = distributed_kalman_rules,
    .uses_link = true,
    .nodes = nodes,
    .create = distributed_kalman_create,
    .destroy = distributed_kalman_destroy,
    .begin = begin,
    .next = next,
    .receive = receive,
    .finish = finish,
};
