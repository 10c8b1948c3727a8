/* The adapters of the consensus Kalman filters and the distributed second-order filters:
 * combinations of keys, the central node, samples that are let pass, and losses. */
#include <math.h>

#include "dse/distributed_second_order.h"
#include "method_rig.h"

/* Two sensors of x1 + x2 and x1 + x3. */
#define PAIR                                                                                       \
    "name: pair\ntime: {period_s: 1, duration_s: 100}\nplant: {name: quadratic_ex4}\n"             \
    "networks:\n  - name: one\n    "
/* Three sensors of x1, x2 and both. */
#define LINEAR                                                                                     \
    "name: line\ntime: {period_s: 1, duration_s: 100}\nplant:\n  name: linear\n  linear: {time: "  \
    "discrete, nx: 2, A: [1, 1, 0, 1], C: [1, 0, 0, 1, 1, 1], groups: [1, 1, 1]}\n"                \
    "networks:\n  - name: one\n    "
#define LINK "graph: {nodes: 2, undirected: true, edges: [0, 1]}\n    "
#define LINE "graph: {nodes: 3, undirected: true, edges: [0, 1, 1, 2]}\n    "
#define SECOND                                                                                     \
    "second_order: {R: [0.01, 0.04], guesses: [4, 3, 2, 2, 1, 3], P0: [1, 1, 1], substeps: 20, "
#define KALMAN "consensus_kalman: {R: [1, 2, 3], Q: [1, 1], guesses: [1, 2, 3, 4, 5, 9], "

/* ---- keys ---- */

static void keys_that_do_not_fit_are_refused(void **state)
{
    (void)state;
    static const struct {
        const char *head, *keys, *wanted;
    } cases[] = {
        {PAIR, SECOND "scheme: B}", "graph is missing: who hears whom; without one there are only"},
        {PAIR, LINK SECOND "scheme: central}", "graph: a central node hears nobody"},
        {PAIR, LINK SECOND "scheme: sideways}", "is not one of: B_information, C_information"},
        {PAIR, LINK SECOND "sensors: [0, 2]}", "node 1 reads sensor group 2"},
        {PAIR, SECOND "scheme: central, sensors: [0, 0]}", "reads each group once"},
        {PAIR, SECOND "scheme: central, sensors: [0, 2]}", "there is no such sensor group"},
        {PAIR, LINK SECOND "delta: 0}", "delta: 0 is out of range; it must be > 0"},
        {PAIR, LINK SECOND "rounds: 0}", "rounds: 0 is out of range"},
        {PAIR, LINK "second_order: {R: [1, 1]}", "guesses is missing"},
        {PAIR, LINK "second_order: {guesses: [1, 2, 3, 4, 5, 6]}", "R: is missing"},
        {PAIR, LINK "second_order: {R: [1], guesses: [1, 2, 3, 4, 5, 6]}", "R: has 1 values"},
        {PAIR, LINK "second_order: {R: [1, 1], guesses: [1, 2, 3]}",
         "guesses has 3 values; it must have 6"},
        {PAIR, "link: {D: 1}\n    " LINK SECOND "}", "link.D: must be 0"},
        {PAIR, LINK "consensus_kalman: {R: [1, 1], guesses: [1, 2, 3, 4, 5, 6]}",
         "quadratic_ex4 is not a linear plant with `time: discrete`"},
        {LINEAR, LINE "second_order: {R: [1, 2, 3], guesses: [1, 2, 3, 4, 5, 6]}",
         "plant linear is not a quadratic system"},
        {LINEAR, LINE KALMAN "scheme: A, epsilon: 0.6}", "filter 0 cannot be set up"},
        {LINEAR, KALMAN "scheme: A}", "graph is missing"},
    };
    static struct rig rig;
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++) {
        struct error error = {.text = ""};
        if (open_rig(&rig, cases[c].head, cases[c].keys, &error)) {
            close_rig(&rig);
            fail_msg("accepted: %s", cases[c].keys);
        }
        if (strstr(error.text, cases[c].wanted) == NULL)
            fail_msg("\n  message:  %s\n  expected: %s", error.text, cases[c].wanted);
    }
}

/* A literal scheme sums what sensors say: they need as many outputs each. */
static void literal_schemes_need_equal_sensors(void **state)
{
    (void)state;
    static struct rig rig;
    struct error error = {.text = ""};
    assert_true(open_rig(&rig, PAIR, LINK SECOND "scheme: B_literal}", &error));
    close_rig(&rig);
}

/* ---- one node ---- */

static void start(struct rig *rig, int i, int64_t k, const double *y)
{
    static const bool valid[] = {true, true, true};
    const struct method_sample sample = {
        .k = k, .t = (double)k * rig->setup[0].period, .y = y, .valid = valid};
    assert_int_equal(rig->method->begin(rig->node[i], &sample), DSE_OK);
}

