/* Lossy networks: fates of packets, what a receiver keeps, the age bound, triggers. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "dse/link.h"

enum { MAX_D = 5, STAMPS = 400 };

static struct dse_link_config lossy(int D, int T_m, double loss, uint64_t seed)
{
    return (struct dse_link_config){.max_delay = D, .max_losses = T_m, .loss = loss, .seed = seed};
}

static struct dse_link link_of(const struct dse_link_config *config, int to, int from)
{
    struct dse_link link;
    assert_int_equal(dse_link_init(&link, config, to, from), DSE_OK);
    return link;
}

/* ---- fates ---- */

static void delays_and_runs_of_losses_stay_within_their_bounds(void **state)
{
    (void)state;
    for (int D = 0; D <= MAX_D; D++) {
        for (int T_m = 0; T_m <= 3; T_m++) {
            const struct dse_link_config config =
                lossy(D, T_m, 0.7, 17 * (uint64_t)D + (uint64_t)T_m);
            struct dse_link link = link_of(&config, 1, 0);
            int run = 0, longest = 0, largest = 0;
            assert_int_equal(dse_link_fate(&link, 0), 0);
            for (int s = 1; s < STAMPS; s++) {
                const int fate = dse_link_fate(&link, s);
                assert_in_range(fate + 1, 0, D + 1);
                run = fate == DSE_LINK_LOST ? run + 1 : 0;
                longest = run > longest ? run : longest;
                largest = fate > largest ? fate : largest;
            }
            /* bounds that are reached, not only kept */
            assert_int_equal(longest, T_m);
            assert_int_equal(largest, D);
        }
    }
}

static void losses_and_delays_come_as_often_as_configured(void **state)
{
    (void)state;
    enum { N = 20000 };
    const struct dse_link_config config = lossy(3, N, 0.4, 5);
    struct dse_link link = link_of(&config, 0, 1);
    int count[5] = {0};
    for (int s = 1; s <= N; s++) {
        count[dse_link_fate(&link, s) + 1]++;
    }
    assert_true(fabs(count[0] / (double)N - 0.4) < 0.015); /* four standard deviations */
    for (int d = 1; d < 5; d++) {
        assert_true(fabs(count[d] / (double)N - 0.15) < 0.011);
    }
}

static void fate_depends_on_seed_pair_and_stamp_only(void **state)
{
    (void)state;
    const struct dse_link_config one = lossy(3, 2, 0.4, 1), two = lossy(3, 2, 0.4, 2);
    struct dse_link a = link_of(&one, 0, 1), b = link_of(&one, 0, 1), c = link_of(&one, 1, 0),
                    d = link_of(&two, 0, 1);
    int other_pair = 0, other_seed = 0;
    for (int s = 0; s < STAMPS; s++) {
        const int fate = dse_link_fate(&a, s);
        other_pair += fate != dse_link_fate(&c, s);
        other_seed += fate != dse_link_fate(&d, s);
        /* b asks for every third stamp only */
        if (s % 3 == 0) {
            assert_int_equal(dse_link_fate(&b, s), fate);
        }
    }
    assert_true(other_pair > STAMPS / 4 && other_seed > STAMPS / 4);
    assert_int_equal(dse_link_fate(&b, 5), DSE_LINK_LOST); /* passed over */
}

static void recorded_network_is_replayed(void **state)
{
    (void)state;
    static const int16_t table[2 * 2 * 3] = {0, 0, 0, /**/ 1, -1, 3, /**/ 2, 0, -1, /**/ 0, 0, 0};
    const struct dse_link_config config = {.max_delay = 2, .table = table, .nodes = 2, .stamps = 3};
    struct dse_link link = link_of(&config, 0, 1), back = link_of(&config, 1, 0);
    assert_int_equal(dse_link_fate(&link, 0), 1);
    assert_int_equal(dse_link_fate(&link, 1), DSE_LINK_LOST);
    assert_int_equal(dse_link_fate(&link, 2), DSE_LINK_LOST); /* 3 is beyond D */
    assert_int_equal(dse_link_fate(&link, 3), 0);             /* beyond the table */
    assert_int_equal(dse_link_fate(&back, 0), 2);
    assert_int_equal(dse_link_fate(&back, 2), DSE_LINK_LOST);
    struct dse_link outside;
    assert_int_equal(dse_link_init(&outside, &config, 2, 0), DSE_EINVAL);
    assert_int_equal(dse_link_init(&outside, &config, 0, 2), DSE_EINVAL);
}

