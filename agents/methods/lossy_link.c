/* Delays and losses at the receiver, by communication instants. */
#include <stdlib.h>

#include "methods/lossy_link.h"

struct lossy_link {
    struct dse_link_config config;
    struct dse_link_outage *outages; /* counted in instants */
    struct dse_link *fate;
    struct dse_line *line;
    dse_real *memory;
};

void lossy_link_destroy(struct lossy_link *links)
{
    if (links == NULL)
        return;
    free(links->outages);
    free(links->fate);
    free(links->line);
    free(links->memory);
    free(links);
}

/* The first instant that is not before a sample; instant s is at sample s every. */
static int64_t first_instant(int64_t sample, int64_t every)
{
    return sample / every + (sample % every != 0);
}

static bool count_in_instants(struct lossy_link *links, int64_t every, struct error *error)
{
    const int count = links->config.n_outages;
    links->outages = calloc((size_t)count + 1, sizeof *links->outages);
    if (links->outages == NULL)
        return error_set(error, "out of memory");
    for (int k = 0; k < count; k++) {
        const struct dse_link_outage *outage = &links->config.outages[k];
        links->outages[k] = (struct dse_link_outage){.from = outage->from,
                                                     .to = outage->to,
                                                     .first = first_instant(outage->first, every),
                                                     .end = first_instant(outage->end, every)};
    }
    links->config.outages = links->outages;
    return true;
}

static bool open_lines(struct lossy_link *links, int to, const int *sizes, struct error *error)
{
    struct dse_arena arena;
    const int D = links->config.max_delay, nodes = links->config.nodes;
    int reals = 0;
    for (int j = 0; j < nodes; j++)
        reals += DSE_LINE_STORAGE(D, sizes[j]);
    links->fate = calloc((size_t)nodes + 1, sizeof *links->fate);
    links->line = calloc((size_t)nodes + 1, sizeof *links->line);
    links->memory = calloc((size_t)reals + 1, sizeof *links->memory);
    if (links->fate == NULL || links->line == NULL || links->memory == NULL)
        return error_set(error, "out of memory");
    dse_arena_init(&arena, links->memory, reals);
    for (int j = 0; j < nodes; j++)
        if (dse_link_init(&links->fate[j], &links->config, to, j) != DSE_OK ||
            dse_line_init(&links->line[j], D, sizes[j], &arena) != DSE_OK)
            return error_set(error, "the network's delays and losses cannot be set up");
    return true;
}

/* After the end of a recorded network everything would come at once: a run that goes on behind it
 * is a mistake. */
static bool recording_is_long_enough(const struct method_setup *setup, int64_t every,
                                     struct error *error)
{
    const struct dse_link_config *link = setup->link;
    const int64_t instants = first_instant(scenario_samples(setup->scenario), every);
    if (link->table == NULL || link->stamps >= instants)
        return true;
    return error_set(error,
                     "%s: networks.%s.link.file: %s ends at stamp %d, but the run has %lld "
                     "communication instants",
                     setup->scenario->file, setup->network->name, setup->network->link->file,
                     link->stamps - 1, (long long)instants);
}

struct lossy_link *lossy_link_create(const struct method_setup *setup, const int *sizes,
                                     int64_t every, struct error *error)
{
    if (!recording_is_long_enough(setup, every, error))
        return NULL;
    struct lossy_link *links = calloc(1, sizeof *links);
    if (links == NULL) {
        error_set(error, "out of memory");
        return NULL;
    }
    links->config = *setup->link;
    if (!count_in_instants(links, every, error) || !open_lines(links, setup->node, sizes, error)) {
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
