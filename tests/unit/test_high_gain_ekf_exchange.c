/* Adaptive high-gain EKF: what the filters tell each other in the rounds of a tick, in which order,
 * when, and what happens when it is refused, doubled or lost. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "dse/high_gain_ekf.h"
#include "dse/math.h"
#include "dse/ode.h"
#include "high_gain_rig.h"
#include "near.h"

static void order_of_messages_does_not_matter(void **state)
{
    (void)state;
    static struct network forwards, backwards;
    for (int way = 0; way < 2; way++) {
        struct dse_high_gain_ekf_config config = linear_config();
        config.communication = ways[way];
        linear_network(&forwards, &config);
        linear_network(&backwards, &config);
        backwards.backwards = true;
        for (int k = 0; k < 3 * LINEAR_HORIZON; k++) {
            tick(&forwards);
            tick(&backwards);
        }
        assert_same_state(&forwards, &backwards);
    }
}

static void filters_that_share_the_innovation_have_the_same_gain_to_the_last_bit(void **state)
{
    (void)state;
    static struct network network;
    const struct dse_high_gain_ekf_config config = linear_config();
    linear_network(&network, &config);
    dse_real highest = 1;
    for (int k = 0; k < 3 * LINEAR_HORIZON; k++) {
        tick(&network);
        const dse_real theta = dse_high_gain_ekf_theta(&network.filter[0]);
        highest = dse_max(highest, theta);
        dse_real sum = 0;
        for (int i = 0; i < LINEAR_P; i++) {
            const dse_real other = dse_high_gain_ekf_theta(&network.filter[i]);
            assert_memory_equal(&other, &theta, sizeof theta);
            sum += dse_high_gain_ekf_innovation(&network.filter[i]);
        }
        assert_near(dse_high_gain_ekf_drive(&network.filter[1]), sum, 0);
    }
    assert_true(highest > 2); /* it did move */
}

static void stages_give_all_filters_one_common_picture(void **state)
{
    (void)state;
    static struct network network;
    struct dse_high_gain_ekf_config config = linear_config();
    config.communication = DSE_HIGH_GAIN_STAGES;
    linear_network(&network, &config);
    for (int k = 0; k < LINEAR_HORIZON; k++) {
        tick(&network);
        for (int i = 1; i < LINEAR_P; i++) {
            assert_memory_equal(network.filter[i].base, network.filter[0].base,
                                LINEAR_N * sizeof(dse_real));
        }
    }
}

static void messages_follow_the_schedule(void **state)
{
    (void)state;
    static struct network network;
    static const struct {
        enum dse_high_gain_communication communication;
        enum dse_high_gain_innovation innovation;
        int every;
        int rounds[4], count[4]; /* of filter 0, which has two states */
    } cases[] = {
        {DSE_HIGH_GAIN_TICK, DSE_HIGH_GAIN_OWN, 0, {1, 1, 1, 1}, {3, 3, 3, 3}},
        {DSE_HIGH_GAIN_TICK, DSE_HIGH_GAIN_OWN, 3, {1, 0, 0, 1}, {3, 0, 0, 3}},
        {DSE_HIGH_GAIN_TICK, DSE_HIGH_GAIN_SUM, 3, {1, 1, 1, 1}, {3, 1, 1, 3}},
        {DSE_HIGH_GAIN_STAGES, DSE_HIGH_GAIN_SUM, 1, {4, 4, 4, 4}, {3, 3, 3, 3}},
        {DSE_HIGH_GAIN_NONE, DSE_HIGH_GAIN_OWN, 1, {0, 0, 0, 0}, {0, 0, 0, 0}},
    };
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++) {
        struct dse_high_gain_ekf_config config = linear_config();
        config.communication = cases[c].communication;
        config.innovation = cases[c].innovation;
        config.comm_every_ticks = cases[c].every;
        linear_network(&network, &config);
        for (int k = 0; k < 4; k++) {
            dse_real message[DSE_HIGH_GAIN_EKF_MESSAGE(2)];
            begin_tick(&network);
            assert_int_equal(dse_high_gain_ekf_rounds(&network.filter[0]), cases[c].rounds[k]);
            assert_int_equal(dse_high_gain_ekf_message(&network.filter[0], 0, message),
                             cases[c].count[k]);
            /* not the time of the other rounds */
            assert_int_equal(dse_high_gain_ekf_message(&network.filter[0], 1, message), 0);
            assert_int_equal(dse_high_gain_ekf_message(&network.filter[0], -1, message), 0);
            end_tick(&network);
        }
    }
}

