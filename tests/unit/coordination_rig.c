#include "coordination_rig.h"

#include <stdlib.h>

static enum dse_status take(int count, dse_real **memory, struct dse_arena *arena)
{
    *memory = calloc((size_t)(count > 0 ? count : 1), sizeof **memory);
    dse_arena_init(arena, *memory, count);
    return *memory ? DSE_OK : DSE_ESTORAGE;
}

static void find_sizes(struct coordination *net)
{
    net->n = net->ny = 0;
    for (int i = 0; i < net->config.parts; i++) {
        net->first[i] = net->n;
        net->first_output[i] = net->ny;
        net->n += net->config.subsystems[i].nx;
        net->ny += net->config.subsystems[i].ny;
    }
    net->first[net->config.parts] = net->n;
    net->first_output[net->config.parts] = net->ny;
}

/* The open-loop predictions that agents start with. */
static void find_starts(struct coordination *net)
{
    const int steps = net->settings.min_horizon - 1;
    const size_t n = (size_t)net->n;
    dse_real *x0 = calloc(n + 1, sizeof *x0);
    dse_real *scratch = calloc(2 * n + 1, sizeof *scratch);
    for (int i = 0; i < net->config.parts; i++) {
        const struct dse_mhe_subsystem *s = &net->config.subsystems[i];
        for (int a = 0; a < s->nx; a++)
            x0[net->first[i] + a] = s->x0 ? s->x0[a] : 0;
        net->start[i] = calloc((size_t)steps + 1, (size_t)s->nx * sizeof *net->start[i]);
    }
    for (int i = 0; i < net->config.parts; i++)
        dse_mhe_open_loop(net->n, net->config.A, x0, steps, net->first[i],
                          net->config.subsystems[i].nx, net->start[i], scratch);
    free(x0);
    free(scratch);
}

static enum dse_status start_agents(struct coordination *net)
{
    const int N = net->settings.horizon;
    int largest = 0;
    for (int i = 0; i < net->config.parts; i++) {
        const struct dse_mhe_subsystem *s = &net->config.subsystems[i];
        struct dse_mhe_local_config *config = &net->local_config[i];
        struct dse_arena arena;
        config->settings = &net->settings;
        config->subsystem = s;
        config->start = net->start[i];
        enum dse_status status = take(dse_mhe_local_storage(config), &net->memory[i], &arena);
        if (status == DSE_OK)
            status = dse_mhe_local_init(&net->local[i], config, &arena);
        if (status != DSE_OK)
            return status;
        const int up = DSE_MHE_UP_SIZE(s->nx, s->ny, N);
        largest = up > largest ? up : largest;
        net->down[i] = calloc((size_t)DSE_MHE_DOWN_SIZE(s->nx, N), sizeof *net->down[i]);
    }
    net->up = calloc((size_t)largest + 1, sizeof *net->up);
    return DSE_OK;
}

enum dse_status coordination_start(struct coordination *net)
{
    struct dse_arena arena;
    net->config.settings = &net->settings;
    find_sizes(net);
    find_starts(net);
    enum dse_status status = start_agents(net);
    if (status == DSE_OK)
        status = take(dse_mhe_coordinator_storage(&net->config), &net->memory[net->config.parts],
                      &arena);
    if (status == DSE_OK)
        status = dse_mhe_coordinator_init(&net->coordinator, &net->config, &arena);
    return status;
}

static bool delivers(const struct coordination *net, int i, bool up)
{
    return net->delivers == NULL || net->delivers(net, i, up);
}

static double now(const struct coordination *net)
{
    return net->clock ? net->clock() : 0;
}

/* Adds what has passed since `from`; returns the present time. */
static double charge(const struct coordination *net, double from, double *account)
{
    const double to = now(net);
    *account += to - from;
    return to;
}

