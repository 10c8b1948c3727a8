/* lcm-logger and the recording beside it. */
#include "run/recorder.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "run/programs.h"
#include "runtime/agent.h"
#include "runtime/channels.h"

#define START_WAIT_S 5.0
#define TELL_PERIOD  0.02 /* s: a lost word to the clock is said again after this */

static int64_t file_size(const char *path)
{
    struct stat status;
    return stat(path, &status) == 0 ? (int64_t)status.st_size : -1;
}

static void run_logger(const char *url, const char *path)
{
    char logger[4096], url_option[600];
    struct error error = {0};
    if (!program_logger(logger, (int)sizeof logger, &error)) {
        fprintf(stderr, "dse-run: %s\n", error.text);
        _exit(127);
    }
    int nowhere = open("/dev/null", O_WRONLY);
    FILE *complaints = fdopen(dup(STDERR_FILENO), "w");
    if (nowhere < 0 || complaints == NULL)
        _exit(126);
    dup2(nowhere, STDOUT_FILENO);
    dup2(nowhere, STDERR_FILENO); /* it says hello and goodbye there */
    snprintf(url_option, sizeof url_option, "--lcm-url=%s", url);
    execlp(logger, logger, url_option, "--force", "--quiet", path, (char *)NULL);
    fprintf(complaints, "dse-run: cannot run %s: %s\n", logger, strerror(errno));
    fflush(complaints);
    _exit(127);
}

/* Under run id 0: not a message of the run. */
static void ping(struct bus *bus, const struct scenario *scenario)
{
    struct sender sender = {.bus = bus};
    sender.id.role = DSE_HEADER_T_ROLE_RUN;
    sender.id.network = -1;
    dse_status_t message = {.scenario_hash = (int64_t)scenario->hash,
                            .pid = (int32_t)getpid(),
                            .state = DSE_STATUS_T_STATE_JOINING};
    sender_status(&sender, -1, 0, &message);
}

static bool wait_for_logger(struct recorder *recorder, struct bus *bus,
                            const struct scenario *scenario, struct error *error)
{
    for (double until = host_now() + START_WAIT_S; file_size(recorder->path) <= 0;) {
        if (!recorder_alive(recorder))
            return error_set(error, "lcm-logger ended before it had written anything into %s",
                             recorder->path);
        if (host_now() > until)
            return error_set(error, "lcm-logger wrote nothing into %s within %g s", recorder->path,
                             START_WAIT_S);
        ping(bus, scenario);
        bus_wait(bus, 20);
    }
    return true;
}

static void on_done(void *user, const char *channel, const uint8_t *bytes, int length)
{
    (void)channel;
    struct recorder *recorder = user;
    dse_done_t done;
    if (message_done(bytes, length, &recorder->counters, &done) &&
        done.header.role != DSE_HEADER_T_ROLE_RUN &&
        done.header.run_id == recorder->sender.id.run_id && done.header.sample > recorder->sample)
        recorder->sample = done.header.sample;
}

bool recorder_start(struct recorder *recorder, struct bus *bus, const char *url, const char *path,
                    const struct scenario *scenario, int64_t run_id, struct error *error)
{
    *recorder = (struct recorder){.path = path, .sample = -1, .told = -1};
    recorder->sender.bus = bus;
    recorder->sender.id.run_id = run_id;
    recorder->sender.id.role = DSE_HEADER_T_ROLE_RUN;
    recorder->sender.id.network = -1;
    pid_t parent = getpid();
    recorder->pid = fork();
    if (recorder->pid == 0) {
        setpgid(0, 0);
        prctl(PR_SET_PDEATHSIG, SIGTERM);
        if (getppid() != parent)
            _exit(1);
        run_logger(url, path);
    }
    if (recorder->pid < 0) {
        recorder->pid = 0;
        return error_set(error, "cannot start lcm-logger: %s", strerror(errno));
    }
    snprintf(recorder->copy_path, sizeof recorder->copy_path, "%.4000s.copy", path);
    if (!wait_for_logger(recorder, bus, scenario, error) ||
        !bus_subscribe(bus, CHANNEL_DONE, on_done, recorder, error))
        return false;
    recorder->copy = log_record(bus, recorder->copy_path, error);
    return recorder->copy != NULL;
}

void recorder_follow(struct recorder *recorder)
{
    double now = host_now();
    if (recorder->sample < 0 ||
        (recorder->sample == recorder->told && now < recorder->told_at + TELL_PERIOD))
        return;
    dse_done_t done = {0};
    sender_done(&recorder->sender, recorder->sample, 0, &done);
    recorder->told = recorder->sample;
    recorder->told_at = now;
}

bool recorder_alive(struct recorder *recorder)
{
    if (recorder->pid != 0 && waitpid(recorder->pid, NULL, WNOHANG) == recorder->pid)
        recorder->pid = 0;
    return recorder->pid != 0;
}

/* What arrived last is written when the file has not grown for a while. */
static void wait_until_still(const char *path)
{
    int64_t before = -1;
    for (int still = 0, i = 0; still < 3 && i < 100; i++) {
        int64_t now = file_size(path);
        still = now == before ? still + 1 : 0;
        before = now;
        usleep(50000);
    }
}

static void end_logger(struct recorder *recorder)
{
    if (!recorder_alive(recorder))
        return;
    wait_until_still(recorder->path);
    kill(recorder->pid, SIGTERM);
    for (int i = 0; i < 300 && recorder_alive(recorder); i++)
        usleep(10000);
    if (recorder->pid != 0)
        kill(recorder->pid, SIGKILL);
    recorder->pid = 0;
}

/* Messages in a log that belong to some run. */
static int64_t count_messages(const char *path)
{
    static const uint8_t no_run[8];
    struct error error = {0};
    struct log_reader *log = log_open(path, &error);
    struct log_event event;
    int64_t count = 0;
    while (log != NULL && log_next(log, &event))
        if (event.length >= 16 && memcmp(event.bytes + 8, no_run, sizeof no_run) != 0)
            count++;
    log_close(log);
    return count;
}

/* Keeps the recording that holds more of the run. */
static void choose_recording(const struct recorder *recorder)
{
    int64_t logged = count_messages(recorder->path);
    int64_t copied = count_messages(recorder->copy_path);
    if (logged >= copied) {
        unlink(recorder->copy_path);
        return;
    }
    fprintf(stderr,
            "lcm-logger missed %lld of %lld messages (its queue holds 30); the log is dse-run's "
            "own recording\n",
            (long long)(copied - logged), (long long)copied);
    if (rename(recorder->copy_path, recorder->path) != 0)
        fprintf(stderr, "dse-run: cannot rename %s: %s\n", recorder->copy_path, strerror(errno));
}

void recorder_end(struct recorder *recorder)
{
    end_logger(recorder);
    if (recorder->copy == NULL)
        return;
    struct error error = {0};
    while (bus_wait(recorder->sender.bus, 0) > 0)
        continue; /* the last words of the agents */
    if (log_finish(recorder->copy, &error))
        choose_recording(recorder);
    else
        unlink(recorder->copy_path);
    recorder->copy = NULL;
}
