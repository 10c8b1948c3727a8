/* Watches the estimates of a replay and compares them bit for bit with the recorded ones. */
#ifndef DSE_RUN_COMPARE_H
#define DSE_RUN_COMPARE_H

#include "run/recorded.h"
#include "runtime/bus.h"

struct compare_node {
    int64_t equal;
    int64_t different;
    int64_t unknown;          /* not in the recorded log */
    int64_t first_difference; /* sample, -1 */
    double largest;           /* largest difference of a state */
};

struct compare {
    const struct recorded *recorded;
    struct compare_node *nodes; /* one per recorded->estimates */
};

/* NULL and an error text on failure. Frees nothing of `recorded`. */
struct compare *compare_start(const struct recorded *recorded, struct bus *bus,
                              struct error *error);
/* Prints a line per node; true when every recorded estimate was met bit for bit. */
bool compare_report(const struct compare *compare, const struct scenario *scenario);
void compare_free(struct compare *compare);

#endif
