/* Extended Kalman filter for discrete models and for continuous models with sampled outputs.
 *
 *     discrete     x(k+1) = f(x(k), u(k)) + w,  w ~ N(0, Q)         y = h(x, u) + e,  e ~ N(0, R)
 *     continuous   dx = f(x, u) dt + dw,  dw dw' ~ Q dt             y = h(x, u) + e
 *
 * The covariance is kept as factors P = T' diag(d) T (dse/factored.h), so it stays positive
 * semidefinite for any R > 0 and any singular Q, and a measurement update costs no more than that
 * of a plain covariance. Outputs enter one by one; all are linearised at the predicted state, hence
 * their order does not matter beyond rounding. A correlated R is whitened by its Cholesky factor.
 *
 *     static dse_real memory[DSE_EKF_STORAGE(4, 2)];
 *     struct dse_arena arena;
 *     struct dse_ekf ekf;
 *     dse_arena_init(&arena, memory, DSE_EKF_STORAGE(4, 2));
 *     dse_ekf_init(&ekf, &config, &arena);
 *     for each sample:
 *         dse_ekf_predict(&ekf, t, u_before);
 *         dse_ekf_update(&ekf, t, u, &measurement);
 *
 * A predict or update that fails leaves state, covariance and time as they were. */
#ifndef DSE_EKF_H
#define DSE_EKF_H

#include <stdbool.h>

#include "dse/arena.h"
#include "dse/factored.h"
#include "dse/health.h"
#include "dse/model.h"
#include "dse/ode.h"
#include "dse/real.h"
#include "dse/status.h"

/* Config, model and all that they point to must outlive the filter. */
struct dse_ekf_config {
    const struct dse_model *model; /* with dfdx, and with dhdx when ny > 0 */
    dse_real t0;                   /* time of x0, in the model's time unit; default 0 */
    const dse_real *x0;            /* nx: initial estimate; NULL: zero */
    const dse_real *P0;            /* nx x nx: its covariance, positive semidefinite (0: known) */

    /* nx x nx, positive semidefinite; NULL: no process noise. Discrete model: covariance per step.
     * Continuous model: intensity, covariance per unit of time. Read at every predict. */
    const dse_real *Q;
    const dse_real *R; /* ny x ny, positive definite, constant: covariance of e */

    /* A channel whose innovation exceeds this many standard deviations of its own prior
     * distribution is rejected. > 0; 0 (default): no gate. */
    dse_real gate;

    /* Continuous models: panels of a predict, each of two Runge-Kutta steps. >= 1; 0 means 1. */
    int panels;
    /* Continuous models: longest panel, in time units; a long predict takes as many more panels as
     * it needs. > 0; 0 (default): no bound. */
    dse_real max_panel;
};

/* What became of a channel in the last update. */
enum dse_channel {
    DSE_CHANNEL_USED = 0,
    DSE_CHANNEL_MISSING = 1,   /* flagged invalid by the sender */
    DSE_CHANNEL_NONFINITE = 2, /* flagged valid, but NaN or infinite: treated as missing */
    DSE_CHANNEL_REJECTED = 3   /* outside the gate */
};

/* Totals since init. */
struct dse_ekf_counts {
    long predictions; /* successful */
    long updates;     /* successful, with or without data */
    long used;        /* channels, as in enum dse_channel */
    long missing;
    long nonfinite;
    long rejected;
    long failed; /* predicts and updates that left the estimate as it was */
};

struct dse_ekf {
    const struct dse_ekf_config *config;
    int nx, ny;
    dse_real time; /* of the estimate */
    dse_real *x;   /* nx */
    dse_real *T;   /* nx x nx, padded, and d (nx): P = T' diag(d) T */
    dse_real *d;
    dse_real *x_next; /* the same triple, filled by a step and exchanged for the above on success */
    dse_real *T_next;
    dse_real *d_next;
    dse_real *R_factor;   /* ny x ny: Cholesky factor of R */
    dse_real *innovation; /* ny */
    dse_real *channel;    /* ny: enum dse_channel */
    dse_real *scratch;    /* see DSE_EKF_SCRATCH */
    dse_real *ode;        /* continuous model: [x; Phi], F and Runge-Kutta scratch */
    bool R_diagonal;
    bool predicted; /* the last successful step was a predict */
    dse_real nis;
    int used;
    enum dse_health health;
    struct dse_ekf_counts counts;
};

/* Predict: F and the scratch of the time update. Update: struct workspace in ekf_update.c. */
#define DSE_EKF_SCRATCH_PREDICT(nx) ((nx) * (nx) + DSE_FACTORED_PREDICT_SCRATCH(nx))
#define DSE_EKF_SCRATCH_UPDATE(nx, ny)                                                             \
    ((nx)*DSE_FACTORED_STRIDE(ny) + DSE_EKF_SCRATCH_REST(nx, ny) + (nx) * (ny) + (ny) * (ny) +     \
     2 * (ny) + (nx))
