/* The adaptation of the high gain: its interval, rise, relaxation and independence of the tick. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "dse/high_gain_ekf.h"
#include "dse/math.h"
#include "near.h"

/* Section 2.6. */
static const struct dse_gain_adaptation section_2_6 = {
    .theta_m = 20, .rise_time = DSE_REAL(0.001), .relaxation = 100, .sharpness = 5, .threshold = 4};

static void gain_stays_in_its_interval_for_any_innovation_and_step(void **state)
{
    (void)state;
    static const dse_real J[] = {0, 3, 4, DSE_REAL(4.1), 5, 1000, DSE_REAL(1e30)};
    static const dse_real h[] = {DSE_REAL(1e-9), DSE_REAL(2.8e-4), DSE_REAL(0.01), 1, 1000};
    static const dse_real theta_m[] = {DSE_REAL(0.75), 1, 3, 20, 80};
    struct dse_gain_adaptation gain = section_2_6;
    for (int a = 0; a < 5; a++) {
        gain.theta_m = theta_m[a];
        for (int b = 0; b < 7; b++) {
            for (int c = 0; c < 5; c++) {
                for (int s = 0; s <= 10; s++) {
                    const dse_real theta = 1 + (dse_real)s / 10 * (2 * theta_m[a] - 1);
                    const dse_real next = dse_gain_adaptation_step(&gain, h[c], J[b], theta);
                    assert_true(next >= 1 && next <= 2 * theta_m[a]);
                }
            }
        }
    }
}

static void gain_reaches_theta_m_in_the_time_of_the_rise_law(void **state)
{
    (void)state;
    /* DeltaT (1 - 1/theta_m) from theta = 1 with mu = 1 */
    const dse_real h = section_2_6.rise_time * (1 - 1 / section_2_6.theta_m);
    assert_near(dse_gain_adaptation_step(&section_2_6, h, 1000, 1), 20, TOLERANCE(1e-10, 1e-3));
    /* then 2 theta_m - theta = theta_m / (1 + theta_m s): algebraically */
    assert_near(dse_gain_adaptation_step(&section_2_6, h + section_2_6.rise_time, 1000, 1),
                40 - DSE_REAL(20) / 21, TOLERANCE(1e-10, 1e-3));
}

static void gain_relaxes_exponentially_without_innovation(void **state)
{
    (void)state;
    const dse_real h = DSE_REAL(0.013);
    assert_true(dse_gain_adaptation_mu(&section_2_6, -1000) <= 0);
    assert_near(dse_gain_adaptation_step(&section_2_6, h, -1000, 31), 1 + 30 * dse_exp(-100 * h),
                TOLERANCE(1e-13, 1e-5));
}

static void saturated_gain_does_not_depend_on_the_tick(void **state)
{
    (void)state;
    dse_real theta = 1;
    for (int k = 0; k < 64; k++) {
        theta = dse_gain_adaptation_step(&section_2_6, DSE_REAL(0.002) / 64, 1000, theta);
    }
    assert_near(theta, dse_gain_adaptation_step(&section_2_6, DSE_REAL(0.002), 1000, 1),
                TOLERANCE(1e-10, 1e-3));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(gain_stays_in_its_interval_for_any_innovation_and_step),
        cmocka_unit_test(gain_reaches_theta_m_in_the_time_of_the_rise_law),
        cmocka_unit_test(gain_relaxes_exponentially_without_innovation),
        cmocka_unit_test(saturated_gain_does_not_depend_on_the_tick),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
