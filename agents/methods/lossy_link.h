/* The network that an experiment asks for, at the receiver: packets of the neighbours are held back
 * or dropped as dse/link.h says, from the scenario's seed or from a recorded network. What a node
 * hears on the bus it hears for certain; what its estimator hears goes through here. So the same
 * trouble comes in every way of running a scenario, and networks of one scenario share it. */
#ifndef DSE_METHODS_LOSSY_LINK_H
#define DSE_METHODS_LOSSY_LINK_H

#include "dse/link.h"
#include "methods/method.h"

#define LOSSY_LINK_MAX_DELAY 100

/* The keys under which a method's section names its network. */
struct lossy_link_section {
    unsigned D;    /* largest delay in communication periods */
    unsigned T_m;  /* most consecutive losses */
    double loss;   /* probability */
    uint64_t seed; /* added to the scenario's */
    char *file;    /* recorded network, NULL: random */
};

extern const cyaml_schema_field_t lossy_link_fields[];

/* NOLINTBEGIN(bugprone-macro-parentheses): the prefix is a literal that joins its neighbours */
/* Rules for the method's table; prefix: the path of the mapping in its section. */
#define LOSSY_LINK_RULES(prefix)                                                                   \
    {.key = prefix,                                                                                \
     SCENARIO_ANY,                                                                                 \
     .absent = "nothing is late or lost",                                                          \
     .meaning = "delays and losses of the network, put in at the receivers"},                      \
        {.key = prefix ".D",                                                                       \
         .min = 0,                                                                                 \
         .max = LOSSY_LINK_MAX_DELAY,                                                              \
         .meaning = "largest delay, in communication periods; what comes later is lost"},          \
        {.key = prefix ".T_m",                                                                     \
         .min = 0,                                                                                 \
         .max = 1000000,                                                                           \
         .absent = "0",                                                                            \
         .meaning = "most consecutive losses of one sender and receiver"},                         \
        {.key = prefix ".loss",                                                                    \
         .min = 0,                                                                                 \
         .max = 1,                                                                                 \
         .absent = "0",                                                                            \
         .meaning = "probability that a packet is lost, where T_m allows it"},                     \
        {.key = prefix ".seed",                                                                    \
         SCENARIO_ANY,                                                                             \
         .absent = "0",                                                                            \
         .meaning = "added to the scenario's seed: other delays with the same noise"},             \
    {                                                                                              \
        .key = prefix ".file", SCENARIO_ANY, .absent = "random",                                   \
        .meaning = "recorded network, a CSV beside the scenario: to,from,stamp,delay"              \
    }

/* NOLINTEND(bugprone-macro-parentheses) */

/* All that comes to one node. */
struct lossy_link;

/* instants: communication instants of the run, which a recorded network has to cover. sizes: reals
 * in the packets of each of the `nodes`. NULL and an error text on failure. */
struct lossy_link *lossy_link_create(const struct lossy_link_section *section,
                                     const struct method_setup *setup, int nodes, const int *sizes,
                                     int64_t instants, struct error *error);
void lossy_link_destroy(struct lossy_link *links);
/* Packet of node `from` with this stamp goes its way. Stamps of a node ascend. */
void lossy_link_put(struct lossy_link *links, int from, int64_t stamp, const dse_real *value);
/* The oldest packet of `from` that has arrived at instant `now`, or NULL. */
const dse_real *lossy_link_take(struct lossy_link *links, int from, int64_t now, int64_t *stamp);

#endif
