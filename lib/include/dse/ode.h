/* Integration steps with fixed memory for x' = f(t, x, u), u held over the step.
 *
 * Every function leaves x unchanged when it fails, and never writes x before it has succeeded, so
 * that f may read the x that it is called for. Scratch needs no initialisation and keeps nothing
 * from call to call. What f answers other than DSE_OK is handed through. */
#ifndef DSE_ODE_H
#define DSE_ODE_H

#include "dse/model.h"
#include "dse/real.h"
#include "dse/status.h"

/* Any right-hand side, so that coupled systems (estimate and covariance) need no dse_model:
 * dx = f(t, x). */
typedef enum dse_status (*dse_ode_rhs)(void *context, dse_real t, const dse_real *x, dse_real *dx);

/* A continuous model with held input as such a right-hand side: context is a
 * `struct dse_held_model *`. */
struct dse_held_model {
    const struct dse_model *model;
    const dse_real *u; /* nu, NULL when nu = 0 */
};
enum dse_status dse_held_model_rhs(void *context, dse_real t, const dse_real *x, dse_real *dx);

/* One classical Runge-Kutta step of size h: x(t) -> x(t + h) in place.
 *   x + h/6 (k1 + 2 k2 + 2 k3 + k4)
 * scratch: DSE_RK4_SCRATCH(n) reals. DSE_ENONFINITE when the new x is not finite. */
#define DSE_RK4_SCRATCH(n) (3 * (n))
enum dse_status dse_rk4_step(dse_ode_rhs f, void *context, dse_real t, dse_real h, int n,
                             dse_real *x, dse_real *scratch);

/* Same for a model with held input u; DSE_EINVAL for a discrete model. */
enum dse_status dse_rk4_model_step(const struct dse_model *model, dse_real t, dse_real h,
                                   const dse_real *u, dse_real *x, dse_real *scratch);

/* Adaptive Dormand-Prince 5(4): x(t0) -> x(t1) in place with local error control
 *   |error_j| <= atol + rtol max(|x_j|, |new x_j|)   for each state and step.
 * t1 may lie before t0. A step into a region where f fails (DSE_EMODEL) or is not finite is
 * repeated with a fifth of its size.
 *
 * Errors: DSE_EINVAL (negative or non-finite setting, n < 1), DSE_ENONFINITE (t0, t1 or x),
 * DSE_ENOCONV (max_steps, or the step has become too small to move t) - or DSE_EMODEL or
 * DSE_ENONFINITE when that is why the steps became so small. */
struct dse_rk45_config {
    dse_real rtol; /* > 0; 0 means 1e-6 */
    dse_real atol; /* > 0, in the units of x; 0 means 1e-9 */
    dse_real h0;   /* first step, > 0; 0: from the size of x and f(x), at most t1 - t0 */
    int max_steps; /* tried steps, accepted or not, > 0; 0 means 10000 */
};
struct dse_rk45_result {
    int steps;    /* accepted */
    int rejected; /* repeated with a smaller step */
    dse_real h;   /* size of the step that it would try next: the h0 of a next call */
};
#define DSE_RK45_SCRATCH(n) (9 * (n))
/* config may be NULL (defaults); result may be NULL and is written on failure as well. */
enum dse_status dse_rk45_integrate(dse_ode_rhs f, void *context,
                                   const struct dse_rk45_config *config, dse_real t0, dse_real t1,
                                   int n, dse_real *x, dse_real *scratch,
                                   struct dse_rk45_result *result);

/* One linearly implicit step for stiff models, ROS2 of Verwer, Spee, Blom and Hundsdorfer (SIAM J.
 * Sci. Comput. 20, 1999); needs dfdx:
 *   (I - gamma h J) k1 = f(t, x)
 *   (I - gamma h J) k2 = f(t + h, x + h k1) - 2 k1
 *   x += h/2 (3 k1 + k2),      gamma = 1 - 1/sqrt 2
 * L-stable. Order 2 with any matrix J, so an approximate dfdx costs accuracy but not order. A stiff
 * f that depends on t itself costs more: its error is of order h, for dse_model has no df/dt.
 * gamma = 1 + 1/sqrt 2 would be L-stable as well, and its stages overshoot less, but its error is
 * 34 times larger.
 *
 * Errors: DSE_EINVAL (discrete model or no dfdx), DSE_ESINGULAR, DSE_ENONFINITE, what f and dfdx
 * answer. scratch: DSE_ROS2_SCRATCH(n) reals. */
#define DSE_ROS2_SCRATCH(n) ((n) * (n) + 3 * (n) + DSE_ODE_PIVOTS(n))
#define DSE_ODE_PIVOTS(n)   (n)
enum dse_status dse_ros2_step(const struct dse_model *model, dse_real t, dse_real h,
                              const dse_real *u, dse_real *x, dse_real *scratch);

#endif