static void impossible_networks_are_refused(void **state)
{
    (void)state;
    struct dse_link link;
    struct dse_link_config config = lossy(-1, 2, 0.4, 1);
    assert_int_equal(dse_link_init(&link, &config, 0, 1), DSE_EINVAL);
    config = lossy(3, -1, 0.4, 1);
    assert_int_equal(dse_link_init(&link, &config, 0, 1), DSE_EINVAL);
    config = lossy(3, 2, 1.1, 1);
    assert_int_equal(dse_link_init(&link, &config, 0, 1), DSE_EINVAL);
    config = lossy(3, 2, NAN, 1);
    assert_int_equal(dse_link_init(&link, &config, 0, 1), DSE_EINVAL);
    config = lossy(3, 2, 0.4, 1);
    assert_int_equal(dse_link_init(&link, &config, -1, 1), DSE_EINVAL);
    assert_int_equal(dse_link_init(&link, NULL, 0, 1), DSE_EINVAL);
}

static void nothing_arrives_during_an_outage_and_all_else_is_as_without(void **state)
{
    (void)state;
    static const struct dse_link_outage outages[] = {
        {.from = 1, .to = 0, .first = 10, .end = 20},
        {.from = -1, .to = 2, .first = 30, .end = 35},
        {.from = 0, .to = -1, .first = 40, .end = 41},
        {.from = -1, .to = -1, .first = 50, .end = 60}};
    const struct dse_link_config plain = lossy(3, 2, 0.3, 9);
    struct dse_link_config troubled = plain;
    troubled.outages = outages;
    troubled.n_outages = 4;
    for (int to = 0; to < 3; to++) {
        for (int from = 0; from < 3; from++) {
            struct dse_link a = link_of(&plain, to, from), b = link_of(&troubled, to, from);
            for (int s = 0; s < STAMPS; s++) {
                const bool out = (to == 0 && from == 1 && s >= 10 && s < 20) ||
                                 (to == 2 && s >= 30 && s < 35) || (from == 0 && s == 40) ||
                                 (s >= 50 && s < 60);
                const int fate = dse_link_fate(&a, s);
                assert_int_equal(dse_link_fate(&b, s), out ? DSE_LINK_LOST : fate);
            }
        }
    }
    troubled.outages = NULL;
    struct dse_link link;
    assert_int_equal(dse_link_init(&link, &troubled, 0, 1), DSE_EINVAL);
    troubled.n_outages = -1;
    assert_int_equal(dse_link_init(&link, &troubled, 0, 1), DSE_EINVAL);
}

/* ---- rounds ---- */

static void each_round_has_a_loss_of_its_own_that_depends_on_no_other(void **state)
{
    (void)state;
    enum { N = 4000, ROUNDS = 5 };
    const struct dse_link_config config = lossy(0, N * ROUNDS, 0.25, 6);
    struct dse_link all = link_of(&config, 0, 1), few = link_of(&config, 0, 1),
                    back = link_of(&config, 1, 0);
    int lost = 0, both = 0, other = 0;
    for (int k = 0; k < N; k++) {
        bool before = false;
        for (int r = 0; r < ROUNDS; r++) {
            const bool now = dse_link_lost(&all, k, r);
            assert_int_equal(dse_link_lost(&all, k, r), now); /* asked again */
            lost += now;
            both += now && before;
            other += now != dse_link_lost(&back, k, r);
            if (r == k % ROUNDS) {
                assert_int_equal(dse_link_lost(&few, k, r), now);
            }
            before = now;
        }
    }
    /* four standard deviations of a binomial count */
    assert_true(fabs(lost / (double)(N * ROUNDS) - 0.25) < 0.0125);
    assert_true(fabs(both / (double)(N * (ROUNDS - 1)) - 0.0625) < 0.008);
    assert_true(other > N);
}

static void losses_in_a_row_stay_within_their_bound_over_rounds_and_samples(void **state)
{
    (void)state;
    for (int T_m = 0; T_m <= 3; T_m++) {
        const struct dse_link_config config = lossy(0, T_m, 0.9, 3);
        struct dse_link link = link_of(&config, 0, 1);
        int run = 0, longest = 0;
        for (int k = 0; k < STAMPS; k++) {
            for (int r = 0; r < 1 + k % 3; r++) {
                run = dse_link_lost(&link, k, r) ? run + 1 : 0;
                longest = run > longest ? run : longest;
            }
        }
        assert_int_equal(longest, T_m);
    }
}

