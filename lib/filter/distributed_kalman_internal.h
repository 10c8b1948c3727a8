/* What the parts of the distributed Kalman filter share. */
#ifndef DSE_DISTRIBUTED_KALMAN_INTERNAL_H
#define DSE_DISTRIBUTED_KALMAN_INTERNAL_H

#include <stddef.h>

#include "dse/distributed_kalman.h"

/* Ages of a neighbour that is not in use. */
#define DKF_NEVER DSE_REAL(-1) /* it has not been heard yet */
#define DKF_GONE  DSE_REAL(-2) /* it was in use and fell silent */

/* A state [xh; P; W; Gamma] by its parts. */
struct dkf_parts {
    dse_real *x;
    dse_real *P;     /* NULL when K is given */
    dse_real *W;     /* NULL but with LYAPUNOV */
    dse_real *gains; /* n_gains x ny x ny */
};

static inline struct dkf_parts dkf_parts(const struct dse_dkf *dkf, dse_real *state)
{
    const int n = dkf->nx, square = n * n;
    dse_real *P = state + n, *W = P + (dkf->riccati ? square : 0);
    return (struct dkf_parts){.x = state,
                              .P = dkf->riccati ? P : NULL,
                              .W = dkf->lyapunov ? W : NULL,
                              .gains = W + (dkf->lyapunov ? square : 0)};
}

/* ---- products of a few rows and columns ----
 * The kernels of dse/linalg.h pay from this many columns on; below, calling them costs more than
 * the work. A node has 2 to 10 states. */
#define DKF_WIDE 8

/* y (m) = M (m x n) x. */
static inline void dkf_apply(int m, int n, const dse_real *restrict M, const dse_real *restrict x,
                             dse_real *restrict y)
{
    if (n >= DKF_WIDE) {
        dse_mat_vec(m, n, M, x, y);
        return;
    }
    for (int i = 0; i < m; i++) {
        dse_real sum = 0;
        for (int j = 0; j < n; j++)
            sum += M[i * n + j] * x[j];
        y[i] = sum;
    }
}

/* Z (m x n) = X (m x k) Y (k x n). */
static inline void dkf_product(int m, int k, int n, const dse_real *restrict X,
                               const dse_real *restrict Y, dse_real *restrict Z)
{
    if (n >= DKF_WIDE) {
        dse_mat_mul(m, k, n, X, Y, Z);
        return;
    }
    for (int i = 0; i < m; i++) {
        for (int j = 0; j < n; j++) {
            dse_real sum = 0;
            for (int p = 0; p < k; p++)
                sum += X[i * k + p] * Y[p * n + j];
            Z[i * n + j] = sum;
        }
    }
}

/* The next `count` reals of a scratch. */
static inline dse_real *dkf_take(dse_real **scratch, int count)
{
    dse_real *piece = *scratch;
    *scratch += count;
    return piece;
}

/* A (nx x nx) at t where more than f needs it; then dx = f(t, x, u), or A x without an f. */
enum dse_status dkf_plant(const struct dse_dkf *dkf, dse_real t, const dse_real *x, dse_real *A,
                          dse_real *dx);

/* eps = y - C x of the channels that there are, 0 for the others; Cx = C x. */
void dkf_residual(const struct dse_dkf *dkf, const dse_real *x, dse_real *Cx, dse_real *eps);

/* The coupling of a state whose outputs are Cx: q (ny) = sum_j Gamma_ij d_ij over the neighbours in
 * use; and, with dgains not NULL, dgains = beta eps d_ij' - sigma Gamma_ij where neighbour and
 * channel are fresh, else 0. d: scratch of 2 ny. */
void dkf_couple(const struct dse_dkf *dkf, const dse_real *gains, const dse_real *Cx,
                const dse_real *eps, dse_real *d, dse_real *q, dse_real *dgains);
/* The same sum of whole states, s (nx) = sum_j (xh_j - x): STANDARD. */
void dkf_consensus(const struct dse_dkf *dkf, const dse_real *x, dse_real *s);
/* |Gamma| <= limit for every gain of a state. */
void dkf_limit(struct dse_dkf *dkf, dse_real *gains);

/* inverse (ny x ny) = that of R for the channels with has != 0, zero in the rows and columns of the
 * others. scratch: ny x ny. DSE_ENOTPD. */
enum dse_status dkf_invert_noise(int ny, const dse_real *R, const dse_real *has, dse_real *inverse,
                                 dse_real *scratch);

/* A sampled measurement: what a Kalman filter makes of P, and what it is made with. */
struct dkf_update {
    dse_real *K;     /* nx x ny: P C' (w R + C P C')^-1, zero columns for missing channels */
    dse_real *J;     /* nx x nx: I - K C */
    dse_real *M;     /* nx x nx: J P J' + K w R K' (Joseph) */
    dse_real *Kt;    /* ny x nx: K' */
    dse_real *CP;    /* ny x nx */
    dse_real *Z;     /* nx x ny */
    dse_real *S;     /* ny x ny */
    dse_real *noise; /* ny x ny: w R of the channels that there are */
    dse_real *LU;    /* nx x nx */
    dse_real *Cx;    /* ny */
    dse_real *eps;   /* ny */
};
/* Its pieces of the scratch, DSE_DKF_SCRATCH_UPDATE in all; *scratch moves on behind them. */
struct dkf_update dkf_update_in(const struct dse_dkf *dkf, dse_real **scratch);
/* Fills it with the noise w R. DSE_ENOTPD. */
enum dse_status dkf_update_covariance(const struct dse_dkf *dkf, dse_real w, const dse_real *P,
                                      struct dkf_update *update);

enum dse_status dkf_correct_discrete(struct dse_dkf *dkf);
enum dse_status dkf_advance_continuous(struct dse_dkf *dkf);
enum dse_status dkf_advance_predictor(struct dse_dkf *dkf);

#endif
