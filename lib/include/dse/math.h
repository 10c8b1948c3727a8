/* Elementary functions with the same bits on every machine and compiler: plain IEEE arithmetic in
 * a fixed order, compiled without contraction. The platform's libm is not called.
 *
 * Error below 1 ulp of the exact value over the whole range; measured by tests/unit/test_math.c:
 * at most 0.56 ulp, sine and cosine 0.8, and 0.51 for float. Special cases follow C11 Annex F: NaN
 * in, NaN out (but pow(1, NaN) = pow(NaN, 0) = 1), log(0) = -inf, exp overflows to inf. A NaN that
 * comes out always has the same bits. No floating-point exception flags are promised. */
#ifndef DSE_MATH_H
#define DSE_MATH_H

#include <stdbool.h>

#include "dse/real.h"

dse_real dse_exp(dse_real x);
/* y_k = dse_exp(x_k) for n numbers, with the same bits and faster: they do not wait for each other.
 * y may be x. */
void dse_exp_many(int n, const dse_real *x, dse_real *y);
dse_real dse_log(dse_real x);             /* natural logarithm */
dse_real dse_pow(dse_real x, dse_real y); /* x^y */
dse_real dse_sin(dse_real x);             /* x in radians, any finite size */
dse_real dse_cos(dse_real x);
dse_real dse_sqrt(dse_real x); /* correctly rounded (IEEE 754) */
dse_real dse_tanh(dse_real x);

/* 1 / (1 + exp(-s)) without overflow for any s. */
dse_real dse_sigmoid(dse_real s);

static inline dse_real dse_abs(dse_real x)
{
#ifdef DSE_REAL_IS_float
    return __builtin_fabsf(x);
#else
    return __builtin_fabs(x);
#endif
}

/* The larger or smaller of two; NaN when one of them is NaN, so that it cannot hide. */
static inline dse_real dse_max(dse_real a, dse_real b)
{
    return a > b || a != a ? a : b;
}

static inline dse_real dse_min(dse_real a, dse_real b)
{
    return a < b || a != a ? a : b;
}

/* Not NaN, not infinite. */
static inline bool dse_is_finite(dse_real x)
{
    return dse_abs(x) <= DSE_REAL_MAX;
}

/* All n values finite. */
bool dse_all_finite(const dse_real *x, int n);

#endif
