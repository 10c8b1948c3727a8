/* Time of a step of a whole network of adaptive distributed Kalman filters (edge-dependent gains)
 * in one process, from 6 to 2,000 nodes: messages, their reception, one Runge-Kutta step of every
 * node. Rings, and random geometric graphs of the mean degree of the source's 50-node network.
 * Beside it the floor: the same equations written out for two states and one output, with all sizes
 * known to the compiler, no checks and no protections, on the same graph; both must agree. Then one
 * node for more states. Contenders take turns, so that whatever else the machine does hits all
 * alike. Prints tables; exits with 1 only when a filter fails or the two disagree. */
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

#include "dse/distributed_kalman.h"
#include "dse/math.h"
#include "dse/random.h"

#include "bench_network.h"

enum { NODES = BENCH_NODES, EDGES = BENCH_EDGES, NODE_STEPS = 20000, MOST_NX = 10 };
#define PERIOD DSE_REAL(0.01)
#define GAMMA  DSE_REAL(0.0005)

/* ---- the network ---- */

static enum dse_status constant_A(const struct dse_model *model, dse_real t, const dse_real *x,
                                  const dse_real *u, dse_real *A)
{
    (void)t, (void)x, (void)u;
    memcpy(A, model->parameters, sizeof(dse_real) * (size_t)(model->nx * model->nx));
    return DSE_OK;
}

static const dse_real A2[4] = {DSE_REAL(-0.15), -2, 2, 0};
static const struct dse_model plant = {
    .time = DSE_CONTINUOUS, .nx = 2, .ny = 1, .parameters = A2, .dfdx = constant_A};
static const dse_real identity[4] = {1, 0, 0, 1};
static const dse_real outputs[2][2] = {{1, 0}, {0, 1}};
static const dse_real noise = DSE_REAL(0.5);

static dse_real memory[NODES * DSE_DKF_STORAGE(2, 1, 0) + EDGES * 8];
static int place[EDGES];
static struct dse_dkf_sensor listeners[EDGES];
static struct dse_dkf_config config[NODES];
static struct dse_dkf node[NODES];
static dse_real guess[NODES][2], y[NODES];
static int reals_used;

static bool make_network(int nodes)
{
    struct dse_arena arena;
    struct dse_random random;
    for (int k = 0; k < bench_graph.edges; k++)
        listeners[k] = (struct dse_dkf_sensor){1, outputs[bench_graph.out[k] % 2]};
    dse_arena_init(&arena, memory, (int)(sizeof memory / sizeof memory[0]));
    dse_random_init(&random, 7, 0);
    for (int i = 0; i < nodes; i++) {
        for (int k = bench_graph.in_first[i]; k < bench_graph.in_first[i + 1]; k++)
            place[k] = dse_graph_out_place(&bench_graph, bench_graph.in[k], i);
        for (int c = 0; c < 2; c++)
            guess[i][c] = (dse_real)(2 * dse_random_uniform(&random) - 1);
        config[i] = (struct dse_dkf_config){.model = &plant,
                                            .period = PERIOD,
                                            .sensor = {1, outputs[i % 2]},
                                            .n_neighbours = dse_graph_in_degree(&bench_graph, i),
                                            .n_listeners = dse_graph_out_degree(&bench_graph, i),
                                            .listeners = listeners + bench_graph.out_first[i],
                                            .scheme = DSE_DKF_EDGE,
                                            .x0 = guess[i],
                                            .P0 = identity,
                                            .Q = identity,
                                            .R = &noise,
                                            .gamma = GAMMA};
        if (dse_dkf_init(&node[i], &config[i], &arena) != DSE_OK)
            return false;
    }
    reals_used = arena.used;
    return true;
}

static bool step_network(int nodes)
{
    bool good = true;
    for (int i = 0; i < nodes; i++) {
        const struct dse_measurement sample = {&y[i], NULL};
        good &= dse_dkf_begin(&node[i], 0, NULL, &sample) == DSE_OK;
    }
    for (int i = 0; i < nodes; i++) {
        for (int k = bench_graph.in_first[i]; k < bench_graph.in_first[i + 1]; k++) {
            dse_real message[2];
            const int count = dse_dkf_message(&node[bench_graph.in[k]], place[k], message);
            good &=
                dse_dkf_receive(&node[i], k - bench_graph.in_first[i], message, count) == DSE_OK;
        }
    }
    for (int i = 0; i < nodes; i++)
        good &= dse_dkf_correct(&node[i]) == DSE_OK && dse_dkf_advance(&node[i]) == DSE_OK;
    return good;
}

