/* Time of one sample of a node of a consensus Kalman filter (types I and II, on a ring, one sensor
 * per node) beside the central Kalman filter, which has all sensors at one place, and beside a
 * Kalman filter of the node's sensor alone: 3, 10 and 20 states, 2 to 200 nodes. Messages are
 * handed over in memory. Then one consensus round beside plain loops over the same sums. Contenders
 * take turns, so that whatever else the machine does hits all alike. Prints tables; exits with 1
 * only when a filter fails or the plain loops disagree. */
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "dse/consensus_kalman.h"
#include "dse/kalman.h"
#include "dse/math.h"
#include "dse/random.h"

enum { MOST = 20, NODES = 200, TURNS = 15 };

static double now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t); /* others may share the processor */
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

/* ---- the plant and its sensors ---- */

static dse_real A[MOST * MOST], Q[MOST * MOST], P0[MOST * MOST], C[NODES * MOST], R[NODES * NODES];
static dse_real r_one[1] = {DSE_REAL(0.25)}, y[NODES];
static struct dse_linear linear = {.A = A, .C = C};
static struct dse_model model;

/* Rotations by pairs of states, slightly damped; random outputs. */
static void make_plant(int n, int nodes)
{
    struct dse_random random;
    dse_random_init(&random, 3, (uint64_t)n);
    memset(A, 0, sizeof A);
    memset(Q, 0, sizeof Q);
    memset(P0, 0, sizeof P0);
    memset(R, 0, sizeof R);
    for (int i = 0; i < n; i++) {
        const int other = i % 2 == 0 ? i + 1 : i - 1;
        A[i * n + i] = DSE_REAL(0.98);
        if (other < n)
            A[i * n + other] = i % 2 == 0 ? DSE_REAL(-0.1) : DSE_REAL(0.1);
        Q[i * n + i] = DSE_REAL(0.01);
        P0[i * n + i] = 4;
    }
    for (int k = 0; k < nodes * n; k++)
        C[k] = (dse_real)dse_random_normal(&random);
    for (int l = 0; l < nodes; l++)
        R[l * nodes + l] = r_one[0];
    dse_linear_model(&model, DSE_DISCRETE, n, 0, 0, &linear);
}

/* ---- contenders ---- */

static struct dse_kalman central, alone;
static dse_real central_memory[DSE_KALMAN_STORAGE(MOST, NODES)];
static dse_real alone_memory[DSE_KALMAN_STORAGE(MOST, 1)];
static struct dse_ckf_config config[NODES];
static struct dse_ckf node[NODES];
static dse_real node_memory[NODES * DSE_CKF_STORAGE(MOST, 1, 2, NODES)];
static dse_real message[NODES][DSE_CKF_MESSAGE(MOST, NODES)];
static int reals_used;

static bool make_kalman(struct dse_kalman *kalman, int n, int ny, dse_real *memory, int room)
{
    struct dse_arena arena;
    const struct dse_kalman_config settings = {
        .nx = n, .ny = ny, .linear = linear, .P0 = P0, .Q = Q, .R = ny > 1 ? R : r_one};
    dse_arena_init(&arena, memory, room);
    return dse_kalman_init(kalman, &settings, &arena) == DSE_OK;
}

static bool make_network(int n, int nodes, struct dse_ckf_config base)
{
    struct dse_arena arena;
    dse_arena_init(&arena, node_memory, (int)(sizeof node_memory / sizeof node_memory[0]));
    base.model = &model;
    base.ny = 1;
    base.R = r_one;
    base.Q = Q;
    base.P0 = P0;
    base.n_neighbours = nodes > 2 ? 2 : 1;
    base.nodes = nodes;
    for (int i = 0; i < nodes; i++) {
        config[i] = base;
        config[i].C = C + i * n;
        config[i].self = i;
        if (dse_ckf_init(&node[i], &config[i], &arena) != DSE_OK)
            return false;
    }
    reals_used = arena.used;
    return true;
}

static bool step_kalman(struct dse_kalman *kalman, int k)
{
    const struct dse_measurement measurement = {y, NULL};
    return dse_kalman_update(kalman, (dse_real)k, NULL, &measurement) == DSE_OK &&
           dse_kalman_predict(kalman, (dse_real)(k + 1), NULL) == DSE_OK;
}

static bool step_network(int nodes, int k)
{
    bool good = true;
    for (int i = 0; i < nodes; i++) {
        const struct dse_measurement measurement = {&y[i], NULL};
        good &= dse_ckf_begin(&node[i], k, (dse_real)k, NULL, &measurement) == DSE_OK;
    }
    for (int r = 0; r < dse_ckf_rounds(&node[0]); r++) {
        int count = 0;
        for (int i = 0; i < nodes; i++)
            count = dse_ckf_message(&node[i], message[i]);
        for (int i = 0; i < nodes; i++) {
            const int next = (i + 1) % nodes, before = (i + nodes - 1) % nodes;
            good &= dse_ckf_receive(&node[i], 0, message[next], count) == DSE_OK;
            if (nodes > 2)
                good &= dse_ckf_receive(&node[i], 1, message[before], count) == DSE_OK;
            good &= dse_ckf_end_round(&node[i]) == DSE_OK;
        }
    }
    for (int i = 0; i < nodes; i++)
        good &= dse_ckf_advance(&node[i]) == DSE_OK;
    return good;
}

/* ---- networks ---- */

static const struct {
    const char *name;
    struct dse_ckf_config base;
} types[] = {
    {"A, 5 rounds", {.scheme = DSE_CKF_A}},
    {"A, 5 rounds, bounded", {.scheme = DSE_CKF_A, .counting = DSE_CKF_BOUNDED}},
    {"A, 1 round, bounded", {.scheme = DSE_CKF_A, .counting = DSE_CKF_BOUNDED, .rounds = 1}},
    {"B", {.scheme = DSE_CKF_B}},
    {"C", {.scheme = DSE_CKF_C}},
};

