/* Whether a window of a linear time-varying model can be observed, or excited, as a number: the
 * assumptions that distributed filters make of every node (A, C_i) and of the plant (A, B).
 *
 *     observability      M = int_t0^t1 Phi(t, t0)' C' C Phi(t, t0) dt      (discrete: a sum)
 *     controllability    W = int_t0^t1 Phi(t1, t) G Phi(t1, t)' dt,        G = B B' or B Q B'
 *
 * Integrated with classical Runge-Kutta steps. */
#ifndef DSE_GRAMIAN_H
#define DSE_GRAMIAN_H

#include "dse/model.h"
#include "dse/ode.h"
#include "dse/real.h"
#include "dse/status.h"

struct dse_window {
    const struct dse_model *model; /* dfdx is A(t); called with x = 0 and u = NULL */
    dse_real t0;
    dse_real length; /* t1 - t0 > 0; discrete: not used */
    int steps;       /* >= 1: Runge-Kutta steps; discrete: samples, at t0, t0 + 1, .. */
};

#define DSE_GRAMIAN_SCRATCH(nx, ny)                                                                \
    (2 * (nx) * (nx) + DSE_RK4_SCRATCH(2 * (nx) * (nx)) + 2 * (nx) * (nx) + (ny) * (nx) + (nx))

/* M (nx x nx) of the outputs C x, C ny x nx. DSE_EINVAL, DSE_EMODEL, DSE_ENONFINITE.
 * scratch: DSE_GRAMIAN_SCRATCH(nx, ny). */
enum dse_status dse_observability_gramian(const struct dse_window *window, int ny,
                                          const dse_real *C, dse_real *M, dse_real *scratch);
/* W (nx x nx) of the noise or input intensity G (nx x nx). scratch: DSE_GRAMIAN_SCRATCH(nx, 0). */
enum dse_status dse_controllability_gramian(const struct dse_window *window, const dse_real *G,
                                            dse_real *W, dse_real *scratch);

/* 1 / (|M| |M^-1|) in Frobenius norms: 1 / n for multiples of the identity, 0 when M is singular to
 * working precision. Below the square root of the precision the window says nothing useful about
 * some direction of the state. Depends on the units of the states. scratch: 2 n x n. */
dse_real dse_gramian_quality(int n, const dse_real *M, dse_real *scratch);

#endif
