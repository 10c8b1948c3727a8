/* The extended Kalman filter: on a pendulum it follows a textbook filter written elsewhere
 * (golden/ekf_table.py); on the two-reactor plant, continuous with sampled noisy outputs, its bits
 * are the host's. */
#include "dse/ekf.h"

#include "dse/math.h"
#include "dse/plant.h"
#include "dse/random.h"
#include "golden_ekf.h"
#include "report.h"

/* ---- the pendulum, discrete ---- */

#ifdef DSE_REAL_IS_float
#define TOLERANCE DSE_REAL(1e-4)
#define FLOOR     DSE_REAL(1e-6)
#else
#define TOLERANCE DSE_REAL(1e-9)
#define FLOOR     DSE_REAL(1e-12)
#endif

#define RATIO (PENDULUM_GRAVITY / PENDULUM_LENGTH)

static enum dse_status move(const struct dse_model *model, dse_real t, const dse_real *x,
                            const dse_real *u, dse_real *next)
{
    (void)model, (void)t, (void)u;
    next[0] = x[0] + PENDULUM_STEP * x[1];
    next[1] = x[1] - PENDULUM_STEP * (RATIO * dse_sin(x[0]) + PENDULUM_DAMPING * x[1]);
    return DSE_OK;
}

static enum dse_status move_jacobian(const struct dse_model *model, dse_real t, const dse_real *x,
                                     const dse_real *u, dse_real *F)
{
    (void)model, (void)t, (void)u;
    F[0] = 1;
    F[1] = PENDULUM_STEP;
    F[2] = -PENDULUM_STEP * RATIO * dse_cos(x[0]);
    F[3] = 1 - PENDULUM_STEP * PENDULUM_DAMPING;
    return DSE_OK;
}

static enum dse_status position(const struct dse_model *model, dse_real t, const dse_real *x,
                                const dse_real *u, dse_real *y)
{
    (void)model, (void)t, (void)u;
    y[0] = PENDULUM_LENGTH * dse_sin(x[0]);
    return DSE_OK;
}

static enum dse_status position_jacobian(const struct dse_model *model, dse_real t,
                                         const dse_real *x, const dse_real *u, dse_real *H)
{
    (void)model, (void)t, (void)u;
    H[0] = PENDULUM_LENGTH * dse_cos(x[0]);
    H[1] = 0;
    return DSE_OK;
}

static const struct dse_model pendulum = {
    .time = DSE_DISCRETE,
    .nx = 2,
    .ny = 1,
    .f = move,
    .h = position,
    .dfdx = move_jacobian,
    .dhdx = position_jacobian,
};

static void check_pendulum(const struct dse_ekf *ekf, int k)
{
    dse_real P[4];
    dse_ekf_covariance(ekf, P);
    const dse_real *x = dse_ekf_state(ekf);
    const dse_real got[] = {x[0], x[1], P[0], P[2], P[3]};
    report_digest("pendulum", 5, got);
    for (int j = 0; j < 5; j++) {
        dse_real expected = pendulum_expected[k][j];
        dse_real error = dse_abs(got[j] - expected);
        report_check("pendulum follows the textbook filter",
                     error <= TOLERANCE * dse_abs(expected) + FLOOR);
    }
}

static enum dse_status run_pendulum(void)
{
    static dse_real memory[DSE_EKF_STORAGE(2, 1)];
    static const dse_real x0[] = {PENDULUM_ANGLE, PENDULUM_SPEED};
    static const dse_real start_P[] = {DSE_REAL(0.25), 0, 0, 1};
    static const dse_real noise[] = {PENDULUM_Q_ANGLE, 0, 0, PENDULUM_Q_SPEED};
    static const dse_real sensor[] = {PENDULUM_R};
    const struct dse_ekf_config config = {
        .model = &pendulum, .x0 = x0, .P0 = start_P, .Q = noise, .R = sensor};
    struct dse_arena arena;
    struct dse_ekf ekf;
    dse_arena_init(&arena, memory, DSE_EKF_STORAGE(2, 1));
    enum dse_status status = dse_ekf_init(&ekf, &config, &arena);
    for (int k = 0; k < PENDULUM_SAMPLES && !status; k++) {
        const dse_real t = PENDULUM_STEP * (dse_real)(k + 1);
        const struct dse_measurement y = {.y = &pendulum_y[k]};
        status = dse_ekf_predict(&ekf, t, 0);
        if (!status)
            status = dse_ekf_update(&ekf, t, 0, &y);
        if (!status)
            check_pendulum(&ekf, k);
    }
    if (!status)
        report_vector("pendulum at last", 2, dse_ekf_state(&ekf));
    return status;
}