static void refused_messages_change_nothing_but_the_counter(void **state)
{
    (void)state;
    static struct network clean, disturbed;
    const dse_real good[4] = {1, 2, 3, 4}, nan[3] = {1, (dse_real)NAN, 3},
                   inf[3] = {(dse_real)INFINITY, 2, 3};
    const struct dse_high_gain_ekf_config config = linear_config();
    linear_network(&clean, &config);
    linear_network(&disturbed, &config);
    tick(&clean);
    struct dse_high_gain_ekf *f = &disturbed.filter[0];
    assert_int_equal(dse_high_gain_ekf_receive(f, 0, 2, good, 3), DSE_EINVAL); /* no tick open */
    begin_tick(&disturbed);
    assert_int_equal(dse_high_gain_ekf_receive(f, 1, 2, good, 3), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_receive(f, -1, 2, good, 3), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_receive(f, 0, 0, good, 3), DSE_EINVAL); /* from itself */
    assert_int_equal(dse_high_gain_ekf_receive(f, 0, 3, good, 3), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_receive(f, 0, -1, good, 3), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_receive(f, 0, 2, NULL, 3), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_receive(f, 0, 2, good, 1), DSE_EFORMAT);
    assert_int_equal(dse_high_gain_ekf_receive(f, 0, 2, good, 4), DSE_EFORMAT);
    assert_int_equal(dse_high_gain_ekf_receive(f, 0, 1, good, 3), DSE_EFORMAT); /* one state */
    assert_int_equal(dse_high_gain_ekf_receive(f, 0, 2, nan, 3), DSE_ENONFINITE);
    assert_int_equal(dse_high_gain_ekf_receive(f, 0, 2, inf, 3), DSE_ENONFINITE);
    end_tick(&disturbed);
    assert_same_state(&clean, &disturbed);
    assert_int_equal(dse_high_gain_ekf_counters(f)->refused, 12);
    assert_int_equal(dse_high_gain_ekf_counters(&clean.filter[0])->refused, 0);
}

static void second_message_of_a_sender_is_ignored(void **state)
{
    (void)state;
    static struct network clean, disturbed;
    const struct dse_high_gain_ekf_config config = linear_config();
    linear_network(&clean, &config);
    linear_network(&disturbed, &config);
    tick(&clean);
    begin_tick(&disturbed);
    dse_real message[DSE_HIGH_GAIN_EKF_MESSAGE(2)];
    assert_int_equal(dse_high_gain_ekf_message(&disturbed.filter[2], 0, message), 3);
    assert_int_equal(dse_high_gain_ekf_receive(&disturbed.filter[0], 0, 2, message, 3), DSE_OK);
    message[1] += 100;
    assert_int_equal(dse_high_gain_ekf_receive(&disturbed.filter[0], 0, 2, message, 3), DSE_OK);
    end_tick(&disturbed);
    assert_same_state(&clean, &disturbed);
    assert_int_equal(dse_high_gain_ekf_counters(&disturbed.filter[0])->duplicates, 2);
}

/* Filter 0 loses the message of filter 2 in one tick: its block goes on as the model predicts, the
 * innovation of filter 2 is the last one known. */
