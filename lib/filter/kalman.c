/* Kalman filter: a linear model, discretised when need be, in the extended Kalman filter. */
#include "dse/kalman.h"

#include <stddef.h>

#include "dse/math.h"

/* Ad, Bd of the held-input discretisation and Qd of Van Loan, all in the arena for good. */
static enum dse_status discretise(struct dse_kalman *kalman, const struct dse_kalman_config *config,
                                  struct dse_arena *arena)
{
    const int nx = config->nx, nu = config->nu;
    dse_real *Ad = dse_arena_take(arena, nx * nx);
    dse_real *Qd = dse_arena_take(arena, nx * nx);
    dse_real *Bd = dse_arena_take(arena, nx * nu);
    struct dse_arena rest = *arena; /* scratch from what the filter takes only afterwards */
    dse_real *scratch = dse_arena_take(
        &rest, DSE_EKF_LARGER(DSE_DISCRETISE_SCRATCH(nx, nu), DSE_VAN_LOAN_SCRATCH(nx)));
    if (!scratch)
        return DSE_ESTORAGE; /* the largest piece: if it fits, all before it did */
    if (config->Q) {
        const enum dse_status status =
            dse_van_loan(nx, config->linear.A, config->Q, config->period, Ad, Qd, scratch);
        if (status != DSE_OK)
            return status;
        kalman->config.Q = Qd;
    }
    kalman->linear.A = Ad;
    kalman->linear.B = nu > 0 ? Bd : NULL;
    return dse_discretise(nx, nu, config->linear.A, config->linear.B, config->period, Ad, Bd,
                          scratch);
}

enum dse_status dse_kalman_init(struct dse_kalman *kalman, const struct dse_kalman_config *config,
                                struct dse_arena *arena)
{
    const struct dse_linear *linear = &config->linear;
    if (config->nx < 1 || config->nu < 0 || config->ny < 0 || !linear->A)
        return DSE_EINVAL;
    if ((config->nu > 0 && !linear->B) || (config->ny > 0 && !linear->C))
        return DSE_EINVAL;
    if (!(config->period >= 0) || !dse_is_finite(config->period))
        return DSE_EINVAL;
    kalman->linear = *linear;
    kalman->config = (struct dse_ekf_config){.model = &kalman->model,
                                             .t0 = config->t0,
                                             .x0 = config->x0,
                                             .P0 = config->P0,
                                             .Q = config->Q,
                                             .R = config->R,
                                             .gate = config->gate};
    if (config->period > 0) {
        const enum dse_status status = discretise(kalman, config, arena);
        if (status != DSE_OK)
            return status;
    }
    dse_linear_model(&kalman->model, DSE_DISCRETE, config->nx, config->nu, config->ny,
                     &kalman->linear);
    return dse_ekf_init(&kalman->ekf, &kalman->config, arena);
}

enum dse_status dse_kalman_predict(struct dse_kalman *kalman, dse_real t, const dse_real *u)
{
    return dse_ekf_predict(&kalman->ekf, t, u);
}

enum dse_status dse_kalman_update(struct dse_kalman *kalman, dse_real t, const dse_real *u,
                                  const struct dse_measurement *measurement)
{
    return dse_ekf_update(&kalman->ekf, t, u, measurement);
}

const struct dse_ekf *dse_kalman_ekf(const struct dse_kalman *kalman)
{
    return &kalman->ekf;
}
