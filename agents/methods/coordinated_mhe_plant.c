/* A linear model, in deviations, of whatever plant the scenario has. */
#include "methods/coordinated_mhe_plant.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "dse/linalg.h"

#define EQUILIBRIUM 1e-2 /* of a state's ordinary deviation: how far it may move in a sample */

int coordinated_mhe_plant_nx(const struct coordinated_mhe_plant *plant, int i)
{
    return plant->first_state[i + 1] - plant->first_state[i];
}

int coordinated_mhe_plant_ny(const struct coordinated_mhe_plant *plant, int i)
{
    return plant->first_output[i + 1] - plant->first_output[i];
}

void coordinated_mhe_plant_free(struct coordinated_mhe_plant *plant)
{
    free(plant->state);
    free(plant->memory);
    *plant = (struct coordinated_mhe_plant){0};
}

/* What is needed on the way, in the plant's order. */
struct workspace {
    struct dse_model model;
    dse_real *x, *dx, *y, *u, *F, *E, *H, *scratch;
    void *memory;
};

static bool take_workspace(struct workspace *work, const struct dse_plant *process)
{
    size_t n = (size_t)process->nx;
    size_t ny = (size_t)process->ny;
    size_t nu = (size_t)process->nu;
    dse_real *at =
        calloc(2 * n + ny + nu + 2 * n * n + ny * n + (size_t)DSE_EXPM_SCRATCH(n) + 1, sizeof *at);
    work->memory = at;
    if (at == NULL)
        return false;
    work->x = at, at += n;
    work->dx = at, at += n;
    work->y = at, at += ny;
    work->u = at, at += nu;
    work->F = at, at += n * n;
    work->E = at, at += n * n;
    work->H = at, at += ny * n;
    work->scratch = at;
    return true;
}

/* ---- parts ---- */

static bool take_memory(struct coordinated_mhe_plant *plant, const struct dse_plant *process)
{
    size_t n = (size_t)process->nx;
    size_t ny = (size_t)process->ny;
    size_t parts = (size_t)process->n_subsystems;
    int *index = calloc(n + ny + 2 * (parts + 1), sizeof *index);
    dse_real *real = calloc(n * n + ny * n + n + ny + 1, sizeof *real);
    plant->state = index;
    plant->memory = real;
    if (index == NULL || real == NULL)
        return false;
    plant->output = index + n;
    plant->first_state = plant->output + ny;
    plant->first_output = plant->first_state + parts + 1;
    plant->A = real;
    plant->C = plant->A + n * n;
    plant->origin = plant->C + ny * n;
    plant->y = plant->origin + n;
    return true;
}

/* Part after part; every state and output in exactly one of them. */
static bool cut(struct coordinated_mhe_plant *plant, const struct dse_plant *process, bool whole,
                struct error *error)
{
    for (int i = 0; i < process->n_subsystems; i++) {
        const struct dse_subsystem *subsystem = &process->subsystems[i];
        if (plant->n + subsystem->n_states > process->nx ||
            plant->ny + subsystem->n_outputs > process->ny)
            break;
        for (int s = 0; s < subsystem->n_states; s++)
            plant->state[plant->n++] = subsystem->states[s];
        for (int l = 0; l < subsystem->n_outputs; l++)
            plant->output[plant->ny++] = subsystem->outputs[l];
        if (!whole && (subsystem->n_states < 1 || subsystem->n_outputs < 1))
            return error_set(error,
                             "plant %s: coordinated_mhe needs states and a sensor in every "
                             "subsystem; %s lacks them",
                             process->name, subsystem->name);
        plant->parts = whole ? 1 : i + 1;
        plant->first_state[plant->parts] = plant->n;
        plant->first_output[plant->parts] = plant->ny;
    }
    bool all = plant->n == process->nx && plant->ny == process->ny;
    return all || error_set(error,
                            "plant %s: coordinated_mhe needs every state and output in exactly "
                            "one subsystem",
                            process->name);
}

/* ---- matrices ---- */

static const double *origin_of(const struct method_setup *setup, const double *given)
{
    const struct scenario_linear *linear = setup->scenario->plant.linear;
    return given == NULL && linear != NULL ? linear->origin : given;
}

static bool choose_point(struct workspace *work, const struct method_setup *setup,
                         const double *given, struct error *error)
{
    const struct dse_plant *process = setup->process;
    const struct scenario *scenario = setup->scenario;
    const double *origin = origin_of(setup, given);
    if (origin == NULL && scenario->plant.linear == NULL)
        return error_set(
            error,
            "%s: networks.%s.coordinated_mhe.origin is missing: the steady state about "
            "which plant %s is linearised",
            scenario->file, setup->network->name, process->name);
    if (scenario->plant.drive_count > 0)
        return error_set(error,
                         "%s: plant.drive: coordinated_mhe knows no inputs that vary, only a "
                         "steady state of constant ones",
                         scenario->file);
    for (int s = 0; s < process->nx; s++)
        work->x[s] = origin != NULL ? (dse_real)origin[s] : 0;
    for (int l = 0; l < process->nu; l++)
        work->u[l] = scenario->plant.inputs != NULL ? (dse_real)scenario->plant.inputs[l]
                                                    : process->inputs[l].nominal;
    return true;
}

