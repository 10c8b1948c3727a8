/* Random numbers: published and independently computed sequences, moments, independent streams. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "dse/random.h"

#define DRAWS 200000

/* First outputs for the state {1, 2, 3, 4}, as published with other implementations. */
static void bits_are_those_of_xoshiro256starstar(void **state)
{
    (void)state;
    static const uint64_t expected[] = {
        11520,
        0,
        1509978240,
        UINT64_C(1215971899390074240),
        UINT64_C(1216172134540287360),
        UINT64_C(607988272756665600),
    };
    struct dse_random random = {{1, 2, 3, 4}};
    for (int i = 0; i < 6; i++)
        assert_true(dse_random_bits(&random) == expected[i]);
}

/* Computed by another implementation (arbitrary-precision integers). */
static void seed_and_stream_determine_the_sequence(void **state)
{
    (void)state;
    static const struct {
        uint64_t seed, stream, expected[3];
    } cases[] = {
        {0,
         0,
         {UINT64_C(0x8c4986f3f0e565d5), UINT64_C(0xf4547fdf5c2f56b6),
          UINT64_C(0x6a9e0d6a14f022fb)}},
        {42,
         0,
         {UINT64_C(0xc986fd807e5b8ab5), UINT64_C(0xe071ea15f19664d1),
          UINT64_C(0x728624137f1e7291)}},
        {42,
         1,
         {UINT64_C(0x4180ab06d19cb0c9), UINT64_C(0x1ef53ab21c4c82ef),
          UINT64_C(0x47b3a4edc8240893)}},
        {UINT64_MAX,
         7,
         {UINT64_C(0x0680f10de3c47bbf), UINT64_C(0x3f47253a27a3897f),
          UINT64_C(0x0f6b6f3edd58d7a0)}},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct dse_random random;
        dse_random_init(&random, cases[i].seed, cases[i].stream);
        for (int k = 0; k < 3; k++)
            assert_true(dse_random_bits(&random) == cases[i].expected[k]);
    }
}

/* sqrt(-2 log a) cos(2 pi b) of the same bits, computed with 60 digits. */
static void normal_numbers_are_box_and_muller_s(void **state)
{
    (void)state;
    static const double expected[] = {0x1.154bf47a5876ep-2, 0x1.634c8b8b01f9dp+0,
                                      -0x1.32aa28f710f6cp-3};
    struct dse_random random;
    dse_random_init(&random, 42, 3);
    for (int i = 0; i < 3; i++)
        assert_true(fabs(dse_random_normal(&random) - expected[i]) < 4e-15);
}

static void a_normal_number_takes_two_draws(void **state)
{
    (void)state;
    struct dse_random normal, bits;
    dse_random_init(&normal, 5, 0);
    dse_random_init(&bits, 5, 0);
    for (int i = 0; i < 100; i++) {
        (void)dse_random_normal(&normal);
        (void)dse_random_bits(&bits);
        (void)dse_random_bits(&bits);
        assert_memory_equal(&normal, &bits, sizeof bits);
    }
}

/* Mean 1/2, variance 1/12, each within five standard errors; every tenth of [0, 1) equally full. */
static void uniform_numbers_fill_the_unit_interval(void **state)
{
    (void)state;
    struct dse_random random;
    dse_random_init(&random, 7, 0);
    double sum = 0, squares = 0;
    int tenths[10] = {0};
    for (int i = 0; i < DRAWS; i++) {
        double u = dse_random_uniform(&random);
        assert_true(u >= 0 && u < 1);
        sum += u - 0.5;
        squares += (u - 0.5) * (u - 0.5);
        tenths[(int)(10 * u)]++;
    }
    assert_true(fabs(sum / DRAWS) < 5 * sqrt(1.0 / 12 / DRAWS));
    assert_true(fabs(squares / DRAWS - 1.0 / 12) < 5 * sqrt(1.0 / 180 / DRAWS));
    for (int i = 0; i < 10; i++)
        assert_true(fabs(tenths[i] - DRAWS / 10.0) < 5 * sqrt(DRAWS * 0.09));
}

/* Moments 0, 1, 0, 3 and the tails beyond 1, 2, 3 and 4, each within five standard errors. */
static void normal_numbers_have_moments_and_tails_of_the_normal_law(void **state)
{
    (void)state;
    struct dse_random random;
    dse_random_init(&random, 8, 0);
    double moments[5] = {0};
    int beyond[5] = {0};
    for (int i = 0; i < DRAWS; i++) {
        double z = dse_random_normal(&random), power = 1;
        for (int k = 1; k <= 4; k++) {
            power *= z;
            moments[k] += power / DRAWS;
            beyond[k] += z > k;
        }
    }
    static const double expected[5] = {1, 0, 1, 0, 3}, variance[5] = {0, 1, 2, 15, 96};
    for (int k = 1; k <= 4; k++) {
        assert_true(fabs(moments[k] - expected[k]) < 5 * sqrt(variance[k] / DRAWS));
        double tail = 0.5 * erfc(k / sqrt(2.0));
        assert_true(fabs(beyond[k] - DRAWS * tail) < 5 * sqrt(DRAWS * tail));
    }
}

/* Correlation of neighbouring seeds, neighbouring streams and swapped pairs: zero within five
 * standard errors. */
static void streams_are_uncorrelated(void **state)
{
    (void)state;
    static const uint64_t pairs[][4] = {{1, 0, 1, 1}, {1, 0, 2, 0}, {1, 2, 2, 1},
                                        {0, 0, 0, 1}, {3, 9, 4, 8}, {0, 1, 1, 0}};
    for (size_t p = 0; p < sizeof pairs / sizeof pairs[0]; p++) {
        struct dse_random a, b;
        dse_random_init(&a, pairs[p][0], pairs[p][1]);
        dse_random_init(&b, pairs[p][2], pairs[p][3]);
        double correlation = 0;
        for (int i = 0; i < 20000; i++)
            correlation += dse_random_normal(&a) * dse_random_normal(&b) / 20000;
        assert_true(fabs(correlation) < 5 / sqrt(20000.0));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(bits_are_those_of_xoshiro256starstar),
        cmocka_unit_test(seed_and_stream_determine_the_sequence),
        cmocka_unit_test(normal_numbers_are_box_and_muller_s),
        cmocka_unit_test(a_normal_number_takes_two_draws),
        cmocka_unit_test(uniform_numbers_fill_the_unit_interval),
        cmocka_unit_test(normal_numbers_have_moments_and_tails_of_the_normal_law),
        cmocka_unit_test(streams_are_uncorrelated),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