static void rounds_follow_outages_and_recorded_networks_and_never_go_back(void **state)
{
    (void)state;
    static const int16_t table[2 * 2 * 3] = {0, 0, 0, /**/ 0, -1, 1, /**/ 0, 0, 0, /**/ 0, 0, 0};
    static const struct dse_link_outage outage = {.from = 1, .to = 0, .first = 4, .end = 5};
    const struct dse_link_config config = {.max_delay = 2,
                                           .table = table,
                                           .nodes = 2,
                                           .stamps = 3,
                                           .outages = &outage,
                                           .n_outages = 1};
    static const bool lost[] = {false, true, true, false, true, false};
    struct dse_link link = link_of(&config, 0, 1);
    assert_true(dse_link_lost(&link, -1, 0));
    assert_true(dse_link_lost(&link, 0, -1));
    for (int k = 0; k < 6; k++) {
        for (int r = 0; r < 3; r++) {
            assert_int_equal(dse_link_lost(&link, k, r), lost[k]);
        }
    }
    assert_true(dse_link_lost(&link, 5, 1)); /* before round 2 */
    assert_true(dse_link_lost(&link, 3, 2));
    assert_false(dse_link_lost(&link, 5, 2));
}

/* ---- packets under way ---- */

static void packets_arrive_when_they_are_due_and_once(void **state)
{
    (void)state;
    dse_real memory[DSE_LINE_STORAGE(3, 1)];
    struct dse_arena arena;
    struct dse_line line;
    static const int delay[] = {3, 1, DSE_LINK_LOST, 0, 7};
    static const int expected[][2] = {{0, 3}, {1, 2}, {3, 3}}; /* stamp, instant */
    dse_arena_init(&arena, memory, DSE_LINE_STORAGE(3, 1));
    assert_int_equal(dse_line_init(&line, 3, 1, &arena), DSE_OK);
    assert_int_equal(arena.used, DSE_LINE_STORAGE(3, 1));
    int seen = 0;
    for (int now = 0; now < 10; now++) {
        int64_t stamp, previous = -1;
        const dse_real *value;
        if (now < 5) {
            const dse_real sent = (dse_real)(100 + now);
            dse_line_put(&line, now, delay[now], &sent);
        }
        while ((value = dse_line_take(&line, now, &stamp)) != NULL) {
            int found = 0;
            for (int k = 0; k < 3; k++) {
                found += expected[k][0] == stamp && expected[k][1] == now;
            }
            assert_int_equal(found, 1);
            assert_true(*value >= 100 + (dse_real)stamp && *value <= 100 + (dse_real)stamp);
            assert_true(stamp > previous); /* the oldest first */
            previous = stamp;
            seen++;
        }
    }
    assert_int_equal(seen, 3);
    struct dse_line none;
    assert_int_equal(dse_line_init(&none, 3, 1, &arena), DSE_ESTORAGE);
    assert_int_equal(dse_line_init(&none, -1, 1, &arena), DSE_EINVAL);
}

/* ---- mailbox ---- */

static const int sizes[2] = {2, 3};

static void open_mailbox(struct dse_mailbox *mailbox, int D, dse_real *memory)
{
    struct dse_arena arena;
    dse_arena_init(&arena, memory, DSE_MAILBOX_STORAGE(2, 5, D));
    assert_int_equal(dse_mailbox_init(mailbox, 2, sizes, D, &arena), DSE_OK);
    assert_int_equal(arena.used, DSE_MAILBOX_STORAGE(2, 5, D));
}

