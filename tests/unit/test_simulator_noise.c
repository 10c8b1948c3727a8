/* The noise of the plant simulator: its seed, its size, its channels. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "sim/simulator.h"
#include "simulator_rig.h"

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
        setting.config.process = setting.config.measurement =
            (struct sim_noise){.distribution = noisy[i], .scale = scale};
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
    const struct sim_noise on = {.distribution = SIM_UNIFORM, .scale = scale};
    const struct sim_noise off[] = {{.distribution = SIM_NONE},
                                    {.distribution = SIM_UNIFORM, .scale = none},
                                    {.distribution = SIM_GAUSSIAN, .scale = none}};
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
            const struct sim_noise noise = {.distribution = noisy[i], .scale = scales[s]};
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

/* The same draws, those beyond the limit put on it: about 4.6 % beyond two standard deviations. */
static void gaussian_noise_stays_within_its_limit(void **state)
{
    (void)state;
    enum { DRAWS = 20000 };
    static const double scale[] = {0.01, 3}, limit[] = {0.02, 1e9};
    const struct sim_noise free = {.distribution = SIM_GAUSSIAN, .scale = scale};
    const struct sim_noise bound = {.distribution = SIM_GAUSSIAN, .scale = scale, .limit = limit};
    struct sim_noise_source source[2];
    int clipped[2] = {0};
    sim_noise_init(&source[0], &free, 2, 5, SIM_NOISE_PROCESS);
    sim_noise_init(&source[1], &bound, 2, 5, SIM_NOISE_PROCESS);
    for (int k = 0; k < DRAWS; k++) {
        double w[2], v[2];
        sim_noise_draw(&source[0], w);
        sim_noise_draw(&source[1], v);
        assert_same_bits(&v[1], &w[1], 1);
        if (fabs(w[0]) <= limit[0]) {
            assert_same_bits(&v[0], &w[0], 1);
        } else {
            assert_true(v[0] == copysign(limit[0], w[0]));
            clipped[w[0] > 0]++;
        }
    }
    assert_in_range(clipped[0], 350, 570); /* 455 expected on either side */
    assert_in_range(clipped[1], 350, 570);
}

/* As many outputs as a plant may have, more than it may have states. */
static void every_output_of_the_largest_plant_has_its_noise(void **state)
{
    (void)state;
    static double scale[DSE_PLANT_MAX_OUTPUTS], value[DSE_PLANT_MAX_OUTPUTS];
    static struct sim_noise_source source;
    for (int j = 0; j < DSE_PLANT_MAX_OUTPUTS; j++)
        scale[j] = j;
    const struct sim_noise noise = {.distribution = SIM_UNIFORM, .scale = scale};
    sim_noise_init(&source, &noise, DSE_PLANT_MAX_OUTPUTS, 1, SIM_NOISE_MEASUREMENT);
    sim_noise_draw(&source, value);
    for (int j = 1; j < DSE_PLANT_MAX_OUTPUTS; j++)
        assert_true(fabs(value[j]) <= scale[j] && value[j] != 0);
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
        const struct sim_noise noise[2] = {{.distribution = noisy[i], .scale = scale},
                                           {.distribution = noisy[i], .scale = scale + 2}};
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

/* Whatever is drawn: the other values are missing by chance as without it. */
static void a_dead_sensor_gives_nothing_and_changes_nothing_else(void **state)
{
    (void)state;
    static const struct sim_outage outages[] = {{.output = 1, .first = 2, .end = 5},
                                                {.output = 1, .first = 8, .end = INT64_MAX}};
    struct setting plain, dead;
    set(&plain, &smooth, 0.1);
    plain.config.missing = 0.3;
    dead = plain;
    dead.config.plant = &dead.plant;
    dead.config.outages = outages;
    dead.config.n_outages = 2;
    struct simulator *sim[2] = {create(&plain), create(&dead)};
    for (int64_t k = 0; k < 60; k++) {
        const bool *valid[2] = {sim_output_valid(sim[0]), sim_output_valid(sim[1])};
        const bool out = (k >= 2 && k < 5) || k >= 8;
        assert_int_equal(valid[1][0], valid[0][0]);
        assert_int_equal(valid[1][1], valid[0][1] && !out);
        step(sim[0]);
        step(sim[1]);
    }
    sim_destroy(sim[0]);
    sim_destroy(sim[1]);
    char reason[REASON] = "";
    static const struct sim_outage wrong = {.output = 2};
    dead.config.outages = &wrong;
    dead.config.n_outages = 1;
    assert_null(sim_create(&dead.config, reason, sizeof reason));
    assert_non_null(strstr(reason, "there is no output 2 to be out"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_same_seed_gives_the_same_bits_and_another_one_does_not),
        cmocka_unit_test(switching_one_noise_off_leaves_the_other_as_it_was),
        cmocka_unit_test(a_channel_does_not_notice_the_size_of_its_neighbour),
        cmocka_unit_test(gaussian_noise_stays_within_its_limit),
        cmocka_unit_test(every_output_of_the_largest_plant_has_its_noise),
        cmocka_unit_test(a_dead_sensor_gives_nothing_and_changes_nothing_else),
        cmocka_unit_test(noise_has_the_stated_size_and_its_channels_are_independent),
    };
    return cmocka_run_group_tests_name("simulator_noise", tests, NULL, NULL);
}
