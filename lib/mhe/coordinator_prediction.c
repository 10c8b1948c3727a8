/* Coordinator of moving horizon estimators, prediction-driven: Algorithm 2. */
#include "coordinator_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"

#define FIRST_ROUNDS 3
#define APART        1000 /* times the change of the first rounds, */
#define APART_AT_END 10   /* and after the last one */

/* ---- where a sample starts ---- */

/* x_i of the next sample by the whole A from x_l at time t of a stack packed by `length`. */
static void predict(const struct dse_mhe_coordinator *c, const dse_real *X, int length, int t,
                    int i, dse_real *next)
{
    const int nx = coordinator_nx(c, i);
    for (int a = 0; a < nx; a++)
        next[a] = 0;
    for (int l = 0; l < c->parts; l++) {
        const int nl = coordinator_nx(c, l);
        const dse_real *x = X + length * c->first[l] + t * nl;
        const dse_real *block = coordinator_block(c, i, l);
        for (int a = 0; a < nx; a++)
            next[a] += dse_dot(nl, block + a * c->n, x);
    }
}

/* The plant's open-loop prediction from x0, without disturbances. */
static void start_open_loop(struct dse_mhe_coordinator *c)
{
    const int H = c->length;
    for (int e = 0; e < (H - 1) * c->n; e++)
        c->other[e] = 0;
    for (int i = 0; i < c->parts; i++) {
        const dse_real *x0 = c->config->subsystems[i].x0;
        dse_real *x = coordinator_states(c, c->X, i);
        for (int a = 0; a < coordinator_nx(c, i); a++)
            x[a] = x0 ? x0[a] : 0;
    }
    for (int t = 1; t < H; t++)
        for (int i = 0; i < c->parts; i++)
            predict(c, c->X, H, t - 1, i,
                    coordinator_states(c, c->X, i) + t * coordinator_nx(c, i));
}

/* The window has grown from `before` samples: x(newest) = A x(before), w = 0. */
static void grow(struct dse_mhe_coordinator *c, int before)
{
    const int H = c->length;
    for (int e = 0; e < before * c->n; e++)
        c->work[e] = c->X[e];
    for (int i = c->parts - 1; i >= 0; i--) { /* from the end on: the blocks move back */
        const int nx = coordinator_nx(c, i), start = c->first[i];
        for (int e = before * nx - 1; e >= 0; e--)
            c->X[H * start + e] = c->work[before * start + e];
        for (int e = (H - 1) * nx - 1; e >= 0; e--)
            c->other[(H - 1) * start + e] =
                e < (before - 1) * nx ? c->other[(before - 1) * start + e] : 0;
    }
    for (int t = before; t < H; t++) {
        for (int i = 0; i < c->parts; i++) {
            const int nx = coordinator_nx(c, i);
            dse_real *x = coordinator_states(c, c->X, i) + t * nx;
            if (coordinator_has(c, i, MHE_DATA))
                predict(c, c->X, H, t - 1, i, x);
            for (int a = 0; a < nx && !coordinator_has(c, i, MHE_DATA); a++)
                x[a] = 0;
        }
    }
}

/* The oldest sample leaves, x(newest) = A x(newest - 1), w = 0; not for what is merely held. */
static void shift(struct dse_mhe_coordinator *c)
{
    const int H = c->length;
    for (int e = 0; e < H * c->n; e++)
        c->work[e] = c->X[e];
    for (int i = 0; i < c->parts; i++) {
        const int nx = coordinator_nx(c, i);
        dse_real *x = coordinator_states(c, c->X, i), *w = coordinator_transitions(c, c->other, i);
        if (!coordinator_has(c, i, MHE_DATA) || c->age[i] > 1)
            continue;
        for (int e = 0; e < (H - 1) * nx; e++) {
            x[e] = x[e + nx];
            w[e] = e < (H - 2) * nx ? w[e + nx] : 0;
        }
        predict(c, c->work, H, H - 1, i, x + (H - 1) * nx);
        c->state[i] &= ~MHE_SYNC;
    }
}

static void clear_sync(struct dse_mhe_coordinator *c)
{
    for (int i = 0; i < c->parts; i++)
        c->state[i] &= ~MHE_SYNC;
}

void coordinator_warm_start(struct dse_mhe_coordinator *c, bool first)
{
    if (first) {
        clear_sync(c);
        /* A coordinator that starts in the middle of a run knows nothing: zero. */
        if (c->newest < c->N)
            start_open_loop(c);
    } else if (c->length > c->last_length) {
        clear_sync(c);
        grow(c, c->last_length);
    } else if (c->config->shift) {
        shift(c);
    }
    for (int e = 0; e < c->length * c->n; e++)
        c->asked[e] = c->X[e];
    for (int e = 0; e < (c->length - 1) * c->n; e++)
        c->p[e] = c->other[e];
}

/* ---- rounds ---- */

/* d = |X^(s) - X^(s-1)|. */
static dse_real change(const struct dse_mhe_coordinator *c)
{
    dse_real sum = 0;
    for (int e = 0; e < c->length * c->n; e++) {
        const dse_real d = c->X[e] - c->asked[e];
        sum += d * d;
    }
    return dse_sqrt(sum);
}

