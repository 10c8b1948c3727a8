/* Extended Kalman filter: from one time to the next. */
#include "ekf_internal.h"

#include <stddef.h>

#include "dse/linalg.h"
#include "dse/math.h"
#include "dse/ode.h"

/* Radau's rule on [0, h]: nodes h/3 and h with weights 3h/4 and h/4, exact for polynomials of
 * degree
 * 2. Its last node is the end of the panel, so noise is only ever added after a propagation. */
#define NODE         (1 / DSE_REAL(3))
#define WEIGHT_INNER DSE_REAL(0.75)
#define WEIGHT_END   DSE_REAL(0.25)
#define PANELS_MAX   1000000

/* x+ = f(x, u),  P+ = F P F' + Q. */
static enum dse_status predict_discrete(struct dse_ekf *ekf, const dse_real *u)
{
    const struct dse_model *model = ekf->config->model;
    enum dse_status status = model->f(model, ekf->time, ekf->x, u, ekf->x_next);
    if (status != DSE_OK)
        return status;
    dse_real *F = ekf->scratch + DSE_FACTORED_PREDICT_SCRATCH(ekf->nx);
    status = model->dfdx(model, ekf->time, ekf->x, u, F);
    if (status != DSE_OK)
        return status;
    return dse_factored_predict(ekf->nx, ekf->T, ekf->d, ekf->config->Q, 1, F, ekf->T_next,
                                ekf->d_next, ekf->scratch);
}

/* Mean and transition matrix as one system z = [x; Phi]. */
struct transition {
    const struct dse_model *model;
    const dse_real *u;
    dse_real *F; /* nx x nx */
};

static enum dse_status transition_rhs(void *context, dse_real t, const dse_real *z, dse_real *dz)
{
    const struct transition *transition = context;
    const struct dse_model *model = transition->model;
    const int n = model->nx;
    enum dse_status status = model->f(model, t, z, transition->u, dz); /* x' = f(x, u) */
    if (status != DSE_OK)
        return status;
    status = model->dfdx(model, t, z, transition->u, transition->F);
    if (status != DSE_OK)
        return status;
    dse_mat_mul(n, n, n, transition->F, z + n, dz + n); /* Phi' = F Phi */
    return DSE_OK;
}

/* Over h from the estimate in (x, T, d) to the next one, which may be the same arrays:
 *     x+ = x(t + h),  P+ = Phi P Phi' + weight Q. */
static enum dse_status propagate(struct dse_ekf *ekf, dse_real t, dse_real h, dse_real weight,
                                 const dse_real *u, const dse_real *x, const dse_real *T,
                                 const dse_real *d)
{
    const int n = ekf->nx;
    dse_real *z = ekf->ode, *F = z + n + n * n, *rest = F + n * n;
    struct transition transition = {.model = ekf->config->model, .u = u, .F = F};
    for (int i = 0; i < n; i++)
        z[i] = x[i];
    dse_mat_identity(n, z + n);
    const enum dse_status status =
        dse_rk4_step(transition_rhs, &transition, t, h, n + n * n, z, rest);
    if (status != DSE_OK)
        return status;
    for (int i = 0; i < n; i++)
        ekf->x_next[i] = z[i];
    return dse_factored_predict(n, T, d, ekf->config->Q, weight, z + n, ekf->T_next, ekf->d_next,
                                ekf->scratch);
}

/* Panels for an interval; 0: too many. */
static int count_panels(const struct dse_ekf_config *config, dse_real interval)
{
    const int least = config->panels > 0 ? config->panels : 1;
    if (!(config->max_panel > 0))
        return least;
    const dse_real needed = interval / config->max_panel;
    if (!(needed < PANELS_MAX))
        return 0;
    int panels = (int)needed;
    if ((dse_real)panels < needed * (1 - 4 * DSE_REAL_EPSILON))
        panels++;
    return panels > least ? panels : least;
}

static enum dse_status predict_continuous(struct dse_ekf *ekf, dse_real t, const dse_real *u)
{
    const dse_real interval = t - ekf->time;
    const int panels = count_panels(ekf->config, interval);
    if (panels == 0)
        return DSE_EINVAL;
    const dse_real h = interval / (dse_real)panels;
    const dse_real *x = ekf->x, *T = ekf->T, *d = ekf->d;
    for (int p = 0; p < panels; p++) {
        const dse_real start = ekf->time + (dse_real)p * h;
        enum dse_status status = propagate(ekf, start, NODE * h, WEIGHT_INNER * h, u, x, T, d);
        if (status != DSE_OK)
            return status;
        x = ekf->x_next;
        T = ekf->T_next;
        d = ekf->d_next;
        status = propagate(ekf, start + NODE * h, h - NODE * h, WEIGHT_END * h, u, x, T, d);
        if (status != DSE_OK)
            return status;
    }
    return DSE_OK;
}

enum dse_status dse_ekf_predict(struct dse_ekf *ekf, dse_real t, const dse_real *u)
{
    const bool continuous = ekf->config->model->time == DSE_CONTINUOUS;
    if (!dse_is_finite(t) || t < ekf->time)
        return DSE_EINVAL;
    if (!(continuous && t == ekf->time)) {
        const enum dse_status status =
            continuous ? predict_continuous(ekf, t, u) : predict_discrete(ekf, u);
        if (status != DSE_OK)
            return dse_ekf_fail(ekf, status);
        if (!dse_all_finite(ekf->x_next, ekf->nx))
            return dse_ekf_fail(ekf, DSE_ENONFINITE);
        dse_ekf_commit(ekf);
        ekf->time = t;
    }
    const bool coasting = ekf->predicted || ekf->health == DSE_HEALTH_DIVERGED;
    if (coasting && ekf->counts.used > 0)
        ekf->health = DSE_HEALTH_COASTING;
    ekf->predicted = true;
    ekf->counts.predictions++;
    return DSE_OK;
}
