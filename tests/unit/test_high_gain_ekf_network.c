/* Adaptive high-gain EKF over networks that keep silent until a trigger, and with a predictor that
 * knows the plant badly. Agreement with independent runs is the golden tests' matter. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "dse/high_gain_ekf.h"
#include "dse/math.h"
#include "dse/plant.h"
#include "high_gain_rig.h"
#include "near.h"

enum { P = 2, N = 4, EVERY = MAX_EVERY };

/* ---- triggers ---- */

static void silent_filter_is_held_and_no_loss_is_counted(void **state)
{
    (void)state;
    static struct network network;
    struct dse_high_gain_ekf_config config = late_config();
    config.communication = DSE_HIGH_GAIN_TRIGGERED;
    config.innovation = DSE_HIGH_GAIN_SUM;
    config.predictor = DSE_HIGH_GAIN_HOLD;
    config.max_delay = 0;
    config.trigger = (struct dse_trigger_config){.threshold = 3};
    late_network(&network, &config);
    dse_real last[P][2] = {{0}};
    int heard = 0, told[P] = {0}, lost = 0;
    for (int k = 0; k < 40 * EVERY; k++) {
        dse_real message[P][DSE_HIGH_GAIN_EKF_MESSAGE(2)];
        int count[P];
        const bool deaf = k >= 2 * EVERY && k < 8 * EVERY; /* 1 does not hear 0 */
        begin_late_tick(&network);
        for (int i = 0; i < P; i++) {
            const dse_real *own = network.filter[i].base + 2 * i;
            const bool far =
                told[i] == 0 || !(dse_sqrt((own[0] - last[i][0]) * (own[0] - last[i][0]) +
                                           (own[1] - last[i][1]) * (own[1] - last[i][1])) < 3);
            count[i] = dse_high_gain_ekf_message(&network.filter[i], 0, message[i]);
            assert_int_equal(count[i], k % EVERY == 0 && far ? 4 : 2);
            if (count[i] == 4) {
                memcpy(last[i], own, sizeof last[i]);
                told[i]++;
            }
            assert_near(message[i][1], (dse_real)told[i], 0);
        }
        assert_int_equal(dse_high_gain_ekf_receive(&network.filter[0], 0, 1, message[1], count[1]),
                         DSE_OK);
        if (!deaf) {
            assert_int_equal(
                dse_high_gain_ekf_receive(&network.filter[1], 0, 0, message[0], count[0]), DSE_OK);
            heard += count[0] == 4;
        } else {
            lost += count[0] == 4;
        }
        end_tick(&network);
    }
    assert_true(told[0] > 3 && told[0] < 30 && lost > 0);
    assert_int_equal(dse_high_gain_ekf_counters(&network.filter[0])->missing_states, 0);
    assert_int_equal(dse_high_gain_ekf_counters(&network.filter[1])->missing_states, lost);
    assert_int_equal(dse_high_gain_ekf_counters(&network.filter[0])->transmissions, told[0]);
    assert_int_equal(heard + lost, told[0]);
    assert_memory_equal(dse_high_gain_ekf_picture(&network.filter[1]), last[0], sizeof last[0]);
}

static void relative_trigger_watches_the_physical_estimate(void **state)
{
    (void)state;
    static struct network network;
    static const dse_real H[2] = {200, 1};
    struct dse_high_gain_ekf_config config = late_config();
    config.coords = DSE_HIGH_GAIN_NORMAL;
    config.communication = DSE_HIGH_GAIN_TRIGGERED;
    config.max_delay = 0;
    config.trigger = (struct dse_trigger_config){
        .norm = DSE_TRIGGER_RELATIVE, .threshold = DSE_REAL(0.5), .weights = H};
    late_network(&network, &config);
    dse_real last[2] = {0};
    int told = 0, silent = 0;
    for (int k = 0; k < 40 * EVERY; k++) {
        begin_late_tick(&network);
        const dse_real *chi = dse_high_gain_ekf_estimate(&network.filter[0]);
        if (k % EVERY == 0) {
            const dse_real a = 200 * (chi[0] - last[0]) / last[0], b = (chi[1] - last[1]) / last[1];
            const bool far = k == 0 || !(dse_sqrt(a * a + b * b) < DSE_REAL(0.5));
            assert_int_equal(dse_high_gain_ekf_tells(&network.filter[0]), far);
            told += far;
            silent += !far;
            if (far) {
                memcpy(last, chi, sizeof last);
            }
        } else {
            assert_false(dse_high_gain_ekf_tells(&network.filter[0]));
        }
        end_tick(&network);
    }
    assert_true(told > 2 && silent > 2);
}

/* ---- a predictor with a model of its own ---- */

