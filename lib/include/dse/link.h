/* What a lossy network does to data, for every method that talks: how long a packet takes and
 * whether it comes at all, what a receiver keeps of it, and what a sender keeps to itself.
 *
 * Time is counted in communication instants 0, 1, 2, ..: the stamp of a packet is the instant of
 * its sending. Two bounds describe the network (section 4.2 of the adaptive high-gain source):
 *
 *     D    a packet that takes more than D instants is dropped
 *     T_m  at most T_m consecutive packets of one ordered pair are lost
 *
 * so that what a receiver knows of a sender is never older than D + T_m instants: in the worst case
 * stamp k - D - T_m is held, the next T_m packets are lost, and the one behind them is due next. */
#ifndef DSE_LINK_H
#define DSE_LINK_H

#include <stdbool.h>
#include <stdint.h>

#include "dse/arena.h"
#include "dse/random.h"
#include "dse/real.h"
#include "dse/status.h"

/* ---- the fate of packets ---- */

#define DSE_LINK_LOST (-1)

/* The largest age of what is known, in instants. */
#define DSE_LINK_MAX_AGE(D, T_m) ((D) + (T_m))

/* Nothing arrives of what `from` sends to `to` at instants first .. end - 1. -1: any node. Whatever
 * T_m and a table say: an outage is not one of the losses that they count. */
struct dse_link_outage {
    int from, to;
    int64_t first, end;
};

struct dse_link_config {
    int max_delay;  /* D >= 0 */
    int max_losses; /* T_m >= 0; not used with a table */
    double loss;    /* probability of a loss where T_m allows one, in [0, 1]; not with a table */
    uint64_t seed;  /* with the pair it gives the sequence; not with a table */
    /* A recorded network: table[(to nodes + from) stamps + s] is the delay of the packet with stamp
     * s, negative when it was lost. NULL: random. After its end everything comes at once. */
    const int16_t *table;
    int nodes, stamps;                     /* sizes of the table */
    const struct dse_link_outage *outages; /* NULL: none */
    int n_outages;
};

/* One ordered pair, receiver `to` and sender `from`. */
struct dse_link {
    const struct dse_link_config *config;
    int to, from;
    struct dse_random random;
    int losses;   /* consecutive, up to stamp `next` */
    int64_t next; /* first stamp whose fate has not been asked for */
    uint64_t key; /* of the draws of dse_link_lost */
    int round;    /* of stamp next - 1: the last one that dse_link_lost was asked for */
    bool lost;    /* and its answer */
};

/* DSE_EINVAL: a setting outside its range, or a pair outside the table. */
enum dse_status dse_link_init(struct dse_link *link, const struct dse_link_config *config, int to,
                              int from);

/* The delay of the packet with this stamp, 0..D, or DSE_LINK_LOST. Stamps are asked for in
 * ascending order; one that was passed over is lost.
 *
 * Random: stamp 0 comes at once; another one is lost with the configured probability unless the
 * T_m before it were, else its delay is uniform on 0..D. Every stamp takes two draws of the pair's
 * own stream, so that gaps change nothing behind them. */
int dse_link_fate(struct dse_link *link, int64_t stamp);

/* For methods that talk several times at each instant, where what is late is of no use: whether the
 * message of this instant and round is lost. Each message has a draw of its own, from the seed, the
 * pair, the instant and the round, so that nothing depends on how many rounds there were before;
 * T_m bounds the consecutive losses among the messages that were asked for. They are asked for in
 * ascending order: the last one again has the same answer, one before it is lost. With a table all
 * messages of an instant are lost unless its packet came at once. A link is asked by this function
 * or by dse_link_fate, not by both. */
bool dse_link_lost(struct dse_link *link, int64_t stamp, int round);

/* ---- packets of one pair under way ---- */

/* Slot stamp mod (D + 1): a packet has arrived or is lost before its slot is needed again. */
struct dse_line {
    int depth, size; /* D + 1 packets of `size` reals */
    int64_t newest;  /* largest stamp that was put, -1: none */
    int *delay;      /* depth, DSE_LINK_LOST where there is no packet */
    dse_real *value; /* depth x size */
};

#define DSE_LINE_STORAGE(D, size) (((D) + 1) * (size) + DSE_ARENA_INTS((D) + 1))

enum dse_status dse_line_init(struct dse_line *line, int max_delay, int size,
                              struct dse_arena *arena);
/* Sends `value` (size reals) off at instant `stamp`. A lost packet and one with a delay beyond D
 * leave no trace. Stamps ascend. */
void dse_line_put(struct dse_line *line, int64_t stamp, int delay, const dse_real *value);
/* The packet with the oldest stamp that has arrived at instant `now` or before, and its stamp; it
 * is then gone, and its value stays until the next put. NULL when there is none. */
