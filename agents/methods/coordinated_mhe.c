/* Coordinated moving horizon estimation as a method: nodes 0 .. N-1 are the agents of the plant's
 * subsystems, the last node is the coordinator. Decentralised: no coordinator. Centralised: one
 * node. */
#include "methods/coordinated_mhe_node.h"

static bool has_coordinator(const struct method_setup *setup)
{
    return coordinated_mhe_is_coordinated(setup->section);
}

static int nodes(const struct method_setup *setup)
{
    const struct coordinated_mhe_section *section = setup->section;
    if (section->scheme == COORDINATED_MHE_CENTRALISED)
        return 1;
    return setup->process->n_subsystems + has_coordinator(setup);
}

static const struct coordinated_mhe_role *role_of(const struct coordinated_mhe_node *node)
{
    return coordinated_mhe_coordinates(node) ? &coordinated_mhe_coordinator
                                             : &coordinated_mhe_agent;
}

static enum dse_status begin(void *self, const struct method_sample *sample)
{
    struct coordinated_mhe_node *node = self;
    node->k = sample->k;
    node->ended = false;
    node->last = false;
    return role_of(node)->begin(node, sample);
}

static enum method_step next(void *self, int round, struct method_plan *plan,
                             struct method_message *message)
{
    struct coordinated_mhe_node *node = self;
    plan->patience_s = node->patience_s;
    return role_of(node)->next(node, round, plan, message);
}

static enum dse_status receive(void *self, int round, int from,
                               const struct method_message *message)
{
    return role_of(self)->receive(self, round, from, message);
}

static enum dse_status finish(void *self, struct method_estimate *estimate)
{
    return role_of(self)->finish(self, estimate);
}

const struct method coordinated_mhe_method = {
    .name = "coordinated_mhe",
    .title = "coordinated moving horizon estimation",
    .fields = coordinated_mhe_fields,
    .section_size = sizeof(struct coordinated_mhe_section),
    .rules = coordinated_mhe_rules,
    .uses_link = true,
    .nodes = nodes,
    .has_coordinator = has_coordinator,
    .create = coordinated_mhe_create,
    .destroy = coordinated_mhe_destroy,
    .begin = begin,
    .next = next,
    .receive = receive,
    .finish = finish,
};