static void mailbox_sorts_by_stamp_whatever_the_order(void **state)
{
    (void)state;
    dse_real memory[DSE_MAILBOX_STORAGE(2, 5, 2)];
    struct dse_mailbox mailbox;
    const dse_real a[3] = {1, 2, 3}, b[3] = {4, 5, 6}, c[3] = {7, 8, 9};
    int64_t oldest = -1;
    open_mailbox(&mailbox, 2, memory);
    dse_mailbox_advance(&mailbox, 10);
    assert_false(dse_mailbox_read(&mailbox, &oldest));
    assert_int_equal(dse_mailbox_age(&mailbox, 1), -1);

    assert_int_equal(dse_mailbox_put(&mailbox, 1, 9, a), DSE_MAILBOX_NEWEST);
    assert_int_equal(dse_mailbox_put(&mailbox, 1, 8, b), DSE_MAILBOX_LATE);
    assert_int_equal(dse_mailbox_put(&mailbox, 0, 10, c), DSE_MAILBOX_NEWEST);
    assert_int_equal(dse_mailbox_put(&mailbox, 1, 8, c), DSE_MAILBOX_DUPLICATE);
    assert_int_equal(dse_mailbox_put(&mailbox, 1, 7, c), DSE_MAILBOX_TOO_LATE);
    assert_int_equal(dse_mailbox_put(&mailbox, 1, 11, c), DSE_MAILBOX_REFUSED);
    assert_int_equal(dse_mailbox_put(&mailbox, 2, 9, c), DSE_MAILBOX_REFUSED);
    assert_int_equal(dse_mailbox_put(&mailbox, 1, -1, c), DSE_MAILBOX_REFUSED);

    assert_memory_equal(dse_mailbox_get(&mailbox, 1, 9), a, sizeof a);
    assert_memory_equal(dse_mailbox_get(&mailbox, 1, 8), b, sizeof b);
    assert_memory_equal(dse_mailbox_get(&mailbox, 0, 10), c, 2 * sizeof *c);
    assert_null(dse_mailbox_get(&mailbox, 0, 9));
    assert_null(dse_mailbox_get(&mailbox, 1, 7));
    assert_ptr_equal(dse_mailbox_news(&mailbox, 1), dse_mailbox_get(&mailbox, 1, 9));
    assert_int_equal(dse_mailbox_age(&mailbox, 1), 1);
    assert_true(dse_mailbox_read(&mailbox, &oldest));
    assert_int_equal(oldest, 8);
    assert_null(dse_mailbox_news(&mailbox, 1));
    assert_false(dse_mailbox_read(&mailbox, &oldest));

    /* what is behind the newest is kept, but is no news of the present */
    assert_int_equal(dse_mailbox_put(&mailbox, 0, 8, b), DSE_MAILBOX_LATE);
    assert_null(dse_mailbox_news(&mailbox, 0));
    assert_int_equal(mailbox.kept, 2);
    assert_int_equal(mailbox.late, 2);
    assert_int_equal(mailbox.duplicates, 1);
    assert_int_equal(mailbox.too_late, 1);
    assert_int_equal(mailbox.refused, 3);
}

static void mailbox_forgets_what_is_older_than_D_and_remembers_the_age(void **state)
{
    (void)state;
    dse_real memory[DSE_MAILBOX_STORAGE(2, 5, 2)];
    struct dse_mailbox mailbox;
    const dse_real a[3] = {1, 2, 3};
    int64_t oldest;
    open_mailbox(&mailbox, 2, memory);
    dse_mailbox_put(&mailbox, 1, 0, a);
    for (int now = 1; now <= 2; now++) {
        dse_mailbox_advance(&mailbox, now);
        assert_non_null(dse_mailbox_get(&mailbox, 1, 0));
    }
    dse_mailbox_advance(&mailbox, 3);
    assert_null(dse_mailbox_get(&mailbox, 1, 0));
    assert_null(dse_mailbox_get(&mailbox, 1, 3)); /* in the same slot */
    assert_int_equal(dse_mailbox_age(&mailbox, 1), 3);
    assert_true(dse_mailbox_read(&mailbox, &oldest));
    assert_int_equal(oldest, 1); /* the first that could still be there */
    dse_mailbox_put(&mailbox, 1, 3, a);
    dse_mailbox_advance(&mailbox, 1000); /* far more than D at once */
    for (int s = 995; s <= 1000; s++) {
        assert_null(dse_mailbox_get(&mailbox, 1, s));
    }
    assert_int_equal(dse_mailbox_age(&mailbox, 1), 997);
    dse_mailbox_clear(&mailbox, 5);
    assert_int_equal(dse_mailbox_age(&mailbox, 1), -1);
    assert_int_equal(dse_mailbox_put(&mailbox, 1, 5, a), DSE_MAILBOX_NEWEST);
}

