/* What the runtime knows of an estimation method: an adapter between scenario and messages on one
 * side and a libdse object on the other.
 *
 * A node passes through each sample like this:
 *
 * - begin(sample);
 * - for round = 0, 1, ..: next(round, plan, message). METHOD_ROUND: `message` is said, then
 *   receive(round, from, message) is called for every node of the plan, in its order.
 *   METHOD_DONE: there is no further round;
 * - finish(estimate).
 *
 * next() closes the round before it. A node whose message did not come before a deadline is left
 * out of the receive calls: the method predicts instead. Rounds need no fixed number: a coordinated
 * method ends when its coordinator says so. A coordinator is a node like the others, with the last
 * index of its network and without sensors. Where a node is heard by others but hears none of them,
 * it may run at most 32 rounds ahead of them: older messages cannot be asked for any more.
 *
 * To add a method: one folder or file here that defines a `const struct method`, one line in
 * registry.c. */
#ifndef DSE_METHOD_H
#define DSE_METHOD_H

#include <stdbool.h>
#include <stdint.h>

#include "dse/health.h"
#include "dse/link.h"
#include "dse/plant.h"
#include "runtime/error.h"
#include "runtime/scenario.h"

#define METHOD_MESSAGE_CAPACITY     2048 /* values of a node's message in one round: 64 parts */
#define METHOD_MAX_NODES            1024 /* nodes of a network */
#define METHOD_MAX_FRAMES           (2 * METHOD_MAX_NODES)
#define METHOD_DIAGNOSTICS_CAPACITY 16

struct method_signal {
    char name[32];
    char unit[32];
};

/* A message of a neighbour and how many of its values are meant for this node. */
struct method_frame {
    int from;
    int values;
};

/* What a node is; filled by create. */
struct method_info {
    char name[64];                     /* "reactor 1" */
    int n_states;                      /* estimated plant states, ... */
    int states[DSE_PLANT_MAX_STATES];  /* ... their indices in the plant's state */
    int n_groups;                      /* sensor groups (subsystems) read, ... */
    int groups[DSE_PLANT_MAX_OUTPUTS]; /* ... in the order in which their y are stacked */
    int n_neighbours;                  /* nodes it hears, ascending: each may be awaited */
    int neighbours[METHOD_MAX_NODES];
    int n_listeners; /* nodes that hear it, ascending */
    int listeners[METHOD_MAX_NODES];
    int every; /* samples between its communication instants, in which a link counts delays; 0: 1 */
    int n_diagnostics;
    struct method_signal diagnostics[METHOD_DIAGNOSTICS_CAPACITY];
    int64_t storage_bytes; /* memory of the libdse object */
    /* What it takes from whom in an ordinary sample, message by message; none: not told. For what
     * communication would cost over links that carry one receiver's values each: on the bus a
     * message is said once for all who listen. */
    int n_frames;
    struct method_frame frames[METHOD_MAX_FRAMES];
};

struct method_sample {
    int64_t k;
    double t;          /* t_k in the plant's time unit */
    const double *u;   /* nu known inputs, held until t_{k+1} */
    const double *y;   /* outputs of the node's groups, stacked */
    const bool *valid; /* which of them may be used */
};

struct method_message {
    bool withheld; /* the node keeps silent in this round (trigger): says only that it is alive */
    int count;     /* <= METHOD_MESSAGE_CAPACITY */
    double *value;
};

/* Whom to wait for in a round. Set by the runtime to all neighbours without end before next(); the
 * method may shorten it. */
struct method_plan {
    bool speak;        /* say the message; false: only listen */
    double patience_s; /* close the round after this without those who are missing: for a neighbour
                        * that a method can do without, like a coordinator that may be gone; it is
                        * not waited for again until it has said something. 0: as the pace says
                        * (lockstep waits until the run is given up) */
    int n_wait;
    int wait[METHOD_MAX_NODES]; /* ascending subset of the neighbours */
};

enum method_step { METHOD_ROUND, METHOD_DONE };

struct method_estimate {
    enum dse_health health;
    double state[DSE_PLANT_MAX_STATES];    /* n_states, physical units */
    double variance[DSE_PLANT_MAX_STATES]; /* n_states; NAN where the method has none */
    double diagnostic[METHOD_DIAGNOSTICS_CAPACITY];
};

/* A network's graph. Node i hears in[in_first[i]] .. in[in_first[i + 1] - 1] and is heard by
 * out[out_first[i]] .. out[out_first[i + 1] - 1], ascending. */
struct method_graph {
    int nodes;
    const int *in_first; /* nodes + 1 */
    const int *in;
    const int *out_first; /* nodes + 1 */
    const int *out;
};

/* What create gets to know. */
struct method_setup {
    const struct scenario *scenario;
    const struct scenario_network *network;
    const void *section; /* the network's section for this method, of section_size bytes */
    const struct method_graph *graph;   /* networks[].graph; NULL: the scenario gives none. A method
                                         * that has no use for a graph refuses one */
    const struct dse_link_config *link; /* networks[].link for all pairs, with outages counted in
                                         * samples; NULL: nothing is late or lost. What is sent on
                                         * the bus arrives: the method puts delays and losses in
                                         * where it receives, see methods/lossy_link.h */
    const struct dse_plant *process;    /* scenario->process */
    const dse_real *prepared;           /* the estimators' own plant constants; outlive the node */
    double period;                      /* in the plant's time unit */
    int node;
};

struct method {
    const char *name;                   /* key of its section in a scenario: "high_gain_ekf" */
    const char *title;                  /* "distributed adaptive high-gain EKF" */
    const cyaml_schema_field_t *fields; /* schema of the section, ends with CYAML_FIELD_END */
    unsigned section_size;              /* sizeof of the structure that the fields fill */
    const struct scenario_rule *rules;  /* limits of its numbers, ends with key NULL */
    bool uses_link;                     /* it honours setup->link; false: a scenario with a link
                                         * is refused */

    /* Number of nodes, the coordinator included. */
    int (*nodes)(const struct method_setup *setup);
    /* True when the network's last node is a coordinator. NULL: none has one. */
    bool (*has_coordinator)(const struct method_setup *setup);
    /* Makes the node and describes it. NULL and an error text when the section does not fit the
     * plant. All memory is taken here; the other functions allocate nothing. */
    void *(*create)(const struct method_setup *setup, struct method_info *info,
                    struct error *error);
    void (*destroy)(void *node);

    /* A failing status is reported and counted; the node goes on with the next sample and says in
     * its estimate's health what it is worth. */
    enum dse_status (*begin)(void *node, const struct method_sample *sample);
    enum method_step (*next)(void *node, int round, struct method_plan *plan,
                             struct method_message *message);
    enum dse_status (*receive)(void *node, int round, int from,
                               const struct method_message *message);
    enum dse_status (*finish)(void *node, struct method_estimate *estimate);
};

/* The i-th registered method, NULL past the last. */
const struct method *method_at(int i);
/* The method called `name`, or NULL. */
const struct method *method_find(const char *name);

#endif
