/* Three agents of a chain of subsystems and their coordinator within bounds, prediction-driven and
 * price-driven: what they agree on is the centralised estimate, here as on the host with the same
 * bits. Some values are missing, some bounds active. */
#include "dse/coordinated_mhe.h"
#include "dse/math.h"
#include "numbers.h"
#include "report.h"

enum { PARTS = 3, NX = 2, N = PARTS * NX, HORIZON = 4, FIRST = 2, SAMPLES = 16 };
/* All bounds of a window may be active. */
enum { ALL = HORIZON * 2 * NX, ALL_OF_PLANT = HORIZON * 2 * N };

#ifdef DSE_REAL_IS_float
#define EPS       DSE_REAL(1e-4)
#define TOLERANCE DSE_REAL(1e-3)
#else
#define EPS       DSE_REAL(1e-9)
#define TOLERANCE DSE_REAL(1e-7)
#endif

static const dse_real A[N * N] = {DSE_REAL(0.8),
                                  DSE_REAL(0.3),
                                  DSE_REAL(0.05),
                                  0,
                                  0,
                                  0,
                                  DSE_REAL(-0.1),
                                  DSE_REAL(0.7),
                                  0,
                                  DSE_REAL(0.04),
                                  0,
                                  0,
                                  DSE_REAL(0.06),
                                  0,
                                  DSE_REAL(0.85),
                                  DSE_REAL(0.4),
                                  DSE_REAL(0.05),
                                  0,
                                  0,
                                  0,
                                  DSE_REAL(-0.2),
                                  DSE_REAL(0.75),
                                  0,
                                  DSE_REAL(0.03),
                                  0,
                                  0,
                                  DSE_REAL(0.07),
                                  0,
                                  DSE_REAL(0.9),
                                  DSE_REAL(0.35),
                                  0,
                                  0,
                                  0,
                                  DSE_REAL(0.02),
                                  DSE_REAL(-0.1),
                                  DSE_REAL(0.8)};
static const dse_real C[NX] = {1, 0};
static const dse_real C_all[PARTS * N] = {1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 1, 0};
static const dse_real Q[NX * NX] = {DSE_REAL(0.6), DSE_REAL(0.1), DSE_REAL(0.1), DSE_REAL(0.4)};
static const dse_real R[1] = {DSE_REAL(0.5)}, D[NX * NX] = {2, 0, 0, 2};
static const dse_real x_min[N] = {-2, -2, -2, -2, -2, -2}, x_max[N] = {2, 2, 2, 2, 2, 2};
static const dse_real w_min[N] = {-1, -1, -1, -1, -1, -1}, w_max[N] = {1, 1, 1, 1, 1, 1};

static dse_real A_ii[PARTS][NX * NX], Q_all[N * N], R_all[PARTS * PARTS];
static dse_real interaction[N * N], scratch[N * N + NX * NX];
static struct dse_mhe_subsystem subsystems[PARTS], plant;
static dse_real y[SAMPLES][PARTS];
static bool valid[SAMPLES][PARTS];
static const dse_real zero[NX] = {0}; /* where the agents start: at rest */

static void make_plant(void)
{
    for (int i = 0; i < PARTS; i++) {
        for (int e = 0; e < NX * NX; e++) {
            const int r = i * NX + e / NX, s = i * NX + e % NX;
            A_ii[i][e] = A[r * N + s];
            Q_all[r * N + s] = Q[e];
        }
        R_all[i * (PARTS + 1)] = R[0];
        subsystems[i] = (struct dse_mhe_subsystem){.nx = NX,
                                                   .ny = 1,
                                                   .A = A_ii[i],
                                                   .C = C,
                                                   .Q = Q,
                                                   .R = R,
                                                   .D = D,
                                                   .x_min = x_min,
                                                   .x_max = x_max,
                                                   .w_min = w_min,
                                                   .w_max = w_max};
    }
    plant = (struct dse_mhe_subsystem){.nx = N,
                                       .ny = PARTS,
                                       .A = A,
                                       .C = C_all,
                                       .Q = Q_all,
                                       .R = R_all,
                                       .x_min = x_min,
                                       .x_max = x_max,
                                       .w_min = w_min,
                                       .w_max = w_max};
}

/* Values up to 3, beyond the bounds of the states; every seventh is missing, but for the first two,
 * which the first window needs. */
static void make_data(void)
{
    struct numbers numbers = {4};
    for (int k = 0; k < SAMPLES; k++) {
        for (int j = 0; j < PARTS; j++) {
            y[k][j] = numbers_uniform(&numbers, -3, 3);
            valid[k][j] = k < FIRST || (k * PARTS + j) % 7 != 5;
        }
    }
}

/* ---- one estimator for all ---- */

static dse_real centralised_memory[DSE_MHE_LOCAL_BOUNDED_STORAGE(N, PARTS, HORIZON, ALL_OF_PLANT)];
static dse_real centralised[SAMPLES][N];

static void run_centralised(const dse_real *stage_cost)
{
    static const struct dse_mhe_settings settings = {.horizon = HORIZON, .min_horizon = FIRST};
    static struct dse_mhe_local_config config;
    static struct dse_mhe_local local;
    struct dse_arena arena;
    plant.stage_cost = stage_cost;
    config = (struct dse_mhe_local_config){.settings = &settings, .subsystem = &plant};
    dse_arena_init(&arena, centralised_memory,
                   DSE_MHE_LOCAL_BOUNDED_STORAGE(N, PARTS, HORIZON, ALL_OF_PLANT));
    enum dse_status status = dse_mhe_local_init(&local, &config, &arena);
    for (int k = 0; k < SAMPLES && status == DSE_OK; k++) {
        const struct dse_measurement measurement = {y[k], valid[k]};
        status = dse_mhe_local_begin(&local, k, &measurement);
        dse_mhe_local_finish(&local);
        for (int a = 0; a < N; a++)
            centralised[k][a] = dse_mhe_local_state(&local)[a];
    }
    report_check("centralised", status == DSE_OK);
}

