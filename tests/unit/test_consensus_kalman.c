/* Consensus Kalman filter, a node and small networks of it: the central filter where averages are
 * exact, what is missing, lost or broken, and what a configuration may say. */
#include <string.h>

#include "consensus_network.h"
#include "near.h"
#include "random_matrix.h"

enum { NX = 3, SIX = 6 };

static struct ckf_network network;
static struct dse_ckf alone;
static struct dse_ckf_config alone_config;
static dse_real alone_memory[DSE_CKF_STORAGE(NX, SIX, 0, 0)];
static dse_real all_C[SIX * NX], all_R[SIX * SIX];

static const dse_real R[1] = {DSE_REAL(0.25)};
static const dse_real P0[NX * NX] = {4, 1, 0, 1, 4, 0, 0, 0, 2};
static const dse_real x0[NX] = {1, -1, 2};

static const int ring[2 * SIX] = {0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 0};
static int complete[SIX * (SIX - 1)];

static int links_of_complete(void)
{
    int count = 0;
    for (int i = 0; i < SIX; i++) {
        for (int j = 0; j < i; j++) {
            complete[2 * count] = i;
            complete[2 * count + 1] = j;
            count++;
        }
    }
    return count;
}

/* Six nodes with outputs of their own, on a ring or all to all. */
static void make(struct dse_ckf_config base, bool all_to_all)
{
    network = (struct ckf_network){.nodes = SIX, .base = base};
    network.base.ny = 1;
    network.base.R = R;
    network.base.P0 = P0;
    network.base.x0 = x0;
    random_state = 11;
    fill_scaled(NX, NX * NX, network.A);
    for (int i = 0; i < SIX; i++)
        fill(NX, network.C[i]);
    const int count = all_to_all ? links_of_complete() : SIX;
    assert_int_equal(ckf_network_make(&network, NX, count, all_to_all ? complete : ring), DSE_OK);
}

/* One node without a network that has the sensors of all. */
static void make_central(void)
{
    struct dse_arena arena;
    for (int i = 0; i < SIX; i++) {
        memcpy(all_C + i * NX, network.C[i], NX * sizeof(dse_real));
        for (int j = 0; j < SIX; j++)
            all_R[i * SIX + j] = i == j ? R[0] : 0;
    }
    alone_config = (struct dse_ckf_config){.model = &network.model,
                                           .ny = SIX,
                                           .C = all_C,
                                           .R = all_R,
                                           .Q = network.base.Q,
                                           .x0 = x0,
                                           .P0 = P0,
                                           .scheme = DSE_CKF_ALONE};
    dse_arena_init(&arena, alone_memory, DSE_CKF_STORAGE(NX, SIX, 0, 0));
    assert_int_equal(dse_ckf_init(&alone, &alone_config, &arena), DSE_OK);
}

/* Every node has the central filter's estimate and covariance over 30 samples. */
static void all_are_central(dse_real tolerance)
{
    make_central();
    for (int k = 0; k < 30; k++) {
        dse_real y[SIX];
        fill(SIX, y);
        const struct dse_measurement sample = {y, NULL};
        assert_int_equal(ckf_network_sample(&network, k, y), DSE_OK);
        assert_int_equal(dse_ckf_begin(&alone, k, (dse_real)k, NULL, &sample), DSE_OK);
        for (int i = 0; i < SIX; i++) {
            assert_all_near(NX, dse_ckf_state(&network.node[i]), dse_ckf_state(&alone), tolerance);
            assert_all_near(NX * NX, dse_ckf_covariance(&network.node[i]),
                            dse_ckf_covariance(&alone), tolerance);
        }
        assert_int_equal(ckf_network_advance(&network), DSE_OK);
        assert_int_equal(dse_ckf_advance(&alone), DSE_OK);
    }
}

/* ---- the central filter ---- */

