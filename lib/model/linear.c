/* The linear model. */
#include "dse/model.h"

#include <stddef.h>

#include "dse/linalg.h"

/* v (m) = P x + Q u, P m x nx, Q m x nu or NULL. */
static void affine(const struct dse_model *model, int m, const dse_real *P, const dse_real *x,
                   const dse_real *Q, const dse_real *u, dse_real *v)
{
    dse_mat_vec(m, model->nx, P, x, v);
    if (Q != NULL)
        for (int i = 0; i < m; i++)
            v[i] += dse_dot(model->nu, Q + i * model->nu, u);
}

static void copy(int count, const dse_real *from, dse_real *to)
{
    for (int i = 0; i < count; i++)
        to[i] = from[i];
}

static enum dse_status linear_f(const struct dse_model *model, dse_real t, const dse_real *x,
                                const dse_real *u, dse_real *dx)
{
    (void)t;
    const struct dse_linear *linear = model->parameters;
    affine(model, model->nx, linear->A, x, linear->B, u, dx);
    return DSE_OK;
}

static enum dse_status linear_h(const struct dse_model *model, dse_real t, const dse_real *x,
                                const dse_real *u, dse_real *y)
{
    (void)t;
    const struct dse_linear *linear = model->parameters;
    affine(model, model->ny, linear->C, x, linear->D, u, y);
    return DSE_OK;
}

static enum dse_status linear_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                   const dse_real *u, dse_real *F)
{
    (void)t, (void)x, (void)u;
    const struct dse_linear *linear = model->parameters;
    copy(model->nx * model->nx, linear->A, F);
    return DSE_OK;
}

static enum dse_status linear_dhdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                   const dse_real *u, dse_real *H)
{
    (void)t, (void)x, (void)u;
    const struct dse_linear *linear = model->parameters;
    copy(model->ny * model->nx, linear->C, H);
    return DSE_OK;
}

void dse_linear_model(struct dse_model *model, enum dse_time_kind time, int nx, int nu, int ny,
                      const struct dse_linear *linear)
{
    *model = (struct dse_model){
        .time = time,
        .nx = nx,
        .nu = nu,
        .ny = ny,
        .parameters = linear,
        .f = linear_f,
        .h = linear_h,
        .dfdx = linear_dfdx,
        .dhdx = linear_dhdx,
    };
}
