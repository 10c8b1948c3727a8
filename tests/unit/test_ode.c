/* Steppers: order of convergence, agreement with closed solutions, step control, stiffness, and x
 * unchanged after every failure. */
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

/* ---- problems with closed solutions ---- */

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
static enum dse_status bell_f(const struct dse_model *model, dse_real t, const dse_real *x,
                              const dse_real *u, dse_real *dx)
{
    (void)model, (void)u;
    dx[0] = -2 * t * x[0] * x[0];
    return DSE_OK;
}

static enum dse_status bell_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                 const dse_real *u, dse_real *F)
{
    (void)model, (void)u;
    F[0] = -4 * t * x[0];
    return DSE_OK;
}

static void bell_exact(double t, double *x)
{
    x[0] = 1 / (1 + t * t);
}

/* A logistic population that feeds a follower: p' = p (1 - p), q' = p - q^2 + ..., chosen such that
 * p = 1 / (1 + exp(-t)) and q = sin t + 2. */
static enum dse_status coupled_f(const struct dse_model *model, dse_real t, const dse_real *x,
                                 const dse_real *u, dse_real *dx)
{
    (void)model, (void)u;
    const dse_real p = dse_sigmoid(t), q = dse_sin(t) + 2;
    dx[0] = x[0] * (1 - x[0]);
    dx[1] = dse_cos(t) + (x[0] - p) - (x[1] * x[1] - q * q);
    return DSE_OK;
}

static enum dse_status coupled_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                    const dse_real *u, dse_real *F)
{
    (void)model, (void)u, (void)t;
    F[0] = 1 - 2 * x[0];
    F[1] = 0;
    F[2] = 1;
    F[3] = -2 * x[1];
    return DSE_OK;
}

static void coupled_exact(double t, double *x)
{
    x[0] = 1 / (1 + exp(-t));
    x[1] = sin(t) + 2;
}

/* Harmonic oscillator. */
static enum dse_status circle_f(const struct dse_model *model, dse_real t, const dse_real *x,
                                const dse_real *u, dse_real *dx)
{
    (void)model, (void)u, (void)t;
    dx[0] = x[1];
    dx[1] = -x[0];
    return DSE_OK;
}

static enum dse_status circle_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                   const dse_real *u, dse_real *F)
{
    (void)model, (void)u, (void)t, (void)x;
    F[0] = F[3] = 0;
    F[1] = 1;
    F[2] = -1;
    return DSE_OK;
}

static void circle_exact(double t, double *x)
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

static struct dse_model model_of(const struct problem *problem)
{
    return (struct dse_model){
        .time = DSE_CONTINUOUS, .nx = problem->n, .f = problem->f, .dfdx = problem->dfdx};
}

static void start(const struct problem *problem, double t, dse_real *x)
{
    double exact[MAX_N];
    problem->exact(t, exact);
    for (int j = 0; j < problem->n; j++)
        x[j] = (dse_real)exact[j];
}

static double error_at(const struct problem *problem, double t, const dse_real *x)
{
    double exact[MAX_N], worst = 0;
    problem->exact(t, exact);
    for (int j = 0; j < problem->n; j++)
        worst = fmax(worst, fabs((double)x[j] - exact[j]));
    return worst;
}

/* ---- fixed steps: order ---- */

typedef enum dse_status (*model_step)(const struct dse_model *model, dse_real t, dse_real h,
                                      const dse_real *u, dse_real *x, dse_real *scratch);

/* Error at t1 after `steps` equal steps. */
static double error_after(const struct problem *problem, const struct dse_model *model,
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
static void check_order(const struct problem *problem, const struct dse_model *model,
                        model_step step, int order, int steps)
{
    double coarse = error_after(problem, model, step, steps);
    double fine = error_after(problem, model, step, 2 * steps);
    double found = log2(coarse / fine);
    printf("%-8s order %.3f, error %.1e -> %.1e\n", problem->name, found, coarse, fine);
    assert_true(fabs(found - order) < (sizeof(dse_real) == sizeof(float) ? 0.5 : 0.1));
}

static void rk4_converges_with_order_four(void **state)
{
    (void)state;
    static const int steps_double[] = {64, 192, 64}, steps_float[] = {9, 18, 9};
    const int *steps = sizeof(dse_real) == sizeof(float) ? steps_float : steps_double;
    for (size_t i = 0; i < N_PROBLEMS; i++) {
        struct dse_model model = model_of(&problems[i]);
        check_order(&problems[i], &model, dse_rk4_model_step, 4, steps[i]);
    }
}

static void ros2_converges_with_order_two(void **state)
{
    (void)state;
    const int steps = sizeof(dse_real) == sizeof(float) ? 40 : 400;
    for (size_t i = 0; i < N_PROBLEMS; i++) {
        struct dse_model model = model_of(&problems[i]);
        check_order(&problems[i], &model, dse_ros2_step, 2, steps);
    }
}

static enum dse_status rough_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                  const dse_real *u, dse_real *F)
{
    (void)t, (void)x, (void)u;
    for (int i = 0; i < model->nx * model->nx; i++)
        F[i] = DSE_REAL(-0.3) + DSE_REAL(0.1) * (dse_real)i;
    return DSE_OK;
}

