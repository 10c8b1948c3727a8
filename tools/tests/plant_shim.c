/* Functions of two plants behind one entry, for tests through ctypes: MADE is a generated plant,
 * the other one is a shipped plant, found by name. */
#include <stddef.h>
#include <string.h>

#include "dse/plant.h"

enum { MOST = 4096 };

extern const struct dse_plant MADE;

static const struct dse_plant *plant_of(const char *shipped)
{
    return shipped == NULL ? &MADE : dse_plant_find(shipped);
}

/* Size of the plant: nx, nu, ny, blocks, parameters, sets; 0 when there is none. */
int shim_sizes(const char *shipped, int *sizes);
int shim_sizes(const char *shipped, int *sizes)
{
    const struct dse_plant *plant = plant_of(shipped);
    if (plant == NULL) {
        return 0;
    }
    const int found[] = {plant->nx,           plant->nu,           plant->ny,
                         plant->n_subsystems, plant->n_parameters, plant->n_sets};
    memcpy(sizes, found, sizeof found);
    return 1;
}

/* out = the function called `what` at x (or z), u and, for push, dx; values: parameters, or NULL
 * for those of the set. Answers the status. */
int shim_call(const char *shipped, int set, const dse_real *values, const char *what, int i,
              dse_real t, const dse_real *x, const dse_real *u, const dse_real *dx, dse_real *out);
int shim_call(const char *shipped, int set, const dse_real *values, const char *what, int i,
              dse_real t, const dse_real *x, const dse_real *u, const dse_real *dx, dse_real *out)
{
    static dse_real prepared[MOST];
    const struct dse_plant *plant = plant_of(shipped);
    if (plant == NULL || plant->prepared_size > MOST) {
        return DSE_EDIM;
    }
    enum dse_status status =
        plant->prepare(values == NULL ? plant->sets[set].values : values, prepared);
    if (status != DSE_OK || strcmp(what, "prepare") == 0) {
        return status;
    }
    struct dse_model m;
    struct dse_normal_form form;
    memset(&form, 0, sizeof form);
    plant->model(prepared, &m);
    plant->normal_form(prepared, &form);
    if (strcmp(what, "f") == 0) {
        return m.f(&m, t, x, u, out);
    }
    if (strcmp(what, "h") == 0) {
        return m.h(&m, t, x, u, out);
    }
    if (strcmp(what, "dfdx") == 0) {
        return m.dfdx(&m, t, x, u, out);
    }
    if (strcmp(what, "dhdx") == 0) {
        return m.dhdx(&m, t, x, u, out);
    }
    if (strcmp(what, "encode") == 0) {
        return form.encode(&form, t, x, u, out);
    }
    if (strcmp(what, "decode") == 0) {
        return form.decode(&form, t, x, u, out);
    }
    if (strcmp(what, "field") == 0) {
        return form.field(&form, t, x, u, out);
    }
    if (strcmp(what, "jacobian") == 0) {
        return form.jacobian(&form, i, t, x, u, out);
    }
    if (strcmp(what, "map_jacobian") == 0) {
        return form.map_jacobian(&form, i, t, x, u, out);
    }
    if (strcmp(what, "push") == 0) {
        return form.push(&form, t, x, u, dx, out);
    }
    if (strcmp(what, "field_jacobian") == 0) {
        return form.field_jacobian(&form, t, x, u, out);
    }
    return DSE_EINVAL;
}
