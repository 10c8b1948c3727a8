/* Why a bus does not work, in words that help. */
#ifndef DSE_RUNTIME_BUS_TROUBLE_H
#define DSE_RUNTIME_BUS_TROUBLE_H

#include <stdbool.h>

#include "runtime/error.h"

/* Looks for the reason why LCM could not use `url` and tells it with its remedy: no such kind of
 * URL, no multicast address, an occupied port, no route. `what` says what failed. Always false. */
bool bus_trouble(const char *url, const char *what, struct error *error);

#endif
