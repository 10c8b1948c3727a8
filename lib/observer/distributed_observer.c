/* A node of a distributed observer: samples, messages, answers. */
#include "distributed_observer_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"
#include "dse/ode.h"

/* ---- the step over one period ---- */

struct period {
    const struct dse_distributed_observer *observer;
    dse_real t0, h;
    const dse_real *u_next;
    struct dse_observer_view view; /* at a stage */
};

/* y and u at the stage's time: linear between the samples, u as u_held says. */
static void interpolate(const struct period *p, dse_real t)
{
    const struct dse_distributed_observer *o = p->observer;
    const struct dse_distributed_observer_config *c = o->config;
    const dse_real share = (t - p->t0) / p->h;
    for (int i = 0; i < c->ny; i++)
        o->y_stage[i] = o->y[i] + share * (o->y_next[i] - o->y[i]);
    for (int i = 0; i < c->nu; i++) {
        const bool held = c->u_held != NULL && c->u_held[i];
        o->u_stage[i] = held ? o->u[i] : o->u[i] + share * (p->u_next[i] - o->u[i]);
    }
}

static enum dse_status rhs(void *context, dse_real t, const dse_real *state, dse_real *derivative)
{
    const struct period *p = context;
    interpolate(p, t);
    dse_observer_evaluate(p->observer, &p->view, state, derivative);
    return DSE_OK;
}

/* `next` = state at the end of the period. */
static enum dse_status step(const struct dse_distributed_observer *o, dse_real h,
                            const dse_real *u_next, bool alone)
{
    const struct dse_distributed_observer_config *c = o->config;
    const int n = c->nz + o->n_gain;
    struct period p = {o, o->t, h, u_next, {o->y_stage, o->u_stage, o->messages, o->age, alone}};
    if (c->time == DSE_DISCRETE) { /* z(k+1) = Lambda z + L y(k) + H u(k) */
        p.view.y = o->y;
        p.view.u = o->u;
        dse_observer_evaluate(o, &p.view, o->state, o->next);
        return dse_all_finite(o->next, n) ? DSE_OK : DSE_ENONFINITE;
    }
    for (int i = 0; i < n; i++)
        o->next[i] = o->state[i];
    return dse_rk4_step(rhs, &p, o->t, h, n, o->next, o->scratch);
}

/* Gamma <- Gamma min(1, gain_max / |Gamma|): towards 0, so that the Lyapunov function, in which
 * |Gamma|^2 is a term, only gets smaller. */
static void bound_gains(const struct dse_distributed_observer *o)
{
    const struct dse_distributed_observer_config *c = o->config;
    const int blocks = c->gain == DSE_OBSERVER_NODE && c->neighbours > 0 ? 1 : c->neighbours;
    dse_real *Gamma = o->next + c->nz;
    for (int j = 0; j < blocks && c->gain_max > 0; j++) {
        const int size = dse_observer_gain_rows(c, j) * dse_observer_columns(c, j);
        const dse_real norm = dse_norm2(size, Gamma);
        for (int i = 0; i < size && norm > c->gain_max; i++)
            Gamma[i] *= c->gain_max / norm;
        Gamma += size;
    }
}

/* A period has gone by: every message is one older. */
static void grow_old(struct dse_distributed_observer *o)
{
    for (int j = 0; j < o->config->neighbours; j++) {
        if (o->age[j] < 0 || o->age[j] > o->hold)
            continue;
        o->age[j]++;
        if (o->age[j] > o->hold)
            o->dropped++;
    }
}

/* ---- samples ---- */

/* y_next from the measurement, the last value where a channel is missing. True: none is. */
static bool take_measurement(const struct dse_distributed_observer *o,
                             const struct dse_measurement *measurement)
{
    bool complete = true;
    for (int i = 0; i < o->config->ny; i++) {
        const bool has = dse_measurement_has(measurement, i);
        o->y_next[i] = has ? measurement->y[i] : o->y[i];
        complete = complete && has;
    }
    return complete;
}

/* After a step that failed: whatever the gains had become, they start from 0 again. */
static void forget_gains(const struct dse_distributed_observer *o)
{
    for (int i = 0; i < o->n_gain; i++)
        o->state[o->config->nz + i] = 0;
}

/* No neighbour's message acts in the period that comes. */
static bool deserted(const struct dse_distributed_observer *o)
{
    for (int j = 0; j < o->config->neighbours; j++)
        if (dse_observer_hearing_of(o, o->age[j]) != DSE_OBSERVER_DROPPED)
            return false;
    return o->config->neighbours > 0;
}

/* The sample becomes the last one. */
static void keep(struct dse_distributed_observer *o, dse_real t, const dse_real *u, bool complete)
{
    const struct dse_distributed_observer_config *c = o->config;
    for (int i = 0; i < c->ny; i++)
        o->y[i] = o->y_next[i];
    for (int i = 0; i < c->nu; i++)
        o->u[i] = u[i];
    for (int i = 0; i < c->nx; i++)
        o->xh[i] = o->xh_stage[i];
    o->t = t;
    o->complete = complete;
    o->health = complete ? DSE_HEALTH_TRACKING : DSE_HEALTH_COASTING;
}