/* ---- agents and coordinator ---- */

enum {
    LOCAL = DSE_MHE_LOCAL_PRICE_BOUNDED_STORAGE(NX, 1, HORIZON, ALL),
    PREDICTION = DSE_MHE_COORDINATOR_PREDICTION_BOUNDED_STORAGE(N, PARTS, NX, HORIZON, 4),
    PRICE = DSE_MHE_COORDINATOR_PRICE_BOUNDED_STORAGE(N, PARTS, NX, 1, PARTS, HORIZON),
    COORDINATOR = (int)PRICE > (int)PREDICTION ? (int)PRICE : (int)PREDICTION
};
static dse_real local_memory[PARTS][LOCAL], coordinator_memory[COORDINATOR];
static struct dse_mhe_settings settings;
static struct dse_mhe_local_config local_config[PARTS];
static struct dse_mhe_local local[PARTS];
static struct dse_mhe_coordinator_config config;
static struct dse_mhe_coordinator coordinator;
static dse_real down[DSE_MHE_DOWN_SIZE(NX, HORIZON)], up[DSE_MHE_UP_SIZE(NX, 1, HORIZON)];

static enum dse_status start(enum dse_mhe_scheme scheme)
{
    struct dse_arena arena;
    settings =
        (struct dse_mhe_settings){.scheme = scheme, .horizon = HORIZON, .min_horizon = FIRST};
    config = (struct dse_mhe_coordinator_config){.settings = &settings,
                                                 .parts = PARTS,
                                                 .subsystems = subsystems,
                                                 .A = A,
                                                 .eps = EPS,
                                                 .max_iter = 200,
                                                 .anderson = scheme == DSE_MHE_PREDICTION ? 4 : 0};
    dse_arena_init(&arena, coordinator_memory, COORDINATOR);
    enum dse_status status = dse_mhe_coordinator_init(&coordinator, &config, &arena);
    for (int i = 0; i < PARTS && status == DSE_OK; i++) {
        local_config[i] = (struct dse_mhe_local_config){
            .settings = &settings, .subsystem = &subsystems[i], .start = zero};
        dse_arena_init(&arena, local_memory[i], LOCAL);
        status = dse_mhe_local_init(&local[i], &local_config[i], &arena);
    }
    return status;
}

/* A question of the coordinator and the answer, or the last word. */
static void talk(int i, bool answer)
{
    int count = dse_mhe_coordinator_message_down(&coordinator, i, down);
    (void)dse_mhe_local_receive_down(&local[i], down, count);
    if (!answer)
        return;
    dse_mhe_local_solve(&local[i]);
    count = dse_mhe_local_message_up(&local[i], up);
    (void)dse_mhe_coordinator_receive_up(&coordinator, i, up, count);
}

static enum dse_mhe_outcome sample(int k)
{
    for (int i = 0; i < PARTS; i++) {
        const struct dse_measurement measurement = {&y[k][i], &valid[k][i]};
        (void)dse_mhe_local_begin(&local[i], k, &measurement);
    }
    (void)dse_mhe_coordinator_begin(&coordinator, k);
    enum dse_mhe_outcome outcome = dse_mhe_coordinator_outcome(&coordinator);
    const bool starting = outcome != DSE_MHE_CONTINUE;
    while (outcome == DSE_MHE_CONTINUE) {
        for (int i = 0; i < PARTS; i++)
            talk(i, true);
        outcome = dse_mhe_coordinator_advance(&coordinator);
    }
    for (int i = 0; i < PARTS; i++) {
        if (!starting)
            talk(i, false);
        dse_mhe_local_finish(&local[i]);
    }
    return outcome;
}

static void run(const char *name, enum dse_mhe_scheme scheme)
{
    dse_real gap = 0, x[N];
    int active = 0;
    bool converged = start(scheme) == DSE_OK;
    for (int k = 0; k < SAMPLES && converged; k++) {
        const enum dse_mhe_outcome outcome = sample(k);
        converged =
            outcome == (k < FIRST - 1 ? DSE_MHE_OUTCOME_STARTING : DSE_MHE_OUTCOME_CONVERGED);
        for (int a = 0; a < N; a++) {
            x[a] = dse_mhe_local_state(&local[a / NX])[a % NX];
            gap = dse_max(gap, dse_abs(x[a] - centralised[k][a]));
        }
        for (int i = 0; i < PARTS; i++)
            active += dse_mhe_local_active(&local[i]);
        report_int("rounds", dse_mhe_coordinator_iterations(&coordinator));
        report_vector(name, N, x);
    }
    report_int("active bounds", active);
    report_check("every sample converges", converged);
    report_check("bounds are active", active >= SAMPLES);
    report_check("the centralised estimates", gap <= TOLERANCE);
}

int main(void)
{
    make_plant();
    make_data();
    run_centralised(0);
    run("prediction", DSE_MHE_PREDICTION);
    report_check("cost of interactions",
                 dse_mhe_interaction_cost(N, A, PARTS, subsystems, interaction, scratch) == DSE_OK);
    run_centralised(interaction);
    run("price", DSE_MHE_PRICE);
    return report_verdict();
}
