/* The whole network as one system of differential equations. */
#include "observer_rig.h"

#include <stddef.h>

#include "dse/linalg.h"
#include "dse/math.h"
#include "dse/ode.h"

/* ---- plants ---- */

static void uio_input(dse_real t, dse_real t0, dse_real *u)
{
    /* a step time that is a sum of steps lies within rounding of the jump */
    const dse_real begin = t0 + DSE_REAL(1e-4);
    u[0] = dse_cos(2 * t);
    u[1] = (begin > 2 ? DSE_REAL(5.0) : 0) - (begin > 5 ? DSE_REAL(3.0) : 0);
}

static void uio_state(const dse_real *xd, const dse_real *u, dse_real *x)
{
    for (int i = 0; i < 3; i++)
        x[i] = xd[i];
    x[3] = -u[0];
}

static void uio_derivative(dse_real t, const dse_real *x, const dse_real *u, dse_real *dxd)
{
    dxd[0] = -x[0] + x[1] + u[0] - 5 * dse_sin(t);
    dxd[1] = -x[0] + x[3] + u[1];
    dxd[2] = -x[1] - x[2];
}

const struct rig_plant rig_descriptor_uio = {4, 3, uio_input, uio_state, uio_derivative};

static void fo_input(dse_real t, dse_real t0, dse_real *u)
{
    (void)t0;
    u[0] = -dse_sin(t);
    u[1] = dse_cos(t);
}

static void fo_state(const dse_real *xd, const dse_real *u, dse_real *x)
{
    x[0] = xd[0];
    x[1] = xd[1];
    x[2] = xd[1];
    x[3] = -xd[0] - u[0] - u[1];
}

static void fo_derivative(dse_real t, const dse_real *x, const dse_real *u, dse_real *dxd)
{
    (void)t;
    dxd[0] = DSE_REAL(-0.25) * x[1] - u[0];
    dxd[1] = x[0] - x[1] + u[0];
}

const struct rig_plant rig_descriptor_fo = {4, 2, fo_input, fo_state, fo_derivative};

static void full_uio_input(dse_real t, dse_real t0, dse_real *u)
{
    (void)t0;
    u[0] = dse_cos(2 * t);
    u[1] = 1;
}

static void same_state(const dse_real *xd, const dse_real *u, dse_real *x)
{
    (void)u;
    for (int i = 0; i < 3; i++)
        x[i] = xd[i];
}

static void full_uio_derivative(dse_real t, const dse_real *x, const dse_real *u, dse_real *dxd)
{
    dxd[0] = -x[0] + x[1] + u[0] - 5 * dse_sin(t);
    dxd[1] = -x[0] + u[1];
    dxd[2] = -x[1] - x[2];
}

const struct rig_plant rig_full_order_uio = {3, 3, full_uio_input, same_state, full_uio_derivative};

static void full_fo_input(dse_real t, dse_real t0, dse_real *u)
{
    (void)t0;
    u[0] = dse_sin(t);
    u[1] = dse_cos(t);
}

static void four_states(const dse_real *xd, const dse_real *u, dse_real *x)
{
    (void)u;
    for (int i = 0; i < 4; i++)
        x[i] = xd[i];
}

static void full_fo_derivative(dse_real t, const dse_real *x, const dse_real *u, dse_real *dxd)
{
    (void)t;
    dxd[0] = -x[0] + x[1] + u[0];
    dxd[1] = -x[0] + x[3] + u[1];
    dxd[2] = -x[1] - x[2];
    dxd[3] = DSE_REAL(0.5) * x[0] - 2 * x[3] + u[0];
}

const struct rig_plant rig_full_order_fo = {4, 4, full_fo_input, four_states, full_fo_derivative};

/* ---- the network ---- */

void rig_connect(struct rig *rig, int edges, const int (*edge)[2], const dse_real *const *C2,
                 const int *rows)
{
    for (int to = 0; to < rig->n; to++) {
        int count = 0;
        for (int from = 0; from < rig->n; from++)
            for (int e = 0; e < edges; e++)
                if (edge[e][0] == from && edge[e][1] == to) {
                    const struct dse_observer_rows one = {rows[from], C2[from]};
                    rig->neighbour[to][count] = from;
                    rig->theirs[to][count++] = one;
                }
        rig->config[to].neighbours = count;
        rig->config[to].theirs = rig->theirs[to];
        rig->config[to].own = (struct dse_observer_rows){rows[to], C2[to]};
    }
}