const dse_real *dse_line_take(struct dse_line *line, int64_t now, int64_t *stamp);

/* ---- what a receiver keeps ---- */

enum dse_mailbox_verdict {
    DSE_MAILBOX_NEWEST,    /* kept, and newer than what was known of the sender */
    DSE_MAILBOX_LATE,      /* kept, behind a newer one: it corrects the past */
    DSE_MAILBOX_DUPLICATE, /* this stamp is known already; dropped */
    DSE_MAILBOX_TOO_LATE,  /* older than D instants; dropped */
    DSE_MAILBOX_REFUSED    /* a stamp of the future, or no such sender; dropped */
};

/* Everything of the last D + 1 instants, for each sender and stamp. */
struct dse_mailbox {
    int senders, depth; /* depth = D + 1 */
    const int *sizes;   /* senders: reals in a value; kept as a pointer */
    int total;          /* their sum */
    int64_t now;
    int *has;        /* depth x senders */
    int *age;        /* senders: now - newest stamp, -1: nothing has come yet */
    int *unread;     /* senders: the newest stamp came after the last dse_mailbox_read */
    dse_real *value; /* depth x total */
    int64_t oldest_unread;
    bool any_unread;
    int64_t kept, late, duplicates, too_late, refused; /* verdicts since the start */
};

/* total: sum of the senders' sizes. */
#define DSE_MAILBOX_STORAGE(senders, total, D)                                                     \
    (((D) + 1) * (total) + DSE_ARENA_INTS(((D) + 1) * (senders)) + 2 * DSE_ARENA_INTS(senders))

enum dse_status dse_mailbox_init(struct dse_mailbox *mailbox, int senders, const int *sizes,
                                 int max_delay, struct dse_arena *arena);
/* Empties it and starts at instant `now`. Counts stay. */
void dse_mailbox_clear(struct dse_mailbox *mailbox, int64_t now);
/* Goes on to instant `now`, not before the last one: older stamps than now - D are forgotten. */
void dse_mailbox_advance(struct dse_mailbox *mailbox, int64_t now);
enum dse_mailbox_verdict dse_mailbox_put(struct dse_mailbox *mailbox, int from, int64_t stamp,
                                         const dse_real *value);
/* What `from` said with this stamp, or NULL. */
const dse_real *dse_mailbox_get(const struct dse_mailbox *mailbox, int from, int64_t stamp);
/* The newest value of `from` when it came after the last read, else NULL. */
const dse_real *dse_mailbox_news(const struct dse_mailbox *mailbox, int from);
/* now - newest stamp of `from`, -1: nothing has come yet. */
int dse_mailbox_age(const struct dse_mailbox *mailbox, int from);
/* True when something came since the last read, with its oldest stamp; then all is read. */
bool dse_mailbox_read(struct dse_mailbox *mailbox, int64_t *oldest);

/* ---- what a sender keeps to itself ---- */

enum dse_trigger_norm {
    DSE_TRIGGER_ABSOLUTE = 0, /* |H (x - x_q)|                                  (5.1) */
    DSE_TRIGGER_RELATIVE = 1  /* |H [(x - x_q)_1 / x_q1, ..]|, x_q as last sent (section 5.7) */
};

/* Send-on-delta: speak when the value has moved by at least the threshold since it was last sent.
 */
struct dse_trigger_config {
    enum dse_trigger_norm norm;
    dse_real threshold;      /* L >= 0; 0: always */
    const dse_real *weights; /* diagonal of H, all >= 0; NULL: ones */
};

struct dse_trigger {
    const struct dse_trigger_config *config;
    int n;
    bool sent;      /* there is a last value */
    dse_real *last; /* n */
};

#define DSE_TRIGGER_STORAGE(n) (n)

/* DSE_EINVAL: threshold or a weight negative or not finite. */
enum dse_status dse_trigger_init(struct dse_trigger *trigger,
                                 const struct dse_trigger_config *config, int n,
                                 struct dse_arena *arena);
/* Whether value (n) is to be sent: always before the first time, and when the distance is not a
 * number. A component that was last sent as 0 has moved infinitely when it is not 0 now. */
bool dse_trigger_fires(const struct dse_trigger *trigger, const dse_real *value);
void dse_trigger_sent(struct dse_trigger *trigger, const dse_real *value);

/* Sequence numbers tell silence from loss: a sender counts what it has sent, modulo
 * DSE_LINK_NUMBERS (exact in any real), and says the count with whatever it says. How many messages
 * lie between the count last heard and this one: 0 when none was sent or the next one has come. */
#define DSE_LINK_NUMBERS (1 << 20)
int dse_link_next_number(int number);
int dse_link_unheard(int last, int number);

#endif
