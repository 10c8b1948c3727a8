/* A shipped plant by the name that reference files give it. */
#include "shipped_plant.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "golden.h"

int golden_plant_load(struct golden_plant *out, const char *name)
{
    static const struct {
        const char *reference, *plant, *set;
    } names[] = {
        {"2cstr_ch2", "cstr2", "ch2"},
        {"2cstr_ch4", "cstr2", "ch4"},
        {"4cstr", "cstr4", NULL},
        {"threetank", "three_tank", "identified"},
        {"threetank_rig", "three_tank", "rig"},
    };
    *out = (struct golden_plant){0};
    for (size_t k = 0; name != NULL && k < sizeof names / sizeof names[0]; k++) {
        if (strcmp(names[k].reference, name) != 0) {
            continue;
        }
        out->plant = dse_plant_find(names[k].plant);
        for (int s = 0; out->plant != NULL && s < out->plant->n_sets; s++) {
            const char *set = out->plant->sets[s].name;
            if (out->set == NULL && (names[k].set == NULL || strcmp(names[k].set, set) == 0)) {
                out->set = &out->plant->sets[s];
            }
        }
    }
    if (out->plant == NULL || out->set == NULL) {
        printf("  the plant '%s' is not supported\n", name != NULL ? name : "(none)");
        return GOLDEN_UNSUPPORTED;
    }
    out->prepared = calloc((size_t)out->plant->prepared_size, sizeof *out->prepared);
    if (out->prepared == NULL || out->plant->prepare(out->set->values, out->prepared) != DSE_OK) {
        printf("  plant '%s' cannot be prepared\n", out->plant->name);
        golden_plant_free(out);
        return GOLDEN_FAIL;
    }
    out->plant->model(out->prepared, &out->model);
    out->plant->normal_form(out->prepared, &out->form);
    for (int k = 0; k < out->plant->nu; k++) {
        out->nominal_u[k] = out->plant->inputs[k].nominal;
    }
    return GOLDEN_PASS;
}

void golden_plant_free(struct golden_plant *plant)
{
    free(plant->prepared);
    plant->prepared = NULL;
}
