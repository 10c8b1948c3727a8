/* The distributed adaptive high-gain EKF as a method: node i is the filter of subsystem i, or node
 * 0 that of the whole plant. */
#include <math.h>

#include "methods/high_gain_ekf_node.h"

#define STAGES_ROUNDS 4

static int nodes(const struct method_setup *setup)
{
    const struct high_gain_ekf_section *section = setup->section;
    return section->framework == HIGH_GAIN_EKF_CENTRALISED ? 1 : setup->process->n_subsystems;
}

static int64_t every(const struct high_gain_ekf_section *section)
{
    return section->communication.every > 0 ? section->communication.every : 1;
}

/* Rounds of sample k by the scenario alone, so that all nodes agree on them whatever happens. */
static int planned_rounds(const struct high_gain_ekf_section *section, int64_t k)
{
    if (section->framework == HIGH_GAIN_EKF_CENTRALISED)
        return 0;
    if (section->communication.kind == DSE_HIGH_GAIN_STAGES)
        return STAGES_ROUNDS;
    bool due = section->communication.kind != DSE_HIGH_GAIN_NONE && k % every(section) == 0;
    return due || section->innovation == DSE_HIGH_GAIN_SUM ? 1 : 0;
}

static enum dse_status begin(void *self, const struct method_sample *sample)
{
    struct high_gain_ekf_node *node = self;
    struct dse_measurement measurement = {.y = sample->y, .valid = sample->valid};
    node->k = sample->k;
    node->planned = planned_rounds(node->section, sample->k);
    enum dse_status status = dse_high_gain_ekf_begin(&node->filter, sample->k, (dse_real)sample->t,
                                                     sample->u, &measurement);
    node->ok = status == DSE_OK;
    return status;
}

/* What the network has brought by now, whether or not its sender speaks in this round. */
static void deliver(struct high_gain_ekf_node *node)
{
    int64_t period = every(node->section);
    if (node->links == NULL || node->k % period != 0)
        return;
    for (int j = 0; j < node->form.p; j++) {
        int64_t stamp = 0;
        const dse_real *state = NULL;
        while ((state = lossy_link_take(node->links, node->block[j], node->k / period, &stamp)) !=
               NULL)
            if (node->ok)
                dse_high_gain_ekf_deliver(&node->filter, j, stamp * period, state,
                                          node->form.n_i[j]);
    }
}

/* A node whose filter has failed in this sample says so by an empty, withheld message: the others
 * predict its block and need not wait for it. Where a trigger decides, a message without the state
 * is withheld, too: it says J and how many states were sent, which is no transmission. */
static enum method_step next(void *self, int round, struct method_plan *plan,
                             struct method_message *message)
{
    struct high_gain_ekf_node *node = self;
    (void)plan; /* everybody speaks and hears everybody */
    if (round == 1)
        deliver(node);
    if (round > 0 && node->ok)
        node->ok = dse_high_gain_ekf_advance(&node->filter, round - 1) == DSE_OK;
    if (round >= node->planned)
        return METHOD_DONE;
    message->count = node->ok ? dse_high_gain_ekf_message(&node->filter, round, message->value) : 0;
    message->withheld =
        message->count == 0 || (node->section->communication.kind == DSE_HIGH_GAIN_TRIGGERED &&
                                !dse_high_gain_ekf_tells(&node->filter));
    return METHOD_ROUND;
}

/* Through the network where there is one: J comes at once, the state when and if it is due. */
static enum dse_status receive(void *self, int round, int from,
                               const struct method_message *message)
{
    struct high_gain_ekf_node *node = self;
    int count = message->count;
    int j = high_gain_ekf_place(node, from);
    if (count == 0)
        return DSE_OK;
    if (node->links != NULL && j >= 0 && count == 1 + node->form.n_i[j]) {
        lossy_link_put(node->links, from, node->k / every(node->section), message->value + 1);
        count = 1;
    }
    return node->ok ? dse_high_gain_ekf_receive(&node->filter, round, j, message->value, count)
                    : DSE_OK;
}

/* Of one output with its sign, of several their Euclidean norm. */
static double innovation(const struct dse_high_gain_ekf *filter)
{
    const dse_real *e = dse_high_gain_ekf_output_error(filter);
    double sum = 0;
    for (int l = 0; l < filter->m; l++)
        sum += (double)e[l] * (double)e[l];
    return filter->m == 1 ? (double)e[0] : sqrt(sum);
}

static enum dse_status finish(void *self, struct method_estimate *estimate)
{
    struct high_gain_ekf_node *node = self;
    struct dse_high_gain_ekf *filter = &node->filter;
    enum dse_status status = node->ok ? dse_high_gain_ekf_finish(filter) : DSE_OK;
    const dse_real *state = dse_high_gain_ekf_estimate(filter);
    const dse_real *P = dse_high_gain_ekf_estimate_covariance(filter);
    for (int s = 0; s < filter->n_i; s++) {
        estimate->state[s] = (double)state[s];
        estimate->variance[s] = (double)P[s * filter->n_i + s];
    }
    estimate->diagnostic[DIAGNOSTIC_THETA] = (double)dse_high_gain_ekf_theta(filter);
    estimate->diagnostic[DIAGNOSTIC_J] = (double)dse_high_gain_ekf_innovation(filter);
    estimate->diagnostic[DIAGNOSTIC_J_SUM] = (double)dse_high_gain_ekf_drive(filter);
    estimate->diagnostic[DIAGNOSTIC_INNOVATION] = innovation(filter);
    estimate->diagnostic[DIAGNOSTIC_AGE] = (double)dse_high_gain_ekf_largest_age(filter);
    estimate->diagnostic[DIAGNOSTIC_SENT] =
        (double)dse_high_gain_ekf_counters(filter)->transmissions;
    estimate->health = dse_high_gain_ekf_health(filter);
    return status;
}

const struct method high_gain_ekf_method = {
    .name = "high_gain_ekf",
    .title = "distributed adaptive high-gain EKF",
    .fields = high_gain_ekf_fields,
    .section_size = sizeof(struct high_gain_ekf_section),
    .rules = high_gain_ekf_rules,
    .uses_link = true,
    .nodes = nodes,
    .create = high_gain_ekf_create,
    .destroy = high_gain_ekf_destroy,
    .begin = begin,
    .next = next,
    .receive = receive,
    .finish = finish,
};
