/* Making a node of coordinated moving horizon estimation from its section. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "methods/coordinated_mhe_node.h"

/* ---- the object ---- */

bool coordinated_mhe_coordinates(const struct coordinated_mhe_node *node)
{
    return node->part == node->plant.parts;
}

static int message_size(const struct coordinated_mhe_node *node, int i)
{
    const int N = (int)node->section->Hp;
    const struct dse_mhe_subsystem *subsystem = &node->subsystems[i];
    int up = DSE_MHE_UP_SIZE(subsystem->nx, subsystem->ny, N);
    int down = DSE_MHE_DOWN_SIZE(subsystem->nx, N);
    return up > down ? up : down;
}

static bool messages_fit(const struct coordinated_mhe_node *node, const struct method_setup *setup,
                         struct error *error)
{
    int all = 1;
    for (int i = 0; i < node->plant.parts; i++)
        all += 1 + message_size(node, i);
    if (!coordinated_mhe_is_coordinated(node->section) || all <= METHOD_MESSAGE_CAPACITY)
        return true;
    return error_set(
        error,
        "%s: networks.%s.coordinated_mhe.Hp: %u samples of %d states make a message of "
        "%d numbers; at most %d fit",
        setup->scenario->file, setup->network->name, node->section->Hp, node->plant.n, all,
        METHOD_MESSAGE_CAPACITY);
}

static bool take_buffers(struct coordinated_mhe_node *node)
{
    int size = 0;
    for (int i = 0; i < node->plant.parts; i++)
        size = message_size(node, i) > size ? message_size(node, i) : size;
    const size_t nx = (size_t)node->local_config.subsystem->nx;
    node->message = calloc((size_t)size + 1, sizeof *node->message);
    node->measured = calloc((size_t)node->plant.ny + 1, sizeof *node->measured);
    node->P = calloc(nx * nx, sizeof *node->P);
    node->answers = calloc((size_t)node->plant.parts, sizeof *node->answers);
    return node->message != NULL && node->measured != NULL && node->P != NULL &&
           node->answers != NULL;
}

static bool refuse(const struct coordinated_mhe_node *node, const struct method_setup *setup,
                   enum dse_status status, struct error *error)
{
    return error_set(error, "%s: networks.%s.coordinated_mhe: node %d cannot be set up: %s",
                     setup->scenario->file, setup->network->name, node->part,
                     dse_status_text(status));
}

static bool open_object(struct coordinated_mhe_node *node, const struct method_setup *setup,
                        struct error *error)
{
    bool coordinates = coordinated_mhe_coordinates(node);
    int storage = coordinates ? dse_mhe_coordinator_storage(&node->coordinator_config)
                              : dse_mhe_local_storage(&node->local_config);
    if (storage <= 0)
        return refuse(node, setup, DSE_EINVAL, error);
    node->memory = calloc((size_t)storage, sizeof *node->memory);
    if (node->memory == NULL || !take_buffers(node))
        return error_set(error, "out of memory");
    dse_arena_init(&node->arena, node->memory, storage);
    enum dse_status status =
        coordinates
            ? dse_mhe_coordinator_init(&node->coordinator, &node->coordinator_config, &node->arena)
            : dse_mhe_local_init(&node->local, &node->local_config, &node->arena);
    return status == DSE_OK || refuse(node, setup, status, error);
}

static bool open_losses(struct coordinated_mhe_node *node, const struct method_setup *setup,
                        struct error *error)
{
    if (setup->link == NULL || !coordinated_mhe_is_coordinated(node->section))
        return true;
    node->losses = lossy_rounds_create(setup, error);
    return node->losses != NULL;
}

/* ---- what the runtime gets to know ---- */

