/* The life of a node: joining, sample after sample, end. */
#include "runtime/node.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <unistd.h>

#include "runtime/channels.h"
#include "runtime/fingerprint.h"
#include "runtime/node_internal.h"
#include "runtime/run_info.h"

#define STATUS_PERIOD_JOINING 0.1 /* s */
#define STATUS_PERIOD_RUNNING 1.0
#define REPLAY_LINGER         0.5 /* s for neighbours that still ask after the last sample */
#define DEADLINE_SHARE        0.8 /* of the sampling period, realtime: later messages are predicted */
#define DEFAULT_REPEAT        0.05
#define DEFAULT_GIVE_UP       20.0

static double repeat_s(const struct node *node)
{
    double given = node->config.scenario->timeouts.repeat_s;
    return given > 0 ? given : DEFAULT_REPEAT;
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

static void publish_status(struct node *node, int state)
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
    publish_status(node, DSE_STATUS_T_STATE_FAILED);
}

static void finish(struct node *node)
{
    node->state = AGENT_FINISHED;
    publish_status(node, DSE_STATUS_T_STATE_FINISHED);
}

static void start(struct node *node)
{
    if (node->started)
        return;
    node->started = true;
    node->state = AGENT_RUNNING;
    node->last_progress = host_now();
    char *json = run_info_node(node->config.scenario, node->config.network, node->config.node,
                               node->method, &node->info, node->source_run);
    if (json != NULL)
        sender_run_info(&node->sender, json);
    free(json);
    publish_status(node, DSE_STATUS_T_STATE_RUNNING);
}

/* ---- one sample ---- */

static void begin_sample(struct node *node)
{
    struct method_sample sample = {.k = node->k,
                                   .t = node->t,
                                   .u = node->u_held,
                                   .y = node->y_stacked,
                                   .valid = node->y_valid};
    node->sample_started = host_now();
    node->sent = 0;
    node->sent_bytes = 0;
    node->round = 0;
    enum dse_status status = node->method->begin(node->instance, &sample);
    node->step_s = host_now() - node->sample_started;
    (void)status; /* the health of the estimate tells; the node goes on */
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

/* The last `done` again, under its old number. */
static void repeat_done(struct node *node)
{
    node->sender.sequence[SENDER_DONE]--;
    publish_done(node, node->k - 1);
}

static void end_sample(struct node *node)
{
    struct method_estimate *estimate = &node->estimate;
    double before = host_now();
    (void)node->method->finish(node->instance, estimate);
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
        at = node->sample_started + DEADLINE_SHARE * period_s(node);
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
            if (!node_round_complete(node) && host_now() <= deadline(node))
                return;
            node_close_round(node);
            node->round++;
        }
        if (!node_open_round(node))
            end_sample(node);
    }
}

/* ---- messages ---- */

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

static void on_clock(void *user, const char *channel, const uint8_t *bytes, int length)
{
    (void)channel;
    struct node *node = user;
    dse_clock_t message;
    if (!message_clock(bytes, length, &node->counters, &message))
        return;
    bool same = message.scenario_hash == (int64_t)node->config.scenario->hash;
    bool replay = node->config.pace == DSE_CLOCK_T_PACE_REPLAY;
    if (node->source_run == 0 && (same || (replay && message.event == DSE_CLOCK_T_EVENT_START)))
        adopt_run(node, message.header.run_id);
    if (!from_source(node, &message.header))
        return;
    if (!same && !replay) {
        node_fail(node, "the plant of this run reads another scenario than %s",
                  node->config.scenario->file);
        return;
    }
    if (message.event == DSE_CLOCK_T_EVENT_JOIN && !node->started)
        publish_status(node, DSE_STATUS_T_STATE_READY);
    if (message.event == DSE_CLOCK_T_EVENT_START)
        start(node);
    if (message.event == DSE_CLOCK_T_EVENT_STOP && node->started && !node->stopping) {
        node->stopping = true;
        node->stop_at = message.header.sample;
        node->linger_until = host_now() + (replay ? REPLAY_LINGER : 0);
    } else if (message.event == DSE_CLOCK_T_EVENT_STOP && !node->started && !replay) {
        finish(node);
    }
}

/* Two processes for one node: the one that came later leaves; of two that join, the one with the
 * larger random number. */
static void on_status(void *user, const char *channel, const uint8_t *bytes, int length)
{
    (void)channel;
    struct node *node = user;
    dse_status_t message;
    if (!message_status(bytes, length, &node->counters, &message))
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
        publish_status(node,
                       node->started ? DSE_STATUS_T_STATE_RUNNING : DSE_STATUS_T_STATE_JOINING);
}

