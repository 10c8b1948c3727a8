/* What may go wrong with a node of a distributed observer: messages, measurements, steps and
 * configurations. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "dse/math.h"
#include "near.h"
#include "observer_scalar.h"

/* ---- messages ---- */

static void lost_neighbour_is_held_then_dropped_and_comes_back_with_no_gain(void **state)
{
    (void)state;
    scalar_config(DSE_OBSERVER_NEIGHBOURS, 2);
    config.hold = 2;
    assert_int_equal(start_node(), DSE_OK);
    assert_int_equal(dse_distributed_observer_hearing(&node, 0), DSE_OBSERVER_DROPPED);
    assert_int_equal(sample_at(0, 0), DSE_OK);
    assert_int_equal(hear(0, 3), DSE_OK);
    assert_int_equal(hear(1, 3), DSE_OK);
    assert_int_equal(dse_distributed_observer_hearing(&node, 0), DSE_OBSERVER_FRESH);
    assert_int_equal(sample_at(DSE_REAL(0.1), 0), DSE_OK);
    const dse_real learnt = gain(0);
    assert_true(learnt > 0);

    static const enum dse_observer_hearing expected[4] = {
        DSE_OBSERVER_HELD, DSE_OBSERVER_HELD, DSE_OBSERVER_DROPPED, DSE_OBSERVER_DROPPED};
    for (int k = 0; k < 4; k++) { /* neighbour 0 is silent, 1 goes on */
        assert_int_equal(dse_distributed_observer_hearing(&node, 0), expected[k]);
        assert_int_equal(hear(1, 3), DSE_OK);
        const dse_real before = gain(1);
        assert_int_equal(sample_at(DSE_REAL(0.1) * (dse_real)(k + 2), 0), DSE_OK);
        assert_true(gain(0) == learnt); /* frozen */
        assert_true(gain(1) > before);
    }
    assert_int_equal(node.dropped, 1);
    assert_int_equal(hear(0, 3), DSE_OK);
    assert_true(gain(0) == 0);
    assert_int_equal(dse_distributed_observer_hearing(&node, 0), DSE_OBSERVER_FRESH);
    assert_int_equal(sample_at(DSE_REAL(0.6), 0), DSE_OK);
    assert_true(gain(0) > 0);
}

static void lost_neighbour_is_held_for_three_periods_unless_told_otherwise(void **state)
{
    (void)state;
    static const struct {
        int hold, periods;
    } cases[] = {{0, 3}, {-1, 0}, {1, 1}, {5, 5}};
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++) {
        scalar_config(DSE_OBSERVER_NEIGHBOURS, 1);
        config.hold = cases[c].hold;
        assert_int_equal(start_node(), DSE_OK);
        assert_int_equal(sample_at(0, 0), DSE_OK);
        assert_int_equal(hear(0, 3), DSE_OK);
        for (int k = 0; k < 7; k++) {
            assert_int_equal(sample_at(DSE_REAL(0.1) * (dse_real)(k + 1), 0), DSE_OK);
            assert_int_equal(dse_distributed_observer_hearing(&node, 0),
                             k < cases[c].periods ? DSE_OBSERVER_HELD : DSE_OBSERVER_DROPPED);
        }
    }
}

/* A held message pulls, a dropped one does not. */
static void held_message_still_couples_and_a_dropped_one_does_not(void **state)
{
    (void)state;
    dse_real with[2];
    for (int hold = 0; hold < 2; hold++) {
        scalar_config(DSE_OBSERVER_NEIGHBOURS, 1);
        config.hold = hold == 0 ? -1 : 1;
        assert_int_equal(start_node(), DSE_OK);
        assert_int_equal(sample_at(0, 0), DSE_OK);
        assert_int_equal(hear(0, 5), DSE_OK);
        assert_int_equal(sample_at(DSE_REAL(0.1), 0), DSE_OK);
        const dse_real z = dse_distributed_observer_z(&node)[0];
        assert_int_equal(sample_at(DSE_REAL(0.2), 0), DSE_OK);
        with[hold] = dse_distributed_observer_z(&node)[0];
        if (hold == 0) { /* alone: the Runge-Kutta step's exp(-0.1) */
            assert_near(with[0], z * DSE_REAL(0.9048375), TOLERANCE(1e-14, 1e-6));
            assert_int_equal(dse_distributed_observer_health(&node), DSE_HEALTH_ALONE);
        }
    }
    assert_true(with[1] > with[0] + DSE_REAL(0.1));
    assert_int_equal(dse_distributed_observer_health(&node), DSE_HEALTH_TRACKING);
}

