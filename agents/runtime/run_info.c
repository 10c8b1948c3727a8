/* Run information as JSON text. */
#include "runtime/run_info.h"

#include <inttypes.h>
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/networks.h"
#include "runtime/node.h"

static const char *pace_name(int pace)
{
    static const char *const names[] = {"lockstep", "realtime", "replay"};
    return names[pace];
}

static json_t *text_or_null(const char *text)
{
    return text != NULL ? json_string(text) : json_null();
}

static json_t *signals(const struct dse_signal *signal, int count)
{
    json_t *list = json_array();
    for (int i = 0; i < count; i++)
        json_array_append_new(list, json_pack("{s:s, s:s, s:s, s:f}", "name", signal[i].name,
                                              "unit", signal[i].unit, "title", signal[i].title,
                                              "scale", (double)signal[i].scale));
    return list;
}

/* The last ones, which estimators do not know, say so. */
static json_t *inputs(const struct dse_plant *process)
{
    json_t *list = signals(process->inputs, process->nu);
    for (int i = process->nu - process->n_unknown; i < process->nu; i++)
        json_object_set_new(json_array_get(list, (size_t)i), "unknown", json_true());
    return list;
}

static json_t *indices(const int *index, int count)
{
    json_t *list = json_array();
    for (int i = 0; i < count; i++)
        json_array_append_new(list, json_integer(index[i]));
    return list;
}

static json_t *groups(const struct dse_plant *process)
{
    json_t *list = json_array();
    for (int i = 0; i < process->n_subsystems; i++) {
        const struct dse_subsystem *subsystem = &process->subsystems[i];
        json_array_append_new(list, json_pack("{s:s, s:o}", "name", subsystem->name, "outputs",
                                              indices(subsystem->outputs, subsystem->n_outputs)));
    }
    return list;
}

static json_t *parameters(const struct scenario *scenario)
{
    const struct dse_plant *process = scenario->process;
    json_t *list = json_array();
    dse_real *values = calloc((size_t)process->n_parameters + 1, sizeof *values);
    dse_real *prepared = calloc((size_t)process->prepared_size + 1, sizeof *prepared);
    struct error error = {0};
    if (values != NULL && prepared != NULL &&
        scenario_prepare_plant(scenario, NULL, values, prepared, &error))
        for (int i = 0; i < process->n_parameters; i++)
            json_array_append_new(
                list, json_pack("{s:s, s:s, s:f}", "name", process->parameters[i].name, "unit",
                                process->parameters[i].unit, "value", (double)values[i]));
    free(values);
    free(prepared);
    return list;
}

static json_t *plant_object(const struct scenario *scenario)
{
    const struct dse_plant *process = scenario->process;
    const char *set = scenario->plant.set != NULL ? scenario->plant.set : process->sets[0].name;
    return json_pack("{s:s, s:s, s:s, s:o, s:o, s:o, s:o, s:o}", "name", process->name, "title",
                     process->title, "set", set, "states", signals(process->states, process->nx),
                     "inputs", inputs(process), "outputs", signals(process->outputs, process->ny),
                     "parameters", parameters(scenario), "groups", groups(process));
}

static const char *network_title(const struct scenario_network *network,
                                 const struct method *method)
{
    if (network->title != NULL)
        return network->title;
    return method != NULL ? method->title : "";
}

/* Enough to tell every packet's fate by dse_link_fate; null: nothing is late or lost. */
static json_t *link_of(const struct scenario_network *network)
{
    const struct dse_link_config *link = scenario_link_fates(network);
    json_t *outages = json_array();
    if (link == NULL) {
        json_decref(outages);
        return json_null();
    }
    for (int i = 0; i < link->n_outages; i++)
        json_array_append_new(outages,
                              json_pack("[i, i, I, I]", link->outages[i].from, link->outages[i].to,
                                        (json_int_t)link->outages[i].first,
                                        (json_int_t)link->outages[i].end));
    char seed[24]; /* all 64 bits: JSON's integers have a sign */
    snprintf(seed, sizeof seed, "%" PRIu64, link->seed);
    return json_pack("{s:i, s:i, s:f, s:s, s:o, s:o}", "D", link->max_delay, "T_m",
                     link->max_losses, "loss", link->loss, "seed", seed, "file",
                     text_or_null(network->link->file), "outages", outages);
}