static void ros2_keeps_order_two_with_a_wrong_jacobian(void **state)
{
    (void)state;
    const int steps = sizeof(dse_real) == sizeof(float) ? 60 : 800;
    for (size_t i = 0; i < N_PROBLEMS; i++) {
        struct dse_model model = model_of(&problems[i]);
        model.dfdx = rough_dfdx;
        check_order(&problems[i], &model, dse_ros2_step, 2, steps);
    }
}

/* ---- RK4 ---- */

/* x + h/6 (k1 + 2 k2 + 2 k3 + k4), written out. */
static void rk4_is_the_textbook_formula(void **state)
{
    (void)state;
    struct dse_model model = model_of(&problems[1]);
    dse_real x[2] = {DSE_REAL(0.3), DSE_REAL(1.7)}, k1[2], k2[2], k3[2], k4[2], s[2], expected[2];
    const dse_real t = DSE_REAL(0.7), h = DSE_REAL(0.2);
    model.f(&model, t, x, NULL, k1);
    for (int j = 0; j < 2; j++)
        s[j] = x[j] + h / 2 * k1[j];
    model.f(&model, t + h / 2, s, NULL, k2);
    for (int j = 0; j < 2; j++)
        s[j] = x[j] + h / 2 * k2[j];
    model.f(&model, t + h / 2, s, NULL, k3);
    for (int j = 0; j < 2; j++)
        s[j] = x[j] + h * k3[j];
    model.f(&model, t + h, s, NULL, k4);
    for (int j = 0; j < 2; j++)
        expected[j] = x[j] + h / 6 * (k1[j] + 2 * k2[j] + 2 * k3[j] + k4[j]);

    dse_real scratch[DSE_RK4_SCRATCH(2)];
    assert_int_equal(dse_rk4_model_step(&model, t, h, NULL, x, scratch), DSE_OK);
    for (int j = 0; j < 2; j++)
        assert_true(dse_abs(x[j] - expected[j]) <= 4 * EPS * dse_abs(expected[j]));
}

static enum dse_status input_f(const struct dse_model *model, dse_real t, const dse_real *x,
                               const dse_real *u, dse_real *dx)
{
    (void)t, (void)x;
    for (int j = 0; j < model->nx; j++)
        dx[j] = u[j];
    return DSE_OK;
}

static enum dse_status zero_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                 const dse_real *u, dse_real *F)
{
    (void)t, (void)x, (void)u;
    for (int i = 0; i < model->nx * model->nx; i++)
        F[i] = 0;
    return DSE_OK;
}

static void input_is_held_over_the_step(void **state)
{
    (void)state;
    const struct dse_model model = {
        .time = DSE_CONTINUOUS, .nx = 2, .nu = 2, .f = input_f, .dfdx = zero_dfdx};
    const dse_real u[2] = {3, -5};
    dse_real scratch[32];
    const model_step steps[] = {dse_rk4_model_step, dse_ros2_step};
    for (int i = 0; i < 2; i++) {
        dse_real x[2] = {1, 1};
        assert_int_equal(steps[i](&model, 0, DSE_REAL(0.5), u, x, scratch), DSE_OK);
        assert_true(dse_abs(x[0] - DSE_REAL(2.5)) <= 4 * EPS);
        assert_true(dse_abs(x[1] + DSE_REAL(1.5)) <= 4 * EPS);
    }
}

static void discrete_models_are_refused(void **state)
{
    (void)state;
    struct dse_model model = model_of(&problems[0]);
    model.time = DSE_DISCRETE;
    dse_real x[1] = {1}, scratch[32];
    assert_int_equal(dse_rk4_model_step(&model, 0, 1, NULL, x, scratch), DSE_EINVAL);
    assert_int_equal(dse_ros2_step(&model, 0, 1, NULL, x, scratch), DSE_EINVAL);
    model.time = DSE_CONTINUOUS;
    model.dfdx = NULL;
    assert_int_equal(dse_ros2_step(&model, 0, 1, NULL, x, scratch), DSE_EINVAL);
    assert_true(x[0] == 1);
}

/* ---- failures ---- */

/* dx = -x, but the call number `fails_at` (from 1) ends otherwise. */
struct saboteur {
    int calls, fails_at;
    enum dse_status status; /* what it answers then; DSE_OK: a NaN derivative instead */
};

static enum dse_status sabotaged_f(const struct dse_model *model, dse_real t, const dse_real *x,
                                   const dse_real *u, dse_real *dx)
{
    (void)t, (void)u;
    struct saboteur *saboteur = *(struct saboteur *const *)model->parameters;
    dx[0] = -x[0];
    dx[1] = -x[1];
    if (++saboteur->calls == saboteur->fails_at) {
        dx[1] = (dse_real)NAN;
        return saboteur->status;
    }
    return DSE_OK;
}

