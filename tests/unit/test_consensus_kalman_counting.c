/* What nodes of a network believe of their own estimates, against their errors: the rotating target
 * of the consensus source's spec (5.4) on graphs with loops. Normalised estimation errors squared
 * (NEES) average to the number of states where the covariance is the error's, to less where it is
 * an upper bound, to more where measurements count too often. */
#include <string.h>

#include "consensus_network.h"
#include "near.h"

enum { NX = 2, RUNS = 30, SAMPLES = 80, FIRST = 30 };

static struct ckf_network network;

struct links {
    int nodes, count;
    int pairs[2 * CKF_EDGES];
};
static struct links ring, complete, ladder;

static void link_up(struct links *links, int i, int j)
{
    links->pairs[2 * links->count] = i;
    links->pairs[2 * links->count + 1] = j;
    links->count++;
}

static int make_graphs(void **state)
{
    (void)state;
    ring.nodes = complete.nodes = 6;
    ladder.nodes = 20;
    for (int i = 0; i < 6; i++) {
        link_up(&ring, i, (i + 1) % 6);
        for (int j = 0; j < i; j++)
            link_up(&complete, i, j);
    }
    for (int i = 0; i < 10; i++) { /* two rails of ten, and rungs */
        link_up(&ladder, i, i + 10);
        if (i < 9) {
            link_up(&ladder, i, i + 1);
            link_up(&ladder, i + 10, i + 11);
        }
    }
    return 0;
}

/* ---- runs ---- */

struct found {
    double nees; /* mean of e' P^-1 e */
    double rms;  /* of e */
};

struct setting {
    const struct links *links;
    struct dse_ckf_config base;
    bool alike;  /* all measure x_0, else alternately x_0 and x_1 */
    double loss; /* share of messages that do not arrive, each by itself */
};

static void make(const struct setting *setting)
{
    static const dse_real Q[4] = {DSE_REAL(0.01), 0, 0, DSE_REAL(0.01)}, P0[4] = {4, 0, 0, 4};
    static const dse_real R[1] = {DSE_REAL(0.25)};
    network = (struct ckf_network){.nodes = setting->links->nodes, .base = setting->base};
    network.base.ny = 1;
    network.base.R = R;
    network.base.Q = Q;
    network.base.P0 = P0;
    network.A[0] = network.A[3] = dse_cos(DSE_REAL(0.1));
    network.A[2] = dse_sin(DSE_REAL(0.1));
    network.A[1] = -network.A[2];
    for (int i = 0; i < network.nodes; i++)
        network.C[i][setting->alike ? 0 : i % 2] = 1;
    assert_int_equal(ckf_network_make(&network, NX, setting->links->count, setting->links->pairs),
                     DSE_OK);
}

static void measure(const dse_real *x, struct dse_random *random, dse_real *y)
{
    for (int i = 0; i < network.nodes; i++)
        y[i] = dse_dot(NX, network.C[i], x) + DSE_REAL(0.5) * (dse_real)dse_random_normal(random);
}

static void lose(double share, struct dse_random *random)
{
    for (int i = 0; i < network.nodes; i++)
        for (int j = 0; j < network.nodes; j++)
            network.deaf[i][j] = share > 0 && dse_random_uniform(random) < share;
}

static void add_errors(const dse_real *x, struct found *sum)
{
    for (int i = 0; i < network.nodes; i++) {
        const dse_real *P = dse_ckf_covariance(&network.node[i]);
        const dse_real *estimate = dse_ckf_state(&network.node[i]);
        const double e0 = (double)(estimate[0] - x[0]), e1 = (double)(estimate[1] - x[1]);
        const double determinant = (double)(P[0] * P[3] - P[1] * P[1]);
        const double form =
            e0 * e0 * (double)P[3] - 2 * e0 * e1 * (double)P[1] + e1 * e1 * (double)P[0];
        sum->nees += form / determinant;
        sum->rms += e0 * e0 + e1 * e1;
    }
}

static struct found run(const struct setting *setting)
{
    struct dse_random random;
    struct found sum = {0, 0};
    dse_random_init(&random, 3, 1);
    for (int r = 0; r < RUNS; r++) {
        make(setting);
        dse_real x[NX] = {(dse_real)(2 * dse_random_normal(&random)),
                          (dse_real)(2 * dse_random_normal(&random))};
        for (int k = 0; k < SAMPLES; k++) {
            dse_real y[CKF_NODES], next[NX];
            measure(x, &random, y);
            lose(setting->loss, &random);
            assert_int_equal(ckf_network_sample(&network, k, y), DSE_OK);
            if (k >= FIRST)
                add_errors(x, &sum);
            assert_int_equal(ckf_network_advance(&network), DSE_OK);
            dse_mat_vec(NX, NX, network.A, x, next);
            for (int c = 0; c < NX; c++)
                x[c] = next[c] + DSE_REAL(0.1) * (dse_real)dse_random_normal(&random);
        }
    }
    const double count = (double)RUNS * (SAMPLES - FIRST) * network.nodes;
    return (struct found){sum.nees / count, (double)dse_sqrt((dse_real)(sum.rms / count))};
}

