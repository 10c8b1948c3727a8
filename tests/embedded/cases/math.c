/* The elementary functions: a table of values, and digests over thousands of arguments. */
#include "dse/math.h"

#include "dse/random.h"
#include "math_bits.h"
#include "numbers.h"
#include "report.h"

#define BATCH 64

typedef dse_real (*function)(dse_real x);

struct range {
    const char *name;
    function f;
    dse_real low, high;
};

static const struct range ranges[] = {
    {"exp", dse_exp, -80, 80},
    {"exp of small", dse_exp, DSE_REAL(-1e-5), DSE_REAL(1e-5)},
    {"log", dse_log, 0, 1000},
    {"log near 1", dse_log, DSE_REAL(0.9), DSE_REAL(1.1)},
    {"sin", dse_sin, -10, 10},
    {"sin of large", dse_sin, DSE_REAL(1e6), DSE_REAL(1e12)},
    {"cos", dse_cos, -10, 10},
    {"cos of large", dse_cos, DSE_REAL(1e6), DSE_REAL(1e12)},
    {"tanh", dse_tanh, -25, 25},
    {"sigmoid", dse_sigmoid, -50, 50},
    {"sqrt", dse_sqrt, 0, DSE_REAL(1e20)},
};

static void functions(void)
{
    struct numbers numbers = {1};
    for (unsigned i = 0; i < sizeof ranges / sizeof ranges[0]; i++) {
        const struct range *range = &ranges[i];
        for (int batch = 0; batch < 4; batch++) {
            dse_real y[BATCH];
            for (int j = 0; j < BATCH; j++)
                y[j] = range->f(numbers_uniform(&numbers, range->low, range->high));
            report_digest(range->name, BATCH, y);
            report_vector(range->name, 2, y);
        }
    }
}

static void powers(void)
{
    struct numbers numbers = {2};
    dse_real z[BATCH];
    for (int j = 0; j < BATCH; j++) {
        dse_real x = numbers_uniform(&numbers, 0, 30);
        z[j] = dse_pow(x, numbers_uniform(&numbers, -20, 20));
    }
    report_digest("pow", BATCH, z);
    report_vector("pow", 8, z);
}

/* Infinities, zeros and the smallest numbers: where a soft-float library could differ. */
static void edges(void)
{
    const dse_real tiny = DSE_REAL_MIN * DSE_REAL_EPSILON;
    const dse_real y[] = {
        dse_exp(-1000),        dse_exp(1000),         dse_log(0),
        dse_log(-1),           dse_log(tiny),         dse_sqrt(tiny),
        dse_sqrt(-1),          dse_sin(tiny),         dse_pow(0, -1),
        dse_pow(tiny, 2),      dse_pow(-2, 3),        dse_pow(-2, DSE_REAL(0.5)),
        dse_tanh(-1000),       dse_sigmoid(-745),     dse_exp(-745),
        dse_log(DSE_REAL_MAX), DSE_REAL_MIN / 3,      tiny / 2,
        dse_cos(DSE_REAL_MAX), dse_sin(DSE_REAL_MAX),
    };
    report_vector("edge", (int)(sizeof y / sizeof y[0]), y);
}

static void random(void)
{
    struct dse_random random;
    dse_random_init(&random, 42, 7);
    report_bits("random bits", dse_random_bits(&random));
    dse_real y[BATCH];
    for (int j = 0; j < BATCH; j++)
        y[j] = (dse_real)dse_random_normal(&random);
    report_digest("random normal", BATCH, y);
    report_vector("random normal", 4, y);
}

int main(void)
{
    functions();
    powers();
    edges();
    random();
    const uint64_t checksum = math_bits_checksum();
    report_bits("checksum", checksum);
    report_check("the checksum is that of the unit test", checksum == MATH_BITS_EXPECTED);
    return report_verdict();
}
