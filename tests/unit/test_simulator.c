/* The plant simulator on small plants of the test's own: solutions in closed form and a stiff
 * problem of the literature. The shipped plants: tests/golden/golden_simulator.c. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "dse/ode.h"
#include "sim/simulator.h"
#include "simulator_rig.h"

/* Robertson's kinetics: rates from 0.04 to 3e7, the classic of stiff integration. */
static enum dse_status robertson_f(const struct dse_model *model, dse_real t, const dse_real *x,
                                   const dse_real *u, dse_real *dx)
{
    (void)model, (void)t, (void)u;
    dx[0] = -0.04 * x[0] + 1e4 * x[1] * x[2];
    dx[2] = 3e7 * x[1] * x[1];
    dx[1] = -dx[0] - dx[2];
    return DSE_OK;
}

static int jacobians; /* how often the integrator asked for one */

static enum dse_status robertson_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                      const dse_real *u, dse_real *F)
{
    (void)model, (void)t, (void)u;
    const double J[9] = {-0.04,       1e4 * x[2],
                         1e4 * x[1], /**/
                         0.04,        -1e4 * x[2] - 6e7 * x[1],
                         -1e4 * x[1], 0,
                         6e7 * x[1],  0};
    memcpy(F, J, sizeof J);
    jacobians++;
    return DSE_OK;
}

static void starts_with_the_given_state_and_input_at_sample_0(void **state)
{
    (void)state;
    static const struct test_plant plain = {
        .name = "plain", .nx = 3, .nu = 1, .ny = 2, .f = smooth_f, .h = copy_h, .rate = 5};
    static const double x0[] = {0.5, -1, 3};
    struct setting setting;
    set(&setting, &plain, 0.1);
    setting.config.x0 = x0;
    struct simulator *sim = create(&setting);
    assert_true(sim_sample(sim) == 0);
    assert_same_bits(sim_state(sim), x0, 3);
    assert_same_bits(sim_input(sim), ones, 1);
    assert_same_bits(sim_output(sim), x0, 2);
    assert_close(sim_time(sim), 0, 0);
    sim_destroy(sim);
}

static void cvode_follows_the_exact_solution_without_noise(void **state)
{
    (void)state;
    struct setting setting;
    set(&setting, &smooth, 0.01);
    struct simulator *sim = create(&setting);
    for (int k = 1; k <= 400; k++) {
        step(sim);
        double t = k * 0.01;
        assert_true(sim_sample(sim) == k);
        assert_close(sim_time(sim), t, 0); /* k T_s, not a sum of periods */
        /* a = 1/5 + (1 - 1/5) e^-5t,  b = 1 + t^2,  c = 1 */
        assert_close(sim_state(sim)[0], 0.2 + 0.8 * exp(-5 * t), 1e-8);
        assert_close(sim_state(sim)[1], 1 + t * t, 1e-8);
        assert_close(sim_state(sim)[2], 1, 1e-12);
    }
    sim_destroy(sim);
}

/* x(k+1) = e^-rT x(k) + (1 - e^-rT)/r (u + w_k): the noise of the sample is held, the next one
 * starts exactly at the next sample. */
static void cvode_holds_the_process_noise_from_sample_to_sample(void **state)
{
    (void)state;
    static const double scale[] = {50, 3, 0};
    struct setting setting;
    set(&setting, &smooth, 0.1);
    setting.config.process = (struct sim_noise){.distribution = SIM_UNIFORM, .scale = scale};
    struct simulator *sim = create(&setting);

    struct sim_noise_source twin;
    sim_noise_init(&twin, &setting.config.process, 3, setting.config.seed, SIM_NOISE_PROCESS);
    double a = 1;
    double b = 1;
    for (int k = 0; k < 300; k++) {
        double w[3];
        sim_noise_draw(&twin, w);
        double decay = exp(-5 * 0.1);
        a = decay * a + (1 - decay) / 5 * (1 + w[0]);
        b += 0.1 * (2 * (k + 0.5) * 0.1 + w[1]);
        step(sim);
        assert_close(sim_state(sim)[0], a, 5e-8);
        assert_close(sim_state(sim)[1], b, 1e-8 * (1 + b));
        assert_close(sim_state(sim)[2], 1, 1e-12);
    }
    sim_destroy(sim);
}

