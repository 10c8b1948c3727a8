/* What a receiver keeps: slot stamp mod (D + 1), so that nothing is ever moved. */
#include <stddef.h>

#include "dse/link.h"

enum dse_status dse_mailbox_init(struct dse_mailbox *mailbox, int senders, const int *sizes,
                                 int max_delay, struct dse_arena *arena)
{
    if (mailbox == NULL || arena == NULL || sizes == NULL || senders < 1 || max_delay < 0) {
        return DSE_EINVAL;
    }
    const int depth = max_delay + 1;
    *mailbox = (struct dse_mailbox){.senders = senders, .depth = depth, .sizes = sizes};
    for (int j = 0; j < senders; j++) {
        if (sizes[j] < 1) {
            return DSE_EDIM;
        }
        mailbox->total += sizes[j];
    }
    mailbox->value = dse_arena_take(arena, depth * mailbox->total);
    mailbox->has = (int *)(void *)dse_arena_take(arena, DSE_ARENA_INTS(depth * senders));
    mailbox->age = (int *)(void *)dse_arena_take(arena, DSE_ARENA_INTS(senders));
    mailbox->unread = (int *)(void *)dse_arena_take(arena, DSE_ARENA_INTS(senders));
    if (mailbox->unread == NULL) {
        return DSE_ESTORAGE;
    }
    dse_mailbox_clear(mailbox, 0);
    return DSE_OK;
}

static void forget(struct dse_mailbox *mailbox, int64_t stamp)
{
    int *has = mailbox->has + (stamp % mailbox->depth) * mailbox->senders;
    for (int j = 0; j < mailbox->senders; j++) {
        has[j] = 0;
    }
}

void dse_mailbox_clear(struct dse_mailbox *mailbox, int64_t now)
{
    for (int s = 0; s < mailbox->depth; s++) {
        forget(mailbox, s);
    }
    for (int j = 0; j < mailbox->senders; j++) {
        mailbox->age[j] = -1;
        mailbox->unread[j] = 0;
    }
    mailbox->now = now;
    mailbox->any_unread = false;
}

void dse_mailbox_advance(struct dse_mailbox *mailbox, int64_t now)
{
    const int64_t steps = now - mailbox->now;
    if (steps <= 0) {
        return;
    }
    /* the slots of the new stamps hold those that are older than D now */
    for (int64_t s = 1; s <= steps && s <= mailbox->depth; s++) {
        forget(mailbox, mailbox->now + s);
    }
    for (int j = 0; j < mailbox->senders; j++) {
        if (mailbox->age[j] >= 0) {
            const int64_t age = mailbox->age[j] + steps;
            mailbox->age[j] = age < INT32_MAX ? (int)age : INT32_MAX;
        }
    }
    mailbox->now = now;
}

/* Where the value of (from, stamp) lies. */
static int place(const struct dse_mailbox *mailbox, int from, int64_t stamp)
{
    int offset = (int)(stamp % mailbox->depth) * mailbox->total;
    for (int j = 0; j < from; j++) {
        offset += mailbox->sizes[j];
    }
    return offset;
}

static int *flag(const struct dse_mailbox *mailbox, int from, int64_t stamp)
{
    return mailbox->has + (stamp % mailbox->depth) * mailbox->senders + from;
}

static enum dse_mailbox_verdict judge(const struct dse_mailbox *mailbox, int from, int64_t stamp)
{
    if (from < 0 || from >= mailbox->senders || stamp < 0 || stamp > mailbox->now) {
        return DSE_MAILBOX_REFUSED;
    }
    if (mailbox->now - stamp >= mailbox->depth) {
        return DSE_MAILBOX_TOO_LATE;
    }
    if (*flag(mailbox, from, stamp)) {
        return DSE_MAILBOX_DUPLICATE;
    }
    const int age = mailbox->age[from];
    return age < 0 || mailbox->now - stamp < age ? DSE_MAILBOX_NEWEST : DSE_MAILBOX_LATE;
}

static void keep(struct dse_mailbox *mailbox, int from, int64_t stamp, const dse_real *value)
{
    dse_real *to = mailbox->value + place(mailbox, from, stamp);
    for (int k = 0; k < mailbox->sizes[from]; k++) {
        to[k] = value[k];
    }
    *flag(mailbox, from, stamp) = 1;
    if (!mailbox->any_unread || stamp < mailbox->oldest_unread) {
        mailbox->oldest_unread = stamp;
    }
    mailbox->any_unread = true;
}

enum dse_mailbox_verdict dse_mailbox_put(struct dse_mailbox *mailbox, int from, int64_t stamp,
                                         const dse_real *value)
{
    const enum dse_mailbox_verdict verdict = judge(mailbox, from, stamp);
    int64_t *const counters[] = {[DSE_MAILBOX_NEWEST] = &mailbox->kept,
                                 [DSE_MAILBOX_LATE] = &mailbox->late,
                                 [DSE_MAILBOX_DUPLICATE] = &mailbox->duplicates,
                                 [DSE_MAILBOX_TOO_LATE] = &mailbox->too_late,
                                 [DSE_MAILBOX_REFUSED] = &mailbox->refused};
    ++*counters[verdict];
    if (verdict == DSE_MAILBOX_NEWEST) {
        mailbox->age[from] = (int)(mailbox->now - stamp);
        mailbox->unread[from] = 1;
    }
    if (verdict == DSE_MAILBOX_NEWEST || verdict == DSE_MAILBOX_LATE) {
        keep(mailbox, from, stamp, value);
    }
    return verdict;
}

const dse_real *dse_mailbox_get(const struct dse_mailbox *mailbox, int from, int64_t stamp)
{
    if (from < 0 || from >= mailbox->senders || stamp < 0 || stamp > mailbox->now ||
        mailbox->now - stamp >= mailbox->depth || !*flag(mailbox, from, stamp)) {
        return NULL;
    }
    return mailbox->value + place(mailbox, from, stamp);
}

const dse_real *dse_mailbox_news(const struct dse_mailbox *mailbox, int from)
{
    return mailbox->unread[from] ? dse_mailbox_get(mailbox, from, mailbox->now - mailbox->age[from])
                                 : NULL;
}

int dse_mailbox_age(const struct dse_mailbox *mailbox, int from)
{
    return mailbox->age[from];
}

bool dse_mailbox_read(struct dse_mailbox *mailbox, int64_t *oldest)
{
    const bool any = mailbox->any_unread;
    if (any) {
        /* what nobody read in time has been forgotten */
        const int64_t first = mailbox->now - mailbox->depth + 1;
        *oldest = mailbox->oldest_unread < first ? first : mailbox->oldest_unread;
    }
    for (int j = 0; j < mailbox->senders; j++) {
        mailbox->unread[j] = 0;
    }
    mailbox->any_unread = false;
    return any;
}
