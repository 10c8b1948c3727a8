/* x^y = exp(y log|x|) with the logarithm and the product as double-doubles; an odd integer y gives
 * the sign of x back. Exact cases (3^2) come out exact, for the error before the last rounding is
 * below 0.05 ulp. */
#include "dse/math.h"
#include "math_internal.h"

#define OVERFLOW_ARGUMENT  710.0 /* of exp, as in exp.c */
#define UNDERFLOW_ARGUMENT (-746.0)
#define TWO_53             0x1p53 /* from here on every double is an even integer */

enum parity { NOT_INTEGER, EVEN, ODD };

static enum parity parity_of(double y)
{
    double size = dse_abs_double(y);
    if (size >= TWO_53)
        return EVEN;
    int64_t whole = (int64_t)size;
    if ((double)whole != size)
        return NOT_INTEGER;
    return whole % 2 == 0 ? EVEN : ODD;
}

/* |x|^y for x = 0 or infinite, or y infinite: 0, 1 or infinity. */
static double pow_of_extremes(double x, double y)
{
    double size = dse_abs_double(x);
    if (size == 1)
        return 1;
    return (size > 1) == (y > 0) ? dse_infinity() : 0;
}

/* x^y for finite x > 0 and finite y. */
static double pow_of_positive(double x, double y)
{
    struct dse_dd log_x = dse_log_kernel(x);
    double size = y * log_x.hi;
    if (size > OVERFLOW_ARGUMENT)
        return dse_infinity();
    if (size < UNDERFLOW_ARGUMENT)
        return 0;
    struct dse_dd product = dse_two_product(y, log_x.hi);
    product.lo += y * log_x.lo;
    int k;
    struct dse_dd m = dse_exp_kernel(product, &k);
    return dse_dd_scale(m, k);
}

static double pow_double(double x, double y)
{
    if (x == 1 || y == 0)
        return 1; /* even for NaN */
    if (x != x || y != y)
        return dse_nan();
    double x_size = dse_abs_double(x);
    bool extreme = x == 0 || x_size > DBL_MAX || dse_abs_double(y) > DBL_MAX;
    enum parity parity = parity_of(y);
    bool negative = (dse_bits(x) & DSE_BITS_SIGN) != 0;
    if (negative && !extreme && parity == NOT_INTEGER)
        return dse_nan();
    double size = extreme ? pow_of_extremes(x, y) : pow_of_positive(x_size, y);
    return negative && parity == ODD ? -size : size;
}

dse_real dse_pow(dse_real x, dse_real y)
{
    return (dse_real)pow_double((double)x, (double)y);
}
