/* The event loop: messages first, then whatever is due. */
#include "runtime/agent.h"

#include <math.h>
#include <signal.h>
#include <stddef.h>
#include <time.h>

#define HOST_MAX_WAIT 0.2 /* s */
#define HOST_LINGER   1.0 /* s that the others get to finish once one agent has failed */

static volatile sig_atomic_t interrupted;

static void on_signal(int number)
{
    (void)number;
    interrupted = 1;
}

void host_catch_signals(void)
{
    struct sigaction action = {.sa_handler = on_signal};
    sigemptyset(&action.sa_mask);
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    signal(SIGPIPE, SIG_IGN);
}

bool host_interrupted(void)
{
    return interrupted != 0;
}

double host_now(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* Polls everybody; the earliest time at which somebody wants to be polled again. */
static double poll_all(struct agent *agents, int n_agents, double now)
{
    double next = now + HOST_MAX_WAIT;
    for (int i = 0; i < n_agents; i++) {
        enum agent_state state = agents[i].state(agents[i].self);
        if (state == AGENT_FINISHED || state == AGENT_FAILED)
            continue;
        next = fmin(next, agents[i].poll(agents[i].self, now));
    }
    return next;
}

static int count_in(const struct agent *agents, int n_agents, enum agent_state state, int *which)
{
    int count = 0;
    for (int i = 0; i < n_agents; i++)
        if (agents[i].state(agents[i].self) == state) {
            *which = count == 0 ? i : *which;
            count++;
        }
    return count;
}

static void stop_all(struct agent *agents, int n_agents, const char *reason)
{
    for (int i = 0; i < n_agents; i++)
        agents[i].stop(agents[i].self, reason);
}

bool host_run(struct bus *bus, struct agent *agents, int n_agents, void (*tick)(void *),
              void *tick_user, struct error *error)
{
    double linger_until = 0;
    bool stopping = false;
    for (;;) {
        double now = host_now();
        double next = poll_all(agents, n_agents, now);
        if (tick != NULL)
            tick(tick_user);
        int which = 0;
        int failed = count_in(agents, n_agents, AGENT_FAILED, &which);
        if (failed > 0) {
            error_set(error, "%s: %s", agents[which].name,
                      agents[which].reason(agents[which].self));
            if (!stopping)
                stop_all(agents, n_agents, error->text);
            linger_until = stopping ? linger_until : now + HOST_LINGER;
            stopping = true;
        }
        int ended = failed + count_in(agents, n_agents, AGENT_FINISHED, &which);
        if (ended == n_agents || (failed > 0 && now > linger_until))
            return failed == 0;
        if (interrupted && !stopping) {
            stop_all(agents, n_agents, "interrupted");
            stopping = true;
            continue;
        }
        double wait = fmax(0, fmin(next - host_now(), HOST_MAX_WAIT));
        if (bus_wait(bus, (int)ceil(wait * 1000)) < 0)
            return error_set(error, "the bus %s failed", bus_url(bus));
    }
}