static void message_that_is_not_finite_is_refused_and_counts_as_not_heard(void **state)
{
    (void)state;
    scalar_config(DSE_OBSERVER_NEIGHBOURS, 1);
    assert_int_equal(start_node(), DSE_OK);
    assert_int_equal(sample_at(0, 0), DSE_OK);
    assert_int_equal(hear(0, (dse_real)NAN), DSE_ENONFINITE);
    assert_int_equal(hear(0, (dse_real)INFINITY), DSE_ENONFINITE);
    assert_int_equal(hear(1, 0), DSE_EINVAL);
    assert_int_equal(hear(-1, 0), DSE_EINVAL);
    assert_int_equal(node.refused, 2);
    assert_int_equal(dse_distributed_observer_hearing(&node, 0), DSE_OBSERVER_DROPPED);
    assert_int_equal(sample_at(1, 0), DSE_OK);
    assert_true(gain(0) == 0);
}

/* ---- measurements and steps ---- */

static void node_without_its_measurement_coasts_silently_and_learns_nothing(void **state)
{
    (void)state;
    scalar_config(DSE_OBSERVER_OWN, 1);
    assert_int_equal(start_node(), DSE_OK);
    assert_int_equal(sample_at(0, 2), DSE_OK);
    assert_true(dse_distributed_observer_may_speak(&node));
    for (int k = 1; k <= 3; k++) { /* nothing comes at 1; the period after it is incomplete too */
        assert_int_equal(hear(0, 5), DSE_OK);
        const dse_real before = gain(0);
        assert_int_equal(sample_at(DSE_REAL(0.1) * (dse_real)k, k == 1 ? (dse_real)NAN : 2),
                         DSE_OK);
        assert_int_equal(dse_distributed_observer_health(&node),
                         k == 1 ? DSE_HEALTH_COASTING : DSE_HEALTH_TRACKING);
        assert_true(dse_distributed_observer_may_speak(&node) == (k != 1));
        assert_true(k < 3 ? gain(0) == before : gain(0) != before);
    }
}

/* z' = -z + y with y held at 2 over a gap: z goes on towards 2. */
static void missing_measurement_is_held_at_its_last_value(void **state)
{
    (void)state;
    scalar_config(DSE_OBSERVER_OWN, 0);
    assert_int_equal(start_node(), DSE_OK);
    assert_int_equal(sample_at(0, 2), DSE_OK);
    for (int k = 1; k <= 40; k++)
        assert_int_equal(sample_at(DSE_REAL(0.25) * (dse_real)k, (dse_real)NAN), DSE_OK);
    assert_near(dse_distributed_observer_estimate(&node)[0], 2, DSE_REAL(1e-3));
    assert_int_equal(dse_distributed_observer_health(&node), DSE_HEALTH_COASTING);
}

static void node_waits_until_every_channel_has_been_seen(void **state)
{
    (void)state;
    static const dse_real L[2] = {1, 0}, N[2] = {0, 1};
    scalar_config(DSE_OBSERVER_OWN, 0);
    config.ny = 2;
    config.L = L;
    config.N = N;
    assert_int_equal(start_node(), DSE_OK);
    static const bool first[2] = {true, false}, second[2] = {false, true};
    static const dse_real y[2] = {4, 7};
    const bool *const valid[2] = {first, second};
    for (int k = 0; k < 2; k++) {
        const struct dse_measurement sample = {y, valid[k]};
        assert_int_equal(dse_distributed_observer_health(&node), DSE_HEALTH_INITIALISING);
        assert_false(dse_distributed_observer_may_speak(&node));
        assert_int_equal(dse_distributed_observer_sample(&node, (dse_real)k, NULL, &sample),
                         DSE_OK);
    }
    assert_int_equal(dse_distributed_observer_health(&node), DSE_HEALTH_COASTING);
    assert_true(dse_distributed_observer_estimate(&node)[0] == 8); /* z0 + y2: nothing integrated */
}

