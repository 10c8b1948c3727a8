/* Distributed Kalman filter: what it does when data, messages or the theory fail it. */
#include <math.h>

#include "dse/distributed_kalman.h"

#include "kalman_network.h"
#include "near.h"

static struct kalman_network network, other;

static const dse_real identity[4] = {1, 0, 0, 1};
static const int ring[] = {0, 1, 1, 2, 2, 3, 3, 0};
enum { RING = 4 };

static void fill_network(struct kalman_network *net, enum dse_dkf_scheme scheme)
{
    static const dse_real x0[RING][2] = {{5, 5}, {-5, -5}, {5, -5}, {-5, 5}};
    *net = (struct kalman_network){.nodes = RING, .model = swinging_plant()};
    net->base = (struct dse_dkf_config){.period = DSE_REAL(0.01),
                                        .sensor = {.ny = 1},
                                        .scheme = scheme,
                                        .gamma = DSE_REAL(0.02),
                                        .P0 = identity,
                                        .Q = identity};
    for (int i = 0; i < RING; i++) {
        network_sense(net, i, 1 + i % 2);
        net->R[i][0] = DSE_REAL(0.1);
        net->x0[i][0] = x0[i][0];
        net->x0[i][1] = x0[i][1];
    }
}

static void make(struct kalman_network *net, enum dse_dkf_scheme scheme)
{
    fill_network(net, scheme);
    assert_int_equal(network_make(net, RING, ring, true), DSE_OK);
}

static void measure(const struct kalman_network *net, const dse_real *x, dse_real *y)
{
    for (int i = 0; i < net->nodes; i++)
        y[i] = dse_dot(2, net->C[i], x);
}

/* A noise-free sample and step; statuses are not looked at. */
static void step(struct kalman_network *net, int k, dse_real *x)
{
    const dse_real t = (dse_real)k * net->base.period;
    dse_real y[RING];
    measure(net, x, y);
    (void)network_hear(net, t, y);
    (void)network_advance(net);
    assert_int_equal(plant_step(&net->model, t, net->base.period, NULL, x), DSE_OK);
}

static void run(struct kalman_network *net, int steps, dse_real *x)
{
    x[0] = 15;
    x[1] = -10;
    for (int k = 0; k < steps; k++)
        step(net, k, x);
}

static dse_real gain(const struct kalman_network *net, int i, int j)
{
    return dse_dkf_gain(&net->node[i], j)[0];
}

/* ---- messages ---- */

static void bad_messages_are_refused_and_counted(void **state)
{
    (void)state;
    dse_real x[2];
    const dse_real bad[] = {(dse_real)NAN, (dse_real)INFINITY, -(dse_real)INFINITY},
                   fine[2] = {1, 2};
    fill_network(&network, DSE_DKF_EDGE);
    network.base.hold = -1;
    assert_int_equal(network_make(&network, RING, ring, true), DSE_OK);
    run(&network, 5, x);
    struct dse_dkf *node = &network.node[0];
    const dse_real y = 1;
    const struct dse_measurement sample = {&y, NULL};
    assert_int_equal(dse_dkf_begin(node, 0, NULL, &sample), DSE_OK);
    for (int k = 0; k < 3; k++)
        assert_int_equal(dse_dkf_receive(node, 0, &bad[k], 1), DSE_ENONFINITE);
    assert_int_equal(dse_dkf_receive(node, 0, fine, 2), DSE_EDIM);
    assert_int_equal(dse_dkf_receive(node, 0, fine, 0), DSE_EDIM);
    assert_int_equal(dse_dkf_receive(node, 2, fine, 1), DSE_EINVAL);
    assert_int_equal(dse_dkf_receive(node, -1, fine, 1), DSE_EINVAL);
    assert_int_equal(dse_dkf_counts(node)->refused, 5);
    assert_int_equal(dse_dkf_receive(node, 1, fine, 1), DSE_OK);
    assert_int_equal(dse_dkf_correct(node), DSE_OK);
    assert_false(dse_dkf_uses(node, 0)); /* as if it had said nothing */
    assert_true(dse_dkf_uses(node, 1));
    assert_int_equal(dse_dkf_health(node), DSE_HEALTH_REJECTING);
    assert_int_equal(dse_dkf_advance(node), DSE_OK);
    assert_true(dse_all_finite(dse_dkf_state(node), 2));
}

