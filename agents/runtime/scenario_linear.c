/* The plant called linear: its matrices stand in the scenario, under plant.linear. Made from the
 * tree once that part is known to fit the schema, before the lengths of other lists are checked
 * against the plant; from then on it is a plant like those that are shipped. */
#include <stdlib.h>
#include <string.h>

#include "runtime/scenario_internal.h"

#define NAME_SIZE   32
#define HANDLE_SIZE ((sizeof(void *) + sizeof(dse_real) - 1) / sizeof(dse_real))

struct scenario_linear_plant {
    struct dse_plant plant;
    struct dse_linear_process process;
    enum dse_time_kind time;
    dse_real *numbers;            /* A, B, C, A_sin one after the other */
    dse_real handle[HANDLE_SIZE]; /* the plant's constants: the address of this structure */
    dse_real x0[DSE_PLANT_MAX_STATES];
    struct dse_parameter_set set;
    char time_unit[NAME_SIZE];
    struct dse_signal states[DSE_PLANT_MAX_STATES];
    struct dse_signal inputs[DSE_PLANT_MAX_INPUTS];
    struct dse_signal outputs[DSE_PLANT_MAX_OUTPUTS];
    char state_names[DSE_PLANT_MAX_STATES][NAME_SIZE];
    char input_names[DSE_PLANT_MAX_INPUTS][NAME_SIZE];
    char output_names[DSE_PLANT_MAX_OUTPUTS][NAME_SIZE];
    struct dse_subsystem groups[DSE_PLANT_MAX_OUTPUTS];
    char group_names[DSE_PLANT_MAX_OUTPUTS][NAME_SIZE];
    int output_index[DSE_PLANT_MAX_OUTPUTS]; /* 0, 1, ..: groups are consecutive rows of C */
    int state_index[DSE_PLANT_MAX_STATES];   /* likewise */
};

/* The section in the tree while the plant is made. */
struct maker {
    struct scenario_tree *tree;
    int section;
    struct error *error;
    struct scenario_linear_plant *linear;
};

/* The node of a key of plant.linear, 0 where it is left out. */
static int node_of(const struct maker *m, const char *key)
{
    const yaml_node_pair_t *pair = scenario_tree_pair(m->tree, m->section, key);
    return pair != NULL ? pair->value : 0;
}

static const char *text_of(const struct maker *m, const char *key)
{
    int node = node_of(m, key);
    return node != 0 ? scenario_tree_text(m->tree, node) : NULL;
}

static int count_of(const struct maker *m, const char *key)
{
    int node = node_of(m, key);
    return node != 0 ? scenario_tree_count(m->tree, node) : 0;
}

static const char *item_of(const struct maker *m, const char *key, int i)
{
    return scenario_tree_text(m->tree, scenario_tree_item(m->tree, node_of(m, key), i));
}

static bool fail_count(const struct maker *m, const char *key, int wanted, const char *what,
                       int rows, int columns)
{
    char path[SCENARIO_PATH_SIZE];
    snprintf(path, sizeof path, "plant.linear.%s", key);
    return scenario_fail(m->tree, scenario_tree_find(m->tree, path), path, m->error,
                         "has %d values; it must have %d: %s = %d x %d, row by row",
                         count_of(m, key), wanted, what, rows, columns);
}

