/* dse-estimator: the estimators of one or several nodes of a scenario's networks. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dse_clock_t.h"
#include "runtime/networks.h"
#include "runtime/node.h"
#include "runtime/options.h"
#include "runtime/program.h"

#define MAX_AGENTS     4096
#define OPTION_NODE    OPTION_OWN
#define OPTION_NETWORK (OPTION_OWN + 1)

static const char name[] = "dse-estimator";

static const char help[] =
    "usage: dse-estimator SCENARIO --node N [options]\n"
    "\n"
    "Runs node N of every network of the scenario: waits until the plant asks who takes part,\n"
    "then estimates sample by sample, talking to the other nodes over LCM.\n"
    "\n"
    "  --node N | N..M    the node, or several nodes in this process (required)\n"
    "  --network NAME     only this network (default: all that have the node)\n";

struct choice {
    int64_t first, last;
    const char *network;
};

static bool take_nodes(struct choice *choice, char *value, struct error *error)
{
    char *dots = strstr(value, "..");
    if (dots != NULL)
        *dots = '\0';
    return options_integer("node", value, 0, METHOD_MAX_NODES - 1, &choice->first, error) &&
           options_integer("node", dots != NULL ? dots + 2 : value, choice->first,
                           METHOD_MAX_NODES - 1, &choice->last, error);
}

static bool take(void *self, int option, char *value, struct error *error)
{
    struct choice *choice = self;
    if (option == OPTION_NODE)
        return take_nodes(choice, value, error);
    choice->network = value;
    return true;
}

static bool check(const void *self, const struct options *options, struct error *error)
{
    (void)options;
    const struct choice *choice = self;
    return choice->first >= 0 ||
           error_set(error, "which node? Give --node N (0 is the first) or --node N..M");
}

static bool make_agents(const struct scenario *scenario, const struct options *options,
                        const void *own, struct bus *bus, struct agent *agents, int *n_agents,
                        struct error *error)
{
    const struct choice *choice = own;
    bool known = choice->network == NULL;
    int most = 0;
    int coordinators = 0;
    for (unsigned i = 0; i < scenario->networks_count; i++) {
        if (choice->network != NULL && strcmp(choice->network, scenario->networks[i].name) != 0)
            continue;
        known = true;
        bool coordinator = false;
        int nodes = network_nodes(scenario, (int)i, &coordinator, error);
        if (nodes < 0)
            return false;
        nodes -= coordinator; /* the last one, which dse-coordinator runs */
        coordinators += coordinator;
        most = nodes > most ? nodes : most;
        for (int64_t n = choice->first; n <= choice->last && n < nodes; n++) {
            struct node_config config = {.scenario = scenario,
                                         .network = (int)i,
                                         .node = (int)n,
                                         .pace = options->pace,
                                         .speed = options->speed,
                                         .run_id = options->run_id};
            if (*n_agents == MAX_AGENTS)
                return error_set(error, "more than %d nodes in one process", MAX_AGENTS);
            if (!node_create(&config, bus, &agents[*n_agents], error))
                return false;
            ++*n_agents;
        }
    }
    if (!known)
        return error_set(error, "--network %s: %s has no such network", choice->network,
                         scenario->file);
    if (choice->last >= most)
        return error_set(error, "--node %d: the nodes of %s are 0 to %d%s", (int)choice->last,
                         scenario->file, most - 1,
                         coordinators > 0 ? "; dse-coordinator runs the coordinator" : "");
    return true;
}

int main(int argc, char **argv)
{
    struct options options = {0};
    struct choice choice = {.first = -1};
    static struct agent agents[MAX_AGENTS];
    static const struct option table[] = {OPTIONS_COMMON,
                                          {"node", required_argument, NULL, OPTION_NODE},
                                          {"network", required_argument, NULL, OPTION_NETWORK},
                                          {0}};
    struct options_program program = {
        .name = name, .help = help, .table = table, .own = &choice, .take = take, .check = check};
    int stop = options_read(&program, argc, argv, &options);
    if (stop != 0)
        return stop - 1;
    return program_serve(name, &options, make_agents, &choice, agents);
}
