/* Distributed second-order filters: what the fusions are equal to, the exchange of messages, and
 * the protections. */
#include <math.h>
#include <string.h>

#include "dse/linalg.h"
#include "near.h"
#include "second_order_network.h"
#include "second_order_plants.h"

enum { PACKED = DSE_DSO_PACKED(NX), SCHEMES = DSE_DSO_C_LITERAL + 1 };

static struct dse_model model;
static struct second_order_network network;
static const dse_real R_source[4] = {DSE_REAL(0.01), 0, 0, DSE_REAL(0.01)};
static const dse_real C_i[NX] = {1, 1, 0}, C_j[NX] = {1, 0, 1};

/* Example 4: nodes take turns with the two sensors; everybody hears everybody. */
static void prepare(enum dse_dso_scheme scheme, int nodes)
{
    static const dse_real w0[2][NX] = {{4, 3, 2}, {2, 1, 3}};
    memset(&network, 0, sizeof network);
    model = plant_model("quadratic_ex4");
    network.base = (struct dse_dso_config){
        .filter = {.model = &model, .ny = 1, .S0 = unit_covariance, .R = R_source},
        .scheme = scheme};
    network.nodes = nodes;
    for (int i = 0; i < nodes; i++) {
        memcpy(network.C[i], i % 2 == 0 ? C_i : C_j, sizeof C_i);
        memcpy(network.w0[i], w0[i % 2], sizeof w0[0]);
        for (int j = 0; j < nodes; j++)
            network.hears[i][j] = i != j;
    }
}

static void make(void)
{
    assert_int_equal(network_make(&network), DSE_OK);
}

static const dse_real *state_of(int i)
{
    return dse_dso_state(&network.node[i]);
}

/* ---- what the fusions are ---- */

/* Both nodes know both sensors and start alike: they are the filter of the stacked measurements. */
static void fused_information_is_the_central_filter(void **state)
{
    (void)state;
    static dse_real memory[DSE_SECOND_ORDER_STORAGE(NX, 2)];
    static const struct {
        enum dse_dso_scheme scheme;
        dse_real epsilon;
    } cases[] = {
        {DSE_DSO_B_INFORMATION, 0},
        {DSE_DSO_C_INFORMATION, 0},
        {DSE_DSO_A_INFORMATION, DSE_REAL(0.5)}}; /* the exact average of two in one round */
    for (int c = 0; c < 3; c++) {
        prepare(cases[c].scheme, 2);
        network.base.epsilon = cases[c].epsilon;
        memcpy(network.w0[1], network.w0[0], sizeof network.w0[0]);
        make();
        const struct dse_second_order_config central = {
            .model = &model, .x0 = network.w0[0], .S0 = unit_covariance, .R = R_source};
        struct dse_second_order filter;
        struct dse_arena arena;
        dse_arena_init(&arena, memory, DSE_SECOND_ORDER_STORAGE(NX, 2));
        assert_int_equal(dse_second_order_init(&filter, &central, &arena), DSE_OK);
        for (int k = 1; k <= 5; k++) {
            const dse_real m[2] = {dse_sin((dse_real)k), dse_cos((dse_real)k)};
            const struct dse_measurement measurement = {m, NULL};
            assert_int_equal(network_sample(&network, (dse_real)k, m), DSE_OK);
            assert_int_equal(dse_second_order_predict(&filter, (dse_real)k, NULL), DSE_OK);
            assert_int_equal(dse_second_order_update(&filter, &measurement), DSE_OK);
            for (int i = 0; i < 2; i++) {
                assert_agree(NX, state_of(i), dse_second_order_state(&filter),
                             TOLERANCE(1e-8, 1e-3));
                assert_agree(NX * NX, dse_dso_covariance(&network.node[i]),
                             dse_second_order_covariance(&filter), TOLERANCE(1e-8, 1e-3));
            }
        }
    }
}

/* delta = 1/2 between two nodes is the exact average of psi. */
static void mixing_by_half_makes_two_nodes_agree(void **state)
{
    (void)state;
    prepare(DSE_DSO_B, 2);
    network.base.delta = DSE_REAL(0.5);
    make();
    static const dse_real m[2] = {1, 2};
    assert_int_equal(network_sample(&network, 1, m), DSE_OK);
    assert_agree(NX, state_of(0), state_of(1), TOLERANCE(1e-14, 1e-6));
}

