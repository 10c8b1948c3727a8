/* A node on a graph of sensors whose filter estimates the whole state of the plant and talks to its
 * neighbours in rounds: what the consensus Kalman filters and the distributed second-order filters
 * have in common. Without a network there is one node per sensor group alone, or one for all groups
 * (central), to compare with. */
#ifndef DSE_METHODS_SENSOR_NODE_H
#define DSE_METHODS_SENSOR_NODE_H

#include "dse/arena.h"
#include "methods/lossy_link.h"
#include "methods/sensor_network.h"

/* ---- the keys that their sections have in common ---- */

struct sensor_node_keys {
    unsigned *sensors; /* one per node, NULL: node i reads group i */
    unsigned sensors_count;
    double *guesses; /* nodes x nx, NULL: networks[].guess for all */
    unsigned guesses_count;
    double *P0; /* nx, NULL: identity */
    unsigned P0_count;
    double *Q; /* nx, NULL: none */
    unsigned Q_count;
    double *R; /* ny */
    unsigned R_count;
    double epsilon, alpha;
    unsigned rounds, skip;
};

extern const cyaml_schema_value_t sensor_node_number, sensor_node_whole;

/* Fields of a section with `struct sensor_node_keys keys`, and their rules. */
#define SENSOR_NODE_LIST(section, key, flags)                                                      \
    CYAML_FIELD_SEQUENCE(#key, CYAML_FLAG_POINTER | (flags), section, keys.key,                    \
                         &sensor_node_number, 1, 100000)
#define SENSOR_NODE_FIELDS(section)                                                                \
    CYAML_FIELD_SEQUENCE("sensors", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, section,             \
                         keys.sensors, &sensor_node_whole, 1, METHOD_MAX_NODES),                   \
        SENSOR_NODE_LIST(section, guesses, CYAML_FLAG_OPTIONAL),                                   \
        SENSOR_NODE_LIST(section, P0, CYAML_FLAG_OPTIONAL),                                        \
        SENSOR_NODE_LIST(section, Q, CYAML_FLAG_OPTIONAL),                                         \
        SENSOR_NODE_LIST(section, R, CYAML_FLAG_DEFAULT),                                          \
        CYAML_FIELD_FLOAT("epsilon", CYAML_FLAG_OPTIONAL, section, keys.epsilon),                  \
        CYAML_FIELD_FLOAT("alpha", CYAML_FLAG_OPTIONAL, section, keys.alpha),                      \
        CYAML_FIELD_UINT("rounds", CYAML_FLAG_OPTIONAL, section, keys.rounds),                     \
        CYAML_FIELD_UINT("skip", CYAML_FLAG_OPTIONAL, section, keys.skip)

/* clang-format off */
#define SENSOR_NODE_RULES(q_meaning)                                                               \
    {.key = "sensors",                                                                             \
     SCENARIO_ANY,                                                                                 \
     .absent = "node i reads group i",                                                             \
     .meaning = "the sensor group that each node reads, from 0; central: all that it reads"},      \
    {.key = "guesses",                                                                             \
     SCENARIO_ANY,                                                                                 \
     .absent = "networks[].guess for all",                                                         \
     .meaning = "initial estimates of node 0, 1, .. in turn; central: their mean"},                \
    {.key = "P0",                                                                                  \
     SCENARIO_AT_LEAST(0),                                                                         \
     .count = SCENARIO_PER_STATE,                                                                  \
     .absent = "identity",                                                                         \
     .meaning = "diagonal of the covariance of each guess"},                                       \
    {.key = "Q",                                                                                   \
     SCENARIO_AT_LEAST(0),                                                                         \
     .count = SCENARIO_PER_STATE,                                                                  \
     .absent = "none",                                                                             \
     .meaning = (q_meaning)},                                                                      \
    {.key = "R",                                                                                   \
     SCENARIO_ABOVE(0),                                                                            \
     .count = SCENARIO_PER_OUTPUT,                                                                 \
     .meaning = "variance of each output's noise"},                                                \
    {.key = "alpha",                                                                               \
     SCENARIO_ABOVE(0),                                                                            \
     .absent = "1",                                                                                \
     .meaning = "speed of a band-pass filter's low-pass part"},                                    \
    {.key = "skip",                                                                                \
     .min = 0,                                                                                     \
     .max = 1000000,                                                                               \
     .absent = "0",                                                                                \
     .meaning = "samples let pass at the start, without measurement and exchange"}
/* clang-format on */

/* ---- the node ---- */

/* The filter behind it: its functions of the same names. */
struct sensor_node_filter {
    int (*rounds)(const void *filter);
    int (*message_size)(const void *filter, int round);
    int (*message)(const void *filter, dse_real *message);
    enum dse_status (*receive)(void *filter, int neighbour, const dse_real *message, int count);
    enum dse_status (*end_round)(void *filter);
};

struct sensor_node {
    const struct sensor_node_keys *keys;
    const struct sensor_node_filter *kind;
    void *filter;
    struct dse_model model;
    int nx, ny;                         /* ny: of its own sensors */
    int outputs[DSE_PLANT_MAX_OUTPUTS]; /* the plant's, stacked */
    int n_neighbours, n_listeners;
    int *neighbours;
    int nodes, largest_degree; /* of the network */
    struct dse_arena arena;
    dse_real *memory;
    /* What the filter's configuration points to. */
    dse_real *C, *R, *P0, *Q, *x0; /* Q NULL: none */
    struct lossy_rounds *links;    /* NULL: what is said is heard */
    int64_t k;
    bool idle;              /* this sample is let pass */
    enum dse_status failed; /* the first failure of the rounds of this sample */
};

/* Who is alone and who is central. */
struct sensor_node_place {
    bool alone;   /* hears nobody */
    bool central; /* one node with all sensors */
};

int sensor_node_nodes(const struct method_setup *setup, const struct sensor_node_keys *keys,
                      struct sensor_node_place place);
/* Combinations of keys that no limit on a single number covers. */
bool sensor_node_check(const struct method_setup *setup, const struct sensor_node_keys *keys,
                       struct sensor_node_place place, struct error *error);
/* Fills a node that is all zero, with memory for the above and for the `storage` reals of its
 * filter, which are next in its arena; and what the runtime gets to know of all but the filter. */
bool sensor_node_open(struct sensor_node *node, const struct method_setup *setup,
                      const struct sensor_node_keys *keys, struct sensor_node_place place,
                      struct method_info *info, struct error *error);
bool sensor_node_take_memory(struct sensor_node *node, const struct method_setup *setup,
                             int storage, struct error *error);
/* What is said and how much memory there is, once the filter stands. */
void sensor_node_describe(const struct sensor_node *node, size_t filter_bytes,
                          struct method_info *info);
void sensor_node_close(struct sensor_node *node);

/* ---- a sample ---- */

/* False: it is let pass. */
bool sensor_node_begin(struct sensor_node *node, const struct method_sample *sample);
enum method_step sensor_node_next(struct sensor_node *node, int round, struct method_plan *plan,
                                  struct method_message *message);
/* One fate per sample and directed link: all rounds of a sample are heard or none. */
enum dse_status sensor_node_receive(struct sensor_node *node, int from,
                                    const struct method_message *message);
/* State and variances. */
void sensor_node_estimate(const struct sensor_node *node, const dse_real *x, const dse_real *P,
                          struct method_estimate *estimate);

#endif