/* Reference at t = 40 as published for this problem; with the model's Jacobian and with CVODE's. */
static void cvode_integrates_a_stiff_plant_with_or_without_its_jacobian(void **state)
{
    (void)state;
    static const double x0[] = {1, 0, 0};
    static const double reference[] = {0.7158270687193941, 9.185534764557338e-06,
                                       0.2841637457458413};
    static const function jacobian[] = {robertson_dfdx, NULL};
    for (int i = 0; i < COUNT(jacobian); i++) {
        const struct test_plant robertson = {.name = "robertson",
                                             .nx = 3,
                                             .ny = 1,
                                             .f = robertson_f,
                                             .h = copy_h,
                                             .dfdx = jacobian[i]};
        struct setting setting;
        set(&setting, &robertson, 4);
        setting.config.x0 = x0;
        setting.config.u = NULL;
        jacobians = 0;
        struct simulator *sim = create(&setting);
        for (int k = 0; k < 10; k++)
            step(sim);
        for (int j = 0; j < 3; j++)
            assert_close(sim_state(sim)[j], reference[j], 1e-8 * reference[j]);
        assert_true((jacobians > 0) == (jacobian[i] != NULL));
        sim_destroy(sim);
    }
}

static void a_looser_tolerance_gives_a_larger_error(void **state)
{
    (void)state;
    static const double rtol[] = {1e-3, 1e-6, 1e-10};
    double error[3];
    for (int i = 0; i < 3; i++) {
        struct setting setting;
        set(&setting, &smooth, 0.05);
        setting.config.rtol = rtol[i];
        setting.config.atol = rtol[i] / 100;
        struct simulator *sim = create(&setting);
        error[i] = 0;
        for (int k = 1; k <= 20; k++) {
            step(sim);
            error[i] =
                fmax(error[i], fabs(sim_state(sim)[0] - (0.2 + 0.8 * exp(-5 * sim_time(sim)))));
        }
        assert_true(error[i] < 50 * rtol[i]);
        sim_destroy(sim);
    }
    assert_true(error[0] > 10 * error[1] && error[1] > 10 * error[2]);
}

/* The tolerance of a state is atol times its scale: a plant in other units takes the same steps. */
static void the_absolute_tolerance_goes_with_the_scale_of_a_state(void **state)
{
    (void)state;
    static const double x0[] = {0, 1, 1};
    static const double large[] = {1024};
    struct setting setting;
    set(&setting, &smooth, 0.05);
    setting.config.x0 = x0;
    setting.config.rtol = 1e-12; /* so that atol rules */
    setting.config.atol = 1e-5;
    struct simulator *sim = create(&setting);

    struct dse_signal scaled[3];
    memcpy(scaled, signals, sizeof scaled);
    scaled[0].scale = 1024;
    setting.plant.states = scaled;
    setting.config.u = large;
    struct simulator *twin = create(&setting);
    for (int k = 0; k < 20; k++) {
        step(sim);
        step(twin);
        double rescaled = sim_state(twin)[0] / 1024;
        assert_same_bits(&rescaled, sim_state(sim), 1);
    }
    sim_destroy(sim);
    sim_destroy(twin);
}

static double latest; /* time at which the model was asked */

static enum dse_status timed_f(const struct dse_model *model, dse_real t, const dse_real *x,
                               const dse_real *u, dse_real *dx)
{
    latest = fmax(latest, t);
    return smooth_f(model, t, x, u, dx);
}

/* Beyond the next sample other noise holds: nothing there may be used. */
static void cvode_does_not_look_beyond_a_sample_with_process_noise(void **state)
{
    (void)state;
    static const double scale[] = {50, 3, 1};
    struct test_plant timed = smooth;
    timed.f = timed_f;
    struct setting setting;
    set(&setting, &timed, 0.1);
    setting.config.process = (struct sim_noise){.distribution = SIM_GAUSSIAN, .scale = scale};
    struct simulator *sim = create(&setting);
    for (int k = 0; k < 100; k++) {
        latest = 0;
        step(sim);
        assert_close(latest, sim_time(sim), 1e-12);
    }
    sim_destroy(sim);
}

struct held {
    double w[3];
    double rate;
};

static enum dse_status smooth_with_noise(void *context, dse_real t, const dse_real *x, dse_real *dx)
{
    const struct held *held = context;
    dx[0] = -held->rate * x[0] + 1 + held->w[0];
    dx[1] = 2 * t + held->w[1];
    dx[2] = held->w[2];
    return DSE_OK;
}

