/* A linear system with bounded states and disturbances, its windows, and who estimates them:
 *
 *     x(k+1) = A x(k) + w,  y(k) = C x(k) + v,   Q = R = I,   |x_i| <= x_max,  |w_i| <= w_max
 *
 * over the last N samples, without arrival cost. */
#ifndef BENCH_MHE_BOUNDED_H
#define BENCH_MHE_BOUNDED_H

#include <stdbool.h>

enum { NX_MAX = 30, NY_MAX = 10, N_MAX = 20, UNKNOWNS_MAX = 300, SAMPLES = 256 };

struct windows {
    int n, m, N;
    double A[NX_MAX * NX_MAX], C[NY_MAX * NX_MAX];
    double x_max, w_max;
    double y[SAMPLES][NY_MAX];
};

/* Samples of the window that ends with sample k; they come round again. */
static inline const double *window_sample(const struct windows *w, long k)
{
    return w->y[(k % SAMPLES + SAMPLES) % SAMPLES];
}

struct contender {
    const char *name;
    /* Allocates what it needs; the window is then that of samples 0 .. N-1. */
    bool (*make)(const struct windows *w);
    /* The next sample comes, the window is solved. */
    bool (*step)(const struct windows *w);
    const double *(*solution)(void); /* N x n: states, oldest first */
    double (*effort)(void);          /* of the last solution: active bounds or iterations */
    void (*drop)(void);
};

extern const struct contender bench_mhe_estimator, bench_mhe_window_qp;
#ifdef BENCH_HPIPM
extern const struct contender bench_mhe_hpipm;
#endif
#ifdef BENCH_OSQP
extern const struct contender bench_mhe_osqp;
#endif
#ifdef BENCH_DAQP
extern const struct contender bench_mhe_daqp;
#endif

/* ---- for those who want it as one programme in the states (bench_mhe_window_qp.c) ---- */

struct dse_window_qp_problem;
/* P and the bounds of the full window. */
void bench_window_problem(const struct windows *w, struct dse_window_qp_problem *problem);
/* c (N x n) of the window that ends with sample k. */
void bench_window_linear(const struct windows *w, long k, double *c);

#endif
