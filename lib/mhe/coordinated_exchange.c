/* Coordinated moving horizon estimation: an agent's rounds and what it makes of them. */
#include <stddef.h>

#include "coordinated_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"

static bool is_starting(const struct dse_mhe_local *local)
{
    return local->length < local->settings->min_horizon;
}

/* ---- down ---- */

/* What was said in this sample has led nowhere: as if nothing had come. */
static void disown(struct dse_mhe_local *local)
{
    local->heard = false;
    local->fresh = false;
    local->has_kept = false;
    local->received_length = 0;
    local->sent_length = 0;
    local->solved = 0; /* the decentralised problem is still to be solved */
}

enum dse_status dse_mhe_local_receive_down(struct dse_mhe_local *local, const dse_real *message,
                                           int count)
{
    const int transitions = (local->length - 1) * local->nx;
    if (count < DSE_MHE_HEADER)
        return DSE_EFORMAT;
    const long k = mhe_header_get(message, MHE_SAMPLE), round = mhe_header_get(message, MHE_ROUND);
    const long length = mhe_header_get(message, MHE_LENGTH);
    const long flags = mhe_header_get(message, MHE_FLAGS);
    if (k < 0 || round < 0 || length < 0 || flags < 0)
        return DSE_EFORMAT;
    const bool stop = (flags & MHE_STOP) != 0, start = (flags & MHE_START) != 0;
    /* A deadline may end a round before it is counted. */
    const bool same_round = round == local->round;
    if (k != local->newest % MHE_SAMPLE_WRAP || local->stopped || round < local->round ||
        (same_round && !stop))
        return DSE_ENODATA;
    /* Of another length: the window of this agent is not full yet, it has to go on alone. */
    if (length != local->length) {
        local->stopped = stop;
        return DSE_EFORMAT;
    }
    const int expected = (stop ? 0 : 2 * transitions) + (start ? local->length * local->nx : 0);
    if (count != DSE_MHE_HEADER + expected)
        return DSE_EFORMAT;
    const dse_real *g = message + DSE_MHE_HEADER, *d = g + transitions, *X = d + transitions;
    if (!dse_all_finite(g, expected))
        return DSE_ENONFINITE;
    local->round = (int)round;
    local->flags = (int)flags;
    local->heard = true;
    local->received_sample = local->newest;
    /* The prices of a round that was not counted have not been judged. */
    const bool judged = !same_round || local->settings->scheme == DSE_MHE_PREDICTION;
    if ((flags & MHE_ACCEPTED) != 0 && judged && local->last_status == DSE_OK) {
        const struct dse_mhe_solution best = local->current;
        local->current = local->kept;
        local->kept = best;
        local->has_kept = true;
    }
    local->stopped = stop;
    if ((flags & MHE_STOP_DIVERGED) != 0)
        disown(local);
    if (stop)
        return DSE_OK;
    local->fresh = true;
    local->received_length = local->length;
    for (int i = 0; i < (local->N - 1) * local->nx; i++) {
        local->g[i] = i < transitions ? g[i] : 0;
        local->d[i] = i < transitions ? d[i] : 0;
    }
    for (int i = 0; start && i < local->length * local->nx; i++)
        local->sent[i] = X[i];
    local->sent_length = start ? local->length : local->sent_length;
    return DSE_OK;
}

void dse_mhe_local_missing_down(struct dse_mhe_local *local)
{
    local->fresh = false;
}

bool dse_mhe_local_is_finished(const struct dse_mhe_local *local)
{
    return local->stopped || is_starting(local) || local->settings->scheme == DSE_MHE_ALONE;
}

/* ---- the problem of a round ---- */

/* Whether what came last may still be used. */
static bool can_hold(const struct dse_mhe_local *local)
{
    const long age = local->newest - local->received_sample;
    return local->received_length > 0 && local->received_length <= local->length &&
           (local->settings->max_age == 0 || age <= local->settings->max_age);
}

