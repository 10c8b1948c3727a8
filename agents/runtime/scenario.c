/* From a file to a checked scenario. */
#include "runtime/scenario.h"

#include <stdlib.h>
#include <string.h>

#include "methods/method.h"
#include "runtime/scenario_internal.h"

#define MAX_FILE_SIZE    (1024 * 1024)
#define DEFAULT_PATIENCE 5.0

/* ---- libcyaml ---- */

/* Keeps the first line of libcyaml's complaint. Its format strings are its own. */
static void keep_log(cyaml_log_t level, void *context, const char *format, va_list arguments)
{
    char *line = context;
    if (level == CYAML_LOG_ERROR && line[0] == '\0') {
        vsnprintf(line, 256, format, arguments);
        line[strcspn(line, "\n")] = '\0';
    }
}

static cyaml_config_t loader(char *log_line)
{
    return (cyaml_config_t){
        .log_fn = keep_log, .log_ctx = log_line, .mem_fn = cyaml_mem, .log_level = CYAML_LOG_ERROR};
}

static void free_values(struct scenario *scenario)
{
    char log_line[256] = "";
    cyaml_config_t config = loader(log_line);
    struct scenario_schema schema;
    scenario_schema_make(&schema);
    cyaml_free(&config, &schema.root, scenario, 0);
}

/* After scenario_check, a failure here is a disagreement between the two and worth its words. */
static struct scenario *load_values(struct scenario_tree *tree, const cyaml_schema_value_t *schema,
                                    struct error *error)
{
    char log_line[256] = "";
    cyaml_config_t config = loader(log_line);
    cyaml_data_t *data = NULL;
    size_t size = 0;
    char *text = scenario_tree_emit(tree, &size);
    if (text == NULL) {
        error_set(error, "%s: out of memory", tree->file);
        return NULL;
    }
    cyaml_err_t status = cyaml_load_data((const uint8_t *)text, size, &config, schema, &data, NULL);
    free(text);
    if (status == CYAML_OK && data != NULL)
        return data;
    error_set(error, "%s: %s: %s", tree->file, cyaml_strerror(status), log_line);
    return NULL;
}

/* ---- reading ---- */

static bool keep_origin(struct scenario *scenario, const char *yaml,
                        const struct scenario_tree *tree)
{
    scenario->file = strdup(tree->file);
    scenario->yaml = strdup(yaml);
    scenario->overrides = calloc(tree->overrides_count + 1, sizeof *scenario->overrides);
    if (scenario->file == NULL || scenario->yaml == NULL || scenario->overrides == NULL)
        return false;
    for (unsigned i = 0; i < tree->overrides_count; i++) {
        scenario->overrides[i] = strdup(tree->overrides[i]);
        if (scenario->overrides[i] == NULL)
            return false;
        scenario->overrides_count++;
    }
    return true;
}

static struct scenario *read_tree(struct scenario_tree *tree, const char *yaml, struct error *error)
{
    struct scenario_schema schema;
    scenario_schema_make(&schema);
    if (!scenario_override(tree, &schema.root, error) || !scenario_check(tree, &schema.root, error))
        return NULL;
    struct scenario *scenario = load_values(tree, &schema.root, error);
    if (scenario == NULL)
        return NULL;
    scenario->hash = scenario_hash(scenario, &schema.root);
    if (scenario_judge(tree, scenario, error) &&
        (keep_origin(scenario, yaml, tree) || error_set(error, "%s: out of memory", tree->file))) {
        scenario->hash = scenario_hash_fates(scenario->hash, scenario);
        return scenario;
    }
    scenario_free(scenario);
    return NULL;
}

struct scenario *scenario_parse(const char *yaml, const char *file, const char *const *overrides,
                                unsigned overrides_count, struct error *error)
{
    return scenario_parse_recorded(yaml, file, NULL, 0, overrides, overrides_count, error);
}

