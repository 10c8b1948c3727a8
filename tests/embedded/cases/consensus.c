/* Filters that agree on information, here as on the host with the same bits: six consensus Kalman
 * filters on a ring that count no measurement twice, and two second-order filters of the quadratic
 * example whose x1' = -x1 - x1 x2, x2' = -x3 + x1^2, x3' = x2. Some values and messages are
 * missing. */
#define CKF_NODES     6
#define CKF_NX        2
#define CKF_NY        1
#define NETWORK_NODES 2
#define NETWORK_NX    3
#define NETWORK_NY    1

#include "consensus_network.h"
#include "dse/math.h"
#include "dse/plant.h"
#include "numbers.h"
#include "report.h"
#include "second_order_network.h"

enum { SAMPLES = 20, RING = 6, TURNING = 2, PAIR = 2, NX = 3 };

#ifdef DSE_REAL_IS_float
#define TOLERANCE DSE_REAL(1e-3)
#else
#define TOLERANCE DSE_REAL(1e-9)
#endif

/* ---- linear: a target that turns 0.1 rad a sample, seen along one axis or the other ---- */

static struct ckf_network ring;
static struct dse_ckf central;
static struct dse_ckf_config central_config;
static dse_real central_memory[DSE_CKF_STORAGE(TURNING, RING, 0, 0)];
static dse_real C_all[RING * TURNING], R_all[RING * RING];

static enum dse_status start_ring(bool all_to_all, int rounds)
{
    static const dse_real R[1] = {DSE_REAL(0.25)};
    static const dse_real Q[] = {DSE_REAL(0.01), 0, 0, DSE_REAL(0.01)}, P0[] = {4, 0, 0, 4};
    static const dse_real c = DSE_REAL(0.9950041652780258), s = DSE_REAL(0.09983341664682815);
    int pairs[RING * (RING - 1)], count = 0;
    for (int i = 0; i < RING; i++)
        for (int j = 0; j < i; j++)
            if (all_to_all || i - j == 1 || i - j == RING - 1) {
                pairs[2 * count] = i;
                pairs[2 * count + 1] = j;
                count++;
            }
    /* eps = 1/6 is the exact average in one round where all hear all */
    ring = (struct ckf_network){.nodes = RING,
                                .base = {.ny = 1, .R = R, .Q = Q, .P0 = P0, .rounds = rounds},
                                .A = {c, -s, s, c}};
    for (int i = 0; i < RING; i++) {
        ring.C[i][i % 2] = 1;
        C_all[i * TURNING + i % 2] = 1;
        R_all[i * (RING + 1)] = R[0];
    }
    const enum dse_status status = ckf_network_make(&ring, TURNING, count, pairs);
    if (status != DSE_OK)
        return status;
    struct dse_arena arena;
    central_config = ring.base;
    central_config.scheme = DSE_CKF_ALONE;
    central_config.ny = RING;
    central_config.C = C_all;
    central_config.R = R_all;
    dse_arena_init(&arena, central_memory, DSE_CKF_STORAGE(TURNING, RING, 0, 0));
    return dse_ckf_init(&central, &central_config, &arena);
}

static enum dse_status turning_sample(long k, const dse_real *y)
{
    const struct dse_measurement all = {y, NULL};
    enum dse_status status = ckf_network_sample(&ring, k, y);
    if (status == DSE_OK)
        status = dse_ckf_begin(&central, k, (dse_real)k, NULL, &all);
    return status;
}

/* Largest distance of a node from the central filter; every tenth value is missing, and on the ring
 * one node is deaf on one side for a while. */
