/* Adaptive high-gain EKF over networks that delay and lose packets. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "dse/high_gain_ekf.h"
#include "dse/link.h"
#include "dse/ode.h"
#include "high_gain_rig.h"
#include "near.h"

enum { P = 2, N = 4, D = MAX_DELAY, EVERY = MAX_EVERY };

static void packets_without_delay_are_a_plain_exchange(void **state)
{
    (void)state;
    static struct network late, plain;
    static const enum dse_high_gain_predictor predictors[] = {DSE_HIGH_GAIN_PREDICT,
                                                              DSE_HIGH_GAIN_HOLD};
    for (int p = 0; p < 2; p++) {
        struct dse_high_gain_ekf_config config = late_config();
        config.predictor = predictors[p];
        late_network(&late, &config);
        config.max_delay = 0;
        late_network(&plain, &config);
        static const int due[] = {0, 1, 2, 3, 4, 5, 6, 7};
        for (int k = 0; k < 8 * EVERY; k++) {
            late_tick(&late, due, 8);
            late_tick(&plain, due, 8);
        }
        assert_same_pictures(&late, &plain);
        assert_int_equal(dse_high_gain_ekf_counters(&late.filter[0])->replayed_ticks, 0);
    }
}

/* (4.1): from the corrected picture of the packet's instant the whole model runs to now, where the
 * own block is what the filter knows. */
static void late_state_moves_with_the_model_to_the_present(void **state)
{
    (void)state;
    static struct network network;
    const struct dse_high_gain_ekf_config config = late_config();
    static const int never[] = {-1};
    late_network(&network, &config);
    for (int k = 0; k < 2 * EVERY; k++) {
        late_tick(&network, never, 1);
    }
    dse_real own0[2], own1[2], want[N], scratch[DSE_RK4_SCRATCH(N)];
    memcpy(own0, network.said[0][0], sizeof own0);
    memcpy(own1, network.said[0][1], sizeof own1);
    memcpy(want, own0, sizeof own0);
    memcpy(want + 2, network.said[1][0], sizeof own0);
    for (int k = 0; k < 2 * EVERY; k++) {
        if (k == EVERY) {
            memcpy(want, own1, sizeof own1);
        }
        assert_int_equal(dse_rk4_model_step(&network.model, (dse_real)k * config.period,
                                            config.period, network.u, want, scratch),
                         DSE_OK);
    }
    begin_late_tick(&network);
    assert_int_equal(deliver(&network, 0, 0), DSE_OK);
    assert_int_equal(dse_high_gain_ekf_age(&network.filter[0], 1), 2);
    assert_int_equal(dse_high_gain_ekf_advance(&network.filter[0], 0), DSE_OK);
    for (int r = 0; r < 2; r++) {
        assert_near(network.filter[0].base[2 + r], want[2 + r], TOLERANCE(1e-11, 1e-3));
        assert_near(network.filter[0].base[r], network.said[0][2][r], 0);
    }
    assert_int_equal(dse_high_gain_ekf_counters(&network.filter[0])->replayed_ticks, 2 * EVERY);
}

static void order_of_arrival_within_an_instant_does_not_matter(void **state)
{
    (void)state;
    static struct network a, b;
    const struct dse_high_gain_ekf_config config = late_config();
    static const int never[] = {-1};
    late_network(&a, &config);
    late_network(&b, &config);
    for (int k = 0; k < 3 * EVERY; k++) {
        late_tick(&a, never, 1);
        late_tick(&b, never, 1);
    }
    begin_late_tick(&a);
    begin_late_tick(&b);
    for (int s = 0; s < 3; s++) {
        assert_int_equal(deliver(&a, 0, s), DSE_OK);
        assert_int_equal(deliver(&b, 0, 2 - s), DSE_OK);
    }
    assert_int_equal(deliver(&b, 0, 1), DSE_OK); /* a duplicate */
    assert_int_equal(dse_high_gain_ekf_counters(&b.filter[0])->duplicates, 1);
    end_tick(&a);
    end_tick(&b);
    assert_same_pictures(&a, &b);
}

