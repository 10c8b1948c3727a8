/* Measurements in information form: what sensors y = C x + e, e ~ N(0, R), know of the state adds
 * up, whoever measures:
 *
 *     u = sum_i C_i'R_i^-1 y_i,   Y = sum_i C_i'R_i^-1 C_i                      (4.27)-(4.31)
 *     M = (P^-1 + Y)^-1,   xh = x + M (u - Y x)                                (4.22)-(4.24)
 *
 * M is made as W'(I + W Y W')^-1 W with P = W'W: symmetric positive semidefinite by construction,
 * and neither P nor Y needs an inverse. The time update is that of any Kalman filter, A M A' + Q
 * (dse_sym_congruence), which a singular Q does not stop, as the inverse form (4.25) is.
 *
 * A network of n nodes that has the averages u / n, Y / n only (consensus) multiplies them by n
 * again. That is the micro-Kalman filter (4.32)-(4.43): the same with all covariances times n.
 *
 * Equation numbers are those of the consensus-based second-order observers source. */
#ifndef DSE_INFORMATION_H
#define DSE_INFORMATION_H

#include "dse/model.h"
#include "dse/real.h"
#include "dse/status.h"

/* u (nx), Y (nx x nx) of the channels of `measurement` that there are: missing and non-finite ones
 * are left out, with their noise; without any u = 0, Y = 0. C: ny x nx, R: ny x ny, positive
 * definite. used: number of channels, may be NULL. DSE_ENOTPD. */
#define DSE_INFORMATION_OF_SCRATCH(nx, ny) ((ny) * (ny) + (ny) * (nx) + (ny))
enum dse_status dse_information_of(int nx, int ny, const dse_real *C, const dse_real *R,
                                   const struct dse_measurement *measurement, dse_real *u,
                                   dse_real *Y, int *used, dse_real *scratch);

/* xh (nx), M (nx x nx) of x, P and the information u, Y. P: positive semidefinite; Y: symmetric, it
 * may be indefinite by a little. M may be P, xh may be x. DSE_ENOTPD: P, or P^-1 + Y, is not;
 * DSE_ENONFINITE. On failure xh and M are as they were. */
#define DSE_INFORMATION_SCRATCH(nx) (5 * (nx) * (nx) + 3 * (nx))
enum dse_status dse_information_update(int nx, const dse_real *x, const dse_real *P,
                                       const dse_real *u, const dse_real *Y, dse_real *xh,
                                       dse_real *M, dse_real *scratch);

#endif
