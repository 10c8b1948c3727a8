/* A reference's plant and data as a network of agents. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "coordination.h"

int report(const char *name, double deviation, double tolerance)
{
    const int pass = isfinite(deviation) && deviation <= tolerance;
    printf("  %-44s deviation %9.2e  tolerance %7.1e  %s\n", name, deviation, tolerance,
           pass ? "ok" : "FAILED");
    return pass ? GOLDEN_PASS : GOLDEN_FAIL;
}

static double *numbers(const json_t *root, const char *key, int expected, int *wrong)
{
    int count;
    double *list = golden_numbers(json_object_get(root, key), &count);
    if (count != expected) {
        printf("  '%s' has %d numbers, %d expected\n", key, count, expected);
        *wrong = 1;
    }
    return list;
}

/* The last subsystem is out of reach after sample dead_from, or, with 0, always. */
static bool delivers(const struct coordination *net, int i, bool up)
{
    const struct network *network = net->context;
    (void)up;
    const bool dead =
        network->dead_from == 0 || (network->dead_from > 0 && net->k > network->dead_from);
    return !(dead && i == network->parts - 1);
}

/* Temperatures are measured: the last of three states (separator) or the first of two. */
static void fill_subsystems(struct network *w, const json_t *trigger)
{
    w->C[w->nx == 3 ? 2 : 0] = 1;
    for (int i = 0; i < w->parts; i++) {
        for (int e = 0; e < w->nx * w->nx; e++)
            w->A_ii[i][e] = w->A[(i * w->nx + e / w->nx) * w->n + i * w->nx + e % w->nx];
        w->subsystems[i] = (struct dse_mhe_subsystem){.nx = w->nx,
                                                      .ny = 1,
                                                      .A = w->A_ii[i],
                                                      .C = w->C,
                                                      .Q = w->Q + i * w->nx * w->nx,
                                                      .R = w->R + i,
                                                      .D = w->D + i * w->nx * w->nx,
                                                      .x0 = w->x0 + i * w->nx};
        w->subsystems[i].trigger = json_number_value(json_array_get(trigger, (size_t)i));
    }
}

int network_read(const json_t *root, struct network *w)
{
    const json_t *config = json_object_get(root, "config"), *sizes = json_object_get(root, "n_i");
    int wrong = 0;
    memset(w, 0, sizeof *w);
    w->dead_from = -1;
    w->parts = (int)json_array_size(sizes);
    if (w->parts < 1 || w->parts > PARTS)
        return GOLDEN_UNSUPPORTED;
    w->nx = (int)json_integer_value(json_array_get(sizes, 0)); /* the same for all */
    w->n = w->nx * w->parts;
    w->samples = (int)golden_number(config, "K", 0) + 1;
    w->A = numbers(root, "A", w->n * w->n, &wrong);
    w->Q = numbers(root, "Q", w->n * w->nx, &wrong);
    w->D = numbers(root, "D", w->n * w->nx, &wrong);
    w->R = numbers(root, "R", w->parts, &wrong);
    w->x0 = numbers(config, "xhat0", w->n, &wrong);
    w->y = numbers(root, "y", w->samples * w->parts, &wrong);
    if (wrong)
        return GOLDEN_FAIL;
    fill_subsystems(w, NULL);
    w->net.settings =
        (struct dse_mhe_settings){.scheme = DSE_MHE_PREDICTION,
                                  .horizon = (int)golden_number(config, "Hp", 0),
                                  .min_horizon = (int)golden_number(config, "Hmin", 0)};
    w->net.config = (struct dse_mhe_coordinator_config){.parts = w->parts,
                                                        .subsystems = w->subsystems,
                                                        .A = w->A,
                                                        .eps = golden_number(config, "eps", 0),
                                                        .max_iter = 200,
                                                        .stop_on_any = true};
    w->net.delivers = delivers;
    w->net.context = w;
    return GOLDEN_PASS;
}

int network_start(struct network *w)
{
    w->started = true;
    return coordination_start(&w->net) == DSE_OK ? GOLDEN_PASS : GOLDEN_FAIL;
}

void network_free(struct network *w)
{
    double *all[] = {w->A, w->Q, w->R, w->D, w->x0, w->y};
    for (size_t i = 0; i < sizeof all / sizeof all[0]; i++)
        free(all[i]);
    if (w->started)
        coordination_free(&w->net);
}

double window_deviation(const struct network *w, const json_t *stack)
{
    int count;
    double *want = golden_numbers(stack, &count), worst = 0;
    for (int i = 0, at = 0; i < w->parts; i++) {
        const struct dse_mhe_local *local = &w->net.local[i];
        const int size = dse_mhe_local_length(local) * w->nx;
        for (int e = 0; e < size; e++, at++)
            worst = at < count ? fmax(worst, fabs(dse_mhe_local_window(local)[e] - want[at]))
                               : INFINITY;
    }
    free(want);
    return worst;
}

/* ---- runs ---- */

static void set_trigger(struct network *w, const json_t *record)
{
    const json_t *trigger = json_object_get(json_object_get(record, "options"), "trig");
    for (int i = 0; i < w->parts && trigger; i++)
        w->subsystems[i].trigger = json_number_value(json_array_get(trigger, (size_t)i));
}

int compare_run(struct network *w, const char *name, const json_t *record, double tolerance)
{
    const int every = (int)golden_number(record, "every", 1);
    const int first = w->net.settings.min_horizon - 1;
    const json_t *rounds = json_object_get(record, "its"), *sent = json_object_get(record, "msgs");
    const json_t *estimates = json_object_get(record, "est");
    double worst = 0, counts = 0, messages = 0, x[NX];
    char text[64];
    set_trigger(w, record);
    if (network_start(w) != GOLDEN_PASS)
        return report(name, INFINITY, tolerance);
    for (int k = 0; k < w->samples; k++) {
        coordination_sample(&w->net, k, w->y + k * w->parts, NULL);
        coordination_state(&w->net, x);
        const json_t *want = k % every == 0 ? json_array_get(estimates, (size_t)(k / every)) : NULL;
        for (int i = 0; i < w->n && want; i++)
            worst = fmax(worst, fabs(x[i] - json_number_value(json_array_get(want, (size_t)i))));
        if (k < first)
            continue;
        const size_t at = (size_t)(k - first);
        counts = fmax(counts, fabs(json_number_value(json_array_get(rounds, at)) -
                                   dse_mhe_coordinator_iterations(&w->net.coordinator)));
        if (sent)
            messages = fmax(messages, fabs(json_number_value(json_array_get(sent, at)) -
                                           dse_mhe_coordinator_uplinks(&w->net.coordinator)));
    }
    snprintf(text, sizeof text, "%s: estimates", name);
    int result = report(text, worst, tolerance);
    snprintf(text, sizeof text, "%s: rounds", name);
    result |= report(text, counts, 0);
    snprintf(text, sizeof text, "%s: answers with data", name);
    return result | report(text, messages, 0);
}
