/* A process model as functions, shared by estimators, simulator and tests.
 *
 *     continuous   x' = f(t, x, u)            y = h(t, x, u)
 *     discrete     x(k+1) = f(t_k, x(k), u(k))    y(k) = h(t_k, x(k), u(k))
 *
 * Time is in the plant's own unit (hours for a plant whose rates are per hour). All matrices are
 * row-major. A function that cannot be evaluated at a point returns DSE_EMODEL and need not have
 * written its output. */
#ifndef DSE_MODEL_H
#define DSE_MODEL_H

#include <stdbool.h>

#include "dse/real.h"
#include "dse/status.h"

enum dse_time_kind { DSE_CONTINUOUS = 0, DSE_DISCRETE = 1 };

struct dse_model {
    enum dse_time_kind time; /* meaning of f and dfdx */
    int nx;                  /* states, > 0 */
    int nu;                  /* known inputs, >= 0; u may be NULL when 0 */
    int ny;                  /* outputs, >= 0 */
    const void *parameters;  /* what the functions need to know; must outlive the model */

    /* dx (nx): derivative, or next state of a discrete model. */
    enum dse_status (*f)(const struct dse_model *model, dse_real t, const dse_real *x,
                         const dse_real *u, dse_real *dx);
    /* y (ny). */
    enum dse_status (*h)(const struct dse_model *model, dse_real t, const dse_real *x,
                         const dse_real *u, dse_real *y);
    /* F (nx x nx) = df/dx. NULL: the model offers no Jacobian. */
    enum dse_status (*dfdx)(const struct dse_model *model, dse_real t, const dse_real *x,
                            const dse_real *u, dse_real *F);
    /* H (ny x nx) = dh/dx. NULL: the model offers no Jacobian. */
    enum dse_status (*dhdx)(const struct dse_model *model, dse_real t, const dse_real *x,
                            const dse_real *u, dse_real *H);
    /* dx (count x nx) at `count` states x (count x nx), each with the bits of f: for many
     * predictions side by side. Fails when f fails at one of them. NULL: f is called for each. */
    enum dse_status (*f_many)(const struct dse_model *model, dse_real t, int count,
                              const dse_real *x, const dse_real *u, dse_real *dx);
};

/* A sample of the outputs as it comes from life: any channel may be missing. */
struct dse_measurement {
    const dse_real *y; /* ny values, in the model's output units */
    const bool *valid; /* ny flags; NULL: all valid. A NaN or infinite y counts as missing. */
};

/* True when channel j is flagged valid and finite. */
bool dse_measurement_has(const struct dse_measurement *measurement, int j);

/* Largest relative deviation of dfdx and dhdx from central differences at (t, x, u), for tests and
 * for checking a plant of one's own:
 *
 *     |J_ij - D_ij| / (max(|J_ij|, |D_ij|) + floor_ij)
 *     floor_ij = eps^(1/3) max_l |D_il s_l| / s_j
 *
 * with s_j = |x_j|, or 1 where x_j = 0, and steps eps^(1/3) s_j: an entry is judged by its own
 * size, unless its effect on f_i is so small beside that of the others that differences cannot
 * resolve it. A right Jacobian gives about 1e-5 (float: 1e-2) or less, a wrong one of order 1.
 * Choose a point where the states have ordinary sizes.
 *
 * A NULL result is not asked for. DSE_EINVAL when the Jacobian asked for is NULL; otherwise what
 * the model answers, or DSE_ENONFINITE. scratch: DSE_MODEL_CHECK_SCRATCH(nx, ny) reals. */
#define DSE_MODEL_CHECK_SCRATCH(nx, ny) (((nx) > (ny) ? (nx) : (ny)) * (2 * (nx) + 2) + (nx))
enum dse_status dse_model_check_jacobians(const struct dse_model *model, dse_real t,
                                          const dse_real *x, const dse_real *u, dse_real *scratch,
                                          dse_real *worst_f, dse_real *worst_h);

/* The linear model x' = A x + B u (or x(k+1) = A x + B u), y = C x + D u as a dse_model. */
struct dse_linear {
    const dse_real *A; /* nx x nx */
    const dse_real *B; /* nx x nu; NULL when nu = 0 */
    const dse_real *C; /* ny x nx */
    const dse_real *D; /* ny x nu; NULL: zero */
};
/* Fills `model`; `linear` and its matrices must outlive it. */
void dse_linear_model(struct dse_model *model, enum dse_time_kind time, int nx, int nu, int ny,
                      const struct dse_linear *linear);

/* A linear process around its operating point o, with a part that swings in time:
 *
 *     continuous   x'     = A(t) (x - o) + B u           A(t) = A + A_s sin(omega t)
 *     discrete     x(k+1) = o + A(t_k) (x - o) + B u
 *                  y      = C x + D u
 *
 * so that states and outputs are what the process shows and u is the deviation of its inputs. */
struct dse_linear_process {
    struct dse_linear linear;
    const dse_real *origin; /* o, nx; NULL: zero */
    const dse_real *swing;  /* A_s, nx x nx; NULL: zero */
    dse_real omega;         /* rad per unit of time */
};
/* Fills `model`; `process` and its matrices must outlive it. */
void dse_linear_process_model(struct dse_model *model, enum dse_time_kind time, int nx, int nu,
                              int ny, const struct dse_linear_process *process);

#endif