static json_t *networks(const struct scenario *scenario)
{
    json_t *list = json_array();
    for (unsigned i = 0; i < scenario->networks_count; i++) {
        struct error error = {0};
        const struct scenario_network *network = &scenario->networks[i];
        const struct method *method = method_at(scenario_method(network));
        json_array_append_new(list, json_pack("{s:s, s:s, s:s, s:i, s:o}", "name", network->name,
                                              "title", network_title(network, method), "method",
                                              method != NULL ? method->name : "", "nodes",
                                              network_nodes(scenario, (int)i, NULL, &error), "link",
                                              link_of(network)));
    }
    return list;
}

static json_t *type_hashes(void)
{
    json_t *object = json_object();
    int64_t fingerprint;
    for (int i = 0; message_type(i, &fingerprint) != NULL; i++) {
        char text[32];
        snprintf(text, sizeof text, "%016" PRIx64, (uint64_t)fingerprint);
        json_object_set_new(object, message_type(i, &fingerprint), json_string(text));
    }
    return object;
}

static json_t *parts(const struct scenario *scenario)
{
    json_t *list = json_array();
    for (unsigned i = 0; i < scenario->parts_count; i++)
        json_array_append_new(list, json_pack("{s:s, s:s}", "name", scenario->parts[i].name, "text",
                                              scenario->parts[i].text));
    return list;
}

static json_t *scenario_object(const struct scenario *scenario)
{
    char hash[32];
    snprintf(hash, sizeof hash, "%016" PRIx64, scenario->hash);
    json_t *overrides = json_array();
    for (unsigned i = 0; i < scenario->overrides_count; i++)
        json_array_append_new(overrides, json_string(scenario->overrides[i]));
    return json_pack("{s:s, s:o, s:o, s:s, s:s, s:s, s:o, s:o}", "name", scenario->name, "title",
                     text_or_null(scenario->title), "source", text_or_null(scenario->source),
                     "file", scenario->file, "hash", hash, "yaml", scenario->yaml, "overrides",
                     overrides, "parts", parts(scenario));
}

char *run_info_plant(const struct scenario *scenario, int64_t run_id, int pace, int64_t samples)
{
    const struct dse_plant *process = scenario->process;
    json_t *object = json_pack(
        "{s:s, s:s, s:I, s:I, s:s, s:o, s:{s:s, s:f, s:f, s:I}, s:o, s:o, s:o}", "kind", "plant",
        "dse_version", DSE_VERSION, "run_id", (json_int_t)run_id, "seed",
        (json_int_t)scenario->seed, "pace", pace_name(pace), "scenario", scenario_object(scenario),
        "time", "unit", process->time_unit, "unit_s", (double)process->time_unit_s, "period",
        scenario_period(scenario), "samples", (json_int_t)samples, "plant", plant_object(scenario),
        "networks", networks(scenario), "type_hashes", type_hashes());
    char *text = json_dumps(object, JSON_COMPACT | JSON_REAL_PRECISION(17));
    json_decref(object);
    return text;
}

char *run_info_node(const struct scenario *scenario, int network, int node,
                    const struct method *method, const struct method_info *info, int64_t source_run)
{
    json_t *diagnostics = json_array();
    for (int i = 0; i < info->n_diagnostics; i++)
        json_array_append_new(diagnostics,
                              json_pack("{s:s, s:s}", "name", info->diagnostics[i].name, "unit",
                                        info->diagnostics[i].unit));
    json_t *frames = json_array();
    for (int i = 0; i < info->n_frames; i++)
        json_array_append_new(frames,
                              json_pack("[i, i]", info->frames[i].from, info->frames[i].values));
    json_t *object = json_pack(
        "{s:s, s:i, s:s, s:i, s:s, s:s, s:s, s:o, s:o, s:o, s:o, s:i, s:o, s:o, s:I, s:I}", "kind",
        "node", "network", network, "network_name", scenario->networks[network].name, "node", node,
        "name", info->name, "method", method->name, "method_title", method->title, "states",
        indices(info->states, info->n_states), "groups", indices(info->groups, info->n_groups),
        "neighbours", indices(info->neighbours, info->n_neighbours), "listeners",
        indices(info->listeners, info->n_listeners), "every", info->every > 0 ? info->every : 1,
        "frames", frames, "diagnostics", diagnostics, "storage_bytes",
        (json_int_t)info->storage_bytes, "source_run", (json_int_t)source_run);
    char *text = json_dumps(object, JSON_COMPACT | JSON_REAL_PRECISION(17));
    json_decref(object);
    return text;
}