static void held_state_does_not_change_when_an_older_one_comes(void **state)
{
    (void)state;
    static struct network a, b;
    struct dse_high_gain_ekf_config config = late_config();
    config.predictor = DSE_HIGH_GAIN_HOLD;
    late_network(&a, &config);
    late_network(&b, &config);
    static const int in_order[] = {0, -1, 3}, out_of_order[] = {0, 4, 3};
    for (int k = 0; k < 6 * EVERY; k++) {
        late_tick(&a, in_order, 3);
        late_tick(&b, out_of_order, 3);
    }
    assert_same_pictures(&a, &b);
}

/* Two states of the only neighbour: at the newer one's instant everything is known. */
static void older_state_of_a_single_neighbour_adds_nothing_to_a_newer_one(void **state)
{
    (void)state;
    static struct network a, b;
    const struct dse_high_gain_ekf_config config = late_config();
    late_network(&a, &config);
    late_network(&b, &config);
    static const int with_old[] = {0, 3, 3}, without[] = {0, -1, 3};
    for (int k = 0; k < 6 * EVERY; k++) {
        late_tick(&a, with_old, 3);
        late_tick(&b, without, 3);
    }
    assert_same_pictures(&a, &b);
}

static void states_beyond_the_bound_are_dropped_and_counted(void **state)
{
    (void)state;
    static struct network a, b;
    const struct dse_high_gain_ekf_config config = late_config();
    static const int lost[] = {0, -1}, too_late[] = {0, 1 + D + 1}, in_time[] = {0, 1 + D};
    late_network(&a, &config);
    late_network(&b, &config);
    for (int k = 0; k < 7 * EVERY; k++) {
        late_tick(&a, lost, 2);
        late_tick(&b, too_late, 2);
    }
    assert_same_pictures(&a, &b);
    assert_int_equal(dse_high_gain_ekf_counters(&b.filter[0])->too_late, 1);
    /* stamps 1 to 3 had their last chance at instants 4 to 6 */
    assert_int_equal(dse_high_gain_ekf_counters(&b.filter[0])->missing_states, 3);
    late_network(&b, &config);
    for (int k = 0; k < 7 * EVERY; k++) {
        late_tick(&b, in_time, 2);
    }
    assert_int_equal(dse_high_gain_ekf_counters(&b.filter[0])->too_late, 0);
    assert_int_equal(dse_high_gain_ekf_counters(&b.filter[0])->missing_states, 2);
}

static void hold_keeps_the_newest_state_until_a_newer_one_comes(void **state)
{
    (void)state;
    static struct network network;
    struct dse_high_gain_ekf_config config = late_config();
    config.predictor = DSE_HIGH_GAIN_HOLD;
    late_network(&network, &config);
    static const int due[] = {0, -1, 4, 3};
    static const int held[] = {0, 0, 0, 3, 3, 3};
    for (int k = 0; k < 6 * EVERY; k++) {
        late_tick(&network, due, 4);
        assert_memory_equal(dse_high_gain_ekf_picture(&network.filter[0]) + 2,
                            network.said[1][held[k / EVERY]], 2 * sizeof(dse_real));
        assert_int_equal(dse_high_gain_ekf_age(&network.filter[0], 1), k / EVERY - held[k / EVERY]);
    }
}

/* From the true state nothing is to be corrected, whatever is late, and also where the feed jumps
 * and moves under the packets: the past is computed with the inputs of the past, and in normal
 * coordinates encoded anew at each jump. */