static void without_neighbours_b_and_c_are_the_filter_alone(void **state)
{
    (void)state;
    static const enum dse_dso_scheme schemes[] = {DSE_DSO_ALONE, DSE_DSO_B, DSE_DSO_C,
                                                  DSE_DSO_B_INFORMATION, DSE_DSO_C_INFORMATION};
    dse_real x[NX] = {0};
    for (int c = 0; c < 5; c++) {
        prepare(schemes[c], 1);
        make();
        for (int k = 1; k <= 3; k++) {
            const dse_real m[1] = {(dse_real)k};
            assert_int_equal(network_sample(&network, (dse_real)k, m), DSE_OK);
        }
        if (c == 0)
            memcpy(x, state_of(0), sizeof x);
        assert_agree(NX, state_of(0), x, TOLERANCE(1e-9, 1e-3));
        assert_int_equal(dse_dso_health(&network.node[0]), DSE_HEALTH_TRACKING);
    }
}

/* A node without a sensor of its own sees through its neighbour's. */
static void a_dead_sensor_is_replaced_by_the_neighbours_information(void **state)
{
    (void)state;
    prepare(DSE_DSO_B_INFORMATION, 2);
    make();
    network.off[1] = true;
    dse_real x[NX];
    memcpy(x, plant_start, sizeof x);
    for (int k = 1; k <= 25; k++) {
        plant_second(&model, x);
        const dse_real m[2] = {x[0] + x[1], 77};
        assert_int_equal(network_sample(&network, (dse_real)k, m), DSE_OK);
    }
    assert_all_near(NX, state_of(1), x, DSE_REAL(0.03)); /* unheard: above 1 */
    assert_int_equal(dse_dso_health(&network.node[1]), DSE_HEALTH_COASTING);
    assert_int_equal(network.node[1].filter.counts.used, 0);
}

/* The normalised weight is delta / (1 + |S|_F). */
static void normalisation_bounds_the_pull_of_neighbours(void **state)
{
    (void)state;
    static const dse_real large[NX * NX] = {900, 0, 0, 0, 900, 0, 0, 0, 900};
    static const dse_real m[2] = {1, 2};
    for (int normalised = 0; normalised < 2; normalised++) {
        prepare(DSE_DSO_C, 2);
        network.base.filter.S0 = large;
        network.base.normalised = normalised == 1;
        make();
        const dse_real size = 900 * dse_sqrt(3), gain = DSE_REAL(0.5) * size;
        assert_near(dse_dso_loop_gain(&network.node[0]), normalised ? gain / (1 + size) : gain,
                    TOLERANCE(1e-9, 1e-2));
        network.off[0] = network.off[1] = true;
        assert_int_equal(network_sample(&network, 0, m), DSE_OK); /* no time passes */
        const dse_real moved = state_of(0)[0] - 4;
        const dse_real want = 900 * DSE_REAL(0.25) * (2 - 4) / (normalised ? 1 + size : 1);
        assert_near(moved, want, dse_abs(want) * TOLERANCE(1e-12, 1e-5));
    }
}

/* ---- the exchange ---- */

static void messages_have_the_documented_sizes(void **state)
{
    (void)state;
    static const int want[SCHEMES][3] = {
        {NX + PACKED, NX, 0},    /* B_INFORMATION */
        {2 * NX + PACKED, 0, 0}, /* C_INFORMATION */
        {NX + PACKED, NX + PACKED, NX + PACKED},
        {NX, 0, 0}, /* B */
        {NX, 0, 0}, /* C */
        {2 * PACKED, 2 * PACKED, 2 * PACKED},
        {0, 0, 0},
        {2 * PACKED + 3, 0, 0}, /* A_LITERAL */
        {2 + PACKED, NX, 0},    /* B_LITERAL */
        {2 + PACKED + NX, 0, 0},
    };
    for (int scheme = 0; scheme < SCHEMES; scheme++) {
        prepare((enum dse_dso_scheme)scheme, 2);
        network.base.rounds = 3;
        make();
        for (int r = 0; r < 3; r++) {
            assert_int_equal(dse_dso_message_size(&network.node[0], r), want[scheme][r]);
            assert_true(want[scheme][r] <= DSE_DSO_MESSAGE(NX, 1));
            assert_true((want[scheme][r] > 0) == (r < dse_dso_rounds(&network.node[0])));
        }
        assert_int_equal(dse_dso_message_size(&network.node[0], -1), 0);
    }
}

