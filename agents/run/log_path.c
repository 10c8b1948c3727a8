/* Where a run is recorded. */
#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "run/run.h"

bool run_log_path(const struct run_options *options, const struct scenario *scenario, char *path,
                  int size, struct error *error)
{
    if (options->log != NULL) {
        snprintf(path, (size_t)size, "%s", options->log);
    } else {
        char when[32];
        time_t now = time(NULL);
        struct tm local;
        localtime_r(&now, &local);
        strftime(when, sizeof when, "%Y%m%d-%H%M%S", &local);
        if (mkdir("runs", 0777) != 0 && errno != EEXIST)
            return error_set(error, "cannot make the folder runs: %s; give a place with --log",
                             strerror(errno));
        snprintf(path, (size_t)size, "runs/%s-%s.lcm", scenario->name, when);
    }
    if (path[0] == '\0')
        return true;
    FILE *file = fopen(path, "wb");
    if (file == NULL)
        return error_set(error, "cannot write the log %s: %s", path, strerror(errno));
    fclose(file);
    return true;
}

void run_log_tell(const char *path)
{
    struct stat status;
    if (path[0] == '\0' || stat(path, &status) != 0)
        return;
    if (S_ISREG(status.st_mode) && status.st_size == 0)
        unlink(path); /* nothing was recorded: the run did not begin */
    else
        printf("log: %s\n", path);
}
