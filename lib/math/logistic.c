/* tanh and the logistic sigmoid from exp as a double-double, so that sums and quotients of it cost
 * no accuracy. */
#include "dse/math.h"
#include "math_internal.h"

#define SATURATION    40.0    /* exp(-40) < 2^-57: lost beside 1 */
#define TANH_ONE      22.0    /* 1 - tanh(22) < 2^-62 */
#define TANH_SERIES   0x1p-4  /* below: Taylor's series */
#define TANH_IDENTITY 0x1p-28 /* below: x^3/3 < ulp(x)/4 */

/* exp(x) = hi + lo for |x| <= 45, where scaling is exact. */
static struct dse_dd exp_dd(double x)
{
    int k;
    struct dse_dd m = dse_exp_kernel((struct dse_dd){x, 0}, &k);
    double scale = dse_power_of_two(k);
    return (struct dse_dd){m.hi * scale, m.lo * scale};
}

/* 1 + e for |e| <= 1. */
static struct dse_dd one_plus(struct dse_dd e)
{
    struct dse_dd sum = dse_fast_two_sum(1, e.hi);
    return dse_fast_two_sum(sum.hi, sum.lo + e.lo);
}

/* tanh(x) = x - x^3/3 + 2 x^5/15 - ... for |x| < 1/16; the next term, x^15 / 687, is below
 * 2^-65 x. */
static double tanh_series(double x)
{
    double z = x * x;
    double tail =
        -1.0 / 3 +
        z * (2.0 / 15 + z * (-17.0 / 315 +
                             z * (62.0 / 2835 + z * (-1382.0 / 155925 + z * (21844.0 / 6081075)))));
    return x + x * z * tail;
}

static double tanh_double(double x)
{
    if (x != x)
        return dse_nan();
    double size = dse_abs_double(x);
    if (size < TANH_IDENTITY)
        return x;
    if (size < TANH_SERIES)
        return tanh_series(x);
    if (size > TANH_ONE)
        return dse_copysign_double(1, x);
    /* tanh|x| = (1 - e) / (1 + e), e = exp(-2 |x|) */
    struct dse_dd e = exp_dd(-2 * size);
    double quotient = dse_dd_divide(one_plus((struct dse_dd){-e.hi, -e.lo}), one_plus(e));
    return dse_copysign_double(quotient, x);
}

static double sigmoid_double(double s)
{
    if (s != s)
        return dse_nan();
    if (s > SATURATION)
        return 1;
    if (s < -SATURATION)
        return dse_exp_double(s); /* e / (1 + e) with e lost beside 1 */
    /* e = exp(-|s|) <= 1: 1 / (1 + e) on the right, e / (1 + e) on the left */
    struct dse_dd e = exp_dd(-dse_abs_double(s));
    struct dse_dd numerator = s >= 0 ? (struct dse_dd){1, 0} : e;
    return dse_dd_divide(numerator, one_plus(e));
}

dse_real dse_tanh(dse_real x)
{
    return (dse_real)tanh_double((double)x);
}

dse_real dse_sigmoid(dse_real s)
{
    return (dse_real)sigmoid_double((double)s);
}
