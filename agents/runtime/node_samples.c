/* Collecting what belongs to one sample: the known inputs and the node's own measurements. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/node_internal.h"

static double *take(double **memory, int count)
{
    double *taken = *memory;
    *memory += count;
    return taken;
}

static void sample_free(struct node_sample *sample)
{
    free(sample->u.value);
    free(sample->y);
    free(sample->valid);
    *sample = (struct node_sample){.k = -1};
}

/* Memory for a place of the ring, taken when it is used for the first time. */
static bool sample_create(const struct node *node, struct node_sample *sample)
{
    int nu = node->setup.process->nu;
    double *memory = calloc((size_t)(nu + node->ny) + 1, sizeof *memory);
    sample->y = calloc((size_t)node->info.n_groups + 1, sizeof *sample->y);
    sample->valid = calloc((size_t)node->ny + 1, sizeof *sample->valid);
    sample->u.value = memory;
    if (memory == NULL || sample->y == NULL || sample->valid == NULL) {
        sample_free(sample);
        return false;
    }
    sample->u.value = take(&memory, nu);
    sample->u.capacity = nu;
    for (int g = 0; g < node->info.n_groups; g++) {
        sample->y[g].value = take(&memory, node->group_ny[g]);
        sample->y[g].capacity = node->group_ny[g];
    }
    return true;
}

/* A ring with n_samples places; the samples that wait keep theirs. */
static bool make_ring(struct node *node, int n_samples)
{
    struct node_sample *ring = calloc((size_t)n_samples, sizeof *ring);
    if (ring == NULL)
        return false;
    for (int i = 0; i < n_samples; i++)
        ring[i].k = -1;
    for (int i = 0; i < node->n_samples; i++)
        if (node->samples[i].k >= node->k)
            ring[node->samples[i].k % n_samples] = node->samples[i];
        else
            sample_free(&node->samples[i]);
    free(node->samples);
    node->samples = ring;
    node->n_samples = n_samples;
    return true;
}

/* Whether sample k >= node->k finds a place. */
static bool has_place(struct node *node, int64_t k)
{
    int n_samples = node->n_samples;
    bool may_grow = node->config.pace == DSE_CLOCK_T_PACE_REPLAY;
    while (may_grow && n_samples < NODE_BACKLOG && k - node->k >= n_samples)
        n_samples *= 2;
    return k - node->k < n_samples && (n_samples == node->n_samples || make_ring(node, n_samples));
}

bool node_samples_create(struct node *node, struct error *error)
{
    const struct dse_plant *process = node->setup.process;
    size_t groups = (size_t)node->info.n_groups + 1;
    node->group_ny = calloc(groups, sizeof *node->group_ny);
    node->group_offset = calloc(groups, sizeof *node->group_offset);
    if (node->group_ny == NULL || node->group_offset == NULL)
        return error_set(error, "out of memory");
    for (int g = 0; g < node->info.n_groups; g++) {
        node->group_offset[g] = node->ny;
        node->group_ny[g] = process->subsystems[node->info.groups[g]].n_outputs;
        node->ny += node->group_ny[g];
    }
    node->u_held = calloc((size_t)process->nu + 1, sizeof *node->u_held);
    node->y_stacked = calloc((size_t)node->ny + 1, sizeof *node->y_stacked);
    node->y_valid = calloc((size_t)node->ny + 1, sizeof *node->y_valid);
    bool ok = node->u_held != NULL && node->y_stacked != NULL && node->y_valid != NULL;
    node->newest = -1;
    return (ok && make_ring(node, NODE_SAMPLES)) || error_set(error, "out of memory");
}

void node_samples_destroy(struct node *node)
{
    for (int i = 0; i < node->n_samples; i++)
        sample_free(&node->samples[i]);
    free(node->samples);
    free(node->group_ny);
    free(node->group_offset);
    free(node->u_held);
    free(node->y_stacked);
    free(node->y_valid);
}

/* The place of sample k, emptied when it held an older one; NULL when k is over or too far ahead.
 */
static struct node_sample *sample_of(struct node *node, int64_t k, double t)
{
    if (k < node->k || (k == node->k && node->phase == NODE_IN_ROUND)) {
        node->counters.duplicates++;
        return NULL;
    }
    if (!has_place(node, k))
        return NULL;
    struct node_sample *sample = &node->samples[k % node->n_samples];
    if (sample->y == NULL && !sample_create(node, sample))
        return NULL;
    if (sample->k != k) {
        sample->k = k;
        sample->t = t;
        message_vector_reset(&sample->u);
        for (int g = 0; g < node->info.n_groups; g++)
            message_vector_reset(&sample->y[g]);
        memset(sample->valid, 0, (size_t)node->ny * sizeof *sample->valid);
    }
    return sample;
}

