/* Linear moving horizon estimator: what its parts share.
 *
 * The optimality conditions of a window with multipliers lambda_j of the transition to x_j are
 *
 *     C_j' R_j^-1 C_j x_j - A' lambda_{j+1} + lambda_j = c_j,   lambda_H = 0       (dual)
 *     x_j = A x_{j-1} + b_j + Q lambda_j                                           (primal)
 *     x_0 = xbar + P lambda_0,  or lambda_0 = 0 without arrival cost               (start)
 *
 * in the indices of the code, where lambda_j and b_j belong to the transition *to* x_j, so that the
 * start looks like one more transition. */
#ifndef DSE_MHE_LINEAR_MHE_INTERNAL_H
#define DSE_MHE_LINEAR_MHE_INTERNAL_H

#include "dse/linear_mhe.h"

/* Place of sample j of the window (0: the oldest, may not be negative) in the ring. */
static inline int linear_mhe_place(const struct dse_linear_mhe *mhe, int j)
{
    const int place = mhe->newest_place - (mhe->length - 1) + j;
    return place < 0 ? place + mhe->N : place;
}

static inline bool linear_mhe_is_complete(const struct dse_linear_mhe *mhe, int place)
{
    for (int j = 0; j < mhe->ny; j++)
        if (mhe->has[place * mhe->ny + j] == 0)
            return false;
    return true;
}

bool linear_mhe_has_data(const struct dse_linear_mhe *mhe, int place);
/* L^-1 C of the sample in that place. */
const dse_real *linear_mhe_rows(const struct dse_linear_mhe *mhe, int place);

/* ---- factors (linear_mhe_factor.c) ---- */

/* Those of all complete windows, at init. */
enum dse_status linear_mhe_factor_complete(struct dse_linear_mhe *mhe);
/* Those of the window as it is. DSE_ESINGULAR, DSE_ENONFINITE. */
enum dse_status linear_mhe_factor_window(struct dse_linear_mhe *mhe);
/* Those of a sample at this distance from the newest in the set `complete` or `partial`, */
static inline struct dse_linear_mhe_stage linear_mhe_stage_in(int nx, dse_real *set, int distance)
{
    struct dse_linear_mhe_stage stage;
    stage.T = set + distance * 3 * nx * nx;
    stage.F = stage.T + nx * nx;
    stage.S = stage.F + nx * nx;
    return stage;
}

/* and in that which holds for it. */
static inline struct dse_linear_mhe_stage linear_mhe_stage(const struct dse_linear_mhe *mhe,
                                                           int distance)
{
    return linear_mhe_stage_in(mhe->nx, distance < mhe->partial_from ? mhe->complete : mhe->partial,
                               distance);
}

/* ---- the arrival cost (linear_mhe_arrival.c) ---- */

/* prior_V of prior_T and prior_d. */
void linear_mhe_prior_rows(struct dse_linear_mhe *mhe);
/* Takes the oldest sample of a full window over; b (nx): B u of the transition to the next one. */
enum dse_status linear_mhe_arrive(struct dse_linear_mhe *mhe, const dse_real *b);

/* ---- bounds (linear_mhe_bounds.c) ---- */

/* The multipliers mu_j of the bounds of x_j and nu_j of those of the disturbance change the
 * conditions into  lambda_j = c_j - C_j' R_j^-1 C_j x_j - mu_j + A' lambda_{j+1}  and
 * w_j = Q (lambda_j - nu_j). */

bool linear_mhe_wants_bounds(const struct dse_linear_mhe_config *config);
int linear_mhe_max_active(const struct dse_linear_mhe_config *config);
enum dse_status linear_mhe_check_bounds(const struct dse_linear_mhe_config *config);
void linear_mhe_prepare_bounds(struct dse_linear_mhe *mhe, struct dse_arena *arena);
/* x_next, the solution without bounds, becomes that with them, or what stands for it. */
void linear_mhe_keep_bounds(struct dse_linear_mhe *mhe, dse_real tolerance, dse_real *certificate);

/* ---- solution (linear_mhe_solve.c); dse_linear_mhe_certify leaves its multipliers in mhe->lambda
 * and its residuals in mhe->residual (linear_mhe_certificate.c) ---- */

/* dx = (the map of the optimality system)^-1 of the negative residual, which is overwritten. */
void linear_mhe_correction(struct dse_linear_mhe *mhe, dse_real *dx);
/* X (H nx x count, row-major) <- K X, see dse/active_set.h. */
enum dse_status linear_mhe_apply(void *context, int count, int newest, dse_real *X);
/* As dse_linear_mhe_certify, with multipliers of bounds by constraint; y may be NULL. */
dse_real linear_mhe_certify(struct dse_linear_mhe *mhe, const dse_real *x, const dse_real *y);
/* mhe->spread, at init. */
void linear_mhe_find_spread(struct dse_linear_mhe *mhe);

/* next = A x + b. */
void linear_mhe_move(const struct dse_linear_mhe *mhe, const dse_real *x, const dse_real *b,
                     dse_real *next);

#endif
