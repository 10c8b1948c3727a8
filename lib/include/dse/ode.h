/* Integration steps with fixed memory for x' = f(t, x, u), u held over the step. */
#ifndef DSE_ODE_H
#define DSE_ODE_H

#include "dse/model.h"
#include "dse/real.h"
#include "dse/status.h"

/* Any right-hand side, so that coupled systems (estimate and covariance) need no dse_model:
 * dx = f(t, x). */
typedef enum dse_status (*dse_ode_rhs)(void *context, dse_real t, const dse_real *x, dse_real *dx);

/* One classical Runge-Kutta step of size h: x(t) -> x(t + h) in place.
 *   x + h/6 (k1 + 2 k2 + 2 k3 + k4)
 * scratch: DSE_RK4_SCRATCH(n) reals. On failure x is unchanged. */
#define DSE_RK4_SCRATCH(n) (3 * (n))
enum dse_status dse_rk4_step(dse_ode_rhs f, void *context, dse_real t, dse_real h, int n,
                             dse_real *x, dse_real *scratch);

/* Same for a model with held input u. */
enum dse_status dse_rk4_model_step(const struct dse_model *model, dse_real t, dse_real h,
                                   const dse_real *u, dse_real *x, dse_real *scratch);

/* Adaptive Dormand-Prince 5(4): x(t0) -> x(t1) in place with local error control
 *   |error_j| <= atol + rtol |x_j|.
 * Fixed memory; at most max_steps steps, then DSE_ENOCONV. */
struct dse_rk45_config {
    dse_real rtol;   /* > 0; 0 means 1e-6 */
    dse_real atol;   /* > 0; 0 means 1e-9 */
    dse_real h0;     /* first step; 0: chosen from the interval */
    int max_steps;   /* 0 means 10000 */
};
struct dse_rk45_result {
    int steps;    /* accepted */
    int rejected; /* repeated with a smaller step */
    dse_real h;   /* the step that it would try next */
};
#define DSE_RK45_SCRATCH(n) (9 * (n))
enum dse_status dse_rk45_integrate(dse_ode_rhs f, void *context,
                                   const struct dse_rk45_config *config, dse_real t0, dse_real t1,
                                   int n, dse_real *x, dse_real *scratch,
                                   struct dse_rk45_result *result);

/* One linearly implicit (Rosenbrock, L-stable, order 2) step for stiff models; needs dfdx:
 *   (I - gamma h J) k1 = f(x),  (I - gamma h J) k2 = f(x + h k1) - 2 k1,  x += h/2 (3 k1 + k2)
 * with gamma = 1 + 1/sqrt 2 or 1 - 1/sqrt 2 (the implementation states which and why).
 * scratch: DSE_ROS2_SCRATCH(n) reals. */
#define DSE_ROS2_SCRATCH(n) ((n) * (n) + 4 * (n) + DSE_ODE_PIVOTS(n))
#define DSE_ODE_PIVOTS(n)   (n)
enum dse_status dse_ros2_step(const struct dse_model *model, dse_real t, dse_real h,
                              const dse_real *u, dse_real *x, dse_real *scratch);

#endif
