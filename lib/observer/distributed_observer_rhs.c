/* The equations of a distributed observer: estimate, coupling and adaptation. */
#include "distributed_observer_internal.h"
#include "dse/linalg.h"

/* y (m) += A (m x n) x; A = NULL is zero. */
static void add_product(int m, int n, const dse_real *A, const dse_real *x, dse_real *y)
{
    for (int i = 0; A != NULL && i < m; i++)
        y[i] += dse_dot(n, A + i * n, x);
}

/* y (m) += A x with A = NULL for the identity. */
static void add_mapped(int m, int n, const dse_real *A, const dse_real *x, dse_real *y)
{
    if (A != NULL)
        add_product(m, n, A, x, y);
    else
        dse_axpy(n, 1, x, y);
}

/* A += a v w'. */
static void add_outer(int m, int n, dse_real a, const dse_real *v, const dse_real *w, dse_real *A)
{
    for (int i = 0; i < m; i++)
        dse_axpy(n, a * v[i], w, A + i * n);
}

static void set_zero(int n, dse_real *x)
{
    for (int i = 0; i < n; i++)
        x[i] = 0;
}

void dse_distributed_observer_output(const struct dse_distributed_observer *observer,
                                     const dse_real *z, const dse_real *y, const dse_real *u,
                                     dse_real *xh)
{
    const struct dse_distributed_observer_config *c = observer->config;
    set_zero(c->nx, xh);
    add_mapped(c->nx, c->nz, c->M, z, xh);
    add_product(c->nx, c->ny, c->N, y, xh);
    add_product(c->nx, c->nu, c->J, u, xh);
}

/* d_ij = m_j - C2 xh_i */
static void difference(const struct dse_distributed_observer_config *c, int j,
                       const dse_real *message, const dse_real *xh, dse_real *d)
{
    const int k = dse_observer_columns(c, j);
    set_zero(k, d);
    add_mapped(k, c->nx, dse_observer_compared(c, j)->C2, xh, d);
    for (int i = 0; i < k; i++)
        d[i] = message[i] - d[i];
}

/* sum += C2_j' Gamma_ij d_ij, or Gamma_ij d_ij when the residual is the node's own. */
static void couple(const struct dse_distributed_observer *observer, int j, const dse_real *Gamma,
                   const dse_real *d)
{
    const struct dse_distributed_observer_config *c = observer->config;
    const int q = dse_observer_gain_rows(c, j), k = dse_observer_columns(c, j);
    if (c->residual == DSE_OBSERVER_OWN) {
        add_product(q, k, Gamma, d, observer->sum);
        return;
    }
    const dse_real *C2 = dse_observer_compared(c, j)->C2;
    for (int i = 0; i < k; i++) {
        const dse_real pull = dse_dot(k, Gamma + i * k, d);
        if (C2 != NULL)
            dse_axpy(c->nx, pull, C2 + i * c->nx, observer->sum);
        else
            observer->sum[i] += pull;
    }
}

/* r = D z + D_y y + D_u u */
static void own_residual(const struct dse_distributed_observer *observer,
                         const struct dse_observer_view *view, const dse_real *z)
{
    const struct dse_distributed_observer_config *c = observer->config;
    set_zero(c->nr, observer->residual);
    add_product(c->nr, c->nz, c->D, z, observer->residual);
    add_product(c->nr, c->ny, c->D_y, view->y, observer->residual);
    add_product(c->nr, c->nu, c->D_u, view->u, observer->residual);
}

/* Gamma' = -gamma r d' with the own residual, gamma d d' with the neighbour's. */
static void adapt(const struct dse_distributed_observer *observer, int j, const dse_real *d,
                  dse_real *dGamma)
{
    const struct dse_distributed_observer_config *c = observer->config;
    const int q = dse_observer_gain_rows(c, j), k = dse_observer_columns(c, j);
    if (c->residual == DSE_OBSERVER_OWN)
        add_outer(q, k, -c->gamma, observer->residual, d, dGamma);
    else
        dse_sym_rank1(k, c->gamma, d, dGamma);
}

/* What the neighbours do to z' and Gamma'. */
static void interact(const struct dse_distributed_observer *observer,
                     const struct dse_observer_view *view, const dse_real *state,
                     dse_real *derivative)
{
    const struct dse_distributed_observer_config *c = observer->config;
    const dse_real *Gamma = state + c->nz, *message = view->messages;
    dse_real *dGamma = derivative + c->nz;
    bool leaks = false;

    dse_distributed_observer_output(observer, state, view->y, view->u, observer->xh_stage);
    if (c->residual == DSE_OBSERVER_OWN)
        own_residual(observer, view, state);
    set_zero(observer->n_inject, observer->sum);
    for (int j = 0; j < c->neighbours; j++) {
        const int k = dse_observer_columns(c, j), size = dse_observer_gain_rows(c, j) * k;
        const enum dse_observer_hearing hearing =
            dse_observer_hearing_of(observer, view->age != NULL ? view->age[j] : 0);
        if (hearing != DSE_OBSERVER_DROPPED) {
            difference(c, j, message, observer->xh_stage, observer->difference);
            couple(observer, j, Gamma, observer->difference);
        }
        if (hearing == DSE_OBSERVER_FRESH) {
            adapt(observer, j, observer->difference, dGamma);
            if (c->gain == DSE_OBSERVER_EDGE || !leaks)
                dse_axpy(size, -c->leak, Gamma, dGamma); /* - leak Gamma */
            leaks = true;
        }
        message += k;
        if (c->gain == DSE_OBSERVER_EDGE) {
            Gamma += size;
            dGamma += size;
        }
    }
    /* z' += Pi^-1 M' sum_j C2_j' Gamma_ij d_ij, or Pi^-1 D' sum_j Gamma_ij d_ij */
    add_product(c->nz, observer->n_inject, observer->injection, observer->sum, derivative);
}

void dse_observer_evaluate(const struct dse_distributed_observer *observer,
                           const struct dse_observer_view *view, const dse_real *state,
                           dse_real *derivative)
{
    const struct dse_distributed_observer_config *c = observer->config;
    /* z' = Lambda z + L y + H u */
    set_zero(c->nz + observer->n_gain, derivative);
    add_product(c->nz, c->nz, c->Lambda, state, derivative);
    add_product(c->nz, c->ny, c->L, view->y, derivative);
    add_product(c->nz, c->nu, c->H, view->u, derivative);
    if (!view->alone && observer->n_gain > 0)
        interact(observer, view, state, derivative);
}

void dse_distributed_observer_rhs(const struct dse_distributed_observer *observer,
                                  const dse_real *state, const dse_real *y, const dse_real *u,
                                  const dse_real *messages, dse_real *derivative)
{
    const struct dse_observer_view view = {.y = y, .u = u, .messages = messages};
    dse_observer_evaluate(observer, &view, state, derivative);
}
