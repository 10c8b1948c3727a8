/* The consensus Kalman filters as a method: node i is a filter in information form of the whole
 * plant with the sensors of one group. A sample has as many rounds as the scheme says. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "methods/consensus_kalman_section.h"

enum consensus_kalman_diagnostic {
    DIAGNOSTIC_INNOVATION,
    DIAGNOSTIC_TRACE,
    DIAGNOSTIC_SILENT,
    DIAGNOSTIC_REFUSED,
    DIAGNOSTIC_FALLBACK,
    DIAGNOSTICS
};

struct consensus_kalman_node {
    const struct consensus_kalman_section *section;
    struct sensor_node node;
    struct dse_ckf_config config;
    struct dse_ckf filter;
    dse_real input[DSE_PLANT_MAX_INPUTS]; /* from this sample to the next */
};

/* ---- the library's functions behind struct sensor_node ---- */

static int rounds(const void *filter)
{
    return dse_ckf_rounds(filter);
}

static int message_size(const void *filter, int round)
{
    return dse_ckf_message_size(filter, round);
}

static int message_of(const void *filter, dse_real *message)
{
    return dse_ckf_message(filter, message);
}

static enum dse_status receive_from(void *filter, int neighbour, const dse_real *message, int count)
{
    return dse_ckf_receive(filter, neighbour, message, count);
}

static enum dse_status end_round(void *filter)
{
    return dse_ckf_end_round(filter);
}

static const struct sensor_node_filter kind = {rounds, message_size, message_of, receive_from,
                                               end_round};

/* ---- making one ---- */

static int nodes(const struct method_setup *setup)
{
    const struct consensus_kalman_section *section = setup->section;
    return sensor_node_nodes(setup, &section->keys, consensus_kalman_place(section));
}

static void destroy(void *self)
{
    struct consensus_kalman_node *node = self;
    sensor_node_close(&node->node);
    free(node);
}

static void fill_config(struct consensus_kalman_node *self)
{
    const struct consensus_kalman_section *section = self->section;
    const struct sensor_node *node = &self->node;
    self->config = (struct dse_ckf_config){
        .model = &node->model,
        .ny = node->ny,
        .C = node->C,
        .R = node->R,
        .Q = node->Q,
        .x0 = node->x0,
        .P0 = node->P0,
        .scheme = consensus_kalman_place(section).alone ? DSE_CKF_ALONE
                                                        : (enum dse_ckf_scheme)section->scheme,
        .n_neighbours = node->n_neighbours,
        .largest_degree = node->largest_degree,
        .epsilon = section->keys.epsilon,
        .alpha = section->keys.alpha,
        .nodes = node->nodes,
        .rounds = (int)section->keys.rounds,
        .counting = (enum dse_ckf_counting)section->counting,
        .multiplicity = section->multiplicity,
        .restart = (int)section->restart,
    };
}

static bool open_filter(struct consensus_kalman_node *self, const struct method_setup *setup,
                        struct method_info *info, struct error *error)
{
    struct sensor_node *node = &self->node;
    const struct sensor_node_place place = consensus_kalman_place(self->section);
    node->kind = &kind;
    node->filter = &self->filter;
    if (!sensor_node_open(node, setup, &self->section->keys, place, info, error) ||
        !sensor_node_take_memory(
            node, setup, DSE_CKF_STORAGE(node->nx, node->ny, node->n_neighbours, node->nodes),
            error))
        return false;
    fill_config(self);
    self->config.self = setup->node;
    const enum dse_status status = dse_ckf_init(&self->filter, &self->config, &node->arena);
    return status == DSE_OK ||
           error_set(error, "%s: networks.%s.consensus_kalman: filter %d cannot be set up: %s",
                     setup->scenario->file, setup->network->name, setup->node,
                     dse_status_text(status));
}

static void *create(const struct method_setup *setup, struct method_info *info, struct error *error)
{
    static const struct method_signal diagnostics[DIAGNOSTICS] = {
        [DIAGNOSTIC_INNOVATION] = {"innovation", ""},
        [DIAGNOSTIC_TRACE] = {"trace of P", ""},
        [DIAGNOSTIC_SILENT] = {"messages not heard", ""},
        [DIAGNOSTIC_REFUSED] = {"messages refused", ""},
        [DIAGNOSTIC_FALLBACK] = {"fusions refused", ""},
    };
    if (!consensus_kalman_section_check(setup, error))
        return NULL;
    struct consensus_kalman_node *self = calloc(1, sizeof *self);
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
    struct consensus_kalman_node *me = self;
    const struct dse_measurement measurement = {.y = sample->y, .valid = sample->valid};
    const int nu = me->node.model.nu;
    if (nu > 0)
        memcpy(me->input, sample->u, (size_t)nu * sizeof *me->input);
    if (sensor_node_begin(&me->node, sample))
        me->node.failed =
            dse_ckf_begin(&me->filter, (long)sample->k, sample->t, me->input, &measurement);
    return DSE_OK; /* a failure is told once, by finish */
}

static enum method_step next(void *self, int round, struct method_plan *plan,
                             struct method_message *message)
{
    struct consensus_kalman_node *me = self;
    return sensor_node_next(&me->node, round, plan, message);
}

static enum dse_status receive(void *self, int round, int from,
                               const struct method_message *message)
{
    struct consensus_kalman_node *me = self;
    (void)round;
    return sensor_node_receive(&me->node, from, message);
}

static void tell(const struct consensus_kalman_node *me, double *diagnostic)
{
    const dse_real *P = dse_ckf_covariance(&me->filter);
    const dse_real *innovation = dse_ckf_innovation(&me->filter);
    const struct dse_ckf_counts *counts = dse_ckf_counts(&me->filter);
    double squares = 0, trace = 0;
    for (int l = 0; l < me->node.ny; l++)
        squares += innovation[l] * innovation[l];
    for (int s = 0; s < me->node.nx; s++)
        trace += P[s * me->node.nx + s];
    diagnostic[DIAGNOSTIC_INNOVATION] = sqrt(squares);
    diagnostic[DIAGNOSTIC_TRACE] = trace;
    diagnostic[DIAGNOSTIC_SILENT] = (double)counts->silent;
    diagnostic[DIAGNOSTIC_REFUSED] = (double)counts->refused;
    diagnostic[DIAGNOSTIC_FALLBACK] = (double)counts->fallback;
}

/* The estimate of t_k, then the prior of t_(k+1). */
static enum dse_status finish(void *self, struct method_estimate *estimate)
{
    struct consensus_kalman_node *me = self;
    sensor_node_estimate(&me->node, dse_ckf_state(&me->filter), dse_ckf_covariance(&me->filter),
                         estimate);
    tell(me, estimate->diagnostic);
    enum dse_status moved = DSE_OK;
    if (!me->node.idle)
        moved = dse_ckf_advance(&me->filter);
    estimate->health = dse_ckf_health(&me->filter);
    return me->node.failed != DSE_OK ? me->node.failed : moved;
}

const struct method consensus_kalman_method = {
    .name = "consensus_kalman",
    .title = "consensus Kalman filter",
    .fields = consensus_kalman_fields,
    .section_size = sizeof(struct consensus_kalman_section),
    .rules = consensus_kalman_rules,
    .uses_link = true,
    .nodes = nodes,
    .create = create,
    .destroy = destroy,
    .begin = begin,
    .next = next,
    .receive = receive,
    .finish = finish,
};
