/* The adapters of the distributed Kalman filters and the distributed observers: combinations of
 * keys, who hears what of whom, and silence. */
#include "method_rig.h"

enum { USED = 3, HEARD = 1, HELD = 2 }; /* diagnostics */

/* Three states, four groups: x1; x2 and x3; x1; x3. */
#define HEAD                                                                                       \
    "name: sensors\ntime: {period_s: 0.1, duration_s: 10}\nplant:\n  name: linear\n  linear: "     \
    "{nx: "                                                                                        \
    "3, A: [-1, 1, 0, 0, -1, 1, 0, 0, -1], C: [1, 0, 0, 0, 1, 0, 0, 0, 1, 1, 0, 0, 0, 0, 1], "     \
    "groups: [1, 2, 1, 1]}\nnetworks:\n  - name: one\n    "

#define STAR "graph: {nodes: 4, edges: [0, 1, 0, 2, 0, 3]}\n    "
#define FILTER                                                                                     \
    "distributed_kalman: {Q: [1, 1, 1], R: [1, 1, 1, 1, 1], guesses: [1, 2, 3, 4, 5, 6, 7, 8, 9, " \
    "10, 11, 12], "
#define ALONE "Lambda: [-1, 0, 0, 0, -1, 0, 0, 0, -1]"

/* How many values node i says in round 0; -1: nothing. */
static int say(struct rig *rig, int i, struct method_message *message)
{
    static struct method_plan plan;
    plan = (struct method_plan){.speak = true};
    if (rig->method->next(rig->node[i], 0, &plan, message) == METHOD_DONE || !plan.speak ||
        message->withheld)
        return -1;
    return message->count;
}

/* ---- keys ---- */

static void keys_that_do_not_fit_are_refused(void **state)
{
    (void)state;
    static const struct {
        const char *keys, *wanted;
    } cases[] = {
        {FILTER "scheme: edge, gamma: 1}", "graph is missing: who hears whom"},
        {STAR FILTER "scheme: edge}", "gamma is missing"},
        {STAR "distributed_kalman: {scheme: none, R: [1, 1, 1, 1, 1]}", "guesses is missing"},
        {STAR "guess: [0, 0, 0]\n    distributed_kalman: {scheme: none}", "R is missing"},
        {STAR FILTER "scheme: node, gamma: 1, direction: given}", "given and D need each other"},
        {STAR FILTER "scheme: global, gamma: 1}", "as many outputs at every node"},
        {STAR FILTER "scheme: none, K: [1, 2]}", "K has 2 values; it must have 15"},
        {STAR FILTER "scheme: none, sensors: [0, 1]}", "sensors has 2 entries; the graph has 4"},
        {STAR FILTER "scheme: none, sensors: [0, 1, 2, 4]}", "node 3 reads sensor group 4"},
        {STAR FILTER "scheme: sideways}", "is not one of: none, edge, node, global, standard"},
        {"graph: {nodes: 5, edges: []}\n    distributed_kalman: {scheme: none, R: [1, 1, 1, 1, 1], "
         "guesses: [0]}",
         "node 4 reads sensor group 4; plant linear has the groups 0 to 3 (see sensors)"},
        {STAR "distributed_observer: {nodes: [{" ALONE "}]}", "nodes has 1 entries"},
        {"distributed_observer: {nodes: [{" ALONE ", L: [1, 2]}]}",
         "nodes[0].L has 2 values; it must have 3 x 1"},
        {"distributed_observer: {nodes: [{Lambda: [-1]}]}", "nodes[0].M is missing"},
        {"distributed_observer: {states: [3], nodes: [{Lambda: [-1]}]}", "there is no state 3"},
        {"distributed_observer: {sensors: [7], nodes: [{" ALONE "}]}", "reads sensor group 7"},
        {"link: {D: 1}\n    " FILTER "scheme: none}", "link.D: must be 0"},
    };
    static struct rig rig;
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++) {
        struct error error = {.text = ""};
        if (open_rig(&rig, HEAD, cases[c].keys, &error)) {
            close_rig(&rig);
            fail_msg("accepted: %s", cases[c].keys);
        }
        if (strstr(error.text, cases[c].wanted) == NULL)
            fail_msg("\n  message:  %s\n  expected: %s", error.text, cases[c].wanted);
    }
}

