/* States that come late, and what they change (section 4.4 of the source, 4.6 of the spec): a
 * filter keeps its pictures of the last D + 1 communication instants. A late state corrects the
 * picture of its own instant; from there the model goes forward again, tick by tick, to the next
 * instant, where the own block and all states that are known of that instant are put in, and so on
 * up to now. */
#include <stddef.h>

#include "dse/ode.h"
#include "high_gain_ekf_internal.h"

int dse_high_gain_every(const struct dse_high_gain_ekf_config *config)
{
    return config->comm_every_ticks > 0 ? config->comm_every_ticks : 1;
}

static dse_real *picture_at(const struct dse_high_gain_ekf *filter, int64_t instant)
{
    return filter->pictures + (instant % (filter->config->max_delay + 1)) * filter->n;
}

/* Inputs of sample k, which is at most D instants ago. */
static dse_real *inputs_at(const struct dse_high_gain_ekf *filter, int64_t k)
{
    const int span = filter->config->max_delay * dse_high_gain_every(filter->config) + 1;
    return filter->inputs + (k % span) * filter->config->model->nu;
}

void dse_high_gain_note_sample(struct dse_high_gain_ekf *filter)
{
    const int every = dse_high_gain_every(filter->config);
    const int64_t k = filter->sample, instant = k / every;
    if (filter->last_sample < 0 || k != filter->last_sample + 1) {
        filter->past_from = (k + every - 1) / every;
        if (instant < filter->mailbox.now) {
            dse_mailbox_clear(&filter->mailbox, instant);
        }
    }
    dse_mailbox_advance(&filter->mailbox, instant);
    filter->last_sample = k;
    if (filter->config->max_delay > 0) {
        dse_real *u = inputs_at(filter, k);
        for (int j = 0; j < filter->config->model->nu; j++) {
            u[j] = filter->u[j];
        }
    }
}

/* A tick of the past under way. */
struct past_tick {
    struct dse_high_gain_ekf *filter;
    dse_real t;
    const dse_real *u, *du;
    bool moving;
};

static enum dse_status past_field(void *context, dse_real t, const dse_real *x, dse_real *dx)
{
    const struct past_tick *tick = context;
    struct dse_high_gain_ekf *filter = tick->filter;
    const dse_real *u = dse_high_gain_inputs(
        tick->u, tick->du, tick->moving, filter->config->model->nu, t - tick->t, filter->u_stage);
    return dse_high_gain_predictor_field(filter, t, x, u, dx);
}

/* One tick from sample k, and the picture in the coordinates of the next sample's inputs. */
static enum dse_status past_step(struct dse_high_gain_ekf *filter, int64_t k, dse_real *x)
{
    const struct dse_high_gain_ekf_config *config = filter->config;
    const dse_real h = config->period;
    struct past_tick tick = {.filter = filter,
                             .t = filter->t - h * (dse_real)(filter->sample - k),
                             .u = inputs_at(filter, k),
                             .du = filter->du_past};
    tick.moving = dse_high_gain_rates(config->form, tick.u, filter->du_past);
    enum dse_status status = dse_rk4_step(past_field, &tick, tick.t, h, filter->n, x, filter->rk);
    if (status != DSE_OK) {
        return status;
    }
    const dse_real *end = dse_high_gain_inputs(tick.u, filter->du_past, tick.moving,
                                               config->model->nu, h, filter->u_stage);
    filter->counters.replayed_ticks++;
    return dse_high_gain_recode(filter, tick.t + h, end, inputs_at(filter, k + 1), x);
}

static void copy(int n, const dse_real *from, dse_real *to)
{
    for (int k = 0; k < n; k++) {
        to[k] = from[k];
    }
}

/* Own block from `own`, all that is known of the others at this instant. own may be x. */
static void correct_picture(const struct dse_high_gain_ekf *filter, int64_t instant,
                            const dse_real *own, dse_real *x)
{
    const struct dse_normal_form *form = filter->config->form;
    int offset = 0;
    for (int j = 0; j < filter->p; j++) {
        const dse_real *block = dse_mailbox_get(&filter->mailbox, j, instant);
        if (j == filter->config->i) {
            copy(form->n_i[j], own + offset, x + offset);
        } else if (block != NULL) {
            copy(form->n_i[j], block, x + offset);
        }
        offset += form->n_i[j];
    }
}

/* Steps 3 and 4 of the procedure, from instant `first` to `now`; x: the picture now. Pictures up to
 * the instant of a failure are corrected, the others stay as they were. */
static enum dse_status replay(struct dse_high_gain_ekf *filter, int64_t first, int64_t now,
                              dse_real *x)
{
    const int every = dse_high_gain_every(filter->config);
    dse_real *start = picture_at(filter, first);
    correct_picture(filter, first, start, start);
    copy(filter->n, start, x);
    for (int64_t g = first; g < now; g++) {
        for (int64_t k = g * every; k < (g + 1) * every; k++) {
            const enum dse_status status = past_step(filter, k, x);
            if (status != DSE_OK) {
                return status;
            }
        }
        dse_real *next = g + 1 < now ? picture_at(filter, g + 1) : filter->base;
        correct_picture(filter, g + 1, next, x);
        if (g + 1 < now) {
            copy(filter->n, x, next);
        }
    }
    return DSE_OK;
}

/* With a predictor: through the past where something of the past has come. */
static void take_into_past(struct dse_high_gain_ekf *filter, int64_t now)
{
    int64_t first = now;
    if (!dse_mailbox_read(&filter->mailbox, &first)) {
        first = now;
    }
    first = first < filter->past_from ? filter->past_from : first;
    if (first < now && filter->pictures != NULL) {
        if (replay(filter, first, now, filter->xs) == DSE_OK) {
            copy(filter->n, filter->xs, filter->base);
            return;
        }
        filter->counters.failed_replays++;
    }
    correct_picture(filter, now, filter->base, filter->base);
}

/* Without: the newest state of each, until something newer comes. */
static void take_newest(struct dse_high_gain_ekf *filter)
{
    const struct dse_normal_form *form = filter->config->form;
    int64_t oldest;
    int offset = 0;
    for (int j = 0; j < filter->p; j++) {
        const dse_real *block =
            j == filter->config->i ? NULL : dse_mailbox_news(&filter->mailbox, j);
        for (int k = 0; block != NULL && k < form->n_i[j]; k++) {
            filter->base[offset + k] = block[k];
        }
        offset += form->n_i[j];
    }
    dse_mailbox_read(&filter->mailbox, &oldest);
}

/* States of the instant D ago that have not come by now are lost, or not worth having. */
static void count_missing(struct dse_high_gain_ekf *filter, int64_t now)
{
    const int64_t last_chance = now - filter->config->max_delay;
    for (int j = 0; j < filter->p && last_chance >= 0; j++) {
        if (j != filter->config->i && dse_mailbox_get(&filter->mailbox, j, last_chance) == NULL) {
            filter->counters.missing_states++;
        }
    }
}

void dse_high_gain_take_states(struct dse_high_gain_ekf *filter)
{
    const struct dse_high_gain_ekf_config *config = filter->config;
    const int64_t now = filter->sample / dse_high_gain_every(config);
    if (config->predictor == DSE_HIGH_GAIN_HOLD) {
        take_newest(filter);
    } else {
        take_into_past(filter, now);
    }
    if (config->max_delay > 0) {
        copy(filter->n, filter->base, picture_at(filter, now));
    }
    if (config->communication != DSE_HIGH_GAIN_TRIGGERED) {
        count_missing(filter, now);
    }
}
