/* A scenario's networks. */
#include "runtime/networks.h"

const struct method *network_method(const struct scenario *scenario, int network,
                                    struct method_setup *setup, struct error *error)
{
    const struct scenario_network *section = &scenario->networks[network];
    int index = scenario_method(section);
    const struct method *method = method_at(index);
    if (method == NULL) {
        error_set(error, "network %s has no method", section->name);
        return NULL;
    }
    *setup = (struct method_setup){.scenario = scenario,
                                   .network = section,
                                   .section = section->section[index],
                                   .graph = section->neighbours,
                                   .link = scenario_link_fates(section),
                                   .process = scenario->process,
                                   .period = scenario_period(scenario)};
    return method;
}

int network_nodes(const struct scenario *scenario, int network, bool *coordinator,
                  struct error *error)
{
    struct method_setup setup;
    const struct method *method = network_method(scenario, network, &setup, error);
    if (method == NULL)
        return -1;
    if (coordinator != NULL)
        *coordinator = method->has_coordinator != NULL && method->has_coordinator(&setup);
    return method->nodes(&setup);
}
