/* Random numbers and matrices, the same in every run: each test program draws one sequence. A
 * linear congruential generator (Knuth's MMIX constants) is random enough for residuals. */
#ifndef RANDOM_MATRIX_H
#define RANDOM_MATRIX_H

#include <math.h>
#include <stdint.h>

#include "dse/real.h"

static uint64_t random_state;

/* Uniform on (-1, 1). */
static inline dse_real uniform(void)
{
    random_state = random_state * 6364136223846793005u + 1442695040888963407u;
    return (dse_real)((double)(random_state >> 11) / 4503599627370496.0 - 1.0);
}

/* Standard normal, by Box and Muller. */
static inline dse_real normal(void)
{
    const double a = 0.5 + 0.4999999 * (double)uniform(), b = 3.14159265358979 * (double)uniform();
    return (dse_real)(sqrt(-2 * log(a)) * cos(b));
}

/* n numbers uniform on (-1, 1). */
static inline void fill(int n, dse_real *x)
{
    for (int i = 0; i < n; i++) {
        x[i] = uniform();
    }
}

/* count numbers uniform on (-1, 1) / sqrt n: products of n x n matrices stay of order 1. */
static inline void fill_scaled(int n, int count, dse_real *M)
{
    for (int i = 0; i < count; i++) {
        M[i] = uniform() / (dse_real)sqrt((double)n);
    }
}

#endif