#define DSE_EKF_SCRATCH_REST(nx, ny)                                                               \
    DSE_EKF_LARGER((nx)*DSE_FACTORED_STRIDE(ny), DSE_FACTORED_UPDATE_SCRATCH(nx, ny))
#define DSE_EKF_SCRATCH(nx, ny)                                                                    \
    DSE_EKF_LARGER(DSE_EKF_SCRATCH_PREDICT(nx), DSE_EKF_SCRATCH_UPDATE(nx, ny))
#define DSE_EKF_LARGER(a, b) ((a) > (b) ? (a) : (b))
/* Reals that dse_ekf_init takes for a discrete model .. */
#define DSE_EKF_STORAGE(nx, ny)                                                                    \
    (2 * DSE_FACTORED_SIZE(nx) + 4 * (nx) + (ny) * (ny) + 2 * (ny) + DSE_EKF_SCRATCH(nx, ny))
/* .. and for a continuous one, whose mean and transition matrix are integrated together. */
#define DSE_EKF_STORAGE_CONTINUOUS(nx, ny) (DSE_EKF_STORAGE(nx, ny) + DSE_EKF_ODE(nx))
#define DSE_EKF_ODE(nx)                    (2 * (nx) * (nx) + (nx) + DSE_RK4_SCRATCH((nx) * (nx) + (nx)))

/* DSE_EINVAL: a value outside its range, a missing Jacobian, a matrix that is not symmetric;
 * DSE_ENOTPD: P0, Q or R; DSE_ENONFINITE; DSE_ESTORAGE. */
enum dse_status dse_ekf_init(struct dse_ekf *ekf, const struct dse_ekf_config *config,
                             struct dse_arena *arena);

/* Sets the estimate anew, e.g. after a fusion with others or a divergence. P (nx x nx) positive
 * semidefinite (upper triangle read). DSE_ENOTPD, DSE_ENONFINITE: nothing has changed. */
enum dse_status dse_ekf_set(struct dse_ekf *ekf, dse_real t, const dse_real *x, const dse_real *P);

/* Moves the estimate to time t with input u (nu, held). A discrete model makes one step, whatever t
 * is; a continuous one integrates from the time of the estimate:
 *     mean and transition matrix  x' = f, Phi' = F Phi  by classical Runge-Kutta of order 4,
 *     process noise               w_i Phi(t, t_i) Q Phi(t, t_i)'  at the nodes of Radau's rule.
 * The transition matrix, not P' = F P + P F' + Q, because a congruence keeps P >= 0 for any step
 * size while a Runge-Kutta step of the differential equation does not. DSE_EINVAL: t not finite or
 * before the estimate; DSE_EMODEL, DSE_ENONFINITE, DSE_ENOTPD (Q). */
enum dse_status dse_ekf_predict(struct dse_ekf *ekf, dse_real t, const dse_real *u);

/* Corrects the estimate with a sample of the outputs taken at t, the time of the estimate (predict
 * there first). Missing and non-finite channels are left out; when none is left the filter coasts,
 * which is no error. DSE_EINVAL: another t; DSE_EMODEL, DSE_ENONFINITE. */
enum dse_status dse_ekf_update(struct dse_ekf *ekf, dse_real t, const dse_real *u,
                               const struct dse_measurement *measurement);

/* The estimate (nx) at dse_ekf_time; valid until the next call. */
const dse_real *dse_ekf_state(const struct dse_ekf *ekf);
dse_real dse_ekf_time(const struct dse_ekf *ekf);
/* P (nx x nx, both triangles), or its diagonal alone (nx). */
void dse_ekf_covariance(const struct dse_ekf *ekf, dse_real *P);
void dse_ekf_variance(const struct dse_ekf *ekf, dse_real *variance);
/* y - h(predicted x) (ny) of the last update; 0 where no finite value came. */
const dse_real *dse_ekf_innovation(const struct dse_ekf *ekf);
enum dse_channel dse_ekf_channel(const struct dse_ekf *ekf, int j);
/* Channels used in the last update, and their normalised innovation squared e' S^-1 e: chi-square
 * with that many degrees of freedom when the filter is consistent. */
int dse_ekf_used(const struct dse_ekf *ekf);
dse_real dse_ekf_nis(const struct dse_ekf *ekf);
/* Initialising until the first channel is used; coasting after an update without data or two
 * predicts in a row; rejecting when a gate refused a channel in the last update; diverged after a
 * failed step, until one succeeds. */
enum dse_health dse_ekf_health(const struct dse_ekf *ekf);
const struct dse_ekf_counts *dse_ekf_counts(const struct dse_ekf *ekf);

#endif