static void what_is_not_a_message_is_refused(void **state)
{
    (void)state;
    static const dse_real m[1] = {1};
    static const struct dse_measurement measurement = {m, NULL};
    dse_real message[DSE_DSO_MESSAGE(NX, 1)], before[NX];
    prepare(DSE_DSO_C, 3);
    make();
    struct dse_dso *node = &network.node[0];
    assert_int_equal(dse_dso_receive(node, 0, network.w0[1], NX), DSE_EINVAL); /* no sample */
    assert_int_equal(dse_dso_end_round(node), DSE_EINVAL);
    assert_int_equal(dse_dso_message(node, message), 0);
    assert_int_equal(dse_dso_begin(node, 1, NULL, &measurement), DSE_OK);
    assert_int_equal(dse_dso_message(node, message), NX);
    memcpy(before, state_of(0), sizeof before);
    const dse_real broken[NX] = {0, NAN, 0};
    assert_int_equal(dse_dso_receive(node, 2, message, NX), DSE_EINVAL);
    assert_int_equal(dse_dso_receive(node, -1, message, NX), DSE_EINVAL);
    assert_int_equal(dse_dso_receive(node, 0, message, NX - 1), DSE_EDIM);
    assert_int_equal(dse_dso_receive(node, 0, broken, NX), DSE_ENONFINITE);
    assert_int_equal(dse_dso_end_round(node), DSE_OK);
    assert_int_equal(dse_dso_counts(node)->refused, 2);
    assert_int_equal(dse_dso_counts(node)->silent, 2);
    assert_int_equal(dse_dso_health(node), DSE_HEALTH_REJECTING);
    assert_int_equal(dse_dso_end_round(node), DSE_EINVAL); /* the sample has ended */
}

/* Repeated and reordered messages change no bit. */
static void neither_order_nor_repetition_of_messages_matters(void **state)
{
    (void)state;
    static const dse_real m[1] = {1};
    static const struct dse_measurement measurement = {m, NULL};
    dse_real x[2][NX];
    for (int scheme = 0; scheme < SCHEMES; scheme++) {
        if (scheme == DSE_DSO_ALONE)
            continue;
        for (int way = 0; way < 2; way++) {
            prepare((enum dse_dso_scheme)scheme, 3);
            make();
            for (int i = 0; i < 3; i++)
                assert_int_equal(dse_dso_begin(&network.node[i], 1, NULL, &measurement), DSE_OK);
            dse_real one[DSE_DSO_MESSAGE(NX, 1)], two[DSE_DSO_MESSAGE(NX, 1)];
            const int count = dse_dso_message(&network.node[1], one);
            dse_dso_message(&network.node[2], two);
            struct dse_dso *node = &network.node[0];
            if (way == 1) {
                dse_dso_receive(node, 1, one, count); /* replaced below */
                dse_dso_receive(node, 1, two, count);
            }
            dse_dso_receive(node, 0, one, count);
            if (way == 0)
                dse_dso_receive(node, 1, two, count);
            for (int r = 0; r < dse_dso_rounds(node); r++)
                assert_int_equal(dse_dso_end_round(node), DSE_OK);
            memcpy(x[way], state_of(0), sizeof x[way]);
        }
        assert_memory_equal(x[0], x[1], sizeof x[0]);
    }
}

static void silence_is_counted_and_said(void **state)
{
    (void)state;
    static const dse_real m[2] = {1, 2};
    prepare(DSE_DSO_B_INFORMATION, 2);
    make();
    assert_int_equal(network_sample(&network, 1, m), DSE_OK);
    assert_int_equal(dse_dso_health(&network.node[0]), DSE_HEALTH_TRACKING);
    network.mute[1] = true;
    assert_int_equal(network_sample(&network, 2, m), DSE_OK);
    assert_int_equal(dse_dso_health(&network.node[0]), DSE_HEALTH_ALONE);
    assert_int_equal(dse_dso_health(&network.node[1]), DSE_HEALTH_TRACKING);
    assert_int_equal(dse_dso_counts(&network.node[0])->silent, 2);
    assert_int_equal(dse_dso_counts(&network.node[0])->heard, 2);
    assert_int_equal(dse_dso_counts(&network.node[0])->samples, 2);
}

/* ---- protections ---- */

