/* Time of one sample of a distributed second-order filter (B-I-inf on a ring, one sensor per node)
 * beside the central filter, which has all sensors at one place: 3, 10 and 20 states, 2 to 200
 * nodes. Then the prediction alone beside plain loops over the equations as printed, with dense
 * forms F_k and a dense S; both must agree. All integrate by 20 Runge-Kutta steps. Contenders take
 * turns, so that whatever else the machine does hits all alike. Prints tables; exits with 1 only
 * when a filter fails or contenders disagree. */
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "dse/distributed_second_order.h"
#include "dse/linalg.h"
#include "dse/math.h"
#include "dse/random.h"

enum { MOST = 20, NODES = 200, TURNS = 9, SUBSTEPS = 20 };
#define PERIOD DSE_REAL(0.1)

static double now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t); /* others may share the processor */
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

static double least(const double *ns)
{
    double smallest = ns[0];
    for (int turn = 1; turn < TURNS; turn++)
        smallest = ns[turn] < smallest ? ns[turn] : smallest;
    return smallest;
}

/* ---- a system: dissipative and lossless, about as many terms as a Galerkin model has ---- */

static dse_real A[MOST * MOST], F[MOST * MOST * MOST], C[NODES * MOST], R[NODES * NODES];
static dse_real x0[MOST], S0[MOST * MOST];
static struct dse_quadratic_term term[DSE_QUADRATIC_MAX_TERMS(MOST)];
static struct dse_quadratic quadratic;
static struct dse_model model;

static dse_real normal(struct dse_random *random)
{
    return (dse_real)dse_random_normal(random);
}

/* a x_j x_k in row i, b x_i x_k in row j, -(a + b) x_i x_j in row k: x'q(x) = 0. */
static void add_triple(struct dse_random *random, int n, int i, int j, int k)
{
    const dse_real a = normal(random), b = normal(random);
    F[(i * n + j) * n + k] += a;
    F[(j * n + i) * n + k] += b;
    F[(k * n + i) * n + j] -= a + b;
}

static void make_system(int n, int nodes)
{
    struct dse_random random;
    dse_random_init(&random, 3, (uint64_t)n);
    memset(F, 0, sizeof F);
    memset(R, 0, sizeof R);
    memset(S0, 0, sizeof S0);
    for (int i = 0; i < n; i++) {
        x0[i] = normal(&random) / 2;
        S0[i * n + i] = DSE_REAL(0.05);
        A[i * n + i] = DSE_REAL(-0.1) * (dse_real)(i + 1);
        for (int j = 0; j < i; j++) {
            A[i * n + j] = normal(&random) / 3;
            A[j * n + i] = -A[i * n + j];
        }
    }
    const int triples = n * n / 3;
    for (int c = 0; c < triples; c++) {
        const int i = c % (n - 2), j = i + 1 + (c / n) % (n - i - 2);
        add_triple(&random, n, i, j, j + 1 + c % (n - j - 1));
    }
    for (int k = 0; k < nodes * n; k++)
        C[k] = normal(&random);
    for (int l = 0; l < nodes; l++)
        R[l * nodes + l] = DSE_REAL(0.01);
    quadratic = (struct dse_quadratic){.A = A, .term = term};
    quadratic.terms = dse_quadratic_terms(n, F, DSE_QUADRATIC_MAX_TERMS(MOST), term);
    dse_quadratic_model(&model, n, 0, 0, &quadratic);
}

static struct dse_second_order_config filter_config(int ny, const dse_real *outputs)
{
    return (struct dse_second_order_config){
        .model = &model, .ny = ny, .C = outputs, .x0 = x0, .S0 = S0, .R = R, .substeps = SUBSTEPS};
}

/* ---- contenders ---- */