/* p = Q^-1 G_A X in place of the agents' multipliers. */
static void price_consistently(struct dse_mhe_coordinator *c)
{
    for (int i = 0; i < c->parts; i++) {
        const struct dse_mhe_subsystem *s = &c->config->subsystems[i];
        dse_real *p = coordinator_transitions(c, c->p, i), *x = coordinator_states(c, c->X, i);
        dse_real *L = c->work + s->nx * (c->length - 1);
        if (dse_cholesky(s->nx, s->Q, L) != DSE_OK)
            continue; /* the agent has refused that Q */
        coordinator_interaction(c, c->X, i, c->work);
        mhe_differences(s, c->length, x, p);
        dse_axpy((c->length - 1) * s->nx, -1, c->work, p);
        for (int t = 0; t < c->length - 1; t++)
            dse_cholesky_solve(s->nx, L, 1, p + t * s->nx);
    }
}

/* Rounds that move apart: far beyond the changes of the first ones, or beyond them and at the end.
 */
static bool moves_apart(struct dse_mhe_coordinator *c)
{
    if (c->round <= FIRST_ROUNDS) {
        c->first_error = dse_max(c->first_error, dse_max(c->error, c->config->eps));
        return false;
    }
    const dse_real limit = c->round < c->max_iter ? APART : APART_AT_END;
    return !(c->error <= limit * c->first_error);
}

/* Nothing of this sample is fit to start the next one: it starts without interaction. */
static void forget(struct dse_mhe_coordinator *c)
{
    for (int e = 0; e < c->length * c->n; e++)
        c->X[e] = 0;
    for (int e = 0; e < (c->length - 1) * c->n; e++)
        c->other[e] = 0;
    c->anderson.count = 0;
    clear_sync(c);
}

/* z <- z + beta (f - z). */
static void move(int count, dse_real beta, const dse_real *f, dse_real *z)
{
    for (int e = 0; e < count; e++)
        z[e] = beta == 1 ? f[e] : z[e] + beta * (f[e] - z[e]);
}

static void copy(int count, const dse_real *from, dse_real *to)
{
    for (int e = 0; e < count; e++)
        to[e] = from[e];
}

/* The question that these answers belong to can be come back to. */
static void remember(struct dse_mhe_coordinator *c)
{
    const int states = c->length * c->n, transitions = (c->length - 1) * c->n;
    copy(states, c->asked, c->question);
    copy(transitions, c->p, c->question + states);
    copy(states, c->X, c->answer);
    copy(transitions, c->other, c->answer + states);
    c->has_answer = true;
    c->relaxed = 1;
}

/* An interaction that no window within the bounds fits: from the last question part of the way to
 * its plain answer, half as far each time. */
static void go_back(struct dse_mhe_coordinator *c)
{
    const int states = c->length * c->n, transitions = (c->length - 1) * c->n;
    c->anderson.count = 0;
    if (!c->has_answer) { /* without interaction: each agent's own problem */
        for (int e = 0; e < states; e++)
            c->asked[e] = 0;
        for (int e = 0; e < transitions; e++)
            c->p[e] = 0;
        return;
    }
    if (c->config->anderson == 0)
        c->relaxed /= 2;
    copy(states, c->question, c->asked);
    copy(transitions, c->question + states, c->p);
    move(states, c->relaxed, c->answer, c->asked);
    move(transitions, c->relaxed, c->answer + states, c->p);
    copy(states, c->answer, c->X);
    copy(transitions, c->answer + states, c->other);
    if (c->config->anderson > 0)
        c->relaxed /= 2;
    clear_sync(c);
}

static int count_failures(const struct dse_mhe_coordinator *c, int what)
{
    int count = 0;
    for (int i = 0; i < c->parts; i++)
        count += coordinator_has(c, i, MHE_ANSWERED | what);
    return count;
}

enum dse_mhe_outcome coordinator_advance_prediction(struct dse_mhe_coordinator *c)
{
    if (count_failures(c, MHE_SINGULAR) > 0 &&
        count_failures(c, MHE_SINGULAR) == count_failures(c, 0))
        return DSE_MHE_OUTCOME_SINGULAR;
    if (c->bounded && count_failures(c, MHE_INFEASIBLE) > 0) {
        c->accepted = false;
        go_back(c);
        return DSE_MHE_CONTINUE;
    }
    if (count_failures(c, MHE_INFEASIBLE) > 0) { /* without bounds: not finite */
        forget(c);
        return DSE_MHE_OUTCOME_DIVERGED;
    }
    c->accepted = true;
    c->error = change(c);
    if (c->error < c->config->eps && !c->config->fixed_iterations &&
        (c->config->stop_on_any || coordinator_is_complete(c)))
        return DSE_MHE_OUTCOME_CONVERGED;
    if (moves_apart(c)) {
        forget(c);
        return DSE_MHE_OUTCOME_DIVERGED;
    }
    if (c->bounded)
        remember(c);
    if (c->config->anderson > 0) {
        coordinator_accelerate(c);
        return DSE_MHE_CONTINUE;
    }
    const dse_real beta = c->config->relaxation > 0 ? c->config->relaxation : 1;
    move(c->length * c->n, beta, c->X, c->asked);
    if (c->config->consistent_certificate > 0)
        price_consistently(c);
    else
        move((c->length - 1) * c->n, beta, c->other, c->p);
    return DSE_MHE_CONTINUE;
}
