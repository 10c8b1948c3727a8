/* Distributed adaptive high-gain EKF: the innovation, the order of its steps, set-up. Agreement
 * with independent reference runs is the golden tests' matter. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "dse/high_gain_ekf.h"
#include "dse/ode.h"
#include "high_gain_rig.h"
#include "near.h"

/* ---- the innovation ---- */

/* J_i of a tick, literally: restart from the picture N_d ticks ago, trapezoid rule. */
static void running_predictions_give_the_integral_over_the_horizon(void **state)
{
    (void)state;
    enum { TICKS = 4 * LINEAR_HORIZON };
    static struct network network;
    dse_real picture[TICKS][LINEAR_N], y[TICKS];
    const struct dse_high_gain_ekf_config config = linear_config();
    linear_network(&network, &config);
    for (int k = 0; k < TICKS; k++) {
        y[k] = network.x[0];
        tick(&network);
        memcpy(picture[k], network.filter[0].base, sizeof picture[k]);
        const int start = k > LINEAR_HORIZON ? k - LINEAR_HORIZON : 0;
        dse_real chi[LINEAR_N], scratch[DSE_RK4_SCRATCH(LINEAR_N)], J = 0;
        memcpy(chi, picture[start], sizeof chi);
        for (int l = start; l <= k; l++) {
            const dse_real e = y[l] - chi[0];
            const dse_real weight = l == start || l == k ? DSE_REAL(0.5) : 1;
            J += k == start ? 0 : weight * config.period * e * e;
            assert_int_equal(
                dse_rk4_model_step(&network.model, 0, config.period, NULL, chi, scratch), DSE_OK);
        }
        assert_near(dse_high_gain_ekf_innovation(&network.filter[0]), J, TOLERANCE(1e-13, 1e-5));
    }
}

/* A prediction from a bad start may leave the model's region; the filter goes on. */
static void prediction_that_cannot_go_on_stands_still(void **state)
{
    (void)state;
    static struct network network;
    const struct dse_high_gain_ekf_config config = linear_config();
    for (int wild = 0; wild < 2; wild++) {
        struct linear lost = coupled; /* the model that the predictions use; the form still works */
        lost.broken = wild == 0;
        lost.wild = wild == 1;
        linear_network(&network, &config);
        tick(&network);
        struct dse_high_gain_ekf *f = &network.filter[0];
        dse_real before[LINEAR_N];
        memcpy(before, f->ring, sizeof before);
        begin_tick(&network);
        network.model.parameters = &lost;
        exchange(&network, 0);
        assert_int_equal(dse_high_gain_ekf_advance(f, 0), DSE_OK);
        assert_int_equal(dse_high_gain_ekf_finish(f), DSE_OK);
        assert_memory_equal(f->ring, before, sizeof before);
        assert_int_equal(dse_high_gain_ekf_counters(f)->frozen_predictions, 2);
        assert_int_equal(dse_high_gain_ekf_health(f), DSE_HEALTH_TRACKING);
    }
}

/* ---- a tick and set-up ---- */

static void steps_of_a_tick_have_one_order(void **state)
{
    (void)state;
    static struct network network;
    const struct dse_high_gain_ekf_config config = linear_config();
    linear_network(&network, &config);
    struct dse_high_gain_ekf *f = &network.filter[0];
    assert_int_equal(dse_high_gain_ekf_rounds(f), 0);
    assert_int_equal(dse_high_gain_ekf_advance(f, 0), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_finish(f), DSE_EINVAL);
    begin_tick(&network);
    assert_int_equal(dse_high_gain_ekf_finish(f), DSE_EINVAL); /* a round is open */
    assert_int_equal(dse_high_gain_ekf_advance(f, 1), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_advance(f, 0), DSE_OK);
    assert_int_equal(dse_high_gain_ekf_advance(f, 0), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_finish(f), DSE_OK);
    assert_int_equal(dse_high_gain_ekf_counters(f)->ticks, 1);
}

static void storage_is_what_the_constant_says(void **state)
{
    (void)state;
    static struct network network;
    const struct dse_high_gain_ekf_config config = cstr_config();
    cstr_network(&network, &config);
    struct dse_high_gain_ekf filter;
    struct dse_arena arena;
    const int size = DSE_HIGH_GAIN_EKF_STORAGE(4, 2, 2, 2, 2, CSTR_HORIZON);
    dse_arena_init(&arena, network.memory[0], size);
    assert_int_equal(dse_high_gain_ekf_init(&filter, &network.config[0], &arena), DSE_OK);
    assert_int_equal(arena.used, size);
    dse_arena_init(&arena, network.memory[0], size - 1);
    assert_int_equal(dse_high_gain_ekf_init(&filter, &network.config[0], &arena), DSE_ESTORAGE);
    assert_int_equal(dse_high_gain_ekf_init(&filter, &network.config[0], NULL), DSE_ESTORAGE);
}

static struct network refused;

static enum dse_status init_with(const struct dse_high_gain_ekf_config *config)
{
    struct dse_high_gain_ekf filter;
    struct dse_arena arena;
    dse_arena_init(&arena, refused.memory[0], (int)(sizeof refused.memory[0] / sizeof(dse_real)));
    return dse_high_gain_ekf_init(&filter, config, &arena);
}