/* A message that comes twice in a sample counts once in the sums. */
static void repeated_messages_change_nothing(void **state)
{
    (void)state;
    dse_real x[2], z[2], y[RING];
    make(&network, DSE_DKF_NODE);
    make(&other, DSE_DKF_NODE);
    run(&network, 20, x);
    run(&other, 20, z);
    measure(&network, x, y);
    assert_int_equal(network_hear(&network, 0, y), DSE_OK);
    for (int i = 0; i < RING; i++) {
        const struct dse_measurement sample = {y + i, NULL};
        assert_int_equal(dse_dkf_begin(&other.node[i], 0, NULL, &sample), DSE_OK);
    }
    assert_int_equal(network_exchange(&other), DSE_OK);
    assert_int_equal(network_exchange(&other), DSE_OK);
    for (int i = 0; i < RING; i++)
        assert_int_equal(dse_dkf_correct(&other.node[i]), DSE_OK);
    assert_int_equal(network_advance(&network), DSE_OK);
    assert_int_equal(network_advance(&other), DSE_OK);
    for (int i = 0; i < RING; i++)
        for (int c = 0; c < 2; c++)
            assert_true(dse_dkf_state(&network.node[i])[c] == dse_dkf_state(&other.node[i])[c]);
}

/* ---- lost neighbours ---- */

/* Node 1 hears 0 and 2 as its neighbours 0 and 1; node 0 falls silent. */
static void a_silent_neighbour_is_held_frozen_dropped_and_taken_back(void **state)
{
    (void)state;
    dse_real x[2];
    fill_network(&network, DSE_DKF_EDGE);
    network.base.hold = 3;
    assert_int_equal(network_make(&network, RING, ring, true), DSE_OK);
    run(&network, 30, x);
    const struct dse_dkf *node = &network.node[1];
    const dse_real frozen = gain(&network, 1, 0);
    dse_real moving = gain(&network, 1, 1);
    assert_true(dse_abs(frozen) > DSE_REAL(0.1));

    network.mute[0] = true;
    for (int k = 0; k < 6; k++) {
        step(&network, 30 + k, x);
        assert_true(dse_dkf_uses(node, 0) == (k < 3)); /* its last word, three times */
        assert_true(gain(&network, 1, 0) == frozen);   /* never adapts with an old word */
        assert_true(gain(&network, 1, 1) != moving);
        moving = gain(&network, 1, 1);
    }
    assert_int_equal(dse_dkf_counts(node)->held, 3);
    assert_int_equal(dse_dkf_counts(node)->dropped, 1);
    assert_int_equal(dse_dkf_counts(node)->rejoined, 0);
    assert_int_equal(dse_dkf_health(node), DSE_HEALTH_TRACKING);

    network.mute[0] = false;
    dse_real y[RING];
    measure(&network, x, y);
    assert_int_equal(network_hear(&network, DSE_REAL(0.36), y), DSE_OK);
    assert_true(dse_dkf_uses(node, 0));
    assert_true(gain(&network, 1, 0) == 0);
    assert_int_equal(network_advance(&network), DSE_OK);
    assert_true(gain(&network, 1, 0) != 0);
    assert_int_equal(dse_dkf_counts(node)->rejoined, 1);
}

static void a_node_that_lost_all_neighbours_is_a_local_filter(void **state)
{
    (void)state;
    for (int scheme = DSE_DKF_EDGE; scheme <= DSE_DKF_STANDARD; scheme++) {
        dse_real x[2], z[2];
        make(&network, (enum dse_dkf_scheme)scheme);
        make(&other, DSE_DKF_ALONE);
        for (int i = 0; i < RING; i++)
            network.mute[i] = true;
        run(&network, 50, x);
        run(&other, 50, z);
        for (int i = 0; i < RING; i++) {
            assert_all_near(2, dse_dkf_state(&network.node[i]), dse_dkf_state(&other.node[i]),
                            TOLERANCE(1e-13, 1e-5));
            assert_int_equal(dse_dkf_health(&network.node[i]), DSE_HEALTH_ALONE);
        }
    }
}

