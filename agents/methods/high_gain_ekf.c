/* The distributed adaptive high-gain EKF as a method: node i is the filter of subsystem i. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dse/high_gain_ekf.h"
#include "methods/high_gain_ekf_section.h"
#include "methods/method.h"

enum { DIAGNOSTIC_THETA, DIAGNOSTIC_J, DIAGNOSTIC_J_SUM, DIAGNOSTIC_INNOVATION, DIAGNOSTICS };

#define STAGES_ROUNDS 4

struct node {
    const struct high_gain_ekf_section *section;
    struct dse_model model;
    struct dse_normal_form form;
    struct dse_high_gain_ekf_config config;
    struct dse_high_gain_ekf filter;
    struct dse_arena arena;
    dse_real *memory;
    int64_t k;
    int planned; /* rounds of this sample, also when the own filter has failed in it */
    bool ok;     /* the own filter takes part in this sample */
};

static int nodes(const struct method_setup *setup)
{
    return setup->process->n_subsystems;
}

static int block_offset(const struct dse_plant *process, int i)
{
    int offset = 0;
    for (int j = 0; j < i; j++)
        offset += process->subsystems[j].n_states;
    return offset;
}

/* n_i x n_i matrix with entries `from` on its diagonal, the identity when there are none. */
static void diagonal(int n, const double *from, dse_real *matrix)
{
    for (int r = 0; r < n; r++)
        matrix[r * n + r] = from != NULL ? (dse_real)from[r] : 1;
}

/* The filter stacks the plant's states block by block: they must lie in this order. */
static bool blocks_are_in_order(const struct dse_plant *process)
{
    int next = 0;
    for (int i = 0; i < process->n_subsystems; i++)
        for (int s = 0; s < process->subsystems[i].n_states; s++)
            if (process->subsystems[i].states[s] != next++)
                return false;
    return next == process->nx;
}

static bool plant_fits(const struct method_setup *setup, struct error *error)
{
    const struct dse_plant *process = setup->process;
    if (process->normal_form == NULL)
        return error_set(error, "plant %s has no normal form, which high_gain_ekf needs",
                         process->name);
    if (!blocks_are_in_order(process) || process->ny < process->n_subsystems)
        return error_set(error,
                         "plant %s: high_gain_ekf needs subsystems in the order of the "
                         "states, with an output each",
                         process->name);
    if (setup->network->guess == NULL)
        return error_set(error,
                         "%s: networks.%s.guess is missing: the initial guess of all %d "
                         "states that the filters share",
                         setup->scenario->file, setup->network->name, process->nx);
    return true;
}

/* Weights and guess live in the arena behind the filter's own memory: the filter keeps pointers. */
static void fill_config(struct node *node, const struct method_setup *setup)
{
    const struct high_gain_ekf_section *section = node->section;
    struct dse_high_gain_ekf_config *config = &node->config;
    int i = setup->node;
    int n_i = node->form.n_i[i];
    int offset = block_offset(setup->process, i);
    dse_real *x0 = dse_arena_take(&node->arena, node->form.n);
    dse_real *P0 = dse_arena_take(&node->arena, n_i * n_i);
    dse_real *Q = dse_arena_take(&node->arena, n_i * n_i);
    for (int s = 0; s < node->form.n; s++)
        x0[s] = (dse_real)setup->network->guess[s];
    diagonal(n_i, section->P0 != NULL ? section->P0 + offset : NULL, P0);
    diagonal(n_i, section->Q + offset, Q);
    config->model = &node->model;
    config->form = &node->form;
    config->i = i;
    config->period = (dse_real)setup->period;
    config->coords = section->coordinates;
    config->scaling = section->scaling;
    config->gain = high_gain_ekf_gain(section, i);
    config->innovation = section->innovation;
    config->communication = section->communication.kind;
    config->predictor = section->communication.predictor;
    config->comm_every_ticks = (int)section->communication.every;
    config->x0 = x0;
    config->P0 = P0;
    config->Q = Q;
    config->R = (dse_real)section->R[i];
    config->adaptation.theta_m = (dse_real)section->theta_m;
    config->adaptation.rise_time = (dse_real)section->DeltaT;
    config->adaptation.relaxation = (dse_real)section->lambda;
    config->adaptation.sharpness = (dse_real)section->beta;
    config->adaptation.threshold = (dse_real)section->m;
    config->horizon = high_gain_ekf_horizon(section, setup->period);
}