static void what_is_exact_stays_exact_under_delays_and_jumping_inputs(void **state)
{
    (void)state;
    static struct network network;
    static const enum dse_high_gain_coords coords[] = {DSE_HIGH_GAIN_PHYSICAL, DSE_HIGH_GAIN_MAPPED,
                                                       DSE_HIGH_GAIN_NORMAL};
    static const int due[] = {0, 3, -1, 5, 7, 5, -1, 10, 8, 9, -1, -1, 15, 13};
    for (int c = 0; c < 3; c++) {
        struct dse_high_gain_ekf_config config = late_config();
        config.coords = coords[c];
        late_network(&network, &config);
        memcpy(network.x, network.x0, sizeof network.x);
        for (int k = 0; k < 16 * EVERY; k++) {
            /* jumps within the periods; in between it moves at a known rate */
            network.u[0] = 5 + (dse_real)(k / 7 % 3);
            network.u[1] = k / 11 % 2 == 0 ? 0 : 30;
            late_tick(&network, due, 14);
            for (int i = 0; i < P; i++) {
                const dse_real *picture = dse_high_gain_ekf_picture(&network.filter[i]);
                dse_real chi[N],
                    end_u[2] = {network.u[0] + network.u[1] * config.period, network.u[1]};
                memcpy(chi, picture, sizeof chi);
                if (coords[c] == DSE_HIGH_GAIN_NORMAL) {
                    assert_int_equal(network.form.decode(&network.form, 0, picture, end_u, chi),
                                     DSE_OK);
                }
                /* the plant of the test holds its input over a tick, so the rate costs O(h) */
                for (int s = 0; s < N; s++) {
                    assert_near(chi[s], network.x[s], DSE_REAL(0.05));
                }
            }
        }
        assert_true(dse_high_gain_ekf_counters(&network.filter[0])->replayed_ticks > 5 * EVERY);
    }
}

static void delays_keep_the_largest_age_within_the_bound(void **state)
{
    (void)state;
    static struct network network;
    const struct dse_high_gain_ekf_config config = late_config();
    const struct dse_link_config lossy = {.max_delay = D, .max_losses = 2, .loss = 0.4, .seed = 4};
    dse_real memory[P][DSE_LINE_STORAGE(D, 2)];
    struct dse_link link[P];
    struct dse_line line[P];
    int largest = 0;
    late_network(&network, &config);
    for (int i = 0; i < P; i++) {
        struct dse_arena arena;
        dse_arena_init(&arena, memory[i], DSE_LINE_STORAGE(D, 2));
        assert_int_equal(dse_link_init(&link[i], &lossy, i, 1 - i), DSE_OK);
        assert_int_equal(dse_line_init(&line[i], D, 2, &arena), DSE_OK);
    }
    for (int k = 0; k < 60 * EVERY; k++) {
        begin_late_tick(&network);
        for (int i = 0; i < P && k % EVERY == 0; i++) {
            const int64_t now = k / EVERY;
            const dse_real *arrived;
            int64_t stamp;
            dse_line_put(&line[i], now, dse_link_fate(&link[i], now), network.said[1 - i][now]);
            while ((arrived = dse_line_take(&line[i], now, &stamp)) != NULL) {
                assert_int_equal(
                    dse_high_gain_ekf_deliver(&network.filter[i], 1 - i, stamp * EVERY, arrived, 2),
                    DSE_OK);
            }
            const int age = dse_high_gain_ekf_largest_age(&network.filter[i]);
            assert_in_range(age, 0, DSE_LINK_MAX_AGE(D, 2));
            largest = age > largest ? age : largest;
        }
        end_tick(&network);
    }
    assert_true(largest >= 3);
}

static void deliveries_that_cannot_be_are_refused(void **state)
{
    (void)state;
    static struct network network;
    const struct dse_high_gain_ekf_config config = late_config();
    struct dse_high_gain_ekf *f = &network.filter[0];
    const dse_real good[2] = {350, 3}, nan[2] = {350, (dse_real)NAN};
    late_network(&network, &config);
    assert_int_equal(dse_high_gain_ekf_deliver(f, 1, 0, good, 2), DSE_EINVAL); /* no tick open */
    begin_late_tick(&network);
    assert_int_equal(dse_high_gain_ekf_deliver(f, 0, 0, good, 2), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_deliver(f, 2, 0, good, 2), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_deliver(f, 1, -EVERY, good, 2), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_deliver(f, 1, EVERY, good, 2), DSE_EINVAL); /* future */
    assert_int_equal(dse_high_gain_ekf_deliver(f, 1, 0, NULL, 2), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_deliver(f, 1, 0, good, 3), DSE_EFORMAT);
    assert_int_equal(dse_high_gain_ekf_deliver(f, 1, 0, nan, 2), DSE_ENONFINITE);
    assert_int_equal(dse_high_gain_ekf_counters(f)->refused, 8);
    assert_int_equal(dse_high_gain_ekf_age(f, 1), -1);
    assert_int_equal(dse_high_gain_ekf_largest_age(f), -1);
    end_tick(&network);
    begin_late_tick(&network); /* no instant */
    assert_int_equal(dse_high_gain_ekf_deliver(f, 1, 0, good, 2), DSE_EINVAL);
}

