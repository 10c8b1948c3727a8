/* A network of nodes of one method, made from a scenario and moved by hand. */
#ifndef METHOD_RIG_H
#define METHOD_RIG_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "methods/method.h"

enum { METHOD_RIG_NODES = 4 };

struct rig {
    struct scenario *scenario;
    const struct method *method;
    dse_real values[4], prepared[512];
    struct method_setup setup[METHOD_RIG_NODES];
    struct method_info info[METHOD_RIG_NODES];
    void *node[METHOD_RIG_NODES];
    struct method_estimate estimate[METHOD_RIG_NODES];
    int nodes;
};

static inline void close_rig(struct rig *rig)
{
    for (int i = 0; i < rig->nodes; i++)
        if (rig->node[i] != NULL)
            rig->method->destroy(rig->node[i]);
    scenario_free(rig->scenario);
}

static inline bool open_rig(struct rig *rig, const char *head, const char *network_keys,
                            struct error *error)
{
    char yaml[4000];
    memset(rig, 0, sizeof *rig);
    snprintf(yaml, sizeof yaml, "%s%s\n", head, network_keys);
    rig->scenario = scenario_parse(yaml, "sensors.yaml", NULL, 0, error);
    if (rig->scenario == NULL)
        return false;
    const struct scenario_network *network = &rig->scenario->networks[0];
    assert_true(rig->scenario->process->prepared_size <= 512);
    bool ok = scenario_prepare_plant(rig->scenario, network, rig->values, rig->prepared, error);
    rig->method = method_at(scenario_method(network));
    for (int i = 0; i < METHOD_RIG_NODES; i++)
        rig->setup[i] = (struct method_setup){.scenario = rig->scenario,
                                              .network = network,
                                              .section = network->section[scenario_method(network)],
                                              .graph = network->neighbours,
                                              .link = scenario_link_fates(network),
                                              .process = rig->scenario->process,
                                              .prepared = rig->prepared,
                                              .period = scenario_period(rig->scenario),
                                              .node = i};
    int nodes = rig->method->nodes(&rig->setup[0]);
    for (int i = 0; ok && i < nodes && i < METHOD_RIG_NODES; i++) {
        rig->node[i] = rig->method->create(&rig->setup[i], &rig->info[i], error);
        ok = rig->node[i] != NULL;
        rig->nodes = i + 1;
    }
    if (!ok)
        close_rig(rig);
    return ok;
}

static inline void must_open(struct rig *rig, const char *head, const char *network_keys)
{
    struct error error = {.text = ""};
    if (!open_rig(rig, head, network_keys, &error)) {
        fail_msg("%s", error.text);
        abort(); /* it does not return */
    }
}

static inline void begin(struct rig *rig, int i, int64_t k, bool measured)
{
    static const double y[2] = {1, 1};
    const bool valid[2] = {measured, measured};
    struct method_sample in = {
        .k = k, .t = (double)k * rig->setup[0].period, .y = y, .valid = valid};
    assert_int_equal(rig->method->begin(rig->node[i], &in), DSE_OK);
}

#endif
