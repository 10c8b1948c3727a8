/* Plants that break, and what the simulator says then. */
#define _POSIX_C_SOURCE 200809L /* dup, fileno; NOLINT(bugprone-reserved-identifier) */

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "sim/simulator.h"
#include "simulator_rig.h"

/* x' = x^2 from 1 is infinite at t = 1. */
static enum dse_status blow_up_f(const struct dse_model *model, dse_real t, const dse_real *x,
                                 const dse_real *u, dse_real *dx)
{
    (void)model, (void)t, (void)u;
    dx[0] = 0;
    dx[1] = x[1] * x[1];
    return DSE_OK;
}

/* b falls to 0 at t = 1/1.05 and cannot leave it: no smooth solution exists. */
static enum dse_status slide_f(const struct dse_model *model, dse_real t, const dse_real *x,
                               const dse_real *u, dse_real *dx)
{
    (void)model, (void)t, (void)u;
    dx[0] = 0.1;
    dx[1] = x[1] > 0 ? -1.05 : 1.05;
    return DSE_OK;
}

/* a falls to 0 at t = 1; its square root exists no further. */
static enum dse_status root_f(const struct dse_model *model, dse_real t, const dse_real *x,
                              const dse_real *u, dse_real *dx)
{
    (void)model, (void)t, (void)u;
    dx[0] = -1;
    dx[1] = sqrt(x[0]);
    return DSE_OK;
}

/* The model ends at t = 1. */
static enum dse_status ends_f(const struct dse_model *model, dse_real t, const dse_real *x,
                              const dse_real *u, dse_real *dx)
{
    (void)model, (void)u;
    dx[0] = -x[0];
    dx[1] = 1;
    return t > 1 ? DSE_EMODEL : DSE_OK;
}

static enum dse_status ends_h(const struct dse_model *model, dse_real t, const dse_real *x,
                              const dse_real *u, dse_real *y)
{
    (void)model, (void)u;
    y[0] = x[0];
    return t > 1 ? DSE_EMODEL : DSE_OK;
}

static enum dse_status root_h(const struct dse_model *model, dse_real t, const dse_real *x,
                              const dse_real *u, dse_real *y)
{
    (void)model, (void)u, (void)x;
    y[0] = sqrt(1 - t);
    return DSE_OK;
}

static int refusals;

/* Grows towards 1; the model is not defined beyond 1.01, where extrapolation may well try it. */
static enum dse_status shy_f(const struct dse_model *model, dse_real t, const dse_real *x,
                             const dse_real *u, dse_real *dx)
{
    (void)model, (void)t, (void)u;
    dx[0] = 50 * x[0] * (1 - x[0]);
    dx[1] = 0;
    if (x[0] <= 1.01)
        return DSE_OK;
    refusals++;
    return DSE_EMODEL;
}

/* The same beside a state that gets stuck at t = 1/1.05. */
static enum dse_status shy_then_stuck_f(const struct dse_model *model, dse_real t,
                                        const dse_real *x, const dse_real *u, dse_real *dx)
{
    const enum dse_status status = shy_f(model, t, x, u, dx);
    dx[1] = x[1] > 0 ? -1.05 : 1.05;
    return status;
}

/* ---- failures ---- */

static void assert_mentions(const char *reason, const char *word)
{
    if (strstr(reason, word) == NULL)
        fail_msg("\"%s\" does not mention \"%s\"", reason, word);
}

