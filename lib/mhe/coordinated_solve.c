/* Coordinated moving horizon estimation: an agent's problems without bounds, in closed form. */
#include <stddef.h>

#include "coordinated_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"

static bool data_are_those_of_factors(const struct dse_mhe_local *local)
{
    if (local->factored_length != local->length)
        return false;
    for (int i = 0; i < local->length * local->ny; i++)
        if (local->has[i] != local->factored[i])
            return false;
    return true;
}

void mhe_local_factor(struct dse_mhe_local *local)
{
    if (data_are_those_of_factors(local))
        return;
    const int H = local->length;
    /* Omega_ii = M_C + G'Q^-1G,  M_x = M_C + G'(Q + D)^-1 G */
    mhe_window_matrix(&local->own_chain, H, &local->outputs, local->has, &local->disturbance);
    local->own_status = mhe_chain_factor(&local->own_chain);
    if (local->settings->scheme == DSE_MHE_PRICE) {
        mhe_window_matrix(&local->price_chain, H, &local->outputs, local->has, &local->price);
        local->price_status = mhe_chain_factor(&local->price_chain);
    }
    if (local->bounded && local->settings->barrier == 0)
        mhe_bounded_factor(local);
    local->factored_length = H;
    for (int i = 0; i < H * local->ny; i++)
        local->factored[i] = local->has[i];
}

/* rhs = c + P^-1 xbar - g. */
static void start_rhs(struct dse_mhe_local *local, const dse_real *g)
{
    const int nx = local->nx, H = local->length;
    const dse_real *prior = local->subsystem->prior;
    for (int i = 0; i < H * nx; i++)
        local->rhs[i] = local->c[i];
    for (int i = 0; i < nx && prior; i++)
        local->rhs[i] += dse_dot(nx, prior + i * nx, local->xbar);
    if (g)
        dse_axpy((H - 1) * nx, -1, g, local->rhs);
}

/* y_t = M x_t for all transitions. */
static void apply(int nx, int count, const dse_real *M, const dse_real *x, dse_real *y)
{
    for (int t = 0; t < count; t++)
        dse_mat_vec(nx, nx, M, x + t * nx, y + t * nx);
}

enum dse_status mhe_local_solve_own(struct dse_mhe_local *local, const dse_real *g,
                                    const dse_real *h)
{
    const int nx = local->nx, H = local->length, transitions = H - 1;
    struct dse_mhe_solution *s = &local->current;
    start_rhs(local, g);
    local->active = 0;
    if (local->bounded && local->settings->barrier > 0)
        return mhe_barrier_solve(local, h);
    if (h) { /* + G'Q^-1 h */
        apply(nx, transitions, local->disturbance.S, h, local->work);
        mhe_differences_transposed(local->subsystem, H, 1, local->work, local->rhs);
    }
    if (local->own_status != DSE_OK)
        return local->own_status;
    if (local->bounded)
        return mhe_bounded_solve_own(local, h);
    for (int i = 0; i < H * nx; i++) /* Omega_ii X = c + G'Q^-1 h - g */
        s->X[i] = local->rhs[i];
    mhe_chain_solve(&local->own_chain, s->X);
    mhe_differences(local->subsystem, H, s->X, s->W);
    if (h)
        dse_axpy(transitions * nx, -1, h, s->W);
    apply(nx, transitions, local->disturbance.S, s->W, s->other); /* lambda = Q^-1 W */
    local->certificate = mhe_chain_residual(&local->own_chain, s->X, local->rhs);
    return dse_all_finite(s->X, H * nx) ? DSE_OK : DSE_ENONFINITE;
}

/* J = 1/2 X'M_C X + 1/2 |W|^2_{Q^-1} + 1/2 |h|^2_{D^-1} - (c - g)'X + p'h. */
static dse_real price_cost(struct dse_mhe_local *local, const dse_real *g, const dse_real *p)
{
    const int nx = local->nx, H = local->length;
    const struct dse_mhe_solution *s = &local->current;
    start_rhs(local, g);
    dse_real sum = 0;
    for (int t = 0; t < H; t++) {
        const dse_real *x = s->X + t * nx;
        mhe_outputs_apply(&local->outputs, local->has + t * local->ny, x, local->work);
        if (t == 0 && local->subsystem->prior)
            for (int i = 0; i < nx; i++)
                local->work[i] += dse_dot(nx, local->subsystem->prior + i * nx, x);
        sum += dse_dot(nx, local->work, x) / 2 - dse_dot(nx, local->rhs + t * nx, x);
    }
    for (int t = 0; t < H - 1; t++) {
        const dse_real *w = s->W + t * nx, *h = s->other + t * nx;
        dse_mat_vec(nx, nx, local->disturbance.S, w, local->work);
        sum += dse_dot(nx, local->work, w) / 2;
        dse_mat_vec(nx, nx, local->interaction.S, h, local->work);
        sum += dse_dot(nx, local->work, h) / 2 + dse_dot(nx, p + t * nx, h);
    }
    return sum;
}

/* X = M_x^-1 (c - g - G'T p),  h = T'G X - V p,  W = G X - h. */
static enum dse_status solve_price_free(struct dse_mhe_local *local, const dse_real *g,
                                        const dse_real *p)
{
    const int nx = local->nx, H = local->length, transitions = H - 1;
    struct dse_mhe_solution *s = &local->current;
    if (local->price_status != DSE_OK)
        return local->price_status;
    start_rhs(local, g);
    apply(nx, transitions, local->price.T, p, local->work);
    mhe_differences_transposed(local->subsystem, H, -1, local->work, local->rhs);
    for (int i = 0; i < H * nx; i++)
        s->X[i] = local->rhs[i];
    mhe_chain_solve(&local->price_chain, s->X);
    local->certificate = mhe_chain_residual(&local->price_chain, s->X, local->rhs);
    mhe_differences(local->subsystem, H, s->X, s->W);
    for (int t = 0; t < transitions; t++) {
        dse_mat_tvec(nx, nx, local->price.T, s->W + t * nx, s->other + t * nx);
        dse_mat_vec(nx, nx, local->price.V, p + t * nx, local->work);
        dse_axpy(nx, -1, local->work, s->other + t * nx);
    }
    dse_axpy(transitions * nx, -1, s->other, s->W);
    return dse_all_finite(s->X, H * nx) ? DSE_OK : DSE_ENONFINITE;
}

enum dse_status mhe_local_solve_price(struct dse_mhe_local *local, const dse_real *g,
                                      const dse_real *p, bool without_bounds)
{
    local->active = 0;
    enum dse_status status;
    if (local->bounded && !without_bounds) {
        start_rhs(local, g);
        status = mhe_bounded_solve_price(local, p);
    } else {
        status = solve_price_free(local, g, p);
    }
    if (status == DSE_OK)
        local->current.J = price_cost(local, g, p);
    return status;
}
