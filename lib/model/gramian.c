/* Gramians of linear time-varying models over a window. */
#include "dse/gramian.h"

#include <stddef.h>

#include "dse/linalg.h"
#include "dse/math.h"

struct context {
    const struct dse_model *model;
    int ny;
    const dse_real *C; /* observability */
    const dse_real *G; /* controllability */
    dse_real *A;       /* nx x nx */
    dse_real *product; /* nx x nx */
    dse_real *CPhi;    /* ny x nx */
    dse_real *zero;    /* nx */
};

static enum dse_status transition(const struct context *c, dse_real t)
{
    return c->model->dfdx(c->model, t, c->zero, NULL, c->A);
}

/* M += h (C Phi)' (C Phi). */
static void add_outputs(const struct context *c, const dse_real *Phi, dse_real *M)
{
    const int n = c->model->nx;
    dse_mat_mul(c->ny, n, n, c->C, Phi, c->CPhi);
    for (int l = 0; l < c->ny; l++)
        dse_sym_rank1(n, 1, c->CPhi + l * n, M);
}

/* [Phi; M]: Phi' = A Phi, M' = Phi' C' C Phi. */
static enum dse_status observability_rate(void *context, dse_real t, const dse_real *x,
                                          dse_real *dx)
{
    const struct context *c = context;
    const int n = c->model->nx;
    const enum dse_status status = transition(c, t);
    if (status != DSE_OK)
        return status;
    dse_mat_mul(n, n, n, c->A, x, dx);
    for (int k = 0; k < n * n; k++)
        dx[n * n + k] = 0;
    add_outputs(c, x, dx + n * n);
    return DSE_OK;
}

/* W' = A W + W A' + G. */
static enum dse_status controllability_rate(void *context, dse_real t, const dse_real *W,
                                            dse_real *dW)
{
    const struct context *c = context;
    const int n = c->model->nx;
    const enum dse_status status = transition(c, t);
    if (status != DSE_OK)
        return status;
    dse_mat_mul(n, n, n, c->A, W, c->product);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            dW[i * n + j] = c->product[i * n + j] + c->product[j * n + i] + c->G[i * n + j];
    return DSE_OK;
}

static bool good(const struct dse_window *window)
{
    const struct dse_model *model = window->model;
    if (model == NULL || model->dfdx == NULL || model->nx < 1 || window->steps < 1 ||
        !dse_is_finite(window->t0))
        return false;
    return model->time == DSE_DISCRETE || (window->length > 0 && dse_is_finite(window->length));
}

static struct context prepare(const struct dse_window *window, int ny, dse_real *scratch)
{
    const int n = window->model->nx;
    struct context c = {.model = window->model, .ny = ny};
    c.A = scratch;
    c.product = c.A + n * n;
    c.CPhi = c.product + n * n;
    c.zero = c.CPhi + ny * n;
    for (int i = 0; i < n; i++)
        c.zero[i] = 0;
    return c;
}

static enum dse_status integrate(const struct dse_window *window, dse_ode_rhs rate,
                                 struct context *c, int size, dse_real *x, dse_real *scratch)
{
    const dse_real h = window->length / (dse_real)window->steps;
    enum dse_status status = DSE_OK;
    for (int k = 0; status == DSE_OK && k < window->steps; k++)
        status = dse_rk4_step(rate, c, window->t0 + (dse_real)k * h, h, size, x, scratch);
    return status;
}

/* Discrete: M = sum_k Phi_k' C' C Phi_k, Phi_{k+1} = A(k) Phi_k. */
static enum dse_status sum_outputs(const struct dse_window *window, struct context *c,
                                   dse_real *Phi, dse_real *M)
{
    const int n = c->model->nx;
    for (int k = 0; k < window->steps; k++) {
        const enum dse_status status = transition(c, window->t0 + (dse_real)k);
        if (status != DSE_OK)
            return status;
        add_outputs(c, Phi, M);
        dse_mat_mul(n, n, n, c->A, Phi, c->product);
        for (int i = 0; i < n * n; i++)
            Phi[i] = c->product[i];
    }
    return dse_all_finite(M, n * n) ? DSE_OK : DSE_ENONFINITE;
}

enum dse_status dse_observability_gramian(const struct dse_window *window, int ny,
                                          const dse_real *C, dse_real *M, dse_real *scratch)
{
    if (!good(window) || ny < 0 || (ny > 0 && C == NULL))
        return DSE_EINVAL;
    const int n = window->model->nx;
    dse_real *state = scratch, *rest = scratch + 2 * n * n; /* [Phi; M] */
    struct context c = prepare(window, ny, rest + DSE_RK4_SCRATCH(2 * n * n));
    c.C = C;
    dse_mat_identity(n, state);
    for (int k = 0; k < n * n; k++)
        state[n * n + k] = 0;
    const enum dse_status status =
        window->model->time == DSE_DISCRETE
            ? sum_outputs(window, &c, state, state + n * n)
            : integrate(window, observability_rate, &c, 2 * n * n, state, rest);
    for (int k = 0; status == DSE_OK && k < n * n; k++)
        M[k] = state[n * n + k];
    return status;
}

/* Discrete: W(k+1) = A(k) W A(k)' + G. */
static enum dse_status sum_noise(const struct dse_window *window, struct context *c, dse_real *W)
{
    const int n = c->model->nx;
    for (int k = 0; k < window->steps; k++) {
        const enum dse_status status = transition(c, window->t0 + (dse_real)k);
        if (status != DSE_OK)
            return status;
        dse_sym_congruence(n, n, c->A, W, c->G, W, c->product);
    }
    return dse_all_finite(W, n * n) ? DSE_OK : DSE_ENONFINITE;
}

enum dse_status dse_controllability_gramian(const struct dse_window *window, const dse_real *G,
                                            dse_real *W, dse_real *scratch)
{
    if (!good(window) || G == NULL)
        return DSE_EINVAL;
    const int n = window->model->nx;
    dse_real *state = scratch, *rest = scratch + 2 * n * n;
    struct context c = prepare(window, 0, rest + DSE_RK4_SCRATCH(2 * n * n));
    c.G = G;
    for (int k = 0; k < n * n; k++)
        state[k] = 0;
    const enum dse_status status =
        window->model->time == DSE_DISCRETE
            ? sum_noise(window, &c, state)
            : integrate(window, controllability_rate, &c, n * n, state, rest);
    for (int k = 0; status == DSE_OK && k < n * n; k++)
        W[k] = state[k];
    return status;
}

dse_real dse_gramian_quality(int n, const dse_real *M, dse_real *scratch)
{
    dse_real *L = scratch, *inverse = scratch + n * n;
    if (dse_cholesky(n, M, L) != DSE_OK)
        return 0;
    dse_mat_identity(n, inverse);
    dse_cholesky_solve(n, L, n, inverse);
    const dse_real condition = dse_norm2(n * n, M) * dse_norm2(n * n, inverse);
    return dse_is_finite(condition) && condition * DSE_REAL_EPSILON < 1 ? 1 / condition : 0;
}
