/* One extended-Kalman-filter step, predict and update, done by several implementations of the same
 * filter. All of them call the same model functions and see the same data. */
#ifndef BENCH_EKF_H
#define BENCH_EKF_H

#ifdef __cplusplus
extern "C" {
#endif

#include "dse/model.h"

#define BENCH_NX_MAX 30
#define BENCH_NY_MAX 10

struct problem {
    struct dse_model model; /* discrete; f and h cost little, F and H are dense and constant */
    dse_real P0[BENCH_NX_MAX * BENCH_NX_MAX];
    dse_real Q[BENCH_NX_MAX * BENCH_NX_MAX];
    dse_real R[BENCH_NY_MAX * BENCH_NY_MAX]; /* diagonal */
};

/* An implementation with its memory inside. step returns 0 when all went well. */
struct contender {
    const char *name;
    int nx, ny; /* 0: any size */
    void (*start)(const struct problem *problem);
    int (*step)(dse_real t, const dse_real *y);
    void (*read)(dse_real *x, dse_real *P);
};

/* Two forms of the covariance update. Symmetric: P - W' W, the cheapest, definite as long as
 * rounding lets it. Joseph: A P A' + K R K', definite but for the rounding of its own products.
 * (The library's factors are definite whatever the rounding.) */
extern const struct contender bench_ekf_dse[1];
extern const struct contender bench_ekf_loops[5];
extern const struct contender bench_ekf_loops_joseph[5];
extern const struct contender bench_ekf_eigen[5];
extern const struct contender bench_ekf_eigen_joseph[5];
extern const struct contender bench_ekf_blasfeo[1];

#ifdef __cplusplus
}
#endif

#endif