static enum dse_status failing_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                    const dse_real *u, dse_real *F)
{
    (void)model, (void)t, (void)x, (void)u;
    F[0] = 0;
    return DSE_EMODEL;
}

static enum dse_status nan_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                const dse_real *u, dse_real *F)
{
    (void)t, (void)x, (void)u;
    for (int i = 0; i < model->nx * model->nx; i++)
        F[i] = (dse_real)NAN;
    return DSE_OK;
}

static void check_sabotaged_step(model_step step, int stages, int fails_at, enum dse_status answer)
{
    struct saboteur saboteur = {0, fails_at, answer}, *parameters = &saboteur;
    const struct dse_model model = {.time = DSE_CONTINUOUS,
                                    .nx = 2,
                                    .parameters = &parameters,
                                    .f = sabotaged_f,
                                    .dfdx = zero_dfdx};
    dse_real x[2] = {1, 2}, scratch[32];
    enum dse_status status = step(&model, 0, DSE_REAL(0.1), NULL, x, scratch);
    if (fails_at > stages) { /* not reached: the step is as good as ever */
        assert_int_equal(status, DSE_OK);
        assert_true(x[0] != 1 && x[1] != 2);
    } else {
        assert_int_equal(status, answer == DSE_OK ? DSE_ENONFINITE : answer);
        assert_true(x[0] == 1 && x[1] == 2);
    }
}

static void a_failed_step_leaves_x_unchanged(void **state)
{
    (void)state;
    const enum dse_status answers[] = {DSE_EMODEL, DSE_EINVAL, DSE_OK};
    for (int i = 0; i < 3; i++) {
        for (int fails_at = 1; fails_at <= 5; fails_at++)
            check_sabotaged_step(dse_rk4_model_step, 4, fails_at, answers[i]);
        for (int fails_at = 1; fails_at <= 3; fails_at++)
            check_sabotaged_step(dse_ros2_step, 2, fails_at, answers[i]);
    }
}

static enum dse_status constant_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                     const dse_real *u, dse_real *F)
{
    (void)t, (void)x, (void)u;
    F[0] = *(const dse_real *)model->parameters;
    return DSE_OK;
}

static void ros2_reports_what_is_wrong_with_its_matrix(void **state)
{
    (void)state;
    struct dse_model model = model_of(&problems[2]);
    dse_real x[2] = {1, 2}, scratch[DSE_ROS2_SCRATCH(2)];
    model.dfdx = failing_dfdx;
    assert_int_equal(dse_ros2_step(&model, 0, 1, NULL, x, scratch), DSE_EMODEL);
    model.dfdx = nan_dfdx;
    assert_int_equal(dse_ros2_step(&model, 0, 1, NULL, x, scratch), DSE_ENONFINITE);
    assert_true(x[0] == 1 && x[1] == 2);

    /* gamma h J = 1 exactly for one of the numbers around 1/gamma = 2 + sqrt 2 */
    int singular = 0;
    for (int ulps = -4; ulps <= 4; ulps++) {
        const dse_real J = DSE_REAL(3.41421356237309505) + 2 * EPS * (dse_real)ulps;
        struct dse_model scalar = model_of(&problems[0]);
        scalar.dfdx = constant_dfdx;
        scalar.parameters = &J;
        dse_real before = x[0];
        enum dse_status status = dse_ros2_step(&scalar, 1, 1, NULL, x, scratch);
        if (status == DSE_ESINGULAR)
            assert_true(x[0] == before);
        singular += status == DSE_ESINGULAR;
        x[0] = before;
    }
    assert_true(singular > 0);
}

/* ---- stiffness ---- */

struct stiff {
    dse_real lambda;
};

/* x' = lambda (x - cos t) - sin t: x = cos t + (x0 - 1) exp(lambda t) */
static enum dse_status forced_f(const struct dse_model *model, dse_real t, const dse_real *x,
                                const dse_real *u, dse_real *dx)
{
    (void)u;
    const struct stiff *stiff = model->parameters;
    dx[0] = stiff->lambda * (x[0] - dse_cos(t)) - dse_sin(t);
    return DSE_OK;
}

/* x1' = lambda (x1 - x2^2) - 2 x2^2, x2' = -x2: x1 goes to x2^2 at once and stays there. */
static enum dse_status slow_f(const struct dse_model *model, dse_real t, const dse_real *x,
                              const dse_real *u, dse_real *dx)
{
    (void)t, (void)u;
    const struct stiff *stiff = model->parameters;
    const dse_real square = x[1] * x[1];
    dx[0] = stiff->lambda * (x[0] - square) - 2 * square;
    dx[1] = -x[1];
    return DSE_OK;
}

static enum dse_status slow_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                 const dse_real *u, dse_real *F)
{
    (void)t, (void)u;
    const struct stiff *stiff = model->parameters;
    F[0] = stiff->lambda;
    F[1] = -2 * stiff->lambda * x[1] - 4 * x[1];
    F[2] = 0;
    F[3] = -1;
    return DSE_OK;
}