static void a_silent_neighbour_is_held_for_three_steps_unless_told_otherwise(void **state)
{
    (void)state;
    static const struct {
        int hold, steps;
    } cases[] = {{0, 3}, {-1, 0}, {1, 1}, {5, 5}};
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++) {
        dse_real x[2];
        fill_network(&network, DSE_DKF_EDGE);
        network.base.hold = cases[c].hold;
        assert_int_equal(network_make(&network, RING, ring, true), DSE_OK);
        run(&network, 1, x);
        network.mute[0] = true;
        for (int k = 0; k < 7; k++) {
            step(&network, 1 + k, x);
            assert_true(dse_dkf_uses(&network.node[1], 0) == (k < cases[c].steps));
        }
    }
}

/* The held word acts: with it the estimate is another one than without. */
static void a_held_word_acts_on_the_estimate(void **state)
{
    (void)state;
    dse_real x[2], z[2];
    fill_network(&network, DSE_DKF_NODE);
    fill_network(&other, DSE_DKF_NODE);
    network.base.hold = 2;
    other.base.hold = -1;
    assert_int_equal(network_make(&network, RING, ring, true), DSE_OK);
    assert_int_equal(network_make(&other, RING, ring, true), DSE_OK);
    run(&network, 30, x);
    run(&other, 30, z);
    network.mute[0] = other.mute[0] = true;
    step(&network, 30, x);
    step(&other, 30, z);
    assert_true(dse_dkf_state(&network.node[1])[0] != dse_dkf_state(&other.node[1])[0]);
}

/* ---- own measurements ---- */

static void a_node_without_measurement_coasts_and_listens(void **state)
{
    (void)state;
    dse_real x[2], y[RING], before[2];
    make(&network, DSE_DKF_EDGE);
    run(&network, 30, x);
    const dse_real gains[2] = {gain(&network, 0, 0), gain(&network, 0, 1)};
    const dse_real variance = dse_dkf_covariance(&network.node[0])[0];
    measure(&network, x, y);
    y[0] = (dse_real)NAN;
    assert_int_equal(network_hear(&network, DSE_REAL(0.3), y), DSE_OK);
    assert_int_equal(network_advance(&network), DSE_OK);
    assert_int_equal(dse_dkf_health(&network.node[0]), DSE_HEALTH_COASTING);
    assert_int_equal(dse_dkf_health(&network.node[1]), DSE_HEALTH_TRACKING);
    assert_int_equal(dse_dkf_counts(&network.node[0])->nonfinite, 1);
    assert_true(gain(&network, 0, 0) == gains[0] && gain(&network, 0, 1) == gains[1]);
    assert_true(dse_dkf_covariance(&network.node[0])[0] > variance); /* nothing was learned */

    /* what is left is plant and coupling: another word of a neighbour makes another estimate */
    const bool missing = false;
    const struct dse_measurement none = {y, &missing};
    for (int c = 0; c < 2; c++)
        before[c] = dse_dkf_state(&network.node[0])[c];
    for (int word = 0; word < 2; word++) {
        const dse_real said = word == 0 ? 0 : 100;
        assert_int_equal(dse_dkf_set(&network.node[0], before, NULL), DSE_OK);
        network.node[0].now[2 + 4] = 1; /* a gain that acts */
        assert_int_equal(dse_dkf_begin(&network.node[0], 0, NULL, &none), DSE_OK);
        assert_int_equal(dse_dkf_receive(&network.node[0], 0, &said, 1), DSE_OK);
        assert_int_equal(dse_dkf_correct(&network.node[0]), DSE_OK);
        assert_int_equal(dse_dkf_advance(&network.node[0]), DSE_OK);
        x[word] = dse_dkf_state(&network.node[0])[0];
    }
    assert_true(dse_abs(x[1] - x[0]) > DSE_REAL(1e-4));
    assert_int_equal(dse_dkf_counts(&network.node[0])->missing, 2);
}

