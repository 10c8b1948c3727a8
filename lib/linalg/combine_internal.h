/* The inner loop of the dense kernels: a linear combination of contiguous rows.
 *
 * Rows run over the fast index, so that a compiler may use vector registers without changing a
 * bit: every element is summed over p in ascending order, whatever the width of a register. Four
 * rows are taken at a time, in that order, to load and store the target once instead of four
 * times. */
#ifndef DSE_LINALG_COMBINE_INTERNAL_H
#define DSE_LINALG_COMBINE_INTERNAL_H

#include "dse/real.h"

/* c_j += sum_p a_p B_pj, p = 0 .. k-1, j = 0 .. n-1; a has stride `sa`, rows of B stride `sb`. */
static inline void combine_add(int n, int k, const dse_real *restrict a, int sa,
                               const dse_real *restrict B, int sb, dse_real *restrict c)
{
    int p = 0;
    for (; p + 4 <= k; p += 4) {
        const dse_real a0 = a[p * sa], a1 = a[(p + 1) * sa];
        const dse_real a2 = a[(p + 2) * sa], a3 = a[(p + 3) * sa];
        const dse_real *b0 = B + p * sb, *b1 = b0 + sb, *b2 = b1 + sb, *b3 = b2 + sb;
        for (int j = 0; j < n; j++)
            c[j] = (((c[j] + a0 * b0[j]) + a1 * b1[j]) + a2 * b2[j]) + a3 * b3[j];
    }
    for (; p < k; p++) {
        const dse_real a0 = a[p * sa];
        const dse_real *b0 = B + p * sb;
        for (int j = 0; j < n; j++)
            c[j] += a0 * b0[j];
    }
}

/* c_j -= sum_p a_p B_pj. */
static inline void combine_subtract(int n, int k, const dse_real *restrict a, int sa,
                                    const dse_real *restrict B, int sb, dse_real *restrict c)
{
    int p = 0;
    for (; p + 4 <= k; p += 4) {
        const dse_real a0 = a[p * sa], a1 = a[(p + 1) * sa];
        const dse_real a2 = a[(p + 2) * sa], a3 = a[(p + 3) * sa];
        const dse_real *b0 = B + p * sb, *b1 = b0 + sb, *b2 = b1 + sb, *b3 = b2 + sb;
        for (int j = 0; j < n; j++)
            c[j] = (((c[j] - a0 * b0[j]) - a1 * b1[j]) - a2 * b2[j]) - a3 * b3[j];
    }
    for (; p < k; p++) {
        const dse_real a0 = a[p * sa];
        const dse_real *b0 = B + p * sb;
        for (int j = 0; j < n; j++)
            c[j] -= a0 * b0[j];
    }
}

#endif
