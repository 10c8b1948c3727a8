/* The true plant, sample by sample. */
#include "sim/simulator.h"

#include <stdlib.h>
#include <string.h>

#include "dse/math.h"
#include "dse/ode.h"
#include "sim/flow_modes.h"
#include "sim/integrator_internal.h"

#define DEFAULT_RTOL 1e-10
#define DEFAULT_ATOL 1e-12

struct simulator {
    struct sim_field field;
    const dse_real *prepared;
    enum sim_integrator integrator;
    struct sim_cvode *cvode;     /* NULL with SIM_RK4 and with a discrete model */
    struct sim_driver *driver;   /* NULL: constant inputs */
    struct sim_flow_plant *flow; /* NULL unless SIM_FLOW */
    double period;
    int64_t sample;
    struct sim_noise_source process;
    struct sim_noise_source measurement;
    struct dse_random missing_stream[DSE_PLANT_MAX_OUTPUTS];
    double missing;
    struct sim_outage *outages; /* n_outages */
    int n_outages;
    double x[DSE_PLANT_MAX_STATES];
    double u[DSE_PLANT_MAX_INPUTS];
    bool jumped;                    /* u at the latest sample is not where it was going */
    double w[DSE_PLANT_MAX_STATES]; /* of this sample */
    double y[DSE_PLANT_MAX_OUTPUTS];
    bool valid[DSE_PLANT_MAX_OUTPUTS];
    double scratch[DSE_RK4_SCRATCH(DSE_PLANT_MAX_STATES)];
};

static bool check_values(const struct dse_signal *signals, const char *what, const double *values,
                         int n, char *reason, int size)
{
    if (n > 0 && values == NULL)
        return sim_reason(reason, size, "; %s is missing", what);
    for (int j = 0; j < n; j++)
        if (!dse_is_finite(values[j]))
            return sim_reason(reason, size, "; %s of %s is not finite", what, signals[j].name);
    return true;
}

static bool check_noise(const struct sim_noise *noise, const struct dse_signal *signals,
                        const char *what, int n, char *reason, int size)
{
    if (noise->distribution == SIM_NONE)
        return true;
    if (!check_values(signals, what, noise->scale, n, reason, size))
        return false;
    for (int j = 0; j < n; j++)
        if (noise->scale[j] < 0 || (noise->limit != NULL && !(noise->limit[j] >= 0)))
            return sim_reason(reason, size, "; %s of %s is negative", what, signals[j].name);
    return true;
}

static bool check_dimensions(const struct dse_plant *plant, const struct dse_model *model,
                             char *reason, int size)
{
    if (plant->nx < 1 || plant->nx > DSE_PLANT_MAX_STATES || plant->nu < 0 ||
        plant->nu > DSE_PLANT_MAX_INPUTS || plant->ny < 0 || plant->ny > DSE_PLANT_MAX_OUTPUTS)
        return sim_reason(
            reason, size,
            "; %d states, %d inputs, %d outputs are outside 1 to %d, 0 to %d, 0 to %d", plant->nx,
            plant->nu, plant->ny, DSE_PLANT_MAX_STATES, DSE_PLANT_MAX_INPUTS,
            DSE_PLANT_MAX_OUTPUTS);
    if (model->nx != plant->nx || model->nu != plant->nu || model->ny != plant->ny)
        return sim_reason(reason, size, "; the model's dimensions are not those of the plant");
    if (model->time != DSE_CONTINUOUS && model->time != DSE_DISCRETE)
        return sim_reason(reason, size,
                          "; the model is neither a differential nor a difference equation");
    return true;
}

static bool check_numbers(const struct sim_config *config, char *reason, int size)
{
    const struct dse_plant *plant = config->plant;
    if (!(config->period > 0) || !dse_is_finite(config->period))
        return sim_reason(reason, size, "; the sampling period %g is not positive", config->period);
    if (!(config->rtol >= 0) || !dse_is_finite(config->rtol) || !(config->atol >= 0) ||
        !dse_is_finite(config->atol))
        return sim_reason(reason, size, "; the tolerances rtol %g, atol %g are not both positive",
                          config->rtol, config->atol);
    if (!(config->missing >= 0 && config->missing <= 1))
        return sim_reason(reason, size, "; the probability %g of a missing value is not in [0, 1]",
                          config->missing);
    for (int k = 0; k < config->n_outages; k++)
        if (config->outages[k].output < 0 || config->outages[k].output >= plant->ny)
            return sim_reason(reason, size, "; there is no output %d to be out",
                              config->outages[k].output);
    return check_values(plant->states, "initial value", config->x0, plant->nx, reason, size) &&
           check_values(plant->inputs, "constant value", config->u, plant->nu, reason, size) &&
           check_noise(&config->process, plant->states, "process noise", plant->nx, reason, size) &&
           check_noise(&config->measurement, plant->outputs, "measurement noise", plant->ny, reason,
                       size);
}