/* ---- who hears what ---- */

/* Node 0 is heard by nodes with C = [0 1 0; 0 0 1], [1 0 0] and [0 0 1]. */
static void a_filter_says_each_listener_what_its_sensors_would_see(void **state)
{
    (void)state;
    static struct rig rig;
    double value[METHOD_MESSAGE_CAPACITY];
    struct method_message message = {.value = value};
    must_open(&rig, HEAD, STAR FILTER "scheme: edge, gamma: 1}");
    begin(&rig, 0, 0, true);
    assert_int_equal(say(&rig, 0, &message), 4);
    const double wanted[] = {2, 3, 1, 3};
    assert_memory_equal(value, wanted, sizeof wanted);
    assert_int_equal(rig.info[1].n_frames, 1);
    assert_int_equal(rig.info[1].frames[0].from, 0);
    assert_int_equal(rig.info[1].frames[0].values, 2);
    assert_int_equal(rig.info[3].frames[0].values, 1);
    assert_int_equal(rig.info[0].n_frames, 0);
    close_rig(&rig);
}

static void listeners_with_equal_sensors_are_told_once(void **state)
{
    (void)state;
    static struct rig rig;
    double value[METHOD_MESSAGE_CAPACITY];
    struct method_message message = {.value = value};
    must_open(&rig, HEAD, STAR FILTER "scheme: edge, gamma: 1, sensors: [0, 3, 2, 3]}");
    begin(&rig, 0, 0, true);
    assert_int_equal(say(&rig, 0, &message), 2);
    const double wanted[] = {3, 1};
    assert_memory_equal(value, wanted, sizeof wanted);
    close_rig(&rig);
}

/* Node 2 reads x1, the third of four values: with d = 1 - 7 its gain moves with beta eps d. */
static void a_filter_takes_its_own_part_of_a_message(void **state)
{
    (void)state;
    static struct rig rig;
    double value[METHOD_MESSAGE_CAPACITY];
    struct method_message message = {.value = value};
    must_open(&rig, HEAD, STAR FILTER "scheme: edge, gamma: 1e-9, hold: 0}");
    begin(&rig, 0, 0, true);
    assert_int_equal(say(&rig, 0, &message), 4);
    begin(&rig, 2, 0, true);
    assert_int_equal(rig.method->receive(rig.node[2], 0, 0, &message), DSE_OK);
    assert_int_equal(rig.method->finish(rig.node[2], &rig.estimate[2]), DSE_OK);
    assert_float_equal(rig.estimate[2].diagnostic[USED], 1, 0);
    begin(&rig, 2, 1, true);
    message.count = 2;
    assert_int_equal(rig.method->receive(rig.node[2], 0, 0, &message), DSE_EDIM);
    rig.method->finish(rig.node[2], &rig.estimate[2]);
    /* Gamma = int beta eps (C x_0 - C x_2) dt over 0.1: eps = 1 - 7, C x_0 = 1, C x_2 = 7; the
     * estimate moves meanwhile, so 3.6 is the start of it only */
    assert_in_range((int64_t)(1000 * rig.estimate[2].diagnostic[0]), 2000, 3600);
    assert_float_equal(rig.estimate[2].diagnostic[USED], 0, 0);
    close_rig(&rig);
}

static void without_listeners_nobody_speaks(void **state)
{
    (void)state;
    static struct rig rig;
    double value[METHOD_MESSAGE_CAPACITY];
    struct method_message message = {.value = value};
    must_open(&rig, HEAD, STAR FILTER "scheme: standard, gamma: 1}");
    for (int i = 0; i < 4; i++) {
        begin(&rig, i, 0, true);
        assert_int_equal(say(&rig, i, &message), i == 0 ? 3 : -1);
    }
    close_rig(&rig);
}

/* ---- observers ---- */

#define CHAIN(tunables)                                                                            \
    "graph: {nodes: 2, edges: [0, 1]}\n    distributed_observer: {states: [2], sensors: [3, 0], "  \
    "nodes: [{Lambda: [-1], L: [1], N: [1], Pi: [1], C2: [2]}, {Lambda: [-1], L: [1], Pi: [1], "   \
    "C2: [1]}], " tunables "}"