/* Every way a plant can fail, with both integrators and with noise (restarts) or without. */
static void a_failed_step_says_where_and_changes_nothing(void **state)
{
    (void)state;
    static const struct {
        struct test_plant plant;
        const char *mentions_cvode, *mentions_rk4; /* NULL: RK4 steps over it */
    } cases[] = {
        {{.name = "blow", .nx = 2, .ny = 1, .f = blow_up_f, .h = copy_h},
         "derivative of b is not finite",
         NULL},
        {{.name = "slide", .nx = 2, .ny = 1, .f = slide_f, .h = copy_h},
         "the state that changes fastest is b",
         NULL},
        {{.name = "root", .nx = 2, .ny = 1, .f = root_f, .h = copy_h},
         "derivative of b is not finite",
         "derivative of b is not finite"},
        {{.name = "ends", .nx = 2, .ny = 1, .f = ends_f, .h = copy_h},
         "model cannot be evaluated",
         "model cannot be evaluated"},
        {{.name = "dazed", .nx = 3, .nu = 1, .ny = 1, .f = smooth_f, .h = ends_h},
         "the outputs: ",
         "the outputs: "},
        {{.name = "nan", .nx = 3, .nu = 1, .ny = 1, .f = smooth_f, .h = root_h},
         "output a is not finite",
         "output a is not finite"},
    };
    static const double scale[] = {1e-9, 1e-9, 1e-9};
    for (int i = 0; i < COUNT(cases); i++)
        for (int variant = 0; variant < 4; variant++) {
            bool rk4 = variant & 1;
            const char *mentions = rk4 ? cases[i].mentions_rk4 : cases[i].mentions_cvode;
            if (mentions == NULL)
                continue;
            struct setting setting;
            set(&setting, &cases[i].plant, 0.3);
            setting.config.integrator = rk4 ? SIM_RK4 : SIM_CVODE;
            if (variant & 2)
                setting.config.process =
                    (struct sim_noise){.distribution = SIM_UNIFORM, .scale = scale};
            struct simulator *sim = create(&setting);
            for (int k = 0; k < 3; k++)
                step(sim);
            double x[3];
            double y[1];
            memcpy(x, sim_state(sim), sizeof x);
            memcpy(y, sim_output(sim), sizeof y);
            for (int attempt = 0; attempt < 2; attempt++) {
                char reason[REASON] = "";
                assert_false(sim_step(sim, reason, sizeof reason));
                assert_mentions(reason, cases[i].plant.name);
                assert_mentions(reason, "beyond sample 3 (t = 0.9 h)");
                assert_mentions(reason, mentions);
                assert_true(sim_sample(sim) == 3);
                assert_same_bits(sim_state(sim), x, cases[i].plant.nx);
                assert_same_bits(sim_output(sim), y, 1);
            }
            sim_destroy(sim);
        }
}

static void a_trial_point_outside_the_model_is_not_the_end(void **state)
{
    (void)state;
    static const double seed[] = {1e-3, 0};
    static const struct test_plant shy = {.name = "shy", .nx = 2, .ny = 1, .f = shy_f, .h = copy_h};
    struct setting setting;
    set(&setting, &shy, 1);
    setting.config.x0 = seed;
    setting.config.rtol = 1e-3;
    setting.config.atol = 1e-3;
    refusals = 0;
    struct simulator *sim = create(&setting);
    for (int k = 0; k < 20; k++)
        step(sim);
    assert_true(refusals > 0);
    assert_close(sim_state(sim)[0], 1, 1e-3);
    sim_destroy(sim);
}

/* The refused trial points were overcome; what stops the integration later is something else. */
static void a_reason_does_not_blame_what_was_overcome(void **state)
{
    (void)state;
    static const double seed[] = {1e-3, 1};
    static const struct test_plant shy = {
        .name = "shy", .nx = 2, .ny = 1, .f = shy_then_stuck_f, .h = copy_h};
    struct dse_signal fine[2] = {signals[0], signals[1]};
    fine[1].scale = 1e-9; /* so that the loose tolerance does not step over it */
    struct setting setting;
    set(&setting, &shy, 2);
    setting.plant.states = fine;
    setting.config.x0 = seed;
    setting.config.rtol = 1e-3;
    setting.config.atol = 1e-3;
    refusals = 0;
    struct simulator *sim = create(&setting);
    char reason[REASON] = "";
    assert_false(sim_step(sim, reason, sizeof reason));
    assert_true(refusals > 0);
    assert_mentions(reason, "the state that changes fastest is b");
    assert_null(strstr(reason, "cannot be evaluated"));
    sim_destroy(sim);
}

static void a_reason_is_cut_at_the_size_of_its_buffer(void **state)
{
    (void)state;
    struct setting setting;
    set(&setting, &smooth, -1);
    for (int size = 0; size < 100; size++) {
        char reason[128];
        memset(reason, '#', sizeof reason);
        assert_null(sim_create(&setting.config, reason, size));
        if (size > 0)
            assert_true(strlen(reason) < (size_t)size);
        for (int i = size; i < COUNT(reason); i++)
            assert_int_equal(reason[i], '#');
    }
}

/* The person at the terminal reads the reason; SUNDIALS has nothing to add on stderr. */
static void a_failing_integration_writes_nothing_to_stderr(void **state)
{
    (void)state;
    static const struct test_plant blow = {
        .name = "blow", .nx = 2, .ny = 1, .f = blow_up_f, .h = copy_h};
    struct setting setting;
    set(&setting, &blow, 2);
    struct simulator *sim = create(&setting);
    FILE *catcher = tmpfile();
    assert_non_null(catcher);
    fflush(stderr);
    int terminal = dup(STDERR_FILENO);
    assert_true(terminal >= 0);
    dup2(fileno(catcher), STDERR_FILENO);
    char reason[REASON] = "";
    bool went_on = sim_step(sim, reason, sizeof reason);
    fflush(stderr);
    dup2(terminal, STDERR_FILENO);
    close(terminal);
    assert_false(went_on);
    assert_mentions(reason, "CVODE: ");
    assert_true(ftell(catcher) == 0 && lseek(fileno(catcher), 0, SEEK_END) == 0);
    fclose(catcher);
    sim_destroy(sim);
}

