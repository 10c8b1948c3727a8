/* The plant simulator on small plants of the test's own: solutions in closed form, a stiff problem
 * of the literature, plants that break. The shipped plants: tests/golden/golden_simulator.c. */
#define _POSIX_C_SOURCE 200809L /* dup, fileno; NOLINT(bugprone-reserved-identifier) */

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "dse/ode.h"
#include "sim/simulator.h"

#define COUNT(array) ((int)(sizeof(array) / sizeof(array)[0]))
#define REASON       512

/* ---- plants ---- */

typedef enum dse_status (*function)(const struct dse_model *, dse_real, const dse_real *,
                                    const dse_real *, dse_real *);

/* "smooth": a' = -rate a + u, b' = 2 t, c' = 0; outputs 0, so that they show the noise alone. */
static enum dse_status smooth_f(const struct dse_model *model, dse_real t, const dse_real *x,
                                const dse_real *u, dse_real *dx)
{
    const double *rate = model->parameters;
    dx[0] = -*rate * x[0] + u[0];
    dx[1] = 2 * t;
    dx[2] = 0;
    return DSE_OK;
}

static enum dse_status zero_h(const struct dse_model *model, dse_real t, const dse_real *x,
                              const dse_real *u, dse_real *y)
{
    (void)t, (void)x, (void)u;
    for (int j = 0; j < model->ny; j++)
        y[j] = 0;
    return DSE_OK;
}

static enum dse_status copy_h(const struct dse_model *model, dse_real t, const dse_real *x,
                              const dse_real *u, dse_real *y)
{
    (void)t, (void)u;
    memcpy(y, x, (size_t)model->ny * sizeof *y);
    return DSE_OK;
}

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

static const struct dse_signal signals[] = {{.name = "a", .unit = "1", .scale = 1},
                                            {.name = "b", .unit = "1", .scale = 1},
                                            {.name = "c", .unit = "1", .scale = 1}};

struct test_plant {
    const char *name;
    int nx, nu, ny;
    enum dse_time_kind time;
    function f, h, dfdx;
    double rate;
};

/* `prepared` is the test plant itself: the library's plants keep numbers there. */
static void test_model(const dse_real *prepared, struct dse_model *model)
{
    const struct test_plant *plant = (const struct test_plant *)(const void *)prepared;
    *model = (struct dse_model){.time = plant->time,
                                .nx = plant->nx,
                                .nu = plant->nu,
                                .ny = plant->ny,
                                .parameters = &plant->rate,
                                .f = plant->f,
                                .h = plant->h,
                                .dfdx = plant->dfdx};
}

static const struct test_plant smooth = {
    .name = "smooth", .nx = 3, .nu = 1, .ny = 2, .f = smooth_f, .h = zero_h, .rate = 5};

/* ---- set-up ---- */

struct setting {
    struct dse_plant plant;
    struct sim_config config;
};

static const double ones[] = {1, 1, 1};

static void set(struct setting *setting, const struct test_plant *plant, double period)
{
    setting->plant = (struct dse_plant){.name = plant->name,
                                        .time_unit = "h",
                                        .nx = plant->nx,
                                        .nu = plant->nu,
                                        .ny = plant->ny,
                                        .states = signals,
                                        .inputs = signals,
                                        .outputs = signals,
                                        .model = test_model};
    setting->config = (struct sim_config){.plant = &setting->plant,
                                          .prepared = (const dse_real *)(const void *)plant,
                                          .x0 = ones,
                                          .u = ones,
                                          .period = period,
                                          .seed = 7};
}

static struct simulator *create(const struct setting *setting)
{
    char reason[REASON] = "";
    struct simulator *sim = sim_create(&setting->config, reason, sizeof reason);
    if (sim == NULL)
        fail_msg("%s", reason);
    return sim;
}

static void step(struct simulator *sim)
{
    char reason[REASON] = "";
    if (!sim_step(sim, reason, sizeof reason))
        fail_msg("%s", reason);
}

static void assert_close(double value, double expected, double tolerance)
{
    if (!(fabs(value - expected) <= tolerance))
        fail_msg("%.17g is not %.17g within %g", value, expected, tolerance);
}

static void assert_same_bits(const double *a, const double *b, int n)
{
    assert_memory_equal(a, b, (size_t)n * sizeof *a);
}

