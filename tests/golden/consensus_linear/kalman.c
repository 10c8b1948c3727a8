/* Networks of linear consensus Kalman filters around the rotating target, and what a node or a
 * centre knows of it alone. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dse/distributed_kalman.h"
#include "dse/gramian.h"
#include "parts.h"

enum { NX = 2, NODES = 6, SAMPLES = 15 };

/* What all runs of a file share. */
struct target {
    double *A, *Q, *R, *P0, *w0, *adjacency; /* adjacency: NODES x NODES */
};

static double *numbers(const json_t *object, const char *key, int wanted)
{
    int count = 0;
    double *found = golden_numbers(json_object_get(object, key), &count);
    if (count == wanted)
        return found;
    printf("  %s: %d numbers, not %d\n", key, count, wanted);
    free(found);
    return NULL;
}

static void free_target(struct target *target)
{
    free(target->A);
    free(target->Q);
    free(target->R);
    free(target->P0);
    free(target->w0);
    free(target->adjacency);
}

static bool load_target(const json_t *root, struct target *target)
{
    *target = (struct target){.A = numbers(root, "A", NX * NX),
                              .Q = numbers(root, "Q", NX * NX),
                              .R = numbers(root, "R", 1),
                              .P0 = numbers(root, "P0", NX * NX),
                              .w0 = numbers(root, "w0", NX),
                              .adjacency = numbers(root, "adjacency", NODES * NODES)};
    return target->A && target->Q && target->R && target->P0 && target->w0 && target->adjacency;
}

/* B_i: [1 0], or alternating with [0 1]. */
static void sensor(bool alike, int i, double *C)
{
    const bool second = !alike && i % 2 == 1;
    C[0] = !second;
    C[1] = second;
}

/* Their entries by the size of the largest of all: some are zero but for rounding. */
static int compare_covariances(const json_t *run, const char *key, int count, const double *M)
{
    return golden_compare_as("  covariance", run, key, count * NX * NX, 1, M, GOLDEN_LINEAR);
}

/* ---- networks ---- */

/* A run by its name in the file; `scaled`: the reference's M is nodes times the covariance. */
struct named {
    const char *name;
    enum dse_ckf_scheme scheme;
    bool scaled;
};
static const struct named runs[] = {
    {"A_literal", DSE_CKF_A_LITERAL, true},
    {"A_fix", DSE_CKF_A_LOW_PASS, true},
    {"A_highpass", DSE_CKF_A, true},
    {"A_highpass_5", DSE_CKF_A, true},
    {"B", DSE_CKF_B, false},
    {"C", DSE_CKF_C_LITERAL, false},
    {"C_norm", DSE_CKF_C, false},
};

static int network_run(const struct target *target, const json_t *sensors, bool alike,
                       const struct named *named)
{
    static struct ckf_network network;
    static double xhat[SAMPLES * NODES * NX], M[SAMPLES * NODES * NX * NX];
    const json_t *run = json_object_get(sensors, named->name);
    int pairs[NODES * NODES];
    double *m = numbers(sensors, "m", SAMPLES * NODES);
    network = (struct ckf_network){
        .nodes = NODES,
        .base = {.ny = 1,
                 .R = target->R,
                 .Q = target->Q,
                 .x0 = target->w0,
                 .P0 = target->P0,
                 .scheme = named->scheme,
                 .counting = DSE_CKF_IN_ALL,
                 .epsilon = golden_number(run, "eps", 0),
                 .alpha = golden_number(run, "alpha", 0),
                 .rounds = (int)golden_number(run, "ncons", 0)},
    };
    memcpy(network.A, target->A, NX * NX * sizeof(double));
    for (int i = 0; i < NODES; i++)
        sensor(alike, i, network.C[i]);
    bool good =
        m != NULL && ckf_network_make(&network, NX, golden_links(NODES, target->adjacency, pairs),
                                      pairs) == DSE_OK;
    for (int k = 0; good && k < SAMPLES; k++) {
        good = ckf_network_sample(&network, k, m + (size_t)k * NODES) == DSE_OK;
        for (int i = 0; i < NODES; i++) {
            const double *P = dse_ckf_covariance(&network.node[i]);
            memcpy(xhat + (k * NODES + i) * NX, dse_ckf_state(&network.node[i]),
                   NX * sizeof(double));
            for (int e = 0; e < NX * NX; e++)
                M[(k * NODES + i) * NX * NX + e] = named->scaled ? NODES * P[e] : P[e];
        }
        good = ckf_network_advance(&network) == DSE_OK && good;
    }
    free(m);
    if (!good) {
        printf("  %s: failed\n", named->name);
        return GOLDEN_FAIL;
    }
    const int verdict =
        golden_compare_as(named->name, run, "xhat", SAMPLES, NODES * NX, xhat, GOLDEN_LINEAR);
    return golden_worse(verdict, compare_covariances(run, "M", SAMPLES * NODES, M));
}

/* ---- centres ---- */

/* The central filter in information form, and the micro-Kalman filter with exact averages: all
 * covariances times `scale`, information divided by it. */