/* ---- the floor ---- */

struct bare {
    dse_real x[2], P[3]; /* P: 11, 12, 22 */
};

static struct bare bare[NODES];
static dse_real gamma_ij[EDGES], said[EDGES];

static void make_bare(int nodes)
{
    for (int i = 0; i < nodes; i++)
        bare[i] = (struct bare){{guess[i][0], guess[i][1]}, {1, 0, 1}};
    memset(gamma_ij, 0, sizeof gamma_ij);
}

static void bare_rates(const struct bare *s, int c, dse_real y_i, int degree, const dse_real *gain,
                       const dse_real *words, struct bare *d, dse_real *dgain)
{
    const dse_real *P = s->P, p[2] = {P[c], P[c + 1]}; /* P C' */
    const dse_real eps = y_i - s->x[c];
    dse_real q = 0;
    for (int j = 0; j < degree; j++) {
        const dse_real difference = words[j] - s->x[c];
        q += gain[j] * difference;
        dgain[j] = eps * difference;
    }
    const dse_real pull = eps / noise + GAMMA * q;
    d->x[0] = A2[0] * s->x[0] + A2[1] * s->x[1] + p[0] * pull;
    d->x[1] = A2[2] * s->x[0] + p[1] * pull;
    d->P[0] = 2 * (A2[0] * P[0] + A2[1] * P[1]) + 1 - p[0] * p[0] / noise;
    d->P[1] = A2[0] * P[1] + A2[1] * P[2] + A2[2] * P[0] - p[0] * p[1] / noise;
    d->P[2] = 2 * A2[2] * P[1] + 1 - p[1] * p[1] / noise;
}

static void bare_step(struct bare *s, int c, dse_real y_i, int degree, dse_real *gain,
                      const dse_real *words)
{
    static const dse_real at[4] = {0, DSE_REAL(0.5), DSE_REAL(0.5), 1}, weight[4] = {1, 2, 2, 1};
    dse_real dgain[128], stage_gain[128], sum_gain[128];
    struct bare d = {{0}, {0}}, stage = *s, sum = {{0}, {0}};
    memcpy(stage_gain, gain, sizeof(dse_real) * (size_t)degree);
    memset(sum_gain, 0, sizeof(dse_real) * (size_t)degree);
    for (int r = 0; r < 4; r++) {
        if (r > 0) {
            const dse_real a = at[r] * PERIOD;
            for (int k = 0; k < 2; k++)
                stage.x[k] = s->x[k] + a * d.x[k];
            for (int k = 0; k < 3; k++)
                stage.P[k] = s->P[k] + a * d.P[k];
            for (int j = 0; j < degree; j++)
                stage_gain[j] = gain[j] + a * dgain[j];
        }
        bare_rates(&stage, c, y_i, degree, stage_gain, words, &d, dgain);
        for (int k = 0; k < 2; k++)
            sum.x[k] += weight[r] * d.x[k];
        for (int k = 0; k < 3; k++)
            sum.P[k] += weight[r] * d.P[k];
        for (int j = 0; j < degree; j++)
            sum_gain[j] += weight[r] * dgain[j];
    }
    for (int k = 0; k < 2; k++)
        s->x[k] += PERIOD / 6 * sum.x[k];
    for (int k = 0; k < 3; k++)
        s->P[k] += PERIOD / 6 * sum.P[k];
    for (int j = 0; j < degree; j++)
        gain[j] += PERIOD / 6 * sum_gain[j];
}

static void step_bare(int nodes)
{
    for (int i = 0; i < nodes; i++)
        for (int k = bench_graph.in_first[i]; k < bench_graph.in_first[i + 1]; k++)
            said[k] = bare[bench_graph.in[k]].x[i % 2];
    for (int i = 0; i < nodes; i++) {
        const int first = bench_graph.in_first[i];
        bare_step(&bare[i], i % 2, y[i], bench_graph.in_first[i + 1] - first, gamma_ij + first,
                  said + first);
    }
}

static bool agree(int nodes)
{
    for (int i = 0; i < nodes; i++)
        for (int c = 0; c < 2; c++)
            if (!(dse_abs(dse_dkf_state(&node[i])[c] - bare[i].x[c]) < dse_sqrt(DSE_REAL_EPSILON)))
                return false;
    return true;
}

static double bytes(int nodes)
{
    return (double)reals_used * sizeof(dse_real) / nodes + sizeof(struct dse_dkf);
}