static enum dse_status decay_f(const struct dse_model *model, dse_real t, const dse_real *x,
                               const dse_real *u, dse_real *dx)
{
    (void)u, (void)t;
    const struct stiff *stiff = model->parameters;
    dx[0] = stiff->lambda * x[0];
    return DSE_OK;
}

static enum dse_status stiff_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                  const dse_real *u, dse_real *F)
{
    (void)x, (void)u, (void)t;
    const struct stiff *stiff = model->parameters;
    F[0] = stiff->lambda;
    return DSE_OK;
}

/* One step multiplies x by R(z) = (1 + (1 - 2 gamma) z) / (1 - gamma z)^2, z = h lambda, which goes
 * to zero for z -> -infinity. */
static void ros2_damps_as_its_stability_function_says(void **state)
{
    (void)state;
    const double gamma = 1 - sqrt(0.5);
    for (int decade = -2; decade <= 8; decade++) {
        const double z = -pow(10, decade);
        const struct stiff stiff = {(dse_real)z};
        const struct dse_model model = {.time = DSE_CONTINUOUS,
                                        .nx = 1,
                                        .parameters = &stiff,
                                        .f = decay_f,
                                        .dfdx = stiff_dfdx};
        dse_real x[1] = {1}, scratch[DSE_ROS2_SCRATCH(1)];
        assert_int_equal(dse_ros2_step(&model, 0, 1, NULL, x, scratch), DSE_OK);
        double expected = (1 + (1 - 2 * gamma) * z) / ((1 - gamma * z) * (1 - gamma * z));
        /* x + h/2 (3 k1 + k2) cancels terms of size 2/gamma */
        assert_true(fabs((double)x[0] - expected) < 50 * (double)EPS);
    }
}

static void ros2_follows_the_slow_solution_with_h_lambda_of_minus_a_million(void **state)
{
    (void)state;
    const dse_real h = DSE_REAL(0.01);
    const struct stiff stiff = {DSE_REAL(-1e8)};
    const struct dse_model model = {
        .time = DSE_CONTINUOUS, .nx = 2, .parameters = &stiff, .f = slow_f, .dfdx = slow_dfdx};
    dse_real x[2] = {3, 1}, scratch[DSE_ROS2_SCRATCH(2)]; /* starts far from x1 = x2^2 */
    for (int k = 0; k < 300; k++) {
        assert_int_equal(dse_ros2_step(&model, (dse_real)k * h, h, NULL, x, scratch), DSE_OK);
        double decayed = exp(-((double)(k + 1) * (double)h));
        assert_true(fabs((double)x[1] - decayed) < 1e-5 + 10 * (double)EPS);
        assert_true(fabs((double)x[0] - decayed * decayed) < 1e-4 + 10 * (double)EPS);
    }
}

static void ros2_errs_by_less_than_h_when_a_stiff_model_depends_on_time(void **state)
{
    (void)state;
    const struct stiff stiff = {DSE_REAL(-1e8)};
    const struct dse_model model = {
        .time = DSE_CONTINUOUS, .nx = 1, .parameters = &stiff, .f = forced_f, .dfdx = stiff_dfdx};
    const dse_real h = DSE_REAL(0.01);
    dse_real x[1] = {2}, scratch[DSE_ROS2_SCRATCH(1)]; /* starts away from cos 0 = 1 */
    for (int k = 0; k < 300; k++) {
        dse_real t = (dse_real)k * h;
        assert_int_equal(dse_ros2_step(&model, t, h, NULL, x, scratch), DSE_OK);
        assert_true(fabs((double)x[0] - cos((double)(t + h))) < (double)h);
    }
}

/* ---- memory ---- */

/* The steppers of a problem with n = 2 touch x[0..1] and the scratch that their macros ask for. */
static void nothing_beyond_x_and_scratch_is_touched(void **state)
{
    (void)state;
    enum { GUARD = 4, MOST = 32 };
    const int sizes[3] = {DSE_RK4_SCRATCH(2), DSE_ROS2_SCRATCH(2), DSE_RK45_SCRATCH(2)};
    struct dse_model model = model_of(&problems[2]);
    struct dse_held_model held = {&model, NULL};
    for (int method = 0; method < 3; method++) {
        dse_real x[2 + GUARD], scratch[MOST + GUARD];
        for (int i = 0; i < 2 + GUARD; i++)
            x[i] = 12345;
        for (int i = 0; i < MOST + GUARD; i++)
            scratch[i] = 12345;
        if (method == 0)
            dse_rk4_model_step(&model, 0, DSE_REAL(0.1), NULL, x, scratch);
        else if (method == 1)
            dse_ros2_step(&model, 0, DSE_REAL(0.1), NULL, x, scratch);
        else
            dse_rk45_integrate(dse_held_model_rhs, &held, NULL, 0, 1, 2, x, scratch, NULL);
        assert_true(x[0] != 12345 && x[1] != 12345);
        for (int i = 2; i < 2 + GUARD; i++)
            assert_true(x[i] == 12345);
        for (int i = sizes[method]; i < MOST + GUARD; i++)
            assert_true(scratch[i] == 12345);
    }
}

/* ---- Dormand-Prince ---- */