static void lost_message_is_predicted_or_held_and_counted(void **state)
{
    (void)state;
    static struct network network;
    for (int hold = 0; hold < 2; hold++) {
        struct dse_high_gain_ekf_config config = linear_config();
        config.predictor = hold ? DSE_HIGH_GAIN_HOLD : DSE_HIGH_GAIN_PREDICT;
        linear_network(&network, &config);
        tick(&network);
        tick(&network);
        const dse_real last_J = dse_high_gain_ekf_innovation(&network.filter[2]);
        dse_real before[LINEAR_N];
        memcpy(before, dse_high_gain_ekf_picture(&network.filter[0]), sizeof before);
        network.lose[0][2] = true;
        tick(&network);
        const struct dse_high_gain_ekf *f = &network.filter[0];
        assert_near(f->base[3], before[3], 0);
        assert_near(f->base[4], before[4], 0);
        assert_near(dse_high_gain_ekf_drive(f),
                    dse_high_gain_ekf_innovation(f) +
                        dse_high_gain_ekf_innovation(&network.filter[1]) + last_J,
                    TOLERANCE(1e-14, 1e-6));
        assert_int_equal(dse_high_gain_ekf_counters(f)->missing_states, 1);
        assert_int_equal(dse_high_gain_ekf_counters(f)->missing_innovations, 1);
        assert_int_equal(dse_high_gain_ekf_counters(&network.filter[1])->missing_states, 0);
        assert_true(hold == (dse_abs(f->x[3] - before[3]) <= 0));
        /* the next message mends the picture */
        network.lose[0][2] = false;
        const dse_real mended = dse_high_gain_ekf_picture(&network.filter[2])[3];
        tick(&network);
        assert_near(f->base[3], mended, 0);
    }
}

/* Between messages block j /= i follows z_j' = A_j z_j + b_j(x^{p,i}) (3.7). Filter 1's own block
 * does not move here: no measurement, and its state does not act on the others. */
static void predictor_follows_the_model_between_messages(void **state)
{
    (void)state;
    static struct network network;
    struct dse_high_gain_ekf_config config = linear_config();
    config.comm_every_ticks = 1000;
    config.innovation = DSE_HIGH_GAIN_OWN;
    linear_network(&network, &config);
    network.blind[1] = true; /* then filter 1 is a model and nothing else */
    dse_real free_run[LINEAR_N], scratch[DSE_RK4_SCRATCH(LINEAR_N)];
    memcpy(free_run, network.x0, sizeof free_run);
    for (int k = 0; k < 50; k++) {
        tick(&network);
        assert_int_equal(
            dse_rk4_model_step(&network.model, 0, config.period, NULL, free_run, scratch), DSE_OK);
    }
    for (int r = 0; r < LINEAR_N; r++) {
        assert_near(dse_high_gain_ekf_picture(&network.filter[1])[r], free_run[r],
                    TOLERANCE(1e-13, 1e-5));
    }
}

static void decentralised_filter_with_hold_keeps_the_guess_of_its_neighbours(void **state)
{
    (void)state;
    static struct network network;
    struct dse_high_gain_ekf_config config = linear_config();
    config.communication = DSE_HIGH_GAIN_NONE;
    config.innovation = DSE_HIGH_GAIN_OWN;
    config.predictor = DSE_HIGH_GAIN_HOLD;
    linear_network(&network, &config);
    for (int k = 0; k < 20; k++) {
        tick(&network);
    }
    assert_memory_equal(dse_high_gain_ekf_picture(&network.filter[0]) + 2, network.x0 + 2,
                        3 * sizeof(dse_real));
    assert_memory_equal(dse_high_gain_ekf_picture(&network.filter[2]), network.x0,
                        3 * sizeof(dse_real));
    assert_int_equal(dse_high_gain_ekf_counters(&network.filter[0])->missing_states, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(order_of_messages_does_not_matter),
        cmocka_unit_test(filters_that_share_the_innovation_have_the_same_gain_to_the_last_bit),
        cmocka_unit_test(stages_give_all_filters_one_common_picture),
        cmocka_unit_test(messages_follow_the_schedule),
        cmocka_unit_test(refused_messages_change_nothing_but_the_counter),
        cmocka_unit_test(second_message_of_a_sender_is_ignored),
        cmocka_unit_test(lost_message_is_predicted_or_held_and_counted),
        cmocka_unit_test(predictor_follows_the_model_between_messages),
        cmocka_unit_test(decentralised_filter_with_hold_keeps_the_guess_of_its_neighbours),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
