/* The sample clock. */
#include "runtime/clock.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <time.h>

#include "runtime/announcement.h"
#include "runtime/channels.h"
#include "runtime/networks.h"
#include "runtime/node.h"
#include "runtime/run_info.h"
#include "runtime/sender.h"

#define JOIN_PERIOD 0.1  /* s between two invitations */
#define STOP_PERIOD 0.05 /* s between two announcements of the end */
#define STOP_PATIENCE                                                                              \
    1.0                     /* s until the clock leaves although not all have said that they ended \
                             */
#define REALTIME_GRACE  0.5 /* s after the last sample of a realtime run */
#define DEFAULT_REPEAT  0.05
#define DEFAULT_GIVE_UP 20.0
#define QUIET           2.5 /* s without a word: a process that runs says one a second */

enum phase { JOINING, WAITING, PAUSING, STOPPING };

struct member {
    int network;
    int node;
    bool coordinator;
    bool coordinated; /* of a network with a coordinator: the others can go on without it */
    bool ready;
    bool finished;
    bool late;        /* it has joined while the run was going on */
    bool absent;      /* it is not waited for until it has caught up */
    int64_t instance; /* of the process that serves it */
    int64_t done;     /* last sample that it finished, -1; while it is absent it counts as done */
    double heard;     /* when it last said something */
};

struct clock {
    struct clock_config config;
    struct sender sender;
    struct announcement announcement; /* the plant's run_info */
    struct message_counters counters;
    struct member *members;
    int n_members;
    enum phase phase;
    enum agent_state state;
    char reason[512];
    bool complete;
    bool failing;

    int64_t k; /* sample that has been published last, -1 */
    struct sample_data data;
    double *y_group;
    bool *valid_group;
    int32_t input_sequence;
    int32_t measurement_sequence;
    double published; /* when sample k was published */
    double repeated;
    double began;     /* joining, stopping: when it began; realtime: when sample 0 was due */
    int64_t recorded; /* newest sample that the recorder has received, -1 */
};

static double repeat_s(const struct clock *clock)
{
    double given = clock->config.scenario->timeouts.repeat_s;
    return given > 0 ? given : DEFAULT_REPEAT;
}

