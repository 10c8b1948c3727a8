/* The life of a node: joining, sample after sample, end. */
#include "runtime/node.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "runtime/fingerprint.h"
#include "runtime/node_internal.h"
#include "runtime/run_info.h"

#define STATUS_PERIOD_JOINING 0.1 /* s */
#define STATUS_PERIOD_RUNNING 1.0
#define DEADLINE_SHARE        0.8 /* of the sampling period, realtime: later messages are predicted */
#define DEFAULT_REPEAT        0.05
#define LONGEST_REPEAT        1.0
#define DEFAULT_GIVE_UP       20.0

static double shortest_repeat_s(const struct node *node)
{
    double given = node->config.scenario->timeouts.repeat_s;
    return given > 0 ? given : DEFAULT_REPEAT;
}

double node_repeat_s(const struct node *node)
{
    return fmax(shortest_repeat_s(node), node->repeat_s);
}

/* What was waited for is here. If it was asked for, it comes at once where it had been lost; what
 * comes long after it was asked for would have come anyway: the others are slow or the network is
 * busy, and asking makes it worse. Many nodes on few processors would ask more than they say. */
static void learn_patience(struct node *node)
{
    double now = host_now(), repeat = node_repeat_s(node);
    if (node->asked_at <= 0)
        node->repeat_s = 0.99 * repeat;
    else
        node->repeat_s =
            now > node->asked_at + 0.5 * repeat ? fmin(2 * repeat, LONGEST_REPEAT) : 0.5 * repeat;
    node->asked_at = 0;
}

static double give_up_s(const struct node *node)
{
    double given = node->config.scenario->timeouts.give_up_s;
    return given > 0 ? given : DEFAULT_GIVE_UP;
}

/* Wall-clock time between two samples of a realtime run. */
static double period_s(const struct node *node)
{
    double speed = node->config.speed > 0 ? node->config.speed : 1;
    return node->config.scenario->time.period_s / speed;
}

/* ---- what the node says of itself ---- */

void node_publish_status(struct node *node, int state)
{
    dse_status_t message = {
        .instance = node->instance_id,
        .scenario_hash = (int64_t)node->config.scenario->hash,
        .pid = (int32_t)getpid(),
        .state = (int8_t)state,
        .estimate_hash = (int64_t)node->estimate_hash,
        .refused_hash = node->counters.refused_hash,
        .refused_length = node->counters.refused_length,
        .refused_count = node->counters.refused_count,
        .refused_nonfinite = node->counters.refused_nonfinite,
        .foreign_run = node->counters.foreign_run,
        .duplicates = node->counters.duplicates,
        .gaps = node->counters.gaps,
        .asked = node->asked,
        .answered = node->answered,
        .predicted = node->predicted,
        .method_failures = node->method_failures,
    };
    message.reason_length = (int16_t)strnlen(node->reason, sizeof message.reason);
    memcpy(message.reason, node->reason, (size_t)message.reason_length);
    sender_status(&node->sender, node->k - 1, node->t, &message);
    node->last_status = host_now();
}

void node_fail(struct node *node, const char *format, ...)
{
    if (node->state == AGENT_FAILED)
        return;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(node->reason, sizeof node->reason, format, arguments);
    va_end(arguments);
    node->state = AGENT_FAILED;
    node_publish_status(node, DSE_STATUS_T_STATE_FAILED);
}

void node_finish(struct node *node)
{
    announcement_repeat(&node->announcement, &node->sender, host_now());
    node->state = AGENT_FINISHED;
    node_publish_status(node, DSE_STATUS_T_STATE_FINISHED);
}

void node_start(struct node *node, int64_t k)
{
    if (node->started || node->state != AGENT_JOINING)
        return;
    node->started = true;
    node->first = k;
    node->k = k;
    node->state = AGENT_RUNNING;
    node->last_progress = host_now();
    char *json = run_info_node(node->config.scenario, node->config.network, node->config.node,
                               node->method, &node->info, node->source_run);
    announcement_begin(&node->announcement, &node->sender, json, node->last_progress);
    node_publish_status(node, DSE_STATUS_T_STATE_RUNNING);
}

/* ---- one sample ---- */

static void begin_sample(struct node *node)
{
    struct method_sample sample = {.k = node->k,
                                   .t = node->t,
                                   .u = node->u_held,
                                   .y = node->y_stacked,
                                   .valid = node->y_valid};
    learn_patience(node);
    node->sample_started = host_now();
    node->sent = 0;
    node->sent_bytes = 0;
    node->round = 0;
    if (node->method->begin(node->instance, &sample) != DSE_OK)
        node->method_failures++;
    node->step_s = host_now() - node->sample_started;
    node->phase = NODE_IN_ROUND;
}

static void publish_done(struct node *node, int64_t k)
{
    dse_done_t done = {.rounds = node->round,
                       .sent = node->sent,
                       .sent_bytes = node->sent_bytes,
                       .step_s = node->step_s};
    sender_done(&node->sender, k, node->t, &done);
}

/* The last `done` again, under its old number; nothing while there has been none. */
void node_repeat_done(struct node *node)
{
    if (node->k == node->first)
        return;
    node->sender.sequence[SENDER_DONE]--;
    publish_done(node, node->k - 1);
}