/* Whether a part is one of a vector of `count` values: a vector of another length is no use. */
static bool is_part_of(int count, int part, int parts, int part_count)
{
    return parts == message_parts(count) && part_count == message_part_count(count, part);
}

void node_take_input(struct node *node, const dse_input_t *message)
{
    if (!is_part_of(node->setup.process->nu, message->part, message->parts, message->count)) {
        node->counters.refused_count++;
        return;
    }
    bool has_time = node->config.pace == DSE_CLOCK_T_PACE_REALTIME;
    if (has_time && message->header.sample > node->newest)
        node->newest = message->header.sample; /* even without a place: the earlier ones are over */
    struct node_sample *sample =
        sample_of(node, message->header.sample, message->header.plant_time);
    if (sample == NULL)
        return;
    if (!message_vector_add(&sample->u, message->part, message->parts, message->count,
                            message->value))
        node->counters.refused_count++;
    else if (message_vector_complete(&sample->u) && sample->k > node->newest)
        node->newest = sample->k;
}

static int group_index(const struct node *node, int group)
{
    for (int g = 0; g < node->info.n_groups; g++)
        if (node->info.groups[g] == group)
            return g;
    return -1;
}

void node_take_measurement(struct node *node, const dse_measurement_t *message)
{
    int g = group_index(node, message->header.node);
    if (g < 0 || !is_part_of(node->group_ny[g], message->part, message->parts, message->count)) {
        node->counters.refused_count++;
        return;
    }
    struct node_sample *sample =
        sample_of(node, message->header.sample, message->header.plant_time);
    if (sample == NULL)
        return;
    if (!message_vector_add(&sample->y[g], message->part, message->parts, message->count,
                            message->value)) {
        node->counters.refused_count++;
        return;
    }
    bool current = message->measured_at == message->header.sample;
    bool *valid =
        sample->valid + node->group_offset[g] + message->part * DSE_MEASUREMENT_T_CAPACITY;
    for (int i = 0; i < message->count; i++)
        valid[i] = current && message->valid[i] != 0;
}

/* Vectors of sample node->k that are not here: 0 when it is complete. */
static int missing(const struct node *node)
{
    const struct node_sample *sample = &node->samples[node->k % node->n_samples];
    if (sample->k != node->k)
        return 1 + node->info.n_groups;
    int count = message_vector_complete(&sample->u) ? 0 : 1;
    for (int g = 0; g < node->info.n_groups; g++)
        if (!message_vector_complete(&sample->y[g]))
            count++;
    return count;
}

void node_report_gap(struct node *node, int64_t k, int64_t count)
{
    node->counters.gaps += count;
    if (node->config.pace != DSE_CLOCK_T_PACE_REPLAY || node->gap_reported)
        return;
    node->gap_reported = true;
    fprintf(stderr,
            "%s: %lld message(s) of sample %lld of the replayed log did not arrive: its estimates "
            "will differ from the recorded ones; play it slower (lcm-logplayer --speed=0.5)\n",
            node->name, (long long)count, (long long)k);
}

/* Without lockstep nobody sends a lost sample again: the next one, or the end, tells that it is
 * lost. */
static bool overtaken(const struct node *node)
{
    if (node->config.pace == DSE_CLOCK_T_PACE_LOCKSTEP)
        return false;
    bool ended = node->stopping && host_now() > node->stop_heard + NODE_LINGER;
    return node->newest > node->k || (ended && node->k < node->stop_at);
}

/* The measurements of group g of the current sample; invalid where they did not arrive. */
static void stack_group(struct node *node, const struct node_sample *sample, int g)
{
    int offset = node->group_offset[g];
    size_t count = (size_t)node->group_ny[g];
    memset(node->y_valid + offset, 0, count * sizeof *node->y_valid);
    memset(node->y_stacked + offset, 0, count * sizeof *node->y_stacked);
    if (sample->k != node->k || !message_vector_complete(&sample->y[g]))
        return;
    memcpy(node->y_stacked + offset, sample->y[g].value, count * sizeof *node->y_stacked);
    memcpy(node->y_valid + offset, sample->valid + offset, count * sizeof *node->y_valid);
}

bool node_sample_ready(struct node *node)
{
    const struct node_sample *sample = &node->samples[node->k % node->n_samples];
    int gap = missing(node);
    if (gap > 0 && !overtaken(node))
        return false;
    if (gap > 0)
        node_report_gap(node, node->k, gap);
    bool here = sample->k == node->k;
    node->t = here ? sample->t : (double)node->k * node->setup.period;
    if (here && message_vector_complete(&sample->u))
        memcpy(node->u_held, sample->u.value,
               (size_t)node->setup.process->nu * sizeof *node->u_held);
    for (int g = 0; g < node->info.n_groups; g++)
        stack_group(node, sample, g);
    return true;
}
