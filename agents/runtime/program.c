/* A program that serves agents, from its options to its exit code. */
#include "runtime/program.h"

int program_serve(const char *name, const struct options *options, program_make *make,
                  const void *choice, struct agent *agents)
{
    struct error error = {0};
    int n_agents = 0;
    host_catch_signals();
    struct scenario *scenario = options_scenario(options, &error);
    struct bus *bus = scenario != NULL ? bus_open(options->lcm_url, &error) : NULL;
    int code = EXIT_BAD_INPUT;
    if (bus != NULL && make(scenario, options, choice, bus, agents, &n_agents, &error))
        code = host_run(bus, agents, n_agents, NULL, NULL, &error) ? 0 : EXIT_RUN;
    if (error.text[0] != '\0')
        options_complain(name, &error);
    for (int i = 0; i < n_agents; i++)
        agents[i].destroy(agents[i].self);
    bus_close(bus);
    scenario_free(scenario);
    return code;
}