/* A node whose prediction fails keeps silent and its estimate; the other one goes on. */
static void a_node_that_fails_does_not_talk(void **state)
{
    (void)state;
    static const dse_real m[2] = {1, 2};
    for (int scheme = 0; scheme < SCHEMES; scheme++) {
        prepare((enum dse_dso_scheme)scheme, 2);
        network.base.filter.max_steps = 400;
        make();
        const dse_real far[NX] = {TOLERANCE(1e200, 1e25), 0, 0};
        assert_int_equal(dse_dso_set(&network.node[1], 0, far, NULL), DSE_OK);
        assert_true(network_sample(&network, 1, m) != DSE_OK);
        assert_int_equal(dse_dso_health(&network.node[1]), DSE_HEALTH_DIVERGED);
        assert_int_equal(dse_dso_counts(&network.node[1])->failed, 1);
        assert_all_near(NX, state_of(1), far, 0);
        assert_near(dse_dso_time(&network.node[1]), 0, 0);
        assert_int_equal(dse_dso_counts(&network.node[0])->heard, 0);
        assert_true(dse_norm_max(NX, state_of(0)) < 10);
        assert_int_equal(dse_dso_set(&network.node[1], 1, plant_start, unit_covariance), DSE_OK);
        assert_int_equal(network_sample(&network, 2, m), DSE_OK);
        assert_true(dse_dso_health(&network.node[1]) != DSE_HEALTH_DIVERGED);
    }
}

/* A neighbour's matrix that would make the fused one indefinite: the own one is used, and said. */
static void a_fused_matrix_that_is_not_positive_is_not_used(void **state)
{
    (void)state;
    static const enum dse_dso_scheme schemes[] = {DSE_DSO_B_INFORMATION, DSE_DSO_C_INFORMATION,
                                                  DSE_DSO_A_INFORMATION, DSE_DSO_A_COVARIANCE,
                                                  DSE_DSO_A_LITERAL,     DSE_DSO_B_LITERAL};
    static const dse_real m[1] = {3};
    static const struct dse_measurement measurement = {m, NULL};
    dse_real hostile[DSE_DSO_MESSAGE(NX, 1)], alone[NX];
    prepare(DSE_DSO_ALONE, 1);
    make();
    assert_int_equal(network_sample(&network, 1, m), DSE_OK);
    memcpy(alone, state_of(0), sizeof alone);
    for (int k = 0; k < DSE_DSO_MESSAGE(NX, 1); k++)
        hostile[k] = -1000000;
    for (int c = 0; c < 6; c++) {
        prepare(schemes[c], 2);
        make();
        struct dse_dso *node = &network.node[0];
        assert_int_equal(dse_dso_begin(node, 1, NULL, &measurement), DSE_OK);
        assert_int_equal(dse_dso_receive(node, 0, hostile, dse_dso_message_size(node, 0)), DSE_OK);
        if (schemes[c] == DSE_DSO_C_INFORMATION) /* its consensus term is no matter of a matrix */
            dse_dso_receive(node, 0, hostile, 0);
        assert_int_equal(dse_dso_end_round(node), DSE_OK);
        assert_int_equal(dse_dso_counts(node)->fallback, 1);
        if (schemes[c] != DSE_DSO_C_INFORMATION)
            assert_agree(NX, state_of(0), alone, TOLERANCE(1e-8, 1e-3));
        while (dse_dso_end_round(node) == DSE_OK)
            continue;
        assert_int_equal(dse_dso_health(node), DSE_HEALTH_REJECTING);
    }
}

static void setting_a_node_anew_empties_its_consensus_filters(void **state)
{
    (void)state;
    static const dse_real m[2] = {1, 2};
    dse_real fresh[NX];
    static const enum dse_dso_scheme schemes[] = {DSE_DSO_A_INFORMATION, DSE_DSO_A_COVARIANCE,
                                                  DSE_DSO_A_LITERAL};
    for (int c = 0; c < 3; c++) {
        for (int run = 0; run < 2; run++) {
            prepare(schemes[c], 2);
            network.base.memory = DSE_DSO_PERSISTENT;
            make();
            for (int k = 1; run == 1 && k < 4; k++)
                assert_int_equal(network_sample(&network, (dse_real)k, m), DSE_OK);
            for (int i = 0; i < 2; i++)
                assert_int_equal(dse_dso_set(&network.node[i], 10, network.w0[i], unit_covariance),
                                 DSE_OK);
            assert_int_equal(network_sample(&network, 11, m), DSE_OK);
            if (run == 0)
                memcpy(fresh, state_of(0), sizeof fresh);
        }
        assert_memory_equal(state_of(0), fresh, sizeof fresh);
    }
}

