/* Differential equations with closed solutions, and the order of convergence of a step on them. */
#ifndef ODE_PROBLEMS_H
#define ODE_PROBLEMS_H

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include <cmocka.h>

#include "dse/math.h"
#include "dse/ode.h"

#define MAX_N 2
#define EPS   DSE_REAL_EPSILON

struct problem {
    const char *name;
    int n;
    enum dse_status (*f)(const struct dse_model *model, dse_real t, const dse_real *x,
                         const dse_real *u, dse_real *dx);
    enum dse_status (*dfdx)(const struct dse_model *model, dse_real t, const dse_real *x,
                            const dse_real *u, dse_real *F);
    void (*exact)(double t, double *x);
    double t1;
};

/* x' = -2 t x^2: x = 1 / (1 + t^2) */
static inline enum dse_status bell_f(const struct dse_model *model, dse_real t, const dse_real *x,
                                     const dse_real *u, dse_real *dx)
{
    (void)model, (void)u;
    dx[0] = -2 * t * x[0] * x[0];
    return DSE_OK;
}

static inline enum dse_status bell_dfdx(const struct dse_model *model, dse_real t,
                                        const dse_real *x, const dse_real *u, dse_real *F)
{
    (void)model, (void)u;
    F[0] = -4 * t * x[0];
    return DSE_OK;
}

static inline void bell_exact(double t, double *x)
{
    x[0] = 1 / (1 + t * t);
}

/* A logistic population that feeds a follower: p' = p (1 - p), q' = p - q^2 + ..., chosen such that
 * p = 1 / (1 + exp(-t)) and q = sin t + 2. */
static inline enum dse_status coupled_f(const struct dse_model *model, dse_real t,
                                        const dse_real *x, const dse_real *u, dse_real *dx)
{
    (void)model, (void)u;
    const dse_real p = dse_sigmoid(t), q = dse_sin(t) + 2;
    dx[0] = x[0] * (1 - x[0]);
    dx[1] = dse_cos(t) + (x[0] - p) - (x[1] * x[1] - q * q);
    return DSE_OK;
}

static inline enum dse_status coupled_dfdx(const struct dse_model *model, dse_real t,
                                           const dse_real *x, const dse_real *u, dse_real *F)
{
    (void)model, (void)u, (void)t;
    F[0] = 1 - 2 * x[0];
    F[1] = 0;
    F[2] = 1;
    F[3] = -2 * x[1];
    return DSE_OK;
}

static inline void coupled_exact(double t, double *x)
{
    x[0] = 1 / (1 + exp(-t));
    x[1] = sin(t) + 2;
}

/* Harmonic oscillator. */
static inline enum dse_status circle_f(const struct dse_model *model, dse_real t, const dse_real *x,
                                       const dse_real *u, dse_real *dx)
{
    (void)model, (void)u, (void)t;
    dx[0] = x[1];
    dx[1] = -x[0];
    return DSE_OK;
}

static inline enum dse_status circle_dfdx(const struct dse_model *model, dse_real t,
                                          const dse_real *x, const dse_real *u, dse_real *F)
{
    (void)model, (void)u, (void)t, (void)x;
    F[0] = F[3] = 0;
    F[1] = 1;
    F[2] = -1;
    return DSE_OK;
}

static inline void circle_exact(double t, double *x)
{
    x[0] = sin(t);
    x[1] = cos(t);
}

static const struct problem problems[] = {
    {"bell", 1, bell_f, bell_dfdx, bell_exact, 2},
    {"coupled", 2, coupled_f, coupled_dfdx, coupled_exact, 3},
    {"circle", 2, circle_f, circle_dfdx, circle_exact, 6},
};
#define N_PROBLEMS (sizeof problems / sizeof problems[0])

static inline struct dse_model model_of(const struct problem *problem)
{
    return (struct dse_model){
        .time = DSE_CONTINUOUS, .nx = problem->n, .f = problem->f, .dfdx = problem->dfdx};
}

static inline void start(const struct problem *problem, double t, dse_real *x)
{
    double exact[MAX_N];
    problem->exact(t, exact);
    for (int j = 0; j < problem->n; j++)
        x[j] = (dse_real)exact[j];
}

static inline double error_at(const struct problem *problem, double t, const dse_real *x)
{
    double exact[MAX_N], worst = 0;
    problem->exact(t, exact);
    for (int j = 0; j < problem->n; j++)
        worst = fmax(worst, fabs((double)x[j] - exact[j]));
    return worst;
}

/* ---- order of fixed steps ---- */

typedef enum dse_status (*model_step)(const struct dse_model *model, dse_real t, dse_real h,
                                      const dse_real *u, dse_real *x, dse_real *scratch);

/* Error at t1 after `steps` equal steps. */
static inline double error_after(const struct problem *problem, const struct dse_model *model,
                                 model_step step, int steps)
{
    dse_real x[MAX_N], scratch[32];
    start(problem, 0, x);
    const dse_real h = (dse_real)(problem->t1 / steps);
    for (int k = 0; k < steps; k++)
        assert_int_equal(step(model, (dse_real)k * h, h, NULL, x, scratch), DSE_OK);
    return error_at(problem, problem->t1, x);
}

/* Halving the step divides the error by 2^order. In float the steps have to be so large, for
 * rounding errors end the convergence early, that the order is not as clear. */
static inline void check_order(const struct problem *problem, const struct dse_model *model,
                               model_step step, int order, int steps)
{
    double coarse = error_after(problem, model, step, steps);
    double fine = error_after(problem, model, step, 2 * steps);
    double found = log2(coarse / fine);
    printf("%-8s order %.3f, error %.1e -> %.1e\n", problem->name, found, coarse, fine);
    assert_true(fabs(found - order) < (sizeof(dse_real) == sizeof(float) ? 0.5 : 0.1));
}

#endif