static void run_ring(const char *name, bool all_to_all, int rounds, dse_real within)
{
    struct numbers numbers = {7};
    dse_real gap = 0, truth[TURNING] = {5, 0}, y[RING];
    enum dse_status status = start_ring(all_to_all, rounds);
    for (int k = 0; k < SAMPLES && status == DSE_OK; k++) {
        const dse_real x = truth[0];
        for (int i = 0; i < RING; i++) {
            y[i] = truth[i % 2] + numbers_uniform(&numbers, -1, 1);
            if ((k * RING + i) % 10 == 7)
                y[i] = DSE_REAL_MAX * 2; /* infinite: treated as missing */
        }
        truth[0] = ring.A[0] * x + ring.A[1] * truth[1];
        truth[1] = ring.A[2] * x + ring.A[3] * truth[1];
        ring.deaf[1][2] = !all_to_all && k > 5 && k < 10;
        status = turning_sample(k, y);
        for (int i = 0; i < RING; i++) {
            const dse_real *estimate = dse_ckf_state(&ring.node[i]);
            report_vector(name, TURNING, estimate);
            report_digest(name, TURNING * TURNING, dse_ckf_covariance(&ring.node[i]));
            for (int a = 0; a < TURNING; a++)
                gap = dse_max(gap, dse_abs(estimate[a] - dse_ckf_state(&central)[a]));
        }
        if (status == DSE_OK)
            status = ckf_network_advance(&ring);
        if (status == DSE_OK)
            status = dse_ckf_advance(&central);
    }
    report_check(name, status == DSE_OK);
    report_check("near the central filter", gap <= within);
}

/* ---- quadratic: two second-order filters ---- */

static struct second_order_network pair;

static enum dse_status start_pair(const struct dse_model *model, enum dse_dso_scheme scheme)
{
    static const dse_real R[1] = {DSE_REAL(0.01)}, S0[NX * NX] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    pair = (struct second_order_network){
        .base = {.filter = {.model = model, .ny = 1, .S0 = S0, .R = R, .substeps = 20},
                 .scheme = scheme,
                 .delta = DSE_REAL(0.25),
                 .memory = DSE_DSO_RESTART,
                 .epsilon = DSE_REAL(0.25),
                 .rounds = 3},
        .nodes = PAIR,
        .hears = {{false, true}, {true, false}},
        .C = {{1, 1, 0}, {1, 0, 1}},
        .w0 = {{4, 3, 2}, {2, 1, 3}}};
    return network_make(&pair);
}

static void run_pair(const char *name, enum dse_dso_scheme scheme)
{
    struct numbers numbers = {3};
    dse_real nothing[1], truth[NX] = {1, 2, 1}, scratch[DSE_RK4_SCRATCH(NX)], m[PAIR], gap = 0;
    struct dse_model model;
    dse_plant_find("quadratic_ex4")->model(nothing, &model);
    enum dse_status status = start_pair(&model, scheme);
    for (int k = 1; k <= SAMPLES && status == DSE_OK; k++) {
        for (int s = 0; s < 50; s++)
            dse_rk4_model_step(&model, 0, DSE_REAL(0.02), NULL, truth, scratch);
        m[0] = truth[0] + truth[1] + numbers_uniform(&numbers, DSE_REAL(-0.1), DSE_REAL(0.1));
        m[1] = truth[0] + truth[2] + numbers_uniform(&numbers, DSE_REAL(-0.1), DSE_REAL(0.1));
        pair.off[1] = k % 7 == 3;
        pair.lost[0][1] = k % 5 == 4;
        status = network_sample(&pair, (dse_real)k, m);
        for (int i = 0; i < PAIR; i++) {
            report_vector(name, NX, dse_dso_state(&pair.node[i]));
            report_digest(name, NX * NX, dse_dso_covariance(&pair.node[i]));
        }
    }
    for (int i = 0; i < PAIR; i++)
        for (int a = 0; a < NX; a++)
            gap = dse_max(gap, dse_abs(dse_dso_state(&pair.node[i])[a] - truth[a]));
    report_check(name, status == DSE_OK);
    report_check("near the truth", gap <= DSE_REAL(0.2));
}

int main(void)
{
    run_ring("all to all", true, 1, TOLERANCE);
    run_ring("ring", false, 5, 1);
    run_pair("B-I-inf", DSE_DSO_B_INFORMATION);
    run_pair("C-I-inf", DSE_DSO_C_INFORMATION);
    run_pair("A-I*", DSE_DSO_A_INFORMATION);
    return report_verdict();
}
