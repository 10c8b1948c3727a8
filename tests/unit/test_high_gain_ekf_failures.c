/* Adaptive high-gain EKF without measurements, and ticks that fail: the state stays as it was. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "dse/high_gain_ekf.h"
#include "dse/linalg.h"
#include "dse/math.h"
#include "high_gain_rig.h"
#include "near.h"

static void filter_without_measurements_coasts_on_the_model(void **state)
{
    (void)state;
    static struct network network;
    const struct dse_high_gain_ekf_config config = linear_config();
    linear_network(&network, &config);
    struct dse_high_gain_ekf *f = &network.filter[0];
    assert_int_equal(dse_high_gain_ekf_health(f), DSE_HEALTH_INITIALISING);
    network.blind[0] = true;
    tick(&network);
    assert_int_equal(dse_high_gain_ekf_health(f), DSE_HEALTH_INITIALISING);
    network.blind[0] = false;
    tick(&network);
    assert_int_equal(dse_high_gain_ekf_health(f), DSE_HEALTH_TRACKING);

    /* P' = F P + P F' + Q_th: the integral of a linear equation, in small steps */
    network.blind[0] = true;
    dse_real P[4], F[4], FP[4];
    memcpy(P, dse_high_gain_ekf_covariance(f), sizeof P);
    const dse_real *squares = f->ring + (LINEAR_HORIZON + 1) * f->n;
    const dse_real J = squares[0]; /* of slot 0 */
    tick(&network);
    assert_near(squares[0], J, 0);
    assert_int_equal(network.form.jacobian(&network.form, 0, 0, f->x, NULL, F), DSE_OK);
    for (int s = 0; s < 1000; s++) {
        dse_mat_mul(2, 2, 2, F, P, FP);
        for (int k = 0; k < 4; k++) {
            P[k] += config.period / 1000 * (FP[k] + FP[(k % 2) * 2 + k / 2] + f->Q_th[k]);
        }
    }
    for (int k = 0; k < 4; k++) {
        assert_near(dse_high_gain_ekf_covariance(f)[k], P[k], DSE_REAL(1e-3) * (1 + dse_abs(P[k])));
    }
    assert_int_equal(dse_high_gain_ekf_health(f), DSE_HEALTH_COASTING);
    assert_int_equal(dse_high_gain_ekf_counters(f)->missing_measurements, 2);
    assert_near(dse_high_gain_ekf_output_error(f)[0], 0, 0);
    network.blind[0] = false;
    tick(&network);
    assert_int_equal(dse_high_gain_ekf_health(f), DSE_HEALTH_TRACKING);
}

static void measurement_that_is_not_a_number_counts_as_missing(void **state)
{
    (void)state;
    static struct network nan, blind;
    static const dse_real bad[] = {(dse_real)NAN, (dse_real)INFINITY, (dse_real)-INFINITY};
    const struct dse_high_gain_ekf_config config = linear_config();
    for (int b = 0; b < 4; b++) {
        linear_network(&nan, &config);
        linear_network(&blind, &config);
        blind.blind[1] = true;
        begin_tick(&nan);
        const struct dse_measurement own = {.y = &bad[b < 3 ? b : 0]};
        assert_int_equal(dse_high_gain_ekf_begin(&nan.filter[1], 0, 0, NULL, b < 3 ? &own : NULL),
                         DSE_OK);
        end_tick(&nan);
        tick(&blind);
        assert_same_state(&nan, &blind);
    }
}

