/* The distributed observers as a method: node i is an observer with the sensors of one group. It
 * integrates up to a sample when that arrives, then says its estimate, or the rows of it in which
 * it is compared; what it hears acts in the next period. Without a graph the nodes are alone. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dse/linalg.h"
#include "methods/distributed_observer_section.h"
#include "methods/lossy_link.h"

enum distributed_observer_diagnostic {
    DIAGNOSTIC_GAIN,
    DIAGNOSTIC_FRESH,
    DIAGNOSTIC_HELD,
    DIAGNOSTIC_REFUSED,
    DIAGNOSTIC_DROPPED,
    DIAGNOSTICS
};

struct distributed_observer_node {
    const struct distributed_observer_section *section;
    struct distributed_observer_size size;
    struct dse_observer_rows own;     /* what is said when only the neighbours' residuals count */
    struct dse_observer_rows *theirs; /* one per neighbour */
    bool *u_held;
    struct dse_distributed_observer_config config;
    struct dse_distributed_observer observer;
    dse_real *memory;
    int n_neighbours, n_listeners;
    int *neighbours;
    struct lossy_rounds *links; /* NULL: what is said is heard */
    int64_t k;
};

/* ---- making one ---- */

static void destroy(void *self)
{
    struct distributed_observer_node *node = self;
    lossy_rounds_destroy(node->links);
    free(node->theirs);
    free(node->u_held);
    free(node->neighbours);
    free(node->memory);
    free(node);
}

/* Inputs that go on between the samples are interpolated, the others held from their sample on. */
static void find_held_inputs(struct distributed_observer_node *node,
                             const struct method_setup *setup)
{
    const struct scenario_plant *plant = &setup->scenario->plant;
    for (int i = 0; i < node->size.nu; i++) {
        node->u_held[i] = true;
        for (unsigned d = 0; d < plant->drive_count; d++)
            if (strcmp(plant->drive[d].name, setup->process->inputs[i].name) == 0)
                node->u_held[i] =
                    plant->drive[d].signal != SCENARIO_SINUSOID || plant->drive[d].loop != NULL;
    }
}

static bool take_memory(struct distributed_observer_node *node, int neighbours, int *storage)
{
    const struct distributed_observer_size *n = &node->size;
    const bool own = node->section->residual == DSE_OBSERVER_OWN;
    int rows = own ? neighbours * n->rows : 0, most = own ? n->nr : 0;
    for (int j = 0; !own && j < neighbours; j++) {
        rows += node->theirs[j].rows;
        most = node->theirs[j].rows > most ? node->theirs[j].rows : most;
    }
    *storage = DSE_DISTRIBUTED_OBSERVER_STORAGE(n->nz, n->nu, n->ny, n->nx, neighbours, rows, most);
    node->memory = calloc((size_t)*storage + 1, sizeof *node->memory);
    return node->memory != NULL;
}

static void fill_config(struct distributed_observer_node *node, const struct method_setup *setup)
{
    const struct distributed_observer_section *section = node->section;
    const struct distributed_observer_design *own = &section->nodes[setup->node];
    const struct distributed_observer_size *n = &node->size;
    node->config = (struct dse_distributed_observer_config){
        .nz = n->nz,
        .nu = n->nu,
        .ny = n->ny,
        .nx = n->nx,
        .Lambda = own->Lambda,
        .L = own->L,
        .H = own->H,
        .M = own->M,
        .N = own->N,
        .J = own->J,
        .z0 = own->z0,
        .u_held = node->u_held,
        .neighbours = node->n_neighbours,
        .residual = section->residual,
        .gain = section->gain,
        .Pi = own->Pi,
        .theirs = node->theirs,
        .own = node->own,
        .nr = n->nr,
        .D = own->D,
        .D_y = own->D_y,
        .D_u = own->D_u,
        .gamma = section->gamma,
        .leak = section->leak,
        .gain_max = section->gain_max,
        .hold = sensor_network_hold(section->hold),
    };
    struct dse_model model;
    setup->process->model(setup->prepared, &model);
    node->config.time = model.time;
}

