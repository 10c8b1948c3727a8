/* Networks of 6 to 2,000 nodes whose steps are measured against a floor, and against a fixed piece
 * of work: what the benches of distributed methods share. */
#ifndef BENCH_NETWORK_H
#define BENCH_NETWORK_H

#include <stdbool.h>

#include "dse/graph.h"
#include "dse/real.h"

enum { BENCH_NODES = 2000, BENCH_EDGES = 40000, BENCH_TURNS = 31 };

/* Who hears whom in the network that is being measured. */
extern struct dse_graph bench_graph;

/* A method and its floor, the same equations without what makes it a library. */
struct bench_contender {
    bool (*make)(int nodes); /* on bench_graph */
    bool (*step)(int nodes); /* messages, their reception, one step of every node */
    void (*make_floor)(int nodes);
    void (*step_floor)(int nodes);
    bool (*agree)(int nodes);   /* both have the same estimates */
    double (*bytes)(int nodes); /* memory of a node */
};

/* Rings, then random geometric graphs of the mean degree of the source's 50-node network: prints a
 * table of each. False: a step failed, or the two disagree. */
bool bench_networks(const struct bench_contender *contender);

/* Processor time of this process: others may share the processor. */
double bench_now_ns(void);
/* So many multiplications and additions per step in vectors of 16 that stay in the cache. */
dse_real bench_multiply(int steps, double count);

#endif