static void describe_agent(const struct coordinated_mhe_node *node,
                           const struct method_setup *setup, struct method_info *info)
{
    static const struct method_signal diagnostics[COORDINATED_MHE_AGENT_DIAGNOSTICS] = {
        [COORDINATED_MHE_AGENT_ITERATIONS] = {"iterations", ""},
        [COORDINATED_MHE_AGENT_STATUS] = {"status", ""},
        [COORDINATED_MHE_AGENT_CERTIFICATE] = {"certificate", ""},
        [COORDINATED_MHE_AGENT_SENT] = {"windows sent", ""},
        [COORDINATED_MHE_AGENT_ACTIVE] = {"active bounds", ""},
    };
    const struct coordinated_mhe_plant *plant = &node->plant;
    const struct dse_plant *process = setup->process;
    bool whole = node->section->scheme == COORDINATED_MHE_CENTRALISED;
    snprintf(info->name, sizeof info->name, "%s",
             whole ? process->title : process->subsystems[node->part].name);
    info->n_states = coordinated_mhe_plant_nx(plant, node->part);
    for (int s = 0; s < info->n_states; s++)
        info->states[s] = plant->state[plant->first_state[node->part] + s];
    info->n_groups = whole ? process->n_subsystems : 1;
    for (int g = 0; g < info->n_groups; g++)
        info->groups[g] = whole ? g : node->part;
    if (coordinated_mhe_is_coordinated(node->section)) {
        info->neighbours[info->n_neighbours++] = plant->parts;
        info->listeners[info->n_listeners++] = plant->parts;
    }
    info->n_diagnostics = COORDINATED_MHE_AGENT_DIAGNOSTICS;
    memcpy(info->diagnostics, diagnostics, sizeof diagnostics);
    info->storage_bytes = (int64_t)sizeof node->local;
}

static void describe_coordinator(const struct coordinated_mhe_node *node, struct method_info *info)
{
    static const struct method_signal diagnostics[COORDINATED_MHE_DIAGNOSTICS] = {
        [COORDINATED_MHE_ITERATIONS] = {"iterations", ""},
        [COORDINATED_MHE_OUTCOME] = {"outcome", ""},
        [COORDINATED_MHE_ERROR] = {"error", ""},
        [COORDINATED_MHE_UPLINKS] = {"windows received", ""},
        [COORDINATED_MHE_HEARD] = {"agents heard", ""},
    };
    snprintf(info->name, sizeof info->name, "coordinator");
    for (int i = 0; i < node->plant.parts; i++) {
        info->neighbours[info->n_neighbours++] = i;
        info->listeners[info->n_listeners++] = i;
    }
    info->n_diagnostics = COORDINATED_MHE_DIAGNOSTICS;
    memcpy(info->diagnostics, diagnostics, sizeof diagnostics);
    info->storage_bytes = (int64_t)sizeof node->coordinator;
}

static void describe(const struct coordinated_mhe_node *node, const struct method_setup *setup,
                     struct method_info *info)
{
    memset(info, 0, sizeof *info);
    if (coordinated_mhe_coordinates(node))
        describe_coordinator(node, info);
    else
        describe_agent(node, setup, info);
    info->storage_bytes += (int64_t)node->arena.used * (int64_t)sizeof(dse_real);
}

/* ---- life ---- */

void coordinated_mhe_destroy(void *self)
{
    struct coordinated_mhe_node *node = self;
    lossy_rounds_destroy(node->losses);
    coordinated_mhe_plant_free(&node->plant);
    free(node->subsystems);
    free(node->numbers);
    free(node->memory);
    free(node->message);
    free(node->measured);
    free(node->P);
    free(node->answers);
    free(node);
}

void *coordinated_mhe_create(const struct method_setup *setup, struct method_info *info,
                             struct error *error)
{
    const struct coordinated_mhe_section *section = setup->section;
    if (setup->graph != NULL) {
        error_set(error,
                  "%s: networks.%s.graph: coordinated_mhe has no use for a graph, its agents hear "
                  "the coordinator",
                  setup->scenario->file, setup->network->name);
        return NULL;
    }
    if (!coordinated_mhe_section_check(section, error))
        return NULL;
    struct coordinated_mhe_node *node = calloc(1, sizeof *node);
    if (node == NULL) {
        error_set(error, "out of memory");
        return NULL;
    }
    node->section = section;
    node->part = setup->node;
    node->patience_s = scenario_patience_s(setup->scenario);
    bool whole = section->scheme == COORDINATED_MHE_CENTRALISED;
    if (!coordinated_mhe_plant_make(setup, whole, section->origin, &node->plant, error) ||
        !coordinated_mhe_configure(node, setup, error) || !messages_fit(node, setup, error) ||
        !open_object(node, setup, error) || !open_losses(node, setup, error)) {
        coordinated_mhe_destroy(node);
        return NULL;
    }
    describe(node, setup, info);
    return node;
}
