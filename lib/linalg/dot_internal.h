/* The inner product, for kernels that consist of many short ones. */
#ifndef DSE_LINALG_DOT_INTERNAL_H
#define DSE_LINALG_DOT_INTERNAL_H

#include "dse/real.h"

/* Four partial sums, joined as (s0 + s1) + (s2 + s3): a fixed order that shortens the chain of
 * dependent additions and is the same for every register width. */
static inline dse_real dot(int n, const dse_real *x, const dse_real *y)
{
    dse_real s0 = 0, s1 = 0, s2 = 0, s3 = 0;
    int i = 0;
    for (; i + 4 <= n; i += 4) {
        s0 += x[i] * y[i];
        s1 += x[i + 1] * y[i + 1];
        s2 += x[i + 2] * y[i + 2];
        s3 += x[i + 3] * y[i + 3];
    }
    for (; i < n; i++)
        s0 += x[i] * y[i];
    return (s0 + s1) + (s2 + s3);
}

#endif
