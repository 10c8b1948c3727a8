/* The plant called linear: its matrices stand in the scenario, under plant.linear. Made from the
 * tree once that part is known to fit the schema, before the lengths of other lists are checked
 * against the plant; from then on it is a plant like those that are shipped. */
#include <stdlib.h>
#include <string.h>

#include "runtime/scenario_linear_internal.h"

/* Signals x1, x2, .. without unit: nominal value 0, size 1. */
static void name_signals(struct dse_signal *signals, char (*names)[LINEAR_NAME_SIZE], int count,
                         char letter)
{
    for (int i = 0; i < count; i++) {
        snprintf(names[i], LINEAR_NAME_SIZE, "%c%d", letter, i + 1);
        signals[i] =
            (struct dse_signal){.name = names[i], .unit = "", .scale = 1, .title = names[i]};
    }
}

static bool rename_states(const struct linear_maker *m)
{
    static const char allowed[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_";
    struct scenario_linear_plant *linear = m->linear;
    int count = linear_count(m, "states");
    if (linear_node(m, "states") == 0)
        return true;
    if (count != linear->plant.nx)
        return scenario_fail(m->tree, linear_node(m, "states"), "plant.linear.states", m->error,
                             "has %d names; it must have nx = %d", count, linear->plant.nx);
    for (int i = 0; i < count; i++) {
        char path[64];
        const char *name = linear_item(m, "states", i);
        int node = scenario_tree_item(m->tree, linear_node(m, "states"), i);
        snprintf(path, sizeof path, "plant.linear.states[%d]", i);
        if (name[strspn(name, allowed)] != '\0')
            return scenario_fail(m->tree, node, path, m->error,
                                 "'%s' is not a name: letters, digits and _ only", name);
        for (int other = 0; other < i; other++)
            if (strcmp(linear->state_names[other], name) == 0)
                return scenario_fail(m->tree, node, path, m->error,
                                     "'%s' is the name of states[%d] too", name, other);
        snprintf(linear->state_names[i], LINEAR_NAME_SIZE, "%s", name);
    }
    return true;
}

/* Who measures what. Unless blocks say so no state belongs to a group: what a node estimates is its
 * method's affair. */
static bool cut_groups(const struct linear_maker *m)
{
    struct scenario_linear_plant *linear = m->linear;
    struct dse_plant *plant = &linear->plant;
    const int node = linear_node(m, "groups");
    int rows = 0;
    plant->n_subsystems = node != 0 ? linear_count(m, "groups") : 1;
    for (int i = 0; i < plant->ny; i++)
        linear->output_index[i] = i;
    for (int g = 0; g < plant->n_subsystems; g++) {
        int count = node != 0 ? atoi(linear_item(m, "groups", g)) : plant->ny;
        if (rows + count <= plant->ny)
            linear->groups[g] =
                (struct dse_subsystem){.name = linear->group_names[g],
                                       .states = linear->output_index,
                                       .n_outputs = count,
                                       .outputs = count > 0 ? linear->output_index + rows : NULL};
        snprintf(linear->group_names[g], LINEAR_NAME_SIZE, "group %d", g + 1);
        rows += count;
    }
    if (rows == plant->ny)
        return true;
    return scenario_fail(m->tree, node, "plant.linear.groups", m->error,
                         "counts %d outputs; there are %d, the rows of C", rows, plant->ny);
}

/* Which states belong to which group: consecutive ones. */
static bool cut_states(const struct linear_maker *m)
{
    struct scenario_linear_plant *linear = m->linear;
    const struct dse_plant *plant = &linear->plant;
    const int node = linear_node(m, "blocks");
    int states = 0;
    if (node == 0)
        return true;
    if (linear_count(m, "blocks") != plant->n_subsystems)
        return scenario_fail(m->tree, node, "plant.linear.blocks", m->error,
                             "has %d values; it must have %d, one per group",
                             linear_count(m, "blocks"), plant->n_subsystems);
    for (int i = 0; i < plant->nx; i++)
        linear->state_index[i] = i;
    for (int g = 0; g < plant->n_subsystems; g++) {
        const int count = atoi(linear_item(m, "blocks", g));
        if (states + count <= plant->nx) {
            linear->groups[g].n_states = count;
            linear->groups[g].states = linear->state_index + (count > 0 ? states : 0);
        }
        states += count;
    }
    if (states == plant->nx)
        return true;
    return scenario_fail(m->tree, node, "plant.linear.blocks", m->error,
                         "counts %d states; there are nx = %d", states, plant->nx);
}

static void set_time(const struct linear_maker *m)
{
    static const struct {
        double seconds;
        const char *unit;
    } units[] = {{1, "s"}, {60, "min"}, {3600, "h"}, {86400, "d"}};
    struct scenario_linear_plant *linear = m->linear;
    const char *time = linear_text(m, "time"), *unit = linear_text(m, "unit_s"), *wrong = NULL;
    double seconds = 1;
    if (unit != NULL)
        scenario_number(unit, &seconds, &wrong);
    linear->time = time != NULL && strcmp(time, "discrete") == 0 ? DSE_DISCRETE : DSE_CONTINUOUS;
    linear->plant.time_unit_s = (dse_real)seconds;
    snprintf(linear->time_unit, sizeof linear->time_unit, "%.6g s", seconds);
    for (size_t i = 0; i < sizeof units / sizeof units[0]; i++)
        if (seconds >= units[i].seconds && seconds <= units[i].seconds)
            snprintf(linear->time_unit, sizeof linear->time_unit, "%s", units[i].unit);
}

static void fill_model(const dse_real *prepared, struct dse_model *model)
{
    const void *address = NULL;
    memcpy(&address, prepared, sizeof address);
    const struct scenario_linear_plant *linear = address;
    dse_linear_process_model(model, linear->time, linear->plant.nx, linear->plant.nu,
                             linear->plant.ny, &linear->process);
}

static void fill_plant(struct scenario_linear_plant *linear)
{
    struct dse_plant *plant = &linear->plant;
    const void *address = linear;
    memcpy(linear->handle, &address, sizeof address);
    linear->set = (struct dse_parameter_set){
        .name = "scenario", .title = "as written", .values = linear->x0, .x0 = linear->x0};
    plant->name = "linear";
    plant->title = "linear plant of the scenario";
    plant->source = "the scenario";
    plant->time_unit = linear->time_unit;
    plant->states = linear->states;
    plant->inputs = linear->inputs;
    plant->outputs = linear->outputs;
    plant->n_sets = 1;
    plant->sets = &linear->set;
    plant->subsystems = linear->groups;
    plant->prepared_size = (int)LINEAR_HANDLE_SIZE;
    plant->constants = linear->handle;
    plant->model = fill_model;
    name_signals(linear->states, linear->state_names, plant->nx, 'x');
    name_signals(linear->inputs, linear->input_names, plant->nu, 'u');
    name_signals(linear->outputs, linear->output_names, plant->ny, 'y');
}

struct scenario_linear_plant *scenario_linear_make(struct scenario_tree *tree, int section,
                                                   struct error *error)
{
    struct scenario_linear_plant *linear = calloc(1, sizeof *linear);
    const struct linear_maker maker = {
        .tree = tree, .section = section, .error = error, .linear = linear};
    if (linear == NULL) {
        error_set(error, "%s: out of memory", tree->file);
        return NULL;
    }
    if (linear_read_matrices(&maker)) {
        set_time(&maker);
        fill_plant(linear);
        if (linear_read_point(&maker) && rename_states(&maker) && cut_groups(&maker) &&
            cut_states(&maker))
            return linear;
    }
    scenario_linear_free(linear);
    return NULL;
}

void scenario_linear_free(struct scenario_linear_plant *linear)
{
    if (linear == NULL)
        return;
    free(linear->numbers);
    free(linear);
}

const struct dse_plant *scenario_linear_process(const struct scenario_linear_plant *linear)
{
    return &linear->plant;
}
