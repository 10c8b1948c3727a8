/* The number type of the library: dse_real is double, or float with -DDSE_REAL=float. */
#ifndef DSE_REAL_H
#define DSE_REAL_H

#include <float.h>

#ifdef DSE_REAL_IS_float
typedef float dse_real;
#define DSE_REAL_EPSILON FLT_EPSILON
#define DSE_REAL_MIN     FLT_MIN
#define DSE_REAL_MAX     FLT_MAX
#else
typedef double dse_real;
#define DSE_REAL_EPSILON DBL_EPSILON
#define DSE_REAL_MIN     DBL_MIN
#define DSE_REAL_MAX     DBL_MAX
#endif

/* A literal in the library's precision: DSE_REAL(0.5). */
#define DSE_REAL(literal) ((dse_real)(literal))

#endif
