/* log(x): table of reciprocals, polynomial, result as a double-double.
 *
 *     x = 2^k m,  0.6875 <= m < 1.375,   log(x) = k ln2 - log(c) + log(1 + r),   r = m c - 1
 *
 * c is 1/m to 11 bits, so m c is exact in two pieces. Around x = 1 both k and log(c) are zero and
 * the result keeps its relative accuracy. */
#include "dse/math.h"
#include "math_internal.h"

#define TABLE_SIZE 64
#define LN2_HI     0x1.62e42fefa38p-1 /* ln 2 = hi + lo, hi a multiple of 2^-42 */
#define LN2_LO     0x1.ef35793c7673p-45
#define ONE_OFFSET UINT64_C(0x000a000000000000) /* bits of 1 minus bits of 0.6875 */
#define TWO_52     0x1p52

struct log_entry {
    double c;      /* reciprocal of the middle of interval i, 10 fractional bits */
    double log_hi; /* -log(c) = hi + lo, hi a multiple of 2^-42 */
    double log_lo;
};

/* Interval i: 2^-7 wide from 0.6875 to 1 (i < 40), 2^-6 wide from 1 to 1.375; both next to 1 have
 * c = 1. */
static const struct log_entry log_table[TABLE_SIZE] = {
    {0x1.724p+0, -0x1.79db6681bp-2, 0x1.4d319161a11f8p-44},
    {0x1.6ep+0, -0x1.6e08eaa2bap-2, -0x1.e38c139318d71p-46},
    {0x1.6ap+0, -0x1.62c82f2b9cp-2, -0x1.e54bdbd7c8a98p-44},
    {0x1.66p+0, -0x1.5767717456p-2, 0x1.64ead9524d7cap-44},
    {0x1.624p+0, -0x1.4c9f09e153p-2, 0x1.e1dde70e02dep-45},
    {0x1.5e8p+0, -0x1.41b941cce1p-2, 0x1.0469013e43fc9p-44},
    {0x1.5acp+0, -0x1.36b5776bc1p-2, -0x1.169785a9c223fp-46},
    {0x1.57p+0, -0x1.2b9303ab8ap-2, 0x1.6db12d6bfb0a5p-45},
    {0x1.538p+0, -0x1.2112559861p-2, -0x1.82e78ba2950c4p-44},
    {0x1.5p+0, -0x1.1675cababap-2, -0x1.8380e731f55c4p-44},
    {0x1.4ccp+0, -0x1.0c81d4860bp-2, 0x1.e5bcf401d1731p-44},
    {0x1.494p+0, -0x1.01ade3913ap-2, 0x1.08930ccdc1521p-46},
    {0x1.46p+0, -0x1.ef0adcbdc6p-3, 0x1.b26b79c86af24p-45},
    {0x1.42cp+0, -0x1.da85d620cep-3, -0x1.40194c16cc7ecp-45},
    {0x1.3fcp+0, -0x1.c765b9e4d6p-3, -0x1.1ab6b36976f6cp-44},
    {0x1.3c8p+0, -0x1.b2797ee464p-3, 0x1.be88a906d00a9p-44},
    {0x1.398p+0, -0x1.9ef83d276ap-3, 0x1.730b7b3f9cep-45},
    {0x1.368p+0, -0x1.8b46f82236p-3, -0x1.2d9f2102dd7c9p-46},
    {0x1.33cp+0, -0x1.790ed4ee26p-3, -0x1.99bbd4e7746f6p-46},
    {0x1.30cp+0, -0x1.64fee8826p-3, 0x1.da40d759dded6p-46},
    {0x1.2ep+0, -0x1.526e5e3a1cp-3, 0x1.790ba37fc5238p-44},
    {0x1.2b4p+0, -0x1.3fb25a5952p-3, -0x1.195be6b358ff7p-44},
    {0x1.288p+0, -0x1.2cca0f5f6p-3, 0x1.b5ef191aff12p-44},
    {0x1.26p+0, -0x1.1b72ad52f6p-3, -0x1.e80a41811a396p-45},
    {0x1.234p+0, -0x1.08338affa2p-3, -0x1.0533cac823e27p-44},
    {0x1.20cp+0, -0x1.ed1794e838p-4, 0x1.fd143749d0484p-46},
    {0x1.1e4p+0, -0x1.c97978d79p-4, 0x1.6e010977d1884p-44},
    {0x1.1bcp+0, -0x1.a58b60c2b4p-4, 0x1.cdc735c5c9f2ap-44},
    {0x1.194p+0, -0x1.814be23f8cp-4, -0x1.b2381da82fdfdp-51},
    {0x1.17p+0, -0x1.60658a9374p-4, -0x1.0c3b1dee9c4f8p-44},
    {0x1.148p+0, -0x1.3b87598b1cp-4, 0x1.2241594aca313p-45},
    {0x1.124p+0, -0x1.1a0fba1bf8p-4, -0x1.4a3fcc319d6dcp-45},
    {0x1.1p+0, -0x1.f0a30c0118p-5, 0x1.d599e83368e91p-45},
    {0x1.0dcp+0, -0x1.ac9722171p-5, -0x1.f8d3ef013222cp-45},
    {0x1.0b8p+0, -0x1.67f94f0948p-5, -0x1.ecc1f3e7e4ed7p-44},
    {0x1.094p+0, -0x1.22c71bcea8p-5, -0x1.d2818f87f888fp-48},
    {0x1.074p+0, -0x1.c98d18d01p-6, 0x1.bf6150589df0fp-45},
    {0x1.05p+0, -0x1.3cea44347p-6, 0x1.6a2c432d6a40bp-44},
    {0x1.03p+0, -0x1.7dc475f82p-7, 0x1.eb1245b5da1f5p-44},
    {0x1p+0, 0x0p+0, 0x0p+0},
    {0x1p+0, 0x0p+0, 0x0p+0},
    {0x1.f48p-1, 0x1.74321d3dp-6, 0x1.b4a690fe94778p-48},
    {0x1.edp-1, 0x1.35c8bfaa1p-5, 0x1.8357d5ef9eb35p-44},
    {0x1.e58p-1, 0x1.b35dd9b588p-5, 0x1.d5674d6cf558ep-44},
    {0x1.de8p-1, 0x1.152b799bb4p-4, -0x1.9bb2907030829p-47},
    {0x1.d78p-1, 0x1.518874226p-4, 0x1.30a1d96258b3ep-44},
    {0x1.d1p-1, 0x1.8a6477a91cp-4, 0x1.c28c0af9bd6dfp-44},
    {0x1.ca8p-1, 0x1.c40d6425a4p-4, 0x1.cb1121d1930ddp-44},
    {0x1.c4p-1, 0x1.fe89139dbcp-4, 0x1.56594d82f7a82p-44},
    {0x1.bep-1, 0x1.1aa2b7e24p-3, -0x1.1ac38dde3b366p-44},
    {0x1.b8p-1, 0x1.365fcb015ap-3, -0x1.fd3a0afb9691bp-44},
    {0x1.b2p-1, 0x1.527e5e4a1cp-3, -0x1.4e60b8d4b411dp-44},
    {0x1.ac8p-1, 0x1.6c9d07d204p-3, -0x1.c73fafd9b2dcap-50},
    {0x1.a7p-1, 0x1.871213750ep-3, 0x1.328eb42f9af75p-44},
    {0x1.a18p-1, 0x1.a1dfc40f1cp-3, -0x1.01e0f004f3781p-44},
    {0x1.9cp-1, 0x1.bd087383bep-3, -0x1.d4bc4595412b6p-45},
    {0x1.97p-1, 0x1.d60a17f904p-3, -0x1.5d6e06fc20d39p-44},
    {0x1.92p-1, 0x1.ef5ade4ddp-3, -0x1.a211565bb8e11p-51},
    {0x1.8dp-1, 0x1.047e60cde8p-2, 0x1.dbdf10d397f3cp-45},
    {0x1.888p-1, 0x1.102ac0a35dp-2, -0x1.f1fbddfdfd686p-45},
    {0x1.84p-1, 0x1.1bf99635a7p-2, -0x1.1ac89575c2125p-44},
    {0x1.7f8p-1, 0x1.27ebaf58d9p-2, -0x1.b198800b4bda7p-45},
    {0x1.7bp-1, 0x1.3401e12aedp-2, -0x1.17c73556e291dp-44},
    {0x1.768p-1, 0x1.403d086ceap-2, 0x1.e6ef574487308p-44}};

