/* Elementary functions with the same bits on every machine and compiler: plain IEEE arithmetic in
 * a fixed order, compiled without contraction. The platform's libm is not called.
 *
 * Error below 1 ulp against the exact value over the whole range (tests/unit/test_math.c). Special
 * cases follow C11 Annex F (NaN in, NaN out; log(0) = -inf; exp overflows to inf). */
#ifndef DSE_MATH_H
#define DSE_MATH_H

#include <stdbool.h>

#include "dse/real.h"

dse_real dse_exp(dse_real x);
dse_real dse_log(dse_real x);               /* natural logarithm */
dse_real dse_pow(dse_real x, dse_real y);   /* x^y */
dse_real dse_sin(dse_real x);               /* x in radians, any finite size */
dse_real dse_cos(dse_real x);
dse_real dse_sqrt(dse_real x);              /* correctly rounded (IEEE 754) */
dse_real dse_tanh(dse_real x);

/* 1 / (1 + exp(-s)) without overflow for any s. */
dse_real dse_sigmoid(dse_real s);

dse_real dse_abs(dse_real x);
dse_real dse_max(dse_real a, dse_real b);
dse_real dse_min(dse_real a, dse_real b);

/* Not NaN, not infinite. */
bool dse_is_finite(dse_real x);
/* All n values finite. */
bool dse_all_finite(const dse_real *x, int n);

#endif
