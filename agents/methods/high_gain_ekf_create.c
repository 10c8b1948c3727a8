/* Making a node of the high-gain EKF from its section. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "methods/high_gain_ekf_node.h"

static bool is_centralised(const struct high_gain_ekf_section *section)
{
    return section->framework == HIGH_GAIN_EKF_CENTRALISED;
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

/* The filter stacks the plant's states and outputs block by block: they must lie in this order. */
static bool blocks_are_in_order(const struct dse_plant *process)
{
    int state = 0;
    int output = 0;
    for (int i = 0; i < process->n_subsystems; i++) {
        const struct dse_subsystem *subsystem = &process->subsystems[i];
        for (int s = 0; s < subsystem->n_states; s++)
            if (subsystem->states[s] != state++)
                return false;
        for (int l = 0; l < subsystem->n_outputs; l++)
            if (subsystem->outputs[l] != output++)
                return false;
        if (subsystem->n_outputs < 1)
            return false;
    }
    return state == process->nx;
}

static bool plant_fits(const struct method_setup *setup, struct error *error)
{
    const struct dse_plant *process = setup->process;
    if (process->normal_form == NULL)
        return error_set(error, "plant %s has no normal form, which high_gain_ekf needs",
                         process->name);
    if (!blocks_are_in_order(process))
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

/* Own outputs, and where they begin among all. */
static int own_outputs(const struct method_setup *setup, int *first)
{
    const struct dse_plant *process = setup->process;
    int all = 0;
    *first = 0;
    for (int j = 0; j < process->n_subsystems; j++) {
        if (j == setup->node)
            *first = all;
        all += process->subsystems[j].n_outputs;
    }
    if (!is_centralised(setup->section))
        return process->subsystems[setup->node].n_outputs;
    *first = 0;
    return all;
}

/* ---- configuration ---- */

/* Reals that the configuration points to. */
static int config_storage(const struct method_setup *setup, int n, int n_i)
{
    int first = 0;
    int m = own_outputs(setup, &first);
    return n + 2 * n_i * n_i + m * m + n_i;
}

static void fill_weights(struct high_gain_ekf_node *node, const struct method_setup *setup, int n_i)
{
    const struct high_gain_ekf_section *section = node->section;
    struct dse_high_gain_ekf_config *config = &node->config;
    int offset = is_centralised(section) ? 0 : block_offset(setup->process, setup->node);
    int first = 0;
    int m = own_outputs(setup, &first);
    dse_real *x0 = dse_arena_take(&node->arena, node->form.n);
    dse_real *P0 = dse_arena_take(&node->arena, n_i * n_i);
    dse_real *Q = dse_arena_take(&node->arena, n_i * n_i);
    dse_real *R = dse_arena_take(&node->arena, m * m);
    high_gain_ekf_guess(node, setup, x0);
    diagonal(n_i, section->P0 != NULL ? section->P0 + offset : NULL, P0);
    diagonal(n_i, section->Q + offset, Q);
    diagonal(m, section->R + first, R);
    config->x0 = x0;
    config->P0 = P0;
    config->Q = Q;
    config->R_block = R;
}

static void fill_communication(struct high_gain_ekf_node *node, const struct method_setup *setup,
                               int n_i)
{
    const struct high_gain_ekf_communication *communication = &node->section->communication;
    struct dse_high_gain_ekf_config *config = &node->config;
    const struct high_gain_ekf_trigger *trigger = communication->trigger;
    config->communication = communication->kind;
    config->predictor = communication->predictor;
    config->comm_every_ticks = (int)communication->every;
    config->max_delay = setup->link != NULL ? setup->link->max_delay : 0;
    if (trigger == NULL)
        return;
    config->trigger.norm = trigger->norm;
    config->trigger.threshold = (dse_real)trigger->L;
    if (trigger->H != NULL) {
        dse_real *H = dse_arena_take(&node->arena, n_i);
        for (int s = 0; s < n_i; s++)
            H[s] = (dse_real)trigger->H[block_offset(setup->process, setup->node) + s];
        config->trigger.weights = H;
    }
}

/* What is no single number lives in the arena before the filter's own memory: the filter keeps
 * pointers. */
static void fill_config(struct high_gain_ekf_node *node, const struct method_setup *setup, int n_i)
{
    const struct high_gain_ekf_section *section = node->section;
    struct dse_high_gain_ekf_config *config = &node->config;
    fill_weights(node, setup, n_i);
    fill_communication(node, setup, n_i);
    config->model = &node->model;
    config->form = &node->form;
    config->whole = is_centralised(section);
    config->i = node->own;
    config->heard = setup->graph != NULL;
    config->period = (dse_real)setup->period;
    config->coords = section->coordinates;
    config->scaling = section->scaling;
    config->gain = high_gain_ekf_gain(section, setup->node);
    config->innovation = section->innovation;
    config->adaptation.theta_m = (dse_real)section->theta_m;
    config->adaptation.rise_time = (dse_real)section->DeltaT;
    config->adaptation.relaxation = (dse_real)section->lambda;
    config->adaptation.sharpness = (dse_real)section->beta;
    config->adaptation.threshold = (dse_real)section->m;
    config->horizon = high_gain_ekf_horizon(section, setup->period);
}

/* ---- what the runtime gets to know ---- */

static bool talks(const struct high_gain_ekf_section *section)
{
    return !is_centralised(section) && (section->communication.kind != DSE_HIGH_GAIN_NONE ||
                                        section->innovation == DSE_HIGH_GAIN_SUM);
}

static void describe_states(const struct high_gain_ekf_node *node, const struct method_setup *setup,
                            struct method_info *info)
{
    const struct dse_plant *process = setup->process;
    const struct dse_subsystem *subsystem = &process->subsystems[setup->node];
    bool whole = is_centralised(node->section);
    snprintf(info->name, sizeof info->name, "%s", whole ? process->title : subsystem->name);
    info->n_states = whole ? process->nx : subsystem->n_states;
    for (int s = 0; s < info->n_states; s++)
        info->states[s] = whole ? s : subsystem->states[s];
    info->n_groups = whole ? process->n_subsystems : 1;
    for (int g = 0; g < info->n_groups; g++)
        info->groups[g] = whole ? g : setup->node;
}

static void describe(const struct high_gain_ekf_node *node, const struct method_setup *setup,
                     struct method_info *info)
{
    static const struct method_signal diagnostics[DIAGNOSTICS] = {
        [DIAGNOSTIC_THETA] = {"theta", ""},
        [DIAGNOSTIC_J] = {"J", "unit^2 time"},
        [DIAGNOSTIC_J_SUM] = {"J driving theta", "unit^2 time"},
        [DIAGNOSTIC_INNOVATION] = {"innovation", ""},
        [DIAGNOSTIC_AGE] = {"age", "exchanges"},
        [DIAGNOSTIC_SENT] = {"states sent", ""},
    };
    const struct dse_plant *process = setup->process;
    const struct dse_subsystem *subsystem = &process->subsystems[setup->node];
    const struct dse_signal *output = &process->outputs[subsystem->outputs[0]];
    memset(info, 0, sizeof *info);
    describe_states(node, setup, info);
    if (talks(node->section))
        high_gain_ekf_describe_neighbours(setup, info);
    info->every = (int)node->section->communication.every;
    info->n_diagnostics = DIAGNOSTICS;
    memcpy(info->diagnostics, diagnostics, sizeof diagnostics);
    snprintf(info->diagnostics[DIAGNOSTIC_INNOVATION].unit,
             sizeof info->diagnostics[DIAGNOSTIC_INNOVATION].unit, "%s", output->unit);
    snprintf(info->diagnostics[DIAGNOSTIC_J].unit, sizeof info->diagnostics[DIAGNOSTIC_J].unit,
             "%s^2 %s", output->unit, process->time_unit);
    memcpy(info->diagnostics[DIAGNOSTIC_J_SUM].unit, info->diagnostics[DIAGNOSTIC_J].unit,
           sizeof info->diagnostics[DIAGNOSTIC_J].unit);
    info->storage_bytes =
        (int64_t)sizeof node->filter +
        (int64_t)(node->arena.used + node->part_storage) * (int64_t)sizeof(dse_real);
}

/* ---- life ---- */

void high_gain_ekf_destroy(void *self)
{
    struct high_gain_ekf_node *node = self;
    lossy_link_destroy(node->links);
    high_gain_ekf_leave_plant(node);
    free(node->memory);
    free(node);
}

static bool take_memory(struct high_gain_ekf_node *node, const struct method_setup *setup, int n_i,
                        struct error *error)
{
    const struct dse_plant *process = setup->process;
    const struct high_gain_ekf_communication *communication = &node->section->communication;
    int n = node->form.n;
    int nu = process->nu;
    int p = is_centralised(node->section) ? 1 : node->form.p;
    int D = setup->link != NULL ? setup->link->max_delay : 0;
    int every = communication->every > 0 ? (int)communication->every : 1;
    int horizon = high_gain_ekf_horizon(node->section, setup->period);
    int storage = config_storage(setup, n, n_i) +
                  DSE_HIGH_GAIN_EKF_STORAGE(n, nu, process->ny, p, n_i, horizon);
    if (D > 0 && every > 1000000 / D)
        return error_set(error,
                         "%s: networks.%s.link: D = %d periods of %d samples are too long to be "
                         "kept",
                         setup->scenario->file, setup->network->name, D, every);
    storage += D > 0 ? DSE_HIGH_GAIN_EKF_DELAY_STORAGE(n, nu, p, D, every) : 0;
    node->memory = calloc((size_t)storage, sizeof *node->memory);
    if (node->memory == NULL)
        return error_set(error, "out of memory");
    dse_arena_init(&node->arena, node->memory, storage);
    return true;
}

static bool open_links(struct high_gain_ekf_node *node, const struct method_setup *setup,
                       struct error *error)
{
    const struct high_gain_ekf_communication *communication = &node->section->communication;
    int64_t every = communication->every > 0 ? communication->every : 1;
    if (setup->link == NULL)
        return true;
    if (is_centralised(node->section) || communication->kind != DSE_HIGH_GAIN_TICK)
        return error_set(error,
                         "%s: networks.%s.link: delays and losses go with communication of kind "
                         "tick only",
                         setup->scenario->file, setup->network->name);
    node->links = lossy_link_create(setup, node->whole_form.n_i, every, error);
    return node->links != NULL;
}

static bool open_filter(struct high_gain_ekf_node *node, const struct method_setup *setup,
                        struct error *error)
{
    int n_i = is_centralised(node->section) ? node->form.n : node->form.n_i[node->own];
    if (!take_memory(node, setup, n_i, error) || !open_links(node, setup, error))
        return false;
    fill_config(node, setup, n_i);
    enum dse_status status = dse_high_gain_ekf_init(&node->filter, &node->config, &node->arena);
    return status == DSE_OK ||
           error_set(error, "%s: networks.%s.high_gain_ekf: filter %d cannot be set up: %s",
                     setup->scenario->file, setup->network->name, setup->node,
                     dse_status_text(status));
}

/* With the place where the section stands: a scenario may have several. */
static bool section_fits(const struct method_setup *setup, struct error *error)
{
    struct error why = {""};
    return high_gain_ekf_section_check(setup->section, setup->period, &why) ||
           error_set(error, "%s: networks.%s.%s", setup->scenario->file, setup->network->name,
                     why.text);
}

void *high_gain_ekf_create(const struct method_setup *setup, struct method_info *info,
                           struct error *error)
{
    if (!plant_fits(setup, error) || !section_fits(setup, error))
        return NULL;
    struct high_gain_ekf_node *node = calloc(1, sizeof *node);
    if (node == NULL) {
        error_set(error, "out of memory");
        return NULL;
    }
    node->section = setup->section;
    if (!high_gain_ekf_take_plant(node, setup, error) || !open_filter(node, setup, error)) {
        high_gain_ekf_destroy(node);
        return NULL;
    }
    describe(node, setup, info);
    return node;
}
