/* Coordinator of moving horizon estimators: messages, and the end of a round. */
#include "coordinator_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"

/* ---- down ---- */

static int flags_for(const struct dse_mhe_coordinator *c, int i)
{
    const bool stop = c->outcome != DSE_MHE_CONTINUE;
    int flags = stop ? MHE_STOP : 0;
    flags |= c->outcome == DSE_MHE_OUTCOME_CONVERGED ? MHE_STOP_CONVERGED : 0;
    flags |= c->outcome == DSE_MHE_OUTCOME_SINGULAR ? MHE_STOP_SINGULAR : 0;
    flags |= c->outcome == DSE_MHE_OUTCOME_DIVERGED ? MHE_STOP_DIVERGED : 0;
    flags |= c->accepted ? MHE_ACCEPTED : 0;
    if (c->settings->scheme == DSE_MHE_PRICE)
        return flags | (c->prices.unbounded_round && !stop ? MHE_UNBOUNDED : 0);
    const bool triggered = c->config->subsystems[i].trigger > 0;
    return flags | (triggered && !coordinator_has(c, i, MHE_SYNC) ? MHE_START : 0);
}

/* p_i - D_i^-1 h_ref: the penalty then acts on h - h_ref but for a constant. */
static void put_price(struct dse_mhe_coordinator *c, int i, dse_real *d)
{
    const int nx = coordinator_nx(c, i), transitions = c->length - 1;
    const dse_real *p = coordinator_transitions(c, c->p, i);
    for (int e = 0; e < transitions * nx; e++)
        d[e] = p[e];
    if (c->prices.recentred == 0)
        return;
    dse_real *L = c->work, *v = L + nx * nx;
    if (dse_cholesky(nx, c->config->subsystems[i].D, L) != DSE_OK)
        return; /* cannot be: the agents have checked D */
    const dse_real *reference = coordinator_transitions(c, c->prices.reference, i);
    for (int t = 0; t < transitions; t++) {
        for (int a = 0; a < nx; a++)
            v[a] = reference[t * nx + a];
        dse_cholesky_solve(nx, L, 1, v);
        dse_axpy(nx, -1, v, d + t * nx);
    }
}

int dse_mhe_coordinator_message_down(struct dse_mhe_coordinator *c, int i, dse_real *message)
{
    const int nx = coordinator_nx(c, i), H = c->length, transitions = (H - 1) * nx;
    const int flags = flags_for(c, i);
    message[MHE_SAMPLE] = (dse_real)(c->newest % MHE_SAMPLE_WRAP);
    message[MHE_ROUND] = (dse_real)c->round;
    message[MHE_LENGTH] = (dse_real)H;
    message[MHE_FLAGS] = (dse_real)flags;
    message[MHE_COST] = 0;
    int count = DSE_MHE_HEADER;
    if ((flags & MHE_STOP) == 0) {
        coordinator_price_on(c, c->p, i, message + count);
        count += transitions;
        if (c->settings->scheme == DSE_MHE_PRICE)
            put_price(c, i, message + count);
        else
            coordinator_interaction(c, c->asked, i, message + count);
        count += transitions;
    }
    const dse_real *X = coordinator_states(c, c->X, i);
    for (int e = 0; (flags & MHE_START) != 0 && e < H * nx; e++)
        message[count++] = X[e];
    return count;
}

/* ---- up ---- */

static void clear_answer(struct dse_mhe_coordinator *c, int i)
{
    dse_real *X = coordinator_states(c, c->X, i), *other = coordinator_transitions(c, c->other, i);
    for (int e = 0; e < c->length * coordinator_nx(c, i); e++)
        X[e] = 0;
    for (int e = 0; e < (c->length - 1) * coordinator_nx(c, i); e++)
        other[e] = 0;
}

/* The bit maps of an answer. */
static void take_bits(struct dse_mhe_coordinator *c, int i, const dse_real *words)
{
    const int outputs = c->length * c->config->subsystems[i].ny;
    const int bounds = (2 * c->length - 1) * coordinator_nx(c, i);
    dse_real *has = c->dual.has + c->length * c->first_output[i];
    for (int b = 0; b < outputs; b++)
        has[b] = mhe_bit_get(words, b) ? 1 : 0;
    if (!mhe_subsystem_is_bounded(&c->config->subsystems[i]))
        return;
    const int stride = DSE_MHE_BIT_WORDS((2 * c->N - 1) * c->nx_max);
    words += DSE_MHE_BIT_WORDS(outputs);
    for (int w = 0; w < DSE_MHE_BIT_WORDS(bounds); w++)
        c->dual.bits[i * stride + w] = words[w];
}

static int bit_words(const struct dse_mhe_coordinator *c, int i)
{
    const struct dse_mhe_subsystem *s = &c->config->subsystems[i];
    const bool bounds = c->settings->scheme == DSE_MHE_PRICE && mhe_subsystem_is_bounded(s);
    return DSE_MHE_BIT_WORDS(c->length * s->ny) +
           (bounds ? DSE_MHE_BIT_WORDS((2 * c->length - 1) * s->nx) : 0);
}

/* Whether the header is one of this sample and round. */
static enum dse_status check_header(const struct dse_mhe_coordinator *c, const dse_real *message)
{
    const long k = mhe_header_get(message, MHE_SAMPLE), round = mhe_header_get(message, MHE_ROUND);
    const long flags = mhe_header_get(message, MHE_FLAGS);
    if (k < 0 || round < 0 || flags < 0 || mhe_header_get(message, MHE_LENGTH) < 1)
        return DSE_EFORMAT;
    const bool fresh = (flags & MHE_FRESH) != 0;
    if (k != c->newest % MHE_SAMPLE_WRAP || round > c->round || (fresh && round != c->round))
        return DSE_ENODATA;
    return DSE_OK;
}

