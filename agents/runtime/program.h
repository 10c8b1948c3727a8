/* A program that serves agents of a scenario: opens the scenario and the bus, makes the agents,
 * runs them and takes everything down again. */
#ifndef DSE_RUNTIME_PROGRAM_H
#define DSE_RUNTIME_PROGRAM_H

#include "runtime/agent.h"
#include "runtime/options.h"

/* Fills agents[0 .. *n_agents - 1], also those made before a failure; choice: the program's own
 * options. False and an error text on failure. */
typedef bool program_make(const struct scenario *scenario, const struct options *options,
                          const void *choice, struct bus *bus, struct agent *agents, int *n_agents,
                          struct error *error);

/* The exit code of the program called `name`; agents: room for all that `make` makes. */
int program_serve(const char *name, const struct options *options, program_make *make,
                  const void *choice, struct agent *agents);

#endif
