/* Reading reference files and judging deviations. */
#include "golden.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Fills out (or only counts when out is NULL) depth first, without recursion: the files nest at
 * most four deep. */
static int flatten(const json_t *array, double *out)
{
    enum { DEPTH = 8 };
    const json_t *level[DEPTH] = {array};
    size_t index[DEPTH] = {0};
    int depth = 0, count = 0;
    while (depth >= 0) {
        const json_t *item = json_array_get(level[depth], index[depth]++);
        if (item == NULL) {
            depth--;
        } else if (json_is_array(item) && depth + 1 < DEPTH) {
            depth++;
            level[depth] = item;
            index[depth] = 0;
        } else {
            if (out != NULL) {
                out[count] = json_number_value(item);
            }
            count++;
        }
    }
    return count;
}

double *golden_numbers(const json_t *array, int *count)
{
    *count = flatten(array, NULL);
    double *numbers = calloc((size_t)*count + 1, sizeof *numbers);
    if (numbers == NULL) {
        fprintf(stderr, "out of memory\n");
        exit(GOLDEN_FAIL);
    }
    flatten(array, numbers);
    return numbers;
}

double golden_number(const json_t *object, const char *key, double otherwise)
{
    const json_t *value = json_object_get(object, key);
    return json_is_number(value) ? json_number_value(value) : otherwise;
}

int golden_is(const json_t *object, const char *key, const char *text)
{
    const char *value = json_string_value(json_object_get(object, key));
    return value != NULL && strcmp(value, text) == 0;
}

int golden_compare_numbers(const char *name, int rows, int columns, const double *got,
                           const double *want, double tolerance)
{
    double worst = 0;
    int finite = 1;
    for (int c = 0; c < columns; c++) {
        double largest = 0;
        for (int r = 0; r < rows; r++) {
            largest = fmax(largest, fabs(want[r * columns + c]));
        }
        for (int r = 0; r < rows; r++) {
            const int k = r * columns + c;
            const double scale = fmax(fabs(want[k]), 1e-3 * largest);
            const double deviation = fabs(got[k] - want[k]);
            finite = finite && isfinite(got[k]) && isfinite(want[k]);
            if (deviation > 0) {
                worst = fmax(worst, scale > 0 ? deviation / scale : INFINITY);
            }
        }
    }
    const int pass = finite && worst <= tolerance;
    printf("  %-18s %6d x %-4d deviation %9.2e  tolerance %7.1e  %s\n", name, rows, columns,
           finite ? worst : NAN, tolerance, pass ? "ok" : "FAILED");
    return pass ? GOLDEN_PASS : GOLDEN_FAIL;
}

int golden_compare_as(const char *name, const json_t *object, const char *key, int rows,
                      int columns, const double *got, double tolerance)
{
    int count;
    double *want = golden_numbers(json_object_get(object, key), &count);
    int result = GOLDEN_FAIL;
    if (count != rows * columns || count == 0) {
        printf("  %-18s %d numbers in the file, %d x %d expected  FAILED\n", name, count, rows,
               columns);
    } else {
        result = golden_compare_numbers(name, rows, columns, got, want, tolerance);
    }
    free(want);
    return result;
}

int golden_compare(const json_t *object, const char *key, int rows, int columns, const double *got,
                   double tolerance)
{
    return golden_compare_as(key, object, key, rows, columns, got, tolerance);
}

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
