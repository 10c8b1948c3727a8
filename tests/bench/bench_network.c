/* The networks, and contenders that take turns, so that whatever else the machine does hits all
 * alike. */
#include "bench_network.h"

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "dse/linalg.h"
#include "dse/random.h"

#define MEAN_DEGREE 9.16 /* 458 directed edges, 50 nodes */

struct dse_graph bench_graph;
static dse_real memory[DSE_GRAPH_STORAGE(BENCH_NODES, BENCH_EDGES)];
static int pairs[2 * BENCH_EDGES];

double bench_now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

dse_real bench_multiply(int steps, double count)
{
    static dse_real a[16], b[16];
    for (int k = 0; k < 16; k++)
        a[k] = (dse_real)k;
    const int vectors = (int)(count / 16) + 1;
    for (int s = 0; s < steps; s++)
        for (int v = 0; v < vectors; v++)
            dse_axpy(16, DSE_REAL(1e-9), a, b);
    return b[3];
}

/* ---- graphs ---- */

static int ring_pairs(int nodes)
{
    for (int i = 0; i < nodes; i++) {
        pairs[2 * i] = i;
        pairs[2 * i + 1] = (i + 1) % nodes;
    }
    return nodes;
}

/* Links between all pairs nearer than a radius in the unit square. */
static int geometric_pairs(int nodes)
{
    static double at[BENCH_NODES][2];
    struct dse_random random;
    const double radius_2 = MEAN_DEGREE / (3.14159265 * nodes);
    int count = 0;
    dse_random_init(&random, 5, 0);
    for (int i = 0; i < nodes; i++) {
        at[i][0] = dse_random_uniform(&random);
        at[i][1] = dse_random_uniform(&random);
        for (int j = 0; j < i && count < BENCH_EDGES / 2; j++) {
            const double dx = at[i][0] - at[j][0], dy = at[i][1] - at[j][1];
            if (dx * dx + dy * dy > radius_2)
                continue;
            pairs[2 * count] = i;
            pairs[2 * count + 1] = j;
            count++;
        }
    }
    return count;
}

static bool make_graph(int nodes, bool geometric)
{
    struct dse_arena arena;
    const int count = geometric ? geometric_pairs(nodes) : ring_pairs(nodes);
    dse_arena_init(&arena, memory, (int)(sizeof memory / sizeof memory[0]));
    return dse_graph_make(&bench_graph, nodes, count, pairs, true, &arena) == DSE_OK;
}

/* ---- measuring ---- */

static int compare(const void *a, const void *b)
{
    const double p = *(const double *)a, q = *(const double *)b;
    return (p > q) - (p < q);
}

struct times {
    double ns;       /* least time of one step of the network */
    double to_floor; /* median of the ratios to the floor, and to a fixed piece of work, turn by */
    double to_work;  /* turn: neither sees the processor change its clock */
};

static bool measure(const struct bench_contender *c, int nodes, struct times *times)
{
    static double ns[BENCH_TURNS], floors[BENCH_TURNS], works[BENCH_TURNS];
    static dse_real ballast;
    const int repeat = 1 + 4000 / nodes;
    for (int turn = -2; turn < BENCH_TURNS; turn++) {
        const double begin = bench_now_ns();
        for (int r = 0; r < repeat; r++)
            if (!c->step(nodes))
                return false;
        const double stepped = bench_now_ns();
        for (int r = 0; r < repeat; r++)
            c->step_floor(nodes);
        const double floored = bench_now_ns();
        ballast += bench_multiply(100, 1000);
        if (turn >= 0) {
            ns[turn] = (stepped - begin) / repeat;
            floors[turn] = (stepped - begin) / (floored - stepped);
            works[turn] = (stepped - begin) / repeat / (bench_now_ns() - floored);
        }
    }
    qsort(ns, BENCH_TURNS, sizeof ns[0], compare);
    qsort(floors, BENCH_TURNS, sizeof floors[0], compare);
    qsort(works, BENCH_TURNS, sizeof works[0], compare);
    *times = (struct times){ns[0], floors[BENCH_TURNS / 2], works[BENCH_TURNS / 2]};
    return ballast == ballast;
}

/* The last column says whether the cost grows faster than the edges: an edge's cost to that of the
 * network with 50 nodes. */
static bool bench_kind(const struct bench_contender *c, bool geometric)
{
    static const int sizes[] = {50, 6, 20, 200, 500, 1000, 2000};
    double fifty = 0;
    printf("%s\n  nodes   edges  us a step   ns a node  ns an edge  bytes a node  to the floor  an "
           "edge, to 50 nodes\n",
           geometric ? "random geometric graphs" : "rings, both ways");
    for (size_t s = 0; s < sizeof sizes / sizeof sizes[0]; s++) {
        struct times times;
        bool made = make_graph(sizes[s], geometric) && c->make(sizes[s]);
        if (made)
            c->make_floor(sizes[s]);
        if (!made || !measure(c, sizes[s], &times) || !c->agree(sizes[s])) {
            printf("%d nodes: failed\n", sizes[s]);
            return false;
        }
        const double an_edge = times.to_work / bench_graph.edges;
        fifty = s == 0 ? an_edge : fifty;
        printf("  %5d  %6d  %9.1f  %10.0f  %10.0f  %12.0f  %12.2f  %20.2f\n", sizes[s],
               bench_graph.edges, 1e-3 * times.ns, times.ns / sizes[s],
               times.ns / bench_graph.edges, c->bytes(sizes[s]), times.to_floor, an_edge / fifty);
    }
    return true;
}

bool bench_networks(const struct bench_contender *contender)
{
    return bench_kind(contender, false) && bench_kind(contender, true);
}
