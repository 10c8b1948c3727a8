/* What drives the plant's inputs: signals, control loops, and the simulator under them. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "dse/ode.h"
#include "sim/simulator.h"

#define COUNT(array) ((int)(sizeof(array) / sizeof(array)[0]))
#define REASON       512
#define BITS         2047

static void near_to(double got, double want, double tolerance)
{
    if (!(fabs(got - want) <= tolerance))
        fail_msg("%.17g is not %.17g within %g", got, want, tolerance);
}

/* ---- signals ---- */

static void steps_act_from_their_sample_on(void **state)
{
    (void)state;
    const struct sim_signal_step steps[] = {{3, 7}, {5, -2}};
    const struct sim_signal signal = {
        .kind = SIM_STEPS, .value = 1, .steps = steps, .n_steps = COUNT(steps)};
    const double want[] = {1, 1, 1, 7, 7, -2, -2};
    struct sim_signal_source source;
    sim_signal_init(&source, &signal, 0, 0);
    for (int k = 0; k < COUNT(want); k++)
        near_to(sim_signal_at_sample(&source, k, k), want[k], 0);
}

static void a_sinusoid_has_its_derivative(void **state)
{
    (void)state;
    /* F0 = 10 (1 + 0.9 sin(0.008 t)), t in seconds, in hours */
    const struct sim_signal signal = {
        .kind = SIM_SINUSOID, .value = 10, .amplitude = 9, .omega = 28.8};
    double before, after, rate, ignored;
    for (int i = 0; i < 20; i++) {
        const double t = 0.013 * i, h = 1e-6;
        near_to(sim_signal_sinusoid(&signal, t, &rate), 10 * (1 + 0.9 * sin(0.008 * 3600 * t)),
                1e-12);
        before = sim_signal_sinusoid(&signal, t - h, &ignored);
        after = sim_signal_sinusoid(&signal, t + h, &ignored);
        near_to(rate, (after - before) / (2 * h), 1e-5);
    }
}

static void prbs_bits(double *bits, uint64_t seed, uint64_t stream, int64_t bit_samples)
{
    const struct sim_signal signal = {
        .kind = SIM_PRBS, .value = 5, .amplitude = 2, .bit_samples = bit_samples};
    struct sim_signal_source source;
    sim_signal_init(&source, &signal, seed, stream);
    for (int b = 0; b < 2 * BITS; b++) {
        for (int64_t s = 0; s < bit_samples; s++) {
            const double value = sim_signal_at_sample(&source, b * bit_samples + s, 0);
            assert_true(fabs(value - 7) <= 0 || fabs(value - 3) <= 0);
            if (s > 0)
                near_to(value, 5 + 2 * bits[b], 0); /* a bit is held */
            bits[b] = (value - 5) / 2;
        }
    }
}

static void a_sinusoid_begins_at_its_phase(void **state)
{
    (void)state;
    const struct sim_signal cosine = {
        .kind = SIM_SINUSOID, .amplitude = 3, .omega = 2, .phase = 1.5707963267948966};
    for (int k = 0; k < 20; k++) {
        const double t = 0.3 * k;
        double rate;
        near_to(sim_signal_sinusoid(&cosine, t, &rate), 3 * cos(2 * t), 1e-14);
        near_to(rate, -6 * sin(2 * t), 1e-14);
    }
}

/* What makes it a maximal sequence: balance, and an autocorrelation of -1/2047 at every shift. */
static void prbs_repeats_after_2047_bits_and_is_white_within(void **state)
{
    (void)state;
    static double bits[2 * BITS];
    prbs_bits(bits, 1, 1, 3);
    double sum = 0;
    for (int b = 0; b < BITS; b++) {
        sum += bits[b];
        near_to(bits[b + BITS], bits[b], 0);
    }
    near_to(fabs(sum), 1, 1e-9);
    for (int shift = 1; shift < BITS; shift++) {
        double product = 0;
        for (int b = 0; b < BITS; b++)
            product += bits[b] * bits[b + shift];
        near_to(product, -1, 1e-9);
    }
}

