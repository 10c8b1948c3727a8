/* The plant as a filter of the high-gain EKF sees it: all of it, or only the subsystems that it
 * hears (networks[].graph), with the parameters that its predictor believes in. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "methods/high_gain_ekf_node.h"

/* ---- the predictor's own plant ---- */

static bool parameters_exist(const struct method_setup *setup, struct error *error)
{
    const struct high_gain_ekf_section *section = setup->section;
    const struct dse_plant *process = setup->process;
    for (unsigned k = 0; k < section->predictor_parameters_count; k++) {
        const char *name = section->predictor_parameters[k].name;
        int i = 0;
        while (i < process->n_parameters && strcmp(process->parameters[i].name, name) != 0)
            i++;
        if (i == process->n_parameters)
            return error_set(error,
                             "%s: networks.%s.high_gain_ekf.predictor_parameters[%u].name: plant "
                             "%s has no parameter '%s'",
                             setup->scenario->file, setup->network->name, k, process->name, name);
    }
    return true;
}

/* The network's parameters, then the predictor's. */
static bool prepare_predictor(struct high_gain_ekf_node *node, const struct method_setup *setup,
                              struct error *error)
{
    const struct high_gain_ekf_section *section = node->section;
    const struct dse_plant *process = setup->process;
    unsigned own = setup->network->parameters_count;
    struct scenario_network believed = *setup->network;
    if (section->predictor_parameters == NULL)
        return true;
    if (!parameters_exist(setup, error))
        return false;
    node->values = calloc((size_t)process->n_parameters + 1, sizeof *node->values);
    node->prepared = calloc((size_t)process->prepared_size + 1, sizeof *node->prepared);
    believed.parameters_count = own + section->predictor_parameters_count;
    believed.parameters =
        calloc((size_t)believed.parameters_count + 1, sizeof *believed.parameters);
    bool ok = node->values != NULL && node->prepared != NULL && believed.parameters != NULL;
    if (!ok)
        error_set(error, "out of memory");
    for (unsigned k = 0; ok && k < believed.parameters_count; k++)
        believed.parameters[k] =
            k < own ? setup->network->parameters[k] : section->predictor_parameters[k - own];
    ok = ok &&
         scenario_prepare_plant(setup->scenario, &believed, node->values, node->prepared, error);
    free(believed.parameters);
    if (ok) {
        process->model(node->prepared, &node->whole_predictor_model);
        node->predictor_model = node->whole_predictor_model;
        node->config.predictor_model = &node->predictor_model;
    }
    return ok;
}

/* ---- a part of the plant ---- */

static bool fail(const struct method_setup *setup, struct error *error, const char *format, int a,
                 int b, int c) __attribute__((format(printf, 3, 0)));

static bool fail(const struct method_setup *setup, struct error *error, const char *format, int a,
                 int b, int c)
{
    char why[200];
    snprintf(why, sizeof why, format, a, b, c);
    return error_set(error, "%s: networks.%s.graph: %s", setup->scenario->file,
                     setup->network->name, why);
}

static bool hears(const struct method_graph *graph, int i, int j)
{
    for (int k = graph->in_first[i]; k < graph->in_first[i + 1]; k++)
        if (graph->in[k] == j)
            return true;
    return i == j;
}

/* Whom a node hears it predicts, and needs all that they need: those that its neighbours hear. */
static bool graph_is_closed(const struct method_setup *setup, struct error *error)
{
    const struct method_graph *graph = setup->graph;
    const int i = setup->node;
    for (int k = graph->in_first[i]; k < graph->in_first[i + 1]; k++) {
        const int j = graph->in[k];
        for (int l = graph->in_first[j]; l < graph->in_first[j + 1]; l++)
            if (!hears(graph, i, graph->in[l]))
                return fail(setup, error,
                            "node %d predicts node %d, which hears node %d: it has to hear that, "
                            "too",
                            i, j, graph->in[l]);
    }
    return true;
}

static bool graph_fits(const struct method_setup *setup, struct error *error)
{
    const struct high_gain_ekf_section *section = setup->section;
    const int p = setup->process->n_subsystems;
    if (section->framework == HIGH_GAIN_EKF_CENTRALISED)
        return fail(setup, error, "a centralised filter talks to nobody", 0, 0, 0);
    if (setup->graph->nodes != p)
        return fail(setup, error, "has %d nodes; the plant has %d subsystems", setup->graph->nodes,
                    p, 0);
    if (section->innovation == DSE_HIGH_GAIN_SUM && setup->graph->in_first[p] < p * (p - 1))
        return fail(setup, error, "with innovation sum all %d nodes need to hear each other", p, 0,
                    0);
    return graph_is_closed(setup, error);
}