static enum dse_status integrate(const struct problem *problem,
                                 const struct dse_rk45_config *config, double t0, double t1,
                                 dse_real *x, struct dse_rk45_result *result)
{
    struct dse_model model = model_of(problem);
    struct dse_held_model held = {&model, NULL};
    dse_real scratch[DSE_RK45_SCRATCH(MAX_N)];
    return dse_rk45_integrate(dse_held_model_rhs, &held, config, (dse_real)t0, (dse_real)t1,
                              problem->n, x, scratch, result);
}

static void rk45_error_follows_the_tolerance(void **state)
{
    (void)state;
    for (size_t i = 0; i < N_PROBLEMS; i++) {
        int steps_before = 0;
        for (double rtol = 1e-3; rtol > 20 * (double)EPS && rtol > 1e-12; rtol *= 0.01) {
            const struct dse_rk45_config config = {.rtol = (dse_real)rtol, .atol = (dse_real)rtol};
            dse_real x[MAX_N];
            struct dse_rk45_result result;
            start(&problems[i], 0, x);
            assert_int_equal(integrate(&problems[i], &config, 0, problems[i].t1, x, &result),
                             DSE_OK);
            double error = error_at(&problems[i], problems[i].t1, x);
            printf("%-8s rtol %.0e: error %.1e, %d steps, %d rejected\n", problems[i].name, rtol,
                   error, result.steps, result.rejected);
            assert_true(error < 20 * rtol);
            assert_true(result.steps > steps_before);
            assert_true(result.h > 0);
            steps_before = result.steps;
        }
    }
}

/* One step of size h from t = 0.2 with tolerances that accept anything. */
static double error_of_one_step(const struct problem *problem, double h)
{
    const struct dse_rk45_config config = {.rtol = 1, .atol = 100, .h0 = 100};
    dse_real x[MAX_N];
    struct dse_rk45_result result;
    start(problem, 0.25, x);
    assert_int_equal(integrate(problem, &config, 0.25, 0.25 + h, x, &result), DSE_OK);
    assert_int_equal(result.steps, 1);
    return error_at(problem, 0.25 + h, x);
}

static void one_step_of_rk45_has_order_five(void **state)
{
    (void)state;
    const double h = sizeof(dse_real) == sizeof(float) ? 0.5 : 0.0625;
    for (size_t i = 0; i < N_PROBLEMS; i++) {
        double coarse = error_of_one_step(&problems[i], h);
        double fine = error_of_one_step(&problems[i], h / 2);
        double order = log2(coarse / fine) - 1;
        printf("%-8s order %.2f, error %.1e -> %.1e\n", problems[i].name, order, coarse, fine);
        /* in float the steps are too large for the leading term of the error to rule */
        assert_true(order > 4.5 && (sizeof(dse_real) == sizeof(float) || order < 5.3));
    }
}

/* x' = t^4 from t = 0: the estimate of the local error is 71/270000 h^5. */
static enum dse_status quartic(void *context, dse_real t, const dse_real *x, dse_real *dx)
{
    (void)context, (void)x;
    dx[0] = t * t * t * t;
    return DSE_OK;
}

/* One step of size 2 from x0, with the tolerance a little above or below the estimate. */
static void check_acceptance(dse_real x0, struct dse_rk45_config config, bool accepted)
{
    config.h0 = 2;
    config.max_steps = 1;
    dse_real x[1] = {x0}, scratch[DSE_RK45_SCRATCH(1)];
    struct dse_rk45_result result;
    enum dse_status status =
        dse_rk45_integrate(quartic, NULL, &config, 0, 2, 1, x, scratch, &result);
    assert_int_equal(status, accepted ? DSE_OK : DSE_ENOCONV);
    assert_int_equal(result.steps, accepted);
    assert_int_equal(result.rejected, !accepted);
    const dse_real expected = accepted ? x0 + DSE_REAL(6.4) : x0;
    assert_true(dse_abs(x[0] - expected) <= 8 * EPS * (dse_abs(x0) + 10));
    assert_true(accepted ? result.h <= 2 : result.h < 2 && result.h > 1);
}

static void rk45_accepts_an_estimate_up_to_the_tolerance_and_not_beyond(void **state)
{
    (void)state;
    const dse_real estimate = DSE_REAL(71.0 / 270000 * 32), none = DSE_REAL(1e-30);
    const dse_real above = DSE_REAL(1.01) * estimate, below = DSE_REAL(0.99) * estimate;
    check_acceptance(0, (struct dse_rk45_config){.rtol = none, .atol = above}, true);
    check_acceptance(0, (struct dse_rk45_config){.rtol = none, .atol = below}, false);
    /* relative to the larger of |x| before, here, */
    check_acceptance(-1000, (struct dse_rk45_config){.rtol = above / 1000, .atol = none}, true);
    check_acceptance(-1000, (struct dse_rk45_config){.rtol = below / 1000, .atol = none}, false);
    /* and after */
    const dse_real after = DSE_REAL(6.4);
    check_acceptance(0, (struct dse_rk45_config){.rtol = above / after, .atol = none}, true);
    check_acceptance(0, (struct dse_rk45_config){.rtol = below / after, .atol = none}, false);
}