static void prbs_begins_where_seed_and_stream_put_it(void **state)
{
    (void)state;
    static double one[2 * BITS], again[2 * BITS], other[2 * BITS], next[2 * BITS];
    prbs_bits(one, 1, 1, 1);
    prbs_bits(again, 1, 1, 1);
    prbs_bits(other, 2, 1, 1);
    prbs_bits(next, 1, 2, 1);
    assert_memory_equal(one, again, sizeof one);
    assert_memory_not_equal(one, other, sizeof one);
    assert_memory_not_equal(one, next, sizeof one);
}

/* ---- controllers ---- */

/* y' = (u - y)/5, exact over a sample. */
static double lag_plant(double y, double u, double period)
{
    return u + (y - u) * exp(-period / 5);
}

static void pid_brings_its_measurement_to_the_set_point(void **state)
{
    (void)state;
    const struct sim_pid pid = {.kp = 2, .ti = 4, .td = 0.3};
    struct sim_pid_state controller = {0};
    double y = 1;
    for (int k = 0; k < 2000; k++)
        y = lag_plant(y, sim_pid_step(&pid, &controller, 0.1, 1, -100, 100, 3, y), 0.1);
    near_to(y, 3, 1e-9);
}

static void pid_begins_without_a_bump(void **state)
{
    (void)state;
    const struct sim_pid pid = {.kp = 2, .ti = 4, .td = 1};
    struct sim_pid_state controller = {0};
    for (int k = 0; k < 5; k++)
        near_to(sim_pid_step(&pid, &controller, 0.1, 7, 0, 10, 3, 3), 7, 0);
}

/* kp e + I, I' = kp e/ti, -kp td y' by hand. */
static void pid_is_the_formula(void **state)
{
    (void)state;
    const struct sim_pid pid = {.kp = 2, .ti = 4, .td = 0.5};
    struct sim_pid_state controller = {0};
    near_to(sim_pid_step(&pid, &controller, 0.1, 1, -100, 100, 3, 2), 2 * 1 + 1 + 2 * 0.1 / 4,
            1e-15);
    const double integral = 1 + 2 * 0.1 / 4 + 2 * 0.5 * 0.1 / 4;
    near_to(sim_pid_step(&pid, &controller, 0.1, 1, -100, 100, 3, 2.5),
            2 * 0.5 + integral - 2 * 0.5 * 0.5 / 0.1, 1e-14);
}

/* After a long time at its limit the controller leaves it as soon as the error turns: an integral
 * that had wound up would hold it there for as long again. */
static void pid_does_not_wind_up_at_a_limit(void **state)
{
    (void)state;
    const struct sim_pid pid = {.kp = 1, .ti = 2, .td = 0};
    struct sim_pid_state up = {0}, down = {0};
    for (int k = 0; k < 1000; k++) {
        near_to(sim_pid_step(&pid, &up, 0.1, 5, 0, 10, 100, 0), 10, 0);
        near_to(sim_pid_step(&pid, &down, 0.1, 5, 0, 10, -100, 0), 0, 0);
    }
    assert_true(sim_pid_step(&pid, &up, 0.1, 5, 0, 10, -1, 0) < 10);
    assert_true(sim_pid_step(&pid, &down, 0.1, 5, 0, 10, 6, 0) > 0);
}

static const struct sim_loop loop = {.output = 0,
                                     .outer = {.kp = 3, .ti = 10},
                                     .cascaded = true,
                                     .inner = {.kp = 0.5, .ti = 1},
                                     .low = 0,
                                     .high = 10,
                                     .lag = 1};