static int central_run(const struct target *target, const json_t *sensors, bool alike,
                       const char *name, const char *covariance, double scale)
{
    static double xhat[SAMPLES * NX], M[SAMPLES * NX * NX];
    const json_t *run = json_object_get(sensors, name);
    double x[NX], P[NX * NX], Q[NX * NX], scratch[DSE_INFORMATION_SCRATCH(NX)];
    double *m = numbers(sensors, "m", SAMPLES * NODES);
    memcpy(x, target->w0, sizeof x);
    for (int e = 0; e < NX * NX; e++) {
        P[e] = scale * target->P0[e];
        Q[e] = scale * target->Q[e];
    }
    bool good = m != NULL;
    for (int k = 0; good && k < SAMPLES; k++) {
        double u[NX] = {0}, Y[NX * NX] = {0};
        for (int i = 0; good && i < NODES; i++) {
            double C[NX], ui[NX], Yi[NX * NX], room[DSE_INFORMATION_OF_SCRATCH(NX, 1)];
            const struct dse_measurement sample = {m + (size_t)k * NODES + i, NULL};
            sensor(alike, i, C);
            good = dse_information_of(NX, 1, C, target->R, &sample, ui, Yi, NULL, room) == DSE_OK;
            dse_axpy(NX, 1 / scale, ui, u);
            dse_axpy(NX * NX, 1 / scale, Yi, Y);
        }
        good = good && dse_information_update(NX, x, P, u, Y, x, P, scratch) == DSE_OK;
        memcpy(xhat + (size_t)k * NX, x, sizeof x);
        memcpy(M + (size_t)k * NX * NX, P, sizeof P);
        double next[NX];
        dse_mat_vec(NX, NX, target->A, x, next);
        memcpy(x, next, sizeof x);
        dse_sym_congruence(NX, NX, target->A, P, Q, P, scratch);
    }
    free(m);
    if (!good)
        return GOLDEN_FAIL;
    const int verdict = golden_compare_as(name, run, "xhat", SAMPLES, NX, xhat, GOLDEN_LINEAR);
    return golden_worse(verdict, compare_covariances(run, covariance, SAMPLES, M));
}

/* ---- one node alone ---- */

/* x^(k+1) = A x^ + L (y - C x^): a predicting filter of given gain without neighbours. */
static int luenberger(const json_t *root)
{
    enum { STEPS = 20 };
    const json_t *part = json_object_get(root, "luenberger");
    double *A = numbers(part, "A", NX * NX), *C = numbers(part, "C", NX);
    double *L = numbers(part, "L", NX), *start = numbers(part, "xhat0", NX);
    double *y = numbers(part, "y", STEPS);
    double memory[DSE_DKF_STORAGE(NX, 1, 0)], got[STEPS * NX] = {0};
    double gramian[NX * NX], scratch[DSE_GRAMIAN_SCRATCH(NX, 1)];
    int verdict = GOLDEN_FAIL;
    if (A && C && L && start && y) {
        const struct dse_linear linear = {.A = A};
        struct dse_model model;
        struct dse_arena arena;
        struct dse_dkf observer;
        dse_linear_model(&model, DSE_DISCRETE, NX, 0, 0, &linear);
        const struct dse_dkf_config config = {
            .model = &model, .sensor = {1, C}, .K = L, .x0 = start};
        const struct dse_window window = {.model = &model, .steps = 5}; /* t = 0 .. 4 */
        dse_arena_init(&arena, memory, DSE_DKF_STORAGE(NX, 1, 0));
        bool good = dse_dkf_init(&observer, &config, &arena) == DSE_OK;
        for (int k = 0; good && k < STEPS; k++) {
            const struct dse_measurement sample = {y + k, NULL};
            memcpy(got + (size_t)k * NX, dse_dkf_state(&observer), NX * sizeof(double));
            dse_dkf_begin(&observer, k, NULL, &sample);
            good = dse_dkf_correct(&observer) == DSE_OK && dse_dkf_advance(&observer) == DSE_OK;
        }
        good = good && dse_observability_gramian(&window, 1, C, gramian, scratch) == DSE_OK;
        if (good)
            verdict = golden_worse(
                golden_compare_as("Luenberger", part, "xhat", STEPS, NX, got, GOLDEN_LINEAR),
                golden_compare_as("Gramian", part, "gramian_t4", NX, NX, gramian, GOLDEN_LINEAR));
    }
    free(A);
    free(C);
    free(L);
    free(start);
    free(y);
    return verdict;
}

int golden_consensus_kalman(const json_t *root)
{
    static const char *const kinds[] = {"homogeneous", "heterogeneous"};
    struct target target;
    int verdict = load_target(root, &target) ? luenberger(root) : GOLDEN_FAIL;
    for (int s = 0; s < 2 && verdict == GOLDEN_PASS; s++) {
        const json_t *sensors = json_object_get(root, kinds[s]);
        const bool alike = s == 0;
        printf("  %s\n", kinds[s]);
        verdict = central_run(&target, sensors, alike, "central_information_filter", "M", 1);
        verdict = golden_worse(verdict, central_run(&target, sensors, alike,
                                                    "micro_kf_exact_averages", "M_mu", NODES));
        for (size_t r = 0; r < sizeof runs / sizeof runs[0]; r++)
            verdict = golden_worse(verdict, network_run(&target, sensors, alike, &runs[r]));
    }
    free_target(&target);
    return verdict;
}
