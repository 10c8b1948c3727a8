/* exp(x): table of 2^(i/64), short polynomial, result as a double-double.
 *
 *     x = (64 k + i) ln2/64 + r,  |r| <= ln2/128    exp(x) = 2^k 2^(i/64) exp(r)
 *
 * The product n ln2/64 is exact in its high part (38 fractional bits times a 17-bit n), so r is
 * known to 2^-74. */
#include "dse/math.h"
#include "math_internal.h"

#define TABLE_SIZE         64
#define TABLE_OVER_LN2     0x1.71547652b82fep+6 /* 64 / ln 2 */
#define LN2_OVER_TABLE_HI  0x1.62e42ffp-7       /* ln 2 / 64 = hi + lo, hi a multiple of 2^-38 */
#define LN2_OVER_TABLE_LO  (-0x1.718432a1b0e26p-41)
#define OVERFLOW_ARGUMENT  710.0         /* exp is infinite from 709.78 on */
#define ORDINARY_ARGUMENT  (dse_real)700 /* below it in size, exp and its 2^k are normal numbers */
#define BLOCK              16 /* numbers taken together: more would cost stack and bring nothing */
#define UNDERFLOW_ARGUMENT (-746.0) /* exp is zero from -745.13 down */

/* 2^(i/64) = hi + lo, each rounded to nearest. */
static const struct dse_dd power_table[TABLE_SIZE] = {
    {0x1p+0, 0x0p+0},
    {0x1.02c9a3e778061p+0, -0x1.19083535b085dp-56},
    {0x1.059b0d3158574p+0, 0x1.d73e2a475b465p-55},
    {0x1.0874518759bc8p+0, 0x1.186be4bb284ffp-57},
    {0x1.0b5586cf9890fp+0, 0x1.8a62e4adc610bp-54},
    {0x1.0e3ec32d3d1a2p+0, 0x1.03a1727c57b53p-59},
    {0x1.11301d0125b51p+0, -0x1.6c51039449b3ap-54},
    {0x1.1429aaea92dep+0, -0x1.32fbf9af1369ep-54},
    {0x1.172b83c7d517bp+0, -0x1.19041b9d78a76p-55},
    {0x1.1a35beb6fcb75p+0, 0x1.e5b4c7b4968e4p-55},
    {0x1.1d4873168b9aap+0, 0x1.e016e00a2643cp-54},
    {0x1.2063b88628cd6p+0, 0x1.dc775814a8495p-55},
    {0x1.2387a6e756238p+0, 0x1.9b07eb6c70573p-54},
    {0x1.26b4565e27cddp+0, 0x1.2bd339940e9d9p-55},
    {0x1.29e9df51fdee1p+0, 0x1.612e8afad1255p-55},
    {0x1.2d285a6e4030bp+0, 0x1.0024754db41d5p-54},
    {0x1.306fe0a31b715p+0, 0x1.6f46ad23182e4p-55},
    {0x1.33c08b26416ffp+0, 0x1.32721843659a6p-54},
    {0x1.371a7373aa9cbp+0, -0x1.63aeabf42eae2p-54},
    {0x1.3a7db34e59ff7p+0, -0x1.5e436d661f5e3p-56},
    {0x1.3dea64c123422p+0, 0x1.ada0911f09ebcp-55},
    {0x1.4160a21f72e2ap+0, -0x1.ef3691c309278p-58},
    {0x1.44e086061892dp+0, 0x1.89b7a04ef80dp-59},
    {0x1.486a2b5c13cdp+0, 0x1.3c1a3b69062fp-56},
    {0x1.4bfdad5362a27p+0, 0x1.d4397afec42e2p-56},
    {0x1.4f9b2769d2ca7p+0, -0x1.4b309d25957e3p-54},
    {0x1.5342b569d4f82p+0, -0x1.07abe1db13cadp-55},
    {0x1.56f4736b527dap+0, 0x1.9bb2c011d93adp-54},
    {0x1.5ab07dd485429p+0, 0x1.6324c054647adp-54},
    {0x1.5e76f15ad2148p+0, 0x1.ba6f93080e65ep-54},
    {0x1.6247eb03a5585p+0, -0x1.383c17e40b497p-54},
    {0x1.6623882552225p+0, -0x1.bb60987591c34p-54},
    {0x1.6a09e667f3bcdp+0, -0x1.bdd3413b26456p-54},
    {0x1.6dfb23c651a2fp+0, -0x1.bbe3a683c88abp-57},
    {0x1.71f75e8ec5f74p+0, -0x1.16e4786887a99p-55},
    {0x1.75feb564267c9p+0, -0x1.0245957316dd3p-54},
    {0x1.7a11473eb0187p+0, -0x1.41577ee04992fp-55},
    {0x1.7e2f336cf4e62p+0, 0x1.05d02ba15797ep-56},
    {0x1.82589994cce13p+0, -0x1.d4c1dd41532d8p-54},
    {0x1.868d99b4492edp+0, -0x1.fc6f89bd4f6bap-54},
    {0x1.8ace5422aa0dbp+0, 0x1.6e9f156864b27p-54},
    {0x1.8f1ae99157736p+0, 0x1.5cc13a2e3976cp-55},
    {0x1.93737b0cdc5e5p+0, -0x1.75fc781b57ebcp-57},
    {0x1.97d829fde4e5p+0, -0x1.d185b7c1b85d1p-54},
    {0x1.9c49182a3f09p+0, 0x1.c7c46b071f2bep-56},
    {0x1.a0c667b5de565p+0, -0x1.359495d1cd533p-54},
    {0x1.a5503b23e255dp+0, -0x1.d2f6edb8d41e1p-54},
    {0x1.a9e6b5579fdbfp+0, 0x1.0fac90ef7fd31p-54},
    {0x1.ae89f995ad3adp+0, 0x1.7a1cd345dcc81p-54},
    {0x1.b33a2b84f15fbp+0, -0x1.2805e3084d708p-57},
    {0x1.b7f76f2fb5e47p+0, -0x1.5584f7e54ac3bp-56},
    {0x1.bcc1e904bc1d2p+0, 0x1.23dd07a2d9e84p-55},
    {0x1.c199bdd85529cp+0, 0x1.11065895048ddp-55},
    {0x1.c67f12e57d14bp+0, 0x1.2884dff483cadp-54},
    {0x1.cb720dcef9069p+0, 0x1.503cbd1e949dbp-56},
    {0x1.d072d4a07897cp+0, -0x1.cbc3743797a9cp-54},
    {0x1.d5818dcfba487p+0, 0x1.2ed02d75b3707p-55},
    {0x1.da9e603db3285p+0, 0x1.c2300696db532p-54},
    {0x1.dfc97337b9b5fp+0, -0x1.1a5cd4f184b5cp-54},
    {0x1.e502ee78b3ff6p+0, 0x1.39e8980a9cc8fp-55},
    {0x1.ea4afa2a490dap+0, -0x1.e9c23179c2893p-54},
    {0x1.efa1bee615a27p+0, 0x1.dc7f486a4b6bp-54},
    {0x1.f50765b6e454p+0, 0x1.9d3e12dd8a18bp-54},
    {0x1.fa7c1819e90d8p+0, 0x1.74853f3a5931ep-55}};

