/* dse-run: what its ways of running a scenario share. */
#ifndef DSE_RUN_RUN_H
#define DSE_RUN_RUN_H

#include <stdbool.h>
#include <stdint.h>

#include "runtime/options.h"
#include "runtime/scenario.h"

struct run_options {
    struct options common;
    bool inproc;
    const char *replay; /* log to re-estimate from */
    const char *log;    /* NULL: runs/<scenario>-<date>-<time>.lcm; "": none */
    bool dry_run;
    bool keys; /* print the table of keys */
    bool list; /* print the shipped scenarios */
    bool quiet;
    int processes; /* estimator processes that share the nodes, 0: one per node */
};

/* The log's path: as given, or a new one in runs/. False when it cannot be written. */
bool run_log_path(const struct run_options *options, const struct scenario *scenario, char *path,
                  int size, struct error *error);

/* Prints where the log is; removes an empty one. */
void run_log_tell(const char *path);

/* Each returns an exit code and prints its own summary. */
int run_processes(const struct run_options *options, const struct scenario *scenario);
int run_inproc(const struct run_options *options, const struct scenario *scenario);
int run_replay(const struct run_options *options);
int run_dry(const struct run_options *options, const struct scenario *scenario);

#endif
