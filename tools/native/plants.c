/* libdse_plants: the shipped plants for the Python tools, through ctypes (tools/dse/plants.py). The
 * same equations as in the agents, so that what is designed on a desk is what runs.
 *
 * Numbers are double. A call answers a dse_status; text and counts answer NULL or -1 where there is
 * nothing of that name. */
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "dse/linalg.h"
#include "dse/ode.h"
#include "dse/plant.h"

/* ---- what there is ---- */

const char *plants_at(int i);
int plants_members(const char *plant, int subsystem, const char *kind, int *members);
int plants_expm(int n, const double *A, double *E);
int plants_count(const char *plant, const char *kind);
const char *plants_text(const char *plant, const char *kind, int i, const char *field);
int plants_set(const char *plant, int set, double *values, double *x0);
double plants_number(const char *plant, const char *kind, int i, const char *field);

const char *plants_at(int i)
{
    const struct dse_plant *plant = dse_plant_at(i);
    return plant != NULL ? plant->name : NULL;
}

static int is(const char *text, const char *word)
{
    return strcmp(text, word) == 0;
}

static const struct dse_signal *signals_of(const struct dse_plant *plant, const char *kind)
{
    return is(kind, "state")    ? plant->states
           : is(kind, "input")  ? plant->inputs
           : is(kind, "output") ? plant->outputs
                                : NULL;
}

/* How many of a kind: state, input, output, parameter, set, subsystem; -1: no such plant or kind.
 */
int plants_count(const char *name, const char *kind)
{
    const struct dse_plant *plant = dse_plant_find(name);
    return plant == NULL           ? -1
           : is(kind, "state")     ? plant->nx
           : is(kind, "input")     ? plant->nu
           : is(kind, "output")    ? plant->ny
           : is(kind, "parameter") ? plant->n_parameters
           : is(kind, "set")       ? plant->n_sets
           : is(kind, "subsystem") ? plant->n_subsystems
                                   : -1;
}

/* name, unit or title of one of a kind; kind "plant": time_unit. */
const char *plants_text(const char *name, const char *kind, int i, const char *field)
{
    const struct dse_plant *plant = dse_plant_find(name);
    if (plant != NULL && is(kind, "plant")) {
        return is(field, "time_unit") ? plant->time_unit : plant->title;
    }
    if (i < 0 || i >= plants_count(name, kind)) {
        return NULL;
    }
    if (is(kind, "set")) {
        return is(field, "name") ? plant->sets[i].name : plant->sets[i].title;
    }
    if (is(kind, "subsystem")) {
        return plant->subsystems[i].name;
    }
    if (is(kind, "parameter")) {
        const struct dse_parameter *one = &plant->parameters[i];
        return is(field, "name") ? one->name : is(field, "unit") ? one->unit : one->title;
    }
    const struct dse_signal *one = &signals_of(plant, kind)[i];
    return is(field, "name") ? one->name : is(field, "unit") ? one->unit : one->title;
}

/* nominal or scale of a signal, min or max of a parameter; kind "plant": seconds per time unit. */
double plants_number(const char *name, const char *kind, int i, const char *field)
{
    const struct dse_plant *plant = dse_plant_find(name);
    if (plant != NULL && is(kind, "plant")) {
        return plant->time_unit_s;
    }
    if (i < 0 || i >= plants_count(name, kind) || is(kind, "set") || is(kind, "subsystem")) {
        return NAN;
    }
    if (is(kind, "parameter")) {
        return is(field, "min") ? plant->parameters[i].min : plant->parameters[i].max;
    }
    const struct dse_signal *one = &signals_of(plant, kind)[i];
    return is(field, "scale") ? one->scale : one->nominal;
}

/* Parameter values and initial state of a set. */
int plants_set(const char *name, int set, double *values, double *x0)
{
    const struct dse_plant *plant = dse_plant_find(name);
    if (plant == NULL || set < 0 || set >= plant->n_sets) {
        return DSE_EINVAL;
    }
    memcpy(values, plant->sets[set].values, (size_t)plant->n_parameters * sizeof *values);
    memcpy(x0, plant->sets[set].x0, (size_t)plant->nx * sizeof *x0);
    return DSE_OK;
}

/* Which states or outputs (kind) belong to a subsystem, into `members` (room for all that the plant
 * has); their number, -1: there is no such subsystem or kind. */
