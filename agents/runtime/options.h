/* The command line that all agents share. */
#ifndef DSE_RUNTIME_OPTIONS_H
#define DSE_RUNTIME_OPTIONS_H

#include <getopt.h>
#include <stdbool.h>
#include <stdint.h>

#include "runtime/scenario.h"

#define OPTIONS_MAX_OVERRIDES 64

struct options {
    const char *scenario; /* file or unique beginning of a shipped scenario's name */
    const char *lcm_url;  /* NULL: $LCM_DEFAULT_URL, else the program's default */
    const char *overrides[OPTIONS_MAX_OVERRIDES]; /* --set key=value, --seed as seed=value */
    unsigned overrides_count;
    char seed[32];
    int pace; /* DSE_CLOCK_T_PACE_* */
    bool pace_given;
    double speed;   /* realtime: plant seconds per second, 1 by default */
    int64_t run_id; /* 0: not given */
};

/* Long options every agent has, for its own table: OPTIONS_COMMON, then its own. Values >= 256. */
#define OPTIONS_COMMON                                                                             \
    {"set", required_argument, NULL, OPTION_SET}, {"seed", required_argument, NULL, OPTION_SEED},  \
        {"lcm-url", required_argument, NULL, OPTION_LCM_URL},                                      \
        {"pace", required_argument, NULL, OPTION_PACE},                                            \
        {"speed", required_argument, NULL, OPTION_SPEED},                                          \
        {"run-id", required_argument, NULL, OPTION_RUN_ID},                                        \
        {"version", no_argument, NULL, OPTION_VERSION},                                            \
    {                                                                                              \
        "help", no_argument, NULL, 'h'                                                             \
    }

enum {
    OPTION_SET = 256,
    OPTION_SEED,
    OPTION_LCM_URL,
    OPTION_PACE,
    OPTION_SPEED,
    OPTION_RUN_ID,
    OPTION_VERSION,
    OPTION_OWN /* a program's own options begin here */
};

extern const char options_common_help[];

/* What a program adds to the common options. */
struct options_program {
    const char *name;
    const char *help; /* printed before the common options' */
    const struct option *table;
    void *own; /* where its own options go */
    /* Takes an own option: false and an error text when its value makes no sense. */
    bool (*take)(void *own, int option, char *value, struct error *error);
    /* Checks the whole; may be NULL. */
    bool (*check)(const void *own, const struct options *options, struct error *error);
};

/* Reads the command line; --help, --version and mistakes are answered here. 0: go on; otherwise the
 * exit code to end with, plus 1. */
int options_read(const struct options_program *program, int argc, char **argv,
                 struct options *options);

/* A whole number within [min, max] or a number; false and an error text that names the option. */
bool options_integer(const char *name, const char *value, int64_t min, int64_t max, int64_t *number,
                     struct error *error);
bool options_number(const char *name, const char *value, double *number, struct error *error);

/* Finds and reads the scenario. */
struct scenario *options_scenario(const struct options *options, struct error *error);

/* "PROGRAM: TEXT" on stderr; the exit code to return. */
int options_complain(const char *program, const struct error *error);

#define EXIT_BAD_INPUT 2 /* command line or scenario */
#define EXIT_RUN       1 /* the run itself failed */

#endif
