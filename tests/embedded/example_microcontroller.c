/* A filter on a microcontroller: level and outlet coefficient of a draining tank, from a level
 * sensor that may fail. All memory is static.
 *
 *     level' = (u - c sqrt(level)) / A,   c' = 0,   y = level + noise */
#include "dse/ekf.h"
#include "dse/math.h"

static const dse_real A = 0.1; /* m2 */

static enum dse_status f(const struct dse_model *model, dse_real t, const dse_real *x,
                         const dse_real *u, dse_real *dx)
{
    if (x[0] <= 0)
        return DSE_EMODEL; /* no such tank: the estimate stays as it was */
    dx[0] = (u[0] - x[1] * dse_sqrt(x[0])) / A;
    dx[1] = 0;
    return DSE_OK;
}

static enum dse_status dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                            const dse_real *u, dse_real *F)
{
    dse_real root = dse_sqrt(x[0]);
    F[0] = -x[1] / (2 * A * root), F[1] = -root / A;
    F[2] = F[3] = 0;
    return DSE_OK;
}

static enum dse_status h(const struct dse_model *model, dse_real t, const dse_real *x,
                         const dse_real *u, dse_real *y)
{
    y[0] = x[0];
    return DSE_OK;
}

static enum dse_status dhdx(const struct dse_model *model, dse_real t, const dse_real *x,
                            const dse_real *u, dse_real *H)
{
    H[0] = 1, H[1] = 0;
    return DSE_OK;
}

static const struct dse_model tank = {
    .time = DSE_CONTINUOUS, .nx = 2, .nu = 1, .ny = 1, .f = f, .h = h, .dfdx = dfdx, .dhdx = dhdx};
static const dse_real x0[] = {0.5, 0.001}, P0[] = {0.01, 0, 0, 1e-6};
static const dse_real Q[] = {1e-8, 0, 0, 1e-12}, R[] = {1e-4};
static const struct dse_ekf_config config = {
    .model = &tank, .x0 = x0, .P0 = P0, .Q = Q, .R = R, .gate = 5};
static dse_real memory[DSE_EKF_STORAGE_CONTINUOUS(2, 1)];
static struct dse_ekf ekf;

enum dse_status estimator_start(void)
{
    struct dse_arena arena;
    dse_arena_init(&arena, memory, DSE_EKF_STORAGE_CONTINUOUS(2, 1));
    return dse_ekf_init(&ekf, &config, &arena);
}

/* Called by the timer; level is NaN when the sensor said nothing. Read the result with
 * dse_ekf_state, dse_ekf_variance and, before trusting it, dse_ekf_health. */
const struct dse_ekf *estimator_sample(dse_real t, dse_real pump, dse_real level)
{
    const struct dse_measurement measurement = {.y = &level};
    if (dse_ekf_predict(&ekf, t, &pump) == DSE_OK)
        dse_ekf_update(&ekf, t, &pump, &measurement);
    return &ekf;
}
