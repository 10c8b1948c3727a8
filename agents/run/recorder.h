/* The log of a run: lcm-logger as a process, and a second recording of our own beside it.
 *
 * lcm-logger keeps at most 30 received messages in its queue and silently drops what comes when it
 * is full, which a busy machine makes happen. So the clock of a lockstep run is told which samples
 * have been received here (an unlimited queue) and does not run further ahead than a socket buffer
 * holds; and when lcm-logger's log lacks messages in the end, ours takes its place. */
#ifndef DSE_RUN_RECORDER_H
#define DSE_RUN_RECORDER_H

#include <stdbool.h>
#include <stdint.h>
#include <sys/types.h>

#include "runtime/messages.h"
#include "runtime/scenario.h"
#include "runtime/sender.h"

struct recorder {
    pid_t pid; /* of lcm-logger, 0: not running */
    const char *path;
    char copy_path[4096];
    struct log_writer *copy;
    struct message_counters counters;
    int64_t sample; /* newest sample of which a `done` was received, -1 */
    int64_t told;   /* newest sample that the clock was told */
    double told_at;
    struct sender sender;
};

/* Starts lcm-logger on the bus and waits until it writes. */
bool recorder_start(struct recorder *recorder, struct bus *bus, const char *url, const char *path,
                    const struct scenario *scenario, int64_t run_id, struct error *error);
/* Tells the clock what has been received. */
void recorder_follow(struct recorder *recorder);
/* False when lcm-logger has ended although nobody told it to. */
bool recorder_alive(struct recorder *recorder);
/* Lets lcm-logger write what has arrived, ends it and sees to it that the log at `path` is the
 * complete one. Safe when it never started. */
void recorder_end(struct recorder *recorder);

#endif