bool run_info_add(struct run_info_text *info, const dse_run_info_t *message)
{
    if (info->parts != message->parts) {
        memset(info, 0, sizeof *info);
        info->parts = message->parts;
        info->missing = message->parts;
    }
    memcpy(info->text + (size_t)message->part * DSE_RUN_INFO_T_CAPACITY, message->text,
           (size_t)message->count);
    info->missing -= !info->have[message->part];
    info->have[message->part] = true;
    return info->missing == 0;
}

static bool read_overrides(const json_t *list, struct run_info_scenario *scenario)
{
    size_t count = json_array_size(list);
    scenario->overrides = calloc(count + 1, sizeof *scenario->overrides);
    if (scenario->overrides == NULL)
        return false;
    for (size_t i = 0; i < count; i++) {
        const char *text = json_string_value(json_array_get(list, i));
        scenario->overrides[i] = text != NULL ? strdup(text) : NULL;
        if (scenario->overrides[i] == NULL)
            return false;
        scenario->overrides_count++;
    }
    return true;
}

/* Logs of older versions have none. */
static bool read_parts(const json_t *list, struct run_info_scenario *scenario)
{
    size_t count = json_array_size(list);
    scenario->parts = calloc(count + 1, sizeof *scenario->parts);
    if (scenario->parts == NULL)
        return false;
    for (size_t i = 0; i < count; i++) {
        const json_t *one = json_array_get(list, i);
        const char *name = json_string_value(json_object_get(one, "name"));
        const char *text = json_string_value(json_object_get(one, "text"));
        if (name == NULL || text == NULL)
            return false;
        struct scenario_part *part = &scenario->parts[scenario->parts_count++];
        part->name = strdup(name);
        part->text = strdup(text);
        if (part->name == NULL || part->text == NULL)
            return false;
    }
    return true;
}

bool run_info_read_scenario(const char *json, struct run_info_scenario *scenario)
{
    memset(scenario, 0, sizeof *scenario);
    json_t *object = json_loads(json, 0, NULL);
    const char *kind = NULL, *yaml = NULL, *file = NULL;
    json_t *overrides = NULL, *named = NULL;
    json_int_t samples = 0;
    bool ok = object != NULL &&
              json_unpack(object, "{s:s, s:{s:s, s:s, s:o, s?o}, s:{s:I}}", "kind", &kind,
                          "scenario", "yaml", &yaml, "file", &file, "overrides", &overrides,
                          "parts", &named, "time", "samples", &samples) == 0 &&
              strcmp(kind, "plant") == 0;
    if (ok) {
        scenario->yaml = strdup(yaml);
        scenario->file = strdup(file);
        scenario->samples = samples;
        ok = scenario->yaml != NULL && scenario->file != NULL &&
             read_overrides(overrides, scenario) && read_parts(named, scenario);
    }
    json_decref(object);
    return ok;
}

void run_info_scenario_free(struct run_info_scenario *scenario)
{
    for (unsigned i = 0; i < scenario->overrides_count; i++)
        free(scenario->overrides[i]);
    for (unsigned i = 0; i < scenario->parts_count; i++) {
        free(scenario->parts[i].name);
        free(scenario->parts[i].text);
    }
    free(scenario->overrides);
    free(scenario->parts);
    free(scenario->yaml);
    free(scenario->file);
}