static void failing_step_changes_nothing_and_says_diverged(void **state)
{
    (void)state;
    scalar_config(DSE_OBSERVER_OWN, 1);
    config.gamma = DSE_REAL_MAX;
    assert_int_equal(start_node(), DSE_OK);
    assert_int_equal(sample_at(0, 2), DSE_OK);
    assert_int_equal(hear(0, 1000), DSE_OK);
    const dse_real z = dse_distributed_observer_z(&node)[0];
    assert_int_equal(sample_at(1, 3), DSE_ENONFINITE);
    assert_int_equal(dse_distributed_observer_health(&node), DSE_HEALTH_DIVERGED);
    assert_true(dse_distributed_observer_z(&node)[0] == z);
    assert_true(dse_distributed_observer_estimate(&node)[0] == z);
    assert_true(gain(0) == 0);
    assert_false(dse_distributed_observer_may_speak(&node));
}

/* The gain becomes so large in a period that the next one overflows. */
static void node_that_diverged_goes_on_alone_and_then_learns_again(void **state)
{
    (void)state;
    scalar_config(DSE_OBSERVER_OWN, 1);
    assert_int_equal(start_node(), DSE_OK);
    assert_int_equal(sample_at(0, 2), DSE_OK);
    node.state[1] = DSE_REAL_MAX / 2; /* Gamma */
    assert_int_equal(hear(0, 1000), DSE_OK);
    assert_int_equal(sample_at(DSE_REAL(0.1), 2), DSE_ENONFINITE);
    assert_int_equal(hear(0, 3), DSE_OK);
    assert_int_equal(sample_at(DSE_REAL(0.2), 2), DSE_OK);
    assert_int_equal(dse_distributed_observer_health(&node), DSE_HEALTH_ALONE);
    assert_true(gain(0) == 0);
    /* z' = -z + 2 from 1 over both periods */
    assert_near(dse_distributed_observer_z(&node)[0], 2 - dse_exp(DSE_REAL(-0.2)),
                TOLERANCE(1e-5, 1e-5));
    assert_int_equal(hear(0, 3), DSE_OK);
    assert_int_equal(sample_at(DSE_REAL(0.3), 2), DSE_OK);
    assert_int_equal(dse_distributed_observer_health(&node), DSE_HEALTH_TRACKING);
    assert_true(gain(0) > 0);
}

static void samples_must_be_finite_and_ascend(void **state)
{
    (void)state;
    scalar_config(DSE_OBSERVER_OWN, 0);
    assert_int_equal(start_node(), DSE_OK);
    assert_int_equal(sample_at(1, 0), DSE_OK);
    assert_int_equal(sample_at(1, 0), DSE_EINVAL);
    assert_int_equal(sample_at(DSE_REAL(0.5), 0), DSE_EINVAL);
    assert_int_equal(sample_at((dse_real)NAN, 0), DSE_ENONFINITE);
    assert_int_equal(sample_at(2, 0), DSE_OK);
}

/* ---- configurations ---- */

/* A good configuration with one change. */
#define REFUSED(expected, residual_of, change)                                                     \
    do {                                                                                           \
        scalar_config(residual_of, 1);                                                             \
        assert_int_equal(start_node(), DSE_OK);                                                    \
        (change);                                                                                  \
        assert_int_equal(start_node(), expected);                                                  \
    } while (0)

