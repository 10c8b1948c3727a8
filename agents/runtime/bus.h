/* The message bus: the only room that knows LCM's library. URLs are LCM's: udpm://group:port?ttl=0
 * between processes, memq:// within one. */
#ifndef DSE_RUNTIME_BUS_H
#define DSE_RUNTIME_BUS_H

#include <stdbool.h>
#include <stdint.h>

#include "runtime/error.h"

struct bus;

/* bytes are valid during the call only. */
typedef void (*bus_handler)(void *user, const char *channel, const uint8_t *bytes, int length);

/* NULL and a reason (with the command that mends a missing multicast route) on failure. url NULL:
 * $LCM_DEFAULT_URL, else LCM's default group on this machine only. */
struct bus *bus_open(const char *url, struct error *error);
void bus_close(struct bus *bus);
const char *bus_url(const struct bus *bus);

/* pattern: a POSIX extended regular expression that must match the whole channel name. Nothing that
 * arrives is dropped for want of queue space. */
bool bus_subscribe(struct bus *bus, const char *pattern, bus_handler handler, void *user,
                   struct error *error);
bool bus_publish(struct bus *bus, const char *channel, const void *bytes, int length);

/* Hands on the messages that have arrived; waits up to timeout_ms for the first one (0: does not
 * wait). Number of messages, 0 when none came, -1 when the bus failed. */
int bus_wait(struct bus *bus, int timeout_ms);

/* True when a message published at url comes back within five seconds. */
bool bus_check(const char *url, struct error *error);

/* ---- event logs ---- */

struct log_event {
    int64_t time_us; /* when it was logged */
    const char *channel;
    const uint8_t *bytes;
    int length;
};
struct log_reader;
struct log_reader *log_open(const char *path, struct error *error);
/* The next event, valid until the next call; false at the end (also of a truncated file). */
bool log_next(struct log_reader *reader, struct log_event *event);
void log_close(struct log_reader *reader);

struct log_writer;
/* Writes every message on `bus` into a new log at path, in order of arrival. */
struct log_writer *log_record(struct bus *bus, const char *path, struct error *error);
/* Messages written so far; -1 after a write error. */
int64_t log_recorded(const struct log_writer *writer);
/* False when not everything could be written. */
bool log_finish(struct log_writer *writer, struct error *error);

#endif
