/* A message for the person at the terminal: what is wrong, where, and what would be right. */
#ifndef DSE_RUNTIME_ERROR_H
#define DSE_RUNTIME_ERROR_H

#include <stdbool.h>

struct error {
    char text[1024]; /* "" as long as nothing went wrong */
};

/* Sets the text unless one is set already: the first cause is the one to report. Returns false, so
 * that a failing function can end with `return error_set(...)`. */
bool error_set(struct error *error, const char *format, ...) __attribute__((format(printf, 2, 3)));

#endif
