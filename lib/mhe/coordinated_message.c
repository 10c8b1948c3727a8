/* Coordinated moving horizon estimation: what stands in messages. */
#include "coordinated_internal.h"

static long power(int bit)
{
    return 1L << (bit % DSE_MHE_BITS_PER_REAL);
}

void mhe_bits_clear(int count, dse_real *words)
{
    for (int i = 0; i < DSE_MHE_BIT_WORDS(count); i++)
        words[i] = 0;
}

void mhe_bit_set(dse_real *words, int bit)
{
    if (!mhe_bit_get(words, bit))
        words[bit / DSE_MHE_BITS_PER_REAL] += (dse_real)power(bit);
}

bool mhe_bit_get(const dse_real *words, int bit)
{
    const long word = mhe_header_get(words, bit / DSE_MHE_BITS_PER_REAL);
    return word >= 0 && word / power(bit) % 2 == 1;
}

long mhe_header_get(const dse_real *message, int index)
{
    const dse_real value = message[index];
    if (!(value >= 0) || value > (dse_real)MHE_SAMPLE_WRAP)
        return -1;
    const long number = (long)value;
    return (dse_real)number == value ? number : -1;
}

const char *dse_mhe_status_text(enum dse_mhe_status status)
{
    static const char *const text[] = {"starting",   "converged",  "premature", "held",
                                       "local only", "infeasible", "singular"};
    const unsigned count = sizeof text / sizeof text[0];
    return (unsigned)status < count ? text[status] : "unknown"; /* enums are unsigned on ARM */
}