static void fail(struct clock *clock, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

static void publish_clock(struct clock *clock, int event)
{
    dse_clock_t message = {.scenario_hash = (int64_t)clock->config.scenario->hash,
                           .samples = clock->config.samples,
                           .period = scenario_period(clock->config.scenario),
                           .event = (int8_t)event,
                           .pace = (int8_t)clock->config.pace,
                           .complete = (int8_t)clock->complete};
    sender_clock(&clock->sender, clock->k + 1, clock->data.t, &message);
}

static void begin_stop(struct clock *clock)
{
    clock->phase = STOPPING;
    clock->began = host_now();
    announcement_repeat(&clock->announcement, &clock->sender, clock->began);
    clock->repeated = clock->began;
    publish_clock(clock, DSE_CLOCK_T_EVENT_STOP);
}

/* The run ends at once; the clock itself ends as failed when the others have heard of it. */
static void fail(struct clock *clock, const char *format, ...)
{
    if (clock->failing)
        return;
    clock->failing = true;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(clock->reason, sizeof clock->reason, format, arguments);
    va_end(arguments);
    begin_stop(clock);
}

/* ---- who takes part ---- */

static const char *member_name(const struct clock *clock, const struct member *member, char *text,
                               int size)
{
    snprintf(text, (size_t)size, "node %d of network %s", member->node,
             clock->config.scenario->networks[member->network].name);
    return text;
}

static bool gather_members(struct clock *clock, struct error *error)
{
    const struct scenario *scenario = clock->config.scenario;
    for (int pass = 0; pass < 2; pass++) {
        int count = 0;
        for (unsigned i = 0; i < scenario->networks_count; i++) {
            bool coordinated;
            int nodes = network_nodes(scenario, (int)i, &coordinated, error);
            if (nodes < 0)
                return false;
            for (int node = 0; node < nodes; node++, count++)
                if (pass == 1)
                    clock->members[count] =
                        (struct member){.network = (int)i,
                                        .node = node,
                                        .coordinator = coordinated && node == nodes - 1,
                                        .coordinated = coordinated,
                                        .done = -1};
        }
        clock->n_members = count;
        if (pass == 0)
            clock->members = calloc((size_t)count + 1, sizeof *clock->members);
        if (clock->members == NULL)
            return error_set(error, "out of memory");
    }
    return true;
}

static struct member *member_of(struct clock *clock, const dse_header_t *header)
{
    for (int i = 0; i < clock->n_members; i++)
        if (clock->members[i].network == header->network && clock->members[i].node == header->node)
            return &clock->members[i];
    return NULL;
}

/* ---- samples ---- */

static void publish_measurement(struct clock *clock, int group, bool again)
{
    const struct dse_subsystem *subsystem = &clock->config.scenario->process->subsystems[group];
    for (int i = 0; i < subsystem->n_outputs; i++) {
        int output = subsystem->outputs[i];
        clock->y_group[i] = clock->data.y[output];
        clock->valid_group[i] = clock->data.valid == NULL || clock->data.valid[output];
    }
    static const int32_t fresh = -1;
    int32_t sequence = again ? clock->measurement_sequence : fresh;
    sender_measurement(&clock->sender, clock->k, clock->data.t, sequence, group, clock->k,
                       clock->y_group, clock->valid_group, subsystem->n_outputs);
    clock->measurement_sequence += again ? message_parts(subsystem->n_outputs) : 0;
}

/* Input first: it opens the sample; the measurements complete it. */
static void publish_sample(struct clock *clock, bool again)
{
    const struct dse_plant *process = clock->config.scenario->process;
    int32_t first_input =
        again ? clock->input_sequence : sender_sequence(&clock->sender, SENDER_INPUT);
    int32_t first_measurement =
        again ? clock->measurement_sequence : sender_sequence(&clock->sender, SENDER_MEASUREMENT);
    if (!again && clock->data.x != NULL)
        sender_truth(&clock->sender, clock->k, clock->data.t, clock->data.x,
                     process->nx + process->n_unknown);
    sender_input(&clock->sender, clock->k, clock->data.t, again ? first_input : -1, clock->data.u,
                 process->nu);
    for (int group = 0; group < process->n_subsystems; group++)
        publish_measurement(clock, group, again);
    clock->input_sequence = first_input;
    clock->measurement_sequence = first_measurement;
}

static double realtime_due(const struct clock *clock, int64_t k)
{
    double speed = clock->config.speed > 0 ? clock->config.speed : 1;
    return clock->began + (double)k * clock->config.scenario->time.period_s / speed;
}

static bool is_undone(const struct clock *clock, const struct member *member)
{
    return !member->absent && member->done < clock->k;
}

static int count_undone(const struct clock *clock)
{
    int undone = 0;
    for (int i = 0; i < clock->n_members; i++)
        undone += is_undone(clock, &clock->members[i]);
    return undone;
}

static bool recorder_behind(const struct clock *clock)
{
    int lag = clock->config.recorder_lag;
    return lag > 0 && clock->k + 1 < clock->config.samples && clock->recorded < clock->k - lag;
}

static void next_sample(struct clock *clock)
{
    if (clock->k + 1 >= clock->config.samples) {
        clock->complete = true;
        begin_stop(clock);
        return;
    }
    char reason[256] = "";
    if (!clock->config.source.next(clock->config.source.self, clock->k + 1, &clock->data, reason,
                                   (int)sizeof reason)) {
        fail(clock, "no sample after %lld: %s", (long long)clock->k, reason);
        return;
    }
    clock->k++;
    publish_sample(clock, false);
    clock->published = host_now();
    clock->repeated = clock->published;
    clock->phase = WAITING;
}

/* Goes on once everybody is done; a realtime clock goes on when the next sample is due. */
static void advance(struct clock *clock)
{
    if (clock->phase != WAITING || clock->state != AGENT_RUNNING)
        return;
    if (clock->config.pace == DSE_CLOCK_T_PACE_LOCKSTEP && count_undone(clock) == 0 &&
        !recorder_behind(clock))
        next_sample(clock);
}

static void start_run(struct clock *clock)
{
    clock->state = AGENT_RUNNING;
    clock->began = host_now();
    for (int i = 0; i < clock->n_members; i++)
        clock->members[i].heard = clock->began;
    char *json = run_info_plant(clock->config.scenario, clock->config.run_id, clock->config.pace,
                                clock->config.samples);
    announcement_begin(&clock->announcement, &clock->sender, json, clock->began);
    publish_clock(clock, DSE_CLOCK_T_EVENT_START);
    next_sample(clock);
}

/* ---- members that come and go ---- */

/* The member takes part from the next sample on. All hear of it; only who needs it heeds it. */
static void let_in(struct clock *clock, struct member *member)
{
    member->absent = false;
    member->done = member->done > clock->k ? member->done : clock->k;
    publish_clock(clock, DSE_CLOCK_T_EVENT_START);
    advance(clock);
}

/* Somebody wants to join a run that is going on: in the place of a process that is silent, or
 * because it has missed that the run began. In a lockstep run the latter is told by the sample
 * that is repeated until it is done. */
static void take_latecomer(struct clock *clock, struct member *member, int64_t instance)
{
    double now = host_now();
    bool same = instance == member->instance;
    bool waits = member->late || clock->config.pace == DSE_CLOCK_T_PACE_REALTIME;
    bool silent = member->absent || now > member->heard + QUIET;
    if (same ? !waits : !silent)
        return;
    member->instance = instance;
    member->late = true;
    member->heard = now;
    let_in(clock, member);
}

/* The others of its network have used up their patience with it, or are about to. */
static void go_on_without(struct clock *clock, double now)
{
    double patience = 2 * scenario_patience_s(clock->config.scenario);
    bool others = true;
    for (int i = 0; i < clock->n_members; i++)
        others = others && (clock->members[i].coordinated || !is_undone(clock, &clock->members[i]));
    if (!others || now <= clock->published + patience)
        return;
    for (int i = 0; i < clock->n_members; i++)
        if (is_undone(clock, &clock->members[i]))
            clock->members[i].absent = true;
    advance(clock);
}

/* A member that takes part has left. */
static void take_leave(struct clock *clock, struct member *member, const dse_status_t *message)
{
    if (member->coordinated) {
        member->absent = true;
        advance(clock);
        return;
    }
    char name[96];
    int length = message->reason_length;
    if (length < 0 || length > (int)sizeof message->reason)
        length = 0;
    fail(clock, "%s left at sample %lld: %.*s", member_name(clock, member, name, (int)sizeof name),
         (long long)clock->k, length, (const char *)message->reason);
}

/* ---- messages ---- */

static void on_status(void *user, const char *channel, const uint8_t *bytes, int length)
{
    (void)channel;
    struct clock *clock = user;
    dse_status_t message;
    if (!message_status(bytes, length, &clock->counters, &message))
        return;
    bool seeks = message.header.run_id == 0 && message.state == DSE_STATUS_T_STATE_JOINING;
    if (message.header.run_id != clock->config.run_id && !seeks)
        return;
    struct member *member = member_of(clock, &message.header);
    if (member == NULL || message.scenario_hash != (int64_t)clock->config.scenario->hash)
        return;
    if (message.state == DSE_STATUS_T_STATE_READY && !member->ready) {
        member->ready = true;
        member->instance = message.instance;
    }
    bool going = clock->phase != JOINING && clock->phase != STOPPING;
    if (going && message.state == DSE_STATUS_T_STATE_JOINING)
        take_latecomer(clock, member, message.instance);
    if (message.instance != member->instance)
        return; /* a second process for this node, which leaves by itself */
    member->heard = host_now();
    if (message.state == DSE_STATUS_T_STATE_FINISHED)
        member->finished = true;
    if (message.state == DSE_STATUS_T_STATE_FAILED && clock->phase == JOINING)
        member->ready = false;
    if (going && member->ready && message.state >= DSE_STATUS_T_STATE_FINISHED)
        take_leave(clock, member, &message);
}

/* Not to every repetition: several nodes may miss the same sample, and a repetition may be an old
 * message on a slow way. */
static void answer_repetition(struct clock *clock)
{
    double now = host_now();
    if (clock->phase != WAITING || now < clock->repeated + 0.5 * repeat_s(clock))
        return;
    publish_sample(clock, true);
    clock->repeated = now;
}

static void on_done(void *user, const char *channel, const uint8_t *bytes, int length)
{
    (void)channel;
    struct clock *clock = user;
    dse_done_t message;
    if (!message_done(bytes, length, &clock->counters, &message) ||
        message.header.run_id != clock->config.run_id || clock->state != AGENT_RUNNING)
        return;
    if (message.header.role == DSE_HEADER_T_ROLE_RUN) {
        if (message.header.sample > clock->recorded)
            clock->recorded = message.header.sample;
        advance(clock);
        return;
    }
    struct member *member = member_of(clock, &message.header);
    if (member == NULL)
        return;
    member->heard = host_now();
    if (member->absent) {
        let_in(clock, member);
        return;
    }
    if (message.header.sample > member->done && message.header.sample <= clock->k) {
        member->done = message.header.sample;
        advance(clock);
    } else if (message.header.sample == member->done && member->done == clock->k - 1) {
        answer_repetition(clock); /* said again: it misses the present sample */
    }
}

/* ---- time ---- */

static double poll_joining(struct clock *clock, double now)
{
    int missing = 0;
    struct member *first = NULL;
    for (int i = 0; i < clock->n_members; i++)
        if (!clock->members[i].ready) {
            first = first == NULL ? &clock->members[i] : first;
            missing++;
        }
    if (missing == 0) {
        start_run(clock);
        return now;
    }
    char name[96];
    if (clock->config.join_s > 0 && now > clock->began + clock->config.join_s) {
        member_name(clock, first, name, (int)sizeof name);
        char text[32];
        snprintf(text, sizeof text, " --node %d", first->node);
        fail(clock, "%s%s did not join within %g s; start it with: dse-%s %s%s", name,
             missing > 1 ? " (and others)" : "", clock->config.join_s,
             first->coordinator ? "coordinator" : "estimator", clock->config.scenario->file,
             first->coordinator ? "" : text);
        return now;
    }
    if (now >= clock->repeated + JOIN_PERIOD) {
        publish_clock(clock, DSE_CLOCK_T_EVENT_JOIN);
        clock->repeated = now;
    }
    return clock->repeated + JOIN_PERIOD;
}

static double poll_lockstep(struct clock *clock, double now)
{
    double given = clock->config.scenario->timeouts.give_up_s;
    double give_up = given > 0 ? given : DEFAULT_GIVE_UP;
    double repeat = repeat_s(clock);
    if (now > clock->published + give_up + 1) {
        /* One second later than the nodes: who knows more about the cause speaks first. */
        char name[96];
        for (int i = 0; i < clock->n_members; i++)
            if (is_undone(clock, &clock->members[i])) {
                fail(clock, "%s has not finished sample %lld within %g s; its last sample was %lld",
                     member_name(clock, &clock->members[i], name, (int)sizeof name),
                     (long long)clock->k, give_up, (long long)clock->members[i].done);
                return now;
            }
        fail(clock, "the recorder has not received sample %lld within %g s",
             (long long)(clock->k - clock->config.recorder_lag), give_up);
        return now;
    }
    go_on_without(clock, now);
    if (now >= clock->repeated + 2 * repeat && count_undone(clock) > 0) {
        publish_sample(clock, true);
        clock->repeated = now;
    }
    return fmax(clock->repeated + 2 * repeat, now + 0.01);
}

static double poll_realtime(struct clock *clock, double now)
{
    bool last = clock->k + 1 >= clock->config.samples;
    double due = last ? clock->published + REALTIME_GRACE : realtime_due(clock, clock->k + 1);
    if (last && count_undone(clock) == 0)
        due = now;
    if (now >= due) {
        next_sample(clock);
        return now;
    }
    return due;
}

static double poll_stopping(struct clock *clock, double now)
{
    bool all = true;
    for (int i = 0; i < clock->n_members; i++)
        all = all &&
              (clock->members[i].finished || clock->members[i].absent || !clock->members[i].ready);
    if (all || now > clock->began + STOP_PATIENCE) {
        clock->state = clock->failing ? AGENT_FAILED : AGENT_FINISHED;
        return now;
    }
    if (now >= clock->repeated + STOP_PERIOD) {
        publish_clock(clock, DSE_CLOCK_T_EVENT_STOP);
        clock->repeated = now;
    }
    return clock->repeated + STOP_PERIOD;
}

static double poll_clock(void *self, double now)
{
    struct clock *clock = self;
    announcement_poll(&clock->announcement, &clock->sender, now);
    switch (clock->phase) {
    case JOINING:
        return poll_joining(clock, now);
    case STOPPING:
        return poll_stopping(clock, now);
    default:
        return clock->config.pace == DSE_CLOCK_T_PACE_LOCKSTEP ? poll_lockstep(clock, now)
                                                               : poll_realtime(clock, now);
    }
}

static enum agent_state state_of(const void *self)
{
    return ((const struct clock *)self)->state;
}

static const char *reason_of(const void *self)
{
    return ((const struct clock *)self)->reason;
}

static void stop(void *self, const char *reason)
{
    struct clock *clock = self;
    if (clock->phase == STOPPING)
        return;
    snprintf(clock->reason, sizeof clock->reason, "%s", reason);
    begin_stop(clock);
}

static void destroy(void *self)
{
    struct clock *clock = self;
    if (clock->config.source.destroy != NULL)
        clock->config.source.destroy(clock->config.source.self);
    announcement_free(&clock->announcement);
    free(clock->members);
    free(clock->y_group);
    free(clock->valid_group);
    free(clock);
}

bool clock_create(const struct clock_config *config, struct bus *bus, struct agent *agent,
                  struct error *error)
{
    struct clock *clock = calloc(1, sizeof *clock);
    if (clock == NULL) {
        config->source.destroy(config->source.self);
        return error_set(error, "out of memory");
    }
    clock->config = *config;
    clock->k = -1;
    clock->recorded = -1;
    clock->began = host_now();
    clock->sender.bus = bus;
    clock->sender.id.run_id = config->run_id;
    clock->sender.id.role = DSE_HEADER_T_ROLE_PLANT;
    clock->sender.id.network = -1;
    size_t ny = (size_t)config->scenario->process->ny + 1;
    clock->y_group = calloc(ny, sizeof *clock->y_group);
    clock->valid_group = calloc(ny, sizeof *clock->valid_group);
    if (clock->y_group == NULL || clock->valid_group == NULL || !gather_members(clock, error) ||
        !bus_subscribe(bus, CHANNEL_STATUS, on_status, clock, error) ||
        !bus_subscribe(bus, CHANNEL_DONE, on_done, clock, error)) {
        destroy(clock);
        return error_set(error, "cannot make the plant's clock");
    }
    snprintf(agent->name, sizeof agent->name, "plant %s", config->scenario->plant.name);
    agent->self = clock;
    agent->poll = poll_clock;
    agent->state = state_of;
    agent->reason = reason_of;
    agent->stop = stop;
    agent->destroy = destroy;
    return true;
}

int64_t clock_new_run_id(void)
{
    uint32_t random = 0;
    if (getrandom(&random, sizeof random, 0) < 0)
        random = (uint32_t)host_now();
    int64_t seconds = (int64_t)time(NULL);
    return (seconds << 24) | (int64_t)(random & 0xffffffU) | 1;
}
