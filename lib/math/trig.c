/* sin(x) and cos(x): reduction to |r| <= pi/4, then near-minimax polynomials in r^2. */
#include "dse/math.h"
#include "math_internal.h"

#define SIN_IDENTITY 0x1p-27 /* below: x^3/6 < ulp(x)/4 */

/* sin(r + r_lo) = r + r^3 S(r^2) + r_lo cos r. The polynomial is off by less than 2^-57 sin(r), its
 * four roundings by less than 0.32 ulp. */
static double sin_kernel(struct dse_dd r)
{
    double z = r.hi * r.hi;
    double S = -0x1.5555555555555p-3 +
               z * (0x1.111111111111p-7 +
                    z * (-0x1.a01a01a019938p-13 +
                         z * (0x1.71de3a546095ap-19 +
                              z * (-0x1.ae645412c5549p-26 +
                                   z * (0x1.61217f0b7666bp-33 + z * -0x1.ab17d3ff2df5ep-41)))));
    return r.hi + (r.hi * z * S + r.lo * (1 - 0.5 * z));
}

/* cos(r + r_lo) = 1 - r^2/2 + r^4 C(r^2) - r r_lo with r^2 as a double-double, for half of its
 * rounding error would be a quarter ulp of the result. C is off by less than 2^-59 in all. */
static double cos_kernel(struct dse_dd r)
{
    struct dse_dd square = dse_two_product(r.hi, r.hi);
    double z = square.hi;
    double C = 0x1.5555555555555p-5 +
               z * (-0x1.6c16c16c16967p-10 +
                    z * (0x1.a01a019f4ebp-16 +
                         z * (-0x1.27e4fa17da03p-22 +
                              z * (0x1.1eeb68e934339p-29 + z * -0x1.907da36274fc5p-37))));
    struct dse_dd leading = dse_fast_two_sum(1, -0.5 * z);
    return leading.hi + (leading.lo + (z * z * C - (0.5 * square.lo + r.hi * r.lo)));
}

/* sin(r + quadrant pi/2) */
static double sin_of_quadrant(int quadrant, struct dse_dd r)
{
    double value = (quadrant & 1) != 0 ? cos_kernel(r) : sin_kernel(r);
    return (quadrant & 2) != 0 ? -value : value;
}

static double sin_double(double x)
{
    double size = dse_abs_double(x);
    if (!(size <= DBL_MAX))
        return dse_nan();
    if (size < SIN_IDENTITY)
        return x;
    struct dse_dd r;
    int quadrant = dse_trig_reduce(x, &r);
    return sin_of_quadrant(quadrant, r);
}

double dse_cos_double(double x)
{
    if (!(dse_abs_double(x) <= DBL_MAX))
        return dse_nan();
    struct dse_dd r;
    int quadrant = dse_trig_reduce(x, &r);
    return sin_of_quadrant(quadrant + 1, r);
}

dse_real dse_sin(dse_real x)
{
    return (dse_real)sin_double((double)x);
}

dse_real dse_cos(dse_real x)
{
    return (dse_real)dse_cos_double((double)x);
}