/* Who is in the picture of a node: all, or itself and whom it hears. */
static bool choose_blocks(struct high_gain_ekf_node *node, const struct method_setup *setup,
                          int *blocks, struct error *error)
{
    const bool whole = ((const struct high_gain_ekf_section *)setup->section)->framework ==
                       HIGH_GAIN_EKF_CENTRALISED;
    *blocks = 0;
    node->block = calloc((size_t)node->whole_form.p + 1, sizeof *node->block);
    if (node->block == NULL)
        return error_set(error, "out of memory");
    for (int j = 0; j < node->whole_form.p; j++) {
        if (setup->graph != NULL && !hears(setup->graph, setup->node, j))
            continue;
        if (j == setup->node && !whole)
            node->own = *blocks;
        node->block[(*blocks)++] = j;
    }
    return true;
}

/* One part of the node's, of the filter's plant or the predictor's. */
static bool make_part(struct high_gain_ekf_node *node, const struct method_setup *setup, int blocks,
                      const struct dse_model *model, struct dse_arena *arena, struct dse_part *part,
                      struct error *error)
{
    const struct dse_plant *process = setup->process;
    dse_real x[DSE_PLANT_MAX_STATES], u[DSE_PLANT_MAX_INPUTS] = {0};
    int by = 0, on = 0;
    for (int k = 0; k < process->nx; k++)
        x[k] = (dse_real)setup->network->guess[k];
    for (int k = 0; k < process->nu; k++)
        u[k] = process->inputs[k].nominal;
    enum dse_status status =
        dse_part_init(part, model, &node->whole_form, node->block, blocks, x, u, arena);
    if (status != DSE_OK)
        return error_set(error, "%s: networks.%s.guess: the plant cannot be evaluated there: %s",
                         setup->scenario->file, setup->network->name, dse_status_text(status));
    if (dse_part_closed(part, 0, u, &by, &on) == DSE_OK)
        return true;
    return fail(setup, error,
                "subsystem %d acts on subsystem %d: node %d has to hear it to predict that", by, on,
                setup->node);
}

static bool take_part(struct high_gain_ekf_node *node, const struct method_setup *setup, int blocks,
                      struct error *error)
{
    const struct dse_plant *process = setup->process;
    const bool two = node->config.predictor_model != NULL;
    struct dse_arena arena;
    node->part_storage =
        (two ? 2 : 1) * DSE_PART_STORAGE(process->nx, process->ny, process->n_subsystems);
    node->part_memory = calloc((size_t)node->part_storage, sizeof *node->part_memory);
    if (node->part_memory == NULL)
        return error_set(error, "out of memory");
    dse_arena_init(&arena, node->part_memory, node->part_storage);
    if (!make_part(node, setup, blocks, &node->whole_model, &arena, &node->part, error) ||
        (two && !make_part(node, setup, blocks, &node->whole_predictor_model, &arena,
                           &node->predictor_part, error)))
        return false;
    node->model = node->part.model;
    node->form = node->part.form;
    node->predictor_model = node->predictor_part.model;
    return true;
}

/* ---- all of it ---- */

bool high_gain_ekf_take_plant(struct high_gain_ekf_node *node, const struct method_setup *setup,
                              struct error *error)
{
    int blocks = 0;
    setup->process->model(setup->prepared, &node->whole_model);
    setup->process->normal_form(setup->prepared, &node->whole_form);
    node->model = node->whole_model;
    node->form = node->whole_form;
    if (node->form.encode == NULL && node->section->coordinates != DSE_HIGH_GAIN_PHYSICAL)
        return error_set(error,
                         "%s: networks.%s.high_gain_ekf.coordinates: plant %s has no normal form "
                         "with these parameters; use physical",
                         setup->scenario->file, setup->network->name, setup->process->name);
    if ((setup->graph != NULL && !graph_fits(setup, error)) ||
        !choose_blocks(node, setup, &blocks, error) || !prepare_predictor(node, setup, error))
        return false;
    return blocks == node->whole_form.p || take_part(node, setup, blocks, error);
}

void high_gain_ekf_leave_plant(struct high_gain_ekf_node *node)
{
    free(node->part_memory);
    free(node->block);
    free(node->values);
    free(node->prepared);
}

void high_gain_ekf_guess(const struct high_gain_ekf_node *node, const struct method_setup *setup,
                         dse_real *x0)
{
    for (int k = 0; k < node->form.n; k++)
        x0[k] = (dse_real)setup->network->guess[node->part_storage > 0 ? node->part.state[k] : k];
}

void high_gain_ekf_describe_neighbours(const struct method_setup *setup, struct method_info *info)
{
    const struct method_graph *graph = setup->graph;
    const int i = setup->node;
    for (int j = 0; j < setup->process->n_subsystems; j++) {
        if (j != i && (graph == NULL || hears(graph, i, j)))
            info->neighbours[info->n_neighbours++] = j;
        if (j != i && (graph == NULL || hears(graph, j, i)))
            info->listeners[info->n_listeners++] = j;
    }
}

int high_gain_ekf_place(const struct high_gain_ekf_node *node, int j)
{
    for (int b = 0; b < node->form.p; b++)
        if (node->block[b] == j)
            return b;
    return -1;
}
