/* What the structure alone does not show: does the experiment make sense for this plant? */
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "methods/method.h"
#include "runtime/scenario_internal.h"

struct judge {
    struct scenario_tree *tree;
    struct scenario *scenario;
    struct error *error;
};

static bool fail(struct judge *j, const char *path, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

static bool fail(struct judge *j, const char *path, const char *format, ...)
{
    char message[768];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    return scenario_fail(j->tree, scenario_tree_find(j->tree, path), path, j->error, "%s", message);
}

static bool fail_word(struct judge *j, const char *path, const char *what, const char *wrong,
                      const struct scenario_words *words)
{
    char list[512];
    scenario_words_text(words, wrong, list, sizeof list);
    return fail(j, path, "%s called %s; there are: %s", what, wrong, list);
}

static bool judge_name(struct judge *j, const char *path, const char *name)
{
    static const char allowed[] =
        "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_-";
    if (name[strspn(name, allowed)] == '\0')
        return true;
    return fail(j, path, "'%s' is not a name: letters, digits, _ and - only", name);
}

static bool judge_time(struct judge *j)
{
    const struct scenario_time *time = &j->scenario->time;
    if (time->duration_s < time->period_s)
        return fail(j, "time.duration_s", "%.10g is shorter than one period of %.10g",
                    time->duration_s, time->period_s);
    if (time->duration_s / time->period_s > SCENARIO_MAX_SAMPLES)
        return fail(j, "time.duration_s", "%.10g makes more than %.0e samples of %.10g",
                    time->duration_s, SCENARIO_MAX_SAMPLES, time->period_s);
    return true;
}

static bool judge_linear(struct judge *j)
{
    if (j->tree->linear == NULL)
        return fail(j, "plant.linear", "is missing: the matrices of the plant called linear");
    j->scenario->linear = j->tree->linear;
    j->scenario->process = scenario_linear_process(j->tree->linear);
    j->tree->linear = NULL;
    return true;
}

static bool judge_plant(struct judge *j)
{
    struct scenario *scenario = j->scenario;
    if (strcmp(scenario->plant.name, "linear") == 0)
        return judge_linear(j);
    if (scenario->plant.linear != NULL)
        return fail(j, "plant.linear", "belongs to the plant called linear, not to %s",
                    scenario->plant.name);
    scenario->process = dse_plant_find(scenario->plant.name);
    if (scenario->process != NULL)
        return true;
    struct scenario_words plants = {.count = 0};
    for (int i = 0; dse_plant_at(i) != NULL; i++)
        scenario_words_add(&plants, dse_plant_at(i)->name);
    scenario_words_add(&plants, "linear");
    return fail_word(j, "plant.name", "there is no plant", scenario->plant.name, &plants);
}

static bool judge_set(struct judge *j, const char *path, const char *set)
{
    const struct dse_plant *plant = j->scenario->process;
    struct scenario_words sets = {.count = 0};
    for (int i = 0; i < plant->n_sets; i++) {
        if (set == NULL || strcmp(plant->sets[i].name, set) == 0)
            return true;
        scenario_words_add(&sets, plant->sets[i].name);
    }
    return fail_word(j, path, "the plant has no set", set, &sets);
}

static bool judge_parameter(struct judge *j, const char *path,
                            const struct scenario_parameter *parameter)
{
    char key[SCENARIO_PATH_SIZE + 16];
    const struct dse_plant *plant = j->scenario->process;
    struct scenario_words names = {.count = 0};
    for (int i = 0; i < plant->n_parameters; i++) {
        const struct dse_parameter *p = &plant->parameters[i];
        scenario_words_add(&names, p->name);
        if (strcmp(p->name, parameter->name) != 0)
            continue;
        if (parameter->value >= (double)p->min && parameter->value <= (double)p->max)
            return true;
        snprintf(key, sizeof key, "%s.value", path);
        return fail(j, key, "%.10g is out of range; %s must be >= %.10g and <= %.10g %s (%s)",
                    parameter->value, p->name, (double)p->min, (double)p->max, p->unit, p->title);
    }
    snprintf(key, sizeof key, "%s.name", path);
    return fail_word(j, key, "the plant has no parameter", parameter->name, &names);
}

static bool judge_parameters(struct judge *j, const char *path,
                             const struct scenario_parameter *parameters, unsigned count)
{
    char key[SCENARIO_PATH_SIZE];
    for (unsigned i = 0; i < count; i++) {
        snprintf(key, sizeof key, "%s[%u]", path, i);
        if (!judge_parameter(j, key, &parameters[i]))
            return false;
        for (unsigned other = 0; other < i; other++)
            if (strcmp(parameters[other].name, parameters[i].name) == 0)
                return fail(j, key, "%s is given twice", parameters[i].name);
    }
    return true;
}

/* The plant's own limits are per parameter; together they may still make no plant. */
static bool judge_prepare(struct judge *j, const char *path, const struct scenario_network *network)
{
    const struct dse_plant *plant = j->scenario->process;
    struct error why = {.text = ""};
    dse_real values[DSE_PLANT_MAX_PARAMETERS];
    dse_real *prepared = calloc((size_t)plant->prepared_size + 1, sizeof *prepared);
    bool good =
        prepared != NULL && scenario_prepare_plant(j->scenario, network, values, prepared, &why);
    free(prepared);
    return good || fail(j, path, "%s", why.text[0] != '\0' ? why.text : "out of memory");
}

static bool judge_noise(struct judge *j, const char *path, const struct scenario_noise *noise)
{
    if (noise->distribution != SCENARIO_NONE && noise->scale_count == 0)
        return fail(j, path,
                    "scale is missing: noise that is not 'none' needs one value per channel");
    if (noise->limit_count > 0 && noise->distribution != SCENARIO_GAUSSIAN)
        return fail(j, path, "limit belongs to gaussian noise");
    return true;
}

/* Sensors that are out: outputs of the plant, for a time. */
static bool judge_dead(struct judge *j)
{
    const struct dse_plant *plant = j->scenario->process;
    char key[64];
    for (unsigned k = 0; k < j->scenario->noise.dead_count; k++) {
        const struct scenario_dead_sensor *dead = &j->scenario->noise.dead[k];
        struct scenario_words outputs = {.count = 0};
        bool known = false;
        for (int i = 0; i < plant->ny; i++) {
            scenario_words_add(&outputs, plant->outputs[i].name);
            known |= strcmp(plant->outputs[i].name, dead->output) == 0;
        }
        snprintf(key, sizeof key, "noise.dead[%u].output", k);
        if (!known)
            return fail_word(j, key, "the plant has no output", dead->output, &outputs);
        snprintf(key, sizeof key, "noise.dead[%u]", k);
        if (dead->end_s > 0 && dead->end_s <= dead->start_s)
            return fail(j, key, "ends at %.10g s, which is not after its start at %.10g s",
                        dead->end_s, dead->start_s);
        if (fmax(dead->start_s, dead->end_s) / j->scenario->time.period_s > SCENARIO_MAX_SAMPLES)
            return fail(j, key, "lies beyond the longest run");
    }
    return true;
}

static bool judge_section(struct judge *j, const char *path, const struct scenario_network *network)
{
    struct scenario_words methods = {.count = 0};
    const char *given[SCENARIO_MAX_METHODS];
    int count = 0;
    for (int i = 0; i < SCENARIO_MAX_METHODS && method_at(i) != NULL; i++) {
        scenario_words_add(&methods, method_at(i)->name);
        if (network->section[i] != NULL)
            given[count++] = method_at(i)->name;
    }
    if (count > 1)
        return fail(j, path, "has two methods, %s and %s; a network has one", given[0], given[1]);
    if (count == 1)
        return true;
    char list[512];
    scenario_words_text(&methods, "", list, sizeof list);
    return fail(j, path, "has no method; one of these sections is needed: %s", list);
}

static bool judge_network(struct judge *j, unsigned i)
{
    char path[SCENARIO_PATH_SIZE], key[SCENARIO_PATH_SIZE + 16];
    struct scenario_network *network = &j->scenario->networks[i];
    snprintf(path, sizeof path, "networks[%u]", i);
    snprintf(key, sizeof key, "%s.graph", path);
    if (!scenario_graph_make(j->tree, key, network, j->error))
        return false;
    snprintf(key, sizeof key, "%s.name", path);
    if (!judge_name(j, key, network->name))
        return false;
    for (unsigned other = 0; other < i; other++)
        if (strcmp(j->scenario->networks[other].name, network->name) == 0)
            return fail(j, key, "'%s' is the name of networks[%u] too", network->name, other);
    snprintf(key, sizeof key, "%s.set", path);
    if (!judge_set(j, key, network->set))
        return false;
    snprintf(key, sizeof key, "%s.parameters", path);
    return judge_parameters(j, key, network->parameters, network->parameters_count) &&
           judge_prepare(j, key, network) && judge_section(j, path, network) &&
           scenario_link_make(j->tree, j->scenario, i, j->error);
}

bool scenario_judge(struct scenario_tree *tree, struct scenario *scenario, struct error *error)
{
    struct judge judge = {.tree = tree, .scenario = scenario, .error = error};
    struct judge *j = &judge;
    const struct scenario_plant *plant = &scenario->plant;
    bool good =
        judge_name(j, "name", scenario->name) && judge_time(j) && judge_plant(j) &&
        judge_set(j, "plant.set", plant->set) &&
        judge_parameters(j, "plant.parameters", plant->parameters, plant->parameters_count) &&
        judge_prepare(j, "plant.parameters", NULL) && scenario_judge_drive(tree, scenario, error) &&
        judge_noise(j, "noise.process", &scenario->noise.process) &&
        judge_noise(j, "noise.measurement", &scenario->noise.measurement) && judge_dead(j);
    for (unsigned i = 0; good && i < scenario->networks_count; i++)
        good = judge_network(j, i);
    return good;
}
