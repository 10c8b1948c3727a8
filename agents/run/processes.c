/* The network as processes: a logger, the plant, one estimator process per node. */
#include <errno.h>
#include <netinet/in.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "dse_clock_t.h"
#include "run/programs.h"
#include "run/progress.h"
#include "run/recorded.h"
#include "run/recorder.h"
#include "run/run.h"
#include "runtime/agent.h"
#include "runtime/channels.h"
#include "runtime/clock.h"
#include "runtime/networks.h"
#include "runtime/node.h"
#include "runtime/run_info.h"
#include "runtime/sender.h"

#define MAX_PROCESSES   1100
#define STOP_WAIT_S     3.0
#define JOIN_TEXT       "20"
#define RECEIVE_BUFFER  (2 << 20) /* bytes */
#define SOCKET_MESSAGES 80        /* that surely fit into the receive buffer of a socket */

struct process {
    pid_t pid; /* 0: ended */
    char name[64];
    int exit_status; /* as from waitpid */
};

struct crew {
    struct process list[MAX_PROCESSES];
    int count;
    char failure[512];
};

/* ---- starting and ending processes ---- */

static bool spawn(struct crew *crew, const char *name, const char *const *arguments,
                  struct error *error)
{
    if (crew->count == MAX_PROCESSES)
        return error_set(error, "more than %d processes", MAX_PROCESSES);
    pid_t parent = getpid();
    pid_t pid = fork();
    if (pid < 0)
        return error_set(error, "cannot start %s: %s", name, strerror(errno));
    if (pid == 0) {
        setpgid(0, 0); /* a Ctrl-C goes to dse-run, which ends them in order */
        prctl(PR_SET_PDEATHSIG, SIGTERM);
        if (getppid() != parent)
            _exit(1);
        execvp(arguments[0], (char *const *)arguments);
        fprintf(stderr, "dse-run: cannot run %s: %s\n", arguments[0], strerror(errno));
        _exit(127);
    }
    struct process *process = &crew->list[crew->count++];
    process->pid = pid;
    snprintf(process->name, sizeof process->name, "%s", name);
    return true;
}

static void describe_end(const struct process *process, char *text, int size)
{
    int status = process->exit_status;
    if (WIFSIGNALED(status))
        snprintf(text, (size_t)size, "%s was killed by signal %d (%s)", process->name,
                 WTERMSIG(status), strsignal(WTERMSIG(status)));
    else
        snprintf(text, (size_t)size, "%s ended with exit code %d", process->name,
                 WEXITSTATUS(status));
}

/* Collects processes that have ended; notes the first that ended badly. Only those of the crew:
 * lcm-logger is the recorder's. */
static void reap(struct crew *crew, int64_t k)
{
    for (int i = 0; i < crew->count; i++) {
        struct process *process = &crew->list[i];
        int status;
        if (process->pid == 0 || waitpid(process->pid, &status, WNOHANG) != process->pid)
            continue;
        process->pid = 0;
        process->exit_status = status;
        if (status == 0 || crew->failure[0] != '\0')
            continue;
        char how[256];
        describe_end(process, how, (int)sizeof how);
        snprintf(crew->failure, sizeof crew->failure, "%s; last sample of the run: %lld", how,
                 (long long)k);
    }
}

static int count_alive(const struct crew *crew)
{
    int alive = 0;
    for (int i = 0; i < crew->count; i++)
        alive += crew->list[i].pid != 0;
    return alive;
}

static void send_signal(const struct crew *crew, int number)
{
    for (int i = 0; i < crew->count; i++)
        if (crew->list[i].pid != 0)
            kill(crew->list[i].pid, number);
}

static void wait_for_end(struct crew *crew, int64_t k, double seconds)
{
    double until = host_now() + seconds;
    for (reap(crew, k); count_alive(crew) > 0 && host_now() < until; reap(crew, k))
        usleep(5000);
}

static void end_all(struct crew *crew, int64_t k)
{
    send_signal(crew, SIGTERM);
    wait_for_end(crew, k, STOP_WAIT_S);
    send_signal(crew, SIGKILL);
    wait_for_end(crew, k, STOP_WAIT_S);
}

/* ---- the bus of one's own ---- */

/* A port on which nobody listens, so that networks on one machine do not hear each other. */
static int free_port(void)
{
    int port = 0;
    int descriptor = socket(AF_INET, SOCK_DGRAM, 0);
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_ANY)};
    socklen_t length = sizeof address;
    if (descriptor >= 0 && bind(descriptor, (struct sockaddr *)&address, sizeof address) == 0 &&
        getsockname(descriptor, (struct sockaddr *)&address, &length) == 0)
        port = ntohs(address.sin_port);
    if (descriptor >= 0)
        close(descriptor);
    return port;
}

/* As much as the system grants without being asked as root: the kernel doubles what is set. */
static int receive_buffer(void)
{
    int limit = 0;
    FILE *file = fopen("/proc/sys/net/core/rmem_max", "r");
    if (file != NULL && fscanf(file, "%d", &limit) != 1)
        limit = 0;
    if (file != NULL)
        fclose(file);
    return limit > 0 && limit < RECEIVE_BUFFER / 2 ? 2 * limit : RECEIVE_BUFFER;
}