int plants_members(const char *name, int subsystem, const char *kind, int *members)
{
    const struct dse_plant *plant = dse_plant_find(name);
    if (plant == NULL || subsystem < 0 || subsystem >= plant->n_subsystems) {
        return -1;
    }
    const struct dse_subsystem *one = &plant->subsystems[subsystem];
    const int states = is(kind, "state");
    if (!states && !is(kind, "output")) {
        return -1;
    }
    const int count = states ? one->n_states : one->n_outputs;
    for (int j = 0; j < count; j++) {
        members[j] = states ? one->states[j] : one->outputs[j];
    }
    return count;
}

/* ---- equations ---- */

int plants_evaluate(const char *name, const double *values, const char *what, double t,
                    const double *x, const double *u, double *out);
int plants_simulate(const char *name, const double *values, int steps_per_sample, double period,
                    int samples, const double *x0, const double *u, double *x, double *y);

/* The model with these parameter values; *prepared is to be freed. */
static int open_model(const char *name, const double *values, double **prepared,
                      struct dse_model *model)
{
    const struct dse_plant *plant = dse_plant_find(name);
    if (plant == NULL) {
        return DSE_EINVAL;
    }
    *prepared = calloc((size_t)plant->prepared_size + 1, sizeof **prepared);
    if (*prepared == NULL) {
        return DSE_ESTORAGE;
    }
    const int status = plant->prepare(values, *prepared);
    if (status == DSE_OK) {
        plant->model(*prepared, model);
    }
    return status;
}

/* out = f, h, dfdx or dhdx at (t, x, u). */
int plants_evaluate(const char *name, const double *values, const char *what, double t,
                    const double *x, const double *u, double *out)
{
    struct dse_model m = {.nx = 0};
    double *prepared = NULL;
    int status = open_model(name, values, &prepared, &m);
    if (status == DSE_OK) {
        status = is(what, "f")                        ? m.f(&m, t, x, u, out)
                 : is(what, "h")                      ? m.h(&m, t, x, u, out)
                 : is(what, "dfdx") && m.dfdx != NULL ? m.dfdx(&m, t, x, u, out)
                 : is(what, "dhdx") && m.dhdx != NULL ? m.dhdx(&m, t, x, u, out)
                                                      : DSE_EINVAL;
    }
    free(prepared);
    return status;
}

/* One sample from t, inputs held: explicit Euler when steps = 0, else so many Runge-Kutta steps. */
static int advance(const struct dse_model *m, int steps, double t, double period, const double *u,
                   double *x)
{
    double dx[DSE_PLANT_MAX_STATES], scratch[DSE_RK4_SCRATCH(DSE_PLANT_MAX_STATES)];
    if (steps == 0) {
        const int status = m->f(m, t, x, u, dx);
        for (int j = 0; status == DSE_OK && j < m->nx; j++) {
            x[j] += period * dx[j];
        }
        return status;
    }
    int status = DSE_OK;
    for (int s = 0; s < steps && status == DSE_OK; s++) {
        status = dse_rk4_model_step(m, t + period * s / steps, period / steps, u, x, scratch);
    }
    return status;
}

/* States x (samples x nx) and outputs y (samples x ny) at t_k = k period from x0, with the inputs
 * u (samples x nu) of each sample. */
int plants_simulate(const char *name, const double *values, int steps_per_sample, double period,
                    int samples, const double *x0, const double *u, double *x, double *y)
{
    struct dse_model m = {.nx = 0};
    double *prepared = NULL;
    int status = open_model(name, values, &prepared, &m);
    for (int k = 0; k < samples && status == DSE_OK; k++) {
        double *now = x + (size_t)k * (size_t)m.nx;
        const double *input = u + (size_t)k * (size_t)m.nu;
        if (k == 0) {
            memcpy(now, x0, (size_t)m.nx * sizeof *now);
        } else {
            memcpy(now, now - m.nx, (size_t)m.nx * sizeof *now);
            status = advance(&m, steps_per_sample, (k - 1) * period, period, input - m.nu, now);
        }
        if (status == DSE_OK) {
            status = m.h(&m, k * period, now, input, y + (size_t)k * (size_t)m.ny);
        }
    }
    free(prepared);
    return status;
}

/* E = exp(A), n x n, with the library's own function. */
int plants_expm(int n, const double *A, double *E)
{
    double *scratch = malloc((size_t)DSE_EXPM_SCRATCH(n) * sizeof *scratch);
    if (scratch == NULL) {
        return DSE_ESTORAGE;
    }
    const int status = dse_expm(n, A, E, scratch);
    free(scratch);
    return status;
}
