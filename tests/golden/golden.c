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

static int check_path(const char *path, int (*check)(const json_t *root))
{
    json_error_t error;
    json_t *root = json_load_file(path, 0, &error);
    printf("%s\n", path);
    if (root == NULL) {
        printf("  line %d: %s\n", error.line, error.text);
        return GOLDEN_FAIL;
    }
    const int result = check(root);
    if (result == GOLDEN_UNSUPPORTED)
        printf("  this layout is not supported\n");
    json_decref(root);
    return result;
}

int golden_main(int argc, char **argv, int (*check)(const json_t *root))
{
    int worst = GOLDEN_PASS;
    if (argc < 2) {
        fprintf(stderr, "usage: %s FILE.json ...\n", argv[0]);
        return GOLDEN_FAIL;
    }
    for (int k = 1; k < argc; k++) {
        const int result = check_path(argv[k], check);
        if (worst != GOLDEN_FAIL && result != GOLDEN_PASS)
            worst = result;
    }
    return worst;
}