/* ---- one node of more states ---- */

static dse_real wide_A[MOST_NX * MOST_NX], wide_I[MOST_NX * MOST_NX];
static dse_real wide_C[2 * MOST_NX];

/* Multiplications of a step: 4 (A P, C P, R^-1 C P, their product, A x, C x, K, and per neighbour),
 * and the Cholesky factor. */
static double flops(int n, int m, int degree)
{
    const double stage = n * n * n + m * n * n + m * m * n + 0.5 * m * n * n + n * n + 3 * m * n +
                         degree * (2.0 * m * m) + 2 * (n + n * n + degree * m * m);
    return 4 * stage + n * n * n / 6.0;
}

static bool bench_node(int n, int m)
{
    enum { DEGREE = 4 };
    static dse_real room[DSE_DKF_STORAGE(MOST_NX, 2, DEGREE)];
    const dse_real zero[2] = {0, 0}, R[4] = {1, 0, 0, 1}, word[2] = {DSE_REAL(0.1), 0};
    struct dse_arena arena;
    struct dse_dkf dkf;
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++) {
            wide_A[i * n + j] = i == j ? -1 : (dse_real)(i - j) / (dse_real)n;
            wide_I[i * n + j] = i == j;
        }
    }
    for (int k = 0; k < m * n; k++)
        wide_C[k] = (dse_real)(k % 3);
    const struct dse_model model = {
        .time = DSE_CONTINUOUS, .nx = n, .parameters = wide_A, .dfdx = constant_A};
    const struct dse_dkf_config settings = {.model = &model,
                                            .period = PERIOD,
                                            .sensor = {m, wide_C},
                                            .n_neighbours = DEGREE,
                                            .scheme = DSE_DKF_EDGE,
                                            .P0 = wide_I,
                                            .Q = wide_I,
                                            .R = R,
                                            .gamma = DSE_REAL(0.01)};
    dse_arena_init(&arena, room, (int)(sizeof room / sizeof room[0]));
    if (dse_dkf_init(&dkf, &settings, &arena) != DSE_OK)
        return false;
    const int steps = NODE_STEPS / (n * n);
    const struct dse_measurement sample = {zero, NULL};
    double fastest[2] = {1e300, 1e300};
    dse_real ballast = 0;
    for (int turn = 0; turn < BENCH_TURNS; turn++) {
        const double begin = bench_now_ns();
        for (int s = 0; s < steps; s++) {
            dse_dkf_begin(&dkf, 0, NULL, &sample);
            for (int j = 0; j < DEGREE; j++)
                dse_dkf_receive(&dkf, j, word, m);
            if (dse_dkf_correct(&dkf) != DSE_OK || dse_dkf_advance(&dkf) != DSE_OK)
                return false;
        }
        const double middle = bench_now_ns();
        ballast += bench_multiply(steps, flops(n, m, DEGREE));
        const double end = bench_now_ns();
        fastest[0] = middle - begin < fastest[0] ? middle - begin : fastest[0];
        fastest[1] = end - middle < fastest[1] ? end - middle : fastest[1];
    }
    printf("  %6d  %7d  %10d  %11.0f  %16.0f  %12.2f  %8d%s\n", n, m, DEGREE, fastest[0] / steps,
           flops(n, m, DEGREE), fastest[0] / fastest[1],
           (int)(sizeof(dse_real) * (size_t)arena.used), ballast < 0 ? " " : "");
    return true;
}

int main(void)
{
    printf(
        "Adaptive distributed Kalman filters, edge-dependent gains, two states, one output (%s)\n",
        sizeof(dse_real) == sizeof(double) ? "double" : "float");
    const struct bench_contender filters = {.make = make_network,
                                            .step = step_network,
                                            .make_floor = make_bare,
                                            .step_floor = step_bare,
                                            .agree = agree,
                                            .bytes = bytes};
    if (!bench_networks(&filters))
        return 1;
    printf("one node\n  states  outputs  neighbours  ns a step  multiplications  to the floor  "
           "   bytes\n");
    static const int sizes[][2] = {{2, 1}, {4, 1}, {4, 2}, {6, 2}, {10, 2}};
    for (size_t s = 0; s < sizeof sizes / sizeof sizes[0]; s++)
        if (!bench_node(sizes[s][0], sizes[s][1])) {
            printf("%d states: failed\n", sizes[s][0]);
            return 1;
        }
    return 0;
}
