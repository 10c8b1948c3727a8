/* Shared inside lib/math: bits of a double, double-double arithmetic, and the functions in double
 * precision whatever dse_real is (the float library rounds their results once).
 *
 * A double-double is an unevaluated sum hi + lo with |lo| <= ulp(hi)/2. Everything here relies on
 * round-to-nearest and on the compiler keeping the order of operations (-ffp-contract=off). */
#ifndef DSE_MATH_INTERNAL_H
#define DSE_MATH_INTERNAL_H

#include <float.h>
#include <stdint.h>
#include <string.h>

#if FLT_EVAL_METHOD != 0
#error "lib/math needs arithmetic in the operands' own precision (no x87)"
#endif

/* ---- bits ---- */

#define DSE_BITS_SIGN     UINT64_C(0x8000000000000000)
#define DSE_BITS_INFINITY UINT64_C(0x7ff0000000000000)
#define DSE_BITS_NAN      UINT64_C(0x7ff8000000000000)
/* Clears the low 27 of 53 significant bits; what is left, and the rest, multiply exactly. */
#define DSE_BITS_TOP_HALF UINT64_C(0xfffffffff8000000)

static inline uint64_t dse_bits(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

static inline double dse_from_bits(uint64_t bits)
{
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

static inline double dse_infinity(void)
{
    return dse_from_bits(DSE_BITS_INFINITY);
}

/* The one NaN that lib/math returns: sign and payload of a computed NaN differ between machines. */
static inline double dse_nan(void)
{
    return dse_from_bits(DSE_BITS_NAN);
}

static inline double dse_abs_double(double x)
{
    return dse_from_bits(dse_bits(x) & ~DSE_BITS_SIGN);
}

static inline double dse_copysign_double(double size, double sign)
{
    return dse_from_bits((dse_bits(size) & ~DSE_BITS_SIGN) | (dse_bits(sign) & DSE_BITS_SIGN));
}

/* 2^k for -1022 <= k <= 1023. */
static inline double dse_power_of_two(int k)
{
    return dse_from_bits((uint64_t)(k + 1023) << 52);
}

/* The nearest integer as a double, for |x| < 2^51 (adding 1.5 2^52 shifts the fraction out). */
static inline double dse_nearest_integer(double x)
{
    const double shift = 0x1.8p52;
    return (x + shift) - shift;
}

/* ---- double-double ---- */

struct dse_dd {
    double hi;
    double lo;
};

/* a + b exactly, for |a| >= |b| or a = 0 (Dekker). */
static inline struct dse_dd dse_fast_two_sum(double a, double b)
{
    double hi = a + b;
    return (struct dse_dd){hi, b - (hi - a)};
}

/* a + b exactly (Knuth). */
static inline struct dse_dd dse_two_sum(double a, double b)
{
    double hi = a + b;
    double b_part = hi - a;
    double a_part = hi - b_part;
    return (struct dse_dd){hi, (a - a_part) + (b - b_part)};
}

/* The leading 26 bits of x; the difference to x is exact. */
static inline double dse_top_half(double x)
{
    return dse_from_bits(dse_bits(x) & DSE_BITS_TOP_HALF);
}

/* a b to twice the working precision (Dekker's product, halves split by masking). */
static inline struct dse_dd dse_two_product(double a, double b)
{
    double a_top = dse_top_half(a), a_rest = a - a_top;
    double b_top = dse_top_half(b), b_rest = b - b_top;
    double hi = a * b;
    double lo = ((a_top * b_top - hi) + a_top * b_rest + a_rest * b_top) + a_rest * b_rest;
    return (struct dse_dd){hi, lo};
}

/* (a.hi + a.lo) / (b.hi + b.lo), rounded to a double; error below 0.5 ulp + 2^-50 ulp. */
static inline double dse_dd_divide(struct dse_dd a, struct dse_dd b)
{
    /* One Newton correction of the quotient: q + (a - q b) / b. */
    double q = a.hi / b.hi;
    struct dse_dd qb = dse_two_product(q, b.hi);
    double remainder = ((a.hi - qb.hi) - qb.lo) + (a.lo - q * b.lo);
    return q + remainder / b.hi;
}

/* (x.hi + x.lo) 2^k for 1/2 < x.hi < 2 and |k| <= 1100, rounded once, to infinity and to subnormal
 * numbers as well. x.hi is x rounded to a double. */
static inline double dse_dd_scale(struct dse_dd x, int k)
{
    if (k < -1022 ||
        (k == -1022 &&
         x.hi < 1)) { /* the last place of 1 + x 2^(k+1022) is that of a subnormal result 2^1022 */
        double down = dse_power_of_two(k + 1022);
        struct dse_dd sum = dse_fast_two_sum(1, x.hi * down);
        double rounded = sum.hi + (sum.lo + x.lo * down);
        return (rounded - 1) * DBL_MIN;
    }
    int first = k / 2; /* 2^1024 has no double of its own */
    return x.hi * dse_power_of_two(first) * dse_power_of_two(k - first);
}

/* ---- kernels ---- */

/* exp(x.hi + x.lo) = (result.hi + result.lo) 2^k, relative error below 2^-59, for |x.hi| < 800.
 * 0.99 < result.hi < 2. */
struct dse_dd dse_exp_kernel(struct dse_dd x, int *k);

/* log(x) = result.hi + result.lo, relative error below 2^-65, for finite x > 0. */
struct dse_dd dse_log_kernel(double x);

/* x = n pi/2 + r, |r.hi + r.lo| <= pi/4 (and a rounding error), for finite x; returns n mod 4. */
int dse_trig_reduce(double x, struct dse_dd *r);

/* ---- the functions in double ---- */

double dse_exp_double(double x);
double dse_log_double(double x);
double dse_cos_double(double x);
double dse_sqrt_double(double x);

/* Square root by integer arithmetic, for machines without the instruction; same bits. */
double dse_sqrt_by_integers(double x);

#endif