static bool bench_network(int n, int nodes, size_t type)
{
    double least[3] = {1e300, 1e300, 1e300};
    const int repeat = 1 + 200 / nodes; /* of the network; of the single filters: */
    const int often = 1 + 2000 / (n * nodes), more = 20;
    make_plant(n, nodes);
    if (!make_kalman(&central, n, nodes, central_memory, DSE_KALMAN_STORAGE(MOST, NODES)) ||
        !make_kalman(&alone, n, 1, alone_memory, DSE_KALMAN_STORAGE(MOST, 1)) ||
        !make_network(n, nodes, types[type].base))
        return false;
    bool good = true;
    int k = 0, central_k = 0, alone_k = 0;
    for (int turn = 0; turn < TURNS; turn++) {
        for (int i = 0; i < nodes; i++)
            y[i] = dse_sin((dse_real)(turn + i));
        const double begin = now_ns();
        for (int r = 0; r < repeat; r++)
            good &= step_network(nodes, k++);
        const double network = now_ns();
        for (int r = 0; r < often; r++)
            good &= step_kalman(&central, central_k++);
        const double centre = now_ns();
        for (int r = 0; r < more; r++)
            good &= step_kalman(&alone, alone_k++);
        const double end = now_ns();
        const double ns[3] = {(network - begin) / repeat / nodes, (centre - network) / often,
                              (end - centre) / more};
        for (int c = 0; c < 3; c++)
            least[c] = ns[c] < least[c] ? ns[c] : least[c];
    }
    printf("  %6d  %5d  %-22s %12.2f  %12.2f  %10.2f  %10.2f  %12.0f\n", n, nodes, types[type].name,
           1e-3 * least[1], 1e-3 * least[0], least[0] / least[1], least[0] / least[2],
           (double)reals_used * sizeof(dse_real) / nodes + sizeof(struct dse_ckf));
    return good;
}

/* ---- one round ---- */

/* v += eps sum_j (g_j - v - u), value by value. */
static void plain_high_pass(int neighbours, int size, const dse_real *said, dse_real eps,
                            const dse_real *u, dse_real *v)
{
    for (int e = 0; e < size; e++) {
        dse_real sum = 0;
        for (int j = 0; j < neighbours; j++)
            sum += said[j * size + e] - (v[e] + u[e]);
        v[e] += eps * sum;
    }
}

static bool bench_round(int neighbours, int size)
{
    enum { WIDEST = 230, NEIGHBOURS = 16, REPEAT = 2000 };
    static dse_real said[NEIGHBOURS * WIDEST], heard[NEIGHBOURS], u[WIDEST], v[WIDEST], w[WIDEST];
    struct dse_random random;
    double least[2] = {1e300, 1e300};
    dse_random_init(&random, 5, 0);
    for (int k = 0; k < NEIGHBOURS * WIDEST; k++)
        said[k] = (dse_real)dse_random_normal(&random);
    for (int j = 0; j < NEIGHBOURS; j++)
        heard[j] = 1;
    for (int e = 0; e < WIDEST; e++)
        u[e] = said[e] / 2;
    memset(v, 0, sizeof v);
    memset(w, 0, sizeof w);
    const struct dse_consensus_words words = {neighbours, size, said, heard};
    const dse_real eps = DSE_REAL(0.05);
    for (int turn = 0; turn < TURNS; turn++) {
        const double begin = now_ns();
        for (int r = 0; r < REPEAT; r++)
            dse_consensus_high_pass(&words, 0, size, eps, u, v);
        const double between = now_ns();
        for (int r = 0; r < REPEAT; r++)
            plain_high_pass(neighbours, size, said, eps, u, w);
        const double end = now_ns();
        least[0] = between - begin < least[0] ? between - begin : least[0];
        least[1] = end - between < least[1] ? end - between : least[1];
    }
    printf("  %10d  %5d  %12.0f  %12.2f\n", neighbours, size, least[0] / REPEAT,
           least[0] / least[1]);
    for (int e = 0; e < size; e++)
        if (!(dse_abs(v[e] - w[e]) < dse_sqrt(DSE_REAL_EPSILON)))
            return false;
    return true;
}

int main(void)
{
    static const int states[] = {3, 10, 20}, sizes[] = {2, 6, 20, 50, 200};
    printf("Consensus Kalman filters on rings, one sensor per node (%s)\n"
           "  states  nodes  type                   central (us)   a node (us)  to central   to "
           "alone  bytes a node\n",
           sizeof(dse_real) == sizeof(double) ? "double" : "float");
    for (size_t n = 0; n < sizeof states / sizeof states[0]; n++)
        for (size_t s = 0; s < sizeof sizes / sizeof sizes[0]; s++)
            for (size_t t = 0; t < sizeof types / sizeof types[0]; t++)
                if (!bench_network(states[n], sizes[s], t)) {
                    printf("%d states, %d nodes, %s: failed\n", states[n], sizes[s], types[t].name);
                    return 1;
                }
    printf("one round of a high-pass filter\n  neighbours  reals            ns  to the floor\n");
    static const int rounds[][2] = {{2, 9}, {2, 65}, {2, 230}, {8, 65}, {16, 230}};
    for (size_t r = 0; r < sizeof rounds / sizeof rounds[0]; r++)
        if (!bench_round(rounds[r][0], rounds[r][1])) {
            printf("disagrees with the plain loops\n");
            return 1;
        }
    return 0;
}