static void on_input(void *user, const char *channel, const uint8_t *bytes, int length)
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
    start(node); /* the message that said so may have been lost */
    bool repeated = message.header.sample == node->k - 1 && node->phase == NODE_WAIT_SAMPLE;
    if (repeated && message.part == 0)
        repeat_done(node); /* the clock still waits for this sample: our `done` was lost */
    node_take_input(node, &message);
    node_advance(node);
}

static void on_measurement(void *user, const char *channel, const uint8_t *bytes, int length)
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

static void on_exchange(void *user, const char *channel, const uint8_t *bytes, int length)
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

/* ---- time ---- */

static double poll_joining(struct node *node, double now)
{
    if (now >= node->last_status + STATUS_PERIOD_JOINING)
        publish_status(node, DSE_STATUS_T_STATE_JOINING);
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
    else if (node->k > 0 && node->config.pace == DSE_CLOCK_T_PACE_LOCKSTEP) {
        /* Our last `done`, said again, asks the clock for the sample that we miss. */
        repeat_done(node);
        node->asked++;
    }
}

static bool may_finish(const struct node *node, double now)
{
    if (!node->stopping)
        return false;
    bool all = node->k >= node->stop_at && node->phase == NODE_WAIT_SAMPLE;
    return (all && now >= node->linger_until) || now >= node->linger_until + give_up_s(node);
}

static double poll_node(void *self, double now)
{
    struct node *node = self;
    if (node->state == AGENT_JOINING)
        return poll_joining(node, now);
    node_advance(node);
    if (node->state != AGENT_RUNNING)
        return now;
    if (may_finish(node, now)) {
        if (node->k < node->stop_at)
            node_report_gap(node, node->k, node->stop_at - node->k);
        finish(node);
        return now;
    }
    if (now >= node->last_status + STATUS_PERIOD_RUNNING)
        publish_status(node, DSE_STATUS_T_STATE_RUNNING);
    double since =
        fmax(node->last_progress, node->phase == NODE_IN_ROUND ? node->round_started : 0);
    bool patient = node->config.pace == DSE_CLOCK_T_PACE_REPLAY && node->phase == NODE_WAIT_SAMPLE;
    if (now > since + give_up_s(node) && !patient)
        give_up(node);
    else if (now >= node->last_repeat + repeat_s(node) && !node->stopping) {
        repeat_request(node);
        node->last_repeat = now;
    }
    double next = node->last_repeat + repeat_s(node);
    if (node->phase == NODE_IN_ROUND)
        next = fmin(next, deadline(node) + 1e-4);
    return node->stopping ? fmin(next, fmax(node->linger_until, now + 0.01)) : next;
}

static enum agent_state state_of(const void *self)
{
    return ((const struct node *)self)->state;
}

static const char *reason_of(const void *self)
{
    return ((const struct node *)self)->reason;
}

static void stop(void *self, const char *reason)
{
    struct node *node = self;
    if (node->state == AGENT_FINISHED || node->state == AGENT_FAILED)
        return;
    snprintf(node->reason, sizeof node->reason, "%s", reason);
    finish(node);
}

/* ---- making it ---- */

static void destroy(void *self)
{
    struct node *node = self;
    if (node == NULL)
        return;
    if (node->instance != NULL)
        node->method->destroy(node->instance);
    node_samples_destroy(node);
    node_rounds_destroy(node);
    free(node->values);
    free(node->prepared);
    free(node);
}

static bool set_up(struct method_setup *setup, const struct scenario *scenario, int network,
                   const struct method **method)
{
    const struct scenario_network *section = &scenario->networks[network];
    int index = scenario_method(section);
    *method = method_at(index);
    setup->scenario = scenario;
    setup->network = section;
    setup->section = section->section[index];
    setup->process = scenario->process;
    setup->period = scenario_period(scenario);
    return *method != NULL;
}

int node_count(const struct scenario *scenario, int network, bool *coordinator, struct error *error)
{
    struct method_setup setup = {0};
    const struct method *method;
    if (!set_up(&setup, scenario, network, &method)) {
        error_set(error, "network %s has no method", scenario->networks[network].name);
        return -1;
    }
    if (coordinator != NULL)
        *coordinator = method->has_coordinator != NULL && method->has_coordinator(&setup);
    return method->nodes(&setup);
}