/* dx = -context[0] x; context[1] keeps the earliest t > 1 that it is called for. */
static enum dse_status watched_decay(void *context, dse_real t, const dse_real *x, dse_real *dx)
{
    dse_real *rate_and_time = context;
    dx[0] = -rate_and_time[0] * x[0];
    if (t > 1 && (rate_and_time[1] == 0 || t < rate_and_time[1]))
        rate_and_time[1] = t;
    return DSE_OK;
}

/* The first step is 0.01 |x| / |f|, a hundredth of the span where that says nothing; the earliest
 * stage lies at a fifth of it. */
static void first_step_of_rk45_comes_from_the_size_of_x_and_f(void **state)
{
    (void)state;
    const struct {
        dse_real rate, x0, h;
    } cases[] = {{1000, 1, DSE_REAL(1e-5)},
                 {2, -3, DSE_REAL(5e-3)},
                 {1000, 0, DSE_REAL(0.04)},
                 {0, 1, DSE_REAL(0.04)},
                 {DSE_REAL(1e-4), 1, DSE_REAL(0.04)}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        dse_real rate_and_time[2] = {cases[i].rate, 0}, x[1] = {cases[i].x0};
        dse_real scratch[DSE_RK45_SCRATCH(1)];
        assert_int_equal(
            dse_rk45_integrate(watched_decay, rate_and_time, NULL, 1, 5, 1, x, scratch, NULL),
            DSE_OK);
        const dse_real h = 5 * (rate_and_time[1] - 1);
        assert_true(dse_abs(h - cases[i].h) < 10 * EPS);
    }
}

static void defaults_of_rk45_are_those_of_its_header(void **state)
{
    (void)state;
    const struct dse_rk45_config none = {0}, written = {.rtol = DSE_REAL(1e-6),
                                                        .atol = DSE_REAL(1e-9),
                                                        .max_steps = 10000};
    const struct dse_rk45_config *configs[3] = {NULL, &none, &written};
    dse_real x[3][MAX_N];
    struct dse_rk45_result results[3];
    for (int i = 0; i < 3; i++) {
        start(&problems[2], 0, x[i]);
        assert_int_equal(integrate(&problems[2], configs[i], 0, 6, x[i], &results[i]), DSE_OK);
        assert_memory_equal(x[i], x[0], sizeof x[0]);
        assert_int_equal(results[i].steps, results[0].steps);
    }
    /* a million turns take longer than the default bound */
    assert_int_equal(integrate(&problems[2], NULL, 0, 6e6, x[0], &results[0]), DSE_ENOCONV);
    assert_int_equal(results[0].steps + results[0].rejected, 10000);
}

/* x' = 1/4 of the largest number, from the largest number: f is finite, the new x is not. */
static enum dse_status overflowing(void *context, dse_real t, const dse_real *x, dse_real *dx)
{
    (void)context, (void)t, (void)x;
    dx[0] = DSE_REAL_MAX / 4;
    return DSE_OK;
}

static void rk45_never_ends_in_infinity(void **state)
{
    (void)state;
    const struct dse_rk45_config config = {.h0 = 4, .max_steps = 50};
    dse_real x[1] = {DSE_REAL_MAX}, scratch[DSE_RK45_SCRATCH(1)];
    assert_int_not_equal(dse_rk45_integrate(overflowing, NULL, &config, 0, 4, 1, x, scratch, NULL),
                         DSE_OK);
    assert_true(x[0] == DSE_REAL_MAX);
}

static enum dse_status counted_nan(void *context, dse_real t, const dse_real *x, dse_real *dx)
{
    (void)t, (void)x;
    ++*(int *)context;
    dx[0] = (dse_real)NAN;
    return DSE_OK;
}

static void rk45_does_not_try_where_f_is_not_finite_at_the_start(void **state)
{
    (void)state;
    int calls = 0;
    dse_real x[1] = {1}, scratch[DSE_RK45_SCRATCH(1)];
    assert_int_equal(dse_rk45_integrate(counted_nan, &calls, NULL, 0, 1, 1, x, scratch, NULL),
                     DSE_ENONFINITE);
    assert_int_equal(calls, 1);
    assert_true(x[0] == 1);
}

static void rk45_goes_backwards_in_time(void **state)
{
    (void)state;
    const double rtol = sizeof(dse_real) == sizeof(float) ? 1e-5 : 1e-9;
    const struct dse_rk45_config config = {.rtol = (dse_real)rtol, .atol = (dse_real)rtol};
    dse_real x[MAX_N];
    start(&problems[2], 5, x);
    assert_int_equal(integrate(&problems[2], &config, 5, -1, x, NULL), DSE_OK);
    assert_true(error_at(&problems[2], -1, x) < 20 * rtol);
}

static void rk45_without_time_to_pass_does_nothing(void **state)
{
    (void)state;
    dse_real x[1] = {3};
    struct dse_rk45_result result = {5, 5, 5};
    assert_int_equal(integrate(&problems[0], NULL, 2, 2, x, &result), DSE_OK);
    assert_true(x[0] == 3 && result.steps == 0 && result.rejected == 0);
}

