/* Files of a scenario: its own text, and what it names. */
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include <jansson.h>

#include "runtime/scenario_internal.h"

#define MAX_FILE_SIZE (1024 * 1024)
#define PATH_SIZE     1024

char *scenario_text(const char *path, struct error *error)
{
    FILE *file = fopen(path, "rb");
    char *text = malloc(MAX_FILE_SIZE + 2);
    bool good = false;
    if (file == NULL) {
        error_set(error, "%s: %s", path, strerror(errno));
    } else if (text == NULL) {
        error_set(error, "%s: out of memory", path);
    } else {
        size_t size = fread(text, 1, MAX_FILE_SIZE + 1, file);
        text[size] = '\0';
        if (ferror(file))
            error_set(error, "%s: %s", path, strerror(errno));
        else if (size > MAX_FILE_SIZE)
            error_set(error, "%s: is larger than %d bytes: too large for a scenario", path,
                      MAX_FILE_SIZE);
        else if (strlen(text) != size)
            error_set(error, "%s: contains a zero byte: not a text", path);
        else
            good = true;
    }
    if (file != NULL)
        fclose(file);
    if (good)
        return text;
    free(text);
    return NULL;
}

static const char *find(const struct scenario_part *parts, unsigned count, const char *name)
{
    for (unsigned i = 0; i < count; i++)
        if (strcmp(parts[i].name, name) == 0)
            return parts[i].text;
    return NULL;
}

/* `name` beside the scenario file. */
static void beside(const char *scenario, const char *name, char *path, size_t size)
{
    const char *slash = strrchr(scenario, '/');
    int folder = name[0] == '/' || slash == NULL ? 0 : (int)(slash - scenario) + 1;
    snprintf(path, size, "%.*s%s", folder, scenario, name);
}

/* What a log carries is JSON, and that is UTF-8. */
static bool is_utf8(const char *text)
{
    json_t *probe = json_string(text);
    json_decref(probe);
    return probe != NULL;
}

/* Takes the text over. */
static const char *keep(struct scenario *scenario, const char *name, char *text)
{
    struct scenario_part *parts =
        realloc(scenario->parts, (scenario->parts_count + 1) * sizeof *parts);
    if (parts != NULL) {
        scenario->parts = parts;
        parts[scenario->parts_count] = (struct scenario_part){.name = strdup(name), .text = text};
        if (parts[scenario->parts_count].name != NULL && text != NULL)
            return parts[scenario->parts_count++].text;
        free(parts[scenario->parts_count].name);
    }
    free(text);
    return NULL;
}

const char *scenario_part_text(const struct scenario_tree *tree, struct scenario *scenario,
                               const char *name, struct error *error)
{
    char path[PATH_SIZE];
    const char *text = find(scenario->parts, scenario->parts_count, name);
    if (text != NULL)
        return text;
    const char *given = find(tree->parts, tree->parts_count, name);
    char *read = NULL;
    if (given == NULL) {
        beside(tree->file, name, path, sizeof path);
        read = scenario_text(path, error);
        if (read == NULL)
            return NULL;
        if (!is_utf8(read)) {
            error_set(error, "%s: is not UTF-8 text", path);
            free(read);
            return NULL;
        }
    } else {
        read = strdup(given);
    }
    text = keep(scenario, name, read);
    if (text == NULL)
        error_set(error, "%s: out of memory", name);
    return text;
}

void scenario_parts_free(struct scenario_part *parts, unsigned count)
{
    for (unsigned i = 0; i < count; i++) {
        free(parts[i].name);
        free(parts[i].text);
    }
    free(parts);
}
