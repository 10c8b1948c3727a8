/* A few numbers side by side in one register: element by element the same operations in the same
 * order as without, so the same bits; only faster. Where the compiler or the processor has no such
 * registers a lane is a single number and the code is plain C. */
#ifndef DSE_LINALG_LANES_INTERNAL_H
#define DSE_LINALG_LANES_INTERNAL_H

#include "dse/real.h"

#if defined(__GNUC__) && defined(__AVX__) && !defined(DSE_REAL_IS_float)
#define LANES_BYTES 32 /* never more than four lanes */
#elif defined(__GNUC__) && (defined(__SSE2__) || (defined(__aarch64__) && defined(__ARM_NEON)))
#define LANES_BYTES 16
#endif

#ifdef LANES_BYTES
#define LANES (LANES_BYTES / (int)sizeof(dse_real))
typedef dse_real lanes __attribute__((vector_size(LANES_BYTES)));

static inline lanes lanes_load(const dse_real *x)
{
    lanes v;
    __builtin_memcpy(&v, x, sizeof v); /* any alignment */
    return v;
}

static inline void lanes_store(dse_real *x, lanes v)
{
    __builtin_memcpy(x, &v, sizeof v);
}

static inline lanes lanes_all(dse_real a)
{
    return a - (lanes){0};
}
#else
#define LANES 1
typedef dse_real lanes;

static inline lanes lanes_load(const dse_real *x)
{
    return *x;
}

static inline void lanes_store(dse_real *x, lanes v)
{
    *x = v;
}

static inline lanes lanes_all(dse_real a)
{
    return a;
}
#endif

#endif
