/* What a case prints: lines "name bits" with the 16 hexadecimal digits of an IEEE double, so that
 * two machines' outputs are equal exactly when their numbers are. No printf: a microcontroller
 * image without it also shows that the library needs none. */
#ifndef REPORT_H
#define REPORT_H

#include <stdint.h>

#include "dse/real.h"

/* "name 0123456789abcdef". */
void report_bits(const char *name, uint64_t bits);

/* The bits of a value; every NaN is reported as "nan", because processors differ in the sign and
 * payload of the NaN that an invalid operation makes. */
void report_real(const char *name, dse_real value);

/* "name[0] ..", "name[1] ..", n lines. */
void report_vector(const char *name, int n, const dse_real *x);

/* One line for many values: "name digest", where the digest (FNV-1a) covers the bits of all n. */
void report_digest(const char *name, int n, const dse_real *x);

/* "name 42" in decimal, for counts and status codes. */
void report_int(const char *name, int value);

/* Counts a failure and prints "FAILED name" unless `holds`. */
void report_check(const char *name, int holds);

/* What main() returns: 0 when every check held, 1 otherwise. Prints the verdict. */
int report_verdict(void);

#endif
