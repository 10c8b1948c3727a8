/* dse-plant: the simulated plant and the sample clock of a scenario. */
#include <stdio.h>
#include <stdlib.h>

#include "dse_clock_t.h"
#include "runtime/clock.h"
#include "runtime/options.h"

#define OPTION_WAIT         OPTION_OWN
#define OPTION_RECORDER_LAG (OPTION_OWN + 1)

static const char name[] = "dse-plant";

static const char help[] =
    "usage: dse-plant SCENARIO [options]\n"
    "\n"
    "Simulates the plant of the scenario: waits until all estimators have joined, then publishes\n"
    "sample after sample until the scenario's duration is over.\n"
    "\n"
    "  --wait S           how long to wait for the estimators (default: for ever)\n"
    "  --recorder-lag N   lockstep: run at most N samples ahead of what dse-run has recorded, so\n"
    "                     that no log lacks a message (default 0: no recorder to wait for)\n";

struct own {
    double wait;
    int recorder_lag;
};

static bool take(void *self, int option, char *value, struct error *error)
{
    struct own *own = self;
    int64_t number = 0;
    if (option == OPTION_WAIT)
        return options_number("wait", value, &own->wait, error);
    bool ok = options_integer("recorder-lag", value, 0, 1000000, &number, error);
    own->recorder_lag = (int)number;
    return ok;
}

static bool check(const void *own, const struct options *options, struct error *error)
{
    (void)own;
    return options->pace != DSE_CLOCK_T_PACE_REPLAY ||
           error_set(error, "--pace replay: the plant is lcm-logplayer then, not dse-plant");
}

int main(int argc, char **argv)
{
    struct options options = {0};
    struct error error = {0};
    static const struct option table[] = {
        OPTIONS_COMMON,
        {"wait", required_argument, NULL, OPTION_WAIT},
        {"recorder-lag", required_argument, NULL, OPTION_RECORDER_LAG},
        {0}};
    struct own own = {0};
    struct options_program program = {
        .name = name, .help = help, .table = table, .own = &own, .take = take, .check = check};
    int stop = options_read(&program, argc, argv, &options);
    if (stop != 0)
        return stop - 1;
    host_catch_signals();
    struct clock_config config = {.pace = options.pace,
                                  .speed = options.speed,
                                  .join_s = own.wait,
                                  .recorder_lag = own.recorder_lag,
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
        options_complain(name, &error);
    bus_close(bus);
    scenario_free(scenario);
    return code;
}