/* Two outputs with correlated noise, one of them missing: the filter of the other one alone. */
static void a_missing_channel_leaves_the_filter_of_the_others(void **state)
{
    (void)state;
    static const dse_real R[4] = {2, DSE_REAL(0.5), DSE_REAL(0.5), 1}, r = 1;
    static const dse_real C[4] = {1, DSE_REAL(0.5), 0, 1}, c2[2] = {0, 1};
    for (int time = DSE_CONTINUOUS; time <= DSE_DISCRETE; time++) {
        enum { STATES = 2, OUTPUTS = 2, SIZE = DSE_DKF_STORAGE(STATES, OUTPUTS, 0) };
        static dse_real memory[2][SIZE];
        static const dse_real A[4] = {DSE_REAL(0.9), DSE_REAL(-0.3), DSE_REAL(0.3), DSE_REAL(0.95)};
        const struct dse_linear parts = {.A = A};
        struct dse_model model;
        dse_linear_model(&model, (enum dse_time_kind)time, 2, 0, 0, &parts);
        struct dse_dkf both, one;
        struct dse_dkf_config config = {.model = &model,
                                        .period = DSE_REAL(0.05),
                                        .sensor = {2, C},
                                        .P0 = identity,
                                        .Q = identity,
                                        .R = R};
        struct dse_dkf_config alone = config;
        alone.sensor = (struct dse_dkf_sensor){1, c2};
        alone.R = &r;
        struct dse_arena arena;
        dse_arena_init(&arena, memory[0], SIZE);
        assert_int_equal(dse_dkf_init(&both, &config, &arena), DSE_OK);
        dse_arena_init(&arena, memory[1], SIZE);
        assert_int_equal(dse_dkf_init(&one, &alone, &arena), DSE_OK);
        for (int k = 0; k < 20; k++) {
            const dse_real y[2] = {7, (dse_real)(k % 5)};
            const bool valid[2] = {false, true};
            const struct dse_measurement sample = {y, valid}, second = {y + 1, NULL};
            assert_int_equal(dse_dkf_begin(&both, (dse_real)k, NULL, &sample), DSE_OK);
            assert_int_equal(dse_dkf_begin(&one, (dse_real)k, NULL, &second), DSE_OK);
            assert_int_equal(dse_dkf_correct(&both), DSE_OK);
            assert_int_equal(dse_dkf_correct(&one), DSE_OK);
            assert_all_near(2, dse_dkf_state(&both), dse_dkf_state(&one), TOLERANCE(1e-12, 1e-4));
            assert_true(dse_dkf_residual(&both)[0] == 0);
            assert_int_equal(dse_dkf_advance(&both), DSE_OK);
            assert_int_equal(dse_dkf_advance(&one), DSE_OK);
            assert_agree(4, dse_dkf_covariance(&both), dse_dkf_covariance(&one),
                         TOLERANCE(1e-12, 1e-5));
        }
    }
}

/* ---- gains without a bound of their own ---- */

static void gains_stay_within_their_limit(void **state)
{
    (void)state;
    static const enum dse_dkf_scheme schemes[] = {DSE_DKF_EDGE, DSE_DKF_NODE, DSE_DKF_GLOBAL};
    for (size_t s = 0; s < 3; s++) {
        dse_real x[2], free_gain;
        make(&network, schemes[s]);
        run(&network, 60, x);
        free_gain = dse_dkf_largest_gain(&network.node[0]);
        assert_int_equal(dse_dkf_counts(&network.node[0])->limited, 0);

        fill_network(&network, schemes[s]);
        network.base.limit = free_gain / 4;
        assert_int_equal(network_make(&network, RING, ring, true), DSE_OK);
        x[0] = 15;
        x[1] = -10;
        for (int k = 0; k < 60; k++) {
            step(&network, k, x);
            assert_true(dse_dkf_largest_gain(&network.node[0]) <=
                        network.base.limit * (1 + 8 * DSE_REAL_EPSILON));
        }
        assert_true(dse_dkf_counts(&network.node[0])->limited > 0);
    }
}

