/* Reproducible random numbers: the same seed gives the same bits on every machine. Used by the
 * simulator's noise and by injected network trouble, never by an estimator's mathematics. */
#ifndef DSE_RANDOM_H
#define DSE_RANDOM_H

#include <stdint.h>

#include "dse/real.h"

struct dse_random {
    uint64_t state[4]; /* xoshiro256** */
};

/* An independent stream for each (seed, stream) pair, e.g. stream = channel number. */
void dse_random_init(struct dse_random *random, uint64_t seed, uint64_t stream);
uint64_t dse_random_bits(struct dse_random *random);
/* Uniform on [0, 1), 53 random bits. */
double dse_random_uniform(struct dse_random *random);
/* Standard normal; takes two draws of the stream. */
double dse_random_normal(struct dse_random *random);

#endif
