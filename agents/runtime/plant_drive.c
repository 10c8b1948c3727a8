/* From seconds and names to plant time and indices. */
#include "runtime/plant_drive.h"

#include <stdlib.h>
#include <string.h>

static int index_of(const struct dse_signal *signals, int count, const char *name)
{
    int i = 0;
    while (i < count && strcmp(signals[i].name, name) != 0)
        i++;
    return i;
}

static struct sim_pid pid_of(const struct scenario_pid *pid, double unit_s)
{
    return (struct sim_pid){.kp = pid->kp, .ti = pid->ti_s / unit_s, .td = pid->td_s / unit_s};
}

static struct sim_loop loop_of(const struct dse_plant *plant, const struct scenario_loop *loop)
{
    double unit_s = (double)plant->time_unit_s;
    struct sim_loop out = {.output = index_of(plant->outputs, plant->ny, loop->output),
                           .outer = pid_of(&loop->outer, unit_s),
                           .cascaded = loop->inner != NULL,
                           .low = loop->low,
                           .high = loop->high,
                           .lag = loop->lag_s / unit_s};
    if (out.cascaded)
        out.inner = pid_of(loop->inner, unit_s);
    return out;
}

/* Steps act from the first sample that is not before them; a rounding error does not count. */
static void fill_steps(const struct scenario_drive *drive, double period_s,
                       struct sim_signal_step *steps)
{
    for (unsigned i = 0; i < drive->steps_count; i++)
        steps[i] = (struct sim_signal_step){
            .sample = (int64_t)ceil(drive->steps[i].at_s / period_s - 1e-6),
            .value = drive->steps[i].value};
}

static unsigned count_steps(const struct scenario *scenario)
{
    unsigned count = 0;
    for (unsigned i = 0; i < scenario->plant.drive_count; i++)
        count += scenario->plant.drive[i].steps_count;
    return count;
}

static struct sim_signal signal_of(const struct scenario *scenario,
                                   const struct scenario_drive *drive,
                                   const struct sim_signal_step *steps)
{
    static const enum sim_signal_kind kinds[] = {[SCENARIO_CONSTANT] = SIM_CONSTANT,
                                                 [SCENARIO_STEPS] = SIM_STEPS,
                                                 [SCENARIO_SINUSOID] = SIM_SINUSOID,
                                                 [SCENARIO_PRBS] = SIM_PRBS};
    return (struct sim_signal){
        .kind = kinds[drive->signal],
        .value = drive->value,
        .amplitude = drive->amplitude,
        .omega = drive->omega * (double)scenario->process->time_unit_s,
        .phase = drive->phase,
        .bit_samples = llround(drive->bit_s / scenario->time.period_s),
        .steps = steps,
        .n_steps = (int)drive->steps_count,
    };
}

bool plant_drives_make(const struct scenario *scenario, struct plant_drives *drives)
{
    const struct dse_plant *plant = scenario->process;
    unsigned count = scenario->plant.drive_count;
    *drives = (struct plant_drives){.count = count};
    drives->drives = calloc((size_t)count + 1, sizeof *drives->drives);
    drives->loops = calloc((size_t)count + 1, sizeof *drives->loops);
    drives->steps = calloc((size_t)count_steps(scenario) + 1, sizeof *drives->steps);
    if (drives->drives == NULL || drives->loops == NULL || drives->steps == NULL) {
        plant_drives_free(drives);
        return false;
    }
    struct sim_signal_step *steps = drives->steps;
    for (unsigned i = 0; i < count; i++) {
        const struct scenario_drive *from = &scenario->plant.drive[i];
        struct sim_drive *to = &drives->drives[i];
        fill_steps(from, scenario->time.period_s, steps);
        to->input = index_of(plant->inputs, plant->nu, from->name);
        to->signal = signal_of(scenario, from, steps);
        steps += from->steps_count;
        if (from->loop != NULL) {
            drives->loops[i] = loop_of(plant, from->loop);
            to->loop = &drives->loops[i];
        }
    }
    return true;
}

void plant_drives_free(struct plant_drives *drives)
{
    free(drives->steps);
    free(drives->loops);
    free(drives->drives);
    *drives = (struct plant_drives){0};
}