static void cascade_brings_its_level_to_the_set_point_within_its_limits(void **state)
{
    (void)state;
    struct sim_loop_state cascade;
    double y = 2;
    sim_loop_init(&cascade, 2);
    for (int k = 0; k < 5000; k++) {
        const double u = sim_loop_step(&loop, &cascade, 0.1, 4, y, true);
        assert_true(u >= 0 && u <= 10);
        y = lag_plant(y, u, 0.1);
    }
    near_to(y, 4, 1e-9);
    /* a set point out of reach: the flow stays at its limit */
    double u = 0;
    for (int k = 0; k < 2000; k++) {
        u = sim_loop_step(&loop, &cascade, 0.1, 40, y, true);
        y = lag_plant(y, u, 0.1);
    }
    near_to(u, 10, 1e-6);
}

static void pump_lags_behind_its_command(void **state)
{
    (void)state;
    /* inner gain 1 and no integral: command = actual + (wanted - actual) = wanted = high */
    struct sim_loop stiff = loop;
    struct sim_loop_state cascade;
    stiff.inner = (struct sim_pid){.kp = 1};
    sim_loop_init(&cascade, 0);
    double u = 0;
    for (int k = 0; k < 20; k++)
        u = sim_loop_step(&stiff, &cascade, 0.1, 1e6, 0, true);
    /* command 10 - q + 0: q' = (10 - 2 q)/lag in steps of the exact lag */
    double q = 0;
    for (int k = 0; k < 20; k++)
        q += (1 - exp(-0.1)) * (10 - q - q);
    near_to(u, q, 1e-12);
}

static void a_missing_measurement_leaves_the_latest_in_force(void **state)
{
    (void)state;
    struct sim_loop_state with, without;
    sim_loop_init(&with, 2);
    sim_loop_init(&without, 2);
    /* before the first the flow stays */
    near_to(sim_loop_step(&loop, &with, 0.1, 4, NAN, false), 2, 0);
    for (int k = 0; k < 10; k++) {
        const double a = sim_loop_step(&loop, &with, 0.1, 4, k == 0 ? 2.5 : NAN, k == 0);
        const double b = sim_loop_step(&loop, &without, 0.1, 4, 2.5, true);
        near_to(a, b, 0);
    }
}

/* ---- the simulator under them ---- */

/* a' = u_0, b' = u_1; outputs a, b. Input 2 is the derivative of input 0. */
static enum dse_status pure_f(const struct dse_model *model, dse_real t, const dse_real *x,
                              const dse_real *u, dse_real *dx)
{
    (void)model, (void)t, (void)x;
    dx[0] = u[0];
    dx[1] = u[1];
    return DSE_OK;
}

static enum dse_status pure_h(const struct dse_model *model, dse_real t, const dse_real *x,
                              const dse_real *u, dse_real *y)
{
    (void)model, (void)t, (void)u;
    memcpy(y, x, 2 * sizeof *y);
    return DSE_OK;
}

static void pure_model(const dse_real *prepared, struct dse_model *model)
{
    *model = (struct dse_model){.time = DSE_CONTINUOUS,
                                .nx = 2,
                                .nu = 3,
                                .ny = 2,
                                .parameters = prepared,
                                .f = pure_f,
                                .h = pure_h};
}

static void pure_form(const dse_real *prepared, struct dse_normal_form *form)
{
    static const int rates[] = {2, -1, -1};
    *form = (struct dse_normal_form){.nu = 3, .rates = rates, .parameters = prepared};
}

static const struct dse_signal states[] = {{"a", "", 0, 1, "a"}, {"b", "", 0, 1, "b"}};
static const struct dse_signal inputs[] = {
    {"ua", "", 0, 1, "ua"}, {"ub", "", 0, 1, "ub"}, {"dua", "", 0, 1, "derivative of ua"}};
static const struct dse_plant pure = {.name = "pure",
                                      .time_unit = "h",
                                      .nx = 2,
                                      .nu = 3,
                                      .ny = 2,
                                      .states = states,
                                      .inputs = inputs,
                                      .outputs = states,
                                      .model = pure_model,
                                      .normal_form = pure_form};