static void rk45_takes_up_where_it_left_off(void **state)
{
    (void)state;
    struct dse_rk45_config config = {.rtol = DSE_REAL(1e-5), .atol = DSE_REAL(1e-5)};
    dse_real x[MAX_N];
    struct dse_rk45_result result;
    start(&problems[2], 0, x);
    for (int k = 0; k < 10; k++) {
        assert_int_equal(integrate(&problems[2], &config, 0.5 * k, 0.5 * (k + 1), x, &result),
                         DSE_OK);
        /* the first call has to find its step, the others get it */
        assert_true(k == 0 || (result.steps <= 3 && result.rejected == 0));
        config.h0 = result.h;
    }
    assert_true(error_at(&problems[2], 5, x) < 1e-3);
}

static void rk45_stops_at_its_bound_of_steps(void **state)
{
    (void)state;
    const struct dse_rk45_config config = {.rtol = 20 * EPS, .atol = 20 * EPS, .max_steps = 5};
    dse_real x[MAX_N] = {0, 1};
    struct dse_rk45_result result;
    assert_int_equal(integrate(&problems[2], &config, 0, 6, x, &result), DSE_ENOCONV);
    assert_int_equal(result.steps + result.rejected, 5);
    assert_true(x[0] == 0 && x[1] == 1);
}

/* dx = -x; the context counts the calls. */
static enum dse_status counted_decay(void *context, dse_real t, const dse_real *x, dse_real *dx)
{
    (void)t;
    ++*(int *)context;
    dx[0] = -x[0];
    return DSE_OK;
}

static void rk45_evaluates_six_times_a_step_and_once_at_the_start(void **state)
{
    (void)state;
    int calls = 0;
    dse_real x[1] = {1}, scratch[DSE_RK45_SCRATCH(1)];
    const struct dse_rk45_config config = {.rtol = DSE_REAL(1e-4), .h0 = 100};
    struct dse_rk45_result result;
    assert_int_equal(
        dse_rk45_integrate(counted_decay, &calls, &config, 0, 50, 1, x, scratch, &result), DSE_OK);
    assert_true(result.steps > 0 && result.rejected > 0);
    assert_int_equal(calls, 1 + 6 * (result.steps + result.rejected));
}

/* x' = x^2 from 1 is infinite at t = 1. */
static enum dse_status explosion(void *context, dse_real t, const dse_real *x, dse_real *dx)
{
    (void)context, (void)t;
    dx[0] = x[0] * x[0];
    return DSE_OK;
}

static void rk45_gives_up_at_a_pole(void **state)
{
    (void)state;
    dse_real x[1] = {1}, scratch[DSE_RK45_SCRATCH(1)];
    struct dse_rk45_result result;
    enum dse_status status =
        dse_rk45_integrate(explosion, NULL, NULL, 0, 2, 1, x, scratch, &result);
    assert_true(status == DSE_ENOCONV || status == DSE_ENONFINITE);
    assert_true(x[0] == 1);
}

/* x' = -50 x, defined for x >= -0.1 only; otherwise NaN or DSE_EMODEL, as the context says. */
static enum dse_status fenced_decay(void *context, dse_real t, const dse_real *x, dse_real *dx)
{
    const enum dse_status *answer = context;
    (void)t;
    dx[0] = -50 * x[0];
    if (x[0] >= DSE_REAL(-0.1))
        return DSE_OK;
    dx[0] = (dse_real)NAN;
    return *answer;
}

static void rk45_comes_back_from_a_step_too_far(void **state)
{
    (void)state;
    const enum dse_status answers[] = {DSE_EMODEL, DSE_OK, DSE_ENONFINITE};
    for (int i = 0; i < 3; i++) {
        enum dse_status answer = answers[i];
        const struct dse_rk45_config config = {
            .rtol = DSE_REAL(1e-4), .atol = DSE_REAL(1e-4), .h0 = DSE_REAL(0.5)};
        dse_real x[1] = {1}, scratch[DSE_RK45_SCRATCH(1)];
        struct dse_rk45_result result;
        assert_int_equal(dse_rk45_integrate(fenced_decay, &answer, &config, 0, DSE_REAL(0.1), 1, x,
                                            scratch, &result),
                         DSE_OK);
        assert_true(result.rejected > 0);
        assert_true(fabs((double)x[0] - exp(-5)) < 1e-3);
    }
}

/* dx = 1 until t = 1/2; from there on there is no model. */
static enum dse_status wall(void *context, dse_real t, const dse_real *x, dse_real *dx)
{
    const enum dse_status *answer = context;
    (void)x;
    dx[0] = 1;
    return t > DSE_REAL(0.5) ? *answer : DSE_OK;
}