static void end(struct rig *rig, int i)
{
    assert_int_equal(rig->method->finish(rig->node[i], &rig->estimate[i]), DSE_OK);
}

/* All outputs in one filter, from the mean of the guesses. */
static void a_central_node_reads_all_sensors(void **state)
{
    (void)state;
    static struct rig rig;
    must_open(&rig, LINEAR, KALMAN "scheme: central}");
    assert_int_equal(rig.nodes, 1);
    assert_int_equal(rig.info[0].n_groups, 3);
    assert_int_equal(rig.info[0].n_neighbours, 0);
    start(&rig, 0, 0, (const double[]){3, 5, 8}); /* as the mean (3, 5) has it */
    struct method_plan plan = {.speak = true};
    struct method_message message = {.count = 0};
    assert_int_equal(rig.method->next(rig.node[0], 0, &plan, &message), METHOD_DONE);
    end(&rig, 0);
    assert_true(fabs(rig.estimate[0].state[0] - 3) < 1e-12);
    assert_true(fabs(rig.estimate[0].state[1] - 5) < 1e-12);
    /* P = (I + C'R^-1 C)^-1 = [7/3 1/3; 1/3 11/6]^-1 */
    const double det = 7.0 / 3 * 11 / 6 - 1.0 / 9;
    assert_true(fabs(rig.estimate[0].variance[0] - 11.0 / 6 / det) < 1e-12);
    assert_true(fabs(rig.estimate[0].variance[1] - 7.0 / 3 / det) < 1e-12);
    close_rig(&rig);
}

static void a_central_node_takes_some_groups_and_the_guess_of_its_own(void **state)
{
    (void)state;
    static struct rig rig;
    must_open(&rig, PAIR, "guess: [7, 8, 9]\n    " SECOND "scheme: central, sensors: [1, 0]}");
    assert_int_equal(rig.info[0].n_groups, 2);
    assert_int_equal(rig.info[0].groups[0], 1);
    start(&rig, 0, 0, (const double[]){16, 15}); /* x1 + x3, x1 + x2 */
    end(&rig, 0);
    for (int s = 0; s < 3; s++)
        assert_true(fabs(rig.estimate[0].state[s] - (7 + s)) < 1e-12);
    close_rig(&rig);
}

/* Neither the values nor the time of a sample that is let pass are used: the first one that counts
 * is predicted to from the guess, at time 0. */
static void samples_are_let_pass_without_a_word(void **state)
{
    (void)state;
    static struct rig rig;
    struct method_plan plan = {.speak = true};
    double value[METHOD_MESSAGE_CAPACITY];
    struct method_message message = {.value = value};
    must_open(&rig, PAIR, LINK SECOND "scheme: B, skip: 1}");
    start(&rig, 0, 0, (const double[]){100});
    assert_int_equal(rig.method->next(rig.node[0], 0, &plan, &message), METHOD_DONE);
    end(&rig, 0);
    assert_true(rig.estimate[0].state[0] == 4 && rig.estimate[0].state[2] == 2);
    assert_int_equal(rig.estimate[0].health, DSE_HEALTH_INITIALISING);
    start(&rig, 0, 1, (const double[]){3});
    assert_int_equal(rig.method->next(rig.node[0], 0, &plan, &message), METHOD_ROUND);
    assert_int_equal(message.count, 3);
    assert_false(message.withheld);
    assert_int_equal(rig.method->next(rig.node[0], 1, &plan, &message), METHOD_DONE);
    end(&rig, 0);
    assert_true(rig.estimate[0].state[0] != 4);
    assert_int_equal(rig.estimate[0].health, DSE_HEALTH_ALONE);
    close_rig(&rig);
}

/* ---- two nodes ---- */

/* One sample of both; `last` is the number of rounds. Returns how often node 0 heard node 1. */
static int sample_of_both(struct rig *rig, int64_t k, int rounds)
{
    static double value[2][METHOD_MESSAGE_CAPACITY];
    struct method_message message[2] = {{.value = value[0]}, {.value = value[1]}};
    static double silent_before;
    enum { SILENT = 3 };
    for (int i = 0; i < 2; i++)
        start(rig, i, k, (const double[]){1});
    for (int r = 0; r <= rounds; r++) {
        struct method_plan plan = {.speak = true};
        for (int i = 0; i < 2; i++)
            assert_int_equal(rig->method->next(rig->node[i], r, &plan, &message[i]),
                             r < rounds ? METHOD_ROUND : METHOD_DONE);
        for (int i = 0; i < 2 && r < rounds; i++)
            assert_int_equal(rig->method->receive(rig->node[i], r, 1 - i, &message[1 - i]), DSE_OK);
    }
    end(rig, 0);
    end(rig, 1);
    silent_before = k == 0 ? 0 : silent_before;
    const double silent = rig->estimate[0].diagnostic[SILENT] - silent_before;
    silent_before = rig->estimate[0].diagnostic[SILENT];
    return rounds - (int)silent;
}

