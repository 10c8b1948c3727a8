/* Reading reference files and judging deviations, for all runners. */
#ifndef GOLDEN_H
#define GOLDEN_H

#include <jansson.h>

/* Answers of a part, and exit codes of the runner. */
enum { GOLDEN_PASS = 0, GOLDEN_FAIL = 1, GOLDEN_UNSUPPORTED = 2 };

/* All numbers inside a (nested) array in reading order; the caller frees. *count is their number.
 */
double *golden_numbers(const json_t *array, int *count);
/* The number called key, or `otherwise` when there is none. */
double golden_number(const json_t *object, const char *key, double otherwise);
/* True when object[key] is the string `text`. */
int golden_is(const json_t *object, const char *key, const char *text);

/* Largest deviation of got (rows x columns) from the reference object[key], each relative to the
 * reference value or, for small ones, to a thousandth of the largest in its column. Prints a line
 * and returns GOLDEN_PASS or GOLDEN_FAIL; a reference of another size is a failure. */
int golden_compare(const json_t *object, const char *key, int rows, int columns, const double *got,
                   double tolerance);
/* The same with another name in the printed line. */
int golden_compare_as(const char *name, const json_t *object, const char *key, int rows,
                      int columns, const double *got, double tolerance);
/* The same against numbers in memory. */
int golden_compare_numbers(const char *name, int rows, int columns, const double *got,
                           const double *want, double tolerance);

/* What every runner does: reads the files that argv names, calls `check` for each and returns the
 * exit code; a deviation weighs more than a file that nothing can be said about. */
int golden_main(int argc, char **argv, int (*check)(const json_t *root));

#endif
