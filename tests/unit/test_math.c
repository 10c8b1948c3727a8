/* Elementary functions against a reference of 113 bits: error below 1 ulp, special cases, and one
 * checksum that stands for the same bits on every machine. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "../../lib/math/math_internal.h"
#include "dse/math.h"
#include "dse/random.h"
#include "math_bits.h"

/* The reference: long double where it has 113 bits, else libquadmath, whose header is not in every
 * compiler's path and so is not included. */
#if LDBL_MANT_DIG == 113
typedef long double wide;
#define WIDE(name) name##l
#else
typedef __float128 wide;
#define WIDE(name) name##q
wide expq(wide x);
wide logq(wide x);
wide powq(wide x, wide y);
wide sinq(wide x);
wide cosq(wide x);
wide sqrtq(wide x);
wide tanhq(wide x);
wide frexpq(wide x, int *exponent);
wide ldexpq(wide x, int exponent);
#endif

#ifdef DSE_REAL_IS_float
#define REAL_DIGITS       FLT_MANT_DIG
#define REAL_MAX_EXPONENT FLT_MAX_EXP
#define REAL_MIN_EXPONENT FLT_MIN_EXP
#define TRUE_MIN          0x1p-149f
typedef uint32_t real_bits;
#else
#define REAL_DIGITS       DBL_MANT_DIG
#define REAL_MAX_EXPONENT DBL_MAX_EXP
#define REAL_MIN_EXPONENT DBL_MIN_EXP
#define TRUE_MIN          0x1p-1074
typedef uint64_t real_bits;
#endif

#define ARGUMENTS 20000 /* per range */

static const dse_real infinity = (dse_real)INFINITY;
static const dse_real not_a_number = (dse_real)NAN;

