/* Making a node of the distributed Kalman filters from its section. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "methods/distributed_kalman_node.h"

/* ---- sensors ---- */

/* Rows of C of all outputs; they are linear in the state and do not change. */
static bool read_outputs(struct distributed_kalman_node *node, const struct method_setup *setup,
                         struct error *error)
{
    const struct dse_plant *process = setup->process;
    dse_real u[DSE_PLANT_MAX_INPUTS], x[DSE_PLANT_MAX_STATES];
    for (int s = 0; s < process->nx; s++)
        x[s] = setup->network->guess != NULL ? setup->network->guess[s] : 0;
    for (int j = 0; j < process->nu; j++)
        u[j] = process->inputs[j].nominal;
    node->C = calloc((size_t)process->ny * (size_t)process->nx + 1, sizeof *node->C);
    if (node->C == NULL)
        return error_set(error, "out of memory");
    if (node->model.dfdx == NULL || node->model.dhdx == NULL ||
        node->model.dhdx(&node->model, 0, x, u, node->C) != DSE_OK)
        return error_set(error, "plant %s has no Jacobians, which distributed_kalman needs",
                         process->name);
    return true;
}

/* ---- configuration ---- */

/* Reals of the matrices that the configuration points to, the messages and the filter itself. */
static int storage(const struct distributed_kalman_node *node, const struct method_setup *setup)
{
    const int nx = setup->process->nx, ny = distributed_kalman_group(setup, setup->node)->n_outputs;
    int reals = nx + 3 * nx * nx + ny * ny + 3 * nx * ny;
    for (int v = 0; v < node->n_voices; v++)
        reals += distributed_kalman_group(setup, node->voices[v])->n_outputs * nx;
    reals += node->section->scheme == DSE_DKF_GLOBAL ? (node->nodes + 1) * ny * ny : 0;
    reals += node->section->discretise ? DISCRETISED_SCRATCH(nx) : 0;
    return reals + (node->section->direction == DSE_DKF_LYAPUNOV
                        ? DSE_DKF_STORAGE_LYAPUNOV(nx, ny, node->n_ears)
                        : DSE_DKF_STORAGE(nx, ny, node->n_ears));
}

/* n x n with entries factor * list[index[r]] on its diagonal; list NULL: `absent`. */
static const dse_real *diagonal(struct distributed_kalman_node *node, int n, const double *list,
                                const int *index, double absent, double factor)
{
    dse_real *matrix = dse_arena_take(&node->arena, n * n);
    for (int r = 0; r < n; r++)
        matrix[r * n + r] = (factor * (list != NULL ? list[index != NULL ? index[r] : r] : absent));
    return matrix;
}

static struct dse_dkf_sensor gather(struct distributed_kalman_node *node,
                                    const struct method_setup *setup, int i)
{
    const struct dse_subsystem *group = distributed_kalman_group(setup, i);
    const int nx = setup->process->nx;
    dse_real *C = dse_arena_take(&node->arena, group->n_outputs * nx);
    for (int l = 0; l < group->n_outputs; l++)
        memcpy(C + l * nx, node->C + group->outputs[l] * nx, (size_t)nx * sizeof *C);
    return (struct dse_dkf_sensor){.ny = group->n_outputs, .C = C};
}

/* This node's part of a list of nx x ny_i matrices of all nodes. */
static const dse_real *own_matrix(struct distributed_kalman_node *node,
                                  const struct method_setup *setup, const double *list)
{
    const int nx = setup->process->nx,
              size = nx * distributed_kalman_group(setup, setup->node)->n_outputs;
    if (list == NULL)
        return NULL;
    for (int i = 0; i < setup->node; i++)
        list += nx * distributed_kalman_group(setup, i)->n_outputs;
    dse_real *matrix = dse_arena_take(&node->arena, size);
    for (int k = 0; k < size; k++)
        matrix[k] = list[k];
    return matrix;
}

