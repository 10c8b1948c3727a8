/* A covariance kept as its factors, so that it cannot lose positive definiteness:
 *
 *     P = T' diag(d) T,   T (n x n) unit upper triangular, row-major; d (n) >= 0.
 *
 * Row j of T is the j-th column of the lower factor, contiguous in memory; what stands left of the
 * diagonal is never read. P >= 0 holds for any rounding error in T, because d stays >= 0 by
 * sums and products of non-negative numbers. A singular P (d_j = 0) is allowed everywhere.
 *
 * This is the factorisation of Bierman and Thornton (G. J. Bierman, "Factorization methods for
 * discrete sequential estimation", 1977) in its lower form. */
#ifndef DSE_FACTORED_H
#define DSE_FACTORED_H

#include <stdbool.h>

#include "dse/real.h"
#include "dse/status.h"

/* Rows Y (n x n) and weights d (n) >= 0 with P = Y' diag(d) Y for a symmetric positive semidefinite
 * P (upper triangle read), by elimination with pivoting; Y is triangular up to a permutation. What
 * is left below 16 n epsilon of each variance counts as rounding, hence as zero. DSE_ENOTPD when
 * P is indefinite beyond that, DSE_ENONFINITE; Y and d are then undefined. */
enum dse_status dse_semidefinite_rows(int n, const dse_real *P, dse_real *Y, dse_real *d);

/* T, d of a symmetric positive semidefinite P; same errors. scratch: n (n + 1). */
#define DSE_FACTORED_FROM_SCRATCH(n) ((n) * ((n) + 1))
enum dse_status dse_factored_from(int n, const dse_real *P, dse_real *T, dse_real *d,
                                  dse_real *scratch);

/* P (n x n, both triangles) = T' diag(d) T. */
void dse_factored_expand(int n, const dse_real *T, const dse_real *d, dse_real *P);

/* The diagonal of P. */
void dse_factored_diagonal(int n, const dse_real *T, const dse_real *d, dse_real *variance);

/* No NaN and no infinity in T or d. */
bool dse_factored_is_finite(int n, const dse_real *T, const dse_real *d);

/* Time update: factors Tp, dp of F P F' + w Q; Q (n x n) positive semidefinite or NULL, w >= 0.
 * Tp may be T and dp may be d. FS is F (n x n) followed by DSE_FACTORED_PREDICT_SCRATCH(n) reals;
 * all of it is overwritten. DSE_ENONFINITE; DSE_ENOTPD (Q, noticed only where P is nearly
 * singular); Tp and dp are then undefined. */
#define DSE_FACTORED_PREDICT_SCRATCH(n) ((n) * (n) + 2 * (n))
enum dse_status dse_factored_predict(int n, const dse_real *T, const dse_real *d, const dse_real *Q,
                                     dse_real w, dse_real *FS, dse_real *Tp, dse_real *dp);

/* Measurement update with one scalar y = h' x + e, var(e) = r > 0, in place. Returns the variance
 * of the innovation s = h' P h + r and leaves v = P h (prior P) in v (n): the gain is v / s.
 * scratch: 3 n. */
#define DSE_FACTORED_UPDATE_SCRATCH(n) (3 * (n))
dse_real dse_factored_update(int n, dse_real *T, dse_real *d, const dse_real *h, dse_real r,
                             dse_real *v, dse_real *scratch);

/* h' P h. */
dse_real dse_factored_form(int n, const dse_real *T, const dse_real *d, const dse_real *h);

#endif
