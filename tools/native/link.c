/* The fates of packets for the Python tools: the functions with which agents put delays and losses
 * in (tools/dse/link.py). */
#include "dse/link.h"

/* Delays of the packets with stamps 0 .. stamps-1 from `from` to `to`, DSE_LINK_LOST where they are
 * lost. table: nodes x nodes x recorded, NULL: random. outages: from, to, first, end in stamps, one
 * after the other. A dse_status. */
int link_fates(int max_delay, int max_losses, double loss, uint64_t seed, const int16_t *table,
               int nodes, int recorded, const int64_t *outages, int n_outages, int to, int from,
               int stamps, int16_t *delay);

#define MOST_OUTAGES 1000

int link_fates(int max_delay, int max_losses, double loss, uint64_t seed, const int16_t *table,
               int nodes, int recorded, const int64_t *outages, int n_outages, int to, int from,
               int stamps, int16_t *delay)
{
    struct dse_link_outage out[MOST_OUTAGES];
    struct dse_link link;
    if (n_outages < 0 || n_outages > MOST_OUTAGES) {
        return DSE_EINVAL;
    }
    for (int k = 0; k < n_outages; k++) {
        out[k] = (struct dse_link_outage){.from = (int)outages[4 * k],
                                          .to = (int)outages[4 * k + 1],
                                          .first = outages[4 * k + 2],
                                          .end = outages[4 * k + 3]};
    }
    const struct dse_link_config config = {.max_delay = max_delay,
                                           .max_losses = max_losses,
                                           .loss = loss,
                                           .seed = seed,
                                           .table = table,
                                           .nodes = nodes,
                                           .stamps = recorded,
                                           .outages = out,
                                           .n_outages = n_outages};
    const enum dse_status status = dse_link_init(&link, &config, to, from);
    for (int s = 0; status == DSE_OK && s < stamps; s++) {
        delay[s] = (int16_t)dse_link_fate(&link, s);
    }
    return status;
}
