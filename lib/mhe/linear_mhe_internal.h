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

bool linear_mhe_is_complete(const struct dse_linear_mhe *mhe, int place);
bool linear_mhe_has_data(const struct dse_linear_mhe *mhe, int place);
/* L^-1 C of the sample in that place. */
const dse_real *linear_mhe_rows(const struct dse_linear_mhe *mhe, int place);

/* ---- factors (linear_mhe_factor.c) ---- */

/* Those of all complete windows, at init. */
enum dse_status linear_mhe_factor_complete(struct dse_linear_mhe *mhe);
/* Those of the window as it is. DSE_ESINGULAR, DSE_ENONFINITE. */
enum dse_status linear_mhe_factor_window(struct dse_linear_mhe *mhe);
/* The factors that hold for a sample at this distance from the newest. */
struct dse_linear_mhe_stage linear_mhe_stage(const struct dse_linear_mhe *mhe, int distance);

/* ---- the arrival cost (linear_mhe_arrival.c) ---- */

/* prior_V of prior_T and prior_d. */
void linear_mhe_prior_rows(struct dse_linear_mhe *mhe);
/* Takes the oldest sample of a full window over; b (nx): B u of the transition to the next one. */
enum dse_status linear_mhe_arrive(struct dse_linear_mhe *mhe, const dse_real *b);

/* ---- solution (linear_mhe_solve.c); dse_linear_mhe_certify leaves its multipliers in mhe->lambda
 * and its residuals in mhe->residual (linear_mhe_certificate.c) ---- */

/* mhe->spread, at init. */
void linear_mhe_find_spread(struct dse_linear_mhe *mhe);

/* next = A x + b. */
void linear_mhe_move(const struct dse_linear_mhe *mhe, const dse_real *x, const dse_real *b,
                     dse_real *next);

#endif
