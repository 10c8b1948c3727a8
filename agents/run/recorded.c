/* A recorded run, read from its log. */
#include "run/recorded.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/channels.h"
#include "runtime/messages.h"

bool recorded_open(const char *path, struct recorded *recorded, struct error *error)
{
    memset(recorded, 0, sizeof *recorded);
    recorded->path = path;
    struct log_reader *log = log_open(path, error);
    struct run_info_text *text = calloc(1, sizeof *text);
    if (log == NULL || text == NULL) {
        log_close(log);
        free(text);
        return error_set(error, "out of memory");
    }
    struct message_counters counters = {0};
    struct log_event event;
    dse_run_info_t message;
    bool found = false;
    while (!found && log_next(log, &event)) {
        if (strcmp(event.channel, CHANNEL_RUN_INFO) != 0 ||
            !message_run_info(event.bytes, event.length, &counters, &message) ||
            message.header.role != DSE_HEADER_T_ROLE_PLANT)
            continue;
        recorded->run_id = message.header.run_id;
        found = run_info_add(text, &message);
    }
    log_close(log);
    bool ok = found && run_info_read_scenario(text->text, &recorded->info);
    free(text);
    return ok || error_set(error,
                           "%s: no run_info of a plant in it: not a log of a dse run, or cut "
                           "off at the very beginning",
                           path);
}

/* The states and the inputs that estimators do not know. */
static int width_of_truth(const struct dse_plant *process)
{
    return process->nx + process->n_unknown;
}

static bool allocate(struct recorded *recorded, struct error *error)
{
    const struct dse_plant *process = recorded->process;
    size_t samples = (size_t)recorded->info.samples;
    recorded->t = calloc(samples + 1, sizeof *recorded->t);
    recorded->x = calloc(samples * (size_t)width_of_truth(process) + 1, sizeof *recorded->x);
    recorded->u = calloc(samples * (size_t)process->nu + 1, sizeof *recorded->u);
    recorded->y = calloc(samples * (size_t)process->ny + 1, sizeof *recorded->y);
    recorded->valid = calloc(samples * (size_t)process->ny + 1, sizeof *recorded->valid);
    recorded->have_u = calloc(samples + 1, 1);
    recorded->have_x = calloc(samples + 1, 1);
    recorded->have_y = calloc(samples * (size_t)process->n_subsystems + 1, 1);
    bool ok = recorded->t && recorded->x && recorded->u && recorded->y && recorded->valid &&
              recorded->have_u && recorded->have_x && recorded->have_y;
    return ok || error_set(error, "out of memory");
}

void recorded_free(struct recorded *recorded)
{
    run_info_scenario_free(&recorded->info);
    free(recorded->t);
    free(recorded->x);
    free(recorded->u);
    free(recorded->y);
    free(recorded->valid);
    free(recorded->have_u);
    free(recorded->have_x);
    free(recorded->have_y);
    for (int i = 0; i < recorded->n_estimates; i++) {
        free(recorded->estimates[i].values);
        free(recorded->estimates[i].have);
    }
    free(recorded->estimates);
}

static bool in_range(const struct recorded *recorded, const dse_header_t *header)
{
    return header->run_id == recorded->run_id && header->sample >= 0 &&
           header->sample < recorded->info.samples;
}

/* Values of one part into row k of a table with `width` columns; false when they do not fit. */
static bool store(double *table, int width, int64_t k, int part, int count, const double *value)
{
    int offset = part * DSE_INPUT_T_CAPACITY;
    if (offset + count > width)
        return false;
    memcpy(table + k * width + offset, value, (size_t)count * sizeof *value);
    return true;
}

static void take_input(struct recorded *recorded, const struct log_event *event)
{
    struct message_counters counters = {0};
    dse_input_t message;
    if (!message_input(event->bytes, event->length, &counters, &message) ||
        !in_range(recorded, &message.header))
        return;
    int64_t k = message.header.sample;
    if (!store(recorded->u, recorded->process->nu, k, message.part, message.count, message.value))
        return;
    recorded->t[k] = message.header.plant_time;
    recorded->have_u[k] = 1;
    if (k + 1 > recorded->samples)
        recorded->samples = k + 1;
}

static void take_truth(struct recorded *recorded, const struct log_event *event)
{
    struct message_counters counters = {0};
    dse_truth_t message;
    if (!message_truth(event->bytes, event->length, &counters, &message) ||
        !in_range(recorded, &message.header))
        return;
    if (store(recorded->x, width_of_truth(recorded->process), message.header.sample, message.part,
              message.count, message.value))
        recorded->have_x[message.header.sample] = 1;
}

