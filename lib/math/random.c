/* xoshiro256** 1.0 and splitmix64 by Blackman and Vigna (public domain), and normal numbers by Box
 * and Muller. */
#include "dse/random.h"
#include "math_internal.h"

#define TWO_PI 0x1.921fb54442d18p+2

/* One step of splitmix64: a bijection that spreads every bit of its counter. */
static uint64_t splitmix64(uint64_t *counter)
{
    *counter += UINT64_C(0x9e3779b97f4a7c15);
    uint64_t z = *counter;
    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
    return z ^ (z >> 31);
}

static uint64_t rotate_left(uint64_t x, int by)
{
    return (x << by) | (x >> (64 - by));
}

void dse_random_init(struct dse_random *random, uint64_t seed, uint64_t stream)
{
    /* The seed is spread before the stream is added, so that (1, 2) and (2, 1) have nothing in
     * common, and the sum is spread again to give the first of four different words. */
    uint64_t counter = seed;
    counter = splitmix64(&counter) + stream;
    counter = splitmix64(&counter);
    for (int i = 0; i < 4; i++)
        random->state[i] = splitmix64(&counter);
}

uint64_t dse_random_bits(struct dse_random *random)
{
    uint64_t *s = random->state;
    uint64_t result = rotate_left(s[1] * 5, 7) * 9;
    uint64_t shifted = s[1] << 17;
    s[2] ^= s[0];
    s[3] ^= s[1];
    s[1] ^= s[2];
    s[0] ^= s[3];
    s[2] ^= shifted;
    s[3] = rotate_left(s[3], 45);
    return result;
}

double dse_random_uniform(struct dse_random *random)
{
    return (double)(dse_random_bits(random) >> 11) * 0x1p-53;
}

/* sqrt(-2 log a) cos(2 pi b), a in (0, 1], b in [0, 1). Two draws for each number, always, so that
 * the k-th number of a stream does not depend on the values before it. */
double dse_random_normal(struct dse_random *random)
{
    double a = 1 - dse_random_uniform(random);
    double b = dse_random_uniform(random);
    return dse_sqrt_double(-2 * dse_log_double(a)) * dse_cos_double(TWO_PI * b);
}
