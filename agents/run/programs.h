/* Where the other programs are. */
#ifndef DSE_RUN_PROGRAMS_H
#define DSE_RUN_PROGRAMS_H

#include <stdbool.h>

#include "runtime/error.h"

/* The program of that name in dse-run's own folder. */
bool program_beside(const char *name, char *path, int size, struct error *error);
/* lcm-logger: $DSE_LCM_LOGGER, else the one found at build time, else by $PATH. */
bool program_logger(char *path, int size, struct error *error);

#endif
