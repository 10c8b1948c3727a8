/* The coordinator: prices or predictions down, windows up, until the agents agree. */
#include "methods/coordinated_mhe_node.h"

static enum dse_status begin(struct coordinated_mhe_node *node, const struct method_sample *sample)
{
    for (int i = 0; i < node->plant.parts; i++)
        node->answers[i] = (struct coordinated_mhe_answer){.present = true};
    return dse_mhe_coordinator_begin(&node->coordinator, (long)sample->k);
}

/* Ends the round: who did not speak at all is not with us in this sample; when nobody is, the
 * sample ends. */
static enum dse_mhe_outcome close_round(struct coordinated_mhe_node *node)
{
    bool anybody = false;
    for (int i = 0; i < node->plant.parts; i++) {
        struct coordinated_mhe_answer *answer = &node->answers[i];
        answer->present = answer->present && answer->said;
        anybody = anybody || answer->present;
        if (!answer->received)
            dse_mhe_coordinator_missing_up(&node->coordinator, i);
    }
    if (anybody)
        return dse_mhe_coordinator_advance(&node->coordinator);
    dse_mhe_coordinator_stop(&node->coordinator);
    return dse_mhe_coordinator_outcome(&node->coordinator);
}

/* The mark of the last message, then for each agent how many numbers and the numbers. */
static enum method_step tell(struct coordinated_mhe_node *node, enum dse_mhe_outcome outcome,
                             struct method_message *message)
{
    node->ended = outcome != DSE_MHE_CONTINUE;
    message->value[message->count++] = node->ended;
    for (int i = 0; i < node->plant.parts; i++) {
        int count = dse_mhe_coordinator_message_down(&node->coordinator, i, node->message);
        message->value[message->count++] = count;
        for (int j = 0; j < count; j++)
            message->value[message->count++] = (double)node->message[j];
    }
    return METHOD_ROUND;
}

static enum method_step listen(struct coordinated_mhe_node *node, struct method_plan *plan)
{
    plan->speak = false;
    plan->n_wait = 0;
    for (int i = 0; i < node->plant.parts; i++) {
        node->answers[i].said = false;
        node->answers[i].received = false;
        if (node->answers[i].present)
            plan->wait[plan->n_wait++] = i;
    }
    return METHOD_ROUND;
}

static enum method_step next(struct coordinated_mhe_node *node, int round, struct method_plan *plan,
                             struct method_message *message)
{
    if (node->ended || node->k + 1 < (int64_t)node->section->Hmin)
        return METHOD_DONE;
    if (round % 2 != 0)
        return listen(node, plan);
    plan->n_wait = 0;
    message->count = 0;
    return tell(node,
                round > 0 ? close_round(node) : dse_mhe_coordinator_outcome(&node->coordinator),
                message);
}

static enum dse_status receive(struct coordinated_mhe_node *node, int round, int from,
                               const struct method_message *message)
{
    struct coordinated_mhe_answer *answer = &node->answers[from];
    const struct dse_mhe_subsystem *subsystem = &node->subsystems[from];
    if (message->count == 0)
        return DSE_OK; /* it stays away */
    answer->said = true;
    if (message->count > DSE_MHE_UP_SIZE(subsystem->nx, subsystem->ny, (int)node->section->Hp))
        return DSE_EFORMAT;
    if (node->losses != NULL && lossy_rounds_lost(node->losses, from, node->k, round))
        return DSE_OK;
    for (int i = 0; i < message->count; i++)
        node->message[i] = (dse_real)message->value[i];
    enum dse_status status =
        dse_mhe_coordinator_receive_up(&node->coordinator, from, node->message, message->count);
    answer->received = status == DSE_OK;
    return status;
}

static enum dse_health health_of(enum dse_mhe_outcome outcome)
{
    switch (outcome) {
    case DSE_MHE_OUTCOME_STARTING:
        return DSE_HEALTH_INITIALISING;
    case DSE_MHE_OUTCOME_ALONE:
        return DSE_HEALTH_ALONE;
    case DSE_MHE_OUTCOME_SINGULAR:
        return DSE_HEALTH_UNOBSERVABLE;
    case DSE_MHE_OUTCOME_DIVERGED:
        return DSE_HEALTH_DIVERGED;
    default:
        return DSE_HEALTH_TRACKING;
    }
}

static enum dse_status finish(struct coordinated_mhe_node *node, struct method_estimate *estimate)
{
    const struct dse_mhe_coordinator *coordinator = &node->coordinator;
    enum dse_mhe_outcome outcome = dse_mhe_coordinator_outcome(coordinator);
    int hears = 0;
    for (int i = 0; i < node->plant.parts; i++)
        hears += dse_mhe_coordinator_hears(coordinator, i);
    estimate->health = health_of(outcome);
    estimate->diagnostic[COORDINATED_MHE_ITERATIONS] = dse_mhe_coordinator_iterations(coordinator);
    estimate->diagnostic[COORDINATED_MHE_OUTCOME] = (double)outcome;
    estimate->diagnostic[COORDINATED_MHE_ERROR] = (double)dse_mhe_coordinator_error(coordinator);
    estimate->diagnostic[COORDINATED_MHE_UPLINKS] = dse_mhe_coordinator_uplinks(coordinator);
    estimate->diagnostic[COORDINATED_MHE_HEARD] = hears;
    return DSE_OK;
}

const struct coordinated_mhe_role coordinated_mhe_coordinator = {
    .begin = begin, .next = next, .receive = receive, .finish = finish};