static bool says_rows(const struct distributed_observer_node *node)
{
    return node->section->residual == DSE_OBSERVER_NEIGHBOURS;
}

static void describe(const struct distributed_observer_node *node, const struct method_setup *setup,
                     int storage, struct method_info *info)
{
    static const struct method_signal diagnostics[DIAGNOSTICS] = {
        [DIAGNOSTIC_GAIN] = {"|Gamma|", ""},
        [DIAGNOSTIC_FRESH] = {"neighbours heard", ""},
        [DIAGNOSTIC_HELD] = {"neighbours held", ""},
        [DIAGNOSTIC_REFUSED] = {"messages refused", ""},
        [DIAGNOSTIC_DROPPED] = {"neighbours dropped", ""},
    };
    info->n_states = node->size.nx;
    for (int s = 0; s < info->n_states; s++)
        info->states[s] = node->section->states != NULL ? (int)node->section->states[s] : s;
    for (int j = 0; j < node->n_neighbours; j++)
        info->frames[info->n_frames++] = (struct method_frame){
            .from = node->neighbours[j],
            .values = says_rows(node) ? distributed_observer_rows(setup, node->neighbours[j]).rows
                                      : node->size.nx};
    info->n_diagnostics = DIAGNOSTICS;
    memcpy(info->diagnostics, diagnostics, sizeof diagnostics);
    info->storage_bytes = (int64_t)sizeof node->observer + storage * (int64_t)sizeof(dse_real);
}

/* Neighbours and what they say. */
static bool find_neighbours(struct distributed_observer_node *node,
                            const struct method_setup *setup, const struct method_info *info)
{
    node->n_neighbours = info->n_neighbours;
    node->n_listeners = info->n_listeners;
    node->neighbours = calloc((size_t)info->n_neighbours + 1, sizeof *node->neighbours);
    node->theirs = calloc((size_t)info->n_neighbours + 1, sizeof *node->theirs);
    node->u_held = calloc((size_t)node->size.nu + 1, sizeof *node->u_held);
    if (node->neighbours == NULL || node->theirs == NULL || node->u_held == NULL)
        return false;
    for (int j = 0; j < info->n_neighbours; j++) {
        node->neighbours[j] = info->neighbours[j];
        node->theirs[j] = distributed_observer_rows(setup, info->neighbours[j]);
    }
    return true;
}

static bool open_observer(struct distributed_observer_node *node, const struct method_setup *setup,
                          struct method_info *info, struct error *error)
{
    const struct sensor_network sensors = distributed_observer_sensors(node->section);
    struct dse_arena arena;
    int storage = 0;
    sensor_network_describe(setup, &sensors, info);
    node->size = distributed_observer_size(setup, setup->node);
    node->own = distributed_observer_rows(setup, setup->node);
    if (!find_neighbours(node, setup, info) || !take_memory(node, node->n_neighbours, &storage))
        return error_set(error, "out of memory");
    find_held_inputs(node, setup);
    fill_config(node, setup);
    dse_arena_init(&arena, node->memory, storage);
    enum dse_status status = dse_distributed_observer_init(&node->observer, &node->config, &arena);
    if (status != DSE_OK)
        return error_set(
            error, "%s: networks.%s.distributed_observer.nodes[%d] cannot be set up: %s",
            setup->scenario->file, setup->network->name, setup->node, dse_status_text(status));
    if (setup->link != NULL && (node->links = lossy_rounds_create(setup, error)) == NULL)
        return false;
    describe(node, setup, storage, info);
    return true;
}

static void *create(const struct method_setup *setup, struct method_info *info, struct error *error)
{
    if (!distributed_observer_section_check(setup, error))
        return NULL;
    struct distributed_observer_node *node = calloc(1, sizeof *node);
    if (node == NULL) {
        error_set(error, "out of memory");
        return NULL;
    }
    memset(info, 0, sizeof *info);
    node->section = setup->section;
    if (!open_observer(node, setup, info, error)) {
        destroy(node);
        return NULL;
    }
    return node;
}

static int nodes(const struct method_setup *setup)
{
    const struct distributed_observer_section *section = setup->section;
    return (int)section->nodes_count;
}