static void the_leak_lets_gains_decay(void **state)
{
    (void)state;
    static const enum dse_dkf_scheme schemes[] = {DSE_DKF_EDGE, DSE_DKF_NODE, DSE_DKF_GLOBAL};
    const dse_real zero[2] = {0, 0}, sigma = DSE_REAL(0.5);
    for (int s = 0; s < 3; s++) {
        dse_real x[2] = {0, 0}, euler = 3;
        fill_network(&network, schemes[s]);
        network.base.sigma = sigma;
        assert_int_equal(network_make(&network, RING, ring, true), DSE_OK);
        step(&network, 0, x);
        for (int i = 0; i < RING; i++) { /* no error, no difference: only the leak moves them */
            assert_int_equal(dse_dkf_set(&network.node[i], zero, NULL), DSE_OK);
            network.node[i].now[2 + 4] = 3;
        }
        for (int k = 0; k < 200; k++) {
            step(&network, k, x);
            euler *= 1 - sigma * network.base.period;
        }
        const dse_real want = schemes[s] == DSE_DKF_GLOBAL ? euler : 3 * dse_exp(-1);
        assert_near(gain(&network, 0, 0), want, TOLERANCE(1e-9, 1e-4));
    }
}

/* With the sign of (2.15) the law drives the errors up: the run leaves the numbers, is seen to, and
 * the last finite estimate stays. */
static void the_law_with_the_opposite_sign_is_seen_to_diverge(void **state)
{
    (void)state;
    dse_real x[2];
    fill_network(&network, DSE_DKF_EDGE);
    network.R[2][0] = 5; /* two nodes that live by their neighbours */
    network.R[3][0] = 10;
    assert_int_equal(network_make(&network, RING, ring, true), DSE_OK);
    for (int i = 0; i < RING; i++)
        network.node[i].rate = -1;
    run(&network, 400, x);
    int diverged = 0;
    for (int i = 0; i < RING; i++) {
        const struct dse_dkf *node = &network.node[i];
        diverged += dse_dkf_health(node) == DSE_HEALTH_DIVERGED;
        assert_true(dse_all_finite(dse_dkf_state(node), 2));
        assert_true(dse_all_finite(dse_dkf_gain(node, 0), 2));
        assert_true(dse_dkf_counts(node)->failed + dse_dkf_counts(node)->steps == 400);
    }
    assert_true(diverged > 0);
}

/* A limit low enough turns it into a bounded error. */
static void a_limit_keeps_even_the_opposite_sign_bounded(void **state)
{
    (void)state;
    dse_real x[2];
    fill_network(&network, DSE_DKF_EDGE);
    network.base.limit = 2; /* below what the plants and filters damp */
    network.R[2][0] = 5;
    network.R[3][0] = 10;
    assert_int_equal(network_make(&network, RING, ring, true), DSE_OK);
    for (int i = 0; i < RING; i++)
        network.node[i].rate = -1;
    run(&network, 400, x);
    for (int i = 0; i < RING; i++) {
        const struct dse_dkf *node = &network.node[i];
        assert_int_equal(dse_dkf_health(node), DSE_HEALTH_TRACKING);
        assert_int_equal(dse_dkf_counts(node)->failed, 0);
        assert_true(dse_norm_max(2, dse_dkf_state(node)) < 50);
        assert_true(dse_dkf_loop_gain(node) < DSE_REAL(0.1));
    }
}

/* h gamma |C P C' sum Gamma|, by hand. */
static void the_loop_gain_is_what_it_says(void **state)
{
    (void)state;
    dse_real x[2];
    make(&network, DSE_DKF_EDGE);
    run(&network, 40, x);
    const struct dse_dkf *node = &network.node[1]; /* C = [0 1] */
    const dse_real sum = gain(&network, 1, 0) + gain(&network, 1, 1);
    const dse_real want = DSE_REAL(0.01) * DSE_REAL(0.02) * dse_dkf_covariance(node)[3] * sum;
    assert_near(dse_dkf_loop_gain(node), dse_abs(want), TOLERANCE(1e-15, 1e-7));
    make(&network, DSE_DKF_STANDARD);
    run(&network, 1, x);
    assert_near(dse_dkf_loop_gain(&network.node[0]),
                DSE_REAL(0.01) * DSE_REAL(0.02) * 2 *
                    dse_norm2(4, dse_dkf_covariance(&network.node[0])),
                TOLERANCE(1e-15, 1e-8));
}