/* The recorder must not lose what comes in bursts: a UDP bus without a buffer's size gets ours. */
static void complete_url(const char *given, char *url, int size)
{
    if (strncmp(given, "udpm:", 5) != 0 || strstr(given, "recv_buf_size") != NULL)
        snprintf(url, (size_t)size, "%s", given);
    else
        snprintf(url, (size_t)size, "%s%crecv_buf_size=%d", given,
                 strchr(given, '?') != NULL ? '&' : '?', receive_buffer());
}

static bool choose_url(const struct run_options *options, char *url, int size, struct error *error)
{
    const char *given = options->common.lcm_url;
    if (given == NULL)
        given = getenv("LCM_DEFAULT_URL");
    if (given != NULL && given[0] != '\0') {
        complete_url(given, url, size);
        return true;
    }
    int port = free_port();
    if (port == 0)
        return error_set(error, "no free UDP port: %s", strerror(errno));
    snprintf(url, (size_t)size, "udpm://239.255.76.67:%d?ttl=0&recv_buf_size=%d", port,
             receive_buffer());
    return true;
}

/* ---- agents ---- */

struct argument_list {
    const char *items[2 * OPTIONS_MAX_OVERRIDES + 24];
    int count;
    char run_id[32], speed[32], lag[16];
};

static void add(struct argument_list *list, const char *item)
{
    list->items[list->count++] = item;
    list->items[list->count] = NULL;
}

static void add_common(struct argument_list *list, const struct run_options *options,
                       const struct scenario *scenario, const char *url, int64_t run_id)
{
    static const char *const paces[] = {"lockstep", "realtime", "replay"};
    add(list, scenario->file);
    add(list, "--lcm-url");
    add(list, url);
    add(list, "--pace");
    add(list, paces[options->common.pace]);
    if (run_id != 0) {
        snprintf(list->run_id, sizeof list->run_id, "%lld", (long long)run_id);
        add(list, "--run-id");
        add(list, list->run_id);
    }
    if (options->common.speed > 0) {
        snprintf(list->speed, sizeof list->speed, "%.17g", options->common.speed);
        add(list, "--speed");
        add(list, list->speed);
    }
    for (unsigned i = 0; i < options->common.overrides_count; i++) {
        add(list, "--set");
        add(list, options->common.overrides[i]);
    }
}

/* Messages of one sample: truth, input, measurements; exchanges, estimate and `done` of each node.
 */
static int messages_per_sample(const struct scenario *scenario, int agents)
{
    return 2 + scenario->process->n_subsystems + 6 * agents;
}

/* How many samples the clock may be ahead of the log: what surely fits into a socket's buffer. */
static void add_recorder_lag(struct argument_list *list, const struct scenario *scenario,
                             int agents)
{
    int lag = SOCKET_MESSAGES / messages_per_sample(scenario, agents);
    snprintf(list->lag, sizeof list->lag, "%d", lag > 1 ? lag : 1);
    add(list, "--recorder-lag");
    add(list, list->lag);
}

struct crowd {
    int estimators; /* of the largest network: they get a process each */
    bool coordinated;
    int agents; /* of all networks, coordinators included */
};

static bool count_nodes(const struct scenario *scenario, struct crowd *crowd, struct error *error)
{
    *crowd = (struct crowd){0};
    for (unsigned i = 0; i < scenario->networks_count; i++) {
        bool coordinator = false;
        int count = network_nodes(scenario, (int)i, &coordinator, error);
        if (count < 0)
            return false;
        crowd->agents += count;
        crowd->coordinated = crowd->coordinated || coordinator;
        count -= coordinator;
        crowd->estimators = count > crowd->estimators ? count : crowd->estimators;
    }
    return true;
}

/* One process for the coordinators of all networks. */
static bool start_coordinator(struct crew *crew, const struct run_options *options,
                              const struct scenario *scenario, const char *url, int64_t run_id,
                              struct error *error)
{
    char program[4096];
    struct argument_list list = {0};
    if (!program_beside("dse-coordinator", program, (int)sizeof program, error))
        return false;
    add(&list, program);
    add_common(&list, options, scenario, url, run_id);
    return spawn(crew, "dse-coordinator", list.items, error);
}

