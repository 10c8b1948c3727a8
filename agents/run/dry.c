/* dse-run --dry-run: who would be started and who would talk to whom, without running anything. */
#include <stdio.h>
#include <stdlib.h>

#include "dse_clock_t.h"
#include "run/run.h"
#include "runtime/networks.h"
#include "runtime/node.h"

static void print_list(const char *title, const int *items, int count)
{
    printf("    %s", title);
    for (int i = 0; i < count; i++)
        printf("%s%d", i == 0 ? " " : ", ", items[i]);
    printf("%s\n", count == 0 ? " none" : "");
}

static void print_node(const struct scenario *scenario, const struct agent *agent)
{
    const struct method_info *info = node_info(agent);
    printf("  %s, %lld bytes\n    estimates", agent->name, (long long)info->storage_bytes);
    for (int i = 0; i < info->n_states; i++)
        printf("%s%s", i == 0 ? " " : ", ", scenario->process->states[info->states[i]].name);
    printf("\n");
    print_list("reads sensor groups", info->groups, info->n_groups);
    print_list("hears nodes", info->neighbours, info->n_neighbours);
    print_list("is heard by nodes", info->listeners, info->n_listeners);
}

static bool print_network(const struct scenario *scenario, int network, struct bus *bus,
                          struct error *error)
{
    int nodes = network_nodes(scenario, network, NULL, error);
    printf("network %d, %s: %d node(s)\n", network, scenario->networks[network].name, nodes);
    for (int node = 0; node < nodes; node++) {
        struct node_config config = {.scenario = scenario, .network = network, .node = node};
        struct agent agent;
        if (!node_create(&config, bus, &agent, error))
            return false;
        print_node(scenario, &agent);
        agent.destroy(agent.self);
    }
    return nodes >= 0;
}

int run_dry(const struct run_options *options, const struct scenario *scenario)
{
    (void)options;
    struct error error = {0};
    const struct dse_plant *process = scenario->process;
    printf("%s: %s\n", scenario->name, scenario->title != NULL ? scenario->title : "");
    printf(
        "plant %s: %d states, %d inputs, %d outputs in %d sensor group(s); %lld samples of %g s\n",
        process->name, process->nx, process->nu, process->ny, process->n_subsystems,
        (long long)scenario_samples(scenario), scenario->time.period_s);
    struct bus *bus = bus_open("memq://", &error);
    bool ok = bus != NULL;
    for (unsigned i = 0; ok && i < scenario->networks_count; i++)
        ok = print_network(scenario, (int)i, bus, &error);
    bus_close(bus);
    return ok ? 0 : options_complain("dse-run", &error);
}