static const dse_real Q[NX * NX] = {DSE_REAL(0.1), 0, 0, 0, DSE_REAL(0.2), 0, 0, 0, DSE_REAL(0.1)};
static const dse_real Q_singular[NX * NX] = {
    DSE_REAL(0.1), DSE_REAL(0.1), 0, DSE_REAL(0.1), DSE_REAL(0.1), 0, 0, 0, 0};

/* The micro-Kalman filter: nodes times exact averages; on a complete graph one round gives them,
 * kept filters included. B and C sum up what all have. */
static void where_all_talk_to_all_every_node_is_the_central_filter(void **state)
{
    (void)state;
    static const struct dse_ckf_config cases[] = {
        {.scheme = DSE_CKF_A, .rounds = 1, .Q = Q},
        {.scheme = DSE_CKF_A, .rounds = 3, .Q = Q_singular},
        {.scheme = DSE_CKF_A, .rounds = 1},
        {.scheme = DSE_CKF_A, .rounds = 1, .counting = DSE_CKF_BOUNDED, .Q = Q},
        {.scheme = DSE_CKF_A, .rounds = 1, .counting = DSE_CKF_IN_ALL, .Q = Q},
        {.scheme = DSE_CKF_B, .Q = Q},
        {.scheme = DSE_CKF_C, .Q = Q_singular},
    };
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++) {
        make(cases[c], true);
        all_are_central(TOLERANCE(5e-15, 5e-6));
    }
}

static void on_a_ring_many_rounds_are_the_central_filter(void **state)
{
    (void)state;
    make((struct dse_ckf_config){.scheme = DSE_CKF_A, .rounds = 100, .Q = Q}, false);
    all_are_central(TOLERANCE(1e-13, 1e-5));
}

/* Innovation, gain and Joseph's form against the information form of a node that is alone. */
static void a_node_alone_is_a_kalman_filter(void **state)
{
    (void)state;
    make((struct dse_ckf_config){.scheme = DSE_CKF_ALONE, .Q = Q}, false);
    dse_real x[NX], P[NX * NX], next[NX], scratch[NX * NX];
    const dse_real *C = network.C[2];
    memcpy(x, x0, sizeof x);
    memcpy(P, P0, sizeof P);
    for (int k = 0; k < 20; k++) {
        dse_real y[SIX], Pc[NX], J[NX * NX];
        fill(SIX, y);
        const dse_real innovation = y[2] - dse_dot(NX, C, x);
        dse_mat_vec(NX, NX, P, C, Pc);
        const dse_real s = dse_dot(NX, C, Pc) + R[0];
        for (int e = 0; e < NX * NX; e++)
            J[e] = (dse_real)(e % (NX + 1) == 0) - Pc[e / NX] * C[e % NX] / s;
        dse_axpy(NX, innovation / s, Pc, x);
        dse_sym_congruence(NX, NX, J, P, NULL, P, scratch);
        dse_sym_rank1(NX, R[0] / (s * s), Pc, P);
        assert_int_equal(ckf_network_sample(&network, k, y), DSE_OK);
        const struct dse_ckf *node = &network.node[2];
        assert_near(dse_ckf_innovation(node)[0], innovation, TOLERANCE(1e-14, 1e-5));
        assert_all_near(NX, dse_ckf_state(node), x, TOLERANCE(1e-14, 1e-5));
        assert_all_near(NX * NX, dse_ckf_covariance(node), P, TOLERANCE(1e-14, 1e-5));
        dse_mat_vec(NX, NX, network.A, x, next);
        memcpy(x, next, sizeof x);
        dse_sym_congruence(NX, NX, network.A, P, Q, P, scratch);
        assert_int_equal(ckf_network_advance(&network), DSE_OK);
        assert_all_near(NX, dse_ckf_state(node), x, TOLERANCE(1e-14, 1e-5));
    }
}

/* ---- counting ---- */

/* With the weights in the messages a node's multiplicity is what the graph says; without them at
 * most that. */