static bool gather_listeners(struct distributed_kalman_node *node, const struct method_setup *setup,
                             struct error *error)
{
    struct dse_dkf_config *config = &node->config;
    config->n_neighbours = node->n_ears;
    config->n_listeners =
        distributed_kalman_says_states(node->section) ? node->n_voices > 0 : node->n_voices;
    if (distributed_kalman_says_states(node->section) || node->n_voices == 0)
        return true;
    node->listeners = calloc((size_t)node->n_voices, sizeof *node->listeners);
    if (node->listeners == NULL)
        return error_set(error, "out of memory");
    for (int v = 0; v < node->n_voices; v++)
        node->listeners[v] = gather(node, setup, node->voices[v]);
    config->listeners = node->listeners;
    return true;
}

/* The noise: with discretise, Q_d = T Q and R_d = R / T. */
static void fill_weights(struct distributed_kalman_node *node, const struct method_setup *setup)
{
    const struct distributed_kalman_section *section = node->section;
    const struct dse_subsystem *group = distributed_kalman_group(setup, setup->node);
    struct dse_dkf_config *config = &node->config;
    const int nx = setup->process->nx;
    const double T = section->discretise ? setup->period : 1;
    const double *guess =
        section->guesses != NULL ? section->guesses + setup->node * nx : setup->network->guess;
    dse_real *x0 = dse_arena_take(&node->arena, nx);
    for (int s = 0; s < nx; s++)
        x0[s] = guess[s];
    config->x0 = x0;
    config->P0 = diagonal(node, nx, section->P0, NULL, 1, 1);
    config->Q = diagonal(node, nx, section->Q, NULL, 0, T);
    if (section->R != NULL)
        config->R = diagonal(node, group->n_outputs, section->R, group->outputs, 0, 1 / T);
    config->K = own_matrix(node, setup, section->K);
    config->D = own_matrix(node, setup, section->D);
    if (section->direction == DSE_DKF_LYAPUNOV)
        config->S = diagonal(node, nx, section->S, NULL, 1, 1);
}

static void fill_model(struct distributed_kalman_node *node, const struct method_setup *setup)
{
    struct dse_dkf_config *config = &node->config;
    setup->process->model(setup->prepared, &node->model);
    config->model = &node->model;
    config->period = setup->period;
    if (!node->section->discretise)
        return;
    struct dse_model *plant = &node->discretised_plant;
    *plant = node->model;
    node->discretised = (struct discretised){
        .plant = plant,
        .period = setup->period,
        .scratch = dse_arena_take(&node->arena, DISCRETISED_SCRATCH(plant->nx))};
    discretised_model(&node->model, &node->discretised);
}

static void fill_tunables(struct distributed_kalman_node *node)
{
    const struct distributed_kalman_section *section = node->section;
    struct dse_dkf_config *config = &node->config;
    config->scheme = section->scheme;
    config->direction = section->direction;
    config->message = distributed_kalman_says_states(section) ? DSE_DKF_FULL : DSE_DKF_PROJECTED;
    config->gamma = section->gamma;
    config->beta = section->beta;
    config->sigma = section->sigma;
    config->limit = section->limit;
    config->hold = sensor_network_hold(section->hold);
}

/* ---- what the runtime gets to know ---- */

static void describe_talk(const struct distributed_kalman_node *node,
                          const struct method_setup *setup, struct method_info *info)
{
    const int ny = node->filter.ny;
    if (node->section->scheme == DSE_DKF_ALONE)
        info->n_neighbours = info->n_listeners = 0;
    for (int j = 0; j < info->n_neighbours; j++)
        info->frames[info->n_frames++] = (struct method_frame){
            .from = info->neighbours[j], .values = dse_dkf_message_size(&node->filter)};
    if (node->section->scheme != DSE_DKF_GLOBAL)
        return;
    info->n_neighbours = info->n_listeners = 0;
    for (int j = 0; j < node->nodes; j++)
        if (j != setup->node) {
            info->neighbours[info->n_neighbours++] = j;
            info->listeners[info->n_listeners++] = j;
            info->frames[info->n_frames++] = (struct method_frame){.from = j, .values = ny * ny};
        }
}

