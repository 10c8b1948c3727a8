/* Square root, correctly rounded as IEEE 754 asks: one instruction where the machine has it, else
 * digit by digit in integers (a Cortex-M4F has no double precision). */
#include "dse/math.h"
#include "math_internal.h"

#if defined(__x86_64__) || defined(__aarch64__) || (defined(__ARM_FP) && (__ARM_FP & 8) != 0)
#define HAS_DOUBLE_SQRT 1
#else
#define HAS_DOUBLE_SQRT 0
#endif

#define DIGITS 54     /* 53 of the result and one to round with */
#define TWO_54 0x1p54 /* lifts subnormal numbers */

/* The root's digits of m in [1, 4), from the leading one down. Invariant: before digit b,
 * remainder = (m - q^2) 2^j and doubled_q = 2 q, so q + b is not too large when
 * 2 q b + b^2 <= m - q^2. */
static uint64_t root_digits(uint64_t m)
{
    uint64_t remainder = 2 * m, q = 0, doubled_q = 0;
    for (uint64_t digit = UINT64_C(1) << (DIGITS - 1); digit != 0; digit >>= 1) {
        uint64_t trial = doubled_q + digit;
        if (trial <= remainder) {
            remainder -= trial;
            doubled_q = trial + digit;
            q += digit;
        }
        remainder *= 2;
    }
    return q;
}

double dse_sqrt_by_integers(double x)
{
    if (x != x || x < 0)
        return dse_nan();
    if (x == 0 || x > DBL_MAX)
        return x;
    int exponent = 0;
    if (x < DBL_MIN) {
        x *= TWO_54;
        exponent = -54;
    }
    uint64_t bits = dse_bits(x);
    exponent += (int)(bits >> 52) - 1023;
    uint64_t m = (bits & UINT64_C(0x000fffffffffffff)) | UINT64_C(0x0010000000000000);
    if (exponent % 2 != 0) { /* m 2^exponent with an even exponent, m in [1, 4) */
        m *= 2;
        exponent--;
    }
    /* A root is never half-way between two doubles, so its 54th digit alone decides. */
    uint64_t q = root_digits(m);
    uint64_t root = (q + (q & 1)) / 2;
    return (double)root * dse_power_of_two(exponent / 2 - 52);
}

double dse_sqrt_double(double x)
{
#if HAS_DOUBLE_SQRT
    return x < 0 || x != x ? dse_nan() : __builtin_sqrt(x);
#else
    return dse_sqrt_by_integers(x);
#endif
}

/* For a float the root in double, rounded again, is the correctly rounded one (53 >= 2 24 + 2). */
dse_real dse_sqrt(dse_real x)
{
    return (dse_real)dse_sqrt_double((double)x);
}
