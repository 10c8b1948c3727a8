/* The exchange with the neighbours, round by round. Messages are handed to the method in the order
 * of the senders, not of their arrival, so that scheduling never changes a result. Who misses a
 * message asks for it by name; who is named says it again. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/node_internal.h"

#define LONGEST_ASK_INTERVAL 1.0 /* s */

bool node_rounds_create(struct node *node, struct error *error)
{
    node->inboxes = calloc((size_t)node->info.n_neighbours + 1, sizeof *node->inboxes);
    node->outgoing = calloc(METHOD_MESSAGE_CAPACITY, sizeof *node->outgoing);
    if (node->inboxes == NULL || node->outgoing == NULL)
        return error_set(error, "out of memory");
    for (int j = 0; j < node->info.n_neighbours; j++) {
        node->inboxes[j].from = node->info.neighbours[j];
        for (int s = 0; s < NODE_INBOX; s++)
            node->inboxes[j].slots[s].k = -1;
    }
    for (int i = 0; i < NODE_HISTORY; i++)
        node->history[i].k = -1;
    return true;
}

void node_rounds_destroy(struct node *node)
{
    for (int j = 0; node->inboxes != NULL && j < node->info.n_neighbours; j++)
        for (int s = 0; s < NODE_INBOX; s++)
            free(node->inboxes[j].slots[s].vector.value);
    for (int i = 0; i < NODE_HISTORY; i++)
        free(node->history[i].value);
    free(node->inboxes);
    free(node->outgoing);
}

static bool is_over(const struct node *node, int64_t k, int round)
{
    return k < node->k || (k == node->k && node->phase == NODE_IN_ROUND && round < node->round);
}

static struct inbox *inbox_of(struct node *node, int from)
{
    for (int j = 0; j < node->info.n_neighbours; j++)
        if (node->inboxes[j].from == from)
            return &node->inboxes[j];
    return NULL;
}

static struct inbox_slot *find_slot(struct inbox *inbox, int64_t k, int round)
{
    for (int s = 0; s < NODE_INBOX; s++)
        if (inbox->slots[s].k == k && inbox->slots[s].round == round)
            return &inbox->slots[s];
    return NULL;
}

static bool is_later(const struct inbox_slot *slot, int64_t k, int round)
{
    return slot->k > k || (slot->k == k && slot->round > round);
}

/* A place for (k, round): one that is free, or that of the latest message, which will be asked for
 * in its turn. NULL when all others are for earlier rounds. */
static struct inbox_slot *open_slot(const struct node *node, struct inbox *inbox, int64_t k,
                                    int round)
{
    struct inbox_slot *slot = find_slot(inbox, k, round);
    if (slot != NULL)
        return slot;
    slot = &inbox->slots[0];
    for (int s = 0; s < NODE_INBOX; s++) {
        struct inbox_slot *other = &inbox->slots[s];
        if (other->k < 0 || is_over(node, other->k, other->round)) {
            slot = other;
            break;
        }
        if (is_later(other, slot->k, slot->round))
            slot = other;
    }
    bool is_free = slot->k < 0 || is_over(node, slot->k, slot->round);
    if (!is_free && !is_later(slot, k, round))
        return NULL;
    slot->k = k;
    slot->round = round;
    message_vector_reset(&slot->vector);
    return slot;
}

static bool make_room(struct message_vector *vector, int parts)
{
    int needed = parts * DSE_EXCHANGE_T_CAPACITY;
    if (needed > METHOD_MESSAGE_CAPACITY)
        return false;
    if (needed <= vector->capacity)
        return true;
    double *grown = realloc(vector->value, (size_t)needed * sizeof *grown);
    if (grown == NULL)
        return false;
    vector->value = grown;
    vector->capacity = needed;
    return true;
}

/* True when a neighbour that misses messages names this node. */
static bool is_named(const struct node *node, const dse_exchange_t *ask)
{
    for (int i = 0; i < ask->count; i++)
        if (ask->value[i] == (double)node->config.node)
            return true;
    return false;
}

/* Says an own message again for those who ask; one answer serves all who ask at a time. */
static void answer(struct node *node, int64_t k, int round)
{
    double now = host_now();
    for (int i = 0; i < NODE_HISTORY; i++) {
        struct spoken *spoken = &node->history[i];
        if (spoken->k != k || spoken->round != round)
            continue;
        if (now < spoken->answered_at + 0.5 * node_repeat_s(node))
            return;
        spoken->answered_at = now;
        struct sender_exchange what = {.round = round,
                                       .intent = DSE_EXCHANGE_T_INTENT_ANSWER,
                                       .withheld = spoken->withheld,
                                       .count = spoken->count,
                                       .value = spoken->value};
        sender_exchange(&node->sender, k, spoken->t, spoken->sequence, &what);
        node->answered++;
        return;
    }
}

void node_take_exchange(struct node *node, const dse_exchange_t *message)
{
    const dse_header_t *header = &message->header;
    if (message->intent == DSE_EXCHANGE_T_INTENT_ASK) {
        if (is_named(node, message))
            answer(node, header->sample, header->round);
        return;
    }
    struct inbox *inbox = inbox_of(node, header->node);
    if (inbox == NULL)
        return;
    inbox->gone = false;
    if (is_over(node, header->sample, header->round)) {
        node->counters.duplicates++;
        return;
    }
    struct inbox_slot *slot = open_slot(node, inbox, header->sample, header->round);
    if (slot == NULL)
        return;
    if (message_vector_complete(&slot->vector)) {
        node->counters.duplicates++;
        return;
    }
    if (!make_room(&slot->vector, message->parts) ||
        !message_vector_add(&slot->vector, message->part, message->parts, message->count,
                            message->value)) {
        node->counters.refused_count++;
        return;
    }
    slot->withheld = message->withheld != 0;
}