struct dse_dd dse_exp_kernel(struct dse_dd x, int *k)
{
    double n = dse_nearest_integer(x.hi * TABLE_OVER_LN2);
    int index = (int)n & (TABLE_SIZE - 1);
    *k = ((int)n - index) / TABLE_SIZE;

    double r = x.hi - n * LN2_OVER_TABLE_HI; /* exact */
    double r_lo = x.lo - n * LN2_OVER_TABLE_LO;

    /* s = exp(r) - 1 by Taylor's series; the next term, r^7/5040, is below 2^-64. r_lo is up to
     * 2^-22 and so enters the polynomial as well. */
    double v = r + r_lo;
    double tail = 0.5 + v * (1.0 / 6 + v * (1.0 / 24 + v * (1.0 / 120 + v * (1.0 / 720))));
    double s = r + (r_lo + v * v * tail);

    /* 2^(i/64) (1 + s) */
    struct dse_dd power = power_table[index];
    return dse_fast_two_sum(power.hi, power.lo + power.hi * s);
}

double dse_exp_double(double x)
{
    if (x != x)
        return dse_nan();
    if (x > OVERFLOW_ARGUMENT)
        return dse_infinity();
    if (x < UNDERFLOW_ARGUMENT)
        return 0;
    int k;
    struct dse_dd m = dse_exp_kernel((struct dse_dd){x, 0}, &k);
    return dse_dd_scale(m, k);
}

dse_real dse_exp(dse_real x)
{
    return (dse_real)dse_exp_double((double)x);
}

/* The arithmetic of the kernel, step by step for all: no step waits for the one before it of the
 * same number, and a compiler may take two or more numbers at a time. */
static void exp_block(int n, const dse_real *x, dse_real *y)
{
    double steps[BLOCK], s[BLOCK];
    for (int i = 0; i < n; i++) {
        steps[i] = dse_nearest_integer((double)x[i] * TABLE_OVER_LN2);
        double r = (double)x[i] - steps[i] * LN2_OVER_TABLE_HI;
        double r_lo = 0 - steps[i] * LN2_OVER_TABLE_LO;
        double v = r + r_lo;
        double tail = 0.5 + v * (1.0 / 6 + v * (1.0 / 24 + v * (1.0 / 120 + v * (1.0 / 720))));
        s[i] = r + (r_lo + v * v * tail);
    }
    for (int i = 0; i < n; i++) {
        int step = (int)steps[i];
        struct dse_dd power = power_table[step & (TABLE_SIZE - 1)];
        double m = power.hi + (power.lo + power.hi * s[i]);
        /* k = (step - i)/64 goes into the exponent, 52 - 6 places up */
        uint64_t k = (uint64_t)(int64_t)(step - (step & (TABLE_SIZE - 1))) << 46;
        y[i] = (dse_real)(m * dse_from_bits(k + (UINT64_C(1023) << 52)));
    }
}

void dse_exp_many(int n, const dse_real *x, dse_real *y)
{
    for (int first = 0; first < n; first += BLOCK) {
        int count = n - first < BLOCK ? n - first : BLOCK;
        int ordinary = 1;
        for (int i = first; i < first + count; i++)
            ordinary &= dse_abs(x[i]) < ORDINARY_ARGUMENT;
        if (ordinary) {
            exp_block(count, x + first, y + first);
            continue;
        }
        for (int i = first; i < first + count; i++)
            y[i] = dse_exp(x[i]);
    }
}
