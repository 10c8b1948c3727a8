/* The progress line: sample, plant time, speed against real time, time left. */
#ifndef DSE_RUN_PROGRESS_H
#define DSE_RUN_PROGRESS_H

#include <stdbool.h>
#include <stdint.h>

#include "runtime/bus.h"
#include "runtime/scenario.h"

struct progress {
    const struct scenario *scenario;
    int64_t samples; /* of the whole run */
    int64_t k;       /* last sample seen, -1 */
    double t;        /* its plant time */
    double began;    /* when sample 0 was seen */
    double shown;
    bool terminal; /* rewrite one line; otherwise a line now and then */
    bool quiet;
};

bool progress_watch(struct progress *progress, const struct scenario *scenario, int64_t samples,
                    bool quiet, struct bus *bus, struct error *error);
/* Prints when it is time to; fits host_run's tick. */
void progress_tick(void *progress);
/* The last line, with the run's mean speed. */
void progress_end(struct progress *progress);

#endif