/* ---- integration ---- */

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
    setting.config.process = (struct sim_noise){SIM_UNIFORM, scale};
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
    setting.config.process = (struct sim_noise){SIM_GAUSSIAN, scale};
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
            setting.config.process = (struct sim_noise){SIM_GAUSSIAN, scale};
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

/* ---- noise ---- */

static const enum sim_distribution noisy[] = {SIM_UNIFORM, SIM_GAUSSIAN};

static void run(const struct setting *setting, int samples, double *x /* samples x 3 */,
                double *y /* samples x 2 */)
{
    struct simulator *sim = create(setting);
    for (int k = 0; k < samples; k++) {
        memcpy(x + 3 * k, sim_state(sim), 3 * sizeof *x);
        memcpy(y + 2 * k, sim_output(sim), 2 * sizeof *y);
        step(sim);
    }
    sim_destroy(sim);
}

#define SAMPLES 60

static void the_same_seed_gives_the_same_bits_and_another_one_does_not(void **state)
{
    (void)state;
    static const double scale[] = {1, 2, 3};
    double x[3][3 * SAMPLES];
    double y[3][2 * SAMPLES];
    for (int i = 0; i < COUNT(noisy); i++) {
        struct setting setting;
        set(&setting, &smooth, 0.1);
        setting.config.process = setting.config.measurement = (struct sim_noise){noisy[i], scale};
        run(&setting, SAMPLES, x[0], y[0]);
        run(&setting, SAMPLES, x[1], y[1]);
        setting.config.seed++;
        run(&setting, SAMPLES, x[2], y[2]);
        assert_same_bits(x[0], x[1], 3 * SAMPLES);
        assert_same_bits(y[0], y[1], 2 * SAMPLES);
        for (int k = 1; k < SAMPLES; k++) {
            assert_true(x[0][3 * k] != x[2][3 * k]);
            assert_true(y[0][2 * k] != y[2][2 * k]);
        }
    }
}

static void switching_one_noise_off_leaves_the_other_as_it_was(void **state)
{
    (void)state;
    static const double scale[] = {1, 2, 3};
    static const double none[3] = {0};
    double x[2][3 * SAMPLES];
    double y[2][2 * SAMPLES];
    const struct sim_noise on = {SIM_UNIFORM, scale};
    const struct sim_noise off[] = {{SIM_NONE, NULL}, {SIM_UNIFORM, none}, {SIM_GAUSSIAN, none}};
    for (int i = 0; i < COUNT(off); i++) {
        struct setting setting;
        set(&setting, &smooth, 0.1);
        setting.config.process = setting.config.measurement = on;
        run(&setting, SAMPLES, x[0], y[0]);
        setting.config.measurement = off[i];
        run(&setting, SAMPLES, x[1], y[1]);
        assert_same_bits(x[0], x[1], 3 * SAMPLES);
        for (int k = 0; k < 2 * SAMPLES; k++)
            assert_true(y[1][k] == 0);
        setting.config.measurement = on;
        setting.config.process = off[i];
        run(&setting, SAMPLES, x[1], y[1]);
        assert_same_bits(y[0], y[1], 2 * SAMPLES);
        assert_close(x[1][3 * SAMPLES - 1], 1, 1e-12); /* c' = 0 without noise */
    }
}

static void a_channel_does_not_notice_the_size_of_its_neighbour(void **state)
{
    (void)state;
    static const double scales[2][3] = {{1, 2, 3}, {5, 2, 0}};
    for (int i = 0; i < COUNT(noisy); i++) {
        struct sim_noise_source source[2];
        for (int s = 0; s < 2; s++) {
            const struct sim_noise noise = {noisy[i], scales[s]};
            sim_noise_init(&source[s], &noise, 3, 11, SIM_NOISE_MEASUREMENT);
        }
        for (int k = 0; k < SAMPLES; k++) {
            double value[2][3];
            sim_noise_draw(&source[0], value[0]);
            sim_noise_draw(&source[1], value[1]);
            assert_same_bits(&value[0][1], &value[1][1], 1);
            assert_true(value[1][2] == 0);
        }
    }
}

/* Mean, variance and correlations of 20,000 draws within five standard errors; the bound exactly.
 */
