/* The network that an experiment asks for (networks[].link), at the receiver: messages of the other
 * nodes are held back or dropped as dse/link.h says, from the scenario's seed or from a recorded
 * network. What a node hears on the bus it hears for certain; what its estimator hears goes through
 * here. So the same trouble comes in every way of running a scenario, and networks of one scenario
 * share it.
 *
 * Two kinds, by how a method talks. lossy_link: once every so many samples, and what comes late is
 * of use. lossy_rounds: in rounds of a sample that is gone when a message is late. */
#ifndef DSE_METHODS_LOSSY_LINK_H
#define DSE_METHODS_LOSSY_LINK_H

#include "dse/link.h"
#include "methods/method.h"

/* ---- by communication instants ---- */

/* All that comes to one node. */
struct lossy_link;

/* For setup->node; setup->link is given. sizes: reals in the packets of each node of the network.
 * every: samples between communication instants; stamps count the latter, and so do D, T_m and a
 * recorded network, which has to cover the run. NULL and an error text on failure. */
struct lossy_link *lossy_link_create(const struct method_setup *setup, const int *sizes,
                                     int64_t every, struct error *error);
/* links may be NULL. */
void lossy_link_destroy(struct lossy_link *links);
/* Packet of node `from` with this stamp goes its way. Stamps of a node ascend. */
void lossy_link_put(struct lossy_link *links, int from, int64_t stamp, const dse_real *value);
/* The oldest packet of `from` that has arrived at instant `now`, or NULL. */
const dse_real *lossy_link_take(struct lossy_link *links, int from, int64_t now, int64_t *stamp);

/* ---- by rounds ---- */

/* What becomes of the messages that come to one node. */
struct lossy_rounds;

/* For setup->node; setup->link is given. D must be 0: a late message is a lost one. Stamps of a
 * recorded network are samples, and its row decides on all rounds of a sample. NULL and an error
 * text on failure. */
struct lossy_rounds *lossy_rounds_create(const struct method_setup *setup, struct error *error);
/* rounds may be NULL. */
void lossy_rounds_destroy(struct lossy_rounds *rounds);
/* Whether what `from` said in this round is lost. To be asked once for every message that is heard,
 * in the order in which they were said: the answers follow from the seed and these questions. */
bool lossy_rounds_lost(struct lossy_rounds *rounds, int from, int64_t sample, int round);

#endif
