/* Kalman filter for a linear time-invariant model: the extended Kalman filter with the model
 *
 *     x(k+1) = A x(k) + B u(k) + w,  w ~ N(0, Q)        (or x' = A x + B u, Q an intensity)
 *     y(k)   = C x(k) + D u(k) + e,  e ~ N(0, R)
 *
 * for which it is exact. A continuous model is discretised once at init: by the matrix exponential
 * with inputs held and by Van Loan's integral of the noise, for steps of constant length.
 *
 * State, covariance, innovation, health: dse_ekf_state(dse_kalman_ekf(&kalman)) and so on. */
#ifndef DSE_KALMAN_H
#define DSE_KALMAN_H

#include "dse/ekf.h"
#include "dse/linalg.h"

/* Config and all that it points to must outlive the filter. */
struct dse_kalman_config {
    int nx, nu, ny;           /* > 0, >= 0, >= 0 */
    struct dse_linear linear; /* A, B, C, D: discrete, or continuous when period > 0 */
    dse_real period;    /* > 0: linear and Q are continuous, sampled so; 0: they are discrete */
    dse_real t0;        /* time of x0; default 0 */
    const dse_real *x0; /* nx: initial estimate; NULL: zero */
    const dse_real *P0; /* nx x nx: its covariance, positive semidefinite */
    const dse_real *Q;  /* nx x nx, positive semidefinite; NULL: no process noise */
    const dse_real *R;  /* ny x ny, positive definite, constant */
    dse_real gate;      /* standard deviations; 0 (default): no gate */
};

/* Must stay where it was initialised: its parts point to each other. */
struct dse_kalman {
    struct dse_ekf ekf;
    struct dse_ekf_config config;
    struct dse_model model;
    struct dse_linear linear; /* discrete */
};

/* Reals that dse_kalman_init takes when the linear model is discrete .. */
#define DSE_KALMAN_STORAGE(nx, ny) DSE_EKF_STORAGE(nx, ny)
/* .. and when it has to be discretised (the filter's own memory serves as scratch before). */
#define DSE_KALMAN_STORAGE_CONTINUOUS(nx, nu, ny)                                                  \
    (2 * (nx) * (nx) + (nx) * (nu) +                                                               \
     DSE_EKF_LARGER(DSE_EKF_STORAGE(nx, ny),                                                       \
                    DSE_EKF_LARGER(DSE_DISCRETISE_SCRATCH(nx, nu), DSE_VAN_LOAN_SCRATCH(nx))))

/* DSE_EINVAL, DSE_ENOTPD (P0, Q, R), DSE_ENONFINITE, DSE_ESTORAGE. */
enum dse_status dse_kalman_init(struct dse_kalman *kalman, const struct dse_kalman_config *config,
                                struct dse_arena *arena);
/* One step to time t with input u (nu). */
enum dse_status dse_kalman_predict(struct dse_kalman *kalman, dse_real t, const dse_real *u);
/* Correction by a sample taken at t, the time of the estimate; see dse_ekf_update. */
enum dse_status dse_kalman_update(struct dse_kalman *kalman, dse_real t, const dse_real *u,
                                  const struct dse_measurement *measurement);
/* The filter for the read-only accessors of dse/ekf.h. */
const struct dse_ekf *dse_kalman_ekf(const struct dse_kalman *kalman);

#endif
