/* The fate of the packets of one ordered pair, from a seed or from a recorded table. */
#include <stddef.h>

#include "dse/link.h"

enum dse_status dse_link_init(struct dse_link *link, const struct dse_link_config *config, int to,
                              int from)
{
    if (link == NULL || config == NULL || to < 0 || from < 0 || config->max_delay < 0) {
        return DSE_EINVAL;
    }
    if (config->table != NULL) {
        if (config->stamps < 0 || to >= config->nodes || from >= config->nodes) {
            return DSE_EINVAL;
        }
    } else if (config->max_losses < 0 || !(config->loss >= 0 && config->loss <= 1)) {
        return DSE_EINVAL;
    }
    *link = (struct dse_link){.config = config, .to = to, .from = from};
    /* streams of their own, apart from those of the noise */
    dse_random_init(&link->random, config->seed,
                    UINT64_C(1) << 63 | (uint64_t)to << 32 | (uint32_t)from);
    return DSE_OK;
}

static int recorded(const struct dse_link *link, int64_t stamp)
{
    const struct dse_link_config *config = link->config;
    if (stamp >= config->stamps) {
        return 0;
    }
    const int pair = link->to * config->nodes + link->from;
    const int delay = config->table[(int64_t)pair * config->stamps + stamp];
    return delay < 0 || delay > config->max_delay ? DSE_LINK_LOST : delay;
}

static int drawn(struct dse_link *link, int64_t stamp)
{
    const struct dse_link_config *config = link->config;
    const double chance = dse_random_uniform(&link->random);
    const double share = dse_random_uniform(&link->random);
    if (stamp == 0) {
        return 0;
    }
    if (link->losses < config->max_losses && chance < config->loss) {
        link->losses++;
        return DSE_LINK_LOST;
    }
    link->losses = 0;
    return (int)(share * (config->max_delay + 1));
}

int dse_link_fate(struct dse_link *link, int64_t stamp)
{
    int fate = DSE_LINK_LOST;
    if (stamp < link->next) {
        return DSE_LINK_LOST;
    }
    if (link->config->table != NULL) {
        link->next = stamp + 1;
        return recorded(link, stamp);
    }
    while (link->next <= stamp) {
        fate = drawn(link, link->next++);
    }
    return fate;
}

int dse_link_next_number(int number)
{
    return (number + 1) % DSE_LINK_NUMBERS;
}

int dse_link_unheard(int last, int number)
{
    return (number - last + DSE_LINK_NUMBERS) % DSE_LINK_NUMBERS;
}
