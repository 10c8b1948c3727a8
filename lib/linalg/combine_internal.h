/* The inner loop of the dense kernels: a linear combination of rows,
 *
 *     c_j <- c_j + sum_p a_p B_pj    (or minus),   p = 0 .. k-1,  j = 0 .. n-1.
 *
 * Every element is the sum of two partial sums, c_j and the terms of even p on the one hand, those
 * of odd p on the other, each in ascending order. So the bits do not depend on how many columns
 * are taken at a time, and half as many additions wait for each other. A block of columns stays in
 * registers while p runs: B is read once, c is read and written once. */
#ifndef DSE_LINALG_COMBINE_INTERNAL_H
#define DSE_LINALG_COMBINE_INTERNAL_H

#include <stdbool.h>

#include "lanes_internal.h"

/* What the sum starts from: `from` where it is given, else zero. */
static inline lanes combine_load(bool given, const dse_real *from)
{
    return given ? lanes_load(from) : lanes_all(0);
}

/* Columns 0 .. 4 LANES - 1. */
static inline void combine_4(int k, const dse_real *a, int sa, const dse_real *B, int sb,
                             dse_real sign, bool given, const dse_real *from, dse_real *c)
{
    lanes c0 = combine_load(given, from), c1 = combine_load(given, from + LANES),
          c2 = combine_load(given, from + 2 * LANES), c3 = combine_load(given, from + 3 * LANES);
    lanes d0 = lanes_all(0), d1 = d0, d2 = d0, d3 = d0;
    for (; k >= 2; k -= 2, a += 2 * sa, B += 2 * sb) {
        const lanes even = lanes_all(sign * a[0]), odd = lanes_all(sign * a[sa]);
        c0 += even * lanes_load(B);
        c1 += even * lanes_load(B + LANES);
        c2 += even * lanes_load(B + 2 * LANES);
        c3 += even * lanes_load(B + 3 * LANES);
        d0 += odd * lanes_load(B + sb);
        d1 += odd * lanes_load(B + sb + LANES);
        d2 += odd * lanes_load(B + sb + 2 * LANES);
        d3 += odd * lanes_load(B + sb + 3 * LANES);
    }
    if (k > 0) {
        const lanes even = lanes_all(sign * a[0]);
        c0 += even * lanes_load(B);
        c1 += even * lanes_load(B + LANES);
        c2 += even * lanes_load(B + 2 * LANES);
        c3 += even * lanes_load(B + 3 * LANES);
    }
    lanes_store(c, c0 + d0);
    lanes_store(c + LANES, c1 + d1);
    lanes_store(c + 2 * LANES, c2 + d2);
    lanes_store(c + 3 * LANES, c3 + d3);
}

static inline void combine_2(int k, const dse_real *a, int sa, const dse_real *B, int sb,
                             dse_real sign, bool given, const dse_real *from, dse_real *c)
{
    lanes c0 = combine_load(given, from), c1 = combine_load(given, from + LANES), d0 = lanes_all(0),
          d1 = d0;
    for (; k >= 2; k -= 2, a += 2 * sa, B += 2 * sb) {
        const lanes even = lanes_all(sign * a[0]), odd = lanes_all(sign * a[sa]);
        c0 += even * lanes_load(B);
        c1 += even * lanes_load(B + LANES);
        d0 += odd * lanes_load(B + sb);
        d1 += odd * lanes_load(B + sb + LANES);
    }
    if (k > 0) {
        const lanes even = lanes_all(sign * a[0]);
        c0 += even * lanes_load(B);
        c1 += even * lanes_load(B + LANES);
    }
    lanes_store(c, c0 + d0);
    lanes_store(c + LANES, c1 + d1);
}

static inline void combine_1(int k, const dse_real *a, int sa, const dse_real *B, int sb,
                             dse_real sign, bool given, const dse_real *from, dse_real *c)
{
    lanes c0 = combine_load(given, from), d0 = lanes_all(0);
    for (; k >= 2; k -= 2, a += 2 * sa, B += 2 * sb) {
        c0 += lanes_all(sign * a[0]) * lanes_load(B);
        d0 += lanes_all(sign * a[sa]) * lanes_load(B + sb);
    }
    if (k > 0)
        c0 += lanes_all(sign * a[0]) * lanes_load(B);
    lanes_store(c, c0 + d0);
}

static inline void combine_scalar(int k, const dse_real *a, int sa, const dse_real *B, int sb,
                                  dse_real sign, bool given, const dse_real *from, dse_real *c)
{
    dse_real c0 = given ? *from : 0, d0 = 0;
    for (; k >= 2; k -= 2, a += 2 * sa, B += 2 * sb) {
        c0 += sign * a[0] * B[0];
        d0 += sign * a[sa] * B[sb];
    }
    if (k > 0)
        c0 += sign * a[0] * B[0];
    *c = c0 + d0;
}

/* c = from +- ..., from may be c; it is read where it is given, else zero stands for it. a has
 * stride sa, the rows of B have stride sb; sign is 1 or -1. c overlaps neither a nor B. */
static inline void combine(int n, int k, const dse_real *a, int sa, const dse_real *B, int sb,
                           dse_real sign, bool given, const dse_real *from, dse_real *c)
{
    int j = 0;
    for (; j + 4 * LANES <= n; j += 4 * LANES)
        combine_4(k, a, sa, B + j, sb, sign, given, from + j, c + j);
    if (j + 2 * LANES <= n) {
        combine_2(k, a, sa, B + j, sb, sign, given, from + j, c + j);
        j += 2 * LANES;
    }
    if (j + LANES <= n) {
        combine_1(k, a, sa, B + j, sb, sign, given, from + j, c + j);
        j += LANES;
    }
    for (; j < n; j++)
        combine_scalar(k, a, sa, B + j, sb, sign, given, from + j, c + j);
}

static inline void combine_add(int n, int k, const dse_real *a, int sa, const dse_real *B, int sb,
                               dse_real *c)
{
    combine(n, k, a, sa, B, sb, 1, true, c, c);
}

static inline void combine_subtract(int n, int k, const dse_real *a, int sa, const dse_real *B,
                                    int sb, dse_real *c)
{
    combine(n, k, a, sa, B, sb, -1, true, c, c);
}

#endif