void dse_mhe_local_solve(struct dse_mhe_local *local)
{
    if (is_starting(local))
        return;
    mhe_local_factor(local);
    const bool held = !local->fresh && can_hold(local);
    const bool price = local->settings->scheme == DSE_MHE_PRICE;
    local->used_held = held;
    local->used_nothing = !local->fresh && !held;
    if (local->used_nothing)
        local->last_status = mhe_local_solve_own(local, NULL, NULL);
    else if (price)
        local->last_status = mhe_local_solve_price(
            local, local->g, local->d, local->fresh && (local->flags & MHE_UNBOUNDED) != 0);
    else
        local->last_status = mhe_local_solve_own(local, local->g, local->d);
    local->solved++;
}

/* ---- up ---- */

/* |X - X last sent| >= eps_i (5.1), or what was sent last is not known. */
static bool has_to_send(const struct dse_mhe_local *local)
{
    if (local->last_status != DSE_OK)
        return false;
    if (local->settings->scheme == DSE_MHE_PRICE)
        return local->fresh; /* an answer to older prices is of no use */
    if (local->subsystem->trigger == 0 || local->sent_length != local->length)
        return true;
    dse_real sum = 0;
    for (int i = 0; i < local->length * local->nx; i++) {
        const dse_real e = local->current.X[i] - local->sent[i];
        sum += e * e;
    }
    return dse_sqrt(sum) >= local->subsystem->trigger;
}

static int put_bits(const struct dse_mhe_local *local, dse_real *at)
{
    const int nx = local->nx, H = local->length, outputs = H * local->ny;
    const int bounds = (2 * H - 1) * nx;
    const bool with_bounds = local->bounded && local->settings->scheme == DSE_MHE_PRICE;
    mhe_bits_clear(outputs, at);
    for (int i = 0; i < outputs; i++)
        if (local->has[i] != 0)
            mhe_bit_set(at, i);
    if (!with_bounds)
        return DSE_MHE_BIT_WORDS(outputs);
    at += DSE_MHE_BIT_WORDS(outputs);
    mhe_bits_clear(bounds, at);
    const bool free = (local->flags & MHE_UNBOUNDED) != 0 || local->last_status != DSE_OK;
    for (int i = 0; i < bounds && !free; i++) {
        const int j = i < H * nx ? i : i - H * nx; /* X first, then W */
        const int k = j / nx * 2 * nx + (i < H * nx ? 0 : nx) + j % nx;
        if (dse_window_qp_side(&local->price_qp.qp, k) != 0)
            mhe_bit_set(at, i);
    }
    return DSE_MHE_BIT_WORDS(outputs) + DSE_MHE_BIT_WORDS(bounds);
}

int dse_mhe_local_message_up(struct dse_mhe_local *local, dse_real *message)
{
    const int nx = local->nx, H = local->length;
    const struct dse_mhe_solution *s = &local->current;
    int flags = local->fresh ? MHE_FRESH : 0;
    if (local->last_status == DSE_ENOTPD || local->last_status == DSE_ESINGULAR)
        flags |= MHE_UP_SINGULAR;
    else if (local->last_status != DSE_OK)
        flags |= MHE_UP_INFEASIBLE;
    local->sends = has_to_send(local);
    flags |= local->sends ? MHE_SENT : 0;
    message[MHE_SAMPLE] = (dse_real)(local->newest % MHE_SAMPLE_WRAP);
    message[MHE_ROUND] = (dse_real)(local->round < 0 ? 0 : local->round);
    message[MHE_LENGTH] = (dse_real)H;
    message[MHE_FLAGS] = (dse_real)flags;
    message[MHE_COST] = local->settings->scheme == DSE_MHE_PRICE && local->sends ? s->J : 0;
    int count = DSE_MHE_HEADER;
    count += put_bits(local, message + count);
    if (!local->sends)
        return count;
    for (int i = 0; i < H * nx; i++) {
        message[count++] = s->X[i];
        local->sent[i] = s->X[i];
    }
    local->sent_length = H;
    for (int i = 0; i < (H - 1) * nx; i++)
        message[count++] = s->other[i];
    return count;
}