/* Before the start: collects the channels until each has been seen. */
static enum dse_status begin(struct dse_distributed_observer *o, dse_real t, const dse_real *u,
                             const struct dse_measurement *measurement)
{
    const struct dse_distributed_observer_config *c = o->config;
    const bool complete = take_measurement(o, measurement);
    bool all = true;
    for (int i = 0; i < c->ny; i++) {
        o->seen[i] = o->seen[i] || dse_measurement_has(measurement, i);
        o->y[i] = o->y_next[i];
        all = all && o->seen[i];
    }
    grow_old(o);
    if (!all)
        return DSE_OK;
    dse_distributed_observer_output(o, o->state, o->y_next, u, o->xh_stage);
    if (!dse_all_finite(o->xh_stage, c->nx))
        return DSE_ENONFINITE;
    o->started = true;
    keep(o, t, u, complete);
    return DSE_OK;
}

enum dse_status dse_distributed_observer_sample(struct dse_distributed_observer *observer,
                                                dse_real t, const dse_real *u,
                                                const struct dse_measurement *measurement)
{
    const struct dse_distributed_observer_config *c = observer->config;
    if (!dse_is_finite(t) || (c->nu > 0 && !dse_all_finite(u, c->nu)))
        return DSE_ENONFINITE;
    if (!observer->started)
        return begin(observer, t, u, measurement);
    if (!(t > observer->t))
        return DSE_EINVAL;
    const bool complete = take_measurement(observer, measurement);
    const bool failed = observer->health == DSE_HEALTH_DIVERGED;
    const bool left = failed || deserted(observer);
    const bool alone = failed || !(observer->complete && complete);
    if (failed)
        forget_gains(observer);
    enum dse_status status = step(observer, t - observer->t, u, alone);
    grow_old(observer);
    if (status == DSE_OK) {
        bound_gains(observer);
        dse_distributed_observer_output(observer, observer->next, observer->y_next, u,
                                        observer->xh_stage);
        status = dse_all_finite(observer->xh_stage, c->nx) ? DSE_OK : DSE_ENONFINITE;
    }
    if (status != DSE_OK) {
        observer->health = DSE_HEALTH_DIVERGED;
        return status;
    }
    for (int i = 0; i < c->nz + observer->n_gain; i++)
        observer->state[i] = observer->next[i];
    keep(observer, t, u, complete);
    if (complete && left)
        observer->health = DSE_HEALTH_ALONE;
    return DSE_OK;
}

/* ---- messages ---- */

/* Whether neighbour j's numbers may be used. */
static enum dse_status admit(struct dse_distributed_observer *o, int j, int count,
                             const dse_real *value)
{
    if (j < 0 || j >= o->config->neighbours)
        return DSE_EINVAL;
    if (dse_all_finite(value, count))
        return DSE_OK;
    o->refused++;
    return DSE_ENONFINITE;
}

/* Neighbour j has been heard; one that comes back starts with Gamma_ij = 0. */
static void heard(struct dse_distributed_observer *o, int j)
{
    const struct dse_distributed_observer_config *c = o->config;
    if (o->age[j] > o->hold && c->gain == DSE_OBSERVER_EDGE) {
        dse_real *Gamma = o->state + c->nz + o->first_gain[j];
        for (int i = 0; i < dse_observer_gain_rows(c, j) * dse_observer_columns(c, j); i++)
            Gamma[i] = 0;
    }
    o->age[j] = 0;
}

enum dse_status dse_distributed_observer_receive(struct dse_distributed_observer *observer, int j,
                                                 const dse_real *estimate)
{
    const struct dse_distributed_observer_config *c = observer->config;
    const enum dse_status status = admit(observer, j, c->nx, estimate);
    if (status != DSE_OK)
        return status;
    const struct dse_observer_rows *compared = dse_observer_compared(c, j);
    if (compared->C2 == NULL)
        return dse_distributed_observer_receive_rows(observer, j, estimate);
    dse_mat_vec(compared->rows, c->nx, compared->C2, estimate, observer->difference);
    return dse_distributed_observer_receive_rows(observer, j, observer->difference);
}

enum dse_status dse_distributed_observer_receive_rows(struct dse_distributed_observer *observer,
                                                      int j, const dse_real *rows)
{
    const struct dse_distributed_observer_config *c = observer->config;
    const int k = j >= 0 && j < c->neighbours ? dse_observer_columns(c, j) : 0;
    const enum dse_status status = admit(observer, j, k, rows);
    if (status != DSE_OK)
        return status;
    dse_real *message = observer->messages + observer->first_row[j];
    for (int i = 0; i < k; i++)
        message[i] = rows[i];
    heard(observer, j);
    return DSE_OK;
}

/* ---- answers ---- */

bool dse_distributed_observer_may_speak(const struct dse_distributed_observer *observer)
{
    return observer->started && observer->complete && observer->health != DSE_HEALTH_DIVERGED;
}

const dse_real *dse_distributed_observer_estimate(const struct dse_distributed_observer *observer)
{
    return observer->xh;
}

const dse_real *dse_distributed_observer_z(const struct dse_distributed_observer *observer)
{
    return observer->state;
}

const dse_real *dse_distributed_observer_gains(const struct dse_distributed_observer *observer)
{
    return observer->state + observer->config->nz;
}

enum dse_health dse_distributed_observer_health(const struct dse_distributed_observer *observer)
{
    return observer->health;
}

enum dse_observer_hearing
dse_distributed_observer_hearing(const struct dse_distributed_observer *observer, int j)
{
    return dse_observer_hearing_of(observer, observer->age[j]);
}
