/* The shipped plants by the names that reference files give them. */
#ifndef SHIPPED_PLANT_H
#define SHIPPED_PLANT_H

#include "dse/plant.h"

/* A shipped plant that a file speaks of, ready for use. */
struct golden_plant {
    const struct dse_plant *plant;
    const struct dse_parameter_set *set;
    double *prepared;
    struct dse_model model;
    struct dse_normal_form form;
    double nominal_u[DSE_PLANT_MAX_INPUTS];
};
/* By the reference's name ("2cstr_ch2"); GOLDEN_UNSUPPORTED when dse does not ship it. */
int golden_plant_load(struct golden_plant *out, const char *name);
void golden_plant_free(struct golden_plant *plant);

#endif
