/* Reading and writing LCM event logs. */
#include "runtime/bus.h"

#include <errno.h>
#include <lcm/eventlog.h>
#include <stdlib.h>
#include <string.h>
#include <sys/time.h>

struct log_reader {
    lcm_eventlog_t *log;
    lcm_eventlog_event_t *event;
};

struct log_reader *log_open(const char *path, struct error *error)
{
    struct log_reader *reader = calloc(1, sizeof *reader);
    if (reader == NULL) {
        error_set(error, "out of memory");
        return NULL;
    }
    reader->log = lcm_eventlog_create(path, "r");
    if (reader->log == NULL) {
        error_set(error, "cannot read the log %s: %s", path, strerror(errno));
        free(reader);
        return NULL;
    }
    return reader;
}

bool log_next(struct log_reader *reader, struct log_event *event)
{
    if (reader->event != NULL)
        lcm_eventlog_free_event(reader->event);
    reader->event = lcm_eventlog_read_next_event(reader->log);
    if (reader->event == NULL)
        return false;
    event->time_us = reader->event->timestamp;
    event->channel = reader->event->channel;
    event->bytes = reader->event->data;
    event->length = reader->event->datalen;
    return true;
}

void log_close(struct log_reader *reader)
{
    if (reader == NULL)
        return;
    if (reader->event != NULL)
        lcm_eventlog_free_event(reader->event);
    lcm_eventlog_destroy(reader->log);
    free(reader);
}

struct log_writer {
    lcm_eventlog_t *log;
    char *path;
    int64_t written;
    bool failed;
};

static void write_event(void *user, const char *channel, const uint8_t *bytes, int length)
{
    struct log_writer *writer = user;
    struct timeval now;
    gettimeofday(&now, NULL);
    lcm_eventlog_event_t event = {
        .eventnum = writer->written,
        .timestamp = (int64_t)now.tv_sec * 1000000 + now.tv_usec,
        .channellen = (int32_t)strlen(channel),
        .datalen = length,
        .channel = (char *)channel,
        .data = (void *)bytes,
    };
    if (lcm_eventlog_write_event(writer->log, &event) != 0)
        writer->failed = true;
    writer->written++;
}

struct log_writer *log_record(struct bus *bus, const char *path, struct error *error)
{
    struct log_writer *writer = calloc(1, sizeof *writer);
    if (writer == NULL) {
        error_set(error, "out of memory");
        return NULL;
    }
    writer->path = strdup(path);
    writer->log = lcm_eventlog_create(path, "w");
    if (writer->log == NULL) {
        error_set(error, "cannot write the log %s: %s", path, strerror(errno));
    } else if (bus_subscribe(bus, ".*", write_event, writer, error)) {
        return writer;
    } else {
        lcm_eventlog_destroy(writer->log);
    }
    free(writer->path);
    free(writer);
    return NULL;
}

int64_t log_recorded(const struct log_writer *writer)
{
    return writer->failed ? -1 : writer->written;
}

bool log_finish(struct log_writer *writer, struct error *error)
{
    bool ok = !writer->failed;
    if (fflush(writer->log->f) != 0)
        ok = false;
    lcm_eventlog_destroy(writer->log);
    if (!ok)
        error_set(error, "the log %s is not complete: %s", writer->path, strerror(errno));
    free(writer->path);
    free(writer);
    return ok;
}
