/* "ahg-43" -> .../sim/scenarios/ahg-43_cstr2_continuous.yaml */
#include <ctype.h>
#include <dirent.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "runtime/scenario_internal.h"

struct listing {
    char path[SCENARIO_MAX_WORDS][512];
    int count;
};

static const char *name_of(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash != NULL ? slash + 1 : path;
}

static bool is_file(const char *path)
{
    struct stat status;
    return stat(path, &status) == 0 && !S_ISDIR(status.st_mode);
}

static bool is_listed(const struct listing *listing, const char *name)
{
    for (int i = 0; i < listing->count; i++)
        if (strcmp(name_of(listing->path[i]), name) == 0)
            return true;
    return false;
}

/* Adds the *.yaml files of a folder whose names no earlier folder has. */
static void list_folder(struct listing *listing, const char *folder)
{
    DIR *directory = opendir(folder);
    if (directory == NULL)
        return;
    for (const struct dirent *entry; (entry = readdir(directory)) != NULL;) {
        size_t length = strlen(entry->d_name);
        if (length <= 5 || strcmp(entry->d_name + length - 5, ".yaml") != 0 ||
            entry->d_name[0] == '.' || is_listed(listing, entry->d_name))
            continue;
        if (listing->count == SCENARIO_MAX_WORDS)
            break;
        char *path = listing->path[listing->count];
        int needed = snprintf(path, sizeof listing->path[0], "%s/%s", folder, entry->d_name);
        if (needed > 0 && (size_t)needed < sizeof listing->path[0] && is_file(path))
            listing->count++;
    }
    closedir(directory);
}

static int by_name(const void *a, const void *b)
{
    return strcmp(name_of(a), name_of(b));
}

static void list_folders(struct listing *listing)
{
    const char *folders = getenv("DSE_SCENARIOS");
    listing->count = 0;
    while (folders != NULL && *folders != '\0') {
        char folder[400];
        size_t n = strcspn(folders, ":");
        snprintf(folder, sizeof folder, "%.*s", (int)n, folders);
        if (n > 0)
            list_folder(listing, folder);
        folders += n + (folders[n] == ':');
    }
    list_folder(listing, DSE_SCENARIO_FOLDER);
    qsort(listing->path, (size_t)listing->count, sizeof listing->path[0], by_name);
}

/* 3: the file's whole name, 2: its first words, 1: its first letters, 0: no match. */
static int match(const char *file, const char *name)
{
    size_t length = strlen(name);
    if (strncmp(file, name, length) != 0)
        return 0;
    const char *rest = file + length;
    if (rest[0] == '\0' || strcmp(rest, ".yaml") == 0)
        return 3;
    return isalnum((unsigned char)rest[0]) ? 1 : 2;
}

/* No match: all there are. The hint compares first words, as people type them: ahg43 for ahg-43. */
static bool fail_none(const struct listing *listing, const char *name, struct error *error)
{
    struct scenario_words names = {.count = 0}, first_words = {.count = 0};
    char first[SCENARIO_MAX_WORDS][32], text[700], hint[64] = "";
    for (int i = 0; i < listing->count; i++) {
        const char *file = name_of(listing->path[i]);
        snprintf(first[i], sizeof first[i], "%.*s", (int)strcspn(file, "_."), file);
        scenario_words_add(&names, file);
        scenario_words_add(&first_words, first[i]);
    }
    scenario_words_text(&names, "", text, sizeof text);
    int nearest = scenario_words_nearest(&first_words, name);
    if (nearest >= 0)
        snprintf(hint, sizeof hint, " (did you mean %s?)", first[nearest]);
    return error_set(error, "no scenario '%.80s'; there are: %s%s", name, text, hint);
}

static bool fail_several(const struct listing *listing, const char *name, int quality,
                         struct error *error)
{
    struct scenario_words names = {.count = 0};
    char text[700];
    for (int i = 0; i < listing->count; i++)
        if (match(name_of(listing->path[i]), name) == quality)
            scenario_words_add(&names, name_of(listing->path[i]));
    scenario_words_text(&names, "", text, sizeof text);
    return error_set(error, "'%.80s' fits several scenarios: %s", name, text);
}

static bool answer(const char *found, char *path, unsigned path_size, struct error *error)
{
    int needed = snprintf(path, path_size, "%s", found);
    if (needed >= 0 && (unsigned)needed < path_size)
        return true;
    return error_set(error, "%.200s..: the path is too long", found);
}

static bool find_listed(const struct listing *listing, const char *name, char *path,
                        unsigned path_size, struct error *error)
{
    int best = 0, found = -1, count = 0;
    for (int i = 0; i < listing->count; i++) {
        int quality = match(name_of(listing->path[i]), name);
        if (quality > best) {
            best = quality;
            count = 0;
        }
        if (quality == best) {
            found = i;
            count++;
        }
    }
    if (best == 0)
        return fail_none(listing, name, error);
    if (count > 1)
        return fail_several(listing, name, best, error);
    return answer(listing->path[found], path, path_size, error);
}

bool scenario_find(const char *name, char *path, unsigned path_size, struct error *error)
{
    if (name[0] == '\0')
        return error_set(error, "the name of the scenario is empty");
    if (is_file(name))
        return answer(name, path, path_size, error);
    if (strchr(name, '/') != NULL) {
        struct stat status;
        bool folder = stat(name, &status) == 0;
        return error_set(error, "%.400s: %s", name, folder ? "is a folder" : strerror(errno));
    }
    struct listing *listing = malloc(sizeof *listing);
    if (listing == NULL)
        return error_set(error, "out of memory");
    list_folders(listing);
    bool good = find_listed(listing, name, path, path_size, error);
    free(listing);
    return good;
}

void scenario_print_list(void)
{
    struct listing *listing = malloc(sizeof *listing);
    if (listing == NULL)
        return;
    list_folders(listing);
    for (int i = 0; i < listing->count; i++) {
        struct error error = {0};
        struct scenario *scenario = scenario_read(listing->path[i], NULL, 0, &error);
        const char *title = scenario != NULL ? scenario->title : error.text;
        printf("%-36.*s %s\n", (int)strcspn(name_of(listing->path[i]), "."),
               name_of(listing->path[i]), title != NULL ? title : "");
        scenario_free(scenario);
    }
    free(listing);
}