/* Whether the inputs of t_k differ from what the sample before ends with. */
static bool inputs_jump(const struct simulator *sim, double t, const double *u)
{
    double expected[DSE_PLANT_MAX_INPUTS];
    memcpy(expected, sim->u, sizeof expected);
    sim_driver_move(sim->driver, t, expected);
    for (int j = 0; j < sim->field.model.nu; j++)
        if (dse_abs(u[j] - expected[j]) > 0)
            return true;
    return false;
}

/* y = h(t_k, x, u), finite. */
static bool evaluate_outputs(struct simulator *sim, double t, const double *x, const double *u,
                             double *y, char *reason, int size)
{
    const struct dse_model *model = &sim->field.model;
    if (sim->flow != NULL) {
        sim_flow_plant_outputs(sim->flow, y);
    } else if (model->ny > 0) {
        enum dse_status status = model->h(model, t, x, u, y);
        if (status != DSE_OK)
            return sim_reason(reason, size, "; the outputs: %s", dse_status_text(status));
    }
    for (int j = 0; j < model->ny; j++)
        if (!dse_is_finite(y[j]))
            return sim_reason(reason, size, "; output %s is not finite",
                              sim->field.plant->outputs[j].name);
    return true;
}

/* A value is missing by chance or because its sensor is out; the draws are the same either way. */
static void draw_valid(struct simulator *sim, int64_t k)
{
    for (int j = 0; j < sim->field.model.ny; j++)
        sim->valid[j] = dse_random_uniform(&sim->missing_stream[j]) >= sim->missing;
    for (int i = 0; i < sim->n_outages; i++)
        if (k >= sim->outages[i].first && k < sim->outages[i].end)
            sim->valid[sim->outages[i].output] = false;
}

/* The states that follow from the others and the inputs. */
static void complete(const struct simulator *sim, double t, const double *u, double *x)
{
    if (sim->field.plant->complete != NULL)
        sim->field.plant->complete(sim->prepared, t, u, x);
}

/* Sample k with the state x: inputs, y = h(t_k, x, u) + v_k, and w_k. Changes nothing when h
 * fails. */
static bool enter_sample(struct simulator *sim, int64_t k, const double *x, char *reason, int size)
{
    const struct dse_model *model = &sim->field.model;
    double y[DSE_PLANT_MAX_OUTPUTS] = {0};
    double v[DSE_PLANT_MAX_OUTPUTS];
    double u[DSE_PLANT_MAX_INPUTS];
    double whole[DSE_PLANT_MAX_STATES];
    double t = (double)k * sim->period;
    memcpy(u, sim->u, sizeof u);
    memcpy(whole, x, (size_t)model->nx * sizeof *x);
    if (sim->driver != NULL)
        sim_driver_prescribe(sim->driver, k, u);
    complete(sim, t, u, whole);
    if (!evaluate_outputs(sim, t, whole, u, y, reason, size))
        return false;
    sim_noise_draw(&sim->process, sim->w);
    sim_noise_draw(&sim->measurement, v);
    for (int j = 0; j < model->ny; j++)
        sim->y[j] = y[j] + v[j];
    draw_valid(sim, k);
    if (sim->driver != NULL) {
        sim_driver_control(sim->driver, k, sim->y, sim->valid, u);
        sim->jumped = inputs_jump(sim, t, u);
        complete(sim, t, u, whole);
    }
    memcpy(sim->u, u, sizeof u);
    memcpy(sim->x, whole, (size_t)model->nx * sizeof *whole);
    sim->sample = k;
    return true;
}

static bool is_discrete(const struct simulator *sim)
{
    return sim->field.model.time == DSE_DISCRETE;
}

