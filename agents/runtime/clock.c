/* The sample clock: its life in time. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/random.h>
#include <time.h>

#include "runtime/channels.h"
#include "runtime/clock_internal.h"
#include "runtime/run_info.h"

#define JOIN_PERIOD 0.1  /* s between two invitations */
#define STOP_PERIOD 0.05 /* s between two announcements of the end */
#define STOP_PATIENCE                                                                              \
    1.0                     /* s until the clock leaves although not all have said that they ended \
                             */
#define REALTIME_GRACE  0.5 /* s after the last sample of a realtime run */
#define DEFAULT_REPEAT  0.05
#define DEFAULT_GIVE_UP 20.0

double clock_repeat_s(const struct clock *clock)
{
    double given = clock->config.scenario->timeouts.repeat_s;
    return given > 0 ? given : DEFAULT_REPEAT;
}

void clock_publish(struct clock *clock, int event)
{
    dse_clock_t message = {.scenario_hash = (int64_t)clock->config.scenario->hash,
                           .samples = clock->config.samples,
                           .period = scenario_period(clock->config.scenario),
                           .event = (int8_t)event,
                           .pace = (int8_t)clock->config.pace,
                           .complete = (int8_t)clock->complete};
    sender_clock(&clock->sender, clock->k + 1, clock->data.t, &message);
}

void clock_begin_stop(struct clock *clock)
{
    clock->phase = STOPPING;
    clock->began = host_now();
    announcement_repeat(&clock->announcement, &clock->sender, clock->began);
    clock->repeated = clock->began;
    clock_publish(clock, DSE_CLOCK_T_EVENT_STOP);
}

/* The run ends at once; the clock itself ends as failed when the others have heard of it. */
void clock_fail(struct clock *clock, const char *format, ...)
{
    if (clock->failing)
        return;
    clock->failing = true;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(clock->reason, sizeof clock->reason, format, arguments);
    va_end(arguments);
    clock_begin_stop(clock);
}

static double realtime_due(const struct clock *clock, int64_t k)
{
    double speed = clock->config.speed > 0 ? clock->config.speed : 1;
    return clock->began + (double)k * clock->config.scenario->time.period_s / speed;
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
    clock_publish(clock, DSE_CLOCK_T_EVENT_START);
    clock_next_sample(clock);
}

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
        clock_member_name(clock, first, name, (int)sizeof name);
        char text[32];
        snprintf(text, sizeof text, " --node %d", first->node);
        clock_fail(clock, "%s%s did not join within %g s; start it with: dse-%s %s%s", name,
                   missing > 1 ? " (and others)" : "", clock->config.join_s,
                   first->coordinator ? "coordinator" : "estimator", clock->config.scenario->file,
                   first->coordinator ? "" : text);
        return now;
    }
    if (now >= clock->repeated + JOIN_PERIOD) {
        clock_publish(clock, DSE_CLOCK_T_EVENT_JOIN);
        clock->repeated = now;
    }
    return clock->repeated + JOIN_PERIOD;
}

static double poll_lockstep(struct clock *clock, double now)
{
    double given = clock->config.scenario->timeouts.give_up_s;
    double give_up = given > 0 ? given : DEFAULT_GIVE_UP;
    double repeat = clock_repeat_s(clock);
    if (now > clock->published + give_up + 1) {
        /* One second later than the nodes: who knows more about the cause speaks first. */
        char name[96];
        for (int i = 0; i < clock->n_members; i++)
            if (clock_is_undone(clock, &clock->members[i])) {
                clock_fail(clock,
                           "%s has not finished sample %lld within %g s; its last sample was %lld",
                           clock_member_name(clock, &clock->members[i], name, (int)sizeof name),
                           (long long)clock->k, give_up, (long long)clock->members[i].done);
                return now;
            }
        clock_fail(clock, "the recorder has not received sample %lld within %g s",
                   (long long)(clock->k - clock->config.recorder_lag), give_up);
        return now;
    }
    clock_go_on_without(clock, now);
    if (now >= clock->repeated + 2 * repeat && clock_count_undone(clock) > 0) {
        clock_publish_sample(clock, true);
        clock->repeated = now;
    }
    return fmax(clock->repeated + 2 * repeat, now + 0.01);
}

static double poll_realtime(struct clock *clock, double now)
{
    bool last = clock->k + 1 >= clock->config.samples;
    double due = last ? clock->published + REALTIME_GRACE : realtime_due(clock, clock->k + 1);
    if (last && clock_count_undone(clock) == 0)
        due = now;
    if (now >= due) {
        clock_next_sample(clock);
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
        clock_publish(clock, DSE_CLOCK_T_EVENT_STOP);
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
    clock_begin_stop(clock);
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
    if (clock->y_group == NULL || clock->valid_group == NULL ||
        !clock_gather_members(clock, error) ||
        !bus_subscribe(bus, CHANNEL_STATUS, clock_on_status, clock, error) ||
        !bus_subscribe(bus, CHANNEL_DONE, clock_on_done, clock, error)) {
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
