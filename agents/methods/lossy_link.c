/* Delays and losses at the receiver. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "methods/lossy_link.h"

#define PATH_SIZE 1024

struct lossy_link {
    struct dse_link_config config;
    int nodes;
    int16_t *table;
    struct dse_link *fate;
    struct dse_line *line;
    dse_real *memory;
};

/* ---- a recorded network ---- */

struct recording {
    const char *path;
    FILE *file;
    int line;
    struct lossy_link *links;
    int64_t last; /* largest stamp */
};

/* `name` beside the scenario file. */
static void beside(const char *scenario, const char *name, char *path, size_t size)
{
    const char *slash = strrchr(scenario, '/');
    int folder = name[0] == '/' || slash == NULL ? 0 : (int)(slash - scenario) + 1;
    snprintf(path, size, "%.*s%s", folder, scenario, name);
}

static bool wrong_row(const struct recording *recording, const char *row, struct error *error)
{
    return error_set(error,
                     "%s:%d: '%.60s' is not to,from,stamp,delay with two different nodes from 0 "
                     "to %d, a stamp >= 0 and a delay <= %d (-1: lost)",
                     recording->path, recording->line, row, recording->links->nodes - 1,
                     LOSSY_LINK_MAX_DELAY);
}

/* One row into the table; what is not listed is lost. */
static bool take_row(struct recording *recording, char *row, struct error *error)
{
    struct lossy_link *links = recording->links;
    long long to = -1, from = -1, stamp = -1, delay = 0;
    int used = 0;
    row[strcspn(row, "\r\n")] = '\0';
    if (row[0] == '\0' || row[0] == '#' || strcmp(row, "to,from,stamp,delay") == 0)
        return true;
    int fields = sscanf(row, "%lld,%lld,%lld,%lld%n", &to, &from, &stamp, &delay, &used);
    if (fields != 4 || row[used] != '\0' || to < 0 || to >= links->nodes || from < 0 ||
        from >= links->nodes || to == from || stamp < 0 || delay < -1 ||
        delay > LOSSY_LINK_MAX_DELAY)
        return wrong_row(recording, row, error);
    recording->last = stamp > recording->last ? stamp : recording->last;
    if (stamp < links->config.stamps)
        links->table[(to * links->nodes + from) * links->config.stamps + stamp] = (int16_t)delay;
    return true;
}

static bool read_rows(struct recording *recording, struct error *error)
{
    char row[256];
    while (fgets(row, sizeof row, recording->file) != NULL) {
        recording->line++;
        if (!take_row(recording, row, error))
            return false;
    }
    if (ferror(recording->file))
        return error_set(error, "%s: %s", recording->path, strerror(errno));
    if (recording->last + 1 < recording->links->config.stamps)
        return error_set(error,
                         "%s: the recorded network ends at stamp %lld, but the run has %d "
                         "communication instants",
                         recording->path, (long long)recording->last,
                         recording->links->config.stamps);
    return true;
}

static bool read_table(struct lossy_link *links, const char *scenario, const char *name,
                       int64_t instants, struct error *error)
{
    char path[PATH_SIZE];
    beside(scenario, name, path, sizeof path);
    struct recording recording = {.path = path, .links = links, .last = -1};
    size_t size = (size_t)links->nodes * (size_t)links->nodes * (size_t)instants;
    links->table = malloc((size + 1) * sizeof *links->table);
    if (links->table == NULL || instants > INT32_MAX / (links->nodes * links->nodes))
        return error_set(error, "%s: too large", path);
    for (size_t k = 0; k < size; k++)
        links->table[k] = DSE_LINK_LOST;
    links->config.table = links->table;
    links->config.nodes = links->nodes;
    links->config.stamps = (int)instants;
    recording.file = fopen(path, "r");
    if (recording.file == NULL)
        return error_set(error, "%s: %s (recorded network of %s)", path, strerror(errno), scenario);
    bool ok = read_rows(&recording, error);
    fclose(recording.file);
    return ok;
}

/* ---- life ---- */

void lossy_link_destroy(struct lossy_link *links)
{
    if (links == NULL)
        return;
    free(links->table);
    free(links->fate);
    free(links->line);
    free(links->memory);
    free(links);
}

static bool open_lines(struct lossy_link *links, int to, const int *sizes, struct error *error)
{
    struct dse_arena arena;
    int D = links->config.max_delay;
    int reals = 0;
    for (int j = 0; j < links->nodes; j++)
        reals += DSE_LINE_STORAGE(D, sizes[j]);
    links->fate = calloc((size_t)links->nodes + 1, sizeof *links->fate);
    links->line = calloc((size_t)links->nodes + 1, sizeof *links->line);
    links->memory = calloc((size_t)reals + 1, sizeof *links->memory);
    if (links->fate == NULL || links->line == NULL || links->memory == NULL)
        return error_set(error, "out of memory");
    dse_arena_init(&arena, links->memory, reals);
    for (int j = 0; j < links->nodes; j++)
        if (dse_link_init(&links->fate[j], &links->config, to, j) != DSE_OK ||
            dse_line_init(&links->line[j], D, sizes[j], &arena) != DSE_OK)
            return error_set(error, "the network's delays and losses cannot be set up");
    return true;
}

struct lossy_link *lossy_link_create(const struct lossy_link_section *section,
                                     const struct method_setup *setup, int nodes, const int *sizes,
                                     int64_t instants, struct error *error)
{
    if (section->file == NULL && section->loss > 0 && section->T_m == 0) {
        error_set(error,
                  "%s: networks.%s: link.loss is %.10g, but link.T_m = 0 allows no loss; "
                  "state T_m >= 1",
                  setup->scenario->file, setup->network->name, section->loss);
        return NULL;
    }
    struct lossy_link *links = calloc(1, sizeof *links);
    if (links == NULL) {
        error_set(error, "out of memory");
        return NULL;
    }
    links->nodes = nodes;
    links->config = (struct dse_link_config){.max_delay = (int)section->D,
                                             .max_losses = (int)section->T_m,
                                             .loss = section->loss,
                                             .seed = setup->scenario->seed + section->seed};
    if ((section->file != NULL &&
         !read_table(links, setup->scenario->file, section->file, instants, error)) ||
        !open_lines(links, setup->node, sizes, error)) {
        lossy_link_destroy(links);
        return NULL;
    }
    return links;
}

void lossy_link_put(struct lossy_link *links, int from, int64_t stamp, const dse_real *value)
{
    dse_line_put(&links->line[from], stamp, dse_link_fate(&links->fate[from], stamp), value);
}

const dse_real *lossy_link_take(struct lossy_link *links, int from, int64_t now, int64_t *stamp)
{
    return dse_line_take(&links->line[from], now, stamp);
}
