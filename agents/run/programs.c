/* Where the other programs are. */
#include "run/programs.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

bool program_beside(const char *name, char *path, int size, struct error *error)
{
    ssize_t length = readlink("/proc/self/exe", path, (size_t)size - 1);
    if (length <= 0)
        return error_set(error, "cannot find the folder of dse-run");
    path[length] = '\0';
    char *slash = strrchr(path, '/');
    size_t room = slash != NULL ? (size_t)(path + size - slash) - 1 : 0;
    if (room <= strlen(name))
        return error_set(error, "cannot find the folder of dse-run");
    snprintf(slash + 1, room, "%s", name);
    if (access(path, X_OK) != 0)
        return error_set(error, "%s is not there: build it first (tools/demo builds everything)",
                         path);
    return true;
}

bool program_logger(char *path, int size, struct error *error)
{
    const char *given = getenv("DSE_LCM_LOGGER");
    if (given != NULL && access(given, X_OK) != 0)
        return error_set(error, "DSE_LCM_LOGGER=%s: not a program", given);
    if (given == NULL && access(DSE_LCM_LOGGER_PATH, X_OK) == 0)
        given = DSE_LCM_LOGGER_PATH;
    snprintf(path, (size_t)size, "%s", given != NULL ? given : "lcm-logger");
    return true;
}
