/* Draws of the simulator's noise. */
#include "sim/noise.h"

#include <stddef.h>

void sim_noise_init(struct sim_noise_source *source, const struct sim_noise *noise, int channels,
                    uint64_t seed, enum sim_noise_kind kind)
{
    source->distribution = noise->distribution;
    source->channels = channels;
    source->limited = noise->distribution == SIM_GAUSSIAN && noise->limit != NULL;
    for (int j = 0; j < channels; j++) {
        source->scale[j] = noise->distribution == SIM_NONE ? 0 : noise->scale[j];
        source->limit[j] = noise->limit != NULL ? noise->limit[j] : 0;
        dse_random_init(&source->stream[j], seed, ((uint64_t)kind << 32) + (uint64_t)j);
    }
}

static double draw(enum sim_distribution distribution, struct dse_random *random)
{
    switch (distribution) {
    case SIM_UNIFORM:
        return 2 * dse_random_uniform(random) - 1;
    case SIM_GAUSSIAN:
        return dse_random_normal(random);
    case SIM_NONE:
        break;
    }
    return 0;
}

static double within(const struct sim_noise_source *source, int j, double value)
{
    const double limit = source->limit[j];
    if (!source->limited || (value <= limit && value >= -limit))
        return value;
    return value > 0 ? limit : -limit;
}

void sim_noise_draw(struct sim_noise_source *source, double *value)
{
    for (int j = 0; j < source->channels; j++)
        value[j] =
            within(source, j, source->scale[j] * draw(source->distribution, &source->stream[j]));
}