static bool talks(const struct high_gain_ekf_section *section)
{
    return section->communication.kind != DSE_HIGH_GAIN_NONE ||
           section->innovation == DSE_HIGH_GAIN_SUM;
}

static void describe(const struct node *node, const struct method_setup *setup,
                     struct method_info *info)
{
    static const struct method_signal diagnostics[DIAGNOSTICS] = {
        [DIAGNOSTIC_THETA] = {"theta", ""},
        [DIAGNOSTIC_J] = {"J", "unit^2 time"},
        [DIAGNOSTIC_J_SUM] = {"J driving theta", "unit^2 time"},
        [DIAGNOSTIC_INNOVATION] = {"innovation", ""},
    };
    const struct dse_plant *process = setup->process;
    const struct dse_subsystem *subsystem = &process->subsystems[setup->node];
    const struct dse_signal *output = &process->outputs[subsystem->outputs[0]];
    memset(info, 0, sizeof *info);
    snprintf(info->name, sizeof info->name, "%s", subsystem->name);
    info->n_states = subsystem->n_states;
    memcpy(info->states, subsystem->states, (size_t)info->n_states * sizeof *info->states);
    info->n_groups = 1;
    info->groups[0] = setup->node;
    for (int j = 0; talks(node->section) && j < process->n_subsystems; j++)
        if (j != setup->node) {
            info->neighbours[info->n_neighbours++] = j;
            info->listeners[info->n_listeners++] = j;
        }
    info->n_diagnostics = DIAGNOSTICS;
    memcpy(info->diagnostics, diagnostics, sizeof diagnostics);
    snprintf(info->diagnostics[DIAGNOSTIC_INNOVATION].unit,
             sizeof info->diagnostics[DIAGNOSTIC_INNOVATION].unit, "%s", output->unit);
    snprintf(info->diagnostics[DIAGNOSTIC_J].unit, sizeof info->diagnostics[DIAGNOSTIC_J].unit,
             "%s^2 %s", output->unit, process->time_unit);
    memcpy(info->diagnostics[DIAGNOSTIC_J_SUM].unit, info->diagnostics[DIAGNOSTIC_J].unit,
           sizeof info->diagnostics[DIAGNOSTIC_J].unit);
    info->storage_bytes =
        (int64_t)sizeof node->filter + (int64_t)node->arena.used * (int64_t)sizeof(dse_real);
}

static void destroy(void *self)
{
    struct node *node = self;
    free(node->memory);
    free(node);
}

static void *create(const struct method_setup *setup, struct method_info *info, struct error *error)
{
    const struct dse_plant *process = setup->process;
    if (!plant_fits(setup, error) ||
        !high_gain_ekf_section_check(setup->section, setup->period, error))
        return NULL;
    struct node *node = calloc(1, sizeof *node);
    if (node == NULL) {
        error_set(error, "out of memory");
        return NULL;
    }
    node->section = setup->section;
    process->model(setup->prepared, &node->model);
    process->normal_form(setup->prepared, &node->form);
    int n = node->form.n;
    int n_i = node->form.n_i[setup->node];
    int horizon = high_gain_ekf_horizon(node->section, setup->period);
    int storage =
        n + 2 * n_i * n_i +
        DSE_HIGH_GAIN_EKF_STORAGE(n, process->nu, process->ny, node->form.p, n_i, horizon);
    node->memory = calloc((size_t)storage, sizeof *node->memory);
    if (node->memory == NULL) {
        destroy(node);
        error_set(error, "out of memory");
        return NULL;
    }
    dse_arena_init(&node->arena, node->memory, storage);
    fill_config(node, setup);
    enum dse_status status = dse_high_gain_ekf_init(&node->filter, &node->config, &node->arena);
    if (status != DSE_OK) {
        destroy(node);
        error_set(error, "%s: networks.%s.high_gain_ekf: filter %d cannot be set up: %s",
                  setup->scenario->file, setup->network->name, setup->node,
                  dse_status_text(status));
        return NULL;
    }
    describe(node, setup, info);
    return node;
}

