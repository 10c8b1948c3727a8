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
    if (config->n_outages < 0 || (config->n_outages > 0 && config->outages == NULL)) {
        return DSE_EINVAL;
    }
    const uint64_t pair = (uint64_t)to << 32 | (uint32_t)from;
    struct dse_random keys;
    *link = (struct dse_link){.config = config, .to = to, .from = from, .round = -1};
    /* streams of their own, apart from those of the noise */
    dse_random_init(&link->random, config->seed, UINT64_C(1) << 63 | pair);
    dse_random_init(&keys, config->seed, UINT64_C(3) << 62 | pair);
    link->key = dse_random_bits(&keys);
    return DSE_OK;
}

static bool is_out(const struct dse_link *link, int64_t stamp)
{
    for (int k = 0; k < link->config->n_outages; k++) {
        const struct dse_link_outage *outage = &link->config->outages[k];
        if ((outage->from < 0 || outage->from == link->from) &&
            (outage->to < 0 || outage->to == link->to) && stamp >= outage->first &&
            stamp < outage->end) {
            return true;
        }
    }
    return false;
}

/* A loss where chance, uniform on [0, 1), and T_m have it so. */
static bool is_lost(struct dse_link *link, double chance)
{
    const bool lost = link->losses < link->config->max_losses && chance < link->config->loss;
    link->losses = lost ? link->losses + 1 : 0;
    return lost;
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
    if (is_lost(link, chance)) {
        return DSE_LINK_LOST;
    }
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
        fate = recorded(link, stamp);
    }
    while (link->next <= stamp) {
        fate = drawn(link, link->next++);
    }
    return is_out(link, stamp) ? DSE_LINK_LOST : fate;
}

/* The message's own draw: seed and stream of a generator are spread one after the other, so that
 * (stamp, round) and (round, stamp) have nothing in common. */
static bool message_lost(struct dse_link *link, int64_t stamp, int round)
{
    struct dse_random random;
    if (link->config->table != NULL) {
        return recorded(link, stamp) != 0;
    }
    dse_random_init(&random, link->key + (uint64_t)stamp, (uint64_t)round);
    return is_lost(link, dse_random_uniform(&random));
}

bool dse_link_lost(struct dse_link *link, int64_t stamp, int round)
{
    const int64_t last = link->next - 1;
    if (stamp < 0 || round < 0 || stamp < last || (stamp == last && round < link->round)) {
        return true;
    }
    if (stamp == last && round == link->round) {
        return link->lost;
    }
    link->next = stamp + 1;
    link->round = round;
    link->lost = message_lost(link, stamp, round) || is_out(link, stamp);
    return link->lost;
}

int dse_link_next_number(int number)
{
    return (number + 1) % DSE_LINK_NUMBERS;
}

int dse_link_unheard(int last, int number)
{
    return (number - last + DSE_LINK_NUMBERS) % DSE_LINK_NUMBERS;
}