static void wrong_configurations_are_refused(void **state)
{
    (void)state;
    static const dse_real nothing[1] = {(dse_real)NAN};
    static const struct dse_observer_rows bad_rows[1] = {{-1, one}};
    const enum dse_observer_residual theirs = DSE_OBSERVER_NEIGHBOURS, own = DSE_OBSERVER_OWN;
    REFUSED(DSE_EINVAL, theirs, config.time = (enum dse_time_kind)7);
    REFUSED(DSE_EINVAL, theirs, config.time = DSE_DISCRETE); /* has neighbours */
    REFUSED(DSE_EINVAL, theirs, config.nz = 0);
    REFUSED(DSE_EINVAL, theirs, config.nx = 0);
    REFUSED(DSE_EINVAL, theirs, config.nu = -1);
    REFUSED(DSE_EINVAL, theirs, config.neighbours = -1);
    REFUSED(DSE_EINVAL, theirs, config.nx = 2); /* M is left out: needs nx = nz */
    REFUSED(DSE_EINVAL, theirs, config.Lambda = NULL);
    REFUSED(DSE_ENONFINITE, theirs, config.Lambda = nothing);
    REFUSED(DSE_ENONFINITE, theirs, config.L = nothing);
    REFUSED(DSE_EINVAL, theirs, config.Pi = NULL);
    REFUSED(DSE_ENOTPD, theirs, config.Pi = minus_one);
    REFUSED(DSE_EINVAL, theirs, config.gamma = -1);
    REFUSED(DSE_EINVAL, theirs, config.leak = (dse_real)INFINITY);
    REFUSED(DSE_EINVAL, theirs, config.gain_max = (dse_real)NAN);
    REFUSED(DSE_EINVAL, theirs, config.hold = -2);
    REFUSED(DSE_EINVAL, theirs, config.gain = DSE_OBSERVER_NODE);
    REFUSED(DSE_EINVAL, theirs, config.theirs = NULL);
    REFUSED(DSE_EINVAL, theirs, config.theirs = bad_rows);
    REFUSED(DSE_EINVAL, own, config.residual = (enum dse_observer_residual)5);
    REFUSED(DSE_EINVAL, own, config.gain = (enum dse_observer_gain)5);
    REFUSED(DSE_EINVAL, own, config.D = NULL);
    REFUSED(DSE_EINVAL, own, config.nr = -1);
    REFUSED(DSE_EINVAL, own, config.own = bad_rows[0]);
    REFUSED(DSE_ENONFINITE, own, config.D_y = nothing);
}

static void memory_is_exactly_what_the_macro_says(void **state)
{
    (void)state;
    struct dse_arena arena;
    static const dse_real M[2] = {1, 2}, C2[2] = {0, 1};
    static const struct dse_observer_rows one_row[2] = {{1, C2}, {1, C2}};
    scalar_config(DSE_OBSERVER_NEIGHBOURS, 2);
    config.nx = 2;
    config.M = M;
    config.theirs = one_row;
    const int size = DSE_DISTRIBUTED_OBSERVER_STORAGE(1, 0, 1, 2, 2, 2, 1);
    dse_arena_init(&arena, memory, size - 1);
    assert_int_equal(dse_distributed_observer_init(&node, &config, &arena), DSE_ESTORAGE);
    assert_int_equal(arena.used, 0);
    dse_arena_init(&arena, memory, size);
    assert_int_equal(dse_distributed_observer_init(&node, &config, &arena), DSE_OK);
    assert_int_equal(arena.used, size);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lost_neighbour_is_held_then_dropped_and_comes_back_with_no_gain),
        cmocka_unit_test(lost_neighbour_is_held_for_three_periods_unless_told_otherwise),
        cmocka_unit_test(held_message_still_couples_and_a_dropped_one_does_not),
        cmocka_unit_test(message_that_is_not_finite_is_refused_and_counts_as_not_heard),
        cmocka_unit_test(node_without_its_measurement_coasts_silently_and_learns_nothing),
        cmocka_unit_test(missing_measurement_is_held_at_its_last_value),
        cmocka_unit_test(node_waits_until_every_channel_has_been_seen),
        cmocka_unit_test(failing_step_changes_nothing_and_says_diverged),
        cmocka_unit_test(node_that_diverged_goes_on_alone_and_then_learns_again),
        cmocka_unit_test(samples_must_be_finite_and_ascend),
        cmocka_unit_test(wrong_configurations_are_refused),
        cmocka_unit_test(memory_is_exactly_what_the_macro_says),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