static void predictor_moves_only_the_neighbours_by_its_own_model(void **state)
{
    (void)state;
    static struct network network;
    static const enum dse_high_gain_coords coords[] = {DSE_HIGH_GAIN_PHYSICAL, DSE_HIGH_GAIN_MAPPED,
                                                       DSE_HIGH_GAIN_NORMAL};
    /* filter 2 believes in 5 m3/h more recycle into reactor 1 */
    dse_real prepared[256];
    struct dse_model wrong;
    prepare_late_plant(prepared, "dFr", 5);
    dse_plant_find("cstr2")->model(prepared, &wrong);
    for (int c = 0; c < 3; c++) {
        struct dse_high_gain_ekf_config config = late_config();
        config.coords = coords[c];
        config.predictor_model = &wrong;
        config.gain = DSE_HIGH_GAIN_ONE;
        late_network(&network, &config);
        const dse_real h = config.period;
        struct dse_high_gain_ekf *f = &network.filter[1];
        assert_int_equal(dse_high_gain_ekf_begin(f, 1, h, network.u, NULL), DSE_OK);
        assert_int_equal(dse_high_gain_ekf_finish(f), DSE_OK);
        dse_real chi[N], right[N], mixed[N];
        memcpy(chi, dse_high_gain_ekf_picture(f), sizeof chi);
        if (coords[c] == DSE_HIGH_GAIN_NORMAL) {
            assert_int_equal(
                network.form.decode(&network.form, 0, dse_high_gain_ekf_picture(f), network.u, chi),
                DSE_OK);
        }
        /* Euler, good to O(h^2): reactor 1 as the wrong model, reactor 2 as the right one */
        assert_int_equal(network.model.f(&network.model, 0, network.x0, network.u, right), DSE_OK);
        assert_int_equal(wrong.f(&wrong, 0, network.x0, network.u, mixed), DSE_OK);
        assert_true(dse_abs(mixed[0] - right[0]) > 100); /* K/h */
        assert_near(chi[0], network.x0[0] + h * mixed[0], TOLERANCE(2e-2, 2e-2));
        assert_true(dse_abs(h * (mixed[0] - right[0])) > DSE_REAL(4e-2));
        assert_near(chi[2], network.x0[2] + h * right[2], TOLERANCE(2e-2, 2e-2));
    }
}

static void predictor_with_the_same_model_is_no_predictor_of_its_own(void **state)
{
    (void)state;
    static struct network a, b;
    static const int due[] = {0, 3, 2, -1, 6, 5};
    for (int c = 0; c < 3; c++) {
        struct dse_high_gain_ekf_config config = late_config();
        config.coords = (enum dse_high_gain_coords)c;
        late_network(&a, &config);
        config.predictor_model = &a.model;
        late_network(&b, &config);
        for (int k = 0; k < 8 * EVERY; k++) {
            late_tick(&a, due, 6);
            late_tick(&b, due, 6);
        }
        assert_same_pictures(&a, &b);
    }
}

/* ---- set-up ---- */

enum {
    STORAGE = DSE_HIGH_GAIN_EKF_STORAGE(N, 2, P, P, 2, LATE_HORIZON) +
              DSE_HIGH_GAIN_EKF_DELAY_STORAGE(N, 2, P, MAX_DELAY, MAX_EVERY)
};

static enum dse_status init_with(const struct dse_high_gain_ekf_config *config, int missing)
{
    static dse_real memory[STORAGE];
    struct dse_high_gain_ekf filter;
    struct dse_arena arena;
    dse_arena_init(&arena, memory, STORAGE - missing);
    const enum dse_status status = dse_high_gain_ekf_init(&filter, config, &arena);
    if (status == DSE_OK) {
        assert_int_equal(arena.used, STORAGE);
    }
    return status;
}

#define REFUSES(status, change)                                                                    \
    do {                                                                                           \
        struct dse_high_gain_ekf_config config = good;                                             \
        change;                                                                                    \
        assert_int_equal(init_with(&config, 0), status);                                           \
    } while (0)

static void impossible_networks_are_refused(void **state)
{
    (void)state;
    static struct network network;
    const struct dse_high_gain_ekf_config base = late_config();
    late_network(&network, &base);
    const struct dse_high_gain_ekf_config good = network.config[0];
    assert_int_equal(init_with(&good, 0), DSE_OK);
    assert_int_equal(init_with(&good, 1), DSE_ESTORAGE);
    REFUSES(DSE_EINVAL, config.max_delay = -1);
    REFUSES(DSE_EINVAL, config.communication = DSE_HIGH_GAIN_TRIGGERED);
    REFUSES(DSE_EINVAL, config.communication = DSE_HIGH_GAIN_STAGES; config.comm_every_ticks = 1);
    REFUSES(DSE_EINVAL, config.trigger.threshold = -1);
    struct dse_model other = network.model;
    other.nx = 3;
    REFUSES(DSE_EDIM, config.predictor_model = &other);
    other = network.model;
    other.time = DSE_DISCRETE;
    REFUSES(DSE_EINVAL, config.predictor_model = &other);
    struct dse_normal_form form = network.form;
    form.push = NULL;
    REFUSES(DSE_OK, config.form = &form; config.predictor_model = &network.model);
    REFUSES(DSE_EINVAL, config.form = &form; config.predictor_model = &network.model;
            config.coords = DSE_HIGH_GAIN_NORMAL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(silent_filter_is_held_and_no_loss_is_counted),
        cmocka_unit_test(relative_trigger_watches_the_physical_estimate),
        cmocka_unit_test(predictor_moves_only_the_neighbours_by_its_own_model),
        cmocka_unit_test(predictor_with_the_same_model_is_no_predictor_of_its_own),
        cmocka_unit_test(impossible_networks_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