static void one_round(struct coordination *net, int i)
{
    struct dse_mhe_local *local = &net->local[i];
    double time = now(net);
    const int count = dse_mhe_coordinator_message_down(&net->coordinator, i, net->down[i]);
    time = charge(net, time, &net->coordinator_time);
    net->messages++;
    net->reals += count;
    if (!delivers(net, i, false) ||
        dse_mhe_local_receive_down(local, net->down[i], count) != DSE_OK)
        dse_mhe_local_missing_down(local);
    if (net->coordinator.outcome != DSE_MHE_CONTINUE)
        return;
    dse_mhe_local_solve(local);
    const int answer = dse_mhe_local_message_up(local, net->up);
    time = charge(net, time, &net->agent_time[i]);
    net->messages++;
    net->reals += answer;
    if (!delivers(net, i, true) ||
        dse_mhe_coordinator_receive_up(&net->coordinator, i, net->up, answer) != DSE_OK)
        dse_mhe_coordinator_missing_up(&net->coordinator, i);
    (void)charge(net, time, &net->coordinator_time);
}

static void begin_agents(struct coordination *net, long k, const dse_real *y, const bool *valid)
{
    double time = now(net);
    net->k = k;
    for (int i = 0; i < net->config.parts; i++) {
        const int at = net->first_output[i];
        const struct dse_measurement measurement = {y + at, valid ? valid + at : NULL};
        (void)dse_mhe_local_begin(&net->local[i], k, &measurement);
        time = charge(net, time, &net->agent_time[i]);
    }
}

static enum dse_mhe_outcome begin_coordinator(struct coordination *net, long k)
{
    if (net->without_coordinator)
        return DSE_MHE_OUTCOME_ALONE;
    const double time = now(net);
    (void)dse_mhe_coordinator_begin(&net->coordinator, k);
    (void)charge(net, time, &net->coordinator_time);
    return dse_mhe_coordinator_outcome(&net->coordinator);
}

enum dse_mhe_outcome coordination_sample(struct coordination *net, long k, const dse_real *y,
                                         const bool *valid)
{
    begin_agents(net, k, y, valid);
    enum dse_mhe_outcome outcome = begin_coordinator(net, k);
    const bool starting = outcome != DSE_MHE_CONTINUE;
    while (outcome == DSE_MHE_CONTINUE) {
        for (int i = 0; i < net->config.parts; i++)
            one_round(net, i);
        const double time = now(net);
        outcome = dse_mhe_coordinator_advance(&net->coordinator);
        (void)charge(net, time, &net->coordinator_time);
    }
    for (int i = 0; i < net->config.parts; i++) {
        if (!starting)
            one_round(net, i); /* stop */
        const double time = now(net);
        dse_mhe_local_finish(&net->local[i]);
        (void)charge(net, time, &net->agent_time[i]);
    }
    return outcome;
}

void coordination_state(const struct coordination *net, dse_real *x)
{
    for (int i = 0; i < net->config.parts; i++)
        for (int a = 0; a < net->config.subsystems[i].nx; a++)
            x[net->first[i] + a] = dse_mhe_local_state(&net->local[i])[a];
}

void coordination_free(struct coordination *net)
{
    for (int i = 0; i < net->config.parts; i++) {
        free(net->start[i]);
        free(net->memory[i]);
        free(net->down[i]);
    }
    free(net->memory[net->config.parts]);
    free(net->up);
}

enum dse_status coordination_alone_start(struct coordination_alone *alone, int horizon,
                                         int min_horizon, double barrier,
                                         const struct dse_mhe_subsystem *subsystem)
{
    struct dse_arena arena;
    alone->settings = (struct dse_mhe_settings){.scheme = DSE_MHE_ALONE,
                                                .horizon = horizon,
                                                .min_horizon = min_horizon,
                                                .barrier = (dse_real)barrier};
    const dse_real *start = alone->config.start;
    alone->config = (struct dse_mhe_local_config){.settings = &alone->settings,
                                                  .subsystem = subsystem,
                                                  .start = start,
                                                  .max_active = alone->max_active};
    enum dse_status status = take(dse_mhe_local_storage(&alone->config), &alone->memory, &arena);
    if (status == DSE_OK)
        status = dse_mhe_local_init(&alone->local, &alone->config, &arena);
    return status;
}

void coordination_alone_sample(struct coordination_alone *alone, long k, const dse_real *y,
                               const bool *valid)
{
    const struct dse_measurement measurement = {y, valid};
    (void)dse_mhe_local_begin(&alone->local, k, &measurement);
    dse_mhe_local_finish(&alone->local);
}