static void take_data(struct dse_mhe_coordinator *c, int i, const dse_real *data)
{
    const int nx = coordinator_nx(c, i), H = c->length;
    dse_real *X = coordinator_states(c, c->X, i), *other = coordinator_transitions(c, c->other, i);
    for (int e = 0; e < H * nx; e++)
        X[e] = data[e];
    for (int e = 0; e < (H - 1) * nx; e++)
        other[e] = data[H * nx + e];
    c->state[i] |= MHE_DATA;
    c->uplinks++;
}

enum dse_status dse_mhe_coordinator_receive_up(struct dse_mhe_coordinator *c, int i,
                                               const dse_real *message, int count)
{
    if (count < DSE_MHE_HEADER)
        return DSE_EFORMAT;
    const enum dse_status status = check_header(c, message);
    if (status != DSE_OK)
        return status;
    const int flags = (int)mhe_header_get(message, MHE_FLAGS);
    const bool sent = (flags & MHE_SENT) != 0;
    const int words = bit_words(c, i), nx = coordinator_nx(c, i);
    const int answered = MHE_ALIVE | MHE_ANSWERED;
    if (mhe_header_get(message, MHE_LENGTH) != c->length) {
        /* It has started late and goes on alone until its window is full. */
        c->state[i] = (c->state[i] & ~(MHE_DATA | MHE_SYNC)) | answered | MHE_CURRENT | MHE_SHORT;
        clear_answer(c, i);
        return DSE_OK;
    }
    if (count != DSE_MHE_HEADER + words + (sent ? (2 * c->length - 1) * nx : 0))
        return DSE_EFORMAT;
    if (!dse_all_finite(message, count))
        return DSE_ENONFINITE;
    c->state[i] &= ~(MHE_INFEASIBLE | MHE_SINGULAR | MHE_SHORT);
    c->state[i] |= answered;
    c->state[i] |= (flags & MHE_UP_INFEASIBLE) != 0 ? MHE_INFEASIBLE : 0;
    c->state[i] |= (flags & MHE_UP_SINGULAR) != 0 ? MHE_SINGULAR : 0;
    c->state[i] |= (flags & MHE_FRESH) != 0 ? MHE_CURRENT | MHE_SYNC : 0;
    if (c->settings->scheme == DSE_MHE_PRICE)
        take_bits(c, i, message + DSE_MHE_HEADER);
    c->age[i] = 0;
    c->J[i] = message[MHE_COST];
    if (sent)
        take_data(c, i, message + DSE_MHE_HEADER + words);
    return DSE_OK;
}

void dse_mhe_coordinator_missing_up(struct dse_mhe_coordinator *c, int i)
{
    c->state[i] &= ~(MHE_ANSWERED | MHE_CURRENT);
}

/* ---- the end of a round ---- */

/* Who has not answered: what is held stays; who has never sent counts as zero, which is the steady
 * state (case 1 of section 5.2). */
static void count_missing(struct dse_mhe_coordinator *c)
{
    for (int i = 0; i < c->parts; i++) {
        if (coordinator_has(c, i, MHE_ANSWERED)) {
            c->silent[i] = 0;
            continue;
        }
        c->state[i] &= ~(MHE_SYNC | MHE_INFEASIBLE | MHE_SINGULAR | MHE_SHORT);
        c->silent[i] += c->silent[i] < c->dead_after;
        if (c->silent[i] >= c->dead_after)
            c->state[i] &= ~MHE_ALIVE;
        if (!coordinator_has(c, i, MHE_DATA))
            clear_answer(c, i);
    }
}

bool coordinator_is_complete(const struct dse_mhe_coordinator *c)
{
    for (int i = 0; i < c->parts; i++)
        if (coordinator_has(c, i, MHE_ALIVE) && !coordinator_has(c, i, MHE_CURRENT))
            return false;
    return true;
}

static bool is_anyone_there(const struct dse_mhe_coordinator *c)
{
    for (int i = 0; i < c->parts; i++)
        if (coordinator_has(c, i, MHE_ALIVE))
            return true;
    return false;
}

enum dse_mhe_outcome dse_mhe_coordinator_advance(struct dse_mhe_coordinator *c)
{
    if (c->outcome != DSE_MHE_CONTINUE)
        return c->outcome;
    count_missing(c);
    c->round++;
    if (!is_anyone_there(c))
        c->outcome = DSE_MHE_OUTCOME_ALONE;
    else if (c->settings->scheme == DSE_MHE_PRICE)
        c->outcome = coordinator_advance_price(c);
    else
        c->outcome = coordinator_advance_prediction(c);
    if (c->outcome == DSE_MHE_OUTCOME_CONVERGED && c->config->fixed_iterations)
        c->outcome = DSE_MHE_CONTINUE;
    if (c->outcome == DSE_MHE_CONTINUE && c->round >= c->max_iter)
        c->outcome = DSE_MHE_OUTCOME_PREMATURE;
    for (int i = 0; i < c->parts && c->outcome == DSE_MHE_CONTINUE; i++)
        c->state[i] &= ~(MHE_ANSWERED | MHE_CURRENT);
    return c->outcome;
}
