/* The classical Runge-Kutta method. */
#include "dse/math.h"
#include "dse/ode.h"

enum dse_status dse_held_model_rhs(void *context, dse_real t, const dse_real *x, dse_real *dx)
{
    const struct dse_held_model *held = context;
    return held->model->f(held->model, t, x, held->u, dx);
}

enum dse_status dse_rk4_step(dse_ode_rhs f, void *context, dse_real t, dse_real h, int n,
                             dse_real *x, dse_real *scratch)
{
    /* Stage s is evaluated at t + c_s h, x + c_s h k_(s-1). */
    static const dse_real c[4] = {0, DSE_REAL(0.5), DSE_REAL(0.5), 1};
    static const dse_real weight[4] = {1, 2, 2, 1};
    dse_real *k = scratch, *stage = scratch + n, *sum = scratch + 2 * n;

    for (int s = 0; s < 4; s++) {
        if (s > 0)
            for (int j = 0; j < n; j++)
                stage[j] = x[j] + c[s] * h * k[j];
        enum dse_status status = f(context, t + c[s] * h, s > 0 ? stage : x, k);
        if (status != DSE_OK)
            return status;
        for (int j = 0; j < n; j++)
            sum[j] = (s > 0 ? sum[j] : 0) + weight[s] * k[j];
    }
    for (int j = 0; j < n; j++)
        stage[j] = x[j] + h / 6 * sum[j];
    if (!dse_all_finite(stage, n))
        return DSE_ENONFINITE;
    for (int j = 0; j < n; j++)
        x[j] = stage[j];
    return DSE_OK;
}

enum dse_status dse_rk4_model_step(const struct dse_model *model, dse_real t, dse_real h,
                                   const dse_real *u, dse_real *x, dse_real *scratch)
{
    if (model->time != DSE_CONTINUOUS)
        return DSE_EINVAL;
    struct dse_held_model held = {model, u};
    return dse_rk4_step(dse_held_model_rhs, &held, t, h, model->nx, x, scratch);
}