static void multiplicity_is_that_of_the_graph_or_a_bound_of_it(void **state)
{
    (void)state;
    for (int rounds = 1; rounds <= 6; rounds++) {
        for (int counting = DSE_CKF_ONCE; counting <= DSE_CKF_BOUNDED; counting++) {
            dse_real y[SIX] = {0}, scratch[2 * SIX];
            make((struct dse_ckf_config){.rounds = rounds,
                                         .counting = (enum dse_ckf_counting)counting},
                 false);
            assert_int_equal(ckf_network_sample(&network, 1, y), DSE_OK);
            for (int i = 0; i < SIX; i++) {
                const dse_real eps = network.node[i].epsilon;
                const dse_real best =
                    1 / dse_consensus_largest_weight(&network.graph, i, eps, rounds, scratch);
                const dse_real got = dse_ckf_multiplicity(&network.node[i]);
                if (counting == DSE_CKF_ONCE || rounds == 1)
                    assert_near(got, best, TOLERANCE(1e-14, 1e-5));
                assert_true(got <= best * (1 + 8 * DSE_REAL_EPSILON) && got >= 1);
            }
        }
    }
}

/* How often measurements that know tr Y_j = each count in a node, by the trace of its Y. */
static dse_real times_counted(const struct dse_ckf *node, dse_real each)
{
    const dse_real *Y = dse_ckf_information(node) + NX;
    return (Y[0] + Y[2] + Y[5]) / each;
}

/* A step so large that a node gives more to each neighbour than it keeps. */
static void the_bound_of_a_node_knows_what_it_gives_away(void **state)
{
    (void)state;
    const dse_real y[SIX] = {0};
    make(
        (struct dse_ckf_config){.rounds = 1, .counting = DSE_CKF_BOUNDED, .epsilon = DSE_REAL(0.5)},
        false);
    assert_int_equal(ckf_network_sample(&network, 0, y), DSE_OK);
    assert_true(dse_ckf_multiplicity(&network.node[0]) == 2); /* weights 1/2, 0, 1/2 */
}

/* One node has data: whatever is lost on the way, it counts in full where it is heard of, else not
 * at all. */
static void a_single_measurement_counts_exactly_once_whatever_is_lost(void **state)
{
    (void)state;
    const dse_real nothing = dse_sqrt(-1);
    const dse_real y[SIX] = {1, nothing, nothing, nothing, nothing, nothing};
    for (int lost = 0; lost < 2; lost++) {
        make((struct dse_ckf_config){.rounds = 3}, false);
        network.deaf[1][0] = lost == 1; /* 0 is heard of by 5, 4, 3 only */
        network.deaf[3][2] = lost == 1;
        assert_int_equal(ckf_network_sample(&network, 0, y), DSE_OK);
        const dse_real each = dse_dot(NX, network.C[0], network.C[0]) / R[0];
        for (int i = 0; i < SIX; i++) {
            const bool away = lost == 1 && (i == 1 || i == 2);
            assert_near(times_counted(&network.node[i], each), away ? 0 : 1,
                        TOLERANCE(1e-14, 1e-5));
        }
    }
}

/* The fused information of the literal form in a network at rest: nodes + 1 times. */
static void the_literal_form_counts_a_nodes_own_measurement_again(void **state)
{
    (void)state;
    make((struct dse_ckf_config){.scheme = DSE_CKF_A_LITERAL, .Q = Q}, true);
    for (int i = 0; i < SIX; i++)
        memcpy(network.C[i], network.C[0], sizeof network.C[0]);
    const dse_real y[SIX] = {0};
    const dse_real each = dse_dot(NX, network.C[0], network.C[0]) / R[0];
    for (int k = 0; k < 100; k++) {
        assert_int_equal(ckf_network_sample(&network, k, y), DSE_OK);
        assert_int_equal(ckf_network_advance(&network), DSE_OK);
    }
    assert_near(times_counted(&network.node[0], each), 2 * SIX, TOLERANCE(1e-12, 1e-4));
}