/* ---- the two reactors, continuous; every fifth sample of a sensor is lost ---- */

enum { NX = 4, NY = 2, NU = 2, SAMPLES = 40, PREPARED = 256 };

static const dse_real period = DSE_REAL(1.0) / 360; /* 10 s in hours */

static const dse_real guess[] = {396, DSE_REAL(2.6), 352, DSE_REAL(3.5)};
static const dse_real P0[] = {900, 0, 0, 0, 0, 1, 0, 0, 0, 0, 900, 0, 0, 0, 0, 1};
static const dse_real Q[] = {150, 0, 0, 0, 0, 5, 0, 0, 0, 0, 150, 0, 0, 0, 0, 5};
static const dse_real R[] = {1, DSE_REAL(0.25), DSE_REAL(0.25), 1}; /* correlated sensors */

static struct {
    dse_real prepared[PREPARED], memory[DSE_EKF_STORAGE_CONTINUOUS(NX, NY)];
    dse_real x[NX], u[NU]; /* the plant's state and inputs */
    struct dse_model model;
    struct dse_ekf_config config;
    struct dse_ekf ekf;
    struct dse_random random;
} reactors;

static enum dse_status start_reactors(void)
{
    const struct dse_plant *plant = dse_plant_find("cstr2");
    if (!plant || plant->prepared_size > PREPARED || plant->nx != NX || plant->nu != NU)
        return DSE_EDIM;
    enum dse_status status = plant->prepare(plant->sets[0].values, reactors.prepared);
    if (status)
        return status;
    plant->model(reactors.prepared, &reactors.model);
    for (int j = 0; j < NX; j++)
        reactors.x[j] = plant->sets[0].x0[j];
    for (int j = 0; j < NU; j++)
        reactors.u[j] = plant->inputs[j].nominal;
    dse_random_init(&reactors.random, 2016, 0);

    reactors.config = (struct dse_ekf_config){
        .model = &reactors.model, .x0 = guess, .P0 = P0, .Q = Q, .R = R, .gate = 6};
    struct dse_arena arena;
    dse_arena_init(&arena, reactors.memory, DSE_EKF_STORAGE_CONTINUOUS(NX, NY));
    return dse_ekf_init(&reactors.ekf, &reactors.config, &arena);
}

/* The plant at t_{k+1} and what its noisy sensors say. */
static enum dse_status measure(int k, dse_real *y)
{
    const struct dse_model *model = &reactors.model;
    const dse_real t = period * (dse_real)k;
    dse_real scratch[DSE_RK4_SCRATCH(NX)];
    enum dse_status status = dse_rk4_model_step(model, t, period, reactors.u, reactors.x, scratch);
    if (!status)
        status = model->h(model, t + period, reactors.x, reactors.u, y);
    for (int j = 0; j < NY; j++)
        y[j] += (dse_real)dse_random_normal(&reactors.random);
    return status;
}

static enum dse_status filter(int k, const dse_real *y)
{
    const dse_real t = period * (dse_real)(k + 1);
    const bool valid[NY] = {k % 5 != 4, true};
    const struct dse_measurement measurement = {.y = y, .valid = valid};
    enum dse_status status = dse_ekf_predict(&reactors.ekf, t, reactors.u);
    if (!status)
        status = dse_ekf_update(&reactors.ekf, t, reactors.u, &measurement);
    return status;
}

static void report_reactors(void)
{
    dse_real P[NX * NX];
    dse_ekf_covariance(&reactors.ekf, P);
    report_vector("reactors", NX, dse_ekf_state(&reactors.ekf));
    report_digest("reactors P", NX * NX, P);
    report_real("reactors nis", dse_ekf_nis(&reactors.ekf));
    report_int("reactors health", (int)dse_ekf_health(&reactors.ekf));
}

static enum dse_status run_reactors(void)
{
    enum dse_status status = start_reactors();
    for (int k = 0; k < SAMPLES && !status; k++) {
        dse_real y[NY] = {0};
        status = measure(k, y);
        if (!status)
            status = filter(k, y);
        if (!status)
            report_reactors();
    }
    if (status)
        return status;
    const dse_real error = dse_abs(dse_ekf_state(&reactors.ekf)[0] - reactors.x[0]);
    report_check("the filter finds the temperature", error < 3);
    return DSE_OK;
}

int main(void)
{
    enum dse_status status = run_pendulum();
    report_int("pendulum status", status);
    report_check("the pendulum's filter runs", status == DSE_OK);
    status = run_reactors();
    report_int("reactors status", status);
    report_check("the reactors' filter runs", status == DSE_OK);
    return report_verdict();
}
