/* Prescribed signals. */
#include "sim/signal.h"

#include "dse/math.h"
#include "dse/random.h"

#define REGISTER_BITS 11
#define PERIOD        2047 /* 2^11 - 1: the polynomial is primitive */

void sim_signal_init(struct sim_signal_source *source, const struct sim_signal *signal,
                     uint64_t seed, uint64_t stream)
{
    struct dse_random random;
    dse_random_init(&random, seed, stream);
    source->signal = *signal;
    source->bits = 1 + (uint32_t)(dse_random_bits(&random) % PERIOD);
    source->shifted = 0;
}

/* Feedback from x^11 and x^9. */
static void shift(struct sim_signal_source *source)
{
    uint32_t bits = source->bits;
    uint32_t feedback = ((bits >> (REGISTER_BITS - 1)) ^ (bits >> 8)) & 1u;
    source->bits = ((bits << 1) | feedback) & PERIOD;
    source->shifted++;
}

static double step_value(const struct sim_signal *signal, int64_t k)
{
    double value = signal->value;
    for (int i = 0; i < signal->n_steps && signal->steps[i].sample <= k; i++)
        value = signal->steps[i].value;
    return value;
}

double sim_signal_at_sample(struct sim_signal_source *source, int64_t k, double t)
{
    const struct sim_signal *signal = &source->signal;
    double rate;
    switch (signal->kind) {
    case SIM_STEPS:
        return step_value(signal, k);
    case SIM_SINUSOID:
        return sim_signal_sinusoid(signal, t, &rate);
    case SIM_PRBS:
        while (source->shifted < k / signal->bit_samples)
            shift(source);
        return signal->value + ((source->bits & 1u) != 0 ? signal->amplitude : -signal->amplitude);
    case SIM_CONSTANT:
        break;
    }
    return signal->value;
}

double sim_signal_sinusoid(const struct sim_signal *signal, double t, double *rate)
{
    double phase = signal->omega * t + signal->phase;
    *rate = signal->amplitude * signal->omega * dse_cos(phase);
    return signal->value + signal->amplitude * dse_sin(phase);
}