static void rk45_says_what_stopped_it(void **state)
{
    (void)state;
    dse_real x[1] = {1}, scratch[DSE_RK45_SCRATCH(1)];
    const enum dse_status answers[] = {DSE_EMODEL, DSE_ENONFINITE, DSE_EINVAL};
    for (int i = 0; i < 3; i++) {
        enum dse_status answer = answers[i];
        struct dse_rk45_result result;
        assert_int_equal(dse_rk45_integrate(wall, &answer, NULL, 0, 1, 1, x, scratch, &result),
                         answer);
        assert_true(result.steps + result.rejected < 300);
        assert_int_equal(dse_rk45_integrate(wall, &answer, NULL, 1, 2, 1, x, scratch, NULL),
                         answer);
        assert_true(x[0] == 1);
    }
}

static void rk45_refuses_impossible_settings(void **state)
{
    (void)state;
    const dse_real nan = (dse_real)NAN, inf = (dse_real)INFINITY;
    const struct dse_rk45_config bad[] = {{.rtol = -1},     {.rtol = nan}, {.atol = -1},
                                          {.atol = inf},    {.h0 = -1},    {.h0 = nan},
                                          {.max_steps = -1}};
    dse_real x[MAX_N] = {1, 1}, scratch[DSE_RK45_SCRATCH(MAX_N)];
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
        assert_int_equal(integrate(&problems[0], &bad[i], 0, 1, x, NULL), DSE_EINVAL);
    assert_int_equal(dse_rk45_integrate(explosion, NULL, NULL, 0, 1, 0, x, scratch, NULL),
                     DSE_EINVAL);
    assert_int_equal(integrate(&problems[0], NULL, 0, (double)inf, x, NULL), DSE_ENONFINITE);
    assert_int_equal(integrate(&problems[0], NULL, (double)nan, 1, x, NULL), DSE_ENONFINITE);
    assert_true(x[0] == 1);
    x[0] = nan;
    assert_int_equal(integrate(&problems[0], NULL, 0, 1, x, NULL), DSE_ENONFINITE);
}

static void scratch_may_hold_anything(void **state)
{
    (void)state;
    dse_real clean[2][32] = {{0}}, x[2][2];
    for (int i = 0; i < 32; i++)
        clean[1][i] = (dse_real)NAN;
    struct dse_model model = model_of(&problems[2]);
    struct dse_held_model held = {&model, NULL};
    for (int i = 0; i < 2; i++) {
        x[i][0] = 1;
        x[i][1] = 2;
        dse_rk4_model_step(&model, 0, DSE_REAL(0.1), NULL, x[i], clean[i]);
        dse_ros2_step(&model, 0, DSE_REAL(0.1), NULL, x[i], clean[i]);
        dse_rk45_integrate(dse_held_model_rhs, &held, NULL, 0, 1, 2, x[i], clean[i], NULL);
    }
    assert_true(dse_is_finite(x[0][0]) && x[0][0] != 1);
    assert_memory_equal(x[0], x[1], sizeof x[0]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rk4_converges_with_order_four),
        cmocka_unit_test(rk4_is_the_textbook_formula),
        cmocka_unit_test(input_is_held_over_the_step),
        cmocka_unit_test(discrete_models_are_refused),
        cmocka_unit_test(a_failed_step_leaves_x_unchanged),
        cmocka_unit_test(ros2_converges_with_order_two),
        cmocka_unit_test(ros2_keeps_order_two_with_a_wrong_jacobian),
        cmocka_unit_test(ros2_reports_what_is_wrong_with_its_matrix),
        cmocka_unit_test(ros2_damps_as_its_stability_function_says),
        cmocka_unit_test(ros2_follows_the_slow_solution_with_h_lambda_of_minus_a_million),
        cmocka_unit_test(ros2_errs_by_less_than_h_when_a_stiff_model_depends_on_time),
        cmocka_unit_test(nothing_beyond_x_and_scratch_is_touched),
        cmocka_unit_test(rk45_error_follows_the_tolerance),
        cmocka_unit_test(one_step_of_rk45_has_order_five),
        cmocka_unit_test(rk45_accepts_an_estimate_up_to_the_tolerance_and_not_beyond),
        cmocka_unit_test(first_step_of_rk45_comes_from_the_size_of_x_and_f),
        cmocka_unit_test(defaults_of_rk45_are_those_of_its_header),
        cmocka_unit_test(rk45_never_ends_in_infinity),
        cmocka_unit_test(rk45_does_not_try_where_f_is_not_finite_at_the_start),
        cmocka_unit_test(rk45_goes_backwards_in_time),
        cmocka_unit_test(rk45_without_time_to_pass_does_nothing),
        cmocka_unit_test(rk45_takes_up_where_it_left_off),
        cmocka_unit_test(rk45_stops_at_its_bound_of_steps),
        cmocka_unit_test(rk45_evaluates_six_times_a_step_and_once_at_the_start),
        cmocka_unit_test(rk45_gives_up_at_a_pole),
        cmocka_unit_test(rk45_comes_back_from_a_step_too_far),
        cmocka_unit_test(rk45_says_what_stopped_it),
        cmocka_unit_test(rk45_refuses_impossible_settings),
        cmocka_unit_test(scratch_may_hold_anything),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