static bool subscribe(struct node *node, struct error *error)
{
    char channel[CHANNEL_LENGTH];
    bool ok = bus_subscribe(node->bus, CHANNEL_CLOCK, on_clock, node, error) &&
              bus_subscribe(node->bus, CHANNEL_STATUS, on_status, node, error) &&
              bus_subscribe(node->bus, CHANNEL_INPUT, on_input, node, error);
    for (int g = 0; ok && g < node->info.n_groups; g++) {
        snprintf(channel, sizeof channel, CHANNEL_MEASUREMENT, node->info.groups[g]);
        ok = bus_subscribe(node->bus, channel, on_measurement, node, error);
    }
    /* Those that it hears, and those that hear it: they may ask for what they missed. */
    bool *linked = calloc(METHOD_MAX_NODES, sizeof *linked);
    ok = ok && linked != NULL;
    for (int j = 0; ok && j < node->info.n_neighbours; j++)
        linked[node->info.neighbours[j]] = true;
    for (int j = 0; ok && j < node->info.n_listeners; j++)
        linked[node->info.listeners[j]] = true;
    for (int j = 0; ok && j < METHOD_MAX_NODES; j++) {
        if (!linked[j])
            continue;
        snprintf(channel, sizeof channel, CHANNEL_EXCHANGE, node->config.network, j);
        ok = bus_subscribe(node->bus, channel, on_exchange, node, error);
    }
    free(linked);
    return ok;
}

static bool make_instance(struct node *node, struct error *error)
{
    const struct dse_plant *process = node->setup.process;
    node->values = calloc((size_t)process->n_parameters + 1, sizeof *node->values);
    node->prepared = calloc((size_t)process->prepared_size + 1, sizeof *node->prepared);
    if (node->values == NULL || node->prepared == NULL)
        return error_set(error, "out of memory");
    if (!scenario_prepare_plant(node->config.scenario, node->network, node->values, node->prepared,
                                error))
        return false;
    node->setup.prepared = node->prepared;
    node->setup.node = node->config.node;
    node->instance = node->method->create(&node->setup, &node->info, error);
    if (node->instance == NULL)
        return error_set(error, "cannot make node %d of network %s", node->config.node,
                         node->network->name);
    return true;
}

static bool set_identity(struct node *node, struct error *error)
{
    bool coordinator;
    int nodes = node_count(node->config.scenario, node->config.network, &coordinator, error);
    if (nodes < 0)
        return false;
    if (node->config.node < 0 || node->config.node >= nodes)
        return error_set(error, "network %s has the nodes 0 to %d: there is no node %d",
                         node->network->name, nodes - 1, node->config.node);
    bool is_coordinator = coordinator && node->config.node == nodes - 1;
    node->sender.bus = node->bus;
    node->sender.id.run_id = node->config.run_id;
    node->sender.id.network = (int8_t)node->config.network;
    node->sender.id.node = (int16_t)node->config.node;
    node->sender.id.role =
        is_coordinator ? DSE_HEADER_T_ROLE_COORDINATOR : DSE_HEADER_T_ROLE_ESTIMATOR;
    if (node->config.pace != DSE_CLOCK_T_PACE_REPLAY)
        node->source_run = node->config.run_id;
    node->estimate_hash = FINGERPRINT_START;
    if (getrandom(&node->instance_id, sizeof node->instance_id, 0) < 0)
        node->instance_id = (int64_t)getpid();
    return true;
}

bool node_create(const struct node_config *config, struct bus *bus, struct agent *agent,
                 struct error *error)
{
    struct node *node = calloc(1, sizeof *node);
    if (node == NULL)
        return error_set(error, "out of memory");
    node->config = *config;
    node->bus = bus;
    node->network = &config->scenario->networks[config->network];
    bool ok = set_up(&node->setup, config->scenario, config->network, &node->method) &&
              set_identity(node, error) && make_instance(node, error) &&
              node_samples_create(node, error) && node_rounds_create(node, error) &&
              subscribe(node, error);
    if (!ok) {
        destroy(node);
        return error_set(error, "cannot make node %d of network %d", config->node, config->network);
    }
    snprintf(node->name, sizeof node->name, "node %d (%.40s) of network %.20s", config->node,
             node->info.name, node->network->name);
    snprintf(agent->name, sizeof agent->name, "%s", node->name);
    agent->self = node;
    agent->poll = poll_node;
    agent->state = state_of;
    agent->reason = reason_of;
    agent->stop = stop;
    agent->destroy = destroy;
    return true;
}

const struct method_info *node_info(const struct agent *agent)
{
    return &((const struct node *)agent->self)->info;
}

uint64_t node_estimate_hash(const struct agent *agent, int64_t *samples)
{
    const struct node *node = agent->self;
    *samples = node->k;
    return node->estimate_hash;
}
