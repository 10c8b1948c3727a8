/* Nodes on a graph of sensors that talk in rounds: sensors, guesses, weights and the exchange. */
#include "methods/sensor_node.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- who reads what ---- */

static struct sensor_network sensors_of(const struct sensor_node_keys *keys)
{
    return (struct sensor_network){.group = keys->sensors, .count = keys->sensors_count};
}

int sensor_node_nodes(const struct method_setup *setup, const struct sensor_node_keys *keys,
                      struct sensor_node_place place)
{
    const struct sensor_network sensors = sensors_of(keys);
    return place.central ? 1 : sensor_network_nodes(setup, &sensors);
}

/* How many nodes the lists of a section speak of: the central node's are those of the network that
 * it is compared with. */
static int listed(const struct method_setup *setup, const struct sensor_node_keys *keys,
                  struct sensor_node_place place)
{
    if (!place.central)
        return sensor_node_nodes(setup, keys, place);
    return keys->sensors != NULL ? (int)keys->sensors_count : setup->process->n_subsystems;
}

static bool fail(const struct method_setup *setup, struct error *error, const char *text)
{
    const struct method *method = method_at(scenario_method(setup->network));
    return error_set(error, "%s: networks.%s.%s%s", setup->scenario->file, setup->network->name,
                     method->name, text);
}

static bool check_central(const struct method_setup *setup, const struct sensor_node_keys *keys,
                          struct error *error)
{
    if (setup->graph != NULL)
        return error_set(error, "%s: networks.%s.graph: a central node hears nobody; leave it out",
                         setup->scenario->file, setup->network->name);
    for (unsigned i = 0; i < keys->sensors_count; i++) {
        if ((int)keys->sensors[i] >= setup->process->n_subsystems)
            return fail(setup, error, ".sensors: there is no such sensor group");
        for (unsigned other = 0; other < i; other++)
            if (keys->sensors[other] == keys->sensors[i])
                return fail(setup, error, ".sensors: a central node reads each group once");
    }
    return true;
}

bool sensor_node_check(const struct method_setup *setup, const struct sensor_node_keys *keys,
                       struct sensor_node_place place, struct error *error)
{
    const struct sensor_network sensors = sensors_of(keys);
    const int wanted = listed(setup, keys, place) * setup->process->nx;
    if (!(place.central ? check_central(setup, keys, error)
                        : sensor_network_check(setup, &sensors, error)))
        return false;
    if (!place.alone && setup->graph == NULL)
        return error_set(error,
                         "%s: networks.%s.graph is missing: who hears whom; without one there are "
                         "only the schemes none and central",
                         setup->scenario->file, setup->network->name);
    if (keys->guesses == NULL && setup->network->guess == NULL)
        return fail(setup, error,
                    ".guesses is missing: the initial estimates, or networks[].guess");
    if (keys->guesses != NULL && (int)keys->guesses_count != wanted)
        return error_set(error, "%s: networks.%s: guesses has %u values; it must have %d",
                         setup->scenario->file, setup->network->name, keys->guesses_count, wanted);
    return true;
}

/* ---- making one ---- */

static void add_group(struct sensor_node *node, const struct method_setup *setup, int group,
                      struct method_info *info)
{
    const struct dse_subsystem *own = &setup->process->subsystems[group];
    info->groups[info->n_groups++] = group;
    for (int l = 0; l < own->n_outputs && node->ny < DSE_PLANT_MAX_OUTPUTS; l++)
        node->outputs[node->ny++] = own->outputs[l];
}

static void find_sensors(struct sensor_node *node, const struct method_setup *setup,
                         struct sensor_node_place place, struct method_info *info)
{
    const struct sensor_network sensors = sensors_of(node->keys);
    if (!place.central) {
        sensor_network_describe(setup, &sensors, info);
        const int group = info->groups[0];
        info->n_groups = 0;
        add_group(node, setup, group, info);
        return;
    }
    snprintf(info->name, sizeof info->name, "all sensors");
    for (int g = 0; g < listed(setup, node->keys, place); g++)
        add_group(node, setup, sensors.group != NULL ? (int)sensors.group[g] : g, info);
}

static bool find_neighbours(struct sensor_node *node, const struct method_setup *setup,
                            struct sensor_node_place place, struct method_info *info,
                            struct error *error)
{
    const struct method_graph *graph = setup->graph;
    for (int i = 0; graph != NULL && i < graph->nodes; i++) {
        const int degree = graph->in_first[i + 1] - graph->in_first[i];
        node->largest_degree = degree > node->largest_degree ? degree : node->largest_degree;
    }
    if (place.alone)
        info->n_neighbours = info->n_listeners = 0;
    node->n_neighbours = info->n_neighbours;
    node->n_listeners = info->n_listeners;
    node->neighbours = calloc((size_t)node->n_neighbours + 1, sizeof *node->neighbours);
    if (node->neighbours == NULL)
        return error_set(error, "out of memory");
    for (int j = 0; j < node->n_neighbours; j++)
        node->neighbours[j] = info->neighbours[j];
    return true;
}

bool sensor_node_open(struct sensor_node *node, const struct method_setup *setup,
                      const struct sensor_node_keys *keys, struct sensor_node_place place,
                      struct method_info *info, struct error *error)
{
    memset(info, 0, sizeof *info);
    node->keys = keys;
    node->nx = setup->process->nx;
    node->nodes = sensor_node_nodes(setup, keys, place);
    setup->process->model(setup->prepared, &node->model);
    find_sensors(node, setup, place, info);
    info->n_states = node->nx;
    for (int s = 0; s < node->nx; s++)
        info->states[s] = s;
    if (!find_neighbours(node, setup, place, info, error))
        return false;
    if (setup->link == NULL || place.alone)
        return true;
    node->links = lossy_rounds_create(setup, error);
    return node->links != NULL;
}

