/* Second-order (Athans) filter for quadratic systems with sampled outputs, and its two baselines:
 *
 *     x' = d + A x + sum_k e_k x'F_k x + B u            m_k = C x(t_k) + e,  e ~ N(0, R)
 *
 *     w' = d + A w + sum_k e_k (w'F_k w + tr(F_k S)) + B u                             (3.48),
 * (3.55) S' = J(w) S + S J(w)' + Q                                                        (3.49),
 * (3.56) G  = S C'(C S C' + R)^-1,  xh = w + G (m - C w),  Sigma = S - G C S              (3.52),
 * (3.59)
 *
 * S is kept as Z'Z. Between samples L = Z' is integrated, L' = J L, so that any Runge-Kutta step is
 * a congruence; channels enter one by one by Potter's square-root update. S therefore stays
 * positive semidefinite whatever the steps and the rounding are. It may become singular (without Q
 * it decays to 0) and is never inverted.
 *
 *     dse_second_order_predict(&f, t, u);                    now w, S at t
 *     dse_second_order_update(&f, &measurement);             now xh, Sigma
 *
 * Of a system whose certificate holds (dse/quadratic.h), without d, Q and u, |w|^2 + tr S cannot
 * grow between samples; the extended Kalman filter promises that of |w|^2 alone.
 *
 * A predict or update that fails leaves the estimate as it was. Equation numbers are those of the
 * consensus-based second-order observers source, sections those of its spec. */
#ifndef DSE_SECOND_ORDER_H
#define DSE_SECOND_ORDER_H

#include <stdbool.h>

#include "dse/arena.h"
#include "dse/factored.h"
#include "dse/health.h"
#include "dse/model.h"
#include "dse/ode.h"
#include "dse/quadratic.h"
#include "dse/real.h"
#include "dse/status.h"

/* What predicts mean and covariance. */
enum dse_second_order_kind {
    DSE_SECOND_ORDER = 0,          /* with the trace term */
    DSE_SECOND_ORDER_EXTENDED = 1, /* without: an extended Kalman filter */
    /* 2 nx points w +- sqrt(nx) columns of S^(1/2) of equal weight through the plant's equations
     * (section 4.8), those of its eigenvectors, which Z is rotated into whether S is singular or
     * not. Q adds its integral over the interval at the end. */
    DSE_SECOND_ORDER_UNSCENTED = 2
};

/* Config, model and all that they point to must outlive the filter. Zero is the default where one
 * is named. */
struct dse_second_order_config {
    const struct dse_model *model; /* of dse_quadratic_model */
    int ny;                        /* own outputs, >= 0; not used when C is NULL */
    const dse_real *C;             /* ny x nx; NULL: the model's ny and C */
    enum dse_second_order_kind kind;

    dse_real t0;        /* time of x0; default 0 */
    const dse_real *x0; /* nx: first estimate; NULL: zero */
    const dse_real *S0; /* nx x nx: its covariance, positive semidefinite */
    const dse_real *Q;  /* nx x nx: intensity of process noise, positive semidefinite; NULL: none.
                         * For truncated models: without it S -> 0 and data are ignored at last */
    const dse_real *R;  /* ny x ny, positive definite */

    /* A channel whose innovation exceeds this many standard deviations of its prior distribution is
     * rejected. > 0; 0 (default): no gate. */
    dse_real gate;

    /* Integration. substeps = 0 (default): Dormand-Prince with rtol and atol (of w and of L), at
     * most max_steps steps. substeps > 0: that many Runge-Kutta steps of order 4 for each predict,
     * each halved again while  |w| h |F| > 1/10, or, where it cannot grow, |w|^2 + tr S has grown;
     * coarse steps after a bad update are where NaN comes from. */
    int substeps;
    dse_real rtol; /* > 0; 0 means 1e-8, float: 1e-5 */
    dse_real atol; /* > 0; 0 means 1e-10, float: 1e-7 */
    int max_steps; /* > 0, of an integration, halved ones included; 0 means 10000 */
};

/* Totals since init. */
struct dse_second_order_counts {
    long predictions; /* successful */
    long updates;     /* successful, with or without data */
    long used;        /* channels */
    long missing;     /* channels flagged invalid */
    long nonfinite;   /* channels flagged valid, but NaN or infinite: treated as missing */
    long rejected;    /* channels outside the gate */
    long halved;      /* Runge-Kutta steps that the guard halved */
    long failed;      /* predicts and updates that left the estimate as it was */
};

