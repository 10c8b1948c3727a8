/* Test arguments that are the same on every machine and owe nothing to the library under test. */
#ifndef NUMBERS_H
#define NUMBERS_H

#include <stdint.h>

#include "dse/real.h"

struct numbers {
    uint64_t state;
};

/* splitmix64 */
static inline uint64_t numbers_bits(struct numbers *numbers)
{
    uint64_t z = (numbers->state += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

/* Uniform on [low, high): 24 random bits, exact in float and in double. */
static inline dse_real numbers_uniform(struct numbers *numbers, dse_real low, dse_real high)
{
    dse_real unit = (dse_real)(int32_t)(numbers_bits(numbers) >> 40) / DSE_REAL(16777216);
    return low + (high - low) * unit;
}

/* n values on [-1, 1). */
static inline void numbers_fill(struct numbers *numbers, int n, dse_real *x)
{
    for (int i = 0; i < n; i++)
        x[i] = numbers_uniform(numbers, -1, 1);
}

#endif
