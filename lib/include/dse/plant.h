/* A shipped process: its model, the names and units of its signals, its parameters and how it is
 * cut into subsystems. Equations only: integration, noise and faults belong to the simulator.
 *
 * To add a plant: one file in lib/plants/ that defines a `const struct dse_plant`, one line in
 * lib/plants/registry.c. */
#ifndef DSE_PLANT_H
#define DSE_PLANT_H

#include "dse/model.h"
#include "dse/normal_form.h"
#include "dse/real.h"
#include "dse/status.h"

/* A state, input or output. */
struct dse_signal {
    const char *name;  /* short, unique within the plant: "T1" */
    const char *unit;  /* "K", "kmol/m3"; "" if none */
    dse_real nominal;  /* initial value of a state or constant value of an input, from the source */
    dse_real scale;    /* size of an ordinary deviation, for plots, tolerances and scaling; > 0 */
    const char *title; /* "temperature of reactor 1" */
};

/* A physical parameter that a scenario may change, in the simulator and the estimators apart. */
struct dse_parameter {
    const char *name; /* "F_r" */
    const char *unit; /* "m3/h" */
    dse_real min;     /* smallest and largest allowed value */
    dse_real max;
    const char *title;
};

/* A named set of parameter values and initial states: one operating case of the source. */
struct dse_parameter_set {
    const char *name;       /* "ch2" */
    const char *title;      /* "section 2.6" */
    const dse_real *values; /* n_parameters */
    const dse_real *x0;     /* nx: true initial state of the source's experiment */
};

/* Who measures and estimates what: subsystem i of the plant's natural decomposition. */
struct dse_subsystem {
    const char *name;   /* "reactor 1" */
    int n_states;       /* own states */
    const int *states;  /* indices into the plant's states */
    int n_outputs;      /* own sensors */
    const int *outputs; /* indices into the plant's outputs */
};

struct dse_plant {
    const char *name;      /* "cstr2" */
    const char *title;     /* "two CSTRs with recycle" */
    const char *source;    /* where it comes from */
    const char *time_unit; /* "h" */
    dse_real time_unit_s;  /* seconds in one unit of plant time: 3600 for hours */

    int nx, nu, ny;
    const struct dse_signal *states;  /* nx */
    const struct dse_signal *inputs;  /* nu */
    const struct dse_signal *outputs; /* ny */
    int n_unknown; /* so many inputs, the last ones, are disturbances: estimators are not told their
                    * values and get the nominal ones */

    int n_parameters;
    const struct dse_parameter *parameters;
    int n_sets; /* >= 1; the first is the default */
    const struct dse_parameter_set *sets;

    int n_subsystems;
    const struct dse_subsystem *subsystems;

    /* Size in reals of what `prepare` makes of the parameter values (derived constants). */
    int prepared_size;
    /* Computes derived constants from n_parameters values; DSE_EINVAL when they make no plant.
     * Functions of the model and the normal form find `prepared` as their parameters pointer.
     * NULL in a plant without parameters whose constants are known: they are copied then. */
    enum dse_status (*prepare)(const dse_real *values, dse_real *prepared);
    const dse_real *constants; /* prepared_size; NULL where there is a prepare */
    /* Fills the model; prepared must outlive it. */
    void (*model)(const dse_real *prepared, struct dse_model *model);
    /* Fills the normal form; NULL when the plant has none. Where the parameters are such that there
     * is none, its maps are NULL and only the sizes are filled. */
    void (*normal_form)(const dse_real *prepared, struct dse_normal_form *form);
    /* Of a descriptor plant E x' = g(t, x, u) with singular E: puts the states that an algebraic
     * equation ties to the other ones and the inputs into x. The model's f does without them and
     * gives 0 for their derivatives, its outputs are of the completed state. NULL: none is tied. */
    void (*complete)(const dse_real *prepared, dse_real t, const dse_real *u, dse_real *x);
};

/* The largest prepared_size, nx, nu, ny of all shipped plants and generous bounds for one's own. */
#define DSE_PLANT_MAX_STATES     160
#define DSE_PLANT_MAX_INPUTS     32
#define DSE_PLANT_MAX_OUTPUTS    256
#define DSE_PLANT_MAX_PARAMETERS 128

/* The plant called `name`, or NULL. */
const struct dse_plant *dse_plant_find(const char *name);
/* The i-th shipped plant, NULL past the last: for listing what there is. */
const struct dse_plant *dse_plant_at(int i);

#endif