/* (log(1 + r) - r + r^2/2) / r^3, near-minimax on [-2^-7, 2^-6]; its error moves log(1 + r) by less
 * than 2^-67 r. */
static double log_tail(double r)
{
    return 0x1.5555555555555p-2 +
           r * (-0x1.0000000000001p-2 +
                r * (0x1.9999999999183p-3 +
                     r * (-0x1.555555550d783p-3 +
                          r * (0x1.2492496a1fc6p-3 +
                               r * (-0x1.000025027ae7dp-3 +
                                    r * (0x1.c70e921aaccefp-4 + r * -0x1.8e3d46690fdcap-4))))));
}

struct dse_dd dse_log_kernel(double x)
{
    int k = 0;
    if (x < DBL_MIN) { /* subnormal */
        x *= TWO_52;
        k = -52;
    }
    uint64_t shifted = dse_bits(x) + ONE_OFFSET;
    int exponent = (int)(shifted >> 52) - 1023;
    k += exponent;
    struct log_entry entry = log_table[(shifted >> 46) & (TABLE_SIZE - 1)];

    /* r + r_lo = m c - 1 */
    double m = dse_from_bits(dse_bits(x) - ((uint64_t)(int64_t)exponent << 52));
    double m_top = dse_top_half(m);
    struct dse_dd r = dse_two_sum(m_top * entry.c - 1, (m - m_top) * entry.c);

    /* r^2/2 = square + square_lo, from the exact square of r's leading half */
    double r_top = dse_top_half(r.hi);
    double square = 0.5 * r_top * r_top;
    double square_lo = 0.5 * (r.hi - r_top) * (r.hi + r_top) + r.hi * r.lo;

    /* (k ln2 - log c) + r - r^2/2 + r^3 Q(r); k LN2_HI + log_hi is exact */
    struct dse_dd sum1 = dse_two_sum(k * LN2_HI + entry.log_hi, r.hi);
    struct dse_dd sum2 = dse_two_sum(sum1.hi, -square);
    double cubic = r.hi * r.hi * r.hi * log_tail(r.hi);
    double small = (k * LN2_LO + entry.log_lo) + (r.lo - square_lo) + cubic;
    return dse_fast_two_sum(sum2.hi, sum1.lo + sum2.lo + small);
}

double dse_log_double(double x)
{
    if (x != x || x < 0)
        return dse_nan();
    if (x == 0)
        return -dse_infinity();
    if (x > DBL_MAX)
        return x;
    return dse_log_kernel(x).hi;
}

dse_real dse_log(dse_real x)
{
    return (dse_real)dse_log_double((double)x);
}
