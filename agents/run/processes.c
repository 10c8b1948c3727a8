/* The network as processes: a logger, the plant, one estimator process per node. */
#include <errno.h>
#include <netinet/in.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "dse_clock_t.h"
#include "run/programs.h"
#include "run/progress.h"
#include "run/run.h"
#include "runtime/agent.h"
#include "runtime/channels.h"
#include "runtime/clock.h"
#include "runtime/node.h"
#include "runtime/run_info.h"
#include "runtime/sender.h"

#define MAX_PROCESSES 1100
#define LOGGER_WAIT_S 5.0
#define STOP_WAIT_S   3.0
#define JOIN_TEXT     "20"

struct process {
    pid_t pid; /* 0: ended */
    char name[64];
    int exit_status; /* as from waitpid */
};

struct crew {
    struct process list[MAX_PROCESSES];
    int count;
    int logger; /* index, -1: none */
    char failure[512];
};

/* ---- starting and ending processes ---- */

static bool spawn(struct crew *crew, const char *name, const char *const *arguments, bool silent,
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
        if (silent && freopen("/dev/null", "w", stdout) == NULL)
            _exit(126);
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

/* Collects processes that have ended; notes the first that ended badly. */
static void reap(struct crew *crew, int64_t k)
{
    int status;
    pid_t pid;
    while ((pid = waitpid(-1, &status, WNOHANG)) > 0)
        for (int i = 0; i < crew->count; i++) {
            struct process *process = &crew->list[i];
            if (process->pid != pid)
                continue;
            process->pid = 0;
            process->exit_status = status;
            if (status == 0 || crew->failure[0] != '\0' || i == crew->logger)
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
        alive += crew->list[i].pid != 0 && i != crew->logger;
    return alive;
}

static void send_signal(const struct crew *crew, int number)
{
    for (int i = 0; i < crew->count; i++)
        if (crew->list[i].pid != 0 && i != crew->logger)
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

/* ---- the logger ---- */

static int64_t file_size(const char *path)
{
    struct stat status;
    return stat(path, &status) == 0 ? (int64_t)status.st_size : -1;
}

static void ping(struct bus *bus, const struct scenario *scenario, int state)
{
    struct sender sender = {.bus = bus};
    sender.id.role = DSE_HEADER_T_ROLE_RUN;
    sender.id.network = -1;
    dse_status_t message = {
        .scenario_hash = (int64_t)scenario->hash, .pid = (int32_t)getpid(), .state = (int8_t)state};
    sender_status(&sender, -1, 0, &message);
}

/* The logger is ready when what we say reaches its file. */
static bool start_logger(struct crew *crew, struct bus *bus, const char *url, const char *path,
                         const struct scenario *scenario, struct error *error)
{
    char logger[4096], url_option[600];
    if (!program_logger(logger, (int)sizeof logger, error))
        return false;
    snprintf(url_option, sizeof url_option, "--lcm-url=%s", url);
    const char *arguments[] = {logger, url_option, "--force", "--quiet", "--flush-interval=100",
                               path,   NULL};
    crew->logger = crew->count;
    if (!spawn(crew, "lcm-logger", arguments, true, error))
        return false;
    double until = host_now() + LOGGER_WAIT_S;
    while (file_size(path) <= 0) {
        int status;
        if (waitpid(crew->list[crew->logger].pid, &status, WNOHANG) > 0) {
            crew->list[crew->logger].pid = 0;
            return error_set(error, "lcm-logger (%s) ended at once with exit code %d", logger,
                             WEXITSTATUS(status));
        }
        if (host_now() > until)
            return error_set(error, "lcm-logger wrote nothing into %s within %g s", path,
                             LOGGER_WAIT_S);
        ping(bus, scenario, DSE_STATUS_T_STATE_JOINING);
        bus_wait(bus, 20);
    }
    return true;
}

/* Lets it write what has arrived, then ends it. */
static void end_logger(struct crew *crew, const char *path)
{
    if (crew->logger < 0 || crew->list[crew->logger].pid == 0)
        return;
    int64_t before = -1;
    for (int quiet = 0, i = 0; quiet < 3 && i < 100; i++) {
        int64_t now = file_size(path);
        quiet = now == before ? quiet + 1 : 0;
        before = now;
        usleep(100000);
    }
    pid_t pid = crew->list[crew->logger].pid;
    kill(pid, SIGTERM);
    for (int i = 0; i < 200 && waitpid(pid, NULL, WNOHANG) == 0; i++)
        usleep(10000);
    crew->list[crew->logger].pid = 0;
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

static bool choose_url(const struct run_options *options, char *url, int size, struct error *error)
{
    const char *given = options->common.lcm_url;
    if (given == NULL)
        given = getenv("LCM_DEFAULT_URL");
    if (given != NULL && given[0] != '\0') {
        snprintf(url, (size_t)size, "%s", given);
        return true;
    }
    int port = free_port();
    if (port == 0)
        return error_set(error, "no free UDP port: %s", strerror(errno));
    snprintf(url, (size_t)size, "udpm://239.255.76.67:%d?ttl=0", port);
    return true;
}

/* ---- agents ---- */

struct argument_list {
    const char *items[2 * OPTIONS_MAX_OVERRIDES + 24];
    int count;
    char run_id[32], speed[32];
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

static bool start_agents(struct crew *crew, const struct run_options *options,
                         const struct scenario *scenario, const char *url, int64_t run_id,
                         struct error *error)
{
    char program[4096], name[64], number[16];
    int nodes = 0;
    for (unsigned i = 0; i < scenario->networks_count; i++) {
        int count = node_count(scenario, (int)i, NULL, error);
        if (count < 0)
            return false;
        nodes = count > nodes ? count : nodes;
    }
    if (!program_beside("dse-estimator", program, (int)sizeof program, error))
        return false;
    for (int node = 0; node < nodes; node++) {
        struct argument_list list = {0};
        add(&list, program);
        add_common(&list, options, scenario, url, run_id);
        snprintf(number, sizeof number, "%d", node);
        snprintf(name, sizeof name, "dse-estimator --node %d", node);
        add(&list, "--node");
        add(&list, number);
        if (!spawn(crew, name, list.items, false, error))
            return false;
    }
    if (options->common.pace == DSE_CLOCK_T_PACE_REPLAY)
        return true; /* lcm-logplayer is the plant */
    struct argument_list list = {0};
    if (!program_beside("dse-plant", program, (int)sizeof program, error))
        return false;
    add(&list, program);
    add_common(&list, options, scenario, url, run_id);
    add(&list, "--wait");
    add(&list, JOIN_TEXT);
    return spawn(crew, "dse-plant", list.items, false, error);
}

/* Shows progress until all agents have ended, one has ended badly, or the user stops the run. */
static void watch(struct crew *crew, struct bus *bus, struct progress *progress)
{
    while (count_alive(crew) > 0 && crew->failure[0] == '\0' && !host_interrupted()) {
        if (bus_wait(bus, 100) < 0)
            break;
        progress_tick(progress);
        reap(crew, progress->k);
    }
    if (crew->failure[0] != '\0')
        wait_for_end(crew, progress->k, 1.5); /* the others tell their own reasons */
    end_all(crew, progress->k);
    progress_end(progress);
}

static bool run_crew(struct crew *crew, const struct run_options *options,
                     const struct scenario *scenario, const char *log_path, struct error *error)
{
    char url[512];
    struct progress progress;
    if (!choose_url(options, url, (int)sizeof url, error) || !bus_check(url, error))
        return false;
    struct bus *bus = bus_open(url, error);
    if (bus == NULL)
        return false;
    int64_t run_id = options->common.run_id;
    if (run_id == 0 && options->common.pace != DSE_CLOCK_T_PACE_REPLAY)
        run_id = clock_new_run_id();
    if (!options->quiet)
        fprintf(stderr, "network %s\n", url);
    bool ok =
        progress_watch(&progress, scenario, scenario_samples(scenario), options->quiet, bus, error);
    if (ok && log_path[0] != '\0')
        ok = start_logger(crew, bus, url, log_path, scenario, error);
    ok = ok && start_agents(crew, options, scenario, url, run_id, error);
    if (ok && options->common.pace == DSE_CLOCK_T_PACE_REPLAY)
        fprintf(stderr, "waiting for a log: lcm-logplayer --lcm-url='%s' LOG\n", url);
    if (ok)
        watch(crew, bus, &progress);
    else
        end_all(crew, -1);
    end_logger(crew, log_path);
    bus_close(bus);
    if (host_interrupted())
        return error_set(error, "interrupted at sample %lld", (long long)progress.k);
    if (crew->failure[0] != '\0')
        return error_set(error, "%s", crew->failure);
    return ok;
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
    crew->logger = -1;
    bool ok = run_crew(crew, options, scenario, log_path, &error);
    if (!ok)
        options_complain("dse-run", &error);
    if (log_path[0] != '\0' && file_size(log_path) > 0)
        printf("log: %s\n", log_path);
    free(crew);
    return ok ? 0 : EXIT_RUN;
}