static void past_before_a_gap_in_the_samples_is_not_replayed(void **state)
{
    (void)state;
    static struct network network;
    const struct dse_high_gain_ekf_config config = late_config();
    static const int never[] = {-1};
    struct dse_high_gain_ekf *f = &network.filter[0];
    late_network(&network, &config);
    for (int k = 0; k < 2 * EVERY; k++) {
        late_tick(&network, never, 1);
    }
    network.k++; /* the sample of instant 2 is left out */
    while (network.k < 4 * EVERY) {
        late_tick(&network, never, 1);
    }
    begin_late_tick(&network);
    assert_int_equal(deliver(&network, 0, 1), DSE_OK);
    assert_int_equal(dse_high_gain_ekf_advance(f, 0), DSE_OK);
    /* from instant 3 on there is a past, and it does not know what came of stamp 1 */
    assert_int_equal(dse_high_gain_ekf_counters(f)->replayed_ticks, EVERY);
}

/* A model that has no past: it fails before a time. */
struct forgetful {
    const struct dse_model *model;
    dse_real since;
};

static enum dse_status forgetful_f(const struct dse_model *model, dse_real t, const dse_real *x,
                                   const dse_real *u, dse_real *dx)
{
    const struct forgetful *forgetful = model->parameters;
    return t < forgetful->since ? DSE_EMODEL : forgetful->model->f(forgetful->model, t, x, u, dx);
}

static void replay_that_fails_leaves_the_running_picture(void **state)
{
    (void)state;
    static struct network a, b;
    struct dse_high_gain_ekf_config config = late_config();
    static const int due[] = {0, 3}, lost[] = {0, -1};
    late_network(&b, &config);
    struct forgetful forgetful = {.model = &a.model};
    struct dse_model wrapper = {.time = DSE_CONTINUOUS,
                                .nx = N,
                                .nu = 2,
                                .ny = P,
                                .parameters = &forgetful,
                                .f = forgetful_f};
    config.predictor_model = &wrapper;
    late_network(&a, &config);
    for (int k = 0; k < 4 * EVERY; k++) {
        forgetful.since = ((dse_real)k - DSE_REAL(0.5)) * config.period;
        late_tick(&a, due, 2);
        late_tick(&b, lost, 2);
    }
    assert_int_equal(dse_high_gain_ekf_counters(&a.filter[0])->failed_replays, 1);
    assert_same_pictures(&a, &b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(packets_without_delay_are_a_plain_exchange),
        cmocka_unit_test(late_state_moves_with_the_model_to_the_present),
        cmocka_unit_test(order_of_arrival_within_an_instant_does_not_matter),
        cmocka_unit_test(held_state_does_not_change_when_an_older_one_comes),
        cmocka_unit_test(older_state_of_a_single_neighbour_adds_nothing_to_a_newer_one),
        cmocka_unit_test(states_beyond_the_bound_are_dropped_and_counted),
        cmocka_unit_test(hold_keeps_the_newest_state_until_a_newer_one_comes),
        cmocka_unit_test(what_is_exact_stays_exact_under_delays_and_jumping_inputs),
        cmocka_unit_test(delays_keep_the_largest_age_within_the_bound),
        cmocka_unit_test(deliveries_that_cannot_be_are_refused),
        cmocka_unit_test(past_before_a_gap_in_the_samples_is_not_replayed),
        cmocka_unit_test(replay_that_fails_leaves_the_running_picture),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
