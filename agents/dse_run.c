/* dse-run: runs a scenario, as processes or in one, or re-estimates from a recorded log. */
#include <stdio.h>
#include <sys/stat.h>

#include "dse_clock_t.h"
#include "run/run.h"
#include "runtime/agent.h"

enum {
    OPTION_INPROC = OPTION_OWN,
    OPTION_REPLAY,
    OPTION_LOG,
    OPTION_NO_LOG,
    OPTION_DRY_RUN,
    OPTION_QUIET,
    OPTION_KEYS,
    OPTION_LIST,
    OPTION_PROCESSES
};

static const char name[] = "dse-run";

static const char help[] =
    "usage: dse-run SCENARIO [options]\n"
    "       dse-run --replay LOG [options]\n"
    "\n"
    "Runs the plant of a scenario and its networks of estimators and records everything they say.\n"
    "SCENARIO is a YAML file or the beginning of a shipped scenario's name: dse-run ahg-43\n"
    "\n"
    "  --log FILE         where to record (default runs/SCENARIO-DATE-TIME.lcm); --no-log: "
    "nowhere\n"
    "  --processes N      share the nodes among N estimator processes (default: one per node)\n"
    "  --inproc           everything in one process instead of one process per node\n"
    "  --replay LOG       estimate again from the measurements in LOG, as fast as it goes, and\n"
    "                     compare with the recorded estimates bit for bit\n"
    "  --dry-run          print who would be started and who would talk to whom\n"
    "  --list             the shipped scenarios\n"
    "  --keys             all keys of a scenario with their limits and defaults\n"
    "  --quiet            no progress lines\n";

static bool take(void *self, int option, char *value, struct error *error)
{
    struct run_options *options = self;
    int64_t number = 0;
    switch (option) {
    case OPTION_INPROC:
        options->inproc = true;
        return true;
    case OPTION_REPLAY:
        options->replay = value;
        return true;
    case OPTION_LOG:
        options->log = value;
        return true;
    case OPTION_NO_LOG:
        options->log = "";
        return true;
    case OPTION_DRY_RUN:
        options->dry_run = true;
        return true;
    case OPTION_QUIET:
        options->quiet = true;
        return true;
    case OPTION_PROCESSES:
        if (!options_integer("processes", value, 1, 1000, &number, error))
            return false;
        options->processes = (int)number;
        return true;
    case OPTION_KEYS:
        options->keys = true;
        return true;
    default:
        options->list = true;
        return true;
    }
}

static bool same_file(const char *a, const char *b)
{
    struct stat one, other;
    return stat(a, &one) == 0 && stat(b, &other) == 0 && one.st_dev == other.st_dev &&
           one.st_ino == other.st_ino;
}

static bool check(const void *self, const struct options *common, struct error *error)
{
    const struct run_options *options = self;
    if (options->replay != NULL && common->scenario != NULL)
        return error_set(error, "--replay takes the scenario from the log: leave out %s",
                         common->scenario);
    if (options->replay != NULL && common->pace_given)
        return error_set(error, "--replay goes as fast as it can: leave out --pace");
    if (options->replay != NULL && options->log != NULL && same_file(options->replay, options->log))
        return error_set(error, "--log %s: that is the log to be replayed", options->log);
    if (options->inproc && common->pace == DSE_CLOCK_T_PACE_REPLAY)
        return error_set(error, "--pace replay needs processes on a bus: leave out --inproc, or "
                                "use --replay LOG");
    return true;
}

int main(int argc, char **argv)
{
    struct run_options options = {0};
    struct error error = {0};
    static const struct option table[] = {OPTIONS_COMMON,
                                          {"inproc", no_argument, NULL, OPTION_INPROC},
                                          {"replay", required_argument, NULL, OPTION_REPLAY},
                                          {"log", required_argument, NULL, OPTION_LOG},
                                          {"no-log", no_argument, NULL, OPTION_NO_LOG},
                                          {"dry-run", no_argument, NULL, OPTION_DRY_RUN},
                                          {"quiet", no_argument, NULL, OPTION_QUIET},
                                          {"keys", no_argument, NULL, OPTION_KEYS},
                                          {"list", no_argument, NULL, OPTION_LIST},
                                          {"processes", required_argument, NULL, OPTION_PROCESSES},
                                          {0}};
    struct options_program program = {
        .name = name, .help = help, .table = table, .own = &options, .take = take, .check = check};
    int stop = options_read(&program, argc, argv, &options.common);
    if (stop != 0)
        return stop - 1;
    if (options.keys)
        scenario_print_keys();
    if (options.list)
        scenario_print_list();
    if (options.keys || options.list)
        return 0;
    host_catch_signals();
    if (options.replay != NULL)
        return run_replay(&options);
    struct scenario *scenario = options_scenario(&options.common, &error);
    if (scenario == NULL)
        return options_complain(name, &error);
    int code;
    if (options.dry_run)
        code = run_dry(&options, scenario);
    else if (options.inproc)
        code = run_inproc(&options, scenario);
    else
        code = run_processes(&options, scenario);
    scenario_free(scenario);
    return code;
}