/* Filters that are kept remember what was lost; those that start anew do not. */
static void restart_forgets_what_was_lost(void **state)
{
    (void)state;
    for (int restart = 0; restart <= 4; restart += 4) {
        const dse_real y[SIX] = {0};
        make((struct dse_ckf_config){.counting = DSE_CKF_IN_ALL, .rounds = 30, .restart = restart},
             false);
        dse_real all = 0, found = 0;
        for (int k = 0; k < 6; k++) {
            network.deaf[1][0] = k < 3; /* sample 4 is the first to start anew after that */
            assert_int_equal(ckf_network_sample(&network, k, y), DSE_OK);
            assert_int_equal(ckf_network_advance(&network), DSE_OK);
        }
        for (int i = 0; i < SIX; i++) {
            all += dse_dot(NX, network.C[i], network.C[i]) / R[0];
            found += times_counted(&network.node[i], SIX);
        }
        assert_int_equal(dse_abs(found - all) < TOLERANCE(1e-12, 1e-4) * all, restart == 4);
    }
}

/* ---- mixing ---- */

/* xh_i = psi_i + eps sum_N (psi_j - psi_i), psi of the nodes that have not mixed yet. */
static void B_mixes_the_estimates_of_neighbours(void **state)
{
    (void)state;
    dse_real y[SIX], psi[SIX][NX];
    make((struct dse_ckf_config){.scheme = DSE_CKF_B, .epsilon = DSE_REAL(0.25)}, false);
    fill(SIX, y);
    for (int i = 0; i < SIX; i++) {
        const struct dse_measurement sample = {y + i, NULL};
        assert_int_equal(dse_ckf_begin(&network.node[i], 0, 0, NULL, &sample), DSE_OK);
    }
    assert_int_equal(ckf_network_round(&network), DSE_OK);
    for (int i = 0; i < SIX; i++)
        memcpy(psi[i], dse_ckf_state(&network.node[i]), sizeof psi[i]);
    network.deaf[3][2] = true;
    assert_int_equal(ckf_network_round(&network), DSE_OK);
    for (int c = 0; c < NX; c++) {
        assert_near(dse_ckf_state(&network.node[1])[c], psi[1][c] / 2 + (psi[0][c] + psi[2][c]) / 4,
                    TOLERANCE(1e-15, 1e-6));
        assert_near(dse_ckf_state(&network.node[3])[c], (3 * psi[3][c] + psi[4][c]) / 4,
                    TOLERANCE(1e-15, 1e-6));
    }
}

/* ---- stability of C ---- */

static void the_normalised_step_of_C_is_stable_where_the_literal_one_is_not(void **state)
{
    (void)state;
    for (int literal = 0; literal < 2; literal++) {
        make((struct dse_ckf_config){.scheme = literal == 1 ? DSE_CKF_C_LITERAL : DSE_CKF_C,
                                     .epsilon = DSE_REAL(0.5),
                                     .Q = Q},
             false);
        memset(network.A, 0, sizeof network.A);
        for (int i = 0; i < NX; i++)
            network.A[i * NX + i] = 1;
        dse_real y[SIX], far = 0;
        for (int i = 0; i < SIX; i++)
            for (int c = 0; c < NX; c++)
                network.C[i][c] *= DSE_REAL(0.03); /* weak sensors: a large P */
        for (int k = 0; k < 60; k++) {
            fill(SIX, y);
            ckf_network_sample(&network, k, y); /* the literal one may overflow */
            ckf_network_advance(&network);
        }
        for (int i = 0; i < SIX; i++)
            far = dse_max(far, dse_norm_max(NX, dse_ckf_state(&network.node[i])));
        assert_int_equal(far > 1000, literal == 1);
    }
}

/* ---- data that are not there ---- */

