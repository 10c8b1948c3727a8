/* Signals that an experiment prescribes: for a plant's input, or for the set point of a loop.
 *
 *     constant   s = value
 *     steps      s = value, from the sample of each step on the step's value
 *     sinusoid   s = value + amplitude sin(omega t + phase), t in the plant's time
 *     prbs       s = value +- amplitude, a new bit every bit_samples samples
 *
 * The pseudo-random binary sequence is that of a shift register of 11 bits, x^11 + x^9 + 1, which
 * repeats after 2047 bits; it begins where the seed puts it, so that different inputs of a run get
 * shifted sequences with next to no correlation. */
#ifndef DSE_SIM_SIGNAL_H
#define DSE_SIM_SIGNAL_H

#include <stdbool.h>
#include <stdint.h>

enum sim_signal_kind { SIM_CONSTANT, SIM_STEPS, SIM_SINUSOID, SIM_PRBS };

struct sim_signal_step {
    int64_t sample; /* ascending */
    double value;   /* from this sample on */
};

struct sim_signal {
    enum sim_signal_kind kind;
    double value;                        /* mean of sinusoid and prbs, before the first step */
    double amplitude;                    /* sinusoid, prbs */
    double omega;                        /* sinusoid: per plant time unit, in rad */
    double phase;                        /* sinusoid: rad */
    int64_t bit_samples;                 /* prbs, >= 1 */
    const struct sim_signal_step *steps; /* n_steps, ascending in sample; must outlive the signal */
    int n_steps;
};

/* A signal under way. */
struct sim_signal_source {
    struct sim_signal signal;
    uint32_t bits;   /* shift register, never 0 */
    int64_t shifted; /* how often */
};

/* stream: which input of the run; streams of one seed differ. */
void sim_signal_init(struct sim_signal_source *source, const struct sim_signal *signal,
                     uint64_t seed, uint64_t stream);

/* The value at sample k, time t of that sample. Samples are asked for in ascending order. */
double sim_signal_at_sample(struct sim_signal_source *source, int64_t k, double t);

/* Value and time derivative at any time t of a sinusoid. */
double sim_signal_sinusoid(const struct sim_signal *signal, double t, double *rate);

#endif