static struct dse_second_order_config central_config;
static struct dse_second_order central;
static dse_real central_memory[DSE_SECOND_ORDER_STORAGE(MOST, NODES)];
static struct dse_dso_config node_config[NODES];
static struct dse_dso node[NODES];
static dse_real node_memory[NODES * DSE_DSO_STORAGE(MOST, 1, 2)];
static dse_real message[NODES][DSE_DSO_MESSAGE(MOST, 1)];
static dse_real y[NODES];
static int reals_used;

static bool make_contenders(int nodes)
{
    struct dse_arena arena;
    dse_arena_init(&arena, central_memory, DSE_SECOND_ORDER_STORAGE(MOST, NODES));
    central_config = filter_config(nodes, C);
    if (dse_second_order_init(&central, &central_config, &arena) != DSE_OK)
        return false;
    dse_arena_init(&arena, node_memory, (int)(sizeof node_memory / sizeof node_memory[0]));
    for (int i = 0; i < nodes; i++) {
        node_config[i] = (struct dse_dso_config){.filter = filter_config(1, C + i * model.nx),
                                                 .n_neighbours = nodes > 2 ? 2 : 1};
        if (dse_dso_init(&node[i], &node_config[i], &arena) != DSE_OK)
            return false;
    }
    reals_used = arena.used;
    return true;
}

static bool step_network(int nodes, dse_real t)
{
    bool good = true;
    for (int i = 0; i < nodes; i++) {
        const struct dse_measurement measurement = {&y[i], NULL};
        good &= dse_dso_begin(&node[i], t, NULL, &measurement) == DSE_OK;
    }
    for (int r = 0; r < 2; r++) {
        int count = 0;
        for (int i = 0; i < nodes; i++)
            count = dse_dso_message(&node[i], message[i]);
        for (int i = 0; i < nodes; i++) {
            const int next = (i + 1) % nodes, before = (i + nodes - 1) % nodes;
            good &= dse_dso_receive(&node[i], 0, message[next], count) == DSE_OK;
            if (nodes > 2)
                good &= dse_dso_receive(&node[i], 1, message[before], count) == DSE_OK;
            good &= dse_dso_end_round(&node[i]) == DSE_OK;
        }
    }
    return good;
}

static bool step_central(dse_real t)
{
    const struct dse_measurement measurement = {y, NULL};
    return dse_second_order_predict(&central, t, NULL) == DSE_OK &&
           dse_second_order_update(&central, &measurement) == DSE_OK;
}

static bool bench_networks(int n)
{
    static const int sizes[] = {2, 6, 20, 50, 200};
    for (size_t s = 0; s < sizeof sizes / sizeof sizes[0]; s++) {
        const int nodes = sizes[s];
        double network_ns[TURNS], central_ns[TURNS];
        make_system(n, nodes);
        if (!make_contenders(nodes))
            return false;
        for (int turn = 0; turn < TURNS; turn++) {
            const dse_real t = PERIOD * (dse_real)(turn + 1);
            for (int i = 0; i < nodes; i++)
                y[i] = dse_sin(t + (dse_real)i);
            const double begin = now_ns();
            const bool good = step_network(nodes, t);
            const double between = now_ns();
            if (!good || !step_central(t))
                return false;
            network_ns[turn] = between - begin;
            central_ns[turn] = now_ns() - between;
        }
        const double a_node = least(network_ns) / nodes;
        printf("  %6d  %5d  %5d  %12.1f  %12.1f  %15.2f  %12.0f\n", n, quadratic.terms, nodes,
               1e-3 * least(central_ns), 1e-3 * a_node, a_node / least(central_ns),
               (double)reals_used * sizeof(dse_real) / nodes + sizeof(struct dse_dso));
    }
    return true;
}

/* ---- the prediction alone, and plain loops ---- */

