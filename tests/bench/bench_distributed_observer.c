/* Time of a period of a whole network of adaptive distributed observers (the default law, a gain
 * per edge) in one process, from 6 to 2,000 nodes: one Runge-Kutta step of every node, messages,
 * their reception. Every node measures one of two states of an oscillator and observes the other
 * one:
 *
 *     x1' = -0.15 x1 - 2 x2,  x2' = 2 x1;    z = x_other - g y,  z' = -z + L y,  xh_other = z + g y
 *
 * Beside it the floor: the same equations written out, with all sizes known to the compiler, no
 * checks and no protections, on the same graph; both must agree. Prints tables; exits with 1 only
 * when an observer fails or the two disagree. */
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

#include "dse/distributed_observer.h"
#include "dse/math.h"
#include "dse/random.h"

#include "bench_network.h"

enum {
    NODES = BENCH_NODES,
    EDGES = BENCH_EDGES,
    PER_NODE = DSE_DISTRIBUTED_OBSERVER_STORAGE(1, 0, 1, 2, 0, 0, 0),
    /* what a neighbour adds, at most */
    PER_EDGE = DSE_DISTRIBUTED_OBSERVER_STORAGE(1, 0, 1, 2, 1, 1, 1) - PER_NODE + 1
};
#define PERIOD DSE_REAL(0.01)
#define GAMMA  DSE_REAL(0.1)

/* By the state that a node measures. */
static const dse_real g[2] = {DSE_REAL(-0.5), DSE_REAL(0.425)};
static const dse_real Lambda[1] = {-1}, Pi[1] = {DSE_REAL(0.5)};
static const dse_real L[2][1] = {{DSE_REAL(2.425)}, {DSE_REAL(-2.425)}};
static const dse_real M[2][2] = {{0, 1}, {1, 0}};
static const dse_real N[2][2] = {{1, DSE_REAL(-0.5)}, {DSE_REAL(0.425), 1}};
static const dse_real C2[2][2] = {{1, 0}, {0, 1}};

static dse_real memory[NODES * PER_NODE + EDGES * PER_EDGE];
static struct dse_observer_rows rows[EDGES];
static struct dse_distributed_observer_config config[NODES];
static struct dse_distributed_observer node[NODES];
static dse_real guess[NODES][1], plant[2];
static long period;
static int reals_used;

static int degree(int i)
{
    return dse_graph_in_degree(&bench_graph, i);
}

/* ---- the network ---- */

static bool make_network(int nodes)
{
    struct dse_arena arena;
    struct dse_random random;
    for (int k = 0; k < bench_graph.edges; k++)
        rows[k] = (struct dse_observer_rows){1, C2[bench_graph.in[k] % 2]};
    dse_arena_init(&arena, memory, (int)(sizeof memory / sizeof memory[0]));
    dse_random_init(&random, 7, 0);
    for (int i = 0; i < nodes; i++) {
        guess[i][0] = (dse_real)(2 * dse_random_uniform(&random) - 1);
        config[i] =
            (struct dse_distributed_observer_config){.nz = 1,
                                                     .ny = 1,
                                                     .nx = 2,
                                                     .Lambda = Lambda,
                                                     .L = L[i % 2],
                                                     .M = M[i % 2],
                                                     .N = N[i % 2],
                                                     .z0 = guess[i],
                                                     .neighbours = degree(i),
                                                     .Pi = Pi,
                                                     .theirs = rows + bench_graph.in_first[i],
                                                     .gamma = GAMMA};
        if (dse_distributed_observer_init(&node[i], &config[i], &arena) != DSE_OK)
            return false;
    }
    reals_used = arena.used;
    plant[0] = 1, plant[1] = 0;
    period = 0;
    return true;
}

/* What is measured goes round, near enough to the oscillator: nothing here depends on it. */
static void turn_plant(dse_real *x)
{
    const dse_real x1 = x[0] - 2 * PERIOD * x[1];
    x[1] += 2 * PERIOD * x1;
    x[0] = x1;
}

static bool step_network(int nodes)
{
    bool good = true;
    for (int i = 0; i < nodes; i++) {
        const struct dse_measurement sample = {&plant[i % 2], NULL};
        good &= dse_distributed_observer_sample(&node[i], (dse_real)period * PERIOD, NULL,
                                                &sample) == DSE_OK;
    }
    for (int i = 0; i < nodes; i++) {
        for (int k = bench_graph.in_first[i]; k < bench_graph.in_first[i + 1]; k++) {
            const int j = bench_graph.in[k];
            const dse_real *said = &dse_distributed_observer_estimate(&node[j])[j % 2];
            good &= dse_distributed_observer_receive_rows(&node[i], k - bench_graph.in_first[i],
                                                          said) == DSE_OK;
        }
    }
    turn_plant(plant);
    period++;
    return good;
}