static void noise_has_the_stated_size_and_its_channels_are_independent(void **state)
{
    (void)state;
    enum { DRAWS = 20000, CHANNELS = 4 };
    static const double scale[CHANNELS] = {0.5, 2, 1, 10};
    static const enum sim_noise_kind kinds[CHANNELS] = {
        SIM_NOISE_PROCESS, SIM_NOISE_PROCESS, SIM_NOISE_MEASUREMENT, SIM_NOISE_MEASUREMENT};
    for (int i = 0; i < COUNT(noisy); i++) {
        const struct sim_noise noise[2] = {{noisy[i], scale}, {noisy[i], scale + 2}};
        struct sim_noise_source source[2];
        for (int s = 0; s < 2; s++)
            sim_noise_init(&source[s], &noise[s], 2, 3, kinds[2 * s]);
        double sum[CHANNELS] = {0};
        double product[CHANNELS][CHANNELS] = {{0}};
        double largest = 0;
        for (int k = 0; k < DRAWS; k++) {
            double v[CHANNELS];
            sim_noise_draw(&source[0], v);
            sim_noise_draw(&source[1], v + 2);
            for (int a = 0; a < CHANNELS; a++) {
                v[a] /= scale[a];
                largest = fmax(largest, fabs(v[a]));
                sum[a] += v[a];
                for (int b = 0; b <= a; b++)
                    product[a][b] += v[a] * v[b];
            }
        }
        double variance = noisy[i] == SIM_UNIFORM ? 1.0 / 3 : 1;
        double error = 5 / sqrt(DRAWS);
        assert_true(noisy[i] == SIM_UNIFORM ? largest <= 1 && largest > 0.999 : largest > 3);
        for (int a = 0; a < CHANNELS; a++) {
            assert_close(sum[a] / DRAWS, 0, error * sqrt(variance));
            for (int b = 0; b <= a; b++) /* Var(v^2) <= 2 variance^2 for both distributions */
                assert_close(product[a][b] / DRAWS, a == b ? variance : 0,
                             error * sqrt(2) * variance);
        }
    }
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
                setting.config.process = (struct sim_noise){SIM_UNIFORM, scale};
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
        {"process noise is missing", 1, 0, 0, ones, ones, {SIM_UNIFORM, 0}, {0}, 0, 3},
        {"process noise of c is negative", 1, 0, 0, ones, ones, {SIM_UNIFORM, negative}, {0}, 0, 3},
        {"measurement noise of b", 1, 0, 0, ones, ones, {0}, {SIM_GAUSSIAN, nan_at_b}, 0, 3},
        {"not a differential equation", 1, 0, 0, ones, ones, {0}, {0}, DSE_DISCRETE, 3},
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
        cmocka_unit_test(starts_with_the_given_state_and_input_at_sample_0),
        cmocka_unit_test(cvode_follows_the_exact_solution_without_noise),
        cmocka_unit_test(cvode_holds_the_process_noise_from_sample_to_sample),
        cmocka_unit_test(cvode_does_not_look_beyond_a_sample_with_process_noise),
        cmocka_unit_test(cvode_integrates_a_stiff_plant_with_or_without_its_jacobian),
        cmocka_unit_test(a_looser_tolerance_gives_a_larger_error),
        cmocka_unit_test(the_absolute_tolerance_goes_with_the_scale_of_a_state),
        cmocka_unit_test(rk4_takes_one_classical_step_per_sample),
        cmocka_unit_test(the_same_seed_gives_the_same_bits_and_another_one_does_not),
        cmocka_unit_test(switching_one_noise_off_leaves_the_other_as_it_was),
        cmocka_unit_test(a_channel_does_not_notice_the_size_of_its_neighbour),
        cmocka_unit_test(noise_has_the_stated_size_and_its_channels_are_independent),
        cmocka_unit_test(a_failed_step_says_where_and_changes_nothing),
        cmocka_unit_test(a_trial_point_outside_the_model_is_not_the_end),
        cmocka_unit_test(a_reason_does_not_blame_what_was_overcome),
        cmocka_unit_test(a_reason_is_cut_at_the_size_of_its_buffer),
        cmocka_unit_test(a_failing_integration_writes_nothing_to_stderr),
        cmocka_unit_test(a_plant_that_cannot_be_simulated_is_refused_with_a_reason),
    };
    return cmocka_run_group_tests_name("simulator", tests, NULL, NULL);
}