/* AHG-49: the bound, for many networks; and it is sharp: some sequence reaches it. */
static void age_never_exceeds_the_largest_delay_plus_the_longest_loss(void **state)
{
    (void)state;
    for (int D = 0; D <= MAX_D; D++) {
        for (int T_m = 0; T_m <= 3; T_m++) {
            int largest = 0;
            for (uint64_t seed = 0; seed < 20; seed++) {
                const struct dse_link_config config = lossy(D, T_m, 0.6, seed);
                struct dse_link link = link_of(&config, 0, 1);
                dse_real memory[DSE_MAILBOX_STORAGE(2, 5, MAX_D)];
                dse_real way[DSE_LINE_STORAGE(MAX_D, 3)];
                struct dse_arena arena;
                struct dse_mailbox mailbox;
                struct dse_line line;
                open_mailbox(&mailbox, D, memory);
                dse_arena_init(&arena, way, DSE_LINE_STORAGE(MAX_D, 3));
                assert_int_equal(dse_line_init(&line, D, 3, &arena), DSE_OK);
                for (int now = 0; now < STAMPS; now++) {
                    const dse_real value[3] = {(dse_real)now, 0, 0};
                    const dse_real *arrived;
                    int64_t stamp;
                    dse_mailbox_advance(&mailbox, now);
                    dse_line_put(&line, now, dse_link_fate(&link, now), value);
                    while ((arrived = dse_line_take(&line, now, &stamp)) != NULL) {
                        assert_true(dse_mailbox_put(&mailbox, 1, stamp, arrived) <=
                                    DSE_MAILBOX_LATE);
                    }
                    const int age = dse_mailbox_age(&mailbox, 1);
                    assert_in_range(age, 0, DSE_LINK_MAX_AGE(D, T_m));
                    largest = age > largest ? age : largest;
                }
            }
            assert_true(largest >= DSE_LINK_MAX_AGE(D, T_m) - (D > 3));
        }
    }
}

/* Fig 4.2: stamp k - D - T_m is held, T_m are lost, the next one takes D. */
static void worst_case_of_the_age_bound_is_attained(void **state)
{
    (void)state;
    enum { D = 3, T_M = 2 };
    static const int fate[] = {0, DSE_LINK_LOST, DSE_LINK_LOST, 3, 3, 3};
    dse_real memory[DSE_MAILBOX_STORAGE(2, 5, D)], way[DSE_LINE_STORAGE(D, 2)];
    struct dse_arena arena;
    struct dse_mailbox mailbox;
    struct dse_line line;
    open_mailbox(&mailbox, D, memory);
    dse_arena_init(&arena, way, DSE_LINE_STORAGE(D, 2));
    assert_int_equal(dse_line_init(&line, D, 2, &arena), DSE_OK);
    for (int now = 0; now <= 6; now++) {
        const dse_real value[2] = {0, 0};
        const dse_real *arrived;
        int64_t stamp;
        dse_mailbox_advance(&mailbox, now);
        if (now < 6) {
            dse_line_put(&line, now, fate[now], value);
        }
        while ((arrived = dse_line_take(&line, now, &stamp)) != NULL) {
            dse_mailbox_put(&mailbox, 0, stamp, arrived);
        }
        assert_int_equal(dse_mailbox_age(&mailbox, 0), now <= D + T_M ? now : D);
    }
}

/* ---- triggers ---- */

static struct dse_trigger trigger_of(const struct dse_trigger_config *config, dse_real *memory)
{
    struct dse_arena arena;
    struct dse_trigger trigger;
    dse_arena_init(&arena, memory, DSE_TRIGGER_STORAGE(2));
    assert_int_equal(dse_trigger_init(&trigger, config, 2, &arena), DSE_OK);
    return trigger;
}

static void trigger_fires_when_the_state_has_moved_by_the_threshold(void **state)
{
    (void)state;
    dse_real memory[2];
    const struct dse_trigger_config config = {.threshold = 5};
    struct dse_trigger trigger = trigger_of(&config, memory);
    const dse_real start[2] = {10, 20}, less[2] = {13, DSE_REAL(23.9)}, moved[2] = {13, 24};
    assert_true(dse_trigger_fires(&trigger, start)); /* never sent */
    dse_trigger_sent(&trigger, start);
    assert_false(dse_trigger_fires(&trigger, start));
    assert_false(dse_trigger_fires(&trigger, less));
    assert_true(dse_trigger_fires(&trigger, moved)); /* exactly the threshold */
    dse_trigger_sent(&trigger, moved);
    assert_false(dse_trigger_fires(&trigger, less)); /* against the last sent, not the first */
    const dse_real wrong[2] = {(dse_real)NAN, 24};
    assert_true(dse_trigger_fires(&trigger, wrong));
}

