/* A node of coordinated moving horizon estimation: an agent (coordinated_mhe_agent.c) or the
 * coordinator (coordinated_mhe_coordinator.c), made in coordinated_mhe_create.c.
 *
 * In even rounds the coordinator speaks: one message with what it has to say to each agent, and
 * whether it is the last one of this sample. In odd rounds the agents answer. An agent that is not
 * with the coordinator in this sample says so by an empty message, once. */
#ifndef DSE_METHODS_COORDINATED_MHE_NODE_H
#define DSE_METHODS_COORDINATED_MHE_NODE_H

#include "dse/coordinated_mhe.h"
#include "methods/coordinated_mhe_plant.h"
#include "methods/coordinated_mhe_section.h"
#include "methods/lossy_link.h"
#include "methods/method.h"

enum coordinated_mhe_agent_diagnostic {
    COORDINATED_MHE_AGENT_ITERATIONS,
    COORDINATED_MHE_AGENT_STATUS,
    COORDINATED_MHE_AGENT_CERTIFICATE,
    COORDINATED_MHE_AGENT_SENT,
    COORDINATED_MHE_AGENT_ACTIVE,
    COORDINATED_MHE_AGENT_DIAGNOSTICS
};
enum coordinated_mhe_coordinator_diagnostic {
    COORDINATED_MHE_ITERATIONS,
    COORDINATED_MHE_OUTCOME,
    COORDINATED_MHE_ERROR,
    COORDINATED_MHE_UPLINKS,
    COORDINATED_MHE_HEARD,
    COORDINATED_MHE_DIAGNOSTICS
};

/* Of an agent's answers, as the coordinator sees them. */
struct coordinated_mhe_answer {
    bool present;  /* the agent is with the coordinator in this sample */
    bool said;     /* something came in this round, */
    bool received; /* and the coordinator could use it */
};

struct coordinated_mhe_node {
    const struct coordinated_mhe_section *section;
    struct coordinated_mhe_plant plant;
    struct dse_mhe_settings settings;
    struct dse_mhe_subsystem *subsystems; /* plant.parts */
    struct dse_mhe_local_config local_config;
    struct dse_mhe_coordinator_config coordinator_config;
    dse_real *numbers; /* what the configuration points to */
    struct dse_mhe_local local;
    struct dse_mhe_coordinator coordinator;
    struct dse_arena arena; /* of either */
    dse_real *memory;
    dse_real *message; /* one message up or down */
    dse_real *measured;
    dse_real *P;                 /* of the agent's covariance */
    struct lossy_rounds *losses; /* NULL: what is said is heard */
    double patience_s;
    int part; /* of an agent */
    int64_t k;

    bool heard;                             /* agent: the coordinator, in this round */
    bool last;                              /* its message was the last one of this sample */
    bool ended;                             /* nothing more to say in this sample */
    int64_t sent;                           /* agent: answers with data so far */
    struct coordinated_mhe_answer *answers; /* plant.parts */
};

/* As in struct method. */
void *coordinated_mhe_create(const struct method_setup *setup, struct method_info *info,
                             struct error *error);
void coordinated_mhe_destroy(void *self);

/* Fills the configurations of a node whose plant is made (coordinated_mhe_config.c). */
bool coordinated_mhe_configure(struct coordinated_mhe_node *node, const struct method_setup *setup,
                               struct error *error);
/* Whether it is the coordinator. */
bool coordinated_mhe_coordinates(const struct coordinated_mhe_node *node);

/* The functions of a node by what it is. */
struct coordinated_mhe_role {
    enum dse_status (*begin)(struct coordinated_mhe_node *node, const struct method_sample *sample);
    enum method_step (*next)(struct coordinated_mhe_node *node, int round, struct method_plan *plan,
                             struct method_message *message);
    enum dse_status (*receive)(struct coordinated_mhe_node *node, int round, int from,
                               const struct method_message *message);
    enum dse_status (*finish)(struct coordinated_mhe_node *node, struct method_estimate *estimate);
};
extern const struct coordinated_mhe_role coordinated_mhe_agent;
extern const struct coordinated_mhe_role coordinated_mhe_coordinator;

#endif