static const double prepared[1] = {0}, zero[3] = {0};

static struct sim_config config_of(const struct sim_drive *drives, int n_drives)
{
    return (struct sim_config){.plant = &pure,
                               .prepared = prepared,
                               .x0 = zero,
                               .u = zero,
                               .drives = drives,
                               .n_drives = n_drives,
                               .period = 0.25};
}

static struct simulator *must_create(const struct sim_config *config)
{
    char reason[REASON] = "";
    struct simulator *sim = sim_create(config, reason, REASON);
    if (sim == NULL)
        fail_msg("%s", reason);
    return sim;
}

static void must_step(struct simulator *sim)
{
    char reason[REASON] = "";
    if (!sim_step(sim, reason, REASON))
        fail_msg("%s", reason);
}

/* Inputs that step are held: both integrators are exact, and what is published acts at once. */
static void stepped_inputs_are_held_over_their_samples(void **state)
{
    (void)state;
    const struct sim_signal_step steps[] = {{2, 3}, {5, -1}};
    const struct sim_drive drives[] = {
        {.input = 1,
         .signal = {.kind = SIM_STEPS, .value = 1, .steps = steps, .n_steps = COUNT(steps)}}};
    const double u[] = {1, 1, 3, 3, 3, -1, -1, -1};
    for (int kind = SIM_CVODE; kind <= SIM_RK4; kind++) {
        struct sim_config config = config_of(drives, 1);
        config.integrator = (enum sim_integrator)kind;
        struct simulator *sim = must_create(&config);
        double b = 0;
        for (int k = 0; k < COUNT(u); k++) {
            near_to(sim_input(sim)[1], u[k], 0);
            near_to(sim_state(sim)[1], b, 1e-8);
            b += 0.25 * u[k];
            must_step(sim);
        }
        sim_destroy(sim);
    }
}

/* a' = 2 + 3 sin(4 t) within the samples too, and the rate input follows. */
static void a_sinusoid_goes_on_between_the_samples(void **state)
{
    (void)state;
    const struct sim_drive drives[] = {
        {.input = 0, .signal = {.kind = SIM_SINUSOID, .value = 2, .amplitude = 3, .omega = 4}}};
    const double error[] = {[SIM_CVODE] = 1e-6, [SIM_RK4] = 1e-3};
    for (int kind = SIM_CVODE; kind <= SIM_RK4; kind++) {
        struct sim_config config = config_of(drives, 1);
        config.integrator = (enum sim_integrator)kind;
        struct simulator *sim = must_create(&config);
        for (int k = 0; k < 40; k++) {
            const double t = 0.25 * k;
            near_to(sim_input(sim)[0], 2 + 3 * sin(4 * t), 1e-12);
            near_to(sim_input(sim)[2], 12 * cos(4 * t), 1e-12);
            near_to(sim_state(sim)[0], 2 * t + 0.75 * (1 - cos(4 * t)), error[kind]);
            must_step(sim);
        }
        sim_destroy(sim);
    }
}

/* b' = u_1 under a controller of gain 1: b_(k+1) = b_k + T (r - b_k). */
static void a_loop_acts_on_what_it_measures(void **state)
{
    (void)state;
    const struct sim_loop proportional = {
        .output = 1, .outer = {.kp = 1}, .low = -100, .high = 100};
    const struct sim_drive drives[] = {{.input = 1, .signal = {.value = 8}, .loop = &proportional}};
    struct sim_config config = config_of(drives, 1);
    struct simulator *sim = must_create(&config);
    double b = 0;
    for (int k = 0; k < 30; k++) {
        near_to(sim_input(sim)[1], 8 - b, 1e-7);
        near_to(sim_state(sim)[1], b, 1e-7);
        b += 0.25 * (8 - b);
        must_step(sim);
    }
    sim_destroy(sim);
}