static void rk4_takes_one_classical_step_per_sample(void **state)
{
    (void)state;
    static const double scale[] = {50, 3, 1};
    for (int noisy = 0; noisy < 2; noisy++) {
        struct setting setting;
        set(&setting, &smooth, 0.1);
        setting.config.integrator = SIM_RK4;
        if (noisy)
            setting.config.process =
                (struct sim_noise){.distribution = SIM_GAUSSIAN, .scale = scale};
        struct simulator *sim = create(&setting);
        struct sim_noise_source twin;
        sim_noise_init(&twin, &setting.config.process, 3, setting.config.seed, SIM_NOISE_PROCESS);
        double x[] = {1, 1, 1};
        double scratch[DSE_RK4_SCRATCH(3)];
        for (int k = 0; k < 50; k++) {
            struct held held = {.rate = 5};
            sim_noise_draw(&twin, held.w);
            assert_int_equal(dse_rk4_step(smooth_with_noise, &held, k * 0.1, 0.1, 3, x, scratch),
                             DSE_OK);
            step(sim);
            assert_same_bits(sim_state(sim), x, 3);
        }
        sim_destroy(sim);
    }
}

/* a(k+1) = a/2 + u, b(k+1) = b + a, c(k+1) = -2 c + t */
static enum dse_status difference_f(const struct dse_model *model, dse_real t, const dse_real *x,
                                    const dse_real *u, dse_real *next)
{
    (void)model;
    next[0] = x[0] / 2 + u[0];
    next[1] = x[1] + x[0];
    next[2] = -2 * x[2] + t;
    return DSE_OK;
}

/* Once per sample, without any integrator: all values here are exact. */
static void a_discrete_plant_goes_by_its_own_step(void **state)
{
    (void)state;
    static const double scale[] = {0.5, 3, 0};
    const struct test_plant difference = {.name = "difference",
                                          .nx = 3,
                                          .nu = 1,
                                          .ny = 2,
                                          .time = DSE_DISCRETE,
                                          .f = difference_f,
                                          .h = copy_h};
    for (int i = 0; i < 4; i++) {
        struct setting setting;
        set(&setting, &difference, 0.25);
        setting.config.integrator = i % 2 == 0 ? SIM_CVODE : SIM_RK4;
        if (i >= 2)
            setting.config.process =
                (struct sim_noise){.distribution = SIM_UNIFORM, .scale = scale};
        struct simulator *sim = create(&setting);
        struct sim_noise_source twin;
        sim_noise_init(&twin, &setting.config.process, 3, setting.config.seed, SIM_NOISE_PROCESS);
        double x[] = {1, 1, 1};
        for (int k = 0; k < 40; k++) {
            double w[3];
            sim_noise_draw(&twin, w);
            assert_same_bits(sim_state(sim), x, 3);
            assert_same_bits(sim_output(sim), x, 2);
            const double next[] = {x[0] / 2 + 1 + w[0], x[1] + x[0] + w[1],
                                   -2 * x[2] + k * 0.25 + w[2]};
            memcpy(x, next, sizeof x);
            step(sim);
        }
        sim_destroy(sim);
    }
}

/* Twice 1e308 is no double. */
static void a_discrete_plant_that_overflows_says_which_state(void **state)
{
    (void)state;
    static const double far[] = {0, 0, 1e308};
    const struct test_plant difference = {
        .name = "difference", .nx = 3, .nu = 1, .time = DSE_DISCRETE, .f = difference_f};
    struct setting setting;
    char reason[REASON] = "";
    set(&setting, &difference, 1);
    setting.config.x0 = far;
    struct simulator *sim = create(&setting);
    assert_false(sim_step(sim, reason, sizeof reason));
    assert_non_null(strstr(reason, "the next value of c is not finite at t = 0 h"));
    assert_true(sim_sample(sim) == 0 && sim_state(sim)[2] > 9e307);
    sim_destroy(sim);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(starts_with_the_given_state_and_input_at_sample_0),
        cmocka_unit_test(cvode_follows_the_exact_solution_without_noise),
        cmocka_unit_test(cvode_holds_the_process_noise_from_sample_to_sample),
        cmocka_unit_test(cvode_does_not_look_beyond_a_sample_with_process_noise),
        cmocka_unit_test(cvode_integrates_a_stiff_plant_with_or_without_its_jacobian),
        cmocka_unit_test(a_looser_tolerance_gives_a_larger_error),
        cmocka_unit_test(the_absolute_tolerance_goes_with_the_scale_of_a_state),
        cmocka_unit_test(rk4_takes_one_classical_step_per_sample),
        cmocka_unit_test(a_discrete_plant_goes_by_its_own_step),
        cmocka_unit_test(a_discrete_plant_that_overflows_says_which_state),
    };
    return cmocka_run_group_tests_name("simulator", tests, NULL, NULL);
}