static bool start_agents(struct crew *crew, const struct run_options *options,
                         const struct scenario *scenario, const char *url, int64_t run_id,
                         bool recording, struct error *error)
{
    char program[4096], name[64], number[32];
    struct crowd crowd;
    if (!count_nodes(scenario, &crowd, error) ||
        !program_beside("dse-estimator", program, (int)sizeof program, error))
        return false;
    int nodes = crowd.estimators;
    int processes = nodes;
    if (options->processes > 0 && options->processes < nodes)
        processes = options->processes;
    for (int i = 0; i < processes; i++) {
        struct argument_list list = {0};
        int first = (int)((int64_t)i * nodes / processes);
        int last = (int)((int64_t)(i + 1) * nodes / processes) - 1;
        add(&list, program);
        add_common(&list, options, scenario, url, run_id);
        if (first == last)
            snprintf(number, sizeof number, "%d", first);
        else
            snprintf(number, sizeof number, "%d..%d", first, last);
        snprintf(name, sizeof name, "dse-estimator --node %s", number);
        add(&list, "--node");
        add(&list, number);
        if (!spawn(crew, name, list.items, error))
            return false;
    }
    if (crowd.coordinated && !start_coordinator(crew, options, scenario, url, run_id, error))
        return false;
    if (options->common.pace == DSE_CLOCK_T_PACE_REPLAY)
        return true; /* lcm-logplayer is the plant */
    struct argument_list list = {0};
    if (!program_beside("dse-plant", program, (int)sizeof program, error))
        return false;
    add(&list, program);
    add_common(&list, options, scenario, url, run_id);
    add(&list, "--wait");
    add(&list, JOIN_TEXT);
    if (recording)
        add_recorder_lag(&list, scenario, crowd.agents);
    return spawn(crew, "dse-plant", list.items, error);
}

/* Shows progress until all agents have ended, one has ended badly, or the user stops the run. */
static void watch(struct crew *crew, struct bus *bus, struct progress *progress,
                  struct recorder *recorder)
{
    while (count_alive(crew) > 0 && crew->failure[0] == '\0' && !host_interrupted()) {
        if (bus_wait(bus, recorder->pid != 0 ? 1 : 100) < 0)
            break;
        progress_tick(progress);
        reap(crew, progress->k);
        if (recorder->pid == 0)
            continue;
        recorder_follow(recorder);
        if (!recorder_alive(recorder))
            snprintf(crew->failure, sizeof crew->failure,
                     "lcm-logger has ended; the log stops at sample %lld",
                     (long long)recorder->sample);
    }
    if (crew->failure[0] != '\0')
        wait_for_end(crew, progress->k, 1.5); /* the others tell their own reasons */
    end_all(crew, progress->k);
    progress_end(progress);
}

/* The parts of a run on a bus, whatever way it ends. */
static bool conduct(struct crew *crew, const struct run_options *options,
                    const struct scenario *scenario, const char *url, struct bus *bus,
                    const char *log_path, struct error *error)
{
    struct progress progress;
    struct recorder recorder = {0};
    bool replay = options->common.pace == DSE_CLOCK_T_PACE_REPLAY;
    int64_t run_id = options->common.run_id;
    if (run_id == 0 && !replay)
        run_id = clock_new_run_id();
    bool recording = log_path[0] != '\0';
    bool ok =
        progress_watch(&progress, scenario, scenario_samples(scenario), options->quiet, bus, error);
    if (ok && recording)
        ok = recorder_start(&recorder, bus, url, log_path, scenario, run_id, error);
    ok = ok && start_agents(crew, options, scenario, url, run_id, recording, error);
    if (ok && replay)
        fprintf(stderr, "waiting for a log: lcm-logplayer --lcm-url='%s' LOG\n", url);
    if (ok)
        watch(crew, bus, &progress, &recorder);
    else
        end_all(crew, -1);
    recorder_end(&recorder);
    if (host_interrupted())
        return error_set(error, "interrupted at sample %lld", (long long)progress.k);
    if (crew->failure[0] != '\0')
        return error_set(error, "%s", crew->failure);
    return ok;
}

static bool run_crew(struct crew *crew, const struct run_options *options,
                     const struct scenario *scenario, const char *log_path, struct error *error)
{
    char url[512];
    if (!choose_url(options, url, (int)sizeof url, error) || !bus_check(url, error))
        return false;
    struct bus *bus = bus_open(url, error);
    if (bus == NULL)
        return false;
    if (!options->quiet)
        fprintf(stderr, "network %s\n", url);
    bool ok = conduct(crew, options, scenario, url, bus, log_path, error);
    bus_close(bus);
    return ok;
}

/* Whether the log holds every input and measurement of the run. */
static void check_log(const char *path, const struct scenario *scenario)
{
    struct error error = {0};
    struct recorded recorded;
    if (recorded_open(path, &recorded, &error) &&
        recorded_load(&recorded, scenario, false, &error) && recorded.missing > 0)
        fprintf(stderr, "dse-run: the log lacks %lld message(s) that did not reach lcm-logger\n",
                (long long)recorded.missing);
    recorded_free(&recorded);
}

int run_processes(const struct run_options *options, const struct scenario *scenario)
{
    struct error error = {0};
    char log_path[4096];
    struct crew *crew = calloc(1, sizeof *crew);
    if (crew == NULL)
        error_set(&error, "out of memory");
    if (crew == NULL || !run_log_path(options, scenario, log_path, (int)sizeof log_path, &error)) {
        free(crew);
        return options_complain("dse-run", &error);
    }
    bool ok = run_crew(crew, options, scenario, log_path, &error);
    if (!ok)
        options_complain("dse-run", &error);
    if (ok && log_path[0] != '\0' && options->common.pace != DSE_CLOCK_T_PACE_REPLAY)
        check_log(log_path, scenario);
    run_log_tell(log_path);
    free(crew);
    return ok ? 0 : EXIT_RUN;
}
