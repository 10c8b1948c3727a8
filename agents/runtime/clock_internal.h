/* The parts of the sample clock: clock.c (making it, time), clock_samples.c (what the plant says),
 * clock_members.c (what the nodes say, who comes and goes). */
#ifndef DSE_RUNTIME_CLOCK_INTERNAL_H
#define DSE_RUNTIME_CLOCK_INTERNAL_H

#include <stdbool.h>
#include <stdint.h>

#include "runtime/announcement.h"
#include "runtime/clock.h"
#include "runtime/messages.h"
#include "runtime/sender.h"

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

/* clock.c */
double clock_repeat_s(const struct clock *clock);
void clock_publish(struct clock *clock, int event);
void clock_begin_stop(struct clock *clock);
/* The run ends at once; the clock itself ends as failed when the others have heard of it. */
void clock_fail(struct clock *clock, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* clock_samples.c */
/* Input first: it opens the sample; the measurements complete it. again: under their old numbers.
 */
void clock_publish_sample(struct clock *clock, bool again);
void clock_next_sample(struct clock *clock);
/* Goes on once everybody is done; a realtime clock goes on when the next sample is due. */
void clock_advance(struct clock *clock);

/* clock_members.c */
bool clock_gather_members(struct clock *clock, struct error *error);
const char *clock_member_name(const struct clock *clock, const struct member *member, char *text,
                              int size);
/* Whether the clock waits for it at this sample; how many there are. */
bool clock_is_undone(const struct clock *clock, const struct member *member);
int clock_count_undone(const struct clock *clock);
/* Gives up those that the others of their network can do without, when patience is used up. */
void clock_go_on_without(struct clock *clock, double now);
/* Bus handlers, user is the clock. */
void clock_on_status(void *user, const char *channel, const uint8_t *bytes, int length);
void clock_on_done(void *user, const char *channel, const uint8_t *bytes, int length);

#endif
