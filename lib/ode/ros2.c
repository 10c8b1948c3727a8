/* ROS2, a linearly implicit Runge-Kutta (Rosenbrock-W) method: one factorisation and two solves. */
#include "dse/ode.h"

#include <stddef.h>

#include "dse/linalg.h"
#include "dse/math.h"

#define GAMMA DSE_REAL(0.29289321881345247560) /* 1 - 1/sqrt 2 */

/* Factors W = I - gamma h J. */
static enum dse_status factor(const struct dse_model *model, dse_real t, dse_real h,
                              const dse_real *u, const dse_real *x, dse_real *W, int *pivots)
{
    const int n = model->nx;
    enum dse_status status = model->dfdx(model, t, x, u, W);
    if (status != DSE_OK)
        return status;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            W[i * n + j] = (i == j ? 1 : 0) - GAMMA * h * W[i * n + j];
    return dse_lu(n, W, pivots);
}

enum dse_status dse_ros2_step(const struct dse_model *model, dse_real t, dse_real h,
                              const dse_real *u, dse_real *x, dse_real *scratch)
{
    if (model->time != DSE_CONTINUOUS || model->dfdx == NULL)
        return DSE_EINVAL;
    const int n = model->nx;
    dse_real *W = scratch, *k1 = W + n * n, *k2 = k1 + n, *stage = k2 + n;
    int *pivots = (int *)(void *)(stage + n);

    enum dse_status status = factor(model, t, h, u, x, W, pivots);
    if (status != DSE_OK)
        return status;

    /* W k1 = f(t, x) */
    status = model->f(model, t, x, u, k1);
    if (status != DSE_OK)
        return status;
    dse_lu_solve(n, W, pivots, 1, k1);

    /* W k2 = f(t + h, x + h k1) - 2 k1 */
    for (int j = 0; j < n; j++)
        stage[j] = x[j] + h * k1[j];
    status = model->f(model, t + h, stage, u, k2);
    if (status != DSE_OK)
        return status;
    for (int j = 0; j < n; j++)
        k2[j] -= 2 * k1[j];
    dse_lu_solve(n, W, pivots, 1, k2);

    /* x + h/2 (3 k1 + k2) */
    for (int j = 0; j < n; j++)
        stage[j] = x[j] + h / 2 * (3 * k1[j] + k2[j]);
    if (!dse_all_finite(stage, n))
        return DSE_ENONFINITE;
    for (int j = 0; j < n; j++)
        x[j] = stage[j];
    return DSE_OK;
}
