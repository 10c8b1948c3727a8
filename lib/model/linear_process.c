/* The linear process around its operating point. */
#include "dse/model.h"

#include <stddef.h>

#include "dse/linalg.h"
#include "dse/math.h"

/* Row i of M (columns wide) times x - o. */
static dse_real row_times_deviation(const struct dse_linear_process *process, int n,
                                    const dse_real *row, const dse_real *x)
{
    if (process->origin == NULL)
        return dse_dot(n, row, x);
    dse_real sum = 0;
    for (int j = 0; j < n; j++)
        sum += row[j] * (x[j] - process->origin[j]);
    return sum;
}

/* sin(omega t), 0 where nothing swings. */
static dse_real swing_at(const struct dse_linear_process *process, dse_real t)
{
    return process->swing != NULL ? dse_sin(process->omega * t) : 0;
}

static enum dse_status process_f(const struct dse_model *model, dse_real t, const dse_real *x,
                                 const dse_real *u, dse_real *dx)
{
    const struct dse_linear_process *process = model->parameters;
    const dse_real *A = process->linear.A, *B = process->linear.B;
    const int n = model->nx;
    const dse_real swing = swing_at(process, t);
    for (int i = 0; i < n; i++) {
        /* A_i (x - o) + sin(omega t) A_s,i (x - o) + B_i u */
        dx[i] = row_times_deviation(process, n, A + i * n, x);
        if (process->swing != NULL)
            dx[i] += swing * row_times_deviation(process, n, process->swing + i * n, x);
        if (B != NULL)
            dx[i] += dse_dot(model->nu, B + i * model->nu, u);
        if (process->origin != NULL && model->time == DSE_DISCRETE)
            dx[i] += process->origin[i];
    }
    return DSE_OK;
}

static enum dse_status process_h(const struct dse_model *model, dse_real t, const dse_real *x,
                                 const dse_real *u, dse_real *y)
{
    (void)t;
    const struct dse_linear *linear =
        &((const struct dse_linear_process *)model->parameters)->linear;
    dse_mat_vec(model->ny, model->nx, linear->C, x, y);
    if (linear->D != NULL)
        for (int i = 0; i < model->ny; i++)
            y[i] += dse_dot(model->nu, linear->D + i * model->nu, u);
    return DSE_OK;
}

static enum dse_status process_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                    const dse_real *u, dse_real *F)
{
    (void)x, (void)u;
    const struct dse_linear_process *process = model->parameters;
    const dse_real swing = swing_at(process, t);
    for (int k = 0; k < model->nx * model->nx; k++)
        F[k] = process->swing != NULL ? process->linear.A[k] + swing * process->swing[k]
                                      : process->linear.A[k];
    return DSE_OK;
}

static enum dse_status process_dhdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                    const dse_real *u, dse_real *H)
{
    (void)t, (void)x, (void)u;
    const struct dse_linear_process *process = model->parameters;
    for (int k = 0; k < model->ny * model->nx; k++)
        H[k] = process->linear.C[k];
    return DSE_OK;
}

void dse_linear_process_model(struct dse_model *model, enum dse_time_kind time, int nx, int nu,
                              int ny, const struct dse_linear_process *process)
{
    *model = (struct dse_model){
        .time = time,
        .nx = nx,
        .nu = nu,
        .ny = ny,
        .parameters = process,
        .f = process_f,
        .h = process_h,
        .dfdx = process_dfdx,
        .dhdx = process_dhdx,
    };
}