static void without_any_data_all_coast_and_start_when_one_has_some(void **state)
{
    (void)state;
    const dse_real no = dse_sqrt(-1);
    const dse_real nothing[SIX] = {no, no, no, no, no, no}, one[SIX] = {1, no, no, no, no, no};
    dse_real expected[NX];
    make((struct dse_ckf_config){.Q = Q}, false);
    dse_mat_vec(NX, NX, network.A, x0, expected);
    assert_int_equal(ckf_network_sample(&network, 0, nothing), DSE_OK);
    assert_all_near(NX, dse_ckf_state(&network.node[0]), x0, 0);
    assert_int_equal(dse_ckf_health(&network.node[0]), DSE_HEALTH_INITIALISING);
    assert_int_equal(ckf_network_advance(&network), DSE_OK);
    assert_all_near(NX, dse_ckf_state(&network.node[0]), expected, 0);
    assert_int_equal(ckf_network_sample(&network, 1, one), DSE_OK);
    assert_int_equal(dse_ckf_health(&network.node[0]), DSE_HEALTH_TRACKING);
    assert_int_equal(dse_ckf_health(&network.node[1]), DSE_HEALTH_COASTING); /* informed by 0 */
    assert_true(dse_ckf_state(&network.node[1])[0] != expected[0]);
    assert_int_equal(dse_ckf_counts(&network.node[0])->nonfinite, 1);
    assert_int_equal(dse_ckf_counts(&network.node[0])->used, 1);
}

static void a_node_that_hears_nobody_goes_on_with_its_own_data(void **state)
{
    (void)state;
    static const enum dse_ckf_scheme schemes[] = {DSE_CKF_A, DSE_CKF_B, DSE_CKF_C};
    for (size_t s = 0; s < sizeof schemes / sizeof schemes[0]; s++) {
        dse_real y[SIX];
        fill(SIX, y);
        const struct dse_measurement sample = {y + 2, NULL};
        make((struct dse_ckf_config){.scheme = DSE_CKF_ALONE, .Q = Q}, false);
        assert_int_equal(dse_ckf_begin(&network.node[2], 0, 0, NULL, &sample), DSE_OK);
        dse_real own[NX];
        memcpy(own, dse_ckf_state(&network.node[2]), sizeof own);
        make((struct dse_ckf_config){.scheme = schemes[s], .Q = Q}, false);
        network.deaf[2][1] = network.deaf[2][3] = true;
        assert_int_equal(ckf_network_sample(&network, 0, y), DSE_OK);
        assert_all_near(NX, dse_ckf_state(&network.node[2]), own, TOLERANCE(1e-14, 1e-6));
        assert_int_equal(dse_ckf_health(&network.node[2]), DSE_HEALTH_ALONE);
        assert_int_equal(dse_ckf_health(&network.node[0]), DSE_HEALTH_TRACKING);
        assert_int_equal(dse_ckf_counts(&network.node[2])->silent,
                         2 * dse_ckf_rounds(&network.node[2]));
    }
}

/* ---- broken messages ---- */

static void broken_messages_are_refused_and_counted(void **state)
{
    (void)state;
    static const enum dse_ckf_scheme schemes[] = {DSE_CKF_A, DSE_CKF_B, DSE_CKF_C,
                                                  DSE_CKF_A_LOW_PASS};
    for (size_t s = 0; s < sizeof schemes / sizeof schemes[0]; s++) {
        dse_real message[DSE_CKF_MESSAGE(NX, SIX)];
        const dse_real y = 1;
        const struct dse_measurement sample = {&y, NULL};
        make((struct dse_ckf_config){.scheme = schemes[s]}, false);
        struct dse_ckf *node = &network.node[0];
        assert_int_equal(dse_ckf_message(node, message), 0);
        assert_int_equal(dse_ckf_receive(node, 0, message, 1), DSE_EINVAL);
        assert_int_equal(dse_ckf_end_round(node), DSE_EINVAL);
        assert_int_equal(dse_ckf_advance(node), DSE_EINVAL);
        assert_int_equal(dse_ckf_begin(node, 0, 0, NULL, &sample), DSE_OK);
        const int count = dse_ckf_message(node, message);
        assert_int_equal(count, dse_ckf_message_size(node, 0));
        assert_true(count <= DSE_CKF_MESSAGE(NX, SIX));
        assert_int_equal(dse_ckf_receive(node, 2, message, count), DSE_EINVAL);
        assert_int_equal(dse_ckf_receive(node, 0, message, count - 1), DSE_EDIM);
        message[count - 1] = dse_sqrt(-1);
        assert_int_equal(dse_ckf_receive(node, 0, message, count), DSE_ENONFINITE);
        for (int r = 0; r < dse_ckf_rounds(node); r++)
            assert_int_equal(dse_ckf_end_round(node), DSE_OK);
        assert_int_equal(dse_ckf_health(node), DSE_HEALTH_REJECTING);
        assert_int_equal(dse_ckf_counts(node)->refused, 2);
        assert_int_equal(dse_ckf_counts(node)->heard, 0);
    }
}