/* Rounds of sample k by the scenario alone, so that all nodes agree on them whatever happens. */
static int planned_rounds(const struct high_gain_ekf_section *section, int64_t k)
{
    if (section->communication.kind == DSE_HIGH_GAIN_STAGES)
        return STAGES_ROUNDS;
    int64_t every = section->communication.every > 0 ? section->communication.every : 1;
    bool due = section->communication.kind == DSE_HIGH_GAIN_TICK && k % every == 0;
    return due || section->innovation == DSE_HIGH_GAIN_SUM ? 1 : 0;
}

static enum dse_status begin(void *self, const struct method_sample *sample)
{
    struct node *node = self;
    struct dse_measurement measurement = {.y = sample->y, .valid = sample->valid};
    node->k = sample->k;
    node->planned = planned_rounds(node->section, sample->k);
    enum dse_status status = dse_high_gain_ekf_begin(&node->filter, sample->k, (dse_real)sample->t,
                                                     sample->u, &measurement);
    node->ok = status == DSE_OK;
    return status;
}

/* A node whose filter has failed in this sample says so by an empty, withheld message: the others
 * predict its block and need not wait for it. */
static enum method_step next(void *self, int round, struct method_plan *plan,
                             struct method_message *message)
{
    struct node *node = self;
    (void)plan; /* everybody speaks and hears everybody */
    if (round > 0 && node->ok)
        node->ok = dse_high_gain_ekf_advance(&node->filter, round - 1) == DSE_OK;
    if (round >= node->planned)
        return METHOD_DONE;
    message->count = node->ok ? dse_high_gain_ekf_message(&node->filter, round, message->value) : 0;
    message->withheld = message->count == 0;
    return METHOD_ROUND;
}

static enum dse_status receive(void *self, int round, int from,
                               const struct method_message *message)
{
    struct node *node = self;
    if (message->withheld || !node->ok)
        return DSE_OK;
    return dse_high_gain_ekf_receive(&node->filter, round, from, message->value, message->count);
}

static enum dse_status finish(void *self, struct method_estimate *estimate)
{
    struct node *node = self;
    struct dse_high_gain_ekf *filter = &node->filter;
    enum dse_status status = node->ok ? dse_high_gain_ekf_finish(filter) : DSE_OK;
    const dse_real *state = dse_high_gain_ekf_estimate(filter);
    const dse_real *P = dse_high_gain_ekf_estimate_covariance(filter);
    for (int s = 0; s < filter->n_i; s++) {
        estimate->state[s] = (double)state[s];
        estimate->variance[s] = (double)P[s * filter->n_i + s];
    }
    estimate->diagnostic[DIAGNOSTIC_THETA] = (double)dse_high_gain_ekf_theta(filter);
    estimate->diagnostic[DIAGNOSTIC_J] = (double)dse_high_gain_ekf_innovation(filter);
    estimate->diagnostic[DIAGNOSTIC_J_SUM] = (double)dse_high_gain_ekf_drive(filter);
    estimate->diagnostic[DIAGNOSTIC_INNOVATION] = (double)dse_high_gain_ekf_output_error(filter)[0];
    estimate->health = dse_high_gain_ekf_health(filter);
    return status;
}

const struct method high_gain_ekf_method = {
    .name = "high_gain_ekf",
    .title = "distributed adaptive high-gain EKF",
    .fields = high_gain_ekf_fields,
    .section_size = sizeof(struct high_gain_ekf_section),
    .rules = high_gain_ekf_rules,
    .nodes = nodes,
    .create = create,
    .destroy = destroy,
    .begin = begin,
    .next = next,
    .receive = receive,
    .finish = finish,
};