/* nx, nu, ny; ny is the number of rows of C. */
static bool read_dimensions(const struct maker *m)
{
    struct dse_plant *plant = &m->linear->plant;
    const char *nu = text_of(m, "nu"), *unknown = text_of(m, "unknown");
    plant->nx = atoi(text_of(m, "nx"));
    plant->nu = nu != NULL ? atoi(nu) : 0;
    plant->n_unknown = unknown != NULL ? atoi(unknown) : 0;
    if (plant->n_unknown > plant->nu)
        return scenario_fail(m->tree, node_of(m, "unknown"), "plant.linear.unknown", m->error,
                             "%d of nu = %d inputs cannot be unknown", plant->n_unknown, plant->nu);
    int count = count_of(m, "C");
    plant->ny = count / plant->nx;
    if (count_of(m, "A") != plant->nx * plant->nx)
        return fail_count(m, "A", plant->nx * plant->nx, "nx x nx", plant->nx, plant->nx);
    if (count_of(m, "B") != plant->nx * plant->nu)
        return fail_count(m, "B", plant->nx * plant->nu, "nx x nu", plant->nx, plant->nu);
    if (node_of(m, "A_sin") != 0 && count_of(m, "A_sin") != plant->nx * plant->nx)
        return fail_count(m, "A_sin", plant->nx * plant->nx, "nx x nx", plant->nx, plant->nx);
    if (count % plant->nx != 0)
        return scenario_fail(m->tree, node_of(m, "C"), "plant.linear.C", m->error,
                             "has %d values; it must have whole rows of nx = %d, one per output",
                             count, plant->nx);
    if (plant->ny > DSE_PLANT_MAX_OUTPUTS)
        return scenario_fail(m->tree, node_of(m, "C"), "plant.linear.C", m->error,
                             "has %d rows; it must have 1 to %d, one per output", plant->ny,
                             DSE_PLANT_MAX_OUTPUTS);
    return true;
}

/* The numbers of a list in their order; where the next list goes. */
static dse_real *read_list(const struct maker *m, const char *key, dse_real *to)
{
    int count = count_of(m, key);
    const char *wrong = NULL;
    for (int i = 0; i < count; i++) {
        double value = 0;
        if (scenario_number(item_of(m, key, i), &value, &wrong))
            *to++ = (dse_real)value;
    }
    return to;
}

static bool read_matrices(const struct maker *m)
{
    struct scenario_linear_plant *linear = m->linear;
    const struct dse_plant *plant = &linear->plant;
    const int count = plant->nx * (2 * plant->nx + plant->nu + plant->ny);
    linear->numbers = calloc((size_t)count, sizeof *linear->numbers);
    if (linear->numbers == NULL)
        return error_set(m->error, "%s: out of memory", m->tree->file);
    dse_real *B = read_list(m, "A", linear->numbers);
    dse_real *C = read_list(m, "B", B);
    dse_real *A_sin = read_list(m, "C", C);
    linear->process.linear =
        (struct dse_linear){.A = linear->numbers, .B = plant->nu > 0 ? B : NULL, .C = C};
    if (read_list(m, "A_sin", A_sin) > A_sin)
        linear->process.swing = A_sin;
    return true;
}

/* The swing of A has its frequency, in rad/s, and is nothing without it. */
static bool read_omega(const struct maker *m)
{
    struct scenario_linear_plant *linear = m->linear;
    const char *omega = text_of(m, "omega"), *wrong = NULL;
    double value = 0;
    if (omega != NULL)
        scenario_number(omega, &value, &wrong);
    linear->process.omega = (dse_real)value * linear->plant.time_unit_s;
    if ((omega != NULL) == (linear->process.swing != NULL))
        return true;
    return scenario_fail(m->tree, m->section, "plant.linear", m->error,
                         "A_sin and omega belong together; one of them is missing");
}

/* The initial state of the only parameter set is the operating point. */
static bool read_origin(const struct maker *m)
{
    struct scenario_linear_plant *linear = m->linear;
    if (node_of(m, "origin") == 0)
        return true;
    if (count_of(m, "origin") != linear->plant.nx)
        return scenario_fail(m->tree, node_of(m, "origin"), "plant.linear.origin", m->error,
                             "has %d values; it must have nx = %d, one per state",
                             count_of(m, "origin"), linear->plant.nx);
    read_list(m, "origin", linear->x0);
    for (int i = 0; i < linear->plant.nx; i++)
        linear->states[i].nominal = linear->x0[i];
    linear->process.origin = linear->x0;
    return true;
}

/* Signals x1, x2, .. without unit: nominal value 0, size 1. */
static void name_signals(struct dse_signal *signals, char (*names)[NAME_SIZE], int count,
                         char letter)
{
    for (int i = 0; i < count; i++) {
        snprintf(names[i], NAME_SIZE, "%c%d", letter, i + 1);
        signals[i] =
            (struct dse_signal){.name = names[i], .unit = "", .scale = 1, .title = names[i]};
    }
}