/* A neighbour that says that it knows less than nothing, and one that makes the sums overflow. */
static void information_that_cannot_be_is_not_used(void **state)
{
    (void)state;
    for (int huge = 0; huge < 2; huge++) {
        dse_real message[DSE_CKF_MESSAGE(NX, 0)], own[NX];
        const dse_real y = 1;
        const struct dse_measurement sample = {&y, NULL};
        make((struct dse_ckf_config){.scheme = DSE_CKF_ALONE}, false);
        assert_int_equal(dse_ckf_begin(&network.node[0], 0, 0, NULL, &sample), DSE_OK);
        memcpy(own, dse_ckf_state(&network.node[0]), sizeof own);
        make((struct dse_ckf_config){.scheme = DSE_CKF_B}, false);
        struct dse_ckf *node = &network.node[0];
        assert_int_equal(dse_ckf_begin(node, 0, 0, NULL, &sample), DSE_OK);
        const int count = dse_ckf_message(node, message);
        for (int e = NX; e < count; e++)
            message[e] = huge == 1 ? DSE_REAL_MAX : -1000;
        assert_int_equal(dse_ckf_receive(node, 0, message, count), DSE_OK);
        assert_int_equal(dse_ckf_receive(node, 1, message, count), DSE_OK);
        assert_int_equal(dse_ckf_end_round(node), DSE_OK);
        assert_int_equal(dse_ckf_end_round(node), DSE_OK);
        assert_all_near(NX, dse_ckf_state(node), own, TOLERANCE(1e-14, 1e-6));
        assert_int_equal(dse_ckf_counts(node)->fallback, 1);
        assert_int_equal(dse_ckf_health(node), DSE_HEALTH_REJECTING);
    }
}

/* Filters that are kept start from zero after an overflow, and are right again. */
static void kept_filters_recover_from_an_overflow(void **state)
{
    (void)state;
    dse_real y[SIX] = {0}, message[DSE_CKF_MESSAGE(NX, 0)];
    make((struct dse_ckf_config){.counting = DSE_CKF_IN_ALL, .rounds = 1, .Q = Q}, false);
    const struct dse_measurement sample = {y, NULL};
    struct dse_ckf *node = &network.node[0];
    assert_int_equal(dse_ckf_begin(node, 0, 0, NULL, &sample), DSE_OK);
    const int count = dse_ckf_message(node, message);
    for (int e = 0; e < count; e++)
        message[e] = DSE_REAL_MAX;
    dse_ckf_receive(node, 0, message, count);
    dse_ckf_receive(node, 1, message, count);
    assert_int_equal(dse_ckf_end_round(node), DSE_OK);
    for (int e = 0; e < node->carried; e++)
        assert_true(node->v[e] == 0);
    assert_int_equal(dse_ckf_health(node), DSE_HEALTH_REJECTING);
}

/* ---- failures ---- */

