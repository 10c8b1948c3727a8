/* One number over the results of all elementary functions at some thousand arguments. It has to
 * come out the same on every machine: test_math compares it on the host, the embedded image on a
 * microcontroller. Uses dse/math.h only. */
#ifndef MATH_BITS_H
#define MATH_BITS_H

#include <stdint.h>
#include <string.h>

#include "dse/math.h"

#ifdef DSE_REAL_IS_float
#define MATH_BITS_EXPECTED UINT64_C(0xd12d5cfeed040b7a)
#else
#define MATH_BITS_EXPECTED UINT64_C(0x3c91f71121f6f1c7)
#endif

#define MATH_BITS_ARGUMENTS 500 /* in each of the ranges below */

/* The next word of a linear congruential generator (Knuth's MMIX constants). */
static inline uint64_t math_bits_next(uint64_t *state)
{
    *state = *state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return *state;
}

/* Uniform on [low, high], in exact or correctly rounded operations only. */
static inline dse_real math_bits_uniform(uint64_t *state, dse_real low, dse_real high)
{
    dse_real unit = (dse_real)(math_bits_next(state) >> 40) / DSE_REAL(16777216);
    return low + (high - low) * unit;
}

/* Takes the bits of a result into the hash (FNV-1a over 8 bytes at once). */
static inline void math_bits_add(uint64_t *hash, dse_real value)
{
    uint64_t bits = 0;
    memcpy(&bits, &value, sizeof value);
    *hash = (*hash ^ bits) * UINT64_C(1099511628211);
    *hash ^= *hash >> 29;
}

static inline uint64_t math_bits_checksum(void)
{
    static const struct {
        dse_real (*function)(dse_real);
        dse_real low, high;
    } ranges[] = {
        {dse_exp, -2, 2},       {dse_exp, -760, 720},     {dse_log, 0, 2},
        {dse_log, 0, 1e30f},    {dse_sin, -4, 4},         {dse_sin, -1e30f, 1e30f},
        {dse_cos, -4, 4},       {dse_cos, -1e30f, 1e30f}, {dse_sqrt, 0, 4},
        {dse_sqrt, 0, 1e30f},   {dse_tanh, -0.2f, 0.2f},  {dse_tanh, -25, 25},
        {dse_sigmoid, -50, 50}, {dse_sigmoid, -760, 0},
    };
    uint64_t state = 2024, hash = UINT64_C(14695981039346656037);
    for (unsigned r = 0; r < sizeof ranges / sizeof ranges[0]; r++)
        for (int i = 0; i < MATH_BITS_ARGUMENTS; i++)
            math_bits_add(&hash, ranges[r].function(
                                     math_bits_uniform(&state, ranges[r].low, ranges[r].high)));
    for (int i = 0; i < MATH_BITS_ARGUMENTS; i++) {
        dse_real near_one = math_bits_uniform(&state, 0.9f, 1.1f);
        math_bits_add(&hash, dse_pow(near_one, math_bits_uniform(&state, -5000, 5000)));
        dse_real large = math_bits_uniform(&state, 0, 1000);
        math_bits_add(&hash, dse_pow(large, math_bits_uniform(&state, -20, 20)));
    }
    return hash;
}

#endif
