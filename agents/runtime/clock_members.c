/* Who takes part in a run: nodes that join, are done, leave, and come again. */
#include <stdio.h>
#include <stdlib.h>

#include "runtime/clock_internal.h"
#include "runtime/networks.h"

#define QUIET 2.5 /* s without a word: a process that runs says one a second */

const char *clock_member_name(const struct clock *clock, const struct member *member, char *text,
                              int size)
{
    snprintf(text, (size_t)size, "node %d of network %s", member->node,
             clock->config.scenario->networks[member->network].name);
    return text;
}

bool clock_gather_members(struct clock *clock, struct error *error)
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

bool clock_is_undone(const struct clock *clock, const struct member *member)
{
    return !member->absent && member->done < clock->k;
}

int clock_count_undone(const struct clock *clock)
{
    int undone = 0;
    for (int i = 0; i < clock->n_members; i++)
        undone += clock_is_undone(clock, &clock->members[i]);
    return undone;
}

/* The member takes part from the next sample on. All hear of it; only who needs it heeds it. */
static void let_in(struct clock *clock, struct member *member)
{
    member->absent = false;
    member->done = member->done > clock->k ? member->done : clock->k;
    clock_publish(clock, DSE_CLOCK_T_EVENT_START);
    clock_advance(clock);
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
void clock_go_on_without(struct clock *clock, double now)
{
    double patience = 2 * scenario_patience_s(clock->config.scenario);
    bool others = true;
    for (int i = 0; i < clock->n_members; i++)
        others = others &&
                 (clock->members[i].coordinated || !clock_is_undone(clock, &clock->members[i]));
    if (!others || now <= clock->published + patience)
        return;
    for (int i = 0; i < clock->n_members; i++)
        if (clock_is_undone(clock, &clock->members[i]))
            clock->members[i].absent = true;
    clock_advance(clock);
}

/* A member that takes part has left. */
static void take_leave(struct clock *clock, struct member *member, const dse_status_t *message)
{
    if (member->coordinated) {
        member->absent = true;
        clock_advance(clock);
        return;
    }
    char name[96];
    int length = message->reason_length;
    if (length < 0 || length > (int)sizeof message->reason)
        length = 0;
    clock_fail(clock, "%s left at sample %lld: %.*s",
               clock_member_name(clock, member, name, (int)sizeof name), (long long)clock->k,
               length, (const char *)message->reason);
}

void clock_on_status(void *user, const char *channel, const uint8_t *bytes, int length)
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
    if (clock->phase != WAITING || now < clock->repeated + 0.5 * clock_repeat_s(clock))
        return;
    clock_publish_sample(clock, true);
    clock->repeated = now;
}

void clock_on_done(void *user, const char *channel, const uint8_t *bytes, int length)
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
        clock_advance(clock);
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
        clock_advance(clock);
    } else if (message.header.sample == member->done && member->done == clock->k - 1) {
        answer_repetition(clock); /* said again: it misses the present sample */
    }
}