static void a_failed_sample_keeps_the_prior_and_the_next_one_goes_on(void **state)
{
    (void)state;
    dse_real noise = DSE_REAL(0.25);
    const dse_real y = 1;
    const struct dse_measurement sample = {&y, NULL};
    make((struct dse_ckf_config){.scheme = DSE_CKF_B}, false);
    network.config[0].R = &noise;
    struct dse_ckf *node = &network.node[0];
    noise = -1;
    assert_int_equal(dse_ckf_begin(node, 0, 0, NULL, &sample), DSE_ENOTPD);
    assert_all_near(NX, dse_ckf_state(node), x0, 0);
    assert_int_equal(dse_ckf_health(node), DSE_HEALTH_DIVERGED);
    assert_int_equal(dse_ckf_counts(node)->failed, 1);
    assert_int_equal(dse_ckf_advance(node), DSE_OK);
    noise = DSE_REAL(0.25);
    assert_int_equal(dse_ckf_begin(node, 1, 1, NULL, &sample), DSE_OK);
    assert_int_equal(dse_ckf_end_round(node), DSE_OK);
    assert_int_equal(dse_ckf_end_round(node), DSE_OK);
    assert_int_equal(dse_ckf_health(node), DSE_HEALTH_ALONE);
    network.A[0] = DSE_REAL_MAX;
    network.A[1] = DSE_REAL_MAX;
    const dse_real before = dse_ckf_state(node)[0];
    assert_int_equal(dse_ckf_advance(node), DSE_ENONFINITE);
    assert_true(dse_ckf_state(node)[0] == before);
    assert_int_equal(dse_ckf_begin(node, 2, dse_sqrt(-1), NULL, &sample), DSE_EINVAL);
}

static void set_changes_all_or_nothing(void **state)
{
    (void)state;
    const dse_real x[NX] = {5, 6, 7}, bad[NX] = {5, dse_sqrt(-1), 7};
    const dse_real negative[NX * NX] = {1, 0, 0, 0, -1, 0, 0, 0, 1};
    make((struct dse_ckf_config){.Q = Q}, false);
    struct dse_ckf *node = &network.node[0];
    assert_int_equal(dse_ckf_set(node, bad, P0), DSE_ENONFINITE);
    assert_int_equal(dse_ckf_set(node, x, negative), DSE_ENOTPD);
    assert_all_near(NX, dse_ckf_state(node), x0, 0);
    assert_int_equal(dse_ckf_set(node, x, NULL), DSE_OK);
    assert_all_near(NX, dse_ckf_state(node), x, 0);
    assert_all_near(NX * NX, dse_ckf_covariance(node), P0, 0);
    assert_int_equal(dse_ckf_set(node, x, Q), DSE_OK);
    assert_all_near(NX * NX, dse_ckf_covariance(node), Q, 0);
}

/* ---- configuration ---- */

static enum dse_status init_with(struct dse_ckf_config config, int missing)
{
    static dse_real memory[DSE_CKF_STORAGE(NX, 1, 2, SIX)];
    static struct dse_ckf node;
    struct dse_arena arena;
    dse_arena_init(&arena, memory,
                   DSE_CKF_STORAGE(NX, 1, 2, config.scheme == DSE_CKF_A ? SIX : 0) - missing);
    return dse_ckf_init(&node, &config, &arena);
}