#define REFUSES(status, change)                                                                    \
    do {                                                                                           \
        struct dse_high_gain_ekf_config config = good;                                             \
        change;                                                                                    \
        assert_int_equal(init_with(&config), status);                                              \
    } while (0)

static void impossible_configurations_are_refused(void **state)
{
    (void)state;
    static const dse_real indefinite[4] = {1, 2, 2, 1}, skew[4] = {1, 1, 0, 1},
                          nan[5] = {(dse_real)NAN, 1, 1, 1, 1}, negative[4] = {-1, 0, 0, 1};
    const struct dse_high_gain_ekf_config base = linear_config();
    linear_network(&refused, &base);
    const struct dse_high_gain_ekf_config good = refused.config[0];
    assert_int_equal(init_with(&good), DSE_OK);
    REFUSES(DSE_EINVAL, config.model = NULL);
    REFUSES(DSE_EINVAL, config.form = NULL);
    REFUSES(DSE_EINVAL, config.i = -1);
    REFUSES(DSE_EINVAL, config.i = 3);
    REFUSES(DSE_EINVAL, config.period = 0);
    REFUSES(DSE_EINVAL, config.period = (dse_real)NAN);
    REFUSES(DSE_EINVAL, config.period = (dse_real)INFINITY);
    REFUSES(DSE_EINVAL, config.R = 0);
    REFUSES(DSE_EINVAL, config.R = (dse_real)NAN);
    REFUSES(DSE_EINVAL, config.horizon = -1);
    REFUSES(DSE_EINVAL, config.horizon = 0); /* adaptation needs one */
    REFUSES(DSE_EINVAL, config.comm_every_ticks = -1);
    REFUSES(DSE_EINVAL, config.x0 = NULL);
    REFUSES(DSE_EINVAL, config.P0 = NULL);
    REFUSES(DSE_EINVAL, config.Q = NULL);
    REFUSES(DSE_EINVAL, config.adaptation.theta_m = DSE_REAL(0.5));
    REFUSES(DSE_EINVAL, config.adaptation.theta_m = (dse_real)NAN);
    REFUSES(DSE_EINVAL, config.adaptation.rise_time = 0);
    REFUSES(DSE_EINVAL, config.adaptation.relaxation = -1);
    REFUSES(DSE_EINVAL, config.adaptation.sharpness = 0);
    REFUSES(DSE_EINVAL, config.adaptation.threshold = (dse_real)NAN);
    REFUSES(DSE_EINVAL, config.coords = (enum dse_high_gain_coords)3);
    REFUSES(DSE_EINVAL, config.scaling = (enum dse_high_gain_scaling)2);
    REFUSES(DSE_EINVAL, config.gain = (enum dse_high_gain_gain)3);
    REFUSES(DSE_EINVAL, config.innovation = (enum dse_high_gain_innovation)2);
    REFUSES(DSE_EINVAL, config.communication = (enum dse_high_gain_communication)4);
    REFUSES(DSE_EINVAL, config.predictor = (enum dse_high_gain_predictor)2);
    REFUSES(DSE_EINVAL, config.communication = DSE_HIGH_GAIN_STAGES; config.comm_every_ticks = 2);
    REFUSES(DSE_EINVAL, config.communication = DSE_HIGH_GAIN_STAGES;
            config.predictor = DSE_HIGH_GAIN_HOLD);
    REFUSES(DSE_EINVAL, config.communication = DSE_HIGH_GAIN_NONE); /* nobody to sum with */
    REFUSES(DSE_ENOTPD, config.P0 = indefinite);
    REFUSES(DSE_EINVAL, config.P0 = skew);
    REFUSES(DSE_ENONFINITE, config.P0 = nan);
    REFUSES(DSE_EINVAL, config.Q = skew);
    REFUSES(DSE_EINVAL, config.Q = negative);
    REFUSES(DSE_ENONFINITE, config.Q = nan);
    REFUSES(DSE_ENONFINITE, config.x0 = nan);
    assert_int_equal(dse_high_gain_ekf_init(NULL, &good, NULL), DSE_EINVAL);

    struct dse_model model = refused.model;
    struct dse_normal_form form = refused.form;
    model.nx = 4;
    REFUSES(DSE_EDIM, config.model = &model);
    model = refused.model;
    model.ny = 2;
    REFUSES(DSE_EDIM, config.model = &model);
    model = refused.model;
    model.time = DSE_DISCRETE;
    REFUSES(DSE_EINVAL, config.model = &model);
    model = refused.model;
    model.dfdx = NULL;
    REFUSES(DSE_OK, config.model = &model);
    REFUSES(DSE_EINVAL, config.model = &model; config.coords = DSE_HIGH_GAIN_PHYSICAL);
    form.decode = NULL;
    REFUSES(DSE_EINVAL, config.form = &form);
    REFUSES(DSE_OK, config.form = &form; config.coords = DSE_HIGH_GAIN_PHYSICAL);
    form = refused.form;
    form.nu = 1;
    REFUSES(DSE_EDIM, config.form = &form);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(running_predictions_give_the_integral_over_the_horizon),
        cmocka_unit_test(prediction_that_cannot_go_on_stands_still),
        cmocka_unit_test(steps_of_a_tick_have_one_order),
        cmocka_unit_test(storage_is_what_the_constant_says),
        cmocka_unit_test(impossible_configurations_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
