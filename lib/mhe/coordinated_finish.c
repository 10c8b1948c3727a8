/* Coordinated moving horizon estimation: what an agent says at the end of a sample. */
#include <stddef.h>

#include "coordinated_internal.h"
#include "dse/linalg.h"

static enum dse_mhe_status judge(const struct dse_mhe_local *local, bool solved)
{
    if (!solved && (local->last_status == DSE_ENOTPD || local->last_status == DSE_ESINGULAR))
        return DSE_MHE_SINGULAR;
    if (!solved)
        return DSE_MHE_INFEASIBLE;
    if (local->settings->scheme == DSE_MHE_ALONE)
        return DSE_MHE_CONVERGED;
    if (local->heard && local->stopped && (local->flags & MHE_STOP_CONVERGED) != 0)
        return DSE_MHE_CONVERGED;
    if (local->heard)
        return DSE_MHE_PREMATURE;
    return local->used_held ? DSE_MHE_HELD : DSE_MHE_LOCAL_ONLY;
}

static bool has_data(const struct dse_mhe_local *local)
{
    for (int j = 0; j < local->ny; j++)
        if (local->has[(local->length - 1) * local->ny + j] != 0)
            return true;
    return false;
}

static enum dse_health health_of(const struct dse_mhe_local *local)
{
    switch (local->status) {
    case DSE_MHE_STARTING:
        return DSE_HEALTH_INITIALISING;
    case DSE_MHE_SINGULAR:
        return DSE_HEALTH_UNOBSERVABLE;
    case DSE_MHE_INFEASIBLE:
        return DSE_HEALTH_REJECTING;
    case DSE_MHE_HELD:
    case DSE_MHE_LOCAL_ONLY:
        return DSE_HEALTH_ALONE;
    case DSE_MHE_CONVERGED:
    case DSE_MHE_PREMATURE:
    default:
        return has_data(local) ? DSE_HEALTH_TRACKING : DSE_HEALTH_COASTING;
    }
}

static void publish(struct dse_mhe_local *local, const dse_real *X)
{
    for (int i = 0; i < local->length * local->nx; i++)
        local->x[i] = X[i];
    local->finished_length = local->length;
}

/* Open loop, from the configured start while the window grows. */
static void predict_start(struct dse_mhe_local *local)
{
    const int nx = local->nx;
    const dse_real *start = local->config->start;
    for (int t = 0; t < local->length; t++) {
        for (int i = 0; i < nx; i++) {
            if (start)
                local->x[t * nx + i] = start[t * nx + i];
            else
                local->x[t * nx + i] =
                    t > 0 ? dse_dot(nx, local->subsystem->A + i * nx, local->x + (t - 1) * nx)
                          : local->xbar[i];
        }
    }
    local->finished_length = local->length;
}

/* By A_ii from the newest estimate before: what `past` was prepared with. */
static void predict(struct dse_mhe_local *local)
{
    for (int i = 0; i < local->nx; i++)
        local->x[i] = local->past[(local->length - 1) * local->nx + i];
    local->finished_length = 1;
}

/* The solution to publish; NULL: there is none of this sample. */
static const dse_real *choose(struct dse_mhe_local *local)
{
    const bool kept = local->stopped && local->has_kept;
    const struct dse_mhe_solution *solution = kept ? &local->kept : &local->current;
    local->cost = solution->J;
    return kept || local->last_status == DSE_OK ? solution->X : NULL;
}

void dse_mhe_local_finish(struct dse_mhe_local *local)
{
    const int nx = local->nx, H = local->length;
    local->finished_sample = local->newest;
    local->has_covariance = false;
    if (H < local->settings->min_horizon) {
        predict_start(local);
        local->status = DSE_MHE_STARTING;
    } else {
        if (local->solved == 0) { /* nobody has asked */
            dse_mhe_local_missing_down(local);
            dse_mhe_local_solve(local);
        }
        const dse_real *X = choose(local);
        const bool triggered = local->subsystem->trigger > 0 && local->heard &&
                               local->settings->scheme == DSE_MHE_PREDICTION;
        if (X && triggered && local->sent_length == H)
            X = local->sent; /* what the coordinator has is the estimate (4.10) */
        local->status = judge(local, X != NULL);
        const bool alone =
            X && (local->status == DSE_MHE_LOCAL_ONLY || local->settings->scheme == DSE_MHE_ALONE);
        if (!X && mhe_local_solve_own(local, NULL, NULL) == DSE_OK)
            X = local->current.X;
        if (X)
            publish(local, X);
        else
            predict(local);
        local->has_covariance = alone && local->active == 0 && local->own_status == DSE_OK &&
                                !(local->bounded && local->settings->barrier > 0);
    }
    local->health = health_of(local);
    for (int i = 0; i < nx; i++)
        local->past[(H - 1) * nx + i] = dse_mhe_local_state(local)[i];
}