static void remember(struct node *node, const struct method_message *message)
{
    struct spoken *spoken = &node->history[node->next_spoken];
    if (message->count > spoken->capacity) {
        double *grown = realloc(spoken->value, (size_t)message->count * sizeof *grown);
        if (grown == NULL)
            return;
        spoken->value = grown;
        spoken->capacity = message->count;
    }
    node->next_spoken = (node->next_spoken + 1) % NODE_HISTORY;
    spoken->k = node->k;
    spoken->t = node->t;
    spoken->round = node->round;
    spoken->answered_at = 0;
    spoken->sequence = sender_sequence(&node->sender, SENDER_EXCHANGE);
    spoken->withheld = message->withheld;
    spoken->count = message->count;
    if (message->count > 0)
        memcpy(spoken->value, message->value, (size_t)message->count * sizeof *spoken->value);
}

static void say(struct node *node, const struct method_message *message)
{
    remember(node, message);
    struct sender_exchange what = {.round = node->round,
                                   .intent = DSE_EXCHANGE_T_INTENT_TELL,
                                   .withheld = message->withheld,
                                   .count = message->count,
                                   .value = message->value};
    sender_exchange(&node->sender, node->k, node->t, -1, &what);
    if (!message->withheld) {
        node->sent++;
        node->sent_bytes += 8 * message->count;
    }
}

bool node_open_round(struct node *node)
{
    struct method_plan *plan = &node->plan;
    struct method_message message = {.value = node->outgoing};
    plan->speak = true;
    plan->patience_s = 0;
    plan->n_wait = node->info.n_neighbours;
    memcpy(plan->wait, node->info.neighbours, (size_t)plan->n_wait * sizeof *plan->wait);
    double before = host_now();
    enum method_step step = node->method->next(node->instance, node->round, plan, &message);
    node->step_s += host_now() - before;
    if (step == METHOD_DONE)
        return false;
    if (message.count < 0 || message.count > METHOD_MESSAGE_CAPACITY) {
        node_fail(node, "the method %s says %d values in round %d; at most %d fit into a message",
                  node->method->name, message.count, node->round, METHOD_MESSAGE_CAPACITY);
        return true;
    }
    if (plan->speak)
        say(node, &message);
    node->round_started = host_now();
    node->last_repeat = node->round_started;
    node->ask_interval = node_repeat_s(node);
    node->next_ask = node->round_started + node->ask_interval;
    return true;
}

static struct inbox_slot *awaited(const struct node *node, int i)
{
    struct inbox *inbox = inbox_of((struct node *)node, node->plan.wait[i]);
    if (inbox == NULL)
        return NULL;
    struct inbox_slot *slot = find_slot(inbox, node->k, node->round);
    return slot != NULL && message_vector_complete(&slot->vector) ? slot : NULL;
}

/* Whether the round can do without the i-th of those that it waits for. */
static bool is_gone(const struct node *node, int i)
{
    const struct inbox *inbox = inbox_of((struct node *)node, node->plan.wait[i]);
    return node->plan.patience_s > 0 && inbox != NULL && inbox->gone;
}

bool node_round_complete(const struct node *node)
{
    for (int i = 0; i < node->plan.n_wait; i++)
        if (awaited(node, i) == NULL && !is_gone(node, i))
            return false;
    return true;
}

/* Who has used up a round's patience is not waited for until it says something again. */
static void miss(struct node *node, int i, double now)
{
    struct inbox *inbox = inbox_of(node, node->plan.wait[i]);
    double patience = node->plan.patience_s;
    node->predicted++;
    if (inbox != NULL && patience > 0 && now > node->round_started + patience)
        inbox->gone = true;
}

void node_close_round(struct node *node)
{
    double before = host_now();
    for (int i = 0; i < node->plan.n_wait; i++) {
        struct inbox_slot *slot = awaited(node, i);
        if (slot == NULL) {
            miss(node, i, before);
            continue;
        }
        struct method_message message = {
            .withheld = slot->withheld, .count = slot->vector.count, .value = slot->vector.value};
        enum dse_status status =
            node->method->receive(node->instance, node->round, node->plan.wait[i], &message);
        if (status != DSE_OK)
            node->method_failures++;
        slot->k = -1;
    }
    node->step_s += host_now() - before;
}

/* Names those whose messages are missing. Asks less and less often: a neighbour may just be slow.
 */
void node_ask(struct node *node)
{
    double now = host_now();
    if (now < node->next_ask)
        return;
    double missing[METHOD_MESSAGE_CAPACITY];
    int count = 0;
    for (int i = 0; i < node->plan.n_wait && count < METHOD_MESSAGE_CAPACITY; i++)
        if (awaited(node, i) == NULL)
            missing[count++] = (double)node->plan.wait[i];
    struct sender_exchange what = {.round = node->round,
                                   .intent = DSE_EXCHANGE_T_INTENT_ASK,
                                   .count = count,
                                   .value = missing};
    sender_exchange(&node->sender, node->k, node->t, -1, &what);
    node->asked++;
    node->asked_at = now;
    node->ask_interval = fmin(2 * node->ask_interval, LONGEST_ASK_INTERVAL);
    node->next_ask = now + node->ask_interval;
}

void node_awaited(const struct node *node, char *text, int size)
{
    int first = -1;
    int others = -1;
    for (int i = 0; i < node->plan.n_wait; i++)
        if (awaited(node, i) == NULL) {
            first = first < 0 ? node->plan.wait[i] : first;
            others++;
        }
    if (others > 0)
        snprintf(text, (size_t)size, "node %d and %d other(s)", first, others);
    else
        snprintf(text, (size_t)size, "node %d", first);
}