enum dse_status rig_start(struct rig *rig, const dse_real *xd0)
{
    for (int i = 0; i < rig->plant->nd; i++)
        rig->state[i] = xd0[i];
    rig->t = rig->t0 = 0;
    for (int i = 0; i < rig->n; i++) {
        struct dse_arena arena;
        dse_arena_init(&arena, rig->memory[i], RIG_STORAGE);
        const enum dse_status status =
            dse_distributed_observer_init(&rig->node[i], &rig->config[i], &arena);
        if (status != DSE_OK)
            return status;
        dse_real *state = rig_node(rig, i);
        for (int j = 0; j < rig->config[i].nz + rig->node[i].n_gain; j++)
            state[j] = rig->node[i].state[j];
    }
    return DSE_OK;
}

static int offset(const struct rig *rig, int i)
{
    int at = rig->plant->nd;
    for (int k = 0; k < i; k++)
        at += rig->config[k].nz + rig->node[k].n_gain;
    return at;
}

dse_real *rig_node(struct rig *rig, int i)
{
    return rig->state + offset(rig, i);
}

/* Everything that follows from a state of the whole. */
struct view {
    dse_real u[RIG_OUTPUTS], x[RIG_STATES], y[RIG_NODES][RIG_OUTPUTS], xh[RIG_NODES][RIG_STATES];
};

static void look(const struct rig *rig, dse_real t, const dse_real *state, struct view *view)
{
    rig->plant->input(t, rig->t0, view->u);
    rig->plant->state(state, view->u, view->x);
    for (int i = 0; i < rig->n; i++) {
        dse_mat_vec(RIG_OUTPUTS, rig->plant->nx, rig->C[i], view->x, view->y[i]);
        dse_distributed_observer_output(&rig->node[i], state + offset(rig, i), view->y[i], view->u,
                                        view->xh[i]);
    }
}

/* What node i hears: the compared rows of its neighbours' estimates. */
static void listen(const struct rig *rig, int i, const struct view *view, dse_real *messages)
{
    const struct dse_distributed_observer_config *c = &rig->config[i];
    for (int j = 0; j < c->neighbours; j++) {
        const struct dse_observer_rows *rows =
            c->residual == DSE_OBSERVER_OWN ? &c->own : &c->theirs[j];
        const dse_real *xh = view->xh[rig->neighbour[i][j]];
        const int k = rows->C2 != NULL ? rows->rows : c->nx;
        if (rows->C2 != NULL)
            dse_mat_vec(k, c->nx, rows->C2, xh, messages);
        for (int l = 0; l < k && rows->C2 == NULL; l++)
            messages[l] = xh[l];
        messages += k;
    }
}

static enum dse_status derivative(void *context, dse_real t, const dse_real *state,
                                  dse_real *dstate)
{
    const struct rig *rig = context;
    struct view view;
    look(rig, t, state, &view);
    rig->plant->derivative(t, view.x, view.u, dstate);
    for (int i = 0; i < rig->n; i++) {
        dse_real messages[RIG_DEGREE * RIG_ROWS];
        const int at = offset(rig, i);
        listen(rig, i, &view, messages);
        dse_distributed_observer_rhs(&rig->node[i], state + at, view.y[i], view.u, messages,
                                     dstate + at);
    }
    return DSE_OK;
}

enum dse_status rig_step(struct rig *rig, dse_real h)
{
    static dse_real scratch[DSE_RK4_SCRATCH(sizeof rig->state / sizeof rig->state[0])];
    rig->t0 = rig->t;
    const enum dse_status status =
        dse_rk4_step(derivative, rig, rig->t, h, offset(rig, rig->n), rig->state, scratch);
    rig->t += h;
    rig->t0 = rig->t;
    return status;
}

void rig_truth(struct rig *rig, dse_real *x, dse_real *u)
{
    rig->plant->input(rig->t, rig->t0, u);
    rig->plant->state(rig->state, u, x);
}

void rig_measure(struct rig *rig, int i, dse_real *y)
{
    dse_real x[RIG_STATES], u[RIG_OUTPUTS];
    rig_truth(rig, x, u);
    dse_mat_vec(RIG_OUTPUTS, rig->plant->nx, rig->C[i], x, y);
}

void rig_estimate(struct rig *rig, int i, dse_real *xh)
{
    dse_real x[RIG_STATES], u[RIG_OUTPUTS], y[RIG_OUTPUTS];
    rig_truth(rig, x, u);
    rig_measure(rig, i, y);
    dse_distributed_observer_output(&rig->node[i], rig_node(rig, i), y, u, xh);
}
