/* What a node makes of the messages on the bus: run control, samples, the neighbours' words. */
#include "runtime/agent.h"
#include "runtime/fingerprint.h"
#include "runtime/node_internal.h"

/* A node of a recorded run is re-estimated under a run id of its own, the same in all processes. */
static int64_t replay_run_id(int64_t recorded)
{
    uint64_t made = fingerprint_add(FINGERPRINT_START, &recorded, sizeof recorded);
    return (int64_t)(made >> 1);
}

static void adopt_run(struct node *node, int64_t run_id)
{
    node->source_run = run_id;
    if (node->sender.id.run_id == 0)
        node->sender.id.run_id =
            node->config.pace == DSE_CLOCK_T_PACE_REPLAY ? replay_run_id(run_id) : run_id;
}

static bool from_source(struct node *node, const dse_header_t *header)
{
    if (header->run_id == node->source_run)
        return true;
    node->counters.foreign_run++;
    return false;
}

/* The clock says with which sample a run begins, and again, when somebody joins late, which one is
 * next. A node of a lockstep run that lies further back than the sample before has been given up
 * by the clock meanwhile. */
static void take_start(struct node *node, int64_t k)
{
    if (!node->started)
        node_start(node, k);
    else if (node->config.pace == DSE_CLOCK_T_PACE_LOCKSTEP && k > node->k + 1)
        node_skip_to(node, k);
}

void node_on_clock(void *user, const char *channel, const uint8_t *bytes, int length)
{
    (void)channel;
    struct node *node = user;
    dse_clock_t message;
    if (!message_clock(bytes, length, &node->counters, &message))
        return;
    bool same = message.scenario_hash == (int64_t)node->config.scenario->hash;
    bool replay = node->config.pace == DSE_CLOCK_T_PACE_REPLAY;
    bool invites =
        message.event == DSE_CLOCK_T_EVENT_JOIN || message.event == DSE_CLOCK_T_EVENT_START;
    if (node->source_run == 0 && invites && (same || replay))
        adopt_run(node, message.header.run_id);
    if (!from_source(node, &message.header))
        return;
    if (!same && !replay) {
        node_fail(node, "the plant of this run reads another scenario than %s",
                  node->config.scenario->file);
        return;
    }
    if (message.event == DSE_CLOCK_T_EVENT_JOIN && node->state == AGENT_JOINING)
        node_publish_status(node, DSE_STATUS_T_STATE_READY);
    if (message.event == DSE_CLOCK_T_EVENT_START)
        take_start(node, message.header.sample);
    if (message.event == DSE_CLOCK_T_EVENT_STOP && node->started && !node->stopping) {
        node->stopping = true;
        node->stop_at = message.header.sample;
        node->stop_heard = host_now();
    } else if (message.event == DSE_CLOCK_T_EVENT_STOP && !node->started && !replay) {
        node_finish(node);
    }
}

/* Two processes for one node: the one that came later leaves; of two that join, the one with the
 * larger random number. Not in a replay: there the status of a node may be a recorded one, and two
 * processes for one node would say the same anyway. */
void node_on_status(void *user, const char *channel, const uint8_t *bytes, int length)
{
    (void)channel;
    struct node *node = user;
    dse_status_t message;
    if (!message_status(bytes, length, &node->counters, &message) ||
        node->config.pace == DSE_CLOCK_T_PACE_REPLAY)
        return;
    const dse_header_t *header = &message.header;
    bool same_place = header->network == node->sender.id.network &&
                      header->node == node->sender.id.node &&
                      (header->role == DSE_HEADER_T_ROLE_ESTIMATOR ||
                       header->role == DSE_HEADER_T_ROLE_COORDINATOR);
    bool same_run = header->run_id == node->sender.id.run_id || header->run_id == 0 ||
                    node->sender.id.run_id == 0;
    if (!same_place || message.instance == node->instance_id ||
        message.scenario_hash != (int64_t)node->config.scenario->hash || !same_run ||
        message.state > DSE_STATUS_T_STATE_RUNNING)
        return;
    int own = node->started ? DSE_STATUS_T_STATE_RUNNING : DSE_STATUS_T_STATE_JOINING;
    int other = message.state == DSE_STATUS_T_STATE_RUNNING ? DSE_STATUS_T_STATE_RUNNING
                                                            : DSE_STATUS_T_STATE_JOINING;
    bool leave = other > own || (other == own && message.instance < node->instance_id);
    if (leave)
        node_fail(node, "already served by process %d: one agent per node", message.pid);
    else if (host_now() > node->last_status + 0.01)
        node_publish_status(node, node->started ? DSE_STATUS_T_STATE_RUNNING
                                                : DSE_STATUS_T_STATE_JOINING);
}

/* The clock still waits for the sample before: our `done` was lost. Answered once in a while only,
 * for it may be an old message on a slow way: an answer to each would be answered in turn. */
static void answer_repetition(struct node *node, const dse_input_t *message)
{
    double now = host_now();
    if (message->header.sample != node->k - 1 || node->phase != NODE_WAIT_SAMPLE ||
        message->part != 0 || now < node->last_repeat + node_repeat_s(node))
        return;
    node_repeat_done(node);
    node->last_repeat = now;
}

void node_on_input(void *user, const char *channel, const uint8_t *bytes, int length)
{
    (void)channel;
    struct node *node = user;
    dse_input_t message;
    if (!message_input(bytes, length, &node->counters, &message))
        return;
    if (node->source_run == 0 && node->config.pace == DSE_CLOCK_T_PACE_REPLAY)
        adopt_run(node, message.header.run_id);
    if (!from_source(node, &message.header))
        return;
    /* The message that said so may have been lost; later on the clock says where to begin. */
    if (message.header.sample == 0 || node->config.pace == DSE_CLOCK_T_PACE_REPLAY)
        node_start(node, 0);
    answer_repetition(node, &message);
    node_take_input(node, &message);
    node_advance(node);
}

void node_on_measurement(void *user, const char *channel, const uint8_t *bytes, int length)
{
    (void)channel;
    struct node *node = user;
    dse_measurement_t message;
    if (!message_measurement(bytes, length, &node->counters, &message))
        return;
    if (node->source_run == 0 && node->config.pace == DSE_CLOCK_T_PACE_REPLAY)
        adopt_run(node, message.header.run_id);
    if (!from_source(node, &message.header))
        return;
    node_take_measurement(node, &message);
    node_advance(node);
}

void node_on_exchange(void *user, const char *channel, const uint8_t *bytes, int length)
{
    (void)channel;
    struct node *node = user;
    dse_exchange_t message;
    if (!message_exchange(bytes, length, &node->counters, &message))
        return;
    if (message.header.run_id != node->sender.id.run_id) {
        node->counters.foreign_run++;
        return;
    }
    if (message.header.network != node->sender.id.network) {
        node->counters.refused_count++;
        return;
    }
    node_take_exchange(node, &message);
    node_advance(node);
}
