/* The shipped plants. A new one is one file, one declaration and one line here. */
#include <stddef.h>

#include "dse/plant.h"

extern const struct dse_plant dse_plant_cavity_forced;
extern const struct dse_plant dse_plant_cavity_free;
extern const struct dse_plant dse_plant_cstr2;
extern const struct dse_plant dse_plant_cstr4;
extern const struct dse_plant dse_plant_descriptor_fo;
extern const struct dse_plant dse_plant_descriptor_uio;
extern const struct dse_plant dse_plant_quadratic_ex3;
extern const struct dse_plant dse_plant_quadratic_ex4;
extern const struct dse_plant dse_plant_quadratic_ex4_ring;
extern const struct dse_plant dse_plant_sep3;
extern const struct dse_plant dse_plant_three_tank;

static const struct dse_plant *const shipped[] = {
    &dse_plant_cavity_forced, &dse_plant_cavity_free,   &dse_plant_cstr2,
    &dse_plant_cstr4,         &dse_plant_descriptor_fo, &dse_plant_descriptor_uio,
    &dse_plant_quadratic_ex3, &dse_plant_quadratic_ex4, &dse_plant_quadratic_ex4_ring,
    &dse_plant_sep3,          &dse_plant_three_tank,
};

const struct dse_plant *dse_plant_at(int i)
{
    const int count = (int)(sizeof shipped / sizeof shipped[0]);
    return i >= 0 && i < count ? shipped[i] : NULL;
}

static int same_name(const char *a, const char *b)
{
    while (*a != '\0' && *a == *b) {
        a++;
        b++;
    }
    return *a == *b;
}

const struct dse_plant *dse_plant_find(const char *name)
{
    if (name == NULL) {
        return NULL;
    }
    for (int i = 0; dse_plant_at(i) != NULL; i++) {
        if (same_name(dse_plant_at(i)->name, name)) {
            return dse_plant_at(i);
        }
    }
    return NULL;
}
