/* The simulated plant of a scenario as a source of samples. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/clock.h"
#include "runtime/plant_drive.h"
#include "sim/simulator.h"

struct plant {
    struct simulator *sim;
    const struct dse_plant *process;
    dse_real *values, *prepared;
    double *u;     /* constant inputs; of the estimators from the first sample on */
    double *truth; /* the states, then the inputs that estimators do not know */
};

/* What estimators are told of the inputs: nominal values of those that they do not know. */
static void tell(struct plant *plant)
{
    const struct dse_plant *process = plant->process;
    const double *u = sim_input(plant->sim);
    const int known = process->nu - process->n_unknown;
    for (int i = 0; i < process->nu; i++)
        plant->u[i] = i < known ? u[i] : (double)process->inputs[i].nominal;
    for (int i = 0; i < process->nx; i++)
        plant->truth[i] = sim_state(plant->sim)[i];
    for (int i = known; i < process->nu; i++)
        plant->truth[process->nx + i - known] = u[i];
}

static bool next(void *self, int64_t k, struct sample_data *data, char *reason, int size)
{
    struct plant *plant = self;
    if (k > 0 && !sim_step(plant->sim, reason, size))
        return false;
    data->t = sim_time(plant->sim);
    tell(plant);
    data->x = plant->truth;
    data->u = plant->u;
    data->y = sim_output(plant->sim);
    data->valid = sim_output_valid(plant->sim);
    return true;
}

static void destroy(void *self)
{
    struct plant *plant = self;
    if (plant->sim != NULL)
        sim_destroy(plant->sim);
    free(plant->values);
    free(plant->prepared);
    free(plant->u);
    free(plant->truth);
    free(plant);
}

static struct sim_noise noise_of(const struct scenario_noise *noise)
{
    static const enum sim_distribution kinds[] = {
        [SCENARIO_NONE] = SIM_NONE,
        [SCENARIO_UNIFORM] = SIM_UNIFORM,
        [SCENARIO_GAUSSIAN] = SIM_GAUSSIAN,
    };
    return (struct sim_noise){
        .distribution = kinds[noise->distribution], .scale = noise->scale, .limit = noise->limit};
}

static const struct dse_parameter_set *set_of(const struct scenario *scenario)
{
    const struct dse_plant *process = scenario->process;
    for (int i = 0; scenario->plant.set != NULL && i < process->n_sets; i++)
        if (strcmp(process->sets[i].name, scenario->plant.set) == 0)
            return &process->sets[i];
    return &process->sets[0];
}

static enum sim_integrator integrator_of(const struct scenario_integrator *integrator)
{
    static const enum sim_integrator kinds[] = {
        [SCENARIO_CVODE] = SIM_CVODE, [SCENARIO_RK4] = SIM_RK4, [SCENARIO_FLOW] = SIM_FLOW};
    return kinds[integrator->kind];
}

static void fill_inputs(const struct scenario *scenario, double *u)
{
    for (int i = 0; i < scenario->process->nu; i++)
        u[i] = scenario->plant.inputs != NULL ? scenario->plant.inputs[i]
                                              : (double)scenario->process->inputs[i].nominal;
}

/* Sensors that are out, in samples; NULL without memory. */
static struct sim_outage *outages_of(const struct scenario *scenario)
{
    const struct scenario_noises *noise = &scenario->noise;
    struct sim_outage *outages = calloc((size_t)noise->dead_count + 1, sizeof *outages);
    for (unsigned k = 0; outages != NULL && k < noise->dead_count; k++) {
        const struct scenario_dead_sensor *dead = &noise->dead[k];
        while (strcmp(scenario->process->outputs[outages[k].output].name, dead->output) != 0)
            outages[k].output++;
        outages[k].first = scenario_sample_at(scenario, dead->start_s);
        outages[k].end = dead->end_s > 0 ? scenario_sample_at(scenario, dead->end_s) : INT64_MAX;
    }
    return outages;
}

bool plant_source(const struct scenario *scenario, struct sample_source *source,
                  struct error *error)
{
    const struct dse_plant *process = scenario->process;
    const struct scenario_integrator *integrator = &scenario->plant.integrator;
    if (integrator->kind == SCENARIO_FLOW && scenario->plant.x0 != NULL)
        return error_set(error, "plant.x0: a flow starts as the run that is called as plant.set");
    struct plant *plant = calloc(1, sizeof *plant);
    if (plant == NULL)
        return error_set(error, "out of memory");
    plant->values = calloc((size_t)process->n_parameters + 1, sizeof *plant->values);
    plant->prepared = calloc((size_t)process->prepared_size + 1, sizeof *plant->prepared);
    plant->u = calloc((size_t)process->nu + 1, sizeof *plant->u);
    plant->truth = calloc((size_t)process->nx + (size_t)process->n_unknown, sizeof *plant->truth);
    plant->process = process;
    char reason[256] = "out of memory";
    struct plant_drives drives = {0};
    struct sim_outage *outages = outages_of(scenario);
    bool ok = outages != NULL && plant->values != NULL && plant->prepared != NULL &&
              plant->u != NULL && plant->truth != NULL && plant_drives_make(scenario, &drives) &&
              scenario_prepare_plant(scenario, NULL, plant->values, plant->prepared, error);
    if (ok) {
        fill_inputs(scenario, plant->u);
        struct sim_config config = {
            .plant = process,
            .prepared = plant->prepared,
            .x0 = scenario->plant.x0 != NULL ? scenario->plant.x0 : set_of(scenario)->x0,
            .u = plant->u,
            .drives = drives.drives,
            .n_drives = (int)drives.count,
            .period = scenario_period(scenario),
            .integrator = integrator_of(integrator),
            .flow_run = (int)(set_of(scenario) - process->sets), /* in the same order */
            .rtol = integrator->rtol > 0 ? integrator->rtol : 1e-10,
            .atol = integrator->atol > 0 ? integrator->atol : 1e-12,
            .process = noise_of(&scenario->noise.process),
            .measurement = noise_of(&scenario->noise.measurement),
            .missing = scenario->noise.missing,
            .outages = outages,
            .n_outages = (int)scenario->noise.dead_count,
            .seed = scenario->seed,
        };
        plant->sim = sim_create(&config, reason, (int)sizeof reason);
        ok = plant->sim != NULL;
    }
    plant_drives_free(&drives);
    free(outages);
    if (!ok) {
        destroy(plant);
        return error_set(error, "cannot set up the plant %s: %s", process->name, reason);
    }
    source->self = plant;
    source->next = next;
    source->destroy = destroy;
    return true;
}