static bool rename_states(const struct maker *m)
{
    static const char allowed[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_";
    struct scenario_linear_plant *linear = m->linear;
    int count = count_of(m, "states");
    if (node_of(m, "states") == 0)
        return true;
    if (count != linear->plant.nx)
        return scenario_fail(m->tree, node_of(m, "states"), "plant.linear.states", m->error,
                             "has %d names; it must have nx = %d", count, linear->plant.nx);
    for (int i = 0; i < count; i++) {
        char path[64];
        const char *name = item_of(m, "states", i);
        int node = scenario_tree_item(m->tree, node_of(m, "states"), i);
        snprintf(path, sizeof path, "plant.linear.states[%d]", i);
        if (name[strspn(name, allowed)] != '\0')
            return scenario_fail(m->tree, node, path, m->error,
                                 "'%s' is not a name: letters, digits and _ only", name);
        for (int other = 0; other < i; other++)
            if (strcmp(linear->state_names[other], name) == 0)
                return scenario_fail(m->tree, node, path, m->error,
                                     "'%s' is the name of states[%d] too", name, other);
        snprintf(linear->state_names[i], NAME_SIZE, "%s", name);
    }
    return true;
}

/* Who measures what. Unless blocks say so no state belongs to a group: what a node estimates is its
 * method's affair. */
static bool cut_groups(const struct maker *m)
{
    struct scenario_linear_plant *linear = m->linear;
    struct dse_plant *plant = &linear->plant;
    const int node = node_of(m, "groups");
    int rows = 0;
    plant->n_subsystems = node != 0 ? count_of(m, "groups") : 1;
    for (int i = 0; i < plant->ny; i++)
        linear->output_index[i] = i;
    for (int g = 0; g < plant->n_subsystems; g++) {
        int count = node != 0 ? atoi(item_of(m, "groups", g)) : plant->ny;
        if (rows + count <= plant->ny)
            linear->groups[g] =
                (struct dse_subsystem){.name = linear->group_names[g],
                                       .states = linear->output_index,
                                       .n_outputs = count,
                                       .outputs = count > 0 ? linear->output_index + rows : NULL};
        snprintf(linear->group_names[g], NAME_SIZE, "group %d", g + 1);
        rows += count;
    }
    if (rows == plant->ny)
        return true;
    return scenario_fail(m->tree, node, "plant.linear.groups", m->error,
                         "counts %d outputs; there are %d, the rows of C", rows, plant->ny);
}

/* Which states belong to which group: consecutive ones. */
static bool cut_states(const struct maker *m)
{
    struct scenario_linear_plant *linear = m->linear;
    const struct dse_plant *plant = &linear->plant;
    const int node = node_of(m, "blocks");
    int states = 0;
    if (node == 0)
        return true;
    if (count_of(m, "blocks") != plant->n_subsystems)
        return scenario_fail(m->tree, node, "plant.linear.blocks", m->error,
                             "has %d values; it must have %d, one per group", count_of(m, "blocks"),
                             plant->n_subsystems);
    for (int i = 0; i < plant->nx; i++)
        linear->state_index[i] = i;
    for (int g = 0; g < plant->n_subsystems; g++) {
        const int count = atoi(item_of(m, "blocks", g));
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

static void set_time(const struct maker *m)
{
    static const struct {
        double seconds;
        const char *unit;
    } units[] = {{1, "s"}, {60, "min"}, {3600, "h"}, {86400, "d"}};
    struct scenario_linear_plant *linear = m->linear;
    const char *time = text_of(m, "time"), *unit = text_of(m, "unit_s"), *wrong = NULL;
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
    plant->prepared_size = (int)HANDLE_SIZE;
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
    const struct maker maker = {.tree = tree, .section = section, .error = error, .linear = linear};
    if (linear == NULL) {
        error_set(error, "%s: out of memory", tree->file);
        return NULL;
    }
    if (read_dimensions(&maker) && read_matrices(&maker)) {
        set_time(&maker);
        fill_plant(linear);
        if (read_omega(&maker) && read_origin(&maker) && rename_states(&maker) &&
            cut_groups(&maker) && cut_states(&maker))
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
