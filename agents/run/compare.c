/* Bit-for-bit comparison of a replay with its record. */
#include "run/compare.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/messages.h"

static void compare_part(struct compare *compare, const dse_estimate_t *message)
{
    const struct recorded *recorded = compare->recorded;
    const struct recorded_estimates *estimates =
        recorded_estimates_of(recorded, message->header.network, message->header.node);
    int64_t k = message->header.sample;
    if (estimates == NULL || k < 0 || k >= recorded->info.samples)
        return;
    struct compare_node *node = &compare->nodes[estimates - recorded->estimates];
    int offset = message->part * DSE_ESTIMATE_T_CAPACITY;
    if (estimates->have[k] == 0 || offset + message->count > estimates->n_states) {
        node->unknown++;
        return;
    }
    const double *row = estimates->values + k * 2 * estimates->n_states;
    size_t bytes = (size_t)message->count * sizeof(double);
    bool equal = memcmp(row + offset, message->state, bytes) == 0 &&
                 memcmp(row + estimates->n_states + offset, message->variance, bytes) == 0;
    node->equal += equal;
    if (equal)
        return;
    node->different++;
    if (node->first_difference < 0)
        node->first_difference = k;
    for (int i = 0; i < message->count; i++)
        node->largest = fmax(node->largest, fabs(row[offset + i] - message->state[i]));
}

static void on_estimate(void *user, const char *channel, const uint8_t *bytes, int length)
{
    (void)channel;
    struct message_counters counters = {0};
    dse_estimate_t message;
    if (message_estimate(bytes, length, &counters, &message))
        compare_part(user, &message);
}

struct compare *compare_start(const struct recorded *recorded, struct bus *bus, struct error *error)
{
    struct compare *compare = calloc(1, sizeof *compare);
    if (compare != NULL)
        compare->nodes = calloc((size_t)recorded->n_estimates + 1, sizeof *compare->nodes);
    if (compare == NULL || compare->nodes == NULL ||
        !bus_subscribe(bus, "DSE_ESTIMATE_.*", on_estimate, compare, error)) {
        error_set(error, "out of memory");
        compare_free(compare);
        return NULL;
    }
    compare->recorded = recorded;
    for (int i = 0; i < recorded->n_estimates; i++)
        compare->nodes[i].first_difference = -1;
    return compare;
}

bool compare_report(const struct compare *compare, const struct scenario *scenario)
{
    bool all = true;
    for (int i = 0; i < compare->recorded->n_estimates; i++) {
        const struct recorded_estimates *estimates = &compare->recorded->estimates[i];
        const struct compare_node *node = &compare->nodes[i];
        const char *network = estimates->network < (int)scenario->networks_count
                                  ? scenario->networks[estimates->network].name
                                  : "?";
        if (node->different == 0 && node->equal >= estimates->samples) {
            printf("  %s node %d: all %lld estimates equal the recorded ones bit for bit\n",
                   network, estimates->node, (long long)node->equal);
            continue;
        }
        all = false;
        printf("  %s node %d: %lld of %lld estimates differ from the record", network,
               estimates->node, (long long)node->different, (long long)estimates->samples);
        if (node->first_difference >= 0)
            printf(", first at sample %lld, by up to %g", (long long)node->first_difference,
                   node->largest);
        printf("\n");
    }
    return all;
}

void compare_free(struct compare *compare)
{
    if (compare == NULL)
        return;
    free(compare->nodes);
    free(compare);
}
