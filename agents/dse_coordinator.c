/* dse-coordinator: the coordinators of a scenario's networks. */
#include <stdlib.h>
#include <string.h>

#include "runtime/networks.h"
#include "runtime/node.h"
#include "runtime/options.h"
#include "runtime/program.h"

#define OPTION_NETWORK OPTION_OWN

static const char name[] = "dse-coordinator";

static const char help[] =
    "usage: dse-coordinator SCENARIO [options]\n"
    "\n"
    "Runs the coordinator of every network of the scenario that has one: waits until the plant\n"
    "asks who takes part, or joins a run that is going on, then makes the estimators of its\n"
    "network agree, sample by sample. They go on alone while it is not there.\n"
    "\n"
    "  --network NAME     only this network's coordinator\n";

struct choice {
    const char *network;
};

/* NOLINTNEXTLINE(readability-non-const-parameter): the type of options_program.take */
static bool take(void *self, int option, char *value, struct error *error)
{
    (void)option;
    (void)error;
    struct choice *choice = self;
    choice->network = value;
    return true;
}

static bool is_chosen(const struct scenario *scenario, int network, const struct choice *choice)
{
    return choice->network == NULL ||
           strcmp(choice->network, scenario->networks[network].name) == 0;
}

/* What is wrong when no agent was made. */
static bool nobody(const struct scenario *scenario, const struct choice *choice,
                   struct error *error)
{
    bool known = choice->network == NULL;
    for (unsigned i = 0; i < scenario->networks_count; i++)
        known = known || strcmp(choice->network, scenario->networks[i].name) == 0;
    if (!known)
        return error_set(error, "--network %s: %s has no such network", choice->network,
                         scenario->file);
    if (choice->network != NULL)
        return error_set(error, "--network %s: this network has no coordinator", choice->network);
    return error_set(error, "%s: no network of this scenario has a coordinator", scenario->file);
}

static bool make_agents(const struct scenario *scenario, const struct options *options,
                        const void *own, struct bus *bus, struct agent *agents, int *n_agents,
                        struct error *error)
{
    const struct choice *choice = own;
    for (unsigned i = 0; i < scenario->networks_count; i++) {
        bool coordinator = false;
        int nodes = network_nodes(scenario, (int)i, &coordinator, error);
        if (nodes < 0)
            return false;
        if (!coordinator || !is_chosen(scenario, (int)i, choice))
            continue;
        struct node_config config = {.scenario = scenario,
                                     .network = (int)i,
                                     .node = nodes - 1,
                                     .pace = options->pace,
                                     .speed = options->speed,
                                     .run_id = options->run_id};
        if (!node_create(&config, bus, &agents[*n_agents], error))
            return false;
        ++*n_agents;
    }
    return *n_agents > 0 || nobody(scenario, choice, error);
}

int main(int argc, char **argv)
{
    struct options options = {0};
    struct choice choice = {0};
    struct agent agents[SCENARIO_MAX_NETWORKS];
    static const struct option table[] = {
        OPTIONS_COMMON, {"network", required_argument, NULL, OPTION_NETWORK}, {0}};
    struct options_program program = {
        .name = name, .help = help, .table = table, .own = &choice, .take = take};
    int stop = options_read(&program, argc, argv, &options);
    if (stop != 0)
        return stop - 1;
    return program_serve(name, &options, make_agents, &choice, agents);
}
