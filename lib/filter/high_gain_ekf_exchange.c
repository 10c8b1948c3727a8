/* Adaptive high-gain EKF: what the filters say to each other, and steps 1 to 3 of a tick. */
#include <stddef.h>

#include "dse/math.h"
#include "high_gain_ekf_internal.h"

void dse_high_gain_plan_rounds(struct dse_high_gain_ekf *filter)
{
    const struct dse_high_gain_ekf_config *config = filter->config;
    const bool alone =
        (filter->p == 1 && !config->heard) || config->communication == DSE_HIGH_GAIN_NONE;
    const dse_real *moved = config->trigger.norm == DSE_TRIGGER_RELATIVE
                                ? filter->estimate
                                : filter->base + filter->offset;

    filter->instant = !alone && filter->sample % dse_high_gain_every(config) == 0;
    filter->tells = filter->instant && (config->communication != DSE_HIGH_GAIN_TRIGGERED ||
                                        dse_trigger_fires(&filter->trigger, moved));
    filter->round = 0;
    if (alone) {
        filter->rounds = 0;
    } else if (config->communication == DSE_HIGH_GAIN_STAGES) {
        filter->rounds = 4;
    } else {
        filter->rounds = filter->instant || config->innovation == DSE_HIGH_GAIN_SUM ? 1 : 0;
    }
    if (filter->tells) {
        dse_trigger_sent(&filter->trigger, moved);
        filter->number = dse_link_next_number(filter->number);
        filter->counters.transmissions++;
    }
    for (int j = 0; j < filter->p; j++) {
        filter->received[j] = 0;
    }
}

int dse_high_gain_ekf_rounds(const struct dse_high_gain_ekf *filter)
{
    return filter->open ? filter->rounds : 0;
}

bool dse_high_gain_ekf_tells(const struct dse_high_gain_ekf *filter)
{
    return filter->open && filter->tells;
}

/* Reals before the state in a message of round 0. */
static int head(const struct dse_high_gain_ekf *filter)
{
    return filter->config->communication == DSE_HIGH_GAIN_TRIGGERED ? 2 : 1;
}

int dse_high_gain_ekf_message(const struct dse_high_gain_ekf *filter, int round, dse_real *out)
{
    if (!filter->open || round != filter->round || round >= filter->rounds) {
        return 0;
    }
    const dse_real *state = (round == 0 ? filter->base : filter->xs) + filter->offset;
    int count = 0;
    if (round == 0) {
        out[count++] = filter->J_own;
        if (head(filter) == 2) {
            out[count++] = (dse_real)filter->number;
        }
    }
    if (round > 0 || filter->tells) {
        for (int k = 0; k < filter->n_i; k++) {
            out[count++] = state[k];
        }
    }
    return count;
}

static enum dse_status refuse(struct dse_high_gain_ekf *filter, enum dse_status status)
{
    filter->counters.refused++;
    return status;
}

static bool is_neighbour(const struct dse_high_gain_ekf *filter, int j)
{
    return j >= 0 && j < filter->p && j != filter->config->i;
}

/* What a message may be long: with its state or, where silence or delay is possible, without. */
static bool right_count(const struct dse_high_gain_ekf *filter, int round, int j, int count)
{
    const struct dse_high_gain_ekf_config *config = filter->config;
    const int n_j = config->form->n_i[j];
    if (round > 0) {
        return count == n_j;
    }
    const bool optional = config->communication == DSE_HIGH_GAIN_TRIGGERED || config->max_delay > 0;
    return (filter->instant && count == head(filter) + n_j) ||
           ((!filter->instant || optional) && count == head(filter));
}

/* How many states j has sent without our having them, one of them perhaps coming just now. */
static enum dse_status take_number(struct dse_high_gain_ekf *filter, int j, dse_real number,
                                   bool with_state)
{
    if (!(number >= 0 && number < DSE_LINK_NUMBERS)) {
        return DSE_EFORMAT;
    }
    const int unheard = dse_link_unheard(filter->heard[j], (int)number);
    filter->counters.missing_states += unheard - (with_state && unheard > 0 ? 1 : 0);
    filter->heard[j] = (int)number;
    return DSE_OK;
}

static void take_state(struct dse_high_gain_ekf *filter, int j, int64_t stamp,
                       const dse_real *state)
{
    const enum dse_mailbox_verdict verdict = dse_mailbox_put(&filter->mailbox, j, stamp, state);
    filter->counters.duplicates += verdict == DSE_MAILBOX_DUPLICATE;
    filter->counters.too_late += verdict == DSE_MAILBOX_TOO_LATE;
}

/* A message of round 0: J_j, the number, perhaps the state. */
static enum dse_status take_opening(struct dse_high_gain_ekf *filter, int j,
                                    const dse_real *message, int count)
{
    const bool with_state = count > head(filter);
    if (head(filter) == 2) {
        const enum dse_status status = take_number(filter, j, message[1], with_state);
        if (status != DSE_OK) {
            return refuse(filter, status);
        }
    }
    filter->J[j] = message[0];
    if (with_state) {
        take_state(filter, j, filter->sample / dse_high_gain_every(filter->config),
                   message + head(filter));
    }
    filter->received[j] = count;
    return DSE_OK;
}

