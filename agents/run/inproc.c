/* The whole network in one process over LCM's memq, with a simulated or a recorded plant. */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "dse_clock_t.h"
#include "run/compare.h"
#include "run/progress.h"
#include "run/recorded.h"
#include "run/run.h"
#include "runtime/agent.h"
#include "runtime/clock.h"
#include "runtime/networks.h"
#include "runtime/node.h"

#define JOIN_S 20.0

/* Agent 0 is the clock, the others are nodes. */
struct network {
    struct bus *bus;
    struct agent *agents;
    int n_agents;
};

static bool add_nodes(struct network *network, const struct clock_config *clock,
                      struct error *error)
{
    const struct scenario *scenario = clock->scenario;
    for (unsigned i = 0; i < scenario->networks_count; i++) {
        int nodes = network_nodes(scenario, (int)i, NULL, error);
        struct agent *grown = nodes < 0
                                  ? NULL
                                  : realloc(network->agents, (size_t)(network->n_agents + nodes) *
                                                                 sizeof *network->agents);
        if (grown == NULL)
            return error_set(error, "out of memory");
        network->agents = grown;
        for (int node = 0; node < nodes; node++) {
            struct node_config config = {.scenario = scenario,
                                         .network = (int)i,
                                         .node = node,
                                         .pace = clock->pace,
                                         .speed = clock->speed,
                                         .run_id = clock->run_id};
            if (!node_create(&config, network->bus, &network->agents[network->n_agents], error))
                return false;
            network->n_agents++;
        }
    }
    return true;
}

static bool build(struct network *network, const struct clock_config *clock, struct error *error)
{
    network->agents = calloc(1, sizeof *network->agents);
    if (network->agents == NULL)
        return error_set(error, "out of memory");
    if (!clock_create(clock, network->bus, &network->agents[0], error))
        return false;
    network->n_agents = 1;
    return add_nodes(network, clock, error);
}

static void tear_down(struct network *network)
{
    for (int i = 0; i < network->n_agents; i++)
        network->agents[i].destroy(network->agents[i].self);
    free(network->agents);
    bus_close(network->bus);
}

static void print_hashes(const struct network *network)
{
    for (int i = 1; i < network->n_agents; i++) {
        int64_t samples;
        uint64_t hash = node_estimate_hash(&network->agents[i], &samples);
        printf("  %s: %lld estimates, hash %016" PRIx64 "\n", network->agents[i].name,
               (long long)samples, hash);
    }
}

/* Runs the network to its end; the log (path "" for none) is complete afterwards. */
static bool run_network(struct network *network, const struct clock_config *clock,
                        const char *log_path, bool quiet, struct error *error)
{
    struct progress progress;
    struct log_writer *log = NULL;
    if (log_path[0] != '\0') {
        log = log_record(network->bus, log_path, error);
        if (log == NULL)
            return false;
    }
    bool ok =
        progress_watch(&progress, clock->scenario, clock->samples, quiet, network->bus, error) &&
        build(network, clock, error) &&
        host_run(network->bus, network->agents, network->n_agents, progress_tick, &progress, error);
    progress_end(&progress);
    while (log != NULL && bus_wait(network->bus, 0) > 0)
        continue; /* the last words of the agents */
    if (log != NULL && !log_finish(log, error))
        ok = false;
    if (host_interrupted())
        ok = error_set(error, "interrupted at sample %lld", (long long)progress.k);
    return ok;
}

int run_inproc(const struct run_options *options, const struct scenario *scenario)
{
    struct error error = {0};
    char log_path[4096];
    if (!run_log_path(options, scenario, log_path, (int)sizeof log_path, &error))
        return options_complain("dse-run", &error);
    struct clock_config clock = {.scenario = scenario,
                                 .samples = scenario_samples(scenario),
                                 .pace = options->common.pace,
                                 .speed = options->common.speed,
                                 .join_s = JOIN_S,
                                 .run_id = options->common.run_id != 0 ? options->common.run_id
                                                                       : clock_new_run_id()};
    if (!plant_source(scenario, &clock.source, &error))
        return options_complain("dse-run", &error);
    struct network network = {.bus = bus_open("memq://", &error)};
    bool ok =
        network.bus != NULL && run_network(&network, &clock, log_path, options->quiet, &error);
    if (!ok)
        options_complain("dse-run", &error);
    if (ok && !options->quiet)
        print_hashes(&network);
    run_log_tell(log_path);
    tear_down(&network);
    return ok ? 0 : EXIT_RUN;
}

/* The recorded scenario, with this call's overrides on top of the recorded ones. */
static struct scenario *recorded_scenario(const struct run_options *options,
                                          const struct recorded *recorded, struct error *error)
{
    unsigned count = recorded->info.overrides_count + options->common.overrides_count;
    const char **overrides = calloc(count + 1, sizeof *overrides);
    if (overrides == NULL) {
        error_set(error, "out of memory");
        return NULL;
    }
    for (unsigned i = 0; i < recorded->info.overrides_count; i++)
        overrides[i] = recorded->info.overrides[i];
    for (unsigned i = 0; i < options->common.overrides_count; i++)
        overrides[recorded->info.overrides_count + i] = options->common.overrides[i];
    struct scenario *scenario =
        scenario_parse_recorded(recorded->info.yaml, recorded->info.file, recorded->info.parts,
                                recorded->info.parts_count, overrides, count, error);
    free(overrides);
    return scenario;
}

static bool replay_network(const struct run_options *options, struct recorded *recorded,
                           const struct scenario *scenario, struct error *error)
{
    struct clock_config clock = {.scenario = scenario,
                                 .samples = recorded->samples,
                                 .pace = DSE_CLOCK_T_PACE_LOCKSTEP,
                                 .join_s = JOIN_S,
                                 .run_id = options->common.run_id != 0 ? options->common.run_id
                                                                       : clock_new_run_id()};
    recorded_source(recorded, &clock.source);
    struct network network = {.bus = bus_open("memq://", error)};
    if (network.bus == NULL)
        return false;
    struct compare *compare = compare_start(recorded, network.bus, error);
    const char *log_path = options->log != NULL ? options->log : "";
    bool ok = compare != NULL && run_network(&network, &clock, log_path, options->quiet, error);
    bool changed = options->common.overrides_count > 0;
    bool equal = ok && compare_report(compare, scenario);
    if (ok && !equal && !changed)
        ok = error_set(error, "the replay differs from the record");
    run_log_tell(log_path);
    compare_free(compare);
    tear_down(&network);
    return ok;
}

int run_replay(const struct run_options *options)
{
    struct error error = {0};
    struct recorded recorded;
    struct scenario *scenario = NULL;
    bool ok = recorded_open(options->replay, &recorded, &error);
    bool usable = ok && (scenario = recorded_scenario(options, &recorded, &error)) != NULL &&
                  recorded_load(&recorded, scenario, true, &error);
    if (usable && recorded.samples < recorded.info.samples)
        fprintf(stderr, "dse-run: %s holds %lld of the run's %lld samples\n", options->replay,
                (long long)recorded.samples, (long long)recorded.info.samples);
    if (usable && recorded.missing > 0)
        fprintf(stderr,
                "dse-run: %s lacks %lld message(s): they were lost on the way to the logger and "
                "count as missing measurements\n",
                options->replay, (long long)recorded.missing);
    int code = usable ? 0 : EXIT_BAD_INPUT;
    if (usable && !replay_network(options, &recorded, scenario, &error))
        code = EXIT_RUN;
    if (code != 0)
        options_complain("dse-run", &error);
    recorded_free(&recorded);
    scenario_free(scenario);
    return code;
}
