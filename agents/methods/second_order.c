/* The distributed second-order filters as a method: node i is a second-order filter of the whole
 * plant with the sensors of one group. A sample has as many rounds as the scheme says. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "methods/second_order_section.h"

enum second_order_diagnostic {
    DIAGNOSTIC_INNOVATION,
    DIAGNOSTIC_TRACE,
    DIAGNOSTIC_LOOP_GAIN,
    DIAGNOSTIC_SILENT,
    DIAGNOSTIC_REFUSED,
    DIAGNOSTIC_FALLBACK,
    DIAGNOSTICS
};

struct second_order_node {
    const struct second_order_section *section;
    struct sensor_node node;
    struct dse_dso_config config;
    struct dse_dso filter;
    dse_real input[DSE_PLANT_MAX_INPUTS]; /* of the sample before: held up to this one */
};

/* ---- the library's functions behind struct sensor_node ---- */

static int rounds(const void *filter)
{
    return dse_dso_rounds(filter);
}

static int message_size(const void *filter, int round)
{
    return dse_dso_message_size(filter, round);
}

static int message_of(const void *filter, dse_real *message)
{
    return dse_dso_message(filter, message);
}

static enum dse_status receive_from(void *filter, int neighbour, const dse_real *message, int count)
{
    return dse_dso_receive(filter, neighbour, message, count);
}

static enum dse_status end_round(void *filter)
{
    return dse_dso_end_round(filter);
}

static const struct sensor_node_filter kind = {rounds, message_size, message_of, receive_from,
                                               end_round};

/* ---- making one ---- */

static int nodes(const struct method_setup *setup)
{
    const struct second_order_section *section = setup->section;
    return sensor_node_nodes(setup, &section->keys, second_order_place(section));
}

static void destroy(void *self)
{
    struct second_order_node *node = self;
    sensor_node_close(&node->node);
    free(node);
}

static void fill_config(struct second_order_node *self)
{
    const struct second_order_section *section = self->section;
    const struct sensor_node *node = &self->node;
    self->config = (struct dse_dso_config){
        .filter = {.model = &node->model,
                   .ny = node->ny,
                   .C = node->C,
                   .kind = section->kind,
                   .x0 = node->x0,
                   .S0 = node->P0,
                   .Q = node->Q,
                   .R = node->R,
                   .gate = section->gate,
                   .substeps = (int)section->substeps},
        .scheme = second_order_place(section).alone ? DSE_DSO_ALONE
                                                    : (enum dse_dso_scheme)section->scheme,
        .n_neighbours = node->n_neighbours,
        .delta = section->delta,
        .normalised = section->normalised,
        .epsilon = section->keys.epsilon,
        .alpha = section->keys.alpha,
        .memory = section->memory,
        .rounds = (int)section->keys.rounds,
        .nodes = node->nodes,
    };
}

static bool open_filter(struct second_order_node *self, const struct method_setup *setup,
                        struct method_info *info, struct error *error)
{
    struct sensor_node *node = &self->node;
    const struct sensor_node_place place = second_order_place(self->section);
    node->kind = &kind;
    node->filter = &self->filter;
    if (!sensor_node_open(node, setup, &self->section->keys, place, info, error) ||
        !sensor_node_take_memory(node, setup,
                                 DSE_DSO_STORAGE(node->nx, node->ny, node->n_neighbours), error))
        return false;
    fill_config(self);
    const enum dse_status status = dse_dso_init(&self->filter, &self->config, &node->arena);
    return status == DSE_OK ||
           error_set(error, "%s: networks.%s.second_order: filter %d cannot be set up: %s",
                     setup->scenario->file, setup->network->name, setup->node,
                     dse_status_text(status));
}