struct scenario *scenario_parse_recorded(const char *yaml, const char *file,
                                         const struct scenario_part *parts, unsigned parts_count,
                                         const char *const *overrides, unsigned overrides_count,
                                         struct error *error)
{
    struct scenario_tree tree;
    if (!scenario_tree_load(&tree, yaml, file, overrides, overrides_count, error))
        return NULL;
    tree.parts = parts;
    tree.parts_count = parts_count;
    struct scenario *scenario = read_tree(&tree, yaml, error);
    scenario_tree_free(&tree);
    return scenario;
}

struct scenario *scenario_read(const char *path, const char *const *overrides,
                               unsigned overrides_count, struct error *error)
{
    char *text = scenario_text(path, error);
    if (text == NULL)
        return NULL;
    struct scenario *scenario = scenario_parse(text, path, overrides, overrides_count, error);
    free(text);
    return scenario;
}

void scenario_free(struct scenario *scenario)
{
    if (scenario == NULL)
        return;
    for (unsigned i = 0; i < scenario->overrides_count; i++)
        free(scenario->overrides[i]);
    for (unsigned i = 0; i < scenario->networks_count; i++) {
        scenario_graph_free(scenario->networks[i].neighbours);
        scenario_link_free(scenario->networks[i].fates);
    }
    scenario_parts_free(scenario->parts, scenario->parts_count);
    scenario_linear_free(scenario->linear);
    free(scenario->overrides);
    free(scenario->yaml);
    free(scenario->file);
    free_values(scenario);
}

/* ---- what follows from it ---- */

int64_t scenario_samples(const struct scenario *scenario)
{
    return llround(scenario->time.duration_s / scenario->time.period_s);
}

int64_t scenario_sample_at(const struct scenario *scenario, double seconds)
{
    return (int64_t)ceil(seconds / scenario->time.period_s - 1e-9);
}

double scenario_period(const struct scenario *scenario)
{
    return scenario->time.period_s / (double)scenario->process->time_unit_s;
}

double scenario_patience_s(const struct scenario *scenario)
{
    double given = scenario->timeouts.patience_s;
    return given > 0 ? given : DEFAULT_PATIENCE;
}

int scenario_method(const struct scenario_network *network)
{
    for (int i = 0; i < SCENARIO_MAX_METHODS; i++)
        if (network->section[i] != NULL)
            return i;
    return -1;
}

static void set_parameters(const struct dse_plant *plant,
                           const struct scenario_parameter *parameters, unsigned count,
                           dse_real *values)
{
    for (unsigned p = 0; p < count; p++)
        for (int i = 0; i < plant->n_parameters; i++)
            if (strcmp(plant->parameters[i].name, parameters[p].name) == 0)
                values[i] = (dse_real)parameters[p].value;
}

static const struct dse_parameter_set *find_set(const struct dse_plant *plant, const char *name)
{
    for (int i = 0; name != NULL && i < plant->n_sets; i++)
        if (strcmp(plant->sets[i].name, name) == 0)
            return &plant->sets[i];
    return &plant->sets[0];
}

bool scenario_prepare_plant(const struct scenario *scenario, const struct scenario_network *network,
                            dse_real *values, dse_real *prepared, struct error *error)
{
    const struct dse_plant *plant = scenario->process;
    bool own_set = network != NULL && network->set != NULL;
    if (plant->prepare == NULL) {
        memcpy(prepared, plant->constants, (size_t)plant->prepared_size * sizeof *prepared);
        return true;
    }
    const struct dse_parameter_set *set =
        find_set(plant, own_set ? network->set : scenario->plant.set);
    memcpy(values, set->values, (size_t)plant->n_parameters * sizeof *values);
    if (!own_set)
        set_parameters(plant, scenario->plant.parameters, scenario->plant.parameters_count, values);
    if (network != NULL)
        set_parameters(plant, network->parameters, network->parameters_count, values);

    enum dse_status status = plant->prepare(values, prepared);
    if (status == DSE_OK)
        return true;
    return error_set(error, "the parameter values make no plant %s: %s", plant->name,
                     dse_status_text(status));
}