static real_bits bits_of(dse_real x)
{
    real_bits bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

static dse_real real_of(real_bits bits)
{
    dse_real x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

/* |got - exact| in units of the last place of a dse_real of exact's size. Infinity counts as the
 * number that would follow the largest one. */
static double error_in_ulp(dse_real got, wide exact)
{
    if (got != got)
        return (double)INFINITY;
    const wide beyond = WIDE(ldexp)(1, REAL_MAX_EXPONENT);
    wide value = dse_is_finite(got) ? (wide)got : got > 0 ? beyond : -beyond;
    if (exact > beyond)
        exact = beyond;
    if (exact < -beyond)
        exact = -beyond;
    int exponent;
    (void)WIDE(frexp)(exact, &exponent); /* |exact| in [1/2, 1) 2^exponent */
    if (exponent < REAL_MIN_EXPONENT || exact == 0)
        exponent = REAL_MIN_EXPONENT;
    if (exponent > REAL_MAX_EXPONENT)
        exponent = REAL_MAX_EXPONENT;
    wide error = value > exact ? value - exact : exact - value;
    return (double)WIDE(ldexp)(error, REAL_DIGITS - exponent);
}

static wide sigmoid_wide(wide s)
{
    return 1 / (1 + WIDE(exp)(-s));
}

/* Uniform on [low, high]. */
static dse_real uniform(struct dse_random *random, double low, double high)
{
    return (dse_real)(low + (high - low) * dse_random_uniform(random));
}

/* Any finite number, all exponents equally often. */
static dse_real any_finite(struct dse_random *random)
{
    for (;;) {
        dse_real x = real_of((real_bits)dse_random_bits(random));
        if (dse_is_finite(x))
            return x;
    }
}

struct claim {
    const char *name;
    dse_real (*function)(dse_real);
    wide (*exact)(wide);
    double limit; /* ulp */
    struct {
        double low, high; /* both 0: any finite number; positive ones only when positive is set */
    } ranges[6];
    int n_ranges;
    bool positive;
};

static const struct claim claims[] = {
    {"exp",
     dse_exp,
     WIDE(exp),
     0.52,
     {{-1, 1}, {-80, 80}, {-709, 710}, {-746, -707}, {0, 0}},
     5,
     0},
    {"log", dse_log, WIDE(log), 0.52, {{0.99, 1.01}, {0.5, 2}, {0, 100}, {0, 0}}, 4, true},
    {"sin", dse_sin, WIDE(sin), 0.82, {{-1, 1}, {-10, 10}, {-1e3, 1e3}, {-6e5, 6e5}, {0, 0}}, 5, 0},
    {"cos", dse_cos, WIDE(cos), 0.82, {{-1, 1}, {-10, 10}, {-1e3, 1e3}, {-6e5, 6e5}, {0, 0}}, 5, 0},
    {"sqrt", dse_sqrt, WIDE(sqrt), 0.5001, {{0, 4}, {0, 0}}, 2, true},
    {"tanh", dse_tanh, WIDE(tanh), 0.60, {{-0.07, 0.07}, {-1, 1}, {-23, 23}, {0, 0}}, 4, 0},
    {"sigmoid",
     dse_sigmoid,
     sigmoid_wide,
     0.60,
     {{-1, 1}, {-45, 45}, {-709, 40}, {-746, -707}, {0, 0}},
     5,
     0},
};

static void error_is_below_one_ulp(void **state)
{
    (void)state;
    for (size_t c = 0; c < sizeof claims / sizeof claims[0]; c++) {
        const struct claim *claim = &claims[c];
        double worst = 0;
        dse_real worst_at = 0;
        struct dse_random random;
        dse_random_init(&random, 1, c);
        for (int r = 0; r < claim->n_ranges; r++) {
            double low = claim->ranges[r].low, high = claim->ranges[r].high;
            for (int i = 0; i < ARGUMENTS; i++) {
                dse_real x = low == high ? any_finite(&random) : uniform(&random, low, high);
                if (claim->positive)
                    x = dse_abs(x);
                if (claim->positive && x == 0)
                    continue;
                double error = error_in_ulp(claim->function(x), claim->exact((wide)x));
                if (!(error <= worst)) {
                    worst = error;
                    worst_at = x;
                }
            }
        }
        printf("%-8s at most %.4f ulp, at %a\n", claim->name, worst, (double)worst_at);
        assert_true(worst < claim->limit);
    }
}

static void error_of_pow_is_below_one_ulp(void **state)
{
    (void)state;
    static const double ranges[][4] = {
        /* x from, to, y from, to */
        {0, 10, -10, 10},       {0.99, 1.01, -7e4, 7e4}, {0.9999999, 1.0000001, -7e9, 7e9},
        {1e-30, 1e-20, -9, 16}, {1e9, 1e10, -34, 31},    {0.5, 2, -1074, 1023},
    };
    struct dse_random random;
    dse_random_init(&random, 2, 0);
    double worst = 0;
    for (size_t r = 0; r < sizeof ranges / sizeof ranges[0]; r++) {
        for (int i = 0; i < ARGUMENTS; i++) {
            dse_real x = uniform(&random, ranges[r][0], ranges[r][1]);
            dse_real y = uniform(&random, ranges[r][2], ranges[r][3]);
            double error = error_in_ulp(dse_pow(x, y), WIDE(pow)((wide)x, (wide)y));
            worst = error > worst ? error : worst;
        }
    }
    for (int i = 0; i < ARGUMENTS; i++) {
        dse_real x = dse_abs(any_finite(&random)), y = any_finite(&random);
        double error = error_in_ulp(dse_pow(x, y), WIDE(pow)((wide)x, (wide)y));
        worst = error > worst ? error : worst;
    }
    printf("pow      at most %.4f ulp\n", worst);
    assert_true(worst < 0.55);
}

/* Arguments that are the nearest double to a multiple of pi/2, among them the hardest one known
 * (6381956970095103 2^797), and the largest double. */
static void trigonometric_reduction_survives_cancellation(void **state)
{
    (void)state;
    static const double hard[] = {
        0x1.6ac5b262ca1ffp+849,
        0x1.921fb54442d18p+0,
        0x1.921fb54442d18p+1,
        0x1.2d97c7f3321d2p+2,
        0x1.921fb54442d18p+20,
        0x1.921fb54442d18p+9,
        0x1p19,
        0x1.fffffffffffffp18,
        -0x1.6ac5b262ca1ffp+849,
        DBL_MAX,
        -0x1p1023,
        0x1.0p-1022,
    };
    for (size_t i = 0; i < sizeof hard / sizeof hard[0]; i++) {
        dse_real x = (dse_real)hard[i];
        if (!dse_is_finite(x))
            continue;
        assert_true(error_in_ulp(dse_sin(x), WIDE(sin)((wide)x)) < 0.82);
        assert_true(error_in_ulp(dse_cos(x), WIDE(cos)((wide)x)) < 0.82);
    }
    for (int n = 1; n < 2000; n++) {
        dse_real x = (dse_real)(n * 1.5707963267948966);
        assert_true(error_in_ulp(dse_sin(x), WIDE(sin)((wide)x)) < 0.82);
        assert_true(error_in_ulp(dse_cos(x), WIDE(cos)((wide)x)) < 0.82);
    }
}

struct special {
    dse_real x;
    dse_real expected;
};

static void assert_same_bits(dse_real got, dse_real expected)
{
    if (bits_of(got) != bits_of(expected))
        fail_msg("%a where %a was expected", (double)got, (double)expected);
}

static void check_specials(dse_real (*function)(dse_real), const struct special *specials, size_t n)
{
    for (size_t i = 0; i < n; i++)
        assert_same_bits(function(specials[i].x), specials[i].expected);
    /* one NaN comes out, whatever goes in */
    dse_real nan = (dse_real)dse_nan();
    assert_same_bits(function(nan), nan);
    assert_same_bits(function(-nan), nan);
}

#define CHECK_SPECIALS(function, ...)                                                              \
    do {                                                                                           \
        const struct special specials[] = {__VA_ARGS__};                                           \
        check_specials(function, specials, sizeof specials / sizeof specials[0]);                  \
    } while (0)

static void special_cases_follow_annex_f(void **state)
{
    (void)state;
    const dse_real inf = infinity, nan = (dse_real)dse_nan(), tiny = TRUE_MIN, zero = 0;
    CHECK_SPECIALS(dse_exp, {zero, 1}, {-zero, 1}, {inf, inf}, {-inf, 0}, {DSE_REAL_MAX, inf},
                   {-DSE_REAL_MAX, 0}, {tiny, 1}, {-tiny, 1});
    CHECK_SPECIALS(dse_log, {zero, -inf}, {-zero, -inf}, {1, 0}, {-1, nan}, {-tiny, nan},
                   {-inf, nan}, {inf, inf});
    CHECK_SPECIALS(dse_sin, {zero, 0}, {-zero, -zero}, {inf, nan}, {-inf, nan}, {tiny, tiny},
                   {-tiny, -tiny});
    CHECK_SPECIALS(dse_cos, {zero, 1}, {-zero, 1}, {inf, nan}, {-inf, nan}, {tiny, 1});
    CHECK_SPECIALS(dse_sqrt, {zero, 0}, {-zero, -zero}, {-1, nan}, {-tiny, nan}, {inf, inf},
                   {-inf, nan}, {4, 2}, {DSE_REAL(0x1p-148), DSE_REAL(0x1p-74)});
    CHECK_SPECIALS(dse_tanh, {zero, 0}, {-zero, -zero}, {inf, 1}, {-inf, -1}, {tiny, tiny},
                   {-tiny, -tiny}, {DSE_REAL_MAX, 1});
    CHECK_SPECIALS(dse_sigmoid, {zero, 0.5f}, {-zero, 0.5f}, {inf, 1}, {-inf, 0}, {DSE_REAL_MAX, 1},
                   {-DSE_REAL_MAX, 0});
}

static void special_cases_of_pow_follow_annex_f(void **state)
{
    (void)state;
    const dse_real inf = infinity, nan = (dse_real)dse_nan(), zero = 0, half = 0.5f;
    const struct {
        dse_real x, y, expected;
    } cases[] = {
        {zero, 3, 0},
        {-zero, 3, -zero},
        {zero, 2, 0},
        {-zero, 2, 0},
        {zero, -3, inf},
        {-zero, -3, -inf},
        {-zero, -2, inf},
        {zero, half, 0},
        {-zero, half, 0},
        {-zero, -half, inf},
        {-zero, inf, 0},
        {zero, -inf, inf},
        {-1, inf, 1},
        {-1, -inf, 1},
        {1, nan, 1},
        {1, inf, 1},
        {nan, 0, 1},
        {nan, -zero, 1},
        {-7, 0, 1},
        {inf, 0, 1},
        {-2, half, nan},
        {-2, -half, nan},
        {half, -inf, inf},
        {-half, -inf, inf},
        {2, -inf, 0},
        {-2, -inf, 0},
        {half, inf, 0},
        {-half, inf, 0},
        {2, inf, inf},
        {-2, inf, inf},
        {-inf, -3, -zero},
        {-inf, -2, 0},
        {-inf, -half, 0},
        {-inf, 3, -inf},
        {-inf, 2, inf},
        {-inf, half, inf},
        {inf, -1, 0},
        {inf, 1, inf},
        {nan, 1, nan},
        {2, nan, nan},
        {-nan, 2, nan},
        {-2, 3, -8},
        {-2, 4, 16},
        {-2, -1, -half},
        {3, 2, 9},
        {9, half, 3},
        {10, 3, 1000},
        {-5, 5, -3125},
        {2, -1060, (dse_real)0x1p-1060},
        {-1, 1e30f, 1},
        {-1, 16777215, -1},
        {2, 1e30f, inf},
        {2, -1e30f, 0},
        {half, 1e30f, 0},
        {-3, 16777215, -inf},
        {-3, -16777215, -zero},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        assert_same_bits(dse_pow(cases[i].x, cases[i].y), cases[i].expected);
}

static void square_root_by_integers_has_the_bits_of_the_instruction(void **state)
{
    (void)state;
    struct dse_random random;
    dse_random_init(&random, 3, 0);
    for (int i = 0; i < ARGUMENTS; i++) {
        double x = dse_from_bits(dse_random_bits(&random) & ~DSE_BITS_SIGN);
        if (x != x)
            continue;
        assert_true(dse_sqrt_by_integers(x) == sqrt(x));
    }
    /* next to squares and powers of two, and subnormal numbers, roundings are hardest */
    for (uint64_t i = 0; i < 3000; i++) {
        double near_square = dse_from_bits(dse_bits((double)(i * i)) + i % 3 - 1);
        assert_true(i == 0 || dse_sqrt_by_integers(near_square) == sqrt(near_square));
        double subnormal = dse_from_bits(i);
        assert_true(dse_sqrt_by_integers(subnormal) == sqrt(subnormal));
        double below_two = dse_from_bits(dse_bits(4.0) - i);
        assert_true(dse_sqrt_by_integers(below_two) == sqrt(below_two));
    }
    assert_true(dse_bits(dse_sqrt_by_integers(-0.0)) == DSE_BITS_SIGN);
    assert_true(dse_bits(dse_sqrt_by_integers(-1)) == DSE_BITS_NAN);
    assert_true(dse_sqrt_by_integers(dse_infinity()) == dse_infinity());
}

static void functions_are_monotone_across_the_seams_of_their_cases(void **state)
{
    (void)state;
    const struct {
        dse_real (*function)(dse_real);
        double seam;
    } seams[] = {{dse_tanh, 0x1p-28}, {dse_tanh, 0x1p-4}, {dse_tanh, 22},    {dse_sigmoid, 40},
                 {dse_sigmoid, -40},  {dse_sigmoid, 0},   {dse_exp, 0},      {dse_log, 1},
                 {dse_log, 0.6875},   {dse_log, 1.375},   {dse_sin, 0x1p-27}};
    for (size_t i = 0; i < sizeof seams / sizeof seams[0]; i++) {
        dse_real at = (dse_real)seams[i].seam;
        dse_real step = 4 * DSE_REAL_EPSILON * dse_max(dse_abs(at), DSE_REAL_EPSILON);
        dse_real below = seams[i].function(at - step), here = seams[i].function(at);
        assert_true(below <= here);
        assert_true(here <= seams[i].function(at + step));
    }
}

static void comparisons_do_not_hide_nan(void **state)
{
    (void)state;
    assert_true(dse_max(1, 2) == 2 && dse_max(2, 1) == 2 && dse_max(-1, -2) == -1);
    assert_true(dse_min(1, 2) == 1 && dse_min(2, 1) == 1 && dse_min(-1, -2) == -2);
    assert_false(dse_is_finite(dse_max(1, not_a_number)));
    assert_false(dse_is_finite(dse_max(not_a_number, 1)));
    assert_false(dse_is_finite(dse_min(1, not_a_number)));
    assert_false(dse_is_finite(dse_min(not_a_number, 1)));
    const dse_real zero = 0;
    assert_same_bits(dse_abs(-zero), zero);
    assert_true(dse_abs(-3) == 3 && dse_abs(3) == 3);
}

static void finite_means_neither_nan_nor_infinite(void **state)
{
    (void)state;
    assert_true(dse_is_finite(DSE_REAL_MAX) && dse_is_finite(-DSE_REAL_MAX) && dse_is_finite(0));
    assert_false(dse_is_finite(infinity) || dse_is_finite(-infinity));
    assert_false(dse_is_finite(not_a_number));
    for (int bad = 0; bad < 5; bad++) {
        dse_real x[5] = {1, -2, 0, DSE_REAL_MAX, TRUE_MIN};
        assert_true(dse_all_finite(x, 5));
        x[bad] = bad % 2 == 0 ? not_a_number : -infinity;
        assert_false(dse_all_finite(x, 5));
        assert_true(dse_all_finite(x, bad));
    }
}

static void bits_are_the_same_on_every_machine(void **state)
{
    (void)state;
    uint64_t checksum = math_bits_checksum();
    printf("checksum %016llx\n", (unsigned long long)checksum);
    assert_true(checksum == MATH_BITS_EXPECTED);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(error_is_below_one_ulp),
        cmocka_unit_test(error_of_pow_is_below_one_ulp),
        cmocka_unit_test(trigonometric_reduction_survives_cancellation),
        cmocka_unit_test(special_cases_follow_annex_f),
        cmocka_unit_test(special_cases_of_pow_follow_annex_f),
        cmocka_unit_test(square_root_by_integers_has_the_bits_of_the_instruction),
        cmocka_unit_test(functions_are_monotone_across_the_seams_of_their_cases),
        cmocka_unit_test(comparisons_do_not_hide_nan),
        cmocka_unit_test(finite_means_neither_nan_nor_infinite),
        cmocka_unit_test(bits_are_the_same_on_every_machine),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
