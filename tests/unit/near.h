/* Comparisons of numbers that say, when they fail, what was compared and how close it had to be.
 * NaN is near nothing. */
#ifndef NEAR_H
#define NEAR_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "dse/math.h"

/* A bound for each precision. */
#ifdef DSE_REAL_IS_float
#define TOLERANCE(in_double, in_float) DSE_REAL(in_float)
#else
#define TOLERANCE(in_double, in_float) DSE_REAL(in_double)
#endif

/* |got - want| <= tolerance. */
static inline void assert_near(dse_real got, dse_real want, dse_real tolerance)
{
    if (!(dse_abs(got - want) <= tolerance)) {
        fail_msg("%.17g is not %.17g within %g", (double)got, (double)want, (double)tolerance);
    }
}

/* The same for n entries. */
static inline void assert_all_near(int n, const dse_real *got, const dse_real *want,
                                   dse_real tolerance)
{
    for (int i = 0; i < n; i++) {
        if (!(dse_abs(got[i] - want[i]) <= tolerance)) {
            fail_msg("entry %d: %.17g is not %.17g within %g", i, (double)got[i], (double)want[i],
                     (double)tolerance);
        }
    }
}

/* The same relative to the largest entry of what is wanted. */
static inline void assert_agree(int n, const dse_real *got, const dse_real *want,
                                dse_real tolerance)
{
    dse_real size = 0;
    for (int i = 0; i < n; i++) {
        size = dse_max(size, dse_abs(want[i]));
    }
    assert_all_near(n, got, want, tolerance * size);
}

#endif