/* ---- a sample ---- */

/* Up to t_k, with what was heard after t_(k-1) (section 3, agent mode). */
static enum dse_status begin(void *self, const struct method_sample *sample)
{
    struct distributed_observer_node *node = self;
    struct dse_measurement measurement = {.y = sample->y, .valid = sample->valid};
    node->k = sample->k;
    return dse_distributed_observer_sample(&node->observer, sample->t, sample->u, &measurement);
}

static enum method_step next(void *self, int round, struct method_plan *plan,
                             struct method_message *message)
{
    struct distributed_observer_node *node = self;
    const dse_real *xh = dse_distributed_observer_estimate(&node->observer);
    if (round > 0 || (node->n_neighbours == 0 && node->n_listeners == 0))
        return METHOD_DONE;
    plan->speak = node->n_listeners > 0; /* to be heard in the next period */
    message->withheld = !dse_distributed_observer_may_speak(&node->observer);
    if (message->withheld)
        return METHOD_ROUND;
    message->count = node->size.nx;
    if (says_rows(node) && node->own.C2 != NULL) {
        message->count = node->own.rows;
        dse_mat_vec(node->own.rows, node->size.nx, node->own.C2, xh, message->value);
    } else {
        memcpy(message->value, xh, (size_t)node->size.nx * sizeof *xh);
    }
    return METHOD_ROUND;
}

static enum dse_status receive(void *self, int round, int from,
                               const struct method_message *message)
{
    struct distributed_observer_node *node = self;
    int j = sensor_network_place(node->neighbours, node->n_neighbours, from);
    if ((node->links != NULL && lossy_rounds_lost(node->links, from, node->k, round)) ||
        message->count == 0 || j < 0)
        return DSE_OK;
    if (!says_rows(node))
        return message->count == node->size.nx
                   ? dse_distributed_observer_receive(&node->observer, j, message->value)
                   : DSE_EDIM;
    return message->count == node->theirs[j].rows
               ? dse_distributed_observer_receive_rows(&node->observer, j, message->value)
               : DSE_EDIM;
}

static void tell(const struct distributed_observer_node *node, double *diagnostic)
{
    const struct dse_distributed_observer *observer = &node->observer;
    const dse_real *Gamma = dse_distributed_observer_gains(observer);
    double sum = 0;
    for (int k = 0; k < observer->n_gain; k++)
        sum += Gamma[k] * Gamma[k];
    diagnostic[DIAGNOSTIC_GAIN] = sqrt(sum);
    for (int j = 0; j < node->n_neighbours; j++) {
        enum dse_observer_hearing heard = dse_distributed_observer_hearing(observer, j);
        diagnostic[DIAGNOSTIC_FRESH] += heard == DSE_OBSERVER_FRESH;
        diagnostic[DIAGNOSTIC_HELD] += heard == DSE_OBSERVER_HELD;
    }
    diagnostic[DIAGNOSTIC_REFUSED] = (double)observer->refused;
    diagnostic[DIAGNOSTIC_DROPPED] = (double)observer->dropped;
}

static enum dse_status finish(void *self, struct method_estimate *estimate)
{
    struct distributed_observer_node *node = self;
    const dse_real *xh = dse_distributed_observer_estimate(&node->observer);
    for (int s = 0; s < node->size.nx; s++) {
        estimate->state[s] = xh[s];
        estimate->variance[s] = NAN;
    }
    for (int d = 0; d < DIAGNOSTICS; d++)
        estimate->diagnostic[d] = 0;
    tell(node, estimate->diagnostic);
    estimate->health = dse_distributed_observer_health(&node->observer);
    return DSE_OK;
}

const struct method distributed_observer_method = {
    .name = "distributed_observer",
    .title = "distributed observer",
    .fields = distributed_observer_fields,
    .section_size = sizeof(struct distributed_observer_section),
    .rules = distributed_observer_rules,
    .uses_link = true,
    .nodes = nodes,
    .create = create,
    .destroy = destroy,
    .begin = begin,
    .next = next,
    .receive = receive,
    .finish = finish,
};
