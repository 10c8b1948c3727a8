/* Losses at the receiver, by rounds. */
#include <stdlib.h>

#include "methods/lossy_link.h"

struct lossy_rounds {
    int nodes;
    struct dse_link *link; /* nodes */
};

void lossy_rounds_destroy(struct lossy_rounds *rounds)
{
    if (rounds == NULL)
        return;
    free(rounds->link);
    free(rounds);
}

static bool link_fits(const struct method_setup *setup, struct error *error)
{
    const struct dse_link_config *link = setup->link;
    const char *file = setup->scenario->file, *network = setup->network->name;
    const int64_t samples = scenario_samples(setup->scenario);
    if (link->max_delay > 0)
        return error_set(error,
                         "%s: networks.%s.link.D: must be 0: a message that is late is of no use "
                         "to the method, which talks in rounds; make it a loss",
                         file, network);
    if (link->table != NULL && link->stamps < samples)
        return error_set(error,
                         "%s: networks.%s.link.file: %s ends at stamp %d, but the run has %lld "
                         "samples",
                         file, network, setup->network->link->file, link->stamps - 1,
                         (long long)samples);
    return true;
}

struct lossy_rounds *lossy_rounds_create(const struct method_setup *setup, struct error *error)
{
    if (!link_fits(setup, error))
        return NULL;
    struct lossy_rounds *rounds = calloc(1, sizeof *rounds);
    const int nodes = setup->link->nodes;
    if (rounds != NULL)
        rounds->link = calloc((size_t)nodes + 1, sizeof *rounds->link);
    bool good = rounds != NULL && rounds->link != NULL;
    if (good)
        rounds->nodes = nodes;
    for (int j = 0; good && j < nodes; j++)
        good = dse_link_init(&rounds->link[j], setup->link, setup->node, j) == DSE_OK;
    if (good)
        return rounds;
    lossy_rounds_destroy(rounds);
    error_set(error, "the network's losses cannot be set up");
    return NULL;
}

bool lossy_rounds_lost(struct lossy_rounds *rounds, int from, int64_t sample, int round)
{
    return from < 0 || from >= rounds->nodes || dse_link_lost(&rounds->link[from], sample, round);
}