static void relative_trigger_weighs_moves_by_the_last_sent_value(void **state)
{
    (void)state;
    dse_real memory[2];
    static const dse_real H[2] = {200, 1};
    const struct dse_trigger_config config = {
        .norm = DSE_TRIGGER_RELATIVE, .threshold = DSE_REAL(0.5), .weights = H};
    struct dse_trigger trigger = trigger_of(&config, memory);
    const dse_real start[2] = {400, 2}, warm[2] = {401, 2}, warmer[2] = {DSE_REAL(400.9), 2},
                   rich[2] = {400, 3}, zero[2] = {400, 0};
    dse_trigger_sent(&trigger, start);
    assert_true(dse_trigger_fires(&trigger, warm)); /* 200 / 400 */
    assert_false(dse_trigger_fires(&trigger, warmer));
    assert_true(dse_trigger_fires(&trigger, rich)); /* 1 / 2 */
    dse_trigger_sent(&trigger, zero);
    assert_false(dse_trigger_fires(&trigger, zero)); /* 0/0 is no move */
    assert_true(dse_trigger_fires(&trigger, rich));  /* 3/0 is */
}

static void trigger_without_threshold_always_fires_and_nonsense_is_refused(void **state)
{
    (void)state;
    dse_real memory[2];
    const struct dse_trigger_config always = {0};
    struct dse_trigger trigger = trigger_of(&always, memory);
    const dse_real value[2] = {1, 2}, negative[2] = {1, -1};
    dse_trigger_sent(&trigger, value);
    assert_true(dse_trigger_fires(&trigger, value));
    struct dse_arena arena;
    dse_arena_init(&arena, memory, 2);
    struct dse_trigger_config config = {.threshold = -1};
    assert_int_equal(dse_trigger_init(&trigger, &config, 2, &arena), DSE_EINVAL);
    config = (struct dse_trigger_config){.threshold = (dse_real)NAN};
    assert_int_equal(dse_trigger_init(&trigger, &config, 2, &arena), DSE_EINVAL);
    config = (struct dse_trigger_config){.weights = negative};
    assert_int_equal(dse_trigger_init(&trigger, &config, 2, &arena), DSE_EINVAL);
    config = (struct dse_trigger_config){.norm = (enum dse_trigger_norm)2};
    assert_int_equal(dse_trigger_init(&trigger, &config, 2, &arena), DSE_EINVAL);
    config = (struct dse_trigger_config){.threshold = 1};
    assert_int_equal(dse_trigger_init(&trigger, &config, 3, &arena), DSE_ESTORAGE);
}

static void sequence_numbers_tell_silence_from_loss_across_the_wrap(void **state)
{
    (void)state;
    assert_int_equal(dse_link_unheard(3, 3), 0); /* nothing new was sent */
    assert_int_equal(dse_link_unheard(3, 4), 1);
    assert_int_equal(dse_link_unheard(3, 7), 4);
    const int last = DSE_LINK_NUMBERS - 1;
    assert_int_equal(dse_link_next_number(last), 0);
    assert_int_equal(dse_link_unheard(last, 0), 1);
    assert_int_equal(dse_link_unheard(last, 2), 3);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(delays_and_runs_of_losses_stay_within_their_bounds),
        cmocka_unit_test(losses_and_delays_come_as_often_as_configured),
        cmocka_unit_test(fate_depends_on_seed_pair_and_stamp_only),
        cmocka_unit_test(recorded_network_is_replayed),
        cmocka_unit_test(impossible_networks_are_refused),
        cmocka_unit_test(nothing_arrives_during_an_outage_and_all_else_is_as_without),
        cmocka_unit_test(each_round_has_a_loss_of_its_own_that_depends_on_no_other),
        cmocka_unit_test(losses_in_a_row_stay_within_their_bound_over_rounds_and_samples),
        cmocka_unit_test(rounds_follow_outages_and_recorded_networks_and_never_go_back),
        cmocka_unit_test(packets_arrive_when_they_are_due_and_once),
        cmocka_unit_test(mailbox_sorts_by_stamp_whatever_the_order),
        cmocka_unit_test(mailbox_forgets_what_is_older_than_D_and_remembers_the_age),
        cmocka_unit_test(age_never_exceeds_the_largest_delay_plus_the_longest_loss),
        cmocka_unit_test(worst_case_of_the_age_bound_is_attained),
        cmocka_unit_test(trigger_fires_when_the_state_has_moved_by_the_threshold),
        cmocka_unit_test(relative_trigger_weighs_moves_by_the_last_sent_value),
        cmocka_unit_test(trigger_without_threshold_always_fires_and_nonsense_is_refused),
        cmocka_unit_test(sequence_numbers_tell_silence_from_loss_across_the_wrap),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
