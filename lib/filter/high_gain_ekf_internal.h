/* Parts of the adaptive high-gain EKF that its files share. */
#ifndef DSE_HIGH_GAIN_EKF_INTERNAL_H
#define DSE_HIGH_GAIN_EKF_INTERNAL_H

#include "dse/high_gain_ekf.h"

/* ---- one Runge-Kutta step of picture and covariance (high_gain_ekf_step.c) ---- */

/* The inputs at t_k + dt: u + dt u'. */
const dse_real *dse_high_gain_inputs(const dse_real *u, const dse_real *du, bool moving, int nu,
                                     dse_real dt, dse_real *u_stage);
/* chi = the picture x of the filter's coordinates in physical ones. */
enum dse_status dse_high_gain_decode(const struct dse_high_gain_ekf *filter, dse_real t,
                                     const dse_real *x, const dse_real *u, dse_real *chi);
/* First stage: the point is the picture at t_k with the messages in. */
void dse_high_gain_first_stage(struct dse_high_gain_ekf *filter);
/* Derivative at the point of stage s = 0..3, its weight into the sum, and the point of stage s + 1.
 */
enum dse_status dse_high_gain_stage(struct dse_high_gain_ekf *filter, int s);
/* After stage 3: the state at t_{k+1} into xs and Ps, checked. */
enum dse_status dse_high_gain_combine(struct dse_high_gain_ekf *filter);

/* ---- the innovation (high_gain_ekf_innovation.c) ---- */

/* J_i at t_k from the oldest running prediction. */
enum dse_status dse_high_gain_innovation(struct dse_high_gain_ekf *filter);
/* Accumulates y_k, restarts the slot of this tick at chi, the physical picture at t_k, and takes
 * all running predictions to t_{k+1}. */
enum dse_status dse_high_gain_advance_predictions(struct dse_high_gain_ekf *filter,
                                                  const dse_real *chi);

#endif