static bool copy_outages(struct simulator *sim, const struct sim_config *config, char *reason,
                         int size)
{
    sim->outages = calloc((size_t)config->n_outages + 1, sizeof *sim->outages);
    if (sim->outages == NULL)
        return sim_reason(reason, size, "; no memory");
    for (int k = 0; k < config->n_outages; k++)
        sim->outages[k] = config->outages[k];
    sim->n_outages = config->n_outages;
    return true;
}

static void copy_config(struct simulator *sim, const struct sim_config *config)
{
    const struct dse_plant *plant = config->plant;
    sim->prepared = config->prepared;
    sim->integrator = config->integrator;
    sim->period = config->period;
    memcpy(sim->x, config->x0, (size_t)plant->nx * sizeof *sim->x);
    if (plant->nu > 0)
        memcpy(sim->u, config->u, (size_t)plant->nu * sizeof *sim->u);
    sim_noise_init(&sim->process, &config->process, plant->nx, config->seed, SIM_NOISE_PROCESS);
    sim_noise_init(&sim->measurement, &config->measurement, plant->ny, config->seed,
                   SIM_NOISE_MEASUREMENT);
    sim->missing = config->missing;
    for (int j = 0; j < plant->ny; j++)
        dse_random_init(&sim->missing_stream[j], config->seed,
                        ((uint64_t)SIM_NOISE_MISSING << 32) + (uint64_t)j);
}

static bool create_cvode(struct simulator *sim, const struct sim_config *config, char *reason,
                         int size)
{
    double rtol = config->rtol > 0 ? config->rtol : DEFAULT_RTOL;
    double atol = config->atol > 0 ? config->atol : DEFAULT_ATOL;
    sim->cvode = sim_cvode_create(&sim->field, sim->x, rtol, atol);
    return sim->cvode != NULL || sim_reason(reason, size, "; CVODE cannot be set up");
}

/* The fields at the start of the run; x is what they are in the model's coordinates. */
static bool create_flow(struct simulator *sim, const struct sim_config *config, char *reason,
                        int size)
{
    sim->flow = sim_flow_plant_create(config->plant->name, config->flow_run);
    if (sim->flow == NULL)
        return sim_reason(reason, size, "; there is no flow behind its model, or no memory");
    if (config->process.distribution != SIM_NONE)
        return sim_reason(reason, size, "; there is no process noise in a simulated flow");
    sim_flow_plant_state(sim->flow, sim->x);
    return true;
}

static bool create_integrator(struct simulator *sim, const struct sim_config *config, char *reason,
                              int size)
{
    switch (sim->integrator) {
    case SIM_FLOW:
        return create_flow(sim, config, reason, size);
    case SIM_RK4:
        return true;
    default:
        return sim->field.model.time == DSE_DISCRETE || create_cvode(sim, config, reason, size);
    }
}

static bool create_driver(struct simulator *sim, const struct sim_config *config, char *reason,
                          int size)
{
    const struct dse_plant *plant = config->plant;
    struct dse_normal_form form = {0};
    if (config->n_drives == 0)
        return true;
    if (plant->normal_form != NULL)
        plant->normal_form(config->prepared, &form);
    sim->driver =
        sim_driver_create(plant, plant->normal_form != NULL ? &form : NULL, sim->u, config->drives,
                          config->n_drives, sim->period, config->seed, reason, size);
    sim->field.driver = sim->driver;
    return sim->driver != NULL;
}

static bool set_up(struct simulator *sim, const struct sim_config *config, char *reason, int size)
{
    struct sim_field *field = &sim->field;
    field->plant = config->plant;
    field->u = sim->u;
    field->w = sim->w;
    config->plant->model(config->prepared, &field->model);
    if (!check_dimensions(config->plant, &field->model, reason, size) ||
        !check_numbers(config, reason, size))
        return false;
    copy_config(sim, config);
    return copy_outages(sim, config, reason, size) && create_driver(sim, config, reason, size) &&
           create_integrator(sim, config, reason, size) &&
           enter_sample(sim, 0, sim->x, reason, size);
}