/* ---- the floor ---- */

static dse_real bare_z[NODES], bare_x[NODES][2], gamma_ij[EDGES], said[EDGES], bare_plant[2];
static dse_real before[2];
static bool bare_started;

static void make_bare(int nodes)
{
    for (int i = 0; i < nodes; i++)
        bare_z[i] = guess[i][0];
    memset(gamma_ij, 0, sizeof gamma_ij);
    bare_plant[0] = 1, bare_plant[1] = 0;
    bare_started = false;
}

/* Neighbour j compares its state type_j; only the other state than the own one depends on z. */
static dse_real bare_rates(int i, dse_real z, dse_real y, int count, const dse_real *gain,
                           dse_real *dgain)
{
    const int own = i % 2, first = bench_graph.in_first[i];
    const dse_real other = z + g[own] * y;
    dse_real pull = 0;
    for (int j = 0; j < count; j++) {
        const int theirs = bench_graph.in[first + j] % 2;
        const dse_real d = said[first + j] - (theirs == own ? y : other);
        pull += theirs == own ? 0 : gain[j] * d;
        dgain[j] = GAMMA * d * d;
    }
    return -z + L[own][0] * y + pull / Pi[0];
}

static void bare_step(int i)
{
    static const dse_real at[4] = {0, DSE_REAL(0.5), DSE_REAL(0.5), 1}, weight[4] = {1, 2, 2, 1};
    dse_real dgain[128], stage_gain[128], sum_gain[128], dz = 0, sum = 0;
    const int first = bench_graph.in_first[i], count = degree(i);
    memset(sum_gain, 0, sizeof(dse_real) * (size_t)count);
    memset(dgain, 0, sizeof(dse_real) * (size_t)count);
    for (int r = 0; r < 4; r++) {
        const dse_real a = at[r] * PERIOD;
        for (int j = 0; j < count; j++)
            stage_gain[j] = gamma_ij[first + j] + a * dgain[j];
        const dse_real y = before[i % 2] + at[r] * (bare_plant[i % 2] - before[i % 2]);
        dz = bare_rates(i, bare_z[i] + a * dz, y, count, stage_gain, dgain);
        sum += weight[r] * dz;
        for (int j = 0; j < count; j++)
            sum_gain[j] += weight[r] * dgain[j];
    }
    bare_z[i] += PERIOD / 6 * sum;
    for (int j = 0; j < count; j++)
        gamma_ij[first + j] += PERIOD / 6 * sum_gain[j];
}

static void step_bare(int nodes)
{
    for (int i = 0; i < nodes && bare_started; i++)
        bare_step(i);
    for (int i = 0; i < nodes; i++) {
        bare_x[i][i % 2] = bare_plant[i % 2];
        bare_x[i][1 - i % 2] = bare_z[i] + g[i % 2] * bare_plant[i % 2];
    }
    for (int i = 0; i < nodes; i++)
        for (int k = bench_graph.in_first[i]; k < bench_graph.in_first[i + 1]; k++)
            said[k] = bare_x[bench_graph.in[k]][bench_graph.in[k] % 2];
    before[0] = bare_plant[0], before[1] = bare_plant[1];
    turn_plant(bare_plant);
    bare_started = true;
}

static bool agree(int nodes)
{
    for (int i = 0; i < nodes; i++)
        for (int c = 0; c < 2; c++)
            if (!(dse_abs(dse_distributed_observer_estimate(&node[i])[c] - bare_x[i][c]) <
                  dse_sqrt(DSE_REAL_EPSILON)))
                return false;
    return true;
}

static double bytes(int nodes)
{
    return (double)reals_used * sizeof(dse_real) / nodes + sizeof(struct dse_distributed_observer);
}

int main(void)
{
    const struct bench_contender observers = {.make = make_network,
                                              .step = step_network,
                                              .make_floor = make_bare,
                                              .step_floor = step_bare,
                                              .agree = agree,
                                              .bytes = bytes};
    printf("Adaptive distributed observers, a gain per edge, two states, one of them measured "
           "(%s)\n",
           sizeof(dse_real) == sizeof(double) ? "double" : "float");
    return bench_networks(&observers) ? 0 : 1;
}