/* f(x_s, u_s) = 0, or = x_s of a discrete plant, to a small part of ordinary deviations. */
static bool is_steady(struct workspace *work, const struct method_setup *setup, struct error *error)
{
    const struct dse_plant *process = setup->process;
    for (int s = 0; s < process->nx; s++) {
        double move = work->model.time == DSE_DISCRETE ? (double)(work->dx[s] - work->x[s])
                                                       : (double)work->dx[s] * setup->period;
        if (!(fabs(move) <= EQUILIBRIUM * (double)process->states[s].scale))
            return error_set(error,
                             "%s: networks.%s.coordinated_mhe.origin is no steady state of plant "
                             "%s: %s moves by %.3g in a sample",
                             setup->scenario->file, setup->network->name, process->name,
                             process->states[s].name, move);
    }
    return true;
}

/* A = e^{F T} of a continuous plant; work->E. */
static bool linearise(struct workspace *work, const struct method_setup *setup, struct error *error)
{
    const struct dse_plant *process = setup->process;
    const struct dse_model *model = &work->model;
    const int n = process->nx;
    bool ok = model->dfdx != NULL && model->dhdx != NULL &&
              model->f(model, 0, work->x, work->u, work->dx) == DSE_OK &&
              model->h(model, 0, work->x, work->u, work->y) == DSE_OK &&
              model->dfdx(model, 0, work->x, work->u, work->F) == DSE_OK &&
              model->dhdx(model, 0, work->x, work->u, work->H) == DSE_OK;
    if (!ok)
        return error_set(error, "plant %s cannot be linearised at the steady state", process->name);
    if (!is_steady(work, setup, error))
        return false;
    if (model->time == DSE_DISCRETE) {
        memcpy(work->E, work->F, (size_t)(n * n) * sizeof *work->E);
        return true;
    }
    for (int i = 0; i < n * n; i++)
        work->F[i] *= (dse_real)setup->period;
    return dse_expm(n, work->F, work->E, work->scratch) == DSE_OK ||
           error_set(error, "plant %s cannot be discretised over a sample of %g %s", process->name,
                     setup->period, process->time_unit);
}

static int part_of(const int *first, int parts, int place)
{
    int i = 0;
    while (i + 1 < parts && place >= first[i + 1])
        i++;
    return i;
}

/* From the plant's order into that of the parts. */
static bool arrange(struct coordinated_mhe_plant *plant, const struct workspace *work,
                    const struct dse_plant *process, struct error *error)
{
    const int n = plant->n;
    for (int r = 0; r < n; r++) {
        plant->origin[r] = work->x[plant->state[r]];
        for (int c = 0; c < n; c++)
            plant->A[r * n + c] = work->E[plant->state[r] * n + plant->state[c]];
    }
    for (int l = 0; l < plant->ny; l++) {
        plant->y[l] = work->y[plant->output[l]];
        for (int c = 0; c < n; c++) {
            dse_real entry = work->H[plant->output[l] * n + plant->state[c]];
            plant->C[l * n + c] = entry;
            if (entry != 0 && part_of(plant->first_output, plant->parts, l) !=
                                  part_of(plant->first_state, plant->parts, c))
                return error_set(error,
                                 "plant %s: output %s shows state %s of another subsystem, which "
                                 "coordinated_mhe does not allow",
                                 process->name, process->outputs[plant->output[l]].name,
                                 process->states[plant->state[c]].name);
        }
    }
    return true;
}

bool coordinated_mhe_plant_make(const struct method_setup *setup, bool whole, const double *origin,
                                struct coordinated_mhe_plant *plant, struct error *error)
{
    const struct dse_plant *process = setup->process;
    struct workspace work = {0};
    *plant = (struct coordinated_mhe_plant){0};
    if (!take_memory(plant, process) || !take_workspace(&work, process)) {
        coordinated_mhe_plant_free(plant);
        return error_set(error, "out of memory");
    }
    process->model(setup->prepared, &work.model);
    bool ok = cut(plant, process, whole, error) && choose_point(&work, setup, origin, error) &&
              linearise(&work, setup, error) && arrange(plant, &work, process, error);
    free(work.memory);
    if (!ok)
        coordinated_mhe_plant_free(plant);
    return ok;
}