enum dse_status dse_high_gain_ekf_receive(struct dse_high_gain_ekf *filter, int round, int j,
                                          const dse_real *message, int count)
{
    if (!filter->open || round != filter->round || round >= filter->rounds ||
        !is_neighbour(filter, j) || message == NULL) {
        return refuse(filter, DSE_EINVAL);
    }
    if (!right_count(filter, round, j, count)) {
        return refuse(filter, DSE_EFORMAT);
    }
    if (!dse_all_finite(message, count)) {
        return refuse(filter, DSE_ENONFINITE);
    }
    if (filter->received[j] > 0) {
        filter->counters.duplicates++;
        return DSE_OK;
    }
    if (round == 0) {
        return take_opening(filter, j, message, count);
    }
    dse_real *block = filter->inbox + dse_high_gain_offset(filter->config->form, j);
    for (int k = 0; k < count; k++) {
        block[k] = message[k];
    }
    filter->received[j] = count;
    return DSE_OK;
}

enum dse_status dse_high_gain_ekf_deliver(struct dse_high_gain_ekf *filter, int j, int64_t stamp,
                                          const dse_real *state, int count)
{
    const int every = dse_high_gain_every(filter->config);
    if (!filter->open || !filter->instant || filter->round > 0 || !is_neighbour(filter, j) ||
        state == NULL || stamp < 0 || stamp > filter->sample || stamp % every != 0) {
        return refuse(filter, DSE_EINVAL);
    }
    if (count != filter->config->form->n_i[j]) {
        return refuse(filter, DSE_EFORMAT);
    }
    if (!dse_all_finite(state, count)) {
        return refuse(filter, DSE_ENONFINITE);
    }
    take_state(filter, j, stamp / every, state);
    return DSE_OK;
}

/* The blocks of a stage into its point; the others stay as the model predicts them. */
static void merge_stage(struct dse_high_gain_ekf *filter)
{
    const struct dse_normal_form *form = filter->config->form;
    int offset = 0;
    for (int j = 0; j < filter->p; j++) {
        if (j != filter->config->i && filter->received[j] == 0) {
            filter->counters.missing_states++;
        } else if (j != filter->config->i) {
            for (int k = offset; k < offset + form->n_i[j]; k++) {
                filter->xs[k] = filter->inbox[k];
            }
        }
        offset += form->n_i[j];
    }
}

/* J that drives theta: J_i or the sum in the order of the subsystems, which gives all filters the
 * same bits (2.10, 3.14). */
static dse_real driving_innovation(struct dse_high_gain_ekf *filter)
{
    filter->J[filter->config->i] = filter->J_own;
    if (filter->config->innovation == DSE_HIGH_GAIN_OWN) {
        return filter->J_own;
    }
    dse_real sum = 0;
    for (int j = 0; j < filter->p; j++) {
        if (j != filter->config->i && filter->received[j] == 0) {
            filter->counters.missing_innovations++;
        }
        sum += filter->J[j];
    }
    return sum;
}

/* R and Q at theta, and the gain that follows for the outputs that are there. */
static enum dse_status weigh(struct dse_high_gain_ekf *filter)
{
    const struct dse_high_gain_ekf_config *config = filter->config;
    const dse_real *R = &config->R;
    if (config->R_block != NULL) {
        R = config->R_block;
    } else if (filter->m > 1) {
        dse_real *diagonal = filter->W;
        for (int ab = 0; ab < filter->m * filter->m; ab++) {
            diagonal[ab] = ab % (filter->m + 1) == 0 ? config->R : 0;
        }
        R = diagonal;
    }
    dse_high_gain_weights(config->scaling, filter->m, filter->chains, filter->n_max,
                          filter->theta_tick, R, config->Q, filter->R_th, filter->Q_th);
    return dse_high_gain_weigh_outputs(filter);
}

enum dse_status dse_high_gain_start_step(struct dse_high_gain_ekf *filter)
{
    const struct dse_high_gain_ekf_config *config = filter->config;
    if (filter->instant) {
        dse_high_gain_take_states(filter);
    }
    filter->J_drive = driving_innovation(filter);
    filter->theta_tick = filter->theta;
    if (config->gain == DSE_HIGH_GAIN_ADAPT) {
        filter->theta_tick = dse_gain_adaptation_step(&config->adaptation, config->period,
                                                      filter->J_drive, filter->theta);
    }
    dse_high_gain_first_stage(filter);
    return weigh(filter);
}

enum dse_status dse_high_gain_ekf_advance(struct dse_high_gain_ekf *filter, int round)
{
    if (!filter->open || round != filter->round || round >= filter->rounds) {
        return DSE_EINVAL;
    }
    const bool stages = filter->config->communication == DSE_HIGH_GAIN_STAGES;
    enum dse_status status = DSE_OK;
    if (round == 0) {
        status = dse_high_gain_start_step(filter);
        /* only now the common picture at t_k is complete */
        status = stages && status == DSE_OK ? dse_high_gain_report(filter) : status;
    } else {
        merge_stage(filter);
    }
    if (stages && status == DSE_OK) {
        status = dse_high_gain_stage(filter, round);
    }
    if (status != DSE_OK) {
        return dse_high_gain_fail(filter, status);
    }
    for (int j = 0; j < filter->p; j++) {
        filter->received[j] = 0;
    }
    filter->round++;
    return DSE_OK;
}

int dse_high_gain_ekf_age(const struct dse_high_gain_ekf *filter, int j)
{
    return is_neighbour(filter, j) ? dse_mailbox_age(&filter->mailbox, j) : -1;
}

int dse_high_gain_ekf_largest_age(const struct dse_high_gain_ekf *filter)
{
    int largest = 0;
    for (int j = 0; j < filter->p; j++) {
        const int age = dse_mailbox_age(&filter->mailbox, j);
        if (j != filter->config->i) {
            largest = age < 0 || largest < 0 ? -1 : (age > largest ? age : largest);
        }
    }
    return largest;
}