static void a_plant_that_cannot_be_simulated_is_refused_with_a_reason(void **state)
{
    (void)state;
    static const double nan_at_b[] = {1, NAN, 1};
    static const double infinite[] = {INFINITY, 1, 1};
    static const double negative[] = {1, 1, -1};
    static const struct {
        const char *mentions;
        double period, rtol, atol;
        const double *x0, *u;
        struct sim_noise process, measurement;
        enum dse_time_kind time;
        int nx; /* of the plant, the model has 3 */
    } cases[] = {
        {"period 0 ", 0, 0, 0, ones, ones, {0}, {0}, DSE_CONTINUOUS, 3},
        {"period -1 ", -1, 0, 0, ones, ones, {0}, {0}, DSE_CONTINUOUS, 3},
        {"period nan ", NAN, 0, 0, ones, ones, {0}, {0}, DSE_CONTINUOUS, 3},
        {"period inf ", INFINITY, 0, 0, ones, ones, {0}, {0}, DSE_CONTINUOUS, 3},
        {"rtol -1", 1, -1, 0, ones, ones, {0}, {0}, DSE_CONTINUOUS, 3},
        {"atol nan", 1, 0, NAN, ones, ones, {0}, {0}, DSE_CONTINUOUS, 3},
        {"atol inf", 1, 0, INFINITY, ones, ones, {0}, {0}, DSE_CONTINUOUS, 3},
        {"initial value is missing", 1, 0, 0, NULL, ones, {0}, {0}, DSE_CONTINUOUS, 3},
        {"initial value of b", 1, 0, 0, nan_at_b, ones, {0}, {0}, DSE_CONTINUOUS, 3},
        {"constant value is missing", 1, 0, 0, ones, NULL, {0}, {0}, DSE_CONTINUOUS, 3},
        {"constant value of a", 1, 0, 0, ones, infinite, {0}, {0}, DSE_CONTINUOUS, 3},
        {"process noise is missing", 1, 0, 0, ones, ones, {SIM_UNIFORM, 0, 0}, {0}, 0, 3},
        {"process noise of c is negative",
         1,
         0,
         0,
         ones,
         ones,
         {SIM_UNIFORM, negative, 0},
         {0},
         0,
         3},
        {"process noise of c is", 1, 0, 0, ones, ones, {SIM_GAUSSIAN, ones, negative}, {0}, 0, 3},
        {"measurement noise of b", 1, 0, 0, ones, ones, {0}, {SIM_GAUSSIAN, nan_at_b, 0}, 0, 3},
        {"neither a differential nor", 1, 0, 0, ones, ones, {0}, {0}, (enum dse_time_kind)2, 3},
        {"not those of the plant", 1, 0, 0, ones, ones, {0}, {0}, DSE_CONTINUOUS, 2},
        {"0 states", 1, 0, 0, ones, ones, {0}, {0}, DSE_CONTINUOUS, 0},
        {"161 states", 1, 0, 0, ones, ones, {0}, {0}, DSE_CONTINUOUS, DSE_PLANT_MAX_STATES + 1},
    };
    for (int i = 0; i < COUNT(cases); i++) {
        struct test_plant plant = smooth;
        plant.time = cases[i].time;
        struct setting setting;
        set(&setting, &plant, cases[i].period);
        setting.plant.nx = cases[i].nx;
        setting.config.rtol = cases[i].rtol;
        setting.config.atol = cases[i].atol;
        setting.config.x0 = cases[i].x0;
        setting.config.u = cases[i].u;
        setting.config.process = cases[i].process;
        setting.config.measurement = cases[i].measurement;
        char reason[REASON] = "";
        assert_null(sim_create(&setting.config, reason, sizeof reason));
        assert_mentions(reason, "plant smooth ");
        assert_mentions(reason, cases[i].mentions);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_failed_step_says_where_and_changes_nothing),
        cmocka_unit_test(a_trial_point_outside_the_model_is_not_the_end),
        cmocka_unit_test(a_reason_does_not_blame_what_was_overcome),
        cmocka_unit_test(a_reason_is_cut_at_the_size_of_its_buffer),
        cmocka_unit_test(a_failing_integration_writes_nothing_to_stderr),
        cmocka_unit_test(a_plant_that_cannot_be_simulated_is_refused_with_a_reason),
    };
    return cmocka_run_group_tests_name("simulator_failures", tests, NULL, NULL);
}
