/* Between the parts that make the plant called linear: what they make, and what they make it of. */
#ifndef DSE_RUNTIME_SCENARIO_LINEAR_INTERNAL_H
#define DSE_RUNTIME_SCENARIO_LINEAR_INTERNAL_H

#include "runtime/scenario_internal.h"

#define LINEAR_NAME_SIZE   32
#define LINEAR_HANDLE_SIZE ((sizeof(void *) + sizeof(dse_real) - 1) / sizeof(dse_real))

struct scenario_linear_plant {
    struct dse_plant plant;
    struct dse_linear_process process;
    enum dse_time_kind time;
    dse_real *numbers;                   /* A, B, C, A_sin one after the other */
    dse_real handle[LINEAR_HANDLE_SIZE]; /* the plant's constants: the address of this structure */
    dse_real x0[DSE_PLANT_MAX_STATES];
    struct dse_parameter_set set;
    char time_unit[LINEAR_NAME_SIZE];
    struct dse_signal states[DSE_PLANT_MAX_STATES];
    struct dse_signal inputs[DSE_PLANT_MAX_INPUTS];
    struct dse_signal outputs[DSE_PLANT_MAX_OUTPUTS];
    char state_names[DSE_PLANT_MAX_STATES][LINEAR_NAME_SIZE];
    char input_names[DSE_PLANT_MAX_INPUTS][LINEAR_NAME_SIZE];
    char output_names[DSE_PLANT_MAX_OUTPUTS][LINEAR_NAME_SIZE];
    struct dse_subsystem groups[DSE_PLANT_MAX_OUTPUTS];
    char group_names[DSE_PLANT_MAX_OUTPUTS][LINEAR_NAME_SIZE];
    int output_index[DSE_PLANT_MAX_OUTPUTS]; /* 0, 1, ..: groups are consecutive rows of C */
    int state_index[DSE_PLANT_MAX_STATES];   /* likewise */
};

/* The section in the tree while the plant is made. */
struct linear_maker {
    struct scenario_tree *tree;
    int section;
    struct error *error;
    struct scenario_linear_plant *linear;
};

/* ---- scenario_linear_numbers.c ---- */

/* The node of a key of plant.linear, 0 where it is left out; the text of a scalar there, NULL
 * without; the number of entries of a list, 0 without; one of them. */
int linear_node(const struct linear_maker *m, const char *key);
const char *linear_text(const struct linear_maker *m, const char *key);
int linear_count(const struct linear_maker *m, const char *key);
const char *linear_item(const struct linear_maker *m, const char *key, int i);

/* Dimensions and matrices: nx, nu, ny (the number of rows of C), A, B, C, A_sin. */
bool linear_read_matrices(const struct linear_maker *m);
/* Around which point and how fast it swings, once the unit of time and the states are there. */
bool linear_read_point(const struct linear_maker *m);

#endif