static void *create(const struct method_setup *setup, struct method_info *info, struct error *error)
{
    static const struct method_signal diagnostics[DIAGNOSTICS] = {
        [DIAGNOSTIC_INNOVATION] = {"innovation", ""},
        [DIAGNOSTIC_TRACE] = {"trace of S", ""},
        [DIAGNOSTIC_LOOP_GAIN] = {"loop gain", ""},
        [DIAGNOSTIC_SILENT] = {"messages not heard", ""},
        [DIAGNOSTIC_REFUSED] = {"messages refused", ""},
        [DIAGNOSTIC_FALLBACK] = {"fusions refused", ""},
    };
    if (!second_order_section_check(setup, error))
        return NULL;
    struct second_order_node *self = calloc(1, sizeof *self);
    if (self == NULL) {
        error_set(error, "out of memory");
        return NULL;
    }
    self->section = setup->section;
    if (!open_filter(self, setup, info, error)) {
        destroy(self);
        return NULL;
    }
    sensor_node_describe(&self->node, sizeof self->filter, info);
    info->n_diagnostics = DIAGNOSTICS;
    memcpy(info->diagnostics, diagnostics, sizeof diagnostics);
    return self;
}

/* ---- a sample ---- */

static enum dse_status begin(void *self, const struct method_sample *sample)
{
    struct second_order_node *me = self;
    const struct dse_measurement measurement = {.y = sample->y, .valid = sample->valid};
    const int nu = me->node.model.nu;
    if (sample->k == 0 && nu > 0)
        memcpy(me->input, sample->u, (size_t)nu * sizeof *me->input);
    if (sensor_node_begin(&me->node, sample))
        me->node.failed = dse_dso_begin(&me->filter, sample->t, me->input, &measurement);
    if (nu > 0)
        memcpy(me->input, sample->u, (size_t)nu * sizeof *me->input);
    return DSE_OK; /* a failure is told once, by finish */
}

static enum method_step next(void *self, int round, struct method_plan *plan,
                             struct method_message *message)
{
    struct second_order_node *me = self;
    return sensor_node_next(&me->node, round, plan, message);
}

static enum dse_status receive(void *self, int round, int from,
                               const struct method_message *message)
{
    struct second_order_node *me = self;
    (void)round;
    return sensor_node_receive(&me->node, from, message);
}

static void tell(const struct second_order_node *me, double *diagnostic)
{
    const dse_real *S = dse_dso_covariance(&me->filter);
    const dse_real *innovation = dse_dso_innovation(&me->filter);
    const struct dse_dso_counts *counts = dse_dso_counts(&me->filter);
    double squares = 0, trace = 0;
    for (int l = 0; l < me->node.ny; l++)
        squares += innovation[l] * innovation[l];
    for (int s = 0; s < me->node.nx; s++)
        trace += S[s * me->node.nx + s];
    diagnostic[DIAGNOSTIC_INNOVATION] = sqrt(squares);
    diagnostic[DIAGNOSTIC_TRACE] = trace;
    diagnostic[DIAGNOSTIC_LOOP_GAIN] = dse_dso_loop_gain(&me->filter);
    diagnostic[DIAGNOSTIC_SILENT] = (double)counts->silent;
    diagnostic[DIAGNOSTIC_REFUSED] = (double)counts->refused;
    diagnostic[DIAGNOSTIC_FALLBACK] = (double)counts->fallback;
}

static enum dse_status finish(void *self, struct method_estimate *estimate)
{
    struct second_order_node *me = self;
    sensor_node_estimate(&me->node, dse_dso_state(&me->filter), dse_dso_covariance(&me->filter),
                         estimate);
    tell(me, estimate->diagnostic);
    estimate->health = dse_dso_health(&me->filter);
    return me->node.failed;
}

const struct method second_order_method = {
    .name = "second_order",
    .title = "distributed second-order filter",
    .fields = second_order_fields,
    .section_size = sizeof(struct second_order_section),
    .rules = second_order_rules,
    .uses_link = true,
    .nodes = nodes,
    .create = create,
    .destroy = destroy,
    .begin = begin,
    .next = next,
    .receive = receive,
    .finish = finish,
};