/* The mean of NEES over so many samples, which depend on each other over some ten, scatters by
 * about 0.1: two states, 150 independent ones or more. */
#define SCATTER 0.25

/* ---- claims ---- */

static void by_default_nobody_believes_too_much_on_graphs_with_loops(void **state)
{
    (void)state;
    const struct links *graphs[] = {&ring, &complete, &ladder};
    for (size_t g = 0; g < 3; g++) {
        for (int rounds = 1; rounds <= 5; rounds += 4) {
            const struct setting setting = {.links = graphs[g], .base = {.rounds = rounds}};
            const struct found found = run(&setting);
            assert_true(found.nees < NX + SCATTER); /* at most the error's covariance */
            assert_true(found.nees > 1.5);          /* and not much more than it */
        }
    }
}

static void by_default_nobody_believes_too_much_when_messages_are_lost(void **state)
{
    (void)state;
    const struct setting once = {.links = &ring, .loss = 0.3};
    const struct setting kept = {.links = &ring, .base = {.counting = DSE_CKF_IN_ALL}, .loss = 0.3};
    const struct found found = run(&once), wrong = run(&kept);
    assert_true(found.nees < NX + SCATTER && found.nees > 1.3);
    assert_true(found.rms < 0.3);
    assert_true(wrong.nees > 50 && wrong.rms > 1); /* what the source's filters make of it */
}

static void estimates_that_are_mixed_are_no_worse_than_they_say(void **state)
{
    (void)state;
    const struct links *graphs[] = {&ring, &complete, &ladder};
    for (size_t g = 0; g < 3; g++) {
        for (int scheme = DSE_CKF_B; scheme <= DSE_CKF_C; scheme++) {
            const struct setting setting = {.links = graphs[g],
                                            .base = {.scheme = (enum dse_ckf_scheme)scheme}};
            const struct found found = run(&setting);
            assert_true(found.nees < NX + SCATTER && found.nees > 1.5);
        }
    }
}

static void the_literal_form_is_overconfident(void **state)
{
    (void)state;
    const struct links *graphs[] = {&ring, &complete, &ladder};
    for (size_t g = 0; g < 3; g++) {
        for (int rounds = 1; rounds <= 5; rounds += 4) {
            const struct setting setting = {
                .links = graphs[g], .base = {.scheme = DSE_CKF_A_LITERAL, .rounds = rounds}};
            assert_true(run(&setting).nees > 4 * NX);
        }
    }
}

/* Kept filters with the factor `nodes`: right with rounds enough for the graph, too sure of
 * themselves with fewer. */
static void kept_filters_need_rounds_enough(void **state)
{
    (void)state;
    struct setting setting = {.links = &ring, .base = {.counting = DSE_CKF_IN_ALL, .rounds = 5}};
    const double enough = run(&setting).nees;
    assert_true(enough < NX + SCATTER && enough > NX - SCATTER);
    setting.base.rounds = 1;
    assert_true(run(&setting).nees > 1.3 * NX);
}

/* Errors against those of the central filter, which a complete graph has. */
static double to_central(bool alike, enum dse_ckf_scheme scheme)
{
    const struct setting central = {.links = &complete, .base = {.rounds = 1}, .alike = alike};
    const struct setting setting = {.links = &ring, .base = {.scheme = scheme}, .alike = alike};
    return run(&setting).rms / run(&central).rms;
}

static void low_pass_filters_need_sensors_that_are_alike(void **state)
{
    (void)state;
    assert_true(to_central(true, DSE_CKF_A_LOW_PASS) < 1.15);
    assert_true(to_central(false, DSE_CKF_A_LOW_PASS) > 1.5);
    assert_true(to_central(true, DSE_CKF_A) < 1.05);
    assert_true(to_central(false, DSE_CKF_A) < 1.05);
}

/* Section 6.4: heterogeneous sensors, ratio of B and C to a single sensor 0.54 to 0.61. */
static void talking_beats_a_single_sensor(void **state)
{
    (void)state;
    const struct setting single = {.links = &ring, .base = {.scheme = DSE_CKF_ALONE}};
    const double own = run(&single).rms;
    for (int scheme = DSE_CKF_A; scheme <= DSE_CKF_C; scheme++) {
        const struct setting setting = {.links = &ring,
                                        .base = {.scheme = (enum dse_ckf_scheme)scheme}};
        assert_true(run(&setting).rms < 0.7 * own);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(by_default_nobody_believes_too_much_on_graphs_with_loops),
        cmocka_unit_test(by_default_nobody_believes_too_much_when_messages_are_lost),
        cmocka_unit_test(estimates_that_are_mixed_are_no_worse_than_they_say),
        cmocka_unit_test(the_literal_form_is_overconfident),
        cmocka_unit_test(kept_filters_need_rounds_enough),
        cmocka_unit_test(low_pass_filters_need_sensors_that_are_alike),
        cmocka_unit_test(talking_beats_a_single_sensor),
    };
    return cmocka_run_group_tests(tests, make_graphs, NULL);
}