/* Its rows of the Jacobian of the outputs, which are linear in the state and do not change. */
static bool read_outputs(struct sensor_node *node, const struct method_setup *setup,
                         struct error *error)
{
    const struct dse_plant *process = setup->process;
    const int nx = node->nx;
    dse_real u[DSE_PLANT_MAX_INPUTS] = {0}, *all = NULL;
    for (int j = 0; j < process->nu; j++)
        u[j] = process->inputs[j].nominal;
    all = calloc((size_t)process->ny * (size_t)nx + 1, sizeof *all);
    if (all == NULL)
        return error_set(error, "out of memory");
    const bool known =
        node->model.dhdx != NULL && node->model.dhdx(&node->model, 0, node->x0, u, all) == DSE_OK;
    for (int l = 0; known && l < node->ny; l++)
        memcpy(node->C + l * nx, all + node->outputs[l] * nx, (size_t)nx * sizeof *all);
    free(all);
    return known || error_set(error, "plant %s has no Jacobian of its outputs", process->name);
}

static void fill_guess(struct sensor_node *node, const struct method_setup *setup)
{
    const struct sensor_node_keys *keys = node->keys;
    const int nx = node->nx, own = setup->node * nx;
    const bool central = (int)keys->guesses_count > node->nodes * nx;
    for (int s = 0; s < nx; s++) {
        if (keys->guesses == NULL || (central && setup->network->guess != NULL)) {
            node->x0[s] = setup->network->guess[s];
        } else if (central) {
            const int n = (int)keys->guesses_count / nx;
            for (int i = 0; i < n; i++)
                node->x0[s] += keys->guesses[i * nx + s];
            node->x0[s] /= n;
        } else {
            node->x0[s] = keys->guesses[own + s];
        }
    }
}

bool sensor_node_take_memory(struct sensor_node *node, const struct method_setup *setup,
                             int storage, struct error *error)
{
    const struct sensor_node_keys *keys = node->keys;
    const int nx = node->nx, ny = node->ny;
    const int reals = nx + 2 * nx * nx + ny * ny + ny * nx + storage;
    node->memory = calloc((size_t)reals + 1, sizeof *node->memory);
    if (node->memory == NULL)
        return error_set(error, "out of memory");
    dse_arena_init(&node->arena, node->memory, reals);
    node->x0 = dse_arena_take(&node->arena, nx);
    node->P0 = dse_arena_take(&node->arena, nx * nx);
    node->R = dse_arena_take(&node->arena, ny * ny);
    node->C = dse_arena_take(&node->arena, ny * nx);
    for (int s = 0; s < nx; s++)
        node->P0[s * nx + s] = keys->P0 != NULL ? keys->P0[s] : 1;
    for (int l = 0; l < ny; l++)
        node->R[l * ny + l] = keys->R[node->outputs[l]];
    if (keys->Q != NULL) {
        node->Q = dse_arena_take(&node->arena, nx * nx);
        for (int s = 0; s < nx; s++)
            node->Q[s * nx + s] = keys->Q[s];
    }
    fill_guess(node, setup);
    return read_outputs(node, setup, error);
}

void sensor_node_describe(const struct sensor_node *node, size_t filter_bytes,
                          struct method_info *info)
{
    const int rounds = node->kind->rounds(node->filter);
    for (int r = 0; r < rounds; r++)
        for (int j = 0; j < node->n_neighbours && info->n_frames < METHOD_MAX_FRAMES; j++)
            info->frames[info->n_frames++] = (struct method_frame){
                .from = node->neighbours[j], .values = node->kind->message_size(node->filter, r)};
    info->storage_bytes =
        (int64_t)filter_bytes + (int64_t)node->arena.used * (int64_t)sizeof(dse_real);
}

void sensor_node_close(struct sensor_node *node)
{
    lossy_rounds_destroy(node->links);
    free(node->neighbours);
    free(node->memory);
}

/* ---- a sample ---- */

bool sensor_node_begin(struct sensor_node *node, const struct method_sample *sample)
{
    node->k = sample->k;
    node->idle = sample->k < (int64_t)node->keys->skip;
    node->failed = DSE_OK;
    return !node->idle;
}

/* A filter whose sample failed has nothing to say, but its neighbours wait for a word in every
 * round. */
enum method_step sensor_node_next(struct sensor_node *node, int round, struct method_plan *plan,
                                  struct method_message *message)
{
    if (node->idle)
        return METHOD_DONE;
    if (round > 0 && node->failed == DSE_OK)
        node->failed = node->kind->end_round(node->filter);
    if (round >= node->kind->rounds(node->filter))
        return METHOD_DONE;
    plan->speak = node->n_listeners > 0;
    message->count = node->failed == DSE_OK ? node->kind->message(node->filter, message->value) : 0;
    message->withheld = message->count == 0;
    return METHOD_ROUND;
}

enum dse_status sensor_node_receive(struct sensor_node *node, int from,
                                    const struct method_message *message)
{
    const int j = sensor_network_place(node->neighbours, node->n_neighbours, from);
    if (node->links != NULL && lossy_rounds_lost(node->links, from, node->k, 0))
        return DSE_OK;
    if (j < 0 || message->count == 0 || node->failed != DSE_OK)
        return DSE_OK;
    return node->kind->receive(node->filter, j, message->value, message->count);
}

void sensor_node_estimate(const struct sensor_node *node, const dse_real *x, const dse_real *P,
                          struct method_estimate *estimate)
{
    for (int s = 0; s < node->nx; s++) {
        estimate->state[s] = x[s];
        estimate->variance[s] = P[s * node->nx + s];
    }
}
