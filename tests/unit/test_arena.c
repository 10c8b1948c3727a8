/* The arena deals out the caller's memory and never more than that. */
#include <limits.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "dse/arena.h"

#define CAPACITY 10

static void pieces_are_adjacent_zeroed_and_disjoint(void **state)
{
    (void)state;
    dse_real memory[CAPACITY];
    for (int i = 0; i < CAPACITY; i++)
        memory[i] = 7;
    struct dse_arena arena;
    dse_arena_init(&arena, memory, CAPACITY);
    dse_real *first = dse_arena_take(&arena, 3);
    dse_real *second = dse_arena_take(&arena, 5);
    assert_ptr_equal(first, memory);
    assert_ptr_equal(second, memory + 3);
    assert_int_equal(arena.used, 8);
    for (int i = 0; i < 8; i++)
        assert_true(memory[i] == 0);
    assert_true(memory[8] == 7 && memory[9] == 7);
}

static void whole_capacity_can_be_taken_and_not_one_more(void **state)
{
    (void)state;
    dse_real memory[CAPACITY];
    struct dse_arena arena;
    dse_arena_init(&arena, memory, CAPACITY);
    assert_null(dse_arena_take(&arena, CAPACITY + 1));
    assert_int_equal(arena.used, 0);
    assert_non_null(dse_arena_take(&arena, CAPACITY));
    assert_null(dse_arena_take(&arena, 1));
    assert_int_equal(arena.used, CAPACITY);
    assert_non_null(dse_arena_take(&arena, 0));
}

static void impossible_counts_are_refused(void **state)
{
    (void)state;
    dse_real memory[CAPACITY];
    struct dse_arena arena;
    dse_arena_init(&arena, memory, CAPACITY);
    assert_non_null(dse_arena_take(&arena, 4));
    assert_null(dse_arena_take(&arena, -1));
    assert_null(dse_arena_take(&arena, INT_MIN));
    assert_null(dse_arena_take(&arena, INT_MAX));
    assert_int_equal(arena.used, 4);
}

static void an_empty_arena_has_nothing(void **state)
{
    (void)state;
    struct dse_arena arena;
    dse_arena_init(&arena, NULL, 0);
    assert_null(dse_arena_take(&arena, 1));
}

static void ints_fit_into_the_reals_reserved_for_them(void **state)
{
    (void)state;
    for (int count = 0; count < 20; count++) {
        size_t bytes = (size_t)DSE_ARENA_INTS(count) * sizeof(dse_real);
        assert_true(bytes >= (size_t)count * sizeof(int));
        assert_true(bytes < (size_t)count * sizeof(int) + sizeof(dse_real));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pieces_are_adjacent_zeroed_and_disjoint),
        cmocka_unit_test(whole_capacity_can_be_taken_and_not_one_more),
        cmocka_unit_test(impossible_counts_are_refused),
        cmocka_unit_test(an_empty_arena_has_nothing),
        cmocka_unit_test(ints_fit_into_the_reals_reserved_for_them),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