static void wrong_settings_are_refused(void **state)
{
    (void)state;
    static const dse_real zero = 0, skew[NX * NX] = {1, 1, 0, 0, 1, 0, 0, 0, 1};
    make((struct dse_ckf_config){.Q = Q}, false);
    const struct dse_ckf_config good = network.config[0];
    assert_int_equal(init_with(good, 0), DSE_OK);
    struct dse_model continuous = network.model;
    continuous.time = DSE_CONTINUOUS;
#define REFUSED(field, value, status)                                                              \
    do {                                                                                           \
        struct dse_ckf_config bad = good;                                                          \
        bad.field = value;                                                                         \
        assert_int_equal(init_with(bad, 0), status);                                               \
    } while (0)
    REFUSED(model, NULL, DSE_EINVAL);
    REFUSED(model, &continuous, DSE_EINVAL);
    REFUSED(C, NULL, DSE_EINVAL);
    REFUSED(P0, NULL, DSE_EINVAL);
    REFUSED(P0, skew, DSE_EINVAL);
    REFUSED(Q, skew, DSE_EINVAL);
    REFUSED(R, &zero, DSE_ENOTPD);
    REFUSED(epsilon, DSE_REAL(0.51), DSE_EINVAL);
    REFUSED(epsilon, dse_sqrt(-1), DSE_EINVAL);
    REFUSED(rounds, -1, DSE_EINVAL);
    REFUSED(nodes, 2, DSE_EINVAL);
    REFUSED(self, SIX, DSE_EINVAL);
    REFUSED(self, -1, DSE_EINVAL);
    REFUSED(largest_degree, 1, DSE_EINVAL);
    REFUSED(scheme, (enum dse_ckf_scheme)7, DSE_EINVAL);
    REFUSED(counting, (enum dse_ckf_counting)3, DSE_EINVAL);
#undef REFUSED
    struct dse_ckf_config one_step = good;
    one_step.scheme = DSE_CKF_C;
    one_step.epsilon = DSE_REAL(0.51); /* beyond 1 / n_neighbours */
    assert_int_equal(init_with(one_step, 0), DSE_EINVAL);
    one_step.scheme = DSE_CKF_C_LITERAL; /* no bound that a configuration could know */
    assert_int_equal(init_with(one_step, 0), DSE_OK);
    struct dse_ckf_config low_pass = good;
    low_pass.scheme = DSE_CKF_A_LOW_PASS;
    low_pass.epsilon = DSE_REAL(0.21); /* beyond 1 / (1 + 2 degree) */
    assert_int_equal(init_with(low_pass, 0), DSE_EINVAL);
    low_pass.epsilon = DSE_REAL(0.2);
    assert_int_equal(init_with(low_pass, 0), DSE_OK);
}

static void storage_is_enough_for_every_scheme_and_checked(void **state)
{
    (void)state;
    make((struct dse_ckf_config){.Q = Q}, false);
    struct dse_ckf_config config = network.config[0];
    for (int scheme = DSE_CKF_A; scheme <= DSE_CKF_A_LITERAL; scheme++) {
        config.scheme = (enum dse_ckf_scheme)scheme;
        assert_int_equal(init_with(config, 0), DSE_OK);
    }
    config.scheme = DSE_CKF_A_LITERAL;
    assert_int_equal(init_with(config, DSE_CKF_SCRATCH(NX, 1)), DSE_ESTORAGE);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(where_all_talk_to_all_every_node_is_the_central_filter),
        cmocka_unit_test(on_a_ring_many_rounds_are_the_central_filter),
        cmocka_unit_test(a_node_alone_is_a_kalman_filter),
        cmocka_unit_test(multiplicity_is_that_of_the_graph_or_a_bound_of_it),
        cmocka_unit_test(a_single_measurement_counts_exactly_once_whatever_is_lost),
        cmocka_unit_test(the_literal_form_counts_a_nodes_own_measurement_again),
        cmocka_unit_test(the_bound_of_a_node_knows_what_it_gives_away),
        cmocka_unit_test(restart_forgets_what_was_lost),
        cmocka_unit_test(B_mixes_the_estimates_of_neighbours),
        cmocka_unit_test(the_normalised_step_of_C_is_stable_where_the_literal_one_is_not),
        cmocka_unit_test(without_any_data_all_coast_and_start_when_one_has_some),
        cmocka_unit_test(a_node_that_hears_nobody_goes_on_with_its_own_data),
        cmocka_unit_test(broken_messages_are_refused_and_counted),
        cmocka_unit_test(information_that_cannot_be_is_not_used),
        cmocka_unit_test(kept_filters_recover_from_an_overflow),
        cmocka_unit_test(a_failed_sample_keeps_the_prior_and_the_next_one_goes_on),
        cmocka_unit_test(set_changes_all_or_nothing),
        cmocka_unit_test(wrong_settings_are_refused),
        cmocka_unit_test(storage_is_enough_for_every_scheme_and_checked),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
