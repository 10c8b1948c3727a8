/* dse-plant: the simulated plant and the sample clock of a scenario. */
#include <stdio.h>
#include <stdlib.h>

#include "dse_clock_t.h"
#include "runtime/clock.h"
#include "runtime/options.h"

#define OPTION_WAIT         OPTION_OWN
#define OPTION_RECORDER_LAG (OPTION_OWN + 1)

static const char program[] = "dse-plant";

static const char help[] =
    "usage: dse-plant SCENARIO [options]\n"
    "\n"
    "Simulates the plant of the scenario: waits until all estimators have joined, then publishes\n"
    "sample after sample until the scenario's duration is over.\n"
    "\n"
    "  --wait S           how long to wait for the estimators (default: for ever)\n"
    "  --recorder-lag N   lockstep: run at most N samples ahead of what dse-run has recorded, so\n"
    "                     that no log lacks a message (default 0: no recorder to wait for)\n";

/* 0: go on; otherwise an exit code + 1. */
static int read_options(int argc, char **argv, struct options *options, double *wait,
                        int *recorder_lag)
{
    static const struct option table[] = {
        OPTIONS_COMMON,
        {"wait", required_argument, NULL, OPTION_WAIT},
        {"recorder-lag", required_argument, NULL, OPTION_RECORDER_LAG},
        {0}};
    struct error error = {0};
    int64_t number = 0;
    int option;
    while ((option = getopt_long(argc, argv, "h", table, NULL)) != -1) {
        bool ok = true;
        if (option == 'h') {
            printf("%s%s", help, options_common_help);
            return 1;
        } else if (option == OPTION_VERSION) {
            printf("dse %s\n", DSE_VERSION);
            return 1;
        } else if (option == '?') {
            return EXIT_BAD_INPUT + 1;
        } else if (option == OPTION_WAIT) {
            ok = options_number("wait", optarg, wait, &error);
        } else if (option == OPTION_RECORDER_LAG) {
            ok = options_integer("recorder-lag", optarg, 0, 1000000, &number, &error);
            *recorder_lag = (int)number;
        } else {
            ok = options_take(options, option, optarg, &error);
        }
        if (!ok)
            return options_complain(program, &error) + 1;
    }
    if (optind < argc)
        options->scenario = argv[optind];
    if (optind + 1 < argc)
        error_set(&error, "%s: only one scenario can be run at a time", argv[optind + 1]);
    else if (options->pace == DSE_CLOCK_T_PACE_REPLAY)
        error_set(&error, "--pace replay: the plant is lcm-logplayer then, not dse-plant");
    return error.text[0] != '\0' ? options_complain(program, &error) + 1 : 0;
}

int main(int argc, char **argv)
{
    struct options options = {0};
    struct error error = {0};
    double wait = 0;
    int recorder_lag = 0;
    int stop = read_options(argc, argv, &options, &wait, &recorder_lag);
    if (stop != 0)
        return stop - 1;
    host_catch_signals();
    struct clock_config config = {.pace = options.pace,
                                  .speed = options.speed,
                                  .join_s = wait,
                                  .recorder_lag = recorder_lag,
                                  .run_id =
                                      options.run_id != 0 ? options.run_id : clock_new_run_id()};
    struct scenario *scenario = options_scenario(&options, &error);
    struct bus *bus = scenario != NULL ? bus_open(options.lcm_url, &error) : NULL;
    struct agent agent;
    int code = EXIT_BAD_INPUT;
    if (bus != NULL && plant_source(scenario, &config.source, &error)) {
        config.scenario = scenario;
        config.samples = scenario_samples(scenario);
        if (clock_create(&config, bus, &agent, &error)) {
            code = host_run(bus, &agent, 1, NULL, NULL, &error) ? 0 : EXIT_RUN;
            agent.destroy(agent.self);
        }
    }
    if (error.text[0] != '\0')
        options_complain(program, &error);
    bus_close(bus);
    scenario_free(scenario);
    return code;
}