static void describe(const struct distributed_kalman_node *node, const struct method_setup *setup,
                     struct method_info *info)
{
    static const struct method_signal diagnostics[DIAGNOSTICS] = {
        [DIAGNOSTIC_GAIN] = {"largest Gamma", ""},
        [DIAGNOSTIC_LOOP_GAIN] = {"loop gain", ""},
        [DIAGNOSTIC_RESIDUAL] = {"residual", ""},
        [DIAGNOSTIC_USED] = {"neighbours used", ""},
        [DIAGNOSTIC_REFUSED] = {"messages refused", ""},
        [DIAGNOSTIC_LIMITED] = {"gains limited", ""},
    };
    const struct sensor_network sensors = distributed_kalman_sensors(node->section);
    memset(info, 0, sizeof *info);
    sensor_network_describe(setup, &sensors, info);
    describe_talk(node, setup, info);
    info->n_states = setup->process->nx;
    for (int s = 0; s < info->n_states; s++)
        info->states[s] = s;
    info->n_diagnostics = DIAGNOSTICS;
    memcpy(info->diagnostics, diagnostics, sizeof diagnostics);
    info->storage_bytes =
        (int64_t)sizeof node->filter + (int64_t)node->arena.used * (int64_t)sizeof(dse_real);
}

/* ---- life ---- */

void distributed_kalman_destroy(void *self)
{
    struct distributed_kalman_node *node = self;
    lossy_rounds_destroy(node->links);
    free(node->C);
    free(node->voices);
    free(node->ears);
    free(node->listeners);
    free(node->has_term);
    free(node->memory);
    free(node);
}

static bool take_memory(struct distributed_kalman_node *node, const struct method_setup *setup,
                        struct error *error)
{
    const int ny = distributed_kalman_group(setup, setup->node)->n_outputs;
    const int reals = storage(node, setup);
    node->memory = calloc((size_t)reals + 1, sizeof *node->memory);
    node->has_term = calloc((size_t)node->nodes + 1, sizeof *node->has_term);
    if (node->memory == NULL || node->has_term == NULL)
        return error_set(error, "out of memory");
    dse_arena_init(&node->arena, node->memory, reals);
    if (node->section->scheme != DSE_DKF_GLOBAL)
        return true;
    node->sum = dse_arena_take(&node->arena, ny * ny);
    node->terms = dse_arena_take(&node->arena, node->nodes * ny * ny);
    return true;
}

static bool open_links(struct distributed_kalman_node *node, const struct method_setup *setup,
                       struct error *error)
{
    if (setup->link == NULL)
        return true;
    node->links = lossy_rounds_create(setup, error);
    return node->links != NULL;
}

static bool open_filter(struct distributed_kalman_node *node, const struct method_setup *setup,
                        struct error *error)
{
    if (!read_outputs(node, setup, error) || !distributed_kalman_find_voices(node, setup, error) ||
        !take_memory(node, setup, error) || !open_links(node, setup, error))
        return false;
    fill_model(node, setup);
    node->config.sensor = gather(node, setup, setup->node);
    if (!gather_listeners(node, setup, error))
        return false;
    fill_weights(node, setup);
    fill_tunables(node);
    enum dse_status status = dse_dkf_init(&node->filter, &node->config, &node->arena);
    return status == DSE_OK ||
           error_set(error, "%s: networks.%s.distributed_kalman: filter %d cannot be set up: %s",
                     setup->scenario->file, setup->network->name, setup->node,
                     dse_status_text(status));
}

void *distributed_kalman_create(const struct method_setup *setup, struct method_info *info,
                                struct error *error)
{
    if (!distributed_kalman_section_check(setup, error))
        return NULL;
    struct distributed_kalman_node *node = calloc(1, sizeof *node);
    if (node == NULL) {
        error_set(error, "out of memory");
        return NULL;
    }
    const struct sensor_network sensors = distributed_kalman_sensors(setup->section);
    node->section = setup->section;
    node->node = setup->node;
    node->nodes = sensor_network_nodes(setup, &sensors);
    node->ok = true;
    setup->process->model(setup->prepared, &node->model);
    if (!open_filter(node, setup, error)) {
        distributed_kalman_destroy(node);
        return NULL;
    }
    describe(node, setup, info);
    return node;
}