/* ---- steps that fail ---- */

/* Where nothing moves, P(h) = (P0^-1 + h C' R^-1 C)^-1 and the output goes to y as far. */
static void a_large_first_covariance_is_taken_in_by_its_solution(void **state)
{
    (void)state;
    static const dse_real sizes[] = {300, DSE_REAL(1e6), DSE_REAL(1e12)}, none[4] = {0};
    for (int s = 0; s < 3; s++) {
        const dse_real P0[4] = {sizes[s], 0, 0, sizes[s]}, y = 1;
        const struct dse_measurement sample = {&y, NULL};
        const struct dse_linear parts = {.A = none};
        fill_network(&network, DSE_DKF_ALONE);
        dse_linear_model(&network.model, DSE_CONTINUOUS, 2, 0, 0, &parts);
        network.base.P0 = P0;
        network.base.Q = NULL;
        assert_int_equal(network_make(&network, RING, ring, true), DSE_OK);
        struct dse_dkf *node = &network.node[0]; /* C = [1 0], R = 0.1, h = 0.01, x0 = (5, 5) */
        assert_int_equal(dse_dkf_begin(node, 0, NULL, &sample), DSE_OK);
        assert_int_equal(dse_dkf_correct(node), DSE_OK);
        assert_int_equal(dse_dkf_advance(node), DSE_OK);
        assert_int_equal(dse_dkf_counts(node)->split, 1);
        const dse_real p = 1 / (1 / sizes[s] + DSE_REAL(0.1));
        const dse_real want[4] = {p, 0, 0, sizes[s]}, x[2] = {1 + 4 * p / sizes[s], 5};
        for (int k = 0; k < 4; k++) /* an exact update loses digits of 1e12 */
            assert_near(dse_dkf_covariance(node)[k], want[k],
                        want[k] * TOLERANCE(1e-3, 1) + TOLERANCE(1e-3, 0));
        assert_all_near(2, dse_dkf_state(node), x, TOLERANCE(1e-10, 1e-4));
    }
}

/* The swinging plant from a large P0: positive definite all the way, soon without splitting, and
 * then what the filter is that was integrated in a hundred times shorter steps. */
static void a_split_step_leads_to_the_same_filter(void **state)
{
    (void)state;
    const dse_real P0[4] = {1000, 0, 0, 1000};
    dse_real x[2];
    struct kalman_network *both[2] = {&network, &other};
    for (int v = 0; v < 2; v++) {
        fill_network(both[v], DSE_DKF_ALONE);
        both[v]->base.P0 = P0;
        both[v]->base.period = v == 0 ? DSE_REAL(0.01) : DSE_REAL(0.0001);
        assert_int_equal(network_make(both[v], RING, ring, true), DSE_OK);
        run(both[v], v == 0 ? 50 : 5000, x);
    }
    const struct dse_dkf *node = &network.node[0];
    assert_true(dse_dkf_counts(node)->split > 0 && dse_dkf_counts(node)->split < 5);
    assert_int_equal(dse_dkf_counts(&other.node[0])->split, 0);
    assert_agree(4, dse_dkf_covariance(node), dse_dkf_covariance(&other.node[0]), DSE_REAL(0.02));
}

