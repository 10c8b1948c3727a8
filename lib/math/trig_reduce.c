/* Argument reduction of sine and cosine: x = n pi/2 + r.
 *
 * Up to 2^19: Cody and Waite with pi/2 in four pieces; the first three have at most 33 bits, so
 * that their products with n are exact. Above: Payne and Hanek in integers. No double comes closer
 * to a multiple of pi/2 than 2^-62, and both ways carry more than 53 bits beyond that. */
#include "math_internal.h"

#define TWO_OVER_PI       0x1.45f306dc9c883p-1
#define CODY_WAITE_LIMIT  0x1p19
#define HALF_PI_1         0x1.921fb544p+0 /* sum of the four: pi/2 to 2^-158 */
#define HALF_PI_2         0x1.0b4611a6p-34
#define HALF_PI_3         0x1.3198a2ep-69
#define HALF_PI_4         0x1.b839a252049c1p-104
#define HALF_PI_HI        0x1.921fb54442d18p+0 /* hi + lo: pi/2 to 2^-107 */
#define HALF_PI_LO        0x1.1a62633145c07p-54
#define WINDOW            6  /* limbs of 2/pi that are multiplied: 192 bits */
#define LEADING_ZERO_BITS 64 /* of the table */

/* 2/pi in binary, 32 bits a limb, after two limbs of zeros. */
static const uint32_t two_over_pi[40] = {
    0x00000000u, 0x00000000u, 0xa2f9836eu, 0x4e441529u, 0xfc2757d1u, 0xf534ddc0u, 0xdb629599u,
    0x3c439041u, 0xfe5163abu, 0xdebbc561u, 0xb7246e3au, 0x424dd2e0u, 0x06492eeau, 0x09d1921cu,
    0xfe1deb1cu, 0xb129a73eu, 0xe88235f5u, 0x2ebb4484u, 0xe99c7026u, 0xb45f7e41u, 0x3991d639u,
    0x835339f4u, 0x9c845f8bu, 0xbdf9283bu, 0x1ff897ffu, 0xde05980fu, 0xef2f118bu, 0x5a0a6d1fu,
    0x6d367ecfu, 0x27cb09b7u, 0x4f463f66u, 0x9e5fea2du, 0x7527bac7u, 0xebe5f17bu, 0x3d0739f7u,
    0x8a5292eau, 0x6bfb5fb1u, 0x1f8d5d08u, 0x56033046u, 0xfc7b6babu,
};

static int reduce_by_cody_waite(double x, struct dse_dd *r)
{
    double n = dse_nearest_integer(x * TWO_OVER_PI);
    /* r = ((x - n p1) - n p2) - n p3 - n p4; the first difference is exact */
    struct dse_dd sum2 = dse_two_sum(x - n * HALF_PI_1, -n * HALF_PI_2);
    struct dse_dd sum3 = dse_two_sum(sum2.hi, -n * HALF_PI_3);
    struct dse_dd low = dse_two_sum(sum2.lo, sum3.lo);
    struct dse_dd sum = dse_two_sum(sum3.hi, low.hi);
    *r = dse_fast_two_sum(sum.hi, sum.lo + (low.lo - n * HALF_PI_4));
    return (int)n & 3;
}

/* limbs = 32 WINDOW bits of 2/pi from bit `start` on, most significant first. */
static void read_two_over_pi(int start, uint32_t *limbs)
{
    int first = start / 32, shift = start % 32;
    for (int i = 0; i < WINDOW; i++) {
        uint64_t high = two_over_pi[first + i];
        uint64_t low = shift != 0 ? two_over_pi[first + i + 1] : 0;
        limbs[i] = (uint32_t)((high << 32 | low) >> (32 - shift));
    }
}

/* limbs <- limbs * factor mod 2^(32 WINDOW). */
static void multiply(uint32_t *limbs, uint64_t factor)
{
    uint64_t low = factor & 0xffffffffu, high = factor >> 32;
    uint64_t carry = 0, previous = 0;
    for (int i = WINDOW - 1; i >= 0; i--) {
        uint64_t limb = limbs[i];
        /* column i of the schoolbook product: limb_i low + limb_(i+1) high + carry */
        uint64_t product = limb * low, crossed = previous * high;
        uint64_t sum = (product & 0xffffffffu) + carry + (crossed & 0xffffffffu);
        carry = (product >> 32) + (crossed >> 32) + (sum >> 32);
        limbs[i] = (uint32_t)sum;
        previous = limb;
    }
}

/* The fraction 0.limbs as a double-double, with the first `skip` bits taken off the front, in
 * [-1/2, 1/2): a leading one bit after them means a negative two's complement number. */
static struct dse_dd signed_fraction(uint32_t *limbs, int skip)
{
    for (int i = 0; i < WINDOW; i++) {
        uint32_t next = i + 1 < WINDOW ? limbs[i + 1] : 0;
        limbs[i] = limbs[i] << skip | next >> (32 - skip);
    }
    double sign = 1;
    if (limbs[0] >> 31 != 0) { /* -f = ~f, but for one unit in the last place */
        sign = -1;
        for (int i = 0; i < WINDOW; i++)
            limbs[i] = ~limbs[i];
    }
    struct dse_dd sum = {0, 0};
    for (int i = 0; i < WINDOW; i++) {
        struct dse_dd next = dse_two_sum(sum.hi, limbs[i] * dse_power_of_two(-32 * (i + 1)));
        sum = (struct dse_dd){next.hi, sum.lo + next.lo};
    }
    return (struct dse_dd){sign * sum.hi, sign * sum.lo};
}

/* x = M 2^e with a 53-bit integer M. Bits of 2/pi worth 2^(2-e) or more only add multiples of 4 to
 * x 2/pi, so the window starts at the bit worth 2^(1-e), and
 *     x 2/pi mod 4 = (M window mod 2^192) 2^(2-192),
 * two bits of quadrant and 190 of fraction. */
static int reduce_by_payne_hanek(double x, struct dse_dd *r)
{
    uint64_t bits = dse_bits(x) & ~DSE_BITS_SIGN;
    int e = (int)(bits >> 52) - 1075;
    uint64_t M = (bits & UINT64_C(0x000fffffffffffff)) | UINT64_C(0x0010000000000000);
    uint32_t limbs[WINDOW];
    read_two_over_pi(LEADING_ZERO_BITS + e - 2, limbs);
    multiply(limbs, M);

    int quadrant = (int)(limbs[0] >> 30);
    if ((limbs[0] >> 29 & 1) != 0) /* the fraction counts from the next multiple */
        quadrant++;
    struct dse_dd f = signed_fraction(limbs, 2);

    /* r = f pi/2 */
    struct dse_dd product = dse_two_product(f.hi, HALF_PI_HI);
    double low = product.lo + (f.hi * HALF_PI_LO + f.lo * HALF_PI_HI);
    *r = dse_fast_two_sum(product.hi, low);
    if (x < 0) {
        *r = (struct dse_dd){-r->hi, -r->lo};
        quadrant = -quadrant;
    }
    return quadrant & 3;
}

int dse_trig_reduce(double x, struct dse_dd *r)
{
    if (dse_abs_double(x) < CODY_WAITE_LIMIT)
        return reduce_by_cody_waite(x, r);
    return reduce_by_payne_hanek(x, r);
}