static void end_sample(struct node *node)
{
    struct method_estimate *estimate = &node->estimate;
    double before = host_now();
    if (node->method->finish(node->instance, estimate) != DSE_OK)
        node->method_failures++;
    node->step_s += host_now() - before;
    struct sender_estimate what = {.health = (int)estimate->health,
                                   .count = node->info.n_states,
                                   .state = estimate->state,
                                   .variance = estimate->variance,
                                   .diagnostics = node->info.n_diagnostics,
                                   .diagnostic = estimate->diagnostic};
    sender_estimate(&node->sender, node->k, node->t, &what);
    size_t bytes = (size_t)node->info.n_states * sizeof(double);
    node->estimate_hash = fingerprint_add(node->estimate_hash, estimate->state, bytes);
    node->estimate_hash = fingerprint_add(node->estimate_hash, estimate->variance, bytes);
    publish_done(node, node->k);
    node->phase = NODE_WAIT_SAMPLE;
    node->k++;
    node->last_progress = host_now();
    node->last_repeat = node->last_progress;
}

/* When the round closes without the messages that are missing; never: INFINITY. */
static double deadline(const struct node *node)
{
    double at = INFINITY;
    if (node->config.pace == DSE_CLOCK_T_PACE_REALTIME)
        at = node->newest > node->k ? node->round_started /* late already */
                                    : node->sample_started + DEADLINE_SHARE * period_s(node);
    if (node->plan.patience_s > 0)
        at = fmin(at, node->round_started + node->plan.patience_s);
    return at;
}

void node_advance(struct node *node)
{
    while (node->state == AGENT_RUNNING) {
        if (node->phase == NODE_WAIT_SAMPLE) {
            if (!node_sample_ready(node))
                return;
            begin_sample(node);
        } else {
            bool complete = node_round_complete(node);
            if (!complete && host_now() <= deadline(node))
                return;
            if (complete)
                learn_patience(node);
            node_close_round(node);
            node->round++;
        }
        if (!node_open_round(node))
            end_sample(node);
    }
}

void node_skip_to(struct node *node, int64_t k)
{
    if (node->state != AGENT_RUNNING || node->phase != NODE_WAIT_SAMPLE || k <= node->k ||
        node_sample_ready(node))
        return;
    node->counters.gaps += k - node->k;
    node->k = k;
    node->last_progress = host_now();
}

/* ---- time ---- */

static double poll_joining(struct node *node, double now)
{
    if (now >= node->last_status + STATUS_PERIOD_JOINING)
        node_publish_status(node, DSE_STATUS_T_STATE_JOINING);
    return node->last_status + STATUS_PERIOD_JOINING;
}

static void give_up(struct node *node)
{
    char who[64];
    if (node->phase == NODE_IN_ROUND) {
        node_awaited(node, who, sizeof who);
        node_fail(node, "no exchange of sample %lld, round %d from %s within %g s",
                  (long long)node->k, node->round, who, give_up_s(node));
    } else {
        node_fail(node, "no measurement of sample %lld from the plant within %g s",
                  (long long)node->k, give_up_s(node));
    }
}

static void repeat_request(struct node *node)
{
    if (node->phase == NODE_IN_ROUND)
        node_ask(node);
    else if (node->k > node->first && node->config.pace == DSE_CLOCK_T_PACE_LOCKSTEP &&
             !node->stopping) {
        /* Our last `done`, said again, asks the clock for the sample that we miss. */
        node_repeat_done(node);
        node->asked++;
        node->asked_at = host_now();
    }
}

/* The time from which on nothing has moved the node. */
static double idle_since(const struct node *node)
{
    double since = fmax(node->stop_heard, node->last_progress);
    return node->phase == NODE_IN_ROUND ? fmax(since, node->round_started) : since;
}

static double linger_s(const struct node *node)
{
    return node->config.pace == DSE_CLOCK_T_PACE_LOCKSTEP ? 0 : NODE_LINGER;
}

static bool may_finish(const struct node *node, double now)
{
    if (!node->stopping)
        return false;
    bool all = node->k >= node->stop_at && node->phase == NODE_WAIT_SAMPLE;
    return now >= idle_since(node) + (all ? linger_s(node) : give_up_s(node));
}

double node_poll(void *self, double now)
{
    struct node *node = self;
    if (node->state == AGENT_JOINING)
        return poll_joining(node, now);
    announcement_poll(&node->announcement, &node->sender, now);
    node_advance(node);
    if (node->state != AGENT_RUNNING)
        return now;
    if (may_finish(node, now)) {
        if (node->k < node->stop_at)
            node_report_gap(node, node->k, node->stop_at - node->k);
        node_finish(node);
        return now;
    }
    if (now >= node->last_status + STATUS_PERIOD_RUNNING)
        node_publish_status(node, DSE_STATUS_T_STATE_RUNNING);
    double since = idle_since(node);
    bool patient = node->config.pace == DSE_CLOCK_T_PACE_REPLAY && node->phase == NODE_WAIT_SAMPLE;
    if (now > since + give_up_s(node) && !patient)
        give_up(node);
    else if (now >= node->last_repeat + node_repeat_s(node)) {
        repeat_request(node);
        node->last_repeat = now;
    }
    double next = node->last_repeat + node_repeat_s(node);
    if (node->phase == NODE_IN_ROUND)
        next = fmin(next, deadline(node) + 1e-4);
    if (node->stopping)
        next = fmin(next, idle_since(node) + linger_s(node));
    return fmax(next, now + 0.001);
}

enum agent_state node_state(const void *self)
{
    return ((const struct node *)self)->state;
}

const char *node_reason(const void *self)
{
    return ((const struct node *)self)->reason;
}

void node_stop(void *self, const char *reason)
{
    struct node *node = self;
    if (node->state == AGENT_FINISHED || node->state == AGENT_FAILED)
        return;
    snprintf(node->reason, sizeof node->reason, "%s", reason);
    node_finish(node);
}