static void observers_say_the_rows_in_which_they_are_compared(void **state)
{
    (void)state;
    static struct rig rig;
    double value[METHOD_MESSAGE_CAPACITY];
    struct method_message message = {.value = value};
    must_open(&rig, HEAD, CHAIN("gamma: 1"));
    assert_int_equal(rig.info[0].n_states, 1);
    assert_int_equal(rig.info[0].states[0], 2);
    begin(&rig, 0, 0, true);
    begin(&rig, 1, 0, true);
    assert_int_equal(say(&rig, 0, &message), 1);
    assert_float_equal(value[0], 2, 0); /* C2 (M z + N y) = 2 (0 + 1) */
    assert_int_equal(rig.method->receive(rig.node[1], 0, 0, &message), DSE_OK);
    assert_int_equal(rig.method->finish(rig.node[1], &rig.estimate[1]), DSE_OK);
    assert_float_equal(rig.estimate[1].diagnostic[HEARD], 1, 0);
    message.count = 2;
    assert_int_equal(rig.method->receive(rig.node[1], 0, 0, &message), DSE_EDIM);
    assert_int_equal(say(&rig, 1, &message), -1); /* nobody listens */
    close_rig(&rig);
}

static void an_observer_without_its_measurements_keeps_silent(void **state)
{
    (void)state;
    static struct rig rig;
    double value[METHOD_MESSAGE_CAPACITY];
    struct method_message message = {.value = value};
    must_open(&rig, HEAD, CHAIN("gamma: 1"));
    begin(&rig, 0, 0, false);
    assert_int_equal(say(&rig, 0, &message), -1);
    rig.method->finish(rig.node[0], &rig.estimate[0]);
    assert_int_equal(rig.estimate[0].health, DSE_HEALTH_INITIALISING);
    begin(&rig, 0, 1, true);
    assert_int_equal(say(&rig, 0, &message), 1);
    close_rig(&rig);
}

/* ---- silence ---- */

/* For how many samples after its only word node 0 acts on node 1. */
static int samples_held(const char *keys)
{
    static struct rig rig;
    double value[METHOD_MESSAGE_CAPACITY];
    struct method_message message = {.value = value};
    must_open(&rig, HEAD, keys);
    const int diagnostic = strstr(keys, "distributed_kalman") != NULL ? USED : HELD;
    int held = 0;
    for (int k = 0; k < 8; k++) {
        begin(&rig, 0, k, true);
        begin(&rig, 1, k, true);
        assert_true(say(&rig, 0, &message) > 0);
        if (k == 0)
            assert_int_equal(rig.method->receive(rig.node[1], 0, 0, &message), DSE_OK);
        assert_int_equal(rig.method->finish(rig.node[1], &rig.estimate[1]), DSE_OK);
        held += k > 0 && rig.estimate[1].diagnostic[diagnostic] > 0;
    }
    close_rig(&rig);
    return held;
}

static void
a_silent_neighbour_is_held_for_three_samples_unless_the_section_says_otherwise(void **state)
{
    (void)state;
    static const struct {
        const char *keys;
        int held;
    } cases[] = {
        {STAR FILTER "scheme: edge, gamma: 1}", 3},
        {STAR FILTER "scheme: edge, gamma: 1, hold: 0}", 0},
        {STAR FILTER "scheme: edge, gamma: 1, hold: 5}", 5},
        {CHAIN("gamma: 1"), 3},
        {CHAIN("gamma: 1, hold: 0"), 0},
        {CHAIN("gamma: 1, hold: 5"), 5},
    };
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++)
        assert_int_equal(samples_held(cases[c].keys), cases[c].held);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(keys_that_do_not_fit_are_refused),
        cmocka_unit_test(a_filter_says_each_listener_what_its_sensors_would_see),
        cmocka_unit_test(listeners_with_equal_sensors_are_told_once),
        cmocka_unit_test(a_filter_takes_its_own_part_of_a_message),
        cmocka_unit_test(without_listeners_nobody_speaks),
        cmocka_unit_test(observers_say_the_rows_in_which_they_are_compared),
        cmocka_unit_test(an_observer_without_its_measurements_keeps_silent),
        cmocka_unit_test(
            a_silent_neighbour_is_held_for_three_samples_unless_the_section_says_otherwise),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
