/* The numbers of the plant called linear, from plant.linear in the scenario. */
#include <stdlib.h>
#include <string.h>

#include "runtime/scenario_linear_internal.h"

int linear_node(const struct linear_maker *m, const char *key)
{
    const yaml_node_pair_t *pair = scenario_tree_pair(m->tree, m->section, key);
    return pair != NULL ? pair->value : 0;
}

const char *linear_text(const struct linear_maker *m, const char *key)
{
    int node = linear_node(m, key);
    return node != 0 ? scenario_tree_text(m->tree, node) : NULL;
}

int linear_count(const struct linear_maker *m, const char *key)
{
    int node = linear_node(m, key);
    return node != 0 ? scenario_tree_count(m->tree, node) : 0;
}

const char *linear_item(const struct linear_maker *m, const char *key, int i)
{
    return scenario_tree_text(m->tree, scenario_tree_item(m->tree, linear_node(m, key), i));
}

static bool fail_count(const struct linear_maker *m, const char *key, int wanted, const char *what,
                       int rows, int columns)
{
    char path[SCENARIO_PATH_SIZE];
    snprintf(path, sizeof path, "plant.linear.%s", key);
    return scenario_fail(m->tree, scenario_tree_find(m->tree, path), path, m->error,
                         "has %d values; it must have %d: %s = %d x %d, row by row",
                         linear_count(m, key), wanted, what, rows, columns);
}

/* nx, nu, ny; ny is the number of rows of C. */
static bool read_dimensions(const struct linear_maker *m)
{
    struct dse_plant *plant = &m->linear->plant;
    const char *nu = linear_text(m, "nu"), *unknown = linear_text(m, "unknown");
    plant->nx = atoi(linear_text(m, "nx"));
    plant->nu = nu != NULL ? atoi(nu) : 0;
    plant->n_unknown = unknown != NULL ? atoi(unknown) : 0;
    if (plant->n_unknown > plant->nu)
        return scenario_fail(m->tree, linear_node(m, "unknown"), "plant.linear.unknown", m->error,
                             "%d of nu = %d inputs cannot be unknown", plant->n_unknown, plant->nu);
    int count = linear_count(m, "C");
    plant->ny = count / plant->nx;
    if (linear_count(m, "A") != plant->nx * plant->nx)
        return fail_count(m, "A", plant->nx * plant->nx, "nx x nx", plant->nx, plant->nx);
    if (linear_count(m, "B") != plant->nx * plant->nu)
        return fail_count(m, "B", plant->nx * plant->nu, "nx x nu", plant->nx, plant->nu);
    if (linear_node(m, "A_sin") != 0 && linear_count(m, "A_sin") != plant->nx * plant->nx)
        return fail_count(m, "A_sin", plant->nx * plant->nx, "nx x nx", plant->nx, plant->nx);
    if (count % plant->nx != 0)
        return scenario_fail(m->tree, linear_node(m, "C"), "plant.linear.C", m->error,
                             "has %d values; it must have whole rows of nx = %d, one per output",
                             count, plant->nx);
    if (plant->ny > DSE_PLANT_MAX_OUTPUTS)
        return scenario_fail(m->tree, linear_node(m, "C"), "plant.linear.C", m->error,
                             "has %d rows; it must have 1 to %d, one per output", plant->ny,
                             DSE_PLANT_MAX_OUTPUTS);
    return true;
}

/* The numbers of a list in their order; where the next list goes. */
static dse_real *read_list(const struct linear_maker *m, const char *key, dse_real *to)
{
    int count = linear_count(m, key);
    const char *wrong = NULL;
    for (int i = 0; i < count; i++) {
        double value = 0;
        if (scenario_number(linear_item(m, key, i), &value, &wrong))
            *to++ = (dse_real)value;
    }
    return to;
}

static bool read_lists(const struct linear_maker *m)
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
static bool read_omega(const struct linear_maker *m)
{
    struct scenario_linear_plant *linear = m->linear;
    const char *omega = linear_text(m, "omega"), *wrong = NULL;
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
static bool read_origin(const struct linear_maker *m)
{
    struct scenario_linear_plant *linear = m->linear;
    if (linear_node(m, "origin") == 0)
        return true;
    if (linear_count(m, "origin") != linear->plant.nx)
        return scenario_fail(m->tree, linear_node(m, "origin"), "plant.linear.origin", m->error,
                             "has %d values; it must have nx = %d, one per state",
                             linear_count(m, "origin"), linear->plant.nx);
    read_list(m, "origin", linear->x0);
    for (int i = 0; i < linear->plant.nx; i++)
        linear->states[i].nominal = linear->x0[i];
    linear->process.origin = linear->x0;
    return true;
}

bool linear_read_matrices(const struct linear_maker *m)
{
    return read_dimensions(m) && read_lists(m);
}

bool linear_read_point(const struct linear_maker *m)
{
    return read_omega(m) && read_origin(m);
}
