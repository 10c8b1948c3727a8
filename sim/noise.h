/* Noise of the simulator: one independent random stream per channel.
 *
 * Stream of channel j: kind * 2^32 + j. Process and measurement noise are different kinds and every
 * channel has its own stream, so that switching one noise off, or changing the size of another
 * channel, changes no other number. */
#ifndef DSE_SIM_NOISE_H
#define DSE_SIM_NOISE_H

#include <stdbool.h>
#include <stdint.h>

#include "dse/plant.h"
#include "dse/random.h"

enum sim_distribution { SIM_NONE, SIM_UNIFORM, SIM_GAUSSIAN };

struct sim_noise {
    enum sim_distribution distribution;
    const double *scale; /* per channel, >= 0: bound (uniform) or standard deviation (Gaussian);
                          * may be NULL when the distribution is SIM_NONE */
    const double *limit; /* per channel, >= 0: Gaussian values beyond +-limit become +-limit; NULL:
                          * none do */
};

enum sim_noise_kind { SIM_NOISE_PROCESS = 1, SIM_NOISE_MEASUREMENT = 2, SIM_NOISE_MISSING = 3 };

#define SIM_NOISE_MAX_CHANNELS DSE_PLANT_MAX_OUTPUTS /* more than states */

struct sim_noise_source {
    enum sim_distribution distribution;
    int channels;
    double scale[SIM_NOISE_MAX_CHANNELS];
    bool limited;
    double limit[SIM_NOISE_MAX_CHANNELS];
    struct dse_random stream[SIM_NOISE_MAX_CHANNELS];
};

/* channels <= SIM_NOISE_MAX_CHANNELS; the scales are copied. */
void sim_noise_init(struct sim_noise_source *source, const struct sim_noise *noise, int channels,
                    uint64_t seed, enum sim_noise_kind kind);

/* The next value of every channel: uniform on [-scale, scale), N(0, scale^2) within its limit, or
 * 0. */
void sim_noise_draw(struct sim_noise_source *source, double *value);

#endif