/* z = [w; S]: (3.48), (3.49) as printed, F_k symmetric and dense. */
static void plain_rates(int n, const dse_real *symmetric, const dse_real *z, dse_real *dz)
{
    dse_real J[MOST * MOST];
    const dse_real *S = z + n;
    for (int k = 0; k < n; k++) {
        const dse_real *F_k = symmetric + k * n * n;
        dz[k] = 0;
        for (int i = 0; i < n; i++) {
            dz[k] += A[k * n + i] * z[i];
            J[k * n + i] = A[k * n + i];
            for (int j = 0; j < n; j++) {
                dz[k] += F_k[i * n + j] * (z[i] * z[j] + S[i * n + j]);
                J[k * n + i] += 2 * F_k[i * n + j] * z[j];
            }
        }
    }
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++) {
            dse_real sum = 0;
            for (int k = 0; k < n; k++)
                sum += J[i * n + k] * S[k * n + j] + S[i * n + k] * J[j * n + k];
            dz[n + i * n + j] = sum;
        }
    }
}

static void plain_prediction(int n, const dse_real *symmetric, dse_real *z)
{
    static const dse_real at[4] = {0, DSE_REAL(0.5), DSE_REAL(0.5), 1}, weight[4] = {1, 2, 2, 1};
    enum { SIZE = MOST + MOST * MOST };
    static dse_real stage[SIZE], rate[SIZE], sum[SIZE];
    const int size = n + n * n;
    const dse_real h = PERIOD / SUBSTEPS;
    for (int s = 0; s < SUBSTEPS; s++) {
        memset(rate, 0, sizeof rate);
        memset(sum, 0, sizeof sum);
        for (int r = 0; r < 4; r++) {
            for (int k = 0; k < size; k++)
                stage[k] = z[k] + at[r] * h * rate[k];
            plain_rates(n, symmetric, stage, rate);
            for (int k = 0; k < size; k++)
                sum[k] += weight[r] * rate[k];
        }
        for (int k = 0; k < size; k++)
            z[k] += h / 6 * sum[k];
    }
}

static bool bench_prediction(int n)
{
    static dse_real symmetric[MOST * MOST * MOST], z[MOST + MOST * MOST];
    double ours[TURNS], plain[TURNS];
    make_system(n, 2);
    for (int k = 0; k < n; k++)
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++)
                symmetric[(k * n + i) * n + j] =
                    (F[(k * n + i) * n + j] + F[(k * n + j) * n + i]) / 2;
    if (!make_contenders(2))
        return false;
    memcpy(z, x0, sizeof(dse_real) * (size_t)n);
    memcpy(z + n, S0, sizeof(dse_real) * (size_t)(n * n));
    for (int turn = 0; turn < TURNS; turn++) {
        const double begin = now_ns();
        if (dse_second_order_predict(&central, PERIOD * (dse_real)(turn + 1), NULL) != DSE_OK)
            return false;
        const double between = now_ns();
        plain_prediction(n, symmetric, z);
        ours[turn] = between - begin;
        plain[turn] = now_ns() - between;
    }
    for (int i = 0; i < n; i++)
        if (!(dse_abs(z[i] - dse_second_order_state(&central)[i]) < DSE_REAL(1e-4)))
            return false;
    printf("  %6d  %5d  %12.1f  %12.1f  %8.2f\n", n, quadratic.terms, 1e-3 * least(ours),
           1e-3 * least(plain), least(ours) / least(plain));
    return true;
}

int main(void)
{
    static const int states[] = {3, 10, MOST};
    bool good = true;
    printf("one sample: a node of a ring, beside the central filter with all sensors\n"
           "  states  terms  nodes    central us     a node us  node to central  bytes a node\n");
    for (int s = 0; s < 3; s++)
        good = bench_networks(states[s]) && good;
    printf("prediction of %d steps, beside plain loops\n"
           "  states  terms     filter us      plain us     ratio\n",
           SUBSTEPS);
    for (int s = 0; s < 3; s++)
        good = bench_prediction(states[s]) && good;
    if (!good)
        printf("failed\n");
    return good ? 0 : 1;
}