static void a_diverged_node_starts_again_when_it_is_set(void **state)
{
    (void)state;
    dse_real x[2], fresh[2] = {1, 2};
    make(&network, DSE_DKF_EDGE);
    run(&network, 20, x);
    struct dse_dkf *node = &network.node[0];
    const dse_real huge = DSE_REAL_MAX / 2, y = 0;
    const struct dse_measurement sample = {&y, NULL};
    assert_int_equal(dse_dkf_begin(node, 0, NULL, &sample), DSE_OK);
    assert_int_equal(dse_dkf_receive(node, 0, &huge, 1), DSE_OK);
    assert_int_equal(dse_dkf_correct(node), DSE_OK);
    assert_int_equal(dse_dkf_advance(node), DSE_ENONFINITE);
    assert_int_equal(dse_dkf_health(node), DSE_HEALTH_DIVERGED);
    assert_int_equal(dse_dkf_advance(node), DSE_EINVAL);

    const dse_real no[2] = {(dse_real)NAN, 0}, indefinite[4] = {1, 2, 2, 1};
    assert_int_equal(dse_dkf_set(node, no, NULL), DSE_ENONFINITE);
    assert_int_equal(dse_dkf_set(node, fresh, indefinite), DSE_ENOTPD);
    assert_int_equal(dse_dkf_set(node, fresh, identity), DSE_OK);
    assert_true(dse_dkf_largest_gain(node) == 0);
    assert_true(dse_dkf_state(node)[1] == 2);
    step(&network, 21, x);
    assert_int_equal(dse_dkf_health(node), DSE_HEALTH_TRACKING);
}

static enum dse_status no_A(const struct dse_model *model, dse_real t, const dse_real *x,
                            const dse_real *u, dse_real *A)
{
    (void)model, (void)t, (void)x, (void)u;
    A[0] = (dse_real)NAN;
    return DSE_EMODEL;
}

static void a_model_that_fails_changes_nothing(void **state)
{
    (void)state;
    for (int time = DSE_CONTINUOUS; time <= DSE_DISCRETE; time++) {
        dse_real x[2], y[RING] = {0};
        fill_network(&network, DSE_DKF_EDGE);
        network.model.time = (enum dse_time_kind)time;
        assert_int_equal(network_make(&network, RING, ring, true), DSE_OK);
        run(&network, 3, x);
        const dse_real before = dse_dkf_state(&network.node[0])[0];
        const dse_real variance = dse_dkf_covariance(&network.node[0])[0];
        network.model.dfdx = no_A;
        enum dse_status status = network_hear(&network, 0, y);
        if (time == DSE_CONTINUOUS)
            status = network_advance(&network);
        assert_int_equal(status, DSE_EMODEL);
        assert_true(dse_dkf_state(&network.node[0])[0] == before);
        assert_true(dse_dkf_covariance(&network.node[0])[0] == variance);
        assert_int_equal(dse_dkf_health(&network.node[0]), DSE_HEALTH_DIVERGED);
        network.model.dfdx = swinging_A;
        step(&network, 4, x);
        assert_int_equal(dse_dkf_health(&network.node[0]), DSE_HEALTH_TRACKING);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(bad_messages_are_refused_and_counted),
        cmocka_unit_test(repeated_messages_change_nothing),
        cmocka_unit_test(a_silent_neighbour_is_held_frozen_dropped_and_taken_back),
        cmocka_unit_test(a_node_that_lost_all_neighbours_is_a_local_filter),
        cmocka_unit_test(a_silent_neighbour_is_held_for_three_steps_unless_told_otherwise),
        cmocka_unit_test(a_held_word_acts_on_the_estimate),
        cmocka_unit_test(a_node_without_measurement_coasts_and_listens),
        cmocka_unit_test(a_missing_channel_leaves_the_filter_of_the_others),
        cmocka_unit_test(gains_stay_within_their_limit),
        cmocka_unit_test(the_leak_lets_gains_decay),
        cmocka_unit_test(the_law_with_the_opposite_sign_is_seen_to_diverge),
        cmocka_unit_test(a_limit_keeps_even_the_opposite_sign_bounded),
        cmocka_unit_test(the_loop_gain_is_what_it_says),
        cmocka_unit_test(a_large_first_covariance_is_taken_in_by_its_solution),
        cmocka_unit_test(a_split_step_leads_to_the_same_filter),
        cmocka_unit_test(a_diverged_node_starts_again_when_it_is_set),
        cmocka_unit_test(a_model_that_fails_changes_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
