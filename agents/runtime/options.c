/* The command line that all agents share. */
#include "runtime/options.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dse_clock_t.h"

const char options_common_help[] =
    "  --set KEY=VALUE    change a value of the scenario, e.g. --set time.duration_s=60;\n"
    "                     may be given several times (dse-run --keys lists the keys)\n"
    "  --seed N           seed of all noise, short for --set seed=N\n"
    "  --lcm-url URL      bus, e.g. udpm://239.255.76.67:7667?ttl=0 (ttl=1: other hosts too);\n"
    "                     default $LCM_DEFAULT_URL\n"
    "  --pace PACE        lockstep: as fast as everybody is done (default);\n"
    "                     realtime: by the wall clock, who is late is predicted;\n"
    "                     replay: driven by lcm-logplayer\n"
    "  --speed X          realtime: plant seconds per second (default 1)\n"
    "  --run-id N         number of this run (default: a new one; estimators: the plant's)\n"
    "  --version, --help\n";

bool options_integer(const char *name, const char *value, int64_t min, int64_t max, int64_t *number,
                     struct error *error)
{
    char *end;
    errno = 0;
    long long parsed = strtoll(value, &end, 10);
    if (end == value || *end != '\0' || errno != 0 || parsed < min || parsed > max)
        return error_set(error, "--%s %s: must be a whole number from %" PRId64 " to %" PRId64,
                         name, value, min, max);
    *number = parsed;
    return true;
}

bool options_number(const char *name, const char *value, double *number, struct error *error)
{
    char *end;
    double parsed = strtod(value, &end);
    if (end == value || *end != '\0' || !isfinite(parsed) || parsed <= 0)
        return error_set(error, "--%s %s: must be a number greater than 0", name, value);
    *number = parsed;
    return true;
}

static bool add_override(struct options *options, const char *text, struct error *error)
{
    if (options->overrides_count == OPTIONS_MAX_OVERRIDES)
        return error_set(error, "--set %s: at most %d changes can be given", text,
                         OPTIONS_MAX_OVERRIDES);
    if (strchr(text, '=') == NULL)
        return error_set(error, "--set %s: must be KEY=VALUE", text);
    options->overrides[options->overrides_count++] = text;
    return true;
}

static bool take_pace(struct options *options, const char *value, struct error *error)
{
    static const char *const names[] = {
        [DSE_CLOCK_T_PACE_LOCKSTEP] = "lockstep",
        [DSE_CLOCK_T_PACE_REALTIME] = "realtime",
        [DSE_CLOCK_T_PACE_REPLAY] = "replay",
    };
    for (int i = 0; i < 3; i++)
        if (strcmp(value, names[i]) == 0) {
            options->pace = i;
            options->pace_given = true;
            return true;
        }
    return error_set(error, "--pace %s: must be lockstep, realtime or replay", value);
}

static bool take_common(struct options *options, int option, const char *value, struct error *error)
{
    int64_t number = 0;
    switch (option) {
    case OPTION_SET:
        return add_override(options, value, error);
    case OPTION_SEED:
        if (!options_integer("seed", value, 0, INT64_MAX, &number, error))
            return false;
        snprintf(options->seed, sizeof options->seed, "seed=%" PRId64, number);
        return add_override(options, options->seed, error);
    case OPTION_LCM_URL:
        options->lcm_url = value;
        return true;
    case OPTION_PACE:
        return take_pace(options, value, error);
    case OPTION_SPEED:
        return options_number("speed", value, &options->speed, error);
    case OPTION_RUN_ID:
        return options_integer("run-id", value, 1, INT64_MAX, &options->run_id, error);
    default:
        return error_set(error, "unknown option; --help lists them");
    }
}

/* 0: taken; otherwise an exit code + 1. */
static int take(const struct options_program *program, struct options *options, int option)
{
    struct error error = {0};
    switch (option) {
    case 'h':
        printf("%s%s", program->help, options_common_help);
        return 1;
    case OPTION_VERSION:
        printf("dse %s\n", DSE_VERSION);
        return 1;
    case '?':
        return EXIT_BAD_INPUT + 1;
    default:
        break;
    }
    bool ok = option >= OPTION_OWN ? program->take(program->own, option, optarg, &error)
                                   : take_common(options, option, optarg, &error);
    return ok ? 0 : options_complain(program->name, &error) + 1;
}

int options_read(const struct options_program *program, int argc, char **argv,
                 struct options *options)
{
    struct error error = {0};
    int option;
    while ((option = getopt_long(argc, argv, "h", program->table, NULL)) != -1) {
        int stop = take(program, options, option);
        if (stop != 0)
            return stop;
    }
    if (optind < argc)
        options->scenario = argv[optind];
    bool ok = true;
    if (optind + 1 < argc)
        ok = error_set(&error, "%s: only one scenario can be run at a time", argv[optind + 1]);
    else if (program->check != NULL)
        ok = program->check(program->own, options, &error);
    return ok ? 0 : options_complain(program->name, &error) + 1;
}

struct scenario *options_scenario(const struct options *options, struct error *error)
{
    char path[4096];
    if (options->scenario == NULL) {
        error_set(error, "which scenario? Give a file or the beginning of a shipped one's name "
                         "(ahg-43); dse-run --list shows them");
        return NULL;
    }
    if (!scenario_find(options->scenario, path, sizeof path, error))
        return NULL;
    return scenario_read(path, options->overrides, options->overrides_count, error);
}

int options_complain(const char *program, const struct error *error)
{
    fflush(stdout);
    fprintf(stderr, "%s: %s\n", program, error->text);
    return EXIT_BAD_INPUT;
}