/* One message lost in one direction: sum v is not 0 any more, and no later round can know. */
static void by_default_a_one_sided_loss_is_forgotten(void **state)
{
    (void)state;
    dse_real error[3] = {0, 0, 0};
    for (int run = 0; run < 3; run++) { /* without a loss; with one; with one, by default */
        prepare(DSE_DSO_A_INFORMATION, 2);
        network.base.epsilon = DSE_REAL(0.5); /* the exact average in one round */
        network.base.memory = run == 2 ? DSE_DSO_AVERAGE : DSE_DSO_PERSISTENT;
        make();
        dse_real truth[NX];
        memcpy(truth, plant_start, sizeof truth);
        for (int k = 1; k <= 20; k++) {
            plant_second(&model, truth);
            const dse_real m[2] = {truth[0] + truth[1], truth[0] + truth[2]};
            network.lost[0][1] = run > 0 && k == 5;
            assert_int_equal(network_sample(&network, (dse_real)k, m), DSE_OK);
        }
        for (int i = 0; i < NX; i++)
            error[run] += dse_abs(state_of(0)[i] - truth[i]);
    }
    assert_true(error[1] > 4 * error[0]);
    assert_true(error[2] < 2 * error[0]);
}

/* ---- configuration ---- */

static void settings_outside_their_ranges_are_refused(void **state)
{
    (void)state;
    static dse_real memory[DSE_DSO_STORAGE(NX, 1, 1)];
    struct dse_dso_config cases[9];
    prepare(DSE_DSO_B, 2);
    for (int c = 0; c < 9; c++) {
        cases[c] = network.base;
        cases[c].filter.C = C_i;
    }
    cases[0].scheme = (enum dse_dso_scheme)SCHEMES;
    cases[1].memory = (enum dse_dso_memory)3;
    cases[2].delta = -1;
    cases[3].epsilon = NAN;
    cases[4].alpha = INFINITY;
    cases[5].n_neighbours = -1;
    cases[6].rounds = -1;
    cases[7].scheme = DSE_DSO_A_INFORMATION; /* nodes missing */
    cases[8].filter.S0 = NULL;
    for (int c = 0; c < 9; c++) {
        struct dse_dso node;
        struct dse_arena arena;
        dse_arena_init(&arena, memory, DSE_DSO_STORAGE(NX, 1, 1));
        if (dse_dso_init(&node, &cases[c], &arena) != DSE_EINVAL)
            fail_msg("case %d", c);
    }
}

static void storage_covers_every_scheme(void **state)
{
    (void)state;
    static dse_real memory[DSE_DSO_STORAGE(NX, 1, 4)];
    for (int scheme = 0; scheme < SCHEMES; scheme++) {
        prepare((enum dse_dso_scheme)scheme, 2);
        struct dse_dso_config config = network.base;
        config.filter.C = C_i;
        config.n_neighbours = 4;
        config.nodes = 5;
        struct dse_dso node;
        struct dse_arena arena;
        dse_arena_init(&arena, memory, DSE_DSO_STORAGE(NX, 1, 4));
        assert_int_equal(dse_dso_init(&node, &config, &arena), DSE_OK);
        const int used = arena.used;
        dse_arena_init(&arena, memory, used - 1);
        assert_int_equal(dse_dso_init(&node, &config, &arena), DSE_ESTORAGE);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(fused_information_is_the_central_filter),
        cmocka_unit_test(mixing_by_half_makes_two_nodes_agree),
        cmocka_unit_test(without_neighbours_b_and_c_are_the_filter_alone),
        cmocka_unit_test(a_dead_sensor_is_replaced_by_the_neighbours_information),
        cmocka_unit_test(normalisation_bounds_the_pull_of_neighbours),
        cmocka_unit_test(messages_have_the_documented_sizes),
        cmocka_unit_test(what_is_not_a_message_is_refused),
        cmocka_unit_test(neither_order_nor_repetition_of_messages_matters),
        cmocka_unit_test(silence_is_counted_and_said),
        cmocka_unit_test(a_node_that_fails_does_not_talk),
        cmocka_unit_test(a_fused_matrix_that_is_not_positive_is_not_used),
        cmocka_unit_test(setting_a_node_anew_empties_its_consensus_filters),
        cmocka_unit_test(by_default_a_one_sided_loss_is_forgotten),
        cmocka_unit_test(settings_outside_their_ranges_are_refused),
        cmocka_unit_test(storage_covers_every_scheme),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
