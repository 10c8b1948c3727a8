/* The progress line. */
#include "run/progress.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "runtime/agent.h"
#include "runtime/channels.h"
#include "runtime/messages.h"

static void on_input(void *user, const char *channel, const uint8_t *bytes, int length)
{
    (void)channel;
    struct progress *progress = user;
    struct message_counters counters = {0};
    dse_input_t message;
    if (!message_input(bytes, length, &counters, &message) || message.header.sample <= progress->k)
        return;
    if (progress->k < 0)
        progress->began = host_now();
    progress->k = message.header.sample;
    progress->t = message.header.plant_time;
}

bool progress_watch(struct progress *progress, const struct scenario *scenario, int64_t samples,
                    bool quiet, struct bus *bus, struct error *error)
{
    *progress = (struct progress){.scenario = scenario,
                                  .samples = samples,
                                  .k = -1,
                                  .terminal = isatty(STDERR_FILENO) == 1,
                                  .quiet = quiet};
    return bus_subscribe(bus, CHANNEL_INPUT, on_input, progress, error);
}

static double speed_of(const struct progress *progress, double elapsed)
{
    double plant_s = (double)progress->k * progress->scenario->time.period_s;
    return elapsed > 0 ? plant_s / elapsed : 0;
}

static void print_line(const struct progress *progress, double elapsed)
{
    double done = (double)(progress->k + 1) / (double)progress->samples;
    double left = progress->k > 0 ? elapsed * (double)(progress->samples - progress->k - 1) /
                                        (double)progress->k
                                  : 0;
    fprintf(stderr, "%ssample %lld of %lld (%.0f %%)  t = %.4g %s  %.0f x real time  %.0f s left%s",
            progress->terminal ? "\r\033[K" : "", (long long)progress->k + 1,
            (long long)progress->samples, 100 * done, progress->t,
            progress->scenario->process->time_unit, speed_of(progress, elapsed), left,
            progress->terminal ? "" : "\n");
    fflush(stderr);
}

void progress_tick(void *user)
{
    struct progress *progress = user;
    double now = host_now();
    if (progress->quiet || progress->k < 0 ||
        now < progress->shown + (progress->terminal ? 0.2 : 5.0))
        return;
    progress->shown = now;
    print_line(progress, now - progress->began);
}

void progress_end(struct progress *progress)
{
    if (progress->quiet || progress->k < 0)
        return;
    print_line(progress, host_now() - progress->began);
    if (progress->terminal)
        fprintf(stderr, "\n");
}