struct simulator *sim_create(const struct sim_config *config, char *reason, int reason_size)
{
    char detail[512] = "";
    struct simulator *sim = calloc(1, sizeof *sim);
    if (sim != NULL && set_up(sim, config, detail, (int)sizeof detail))
        return sim;
    if (reason_size > 0)
        reason[0] = '\0';
    sim_reason(reason, reason_size, "plant %s cannot be simulated%s", config->plant->name,
               sim == NULL ? "; no memory" : detail);
    sim_destroy(sim);
    return NULL;
}

void sim_destroy(struct simulator *sim)
{
    if (sim == NULL)
        return;
    sim_cvode_destroy(sim->cvode);
    sim_driver_destroy(sim->driver);
    sim_flow_plant_destroy(sim->flow);
    free(sim->outages);
    free(sim);
}

int64_t sim_sample(const struct simulator *sim)
{
    return sim->sample;
}

double sim_time(const struct simulator *sim)
{
    return (double)sim->sample * sim->period;
}

const double *sim_state(const struct simulator *sim)
{
    return sim->x;
}

const double *sim_input(const struct simulator *sim)
{
    return sim->u;
}

const double *sim_output(const struct simulator *sim)
{
    return sim->y;
}

const bool *sim_output_valid(const struct simulator *sim)
{
    return sim->valid;
}

static bool integrate_rk4(struct simulator *sim, double t, double *x, char *reason, int size)
{
    sim->field.fault = DSE_OK;
    enum dse_status status = dse_rk4_step(sim_field_rhs, &sim->field, t, sim->period,
                                          sim->field.model.nx, x, sim->scratch);
    if (status == DSE_OK)
        return true;
    if (sim->field.fault == DSE_OK)
        return sim_reason(reason, size, "; %s", dse_status_text(status));
    sim_field_explain(&sim->field, reason, size);
    return false;
}

/* x_(k+1) = f(t_k, x_k, u_k) + w_k in place: the field is the step itself. */
static bool step_discrete(struct simulator *sim, double t, double *x, char *reason, int size)
{
    double next[DSE_PLANT_MAX_STATES];
    sim->field.fault = DSE_OK;
    if (sim_field_rhs(&sim->field, t, x, next) != DSE_OK) {
        sim_field_explain(&sim->field, reason, size);
        return false;
    }
    memcpy(x, next, (size_t)sim->field.model.nx * sizeof *x);
    return true;
}

static bool check_state(const struct simulator *sim, const double *x, char *reason, int size)
{
    for (int j = 0; j < sim->field.model.nx; j++)
        if (!dse_is_finite(x[j]))
            return sim_reason(reason, size, "; %s is not finite", sim->field.plant->states[j].name);
    return true;
}

/* x(t_k) -> x(t_(k+1)) in place. */
static bool integrate(struct simulator *sim, double *x, char *reason, int size)
{
    double t = sim_time(sim);
    double t1 = (double)(sim->sample + 1) * sim->period;
    if (sim->flow != NULL) {
        sim_flow_plant_advance(sim->flow, sim->period);
        sim_flow_plant_state(sim->flow, x);
        return check_state(sim, x, reason, size);
    }
    if (is_discrete(sim))
        return step_discrete(sim, t, x, reason, size);
    /* f + w jumps at every sample with held noise, and where an input does */
    bool jumps = sim->process.distribution != SIM_NONE || sim->jumped;
    if (sim->integrator == SIM_RK4
            ? !integrate_rk4(sim, t, x, reason, size)
            : !sim_cvode_integrate(sim->cvode, jumps, t, t1, x, reason, size))
        return false;
    return check_state(sim, x, reason, size);
}

bool sim_step(struct simulator *sim, char *reason, int reason_size)
{
    const struct dse_plant *plant = sim->field.plant;
    char detail[512] = "";
    double x[DSE_PLANT_MAX_STATES];
    memcpy(x, sim->x, (size_t)plant->nx * sizeof *x);
    if (integrate(sim, x, detail, (int)sizeof detail) &&
        enter_sample(sim, sim->sample + 1, x, detail, (int)sizeof detail))
        return true;
    if (reason_size > 0)
        reason[0] = '\0';
    return sim_reason(reason, reason_size,
                      "plant %s cannot be integrated beyond sample %lld (t = %.9g %s)%s",
                      plant->name, (long long)sim->sample, sim_time(sim), plant->time_unit, detail);
}
