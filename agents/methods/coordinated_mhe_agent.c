/* The agent of a subsystem, or of the whole plant. */
#include <math.h>

#include "methods/coordinated_mhe_node.h"

static enum dse_status begin(struct coordinated_mhe_node *node, const struct method_sample *sample)
{
    const int first = node->plant.first_output[node->part];
    struct dse_measurement measurement = {.y = node->measured, .valid = sample->valid};
    for (int l = 0; l < coordinated_mhe_plant_ny(&node->plant, node->part); l++)
        node->measured[l] = (dse_real)(sample->y[l] - (double)node->plant.y[first + l]);
    return dse_mhe_local_begin(&node->local, (long)sample->k, &measurement);
}

/* Says that it is not with the coordinator in this sample. */
static enum method_step stay_away(struct coordinated_mhe_node *node, struct method_message *message)
{
    node->ended = true;
    message->withheld = true;
    message->count = 0;
    return METHOD_ROUND;
}

static enum method_step answer(struct coordinated_mhe_node *node, struct method_message *message)
{
    dse_mhe_local_solve(&node->local);
    message->count = dse_mhe_local_message_up(&node->local, node->message);
    for (int i = 0; i < message->count; i++)
        message->value[i] = (double)node->message[i];
    message->withheld = !dse_mhe_local_has_sent(&node->local);
    node->sent += !message->withheld;
    return METHOD_ROUND;
}

/* The first samples are predicted on both sides (spec of the start-up: H < Hmin), without a word.
 */
static bool is_silent(const struct coordinated_mhe_node *node)
{
    return node->settings.scheme == DSE_MHE_ALONE || node->k + 1 < (int64_t)node->section->Hmin;
}

static enum method_step next(struct coordinated_mhe_node *node, int round, struct method_plan *plan,
                             struct method_message *message)
{
    if (node->ended || is_silent(node))
        return METHOD_DONE;
    if (round % 2 == 0) {
        node->heard = false;
        plan->speak = false;
        return METHOD_ROUND;
    }
    plan->n_wait = 0;
    if (node->last)
        return METHOD_DONE;
    if (!node->heard)
        dse_mhe_local_missing_down(&node->local);
    if (!node->heard || dse_mhe_local_is_finished(&node->local))
        return stay_away(node, message);
    return answer(node, message);
}

/* The agent's part of the coordinator's message: after the mark of the last one, for each agent how
 * many numbers and the numbers. -1: it is none. */
static int part_of(const struct coordinated_mhe_node *node, const struct method_message *message)
{
    int at = 1;
    for (int i = 0; at < message->count; i++) {
        double numbers = message->value[at];
        if (!(numbers >= 0 && numbers < METHOD_MESSAGE_CAPACITY) ||
            at + 1 + (int)numbers > message->count)
            return -1;
        if (i == node->part)
            return at;
        at += 1 + (int)numbers;
    }
    return -1;
}

static enum dse_status receive(struct coordinated_mhe_node *node, int round, int from,
                               const struct method_message *message)
{
    int at = part_of(node, message);
    if (at < 0)
        return DSE_EFORMAT;
    node->heard = true;
    node->last = message->value[0] != 0;
    int capacity = DSE_MHE_DOWN_SIZE(node->subsystems[node->part].nx, (int)node->section->Hp);
    int count = (int)message->value[at];
    enum dse_status status = count <= capacity ? DSE_OK : DSE_EFORMAT;
    bool lost = node->losses != NULL && lossy_rounds_lost(node->losses, from, node->k, round);
    for (int i = 0; status == DSE_OK && i < count; i++)
        node->message[i] = (dse_real)message->value[at + 1 + i];
    if (status == DSE_OK && !lost)
        status = dse_mhe_local_receive_down(&node->local, node->message, count);
    if (status != DSE_OK || lost)
        dse_mhe_local_missing_down(&node->local);
    return status;
}

/* Of an estimate of its own; that of a coordinated one depends on the neighbours' data. */
static void fill_variance(struct coordinated_mhe_node *node, struct method_estimate *estimate)
{
    const int nx = node->subsystems[node->part].nx;
    bool known = dse_mhe_local_covariance(&node->local, node->P) == DSE_OK;
    for (int s = 0; s < nx; s++)
        estimate->variance[s] = known ? (double)node->P[s * nx + s] : (double)NAN;
}

static enum dse_status finish(struct coordinated_mhe_node *node, struct method_estimate *estimate)
{
    const struct dse_mhe_local *local = &node->local;
    const int first = node->plant.first_state[node->part];
    dse_mhe_local_finish(&node->local);
    const dse_real *x = dse_mhe_local_state(local);
    for (int s = 0; s < node->subsystems[node->part].nx; s++)
        estimate->state[s] = (double)(node->plant.origin[first + s] + x[s]);
    fill_variance(node, estimate);
    enum dse_mhe_status status = dse_mhe_local_status(local);
    estimate->health = dse_mhe_local_health(local);
    estimate->diagnostic[COORDINATED_MHE_AGENT_ITERATIONS] = dse_mhe_local_iterations(local);
    estimate->diagnostic[COORDINATED_MHE_AGENT_STATUS] = (double)status;
    estimate->diagnostic[COORDINATED_MHE_AGENT_CERTIFICATE] =
        (double)dse_mhe_local_certificate(local);
    estimate->diagnostic[COORDINATED_MHE_AGENT_SENT] = (double)node->sent;
    estimate->diagnostic[COORDINATED_MHE_AGENT_ACTIVE] = dse_mhe_local_active(local);
    return DSE_OK;
}

const struct coordinated_mhe_role coordinated_mhe_agent = {
    .begin = begin, .next = next, .receive = receive, .finish = finish};
