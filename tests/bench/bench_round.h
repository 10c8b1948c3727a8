/* Rounds between two processes over LCM's multicast, done bare and by the agents. */
#ifndef BENCH_ROUND_H
#define BENCH_ROUND_H

#include <stdbool.h>

#define ROUND_COUNT 4000 /* measured rounds of one repetition */

/* What one of the two processes, side 0, hands to the parent. */
struct round_times {
    int count; /* complete when ROUND_COUNT */
    double begin_ns;
    double ns[ROUND_COUNT];
};

/* Ends the round under way and begins the next one. */
void round_tick(struct round_times *times);
/* The time until the next tick belongs to no round. */
void round_pause(struct round_times *times);

/* A contender does the rounds of one side and returns when both sides are through. The time of each
 * round of side 0 goes into times, which is NULL on side 1. False when something went wrong. */
typedef bool (*round_contender)(const char *url, int side, struct round_times *times);

/* LCM alone: side 0 says, side 1 answers as soon as it hears. */
bool round_ping_pong(const char *url, int side, struct round_times *times);
/* LCM alone: both say, and the round ends when both have heard. */
bool round_exchange(const char *url, int side, struct round_times *times);
/* Two nodes of the agents' runtime with a method that only talks. */
bool round_agents(const char *url, int side, struct round_times *times);
/* Two nodes of the adaptive high-gain EKF, rounds 1 to 3 of each sample of ahg-43. */
bool round_high_gain(const char *url, int side, struct round_times *times);

/* Bytes of the message that each of them says. */
int round_payload(void);

#endif