/* Whatever is said in a sample, one mask per sample and direction. */
static void all_messages_of_a_sample_share_one_fate(void **state)
{
    (void)state;
    static struct rig rig;
    int heard[3] = {0};
    must_open(&rig, PAIR, LINK "link: {T_m: 100, loss: 0.5}\n    " SECOND "scheme: B_information}");
    for (int64_t k = 0; k < 100; k++)
        heard[sample_of_both(&rig, k, 2)]++;
    assert_int_equal(heard[1], 0);
    assert_in_range(heard[0], 35, 65);
    assert_in_range(heard[2], 35, 65);
    close_rig(&rig);
}

/* As many rounds as the scheme has, and what is said in each. */
static void rounds_and_messages_are_those_of_the_scheme(void **state)
{
    (void)state;
    static const struct {
        const char *head, *keys;
        int rounds, values[3]; /* of node 0 by round */
    } cases[] = {
        {PAIR, LINK SECOND "scheme: B_information}", 2, {9, 3}},
        {PAIR, LINK SECOND "scheme: C_information}", 1, {12}},
        {PAIR, LINK SECOND "scheme: A_information, rounds: 3}", 3, {9, 9, 9}},
        {PAIR, LINK SECOND "scheme: B}", 1, {3}},
        {PAIR, LINK SECOND "scheme: C}", 1, {3}},
        {PAIR, LINK SECOND "scheme: A_covariance, rounds: 2}", 2, {12, 12}},
        {PAIR, LINK SECOND "scheme: A_covariance, memory: restart}", 1, {12}},
        {PAIR, LINK SECOND "scheme: none}", 0, {0}},
        {LINEAR, LINE KALMAN "scheme: A, rounds: 2}", 2, {8, 8}}, /* with three weights */
        {LINEAR, LINE KALMAN "scheme: A, rounds: 2, counting: in_all}", 2, {5, 5}},
        {LINEAR, LINE KALMAN "scheme: B}", 2, {5, 2}},
        {LINEAR, LINE KALMAN "scheme: C}", 1, {7}},
    };
    static struct rig rig;
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++) {
        static double value[METHOD_MESSAGE_CAPACITY];
        struct method_message message = {.value = value};
        struct method_plan plan = {.speak = true};
        must_open(&rig, cases[c].head, cases[c].keys);
        start(&rig, 0, 0, (const double[]){1});
        int r = 0;
        for (; rig.method->next(rig.node[0], r, &plan, &message) == METHOD_ROUND; r++) {
            assert_in_range(r, 0, 2);
            assert_int_equal(message.count, cases[c].values[r]);
            assert_int_equal(rig.info[0].frames[r].values, cases[c].values[r]);
        }
        assert_int_equal(r, cases[c].rounds);
        assert_int_equal(rig.info[0].n_frames, cases[c].rounds);
        close_rig(&rig);
    }
}

/* Variances, information and the filter's own memory are what the library says that they are. */
static void storage_and_variances_are_told(void **state)
{
    (void)state;
    static struct rig rig;
    must_open(&rig, PAIR, LINK SECOND "scheme: B}");
    start(&rig, 0, 0, (const double[]){7});
    struct method_plan plan = {.speak = true};
    double value[METHOD_MESSAGE_CAPACITY];
    struct method_message message = {.value = value};
    assert_int_equal(rig.method->next(rig.node[0], 0, &plan, &message), METHOD_ROUND);
    assert_int_equal(rig.method->next(rig.node[0], 1, &plan, &message), METHOD_DONE);
    end(&rig, 0);
    /* S - S C'C S / (C S C' + R) with S = I, C = [1 1 0], R = 0.01 */
    assert_true(fabs(rig.estimate[0].variance[0] - (1 - 1 / 2.01)) < 1e-12);
    assert_true(fabs(rig.estimate[0].variance[2] - 1) < 1e-12);
    assert_true(rig.info[0].storage_bytes > (int64_t)sizeof(struct dse_dso));
    close_rig(&rig);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(keys_that_do_not_fit_are_refused),
        cmocka_unit_test(literal_schemes_need_equal_sensors),
        cmocka_unit_test(a_central_node_reads_all_sensors),
        cmocka_unit_test(a_central_node_takes_some_groups_and_the_guess_of_its_own),
        cmocka_unit_test(samples_are_let_pass_without_a_word),
        cmocka_unit_test(all_messages_of_a_sample_share_one_fate),
        cmocka_unit_test(rounds_and_messages_are_those_of_the_scheme),
        cmocka_unit_test(storage_and_variances_are_told),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
