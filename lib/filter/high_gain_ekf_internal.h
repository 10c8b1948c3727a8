/* Parts of the adaptive high-gain EKF that its files share. */
#ifndef DSE_HIGH_GAIN_EKF_INTERNAL_H
#define DSE_HIGH_GAIN_EKF_INTERNAL_H

#include "dse/high_gain_ekf.h"

/* ---- coordinates (high_gain_ekf_coordinates.c) ---- */

/* Where block j begins. */
int dse_high_gain_offset(const struct dse_normal_form *form, int j);
/* The inputs at t_k + dt: u + dt u'. */
const dse_real *dse_high_gain_inputs(const dse_real *u, const dse_real *du, bool moving, int nu,
                                     dse_real dt, dse_real *u_stage);
/* The rates of u; true when one is not zero. */
bool dse_high_gain_rates(const struct dse_normal_form *form, const dse_real *u, dse_real *du);
/* chi = the picture x of the filter's coordinates in physical ones. */
enum dse_status dse_high_gain_decode(const struct dse_high_gain_ekf *filter, dse_real t,
                                     const dse_real *x, const dse_real *u, dse_real *chi);
/* The picture x, encoded with inputs `from`, as one that is encoded with `to`: the same physical
 * state. Uses chi. */
enum dse_status dse_high_gain_recode(struct dse_high_gain_ekf *filter, dse_real t,
                                     const dse_real *from, const dse_real *to, dse_real *x);
/* M = dPhi_i/dchi_i of the own block at chi, of everything in a centralised filter. Uses w. */
enum dse_status dse_high_gain_map(struct dse_high_gain_ekf *filter, dse_real t, const dse_real *chi,
                                  const dse_real *u);
/* dx = how the model moves the picture x, and how the predictor's own model does, where there is
 * one. The second uses chi and w. */
enum dse_status dse_high_gain_field(const struct dse_high_gain_ekf *filter, dse_real t,
                                    const dse_real *x, const dse_real *u, dse_real *dx);
enum dse_status dse_high_gain_predictor_field(struct dse_high_gain_ekf *filter, dse_real t,
                                              const dse_real *x, const dse_real *u, dse_real *dx);

/* ---- one Runge-Kutta step of picture and covariance (high_gain_ekf_step.c) ---- */

/* First stage: the point is the picture at t_k with the messages in. */
void dse_high_gain_first_stage(struct dse_high_gain_ekf *filter);
/* Derivative at the point of stage s = 0..3, its weight into the sum, and the point of stage s + 1.
 */
enum dse_status dse_high_gain_stage(struct dse_high_gain_ekf *filter, int s);
/* After stage 3: the state at t_{k+1} into xs and Ps, checked. */
enum dse_status dse_high_gain_combine(struct dse_high_gain_ekf *filter);

/* ---- correction by the own outputs (high_gain_ekf_outputs.c) ---- */

/* L, D and W from R_th for the outputs that are there. */
enum dse_status dse_high_gain_weigh_outputs(struct dse_high_gain_ekf *filter);
/* e (q) = y - C z of block z. */
void dse_high_gain_output_errors(struct dse_high_gain_ekf *filter, const dse_real *z);
/* K (n_i) = P C' R_th^-1 e at the stage's P. */
void dse_high_gain_correction(struct dse_high_gain_ekf *filter);
/* kP = F P + P F' + Q_th - P C' R_th^-1 C P. */
void dse_high_gain_riccati(struct dse_high_gain_ekf *filter);

/* ---- the exchange (high_gain_ekf_exchange.c) ---- */

/* Rounds of the tick that is being opened, and whether the own state is sent. */
void dse_high_gain_plan_rounds(struct dse_high_gain_ekf *filter);
/* Steps 1 to 3 of the tick (4.5): messages, theta, and the weights that follow from it. */
enum dse_status dse_high_gain_start_step(struct dse_high_gain_ekf *filter);
/* Gives the tick up. Everything committed is as it was. */
enum dse_status dse_high_gain_fail(struct dse_high_gain_ekf *filter, enum dse_status status);
/* Estimate and covariance of t_k from the picture in base. */
enum dse_status dse_high_gain_report(struct dse_high_gain_ekf *filter);

/* ---- the past (high_gain_ekf_past.c) ---- */

/* Opens sample k in the memory of the past. */
void dse_high_gain_note_sample(struct dse_high_gain_ekf *filter);
/* The states that came in this instant into base, directly or through the past (4.4). */
void dse_high_gain_take_states(struct dse_high_gain_ekf *filter);
/* comm_every_ticks with its default. */
int dse_high_gain_every(const struct dse_high_gain_ekf_config *config);

/* ---- the innovation (high_gain_ekf_innovation.c) ---- */

/* J_i at t_k from the oldest running prediction. */
enum dse_status dse_high_gain_innovation(struct dse_high_gain_ekf *filter);
/* Accumulates y_k, restarts the slot of this tick at chi, the physical picture at t_k, and takes
 * all running predictions to t_{k+1}. */
enum dse_status dse_high_gain_advance_predictions(struct dse_high_gain_ekf *filter,
                                                  const dse_real *chi);

#endif