struct dse_second_order {
    const struct dse_second_order_config *config;
    const struct dse_quadratic *system;
    const dse_real *C; /* ny x nx */
    int nx, ny;
    dse_real time;
    dse_real *x;      /* nx */
    dse_real *Z;      /* nx x nx: S = Z'Z */
    dse_real *x_next; /* filled by a step and exchanged for the above on success */
    dse_real *Z_next;
    dse_real *S;          /* nx x nx: of the present Z */
    dse_real *y;          /* ny: the measurement at hand */
    dse_real *has;        /* ny: 1 where there is a value that is used, else 0 */
    dse_real *innovation; /* ny: m - C w, 0 where there is no value */
    dse_real *scratch;
    dse_real form; /* |F|: |q(x)| <= |F| |x|^2 */
    bool R_diagonal;
    bool bounded;                       /* the certificate holds, and there is neither d nor Q */
    struct dse_rk45_config integration; /* adaptive; h0: the step that the last one ended with */
    struct dse_rk45_result integrated;
    bool predicted; /* the last successful step was a predict */
    int used;       /* channels of the last update */
    bool rejected;  /* a channel of the last update was */
    enum dse_health health;
    struct dse_second_order_counts counts;
};

#define DSE_SECOND_ORDER_LARGER(a, b) ((a) > (b) ? (a) : (b))
/* [w; L; the part of S that Q makes] while it is integrated. */
#define DSE_SECOND_ORDER_INTEGRATED(nx) ((nx) + 2 * (nx) * (nx))
#define DSE_SECOND_ORDER_SCRATCH_PREDICT(nx)                                                       \
    (DSE_SECOND_ORDER_INTEGRATED(nx) + DSE_RK45_SCRATCH(DSE_SECOND_ORDER_INTEGRATED(nx)) +         \
     3 * (nx) * (nx))
#define DSE_SECOND_ORDER_SCRATCH_UPDATE(nx, ny)                                                    \
    (4 * (nx) * (nx) + 2 * (nx) + (nx) * (ny) + 2 * (ny) * (ny) + (ny))
#define DSE_SECOND_ORDER_SCRATCH(nx, ny)                                                           \
    DSE_SECOND_ORDER_LARGER(DSE_SECOND_ORDER_SCRATCH_PREDICT(nx),                                  \
                            DSE_SECOND_ORDER_SCRATCH_UPDATE(nx, ny))
/* Reals that dse_second_order_init takes. */
#define DSE_SECOND_ORDER_STORAGE(nx, ny)                                                           \
    (2 * (nx) + 3 * (nx) * (nx) + 3 * (ny) + DSE_SECOND_ORDER_SCRATCH(nx, ny))

/* DSE_EINVAL: a value outside its range, a model that is not quadratic, a matrix that is missing or
 * not symmetric; DSE_ENOTPD: S0, Q, R; DSE_ENONFINITE; DSE_ESTORAGE. */
enum dse_status dse_second_order_init(struct dse_second_order *filter,
                                      const struct dse_second_order_config *config,
                                      struct dse_arena *arena);

/* Sets the estimate anew, e.g. after a fusion or a divergence. S (nx x nx) positive semidefinite;
 * NULL: stays. DSE_ENOTPD, DSE_ENONFINITE, DSE_EINVAL (not symmetric): nothing has changed. */
enum dse_status dse_second_order_set(struct dse_second_order *filter, dse_real t, const dse_real *x,
                                     const dse_real *S);

/* To time t with the input u (nu, held; NULL when there is none). DSE_EINVAL: t not finite or
 * before the estimate; DSE_ENONFINITE; DSE_ENOCONV: too many steps; DSE_ENOTPD: steps too
 * coarse for Q. */
enum dse_status dse_second_order_predict(struct dse_second_order *filter, dse_real t,
                                         const dse_real *u);

/* Corrects with a sample of the outputs taken at dse_second_order_time. Missing and non-finite
 * channels are left out; when none is left the filter coasts, which is no error.
 * DSE_ENONFINITE. */
enum dse_status dse_second_order_update(struct dse_second_order *filter,
                                        const struct dse_measurement *measurement);

/* ---- read-only; valid until the next call ---- */

dse_real dse_second_order_time(const struct dse_second_order *filter);
const dse_real *dse_second_order_state(const struct dse_second_order *filter);      /* nx */
const dse_real *dse_second_order_covariance(const struct dse_second_order *filter); /* nx x nx */
/* ny: m - C w of the last update, 0 where there was no value. */
const dse_real *dse_second_order_innovation(const struct dse_second_order *filter);
/* Channels used in the last update. */
int dse_second_order_used(const struct dse_second_order *filter);
/* Initialising until the first channel is used; coasting after an update without data or two
 * predicts in a row; rejecting when the gate refused a channel in the last update; diverged after a
 * failed step, until one succeeds. */
enum dse_health dse_second_order_health(const struct dse_second_order *filter);
const struct dse_second_order_counts *
dse_second_order_counts(const struct dse_second_order *filter);

#endif
