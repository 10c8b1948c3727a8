/* Time of one round of the agents (both say, both hear) against a bare LCM ping-pong of the same
 * payload over the same multicast, between two processes. Contenders take turns, so that whatever
 * else the machine does hits all alike. Exits with 1 only when a contender fails. */
#include "bench_round.h"

#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#define REPETITIONS 9
#define TIME_LIMIT  20 /* s for one repetition: LCM alone would wait for ever */

enum { PING_PONG, EXCHANGE, AGENTS, HIGH_GAIN, CONTENDERS };

static const struct contender {
    const char *name;
    round_contender run;
} contenders[CONTENDERS] = {
    [PING_PONG] = {"LCM, ping-pong: there and back", round_ping_pong},
    [EXCHANGE] = {"LCM, exchange: both say, both hear", round_exchange},
    [AGENTS] = {"agents, a method that only talks", round_agents},
    [HIGH_GAIN] = {"agents, high-gain EKF (computes)", round_high_gain},
};

void round_tick(struct round_times *times)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    const double now = 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
    if (times->begin_ns > 0 && times->count < ROUND_COUNT)
        times->ns[times->count++] = now - times->begin_ns;
    times->begin_ns = now;
}

void round_pause(struct round_times *times)
{
    times->begin_ns = 0;
}

/* A multicast address of this machine alone, on a port that nobody uses. */
static bool free_url(char *url, size_t size)
{
    struct sockaddr_in address = {.sin_family = AF_INET};
    socklen_t length = sizeof address;
    const int number = socket(AF_INET, SOCK_DGRAM, 0);
    const bool ok = number >= 0 && bind(number, (struct sockaddr *)&address, sizeof address) == 0 &&
                    getsockname(number, (struct sockaddr *)&address, &length) == 0;
    if (number >= 0)
        close(number);
    snprintf(url, size, "udpm://239.255.76.67:%d?ttl=0", ntohs(address.sin_port));
    return ok;
}

/* One repetition: two processes that end by themselves. */
static bool repeat(round_contender run, struct round_times *times)
{
    char url[64];
    pid_t sides[2];
    bool ok = free_url(url, sizeof url);
    times->count = 0;
    times->begin_ns = 0;
    fflush(NULL);
    for (int side = 0; side < 2; side++) {
        sides[side] = fork();
        if (sides[side] == 0) {
            alarm(TIME_LIMIT);
            _exit(run(url, side, side == 0 ? times : NULL) ? 0 : 1);
        }
    }
    for (int side = 0; side < 2; side++) {
        int status = 1;
        ok = sides[side] > 0 && waitpid(sides[side], &status, 0) > 0 && status == 0 && ok;
    }
    return ok && times->count == ROUND_COUNT;
}

static int compare(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Sorts the values. */
static double median(double *values, int count)
{
    qsort(values, (size_t)count, sizeof *values, compare);
    return values[count / 2];
}

static double medians[CONTENDERS][REPETITIONS]; /* ns per round */

/* Median of the ratio of two contenders in the same repetition. */
static double ratio(int a, int b)
{
    double ratios[REPETITIONS];
    for (int r = 0; r < REPETITIONS; r++)
        ratios[r] = medians[a][r] / medians[b][r];
    return median(ratios, REPETITIONS);
}

static void print_row(int c)
{
    double sorted[REPETITIONS];
    memcpy(sorted, medians[c], sizeof sorted);
    const double middle = median(sorted, REPETITIONS);
    printf("%-36s %8.1f %8.1f %8.1f   %9.2f %9.2f\n", contenders[c].name, middle * 1e-3,
           sorted[0] * 1e-3, sorted[REPETITIONS - 1] * 1e-3, ratio(c, PING_PONG),
           ratio(c, EXCHANGE));
}

int main(void)
{
    struct round_times *times =
        mmap(NULL, sizeof *times, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (times == MAP_FAILED)
        return 1;
    for (int r = 0; r < REPETITIONS; r++)
        for (int c = 0; c < CONTENDERS; c++) {
            if (!repeat(contenders[c].run, times)) {
                printf("%s: failed\n", contenders[c].name);
                return 1;
            }
            medians[c][r] = median(times->ns, ROUND_COUNT);
        }
    printf("Round between two processes in us, %d bytes a message: median of %d repetitions of %d\n"
           "rounds, fastest and slowest repetition, ratio to LCM alone in the same repetition\n"
           "%-36s   median  fastest  slowest   ping-pong  exchange\n",
           round_payload(), REPETITIONS, ROUND_COUNT, "");
    for (int c = 0; c < CONTENDERS; c++)
        print_row(c);
    return 0;
}
