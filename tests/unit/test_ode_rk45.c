/* The pair of Dormand and Prince with step control: tolerance, first step, bounds, failures. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include <cmocka.h>

#include "dse/math.h"
#include "dse/ode.h"
#include "ode_problems.h"

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

int main(void)
{
    const struct CMUnitTest tests[] = {
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
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
