/* From signals and loops to the plant's inputs. */
#include "sim/drive.h"

#include <stdlib.h>
#include <string.h>

#include "dse/math.h"
#include "sim/integrator_internal.h"

/* Streams of the seed beside those of the noise (sim/noise.h). */
#define STREAM_OF_DRIVES 4

struct channel {
    int input;
    int rate; /* the input that is its derivative, -1: none */
    struct sim_signal_source source;
    struct sim_signal_step *steps; /* own copy */
    bool looped;
    struct sim_loop loop;
    struct sim_loop_state state;
};

struct sim_driver {
    int count;
    double period;
    bool moves;
    struct channel channel[DSE_PLANT_MAX_INPUTS];
};

static bool finite_signal(const struct sim_signal *signal)
{
    bool finite = dse_is_finite(signal->value) && dse_is_finite(signal->amplitude) &&
                  dse_is_finite(signal->omega) && dse_is_finite(signal->phase);
    for (int i = 0; i < signal->n_steps; i++)
        finite = finite && dse_is_finite(signal->steps[i].value);
    return finite;
}

static bool ascending(const struct sim_signal *signal)
{
    for (int i = 1; i < signal->n_steps; i++)
        if (signal->steps[i].sample <= signal->steps[i - 1].sample)
            return false;
    return true;
}

static bool good_pid(const struct sim_pid *pid)
{
    return dse_is_finite(pid->kp) && dse_is_finite(pid->ti) && dse_is_finite(pid->td) &&
           pid->ti >= 0 && pid->td >= 0;
}

static bool check_loop(const struct dse_plant *plant, const struct sim_loop *loop,
                       const char *input, char *reason, int size)
{
    if (loop->output < 0 || loop->output >= plant->ny)
        return sim_reason(reason, size, "; the loop of %s has no output", input);
    if (!good_pid(&loop->outer) || !good_pid(&loop->inner) || !(loop->lag >= 0) ||
        !dse_is_finite(loop->lag))
        return sim_reason(reason, size, "; a setting of the loop of %s is negative or not finite",
                          input);
    if (!(loop->low < loop->high))
        return sim_reason(reason, size, "; the limits of the loop of %s are not in order", input);
    return true;
}

/* rates[j] of the form is the derivative of input j. */
static bool is_a_rate(const struct dse_plant *plant, const int *rates, int input)
{
    for (int j = 0; rates != NULL && j < plant->nu; j++)
        if (rates[j] == input)
            return true;
    return false;
}

static bool check_drive(const struct dse_plant *plant, const int *rates,
                        const struct sim_drive *drives, int i, char *reason, int size)
{
    const struct sim_drive *drive = &drives[i];
    if (drive->input < 0 || drive->input >= plant->nu)
        return sim_reason(reason, size, "; there is no input %d", drive->input);
    const char *name = plant->inputs[drive->input].name;
    for (int other = 0; other < i; other++)
        if (drives[other].input == drive->input)
            return sim_reason(reason, size, "; %s is driven twice", name);
    if (is_a_rate(plant, rates, drive->input))
        return sim_reason(reason, size, "; %s is a time derivative and follows by itself", name);
    if (!finite_signal(&drive->signal) || !ascending(&drive->signal))
        return sim_reason(reason, size,
                          "; the signal of %s has a number that is not finite or steps that do "
                          "not ascend",
                          name);
    if (drive->signal.kind == SIM_PRBS && drive->signal.bit_samples < 1)
        return sim_reason(reason, size, "; the bits of %s are shorter than a sample", name);
    return drive->loop == NULL || check_loop(plant, drive->loop, name, reason, size);
}

static bool fill(struct sim_driver *driver, const int *rates, const double *u,
                 const struct sim_drive *drive, uint64_t seed)
{
    struct channel *channel = &driver->channel[driver->count++];
    struct sim_signal signal = drive->signal;
    if (signal.n_steps > 0) {
        channel->steps = calloc((size_t)signal.n_steps, sizeof *channel->steps);
        if (channel->steps == NULL)
            return false;
        memcpy(channel->steps, signal.steps, (size_t)signal.n_steps * sizeof *channel->steps);
        signal.steps = channel->steps;
    }
    channel->input = drive->input;
    channel->rate = rates != NULL ? rates[drive->input] : -1;
    sim_signal_init(&channel->source, &signal, seed,
                    ((uint64_t)STREAM_OF_DRIVES << 32) + (uint64_t)drive->input);
    channel->looped = drive->loop != NULL;
    if (channel->looped) {
        channel->loop = *drive->loop;
        sim_loop_init(&channel->state, u[drive->input]);
    }
    driver->moves = driver->moves || (!channel->looped && signal.kind == SIM_SINUSOID);
    return true;
}

struct sim_driver *sim_driver_create(const struct dse_plant *plant,
                                     const struct dse_normal_form *form, const double *u,
                                     const struct sim_drive *drives, int n_drives, double period,
                                     uint64_t seed, char *reason, int reason_size)
{
    const int *rates = form != NULL ? form->rates : NULL;
    for (int i = 0; i < n_drives; i++)
        if (!check_drive(plant, rates, drives, i, reason, reason_size))
            return NULL;
    struct sim_driver *driver = calloc(1, sizeof *driver);
    bool ok = driver != NULL;
    if (ok)
        driver->period = period;
    for (int i = 0; ok && i < n_drives; i++)
        ok = fill(driver, rates, u, &drives[i], seed);
    if (ok)
        return driver;
    sim_driver_destroy(driver);
    sim_reason(reason, reason_size, "; no memory");
    return NULL;
}

void sim_driver_destroy(struct sim_driver *driver)
{
    for (int i = 0; driver != NULL && i < driver->count; i++)
        free(driver->channel[i].steps);
    free(driver);
}

void sim_driver_prescribe(struct sim_driver *driver, int64_t k, double *u)
{
    double t = (double)k * driver->period;
    for (int i = 0; i < driver->count; i++) {
        struct channel *channel = &driver->channel[i];
        if (!channel->looped)
            u[channel->input] = sim_signal_at_sample(&channel->source, k, t);
        if (channel->rate >= 0)
            u[channel->rate] = 0;
    }
    sim_driver_move(driver, t, u);
}

void sim_driver_control(struct sim_driver *driver, int64_t k, const double *y, const bool *valid,
                        double *u)
{
    double t = (double)k * driver->period;
    for (int i = 0; i < driver->count; i++) {
        struct channel *channel = &driver->channel[i];
        if (!channel->looped)
            continue;
        double set_point = sim_signal_at_sample(&channel->source, k, t);
        int output = channel->loop.output;
        u[channel->input] = sim_loop_step(&channel->loop, &channel->state, driver->period,
                                          set_point, y[output], valid[output]);
    }
}

bool sim_driver_moves(const struct sim_driver *driver)
{
    return driver->moves;
}

void sim_driver_move(const struct sim_driver *driver, double t, double *u)
{
    for (int i = 0; driver->moves && i < driver->count; i++) {
        const struct channel *channel = &driver->channel[i];
        const struct sim_signal *signal = &channel->source.signal;
        if (channel->looped || signal->kind != SIM_SINUSOID)
            continue;
        double rate;
        u[channel->input] = sim_signal_sinusoid(signal, t, &rate);
        if (channel->rate >= 0)
            u[channel->rate] = rate;
    }
}