static void take_measurement(struct recorded *recorded, const struct log_event *event)
{
    struct message_counters counters = {0};
    dse_measurement_t message;
    const struct dse_plant *process = recorded->process;
    if (!message_measurement(event->bytes, event->length, &counters, &message) ||
        !in_range(recorded, &message.header) || message.header.node >= process->n_subsystems)
        return;
    int64_t k = message.header.sample;
    const struct dse_subsystem *group = &process->subsystems[message.header.node];
    int offset = message.part * DSE_MEASUREMENT_T_CAPACITY;
    if (offset + message.count > group->n_outputs)
        return;
    for (int i = 0; i < message.count; i++) {
        int64_t at = k * process->ny + group->outputs[offset + i];
        recorded->y[at] = message.value[i];
        recorded->valid[at] = message.valid[i] != 0 && message.measured_at == k;
    }
    recorded->have_y[k * process->n_subsystems + message.header.node] = 1;
}

static struct recorded_estimates *estimates_for(struct recorded *recorded,
                                                const dse_estimate_t *message)
{
    for (int i = 0; i < recorded->n_estimates; i++)
        if (recorded->estimates[i].network == message->header.network &&
            recorded->estimates[i].node == message->header.node)
            return &recorded->estimates[i];
    size_t count = (size_t)recorded->n_estimates + 1;
    struct recorded_estimates *grown = realloc(recorded->estimates, count * sizeof *grown);
    if (grown == NULL)
        return NULL;
    recorded->estimates = grown;
    struct recorded_estimates *made = &grown[recorded->n_estimates];
    int n_states = message->parts * DSE_ESTIMATE_T_CAPACITY; /* room for full parts */
    size_t samples = (size_t)recorded->info.samples;
    *made = (struct recorded_estimates){
        .network = message->header.network,
        .node = message->header.node,
        .n_states = n_states,
        .values = calloc(samples * 2 * (size_t)n_states, sizeof(double)),
        .have = calloc(samples, 1),
    };
    recorded->n_estimates++;
    return made;
}

static void take_estimate(struct recorded *recorded, const struct log_event *event)
{
    struct message_counters counters = {0};
    dse_estimate_t message;
    if (!message_estimate(event->bytes, event->length, &counters, &message) ||
        !in_range(recorded, &message.header))
        return;
    struct recorded_estimates *estimates = estimates_for(recorded, &message);
    if (estimates == NULL || estimates->values == NULL || estimates->have == NULL)
        return;
    int64_t k = message.header.sample;
    int width = 2 * estimates->n_states;
    if (!store(estimates->values, width, k, message.part, message.count, message.state))
        return;
    store(estimates->values + estimates->n_states, width, k, message.part, message.count,
          message.variance);
    if (estimates->have[k] == 0)
        estimates->samples++;
    estimates->have[k] = 1;
}

static void count_missing(struct recorded *recorded)
{
    for (int64_t k = 0; k < recorded->samples; k++) {
        recorded->missing += recorded->have_u[k] == 0;
        for (int g = 0; g < recorded->process->n_subsystems; g++)
            recorded->missing += recorded->have_y[k * recorded->process->n_subsystems + g] == 0;
    }
}

bool recorded_load(struct recorded *recorded, const struct scenario *scenario, bool with_estimates,
                   struct error *error)
{
    recorded->process = scenario->process;
    if (!allocate(recorded, error))
        return false;
    struct log_reader *log = log_open(recorded->path, error);
    if (log == NULL)
        return false;
    struct log_event event;
    while (log_next(log, &event)) {
        if (strcmp(event.channel, CHANNEL_INPUT) == 0)
            take_input(recorded, &event);
        else if (strcmp(event.channel, CHANNEL_TRUTH) == 0)
            take_truth(recorded, &event);
        else if (strncmp(event.channel, "DSE_MEASUREMENT_", 16) == 0)
            take_measurement(recorded, &event);
        else if (with_estimates && strncmp(event.channel, "DSE_ESTIMATE_", 13) == 0)
            take_estimate(recorded, &event);
    }
    log_close(log);
    count_missing(recorded);
    return recorded->samples > 0 || error_set(error, "%s: no sample in it", recorded->path);
}

static bool next(void *self, int64_t k, struct sample_data *data, char *reason, int size)
{
    struct recorded *recorded = self;
    const struct dse_plant *process = recorded->process;
    if (k >= recorded->samples) {
        snprintf(reason, (size_t)size, "the log ends here");
        return false;
    }
    data->t = recorded->t[k];
    data->x = recorded->have_x[k] ? recorded->x + k * width_of_truth(process) : NULL;
    data->u = recorded->u + k * process->nu;
    data->y = recorded->y + k * process->ny;
    data->valid = recorded->valid + k * process->ny;
    return true;
}

static void forget(void *self)
{
    (void)self; /* the owner frees it */
}

void recorded_source(struct recorded *recorded, struct sample_source *source)
{
    source->self = recorded;
    source->next = next;
    source->destroy = forget;
}

const struct recorded_estimates *recorded_estimates_of(const struct recorded *recorded, int network,
                                                       int node)
{
    for (int i = 0; i < recorded->n_estimates; i++)
        if (recorded->estimates[i].network == network && recorded->estimates[i].node == node)
            return &recorded->estimates[i];
    return NULL;
}