static void drives_leave_the_noise_as_it_was(void **state)
{
    (void)state;
    static const double scale[] = {1, 1};
    const struct sim_drive drives[] = {
        {.input = 1, .signal = {.kind = SIM_PRBS, .amplitude = 1, .bit_samples = 2}}};
    struct sim_config config = config_of(drives, 1);
    config.measurement = (struct sim_noise){.distribution = SIM_GAUSSIAN, .scale = scale};
    struct sim_config still = config;
    still.n_drives = 0;
    struct simulator *driven = must_create(&config), *rest = must_create(&still);
    for (int k = 0; k < 20; k++) {
        near_to(sim_output(driven)[1] - sim_state(driven)[1],
                sim_output(rest)[1] - sim_state(rest)[1], 1e-12);
        must_step(driven);
        must_step(rest);
    }
    sim_destroy(driven);
    sim_destroy(rest);
}

static void wrong_drives_are_refused_with_a_reason(void **state)
{
    (void)state;
    const struct sim_signal_step back[] = {{5, 1}, {5, 2}};
    const struct sim_loop far = {.output = 2, .low = 0, .high = 1};
    const struct sim_loop narrow = {.output = 0, .low = 1, .high = 1};
    const struct sim_loop slow = {.output = 0, .low = 0, .high = 1, .lag = -1};
    const struct {
        struct sim_drive drives[2];
        int n;
        const char *words;
    } cases[] = {
        {{{.input = 3}}, 1, "there is no input 3"},
        {{{.input = 1}, {.input = 1}}, 2, "ub is driven twice"},
        {{{.input = 2}}, 1, "dua is a time derivative"},
        {{{.input = 1, .signal = {.value = NAN}}}, 1, "ub has a number that is not finite"},
        {{{.input = 1, .signal = {.kind = SIM_STEPS, .steps = back, .n_steps = 2}}},
         1,
         "do not ascend"},
        {{{.input = 1, .signal = {.kind = SIM_PRBS}}}, 1, "bits of ub are shorter"},
        {{{.input = 1, .loop = &far}}, 1, "loop of ub has no output"},
        {{{.input = 1, .loop = &narrow}}, 1, "limits of the loop of ub"},
        {{{.input = 1, .loop = &slow}}, 1, "setting of the loop of ub"},
    };
    for (int c = 0; c < COUNT(cases); c++) {
        char reason[REASON] = "";
        const struct sim_config config = config_of(cases[c].drives, cases[c].n);
        assert_null(sim_create(&config, reason, REASON));
        if (strstr(reason, cases[c].words) == NULL)
            fail_msg("'%s' is not in '%s'", cases[c].words, reason);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(steps_act_from_their_sample_on),
        cmocka_unit_test(a_sinusoid_has_its_derivative),
        cmocka_unit_test(a_sinusoid_begins_at_its_phase),
        cmocka_unit_test(prbs_repeats_after_2047_bits_and_is_white_within),
        cmocka_unit_test(prbs_begins_where_seed_and_stream_put_it),
        cmocka_unit_test(pid_brings_its_measurement_to_the_set_point),
        cmocka_unit_test(pid_begins_without_a_bump),
        cmocka_unit_test(pid_is_the_formula),
        cmocka_unit_test(pid_does_not_wind_up_at_a_limit),
        cmocka_unit_test(cascade_brings_its_level_to_the_set_point_within_its_limits),
        cmocka_unit_test(pump_lags_behind_its_command),
        cmocka_unit_test(a_missing_measurement_leaves_the_latest_in_force),
        cmocka_unit_test(stepped_inputs_are_held_over_their_samples),
        cmocka_unit_test(a_sinusoid_goes_on_between_the_samples),
        cmocka_unit_test(a_loop_acts_on_what_it_measures),
        cmocka_unit_test(drives_leave_the_noise_as_it_was),
        cmocka_unit_test(wrong_drives_are_refused_with_a_reason),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
