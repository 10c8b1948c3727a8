/* The samples of the clock: input, measurements and truth, published when everybody is done. */
#include "runtime/clock_internal.h"

static void publish_measurement(struct clock *clock, int group, bool again)
{
    const struct dse_subsystem *subsystem = &clock->config.scenario->process->subsystems[group];
    for (int i = 0; i < subsystem->n_outputs; i++) {
        int output = subsystem->outputs[i];
        clock->y_group[i] = clock->data.y[output];
        clock->valid_group[i] = clock->data.valid == NULL || clock->data.valid[output];
    }
    static const int32_t fresh = -1;
    int32_t sequence = again ? clock->measurement_sequence : fresh;
    sender_measurement(&clock->sender, clock->k, clock->data.t, sequence, group, clock->k,
                       clock->y_group, clock->valid_group, subsystem->n_outputs);
    clock->measurement_sequence += again ? message_parts(subsystem->n_outputs) : 0;
}

/* Input first: it opens the sample; the measurements complete it. */
void clock_publish_sample(struct clock *clock, bool again)
{
    const struct dse_plant *process = clock->config.scenario->process;
    int32_t first_input =
        again ? clock->input_sequence : sender_sequence(&clock->sender, SENDER_INPUT);
    int32_t first_measurement =
        again ? clock->measurement_sequence : sender_sequence(&clock->sender, SENDER_MEASUREMENT);
    if (!again && clock->data.x != NULL)
        sender_truth(&clock->sender, clock->k, clock->data.t, clock->data.x,
                     process->nx + process->n_unknown);
    sender_input(&clock->sender, clock->k, clock->data.t, again ? first_input : -1, clock->data.u,
                 process->nu);
    for (int group = 0; group < process->n_subsystems; group++)
        publish_measurement(clock, group, again);
    clock->input_sequence = first_input;
    clock->measurement_sequence = first_measurement;
}

static bool recorder_behind(const struct clock *clock)
{
    int lag = clock->config.recorder_lag;
    return lag > 0 && clock->k + 1 < clock->config.samples && clock->recorded < clock->k - lag;
}

void clock_next_sample(struct clock *clock)
{
    if (clock->k + 1 >= clock->config.samples) {
        clock->complete = true;
        clock_begin_stop(clock);
        return;
    }
    char reason[256] = "";
    if (!clock->config.source.next(clock->config.source.self, clock->k + 1, &clock->data, reason,
                                   (int)sizeof reason)) {
        clock_fail(clock, "no sample after %lld: %s", (long long)clock->k, reason);
        return;
    }
    clock->k++;
    clock_publish_sample(clock, false);
    clock->published = host_now();
    clock->repeated = clock->published;
    clock->phase = WAITING;
}

/* Goes on once everybody is done; a realtime clock goes on when the next sample is due. */
void clock_advance(struct clock *clock)
{
    if (clock->phase != WAITING || clock->state != AGENT_RUNNING)
        return;
    if (clock->config.pace == DSE_CLOCK_T_PACE_LOCKSTEP && clock_count_undone(clock) == 0 &&
        !recorder_behind(clock))
        clock_next_sample(clock);
}