/* A tick that fails, wherever it does, leaves no trace in the state. */
static void failed_tick_leaves_the_state_as_it_was(void **state)
{
    (void)state;
    static struct network clean, failing;
    for (int way = 0; way < 2; way++) {
        for (int wild = 0; wild < 2; wild++) {
            struct dse_high_gain_ekf_config config = linear_config();
            config.communication = ways[way];
            linear_network(&clean, &config);
            linear_network(&failing, &config);
            for (int k = 0; k < 2 * LINEAR_HORIZON; k++) {
                tick(&clean);
                tick(&failing);
            }
            const dse_real theta = dse_high_gain_ekf_theta(&failing.filter[0]);
            begin_tick(&failing);
            failing.linear.broken = wild == 0;
            failing.linear.wild = wild == 1;
            enum dse_status status[LINEAR_P] = {DSE_OK, DSE_OK, DSE_OK};
            for (int r = 0; r < 4; r++) {
                for (int i = 0; i < LINEAR_P; i++) {
                    if (status[i] == DSE_OK && r < dse_high_gain_ekf_rounds(&failing.filter[i])) {
                        status[i] = dse_high_gain_ekf_advance(&failing.filter[i], r);
                    }
                }
            }
            for (int i = 0; i < LINEAR_P; i++) {
                struct dse_high_gain_ekf *f = &failing.filter[i];
                status[i] = status[i] == DSE_OK ? dse_high_gain_ekf_finish(f) : status[i];
                assert_int_equal(status[i], wild ? DSE_ENONFINITE : DSE_EMODEL);
                assert_int_equal(dse_high_gain_ekf_health(f), DSE_HEALTH_DIVERGED);
                assert_int_equal(dse_high_gain_ekf_counters(f)->failed_ticks, 1);
                assert_int_equal(dse_high_gain_ekf_finish(f), DSE_EINVAL); /* it is closed */
            }
            assert_near(dse_high_gain_ekf_theta(&failing.filter[0]), theta, 0);
            assert_same_state(&clean, &failing);
            /* and it recovers */
            failing.linear = coupled;
            tick(&clean);
            tick(&failing);
            assert_same_state(&clean, &failing);
            assert_int_equal(dse_high_gain_ekf_health(&failing.filter[0]), DSE_HEALTH_TRACKING);
        }
    }
}

/* P' = -P^2/R with h P/R = 4: one explicit step overshoots to a negative P. */
static void tick_that_loses_positive_definiteness_is_given_up(void **state)
{
    (void)state;
    static struct network network;
    struct dse_high_gain_ekf_config config = linear_config();
    config.R = DSE_REAL(0.005);
    linear_network(&network, &config);
    begin_tick(&network);
    struct dse_high_gain_ekf *f = &network.filter[0];
    assert_int_equal(dse_high_gain_ekf_advance(f, 0), DSE_OK);
    assert_int_equal(dse_high_gain_ekf_finish(f), DSE_ENOTPD);
    assert_int_equal(dse_high_gain_ekf_health(f), DSE_HEALTH_DIVERGED);
    assert_memory_equal(dse_high_gain_ekf_covariance(f), network.P0, sizeof network.P0);
}

static void inputs_that_are_not_numbers_fail_the_tick(void **state)
{
    (void)state;
    static struct network network;
    const dse_real nan[2] = {(dse_real)NAN, 0};
    const struct dse_high_gain_ekf_config config = cstr_config();
    cstr_network(&network, &config);
    struct dse_high_gain_ekf *f = &network.filter[0];
    assert_int_equal(dse_high_gain_ekf_begin(f, 0, 0, nan, NULL), DSE_ENONFINITE);
    assert_int_equal(dse_high_gain_ekf_begin(f, 0, 0, NULL, NULL), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_begin(f, -1, 0, network.u, NULL), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_begin(f, 0, nan[0], network.u, NULL), DSE_ENONFINITE);
    assert_int_equal(dse_high_gain_ekf_health(f), DSE_HEALTH_DIVERGED);
    assert_int_equal(dse_high_gain_ekf_counters(f)->failed_ticks, 4);
    tick(&network);
    assert_int_equal(dse_high_gain_ekf_health(f), DSE_HEALTH_TRACKING);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(filter_without_measurements_coasts_on_the_model),
        cmocka_unit_test(measurement_that_is_not_a_number_counts_as_missing),
        cmocka_unit_test(failed_tick_leaves_the_state_as_it_was),
        cmocka_unit_test(tick_that_loses_positive_definiteness_is_given_up),
        cmocka_unit_test(inputs_that_are_not_numbers_fail_the_tick),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
