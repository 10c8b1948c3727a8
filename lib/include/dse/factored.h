/* A covariance kept as its factors, so that it cannot lose positive definiteness:
 *
 *     P = T' diag(d) T,   T unit upper triangular (n x n), d (n) >= 0.
 *
 * Row j of T is the j-th column of the lower factor, contiguous in memory. P >= 0 holds for any
 * rounding error in T, because d stays >= 0 by sums and products of non-negative numbers. A
 * singular P (d_j = 0) is allowed everywhere.
 *
 * Rows of T have DSE_FACTORED_STRIDE(n) columns, for the sake of speed. What stands left of the
 * diagonal and right of column n - 1 must be zero and stays zero (fresh memory of an arena is).
 *
 * This is the factorisation of Bierman and Thornton (G. J. Bierman, "Factorization methods for
 * discrete sequential estimation", 1977) in its lower form. */
#ifndef DSE_FACTORED_H
#define DSE_FACTORED_H

#include <stdbool.h>

#include "dse/real.h"
#include "dse/status.h"

/* n, rounded up to a multiple of four. */
#define DSE_FACTORED_STRIDE(n) (((n) + 3) / 4 * 4)
/* Reals of T. */
#define DSE_FACTORED_SIZE(n) ((n)*DSE_FACTORED_STRIDE(n))

/* Rows Y (n x n, stride s >= n) and weights d (n) >= 0 with P = Y' diag(d) Y for a symmetric
 * positive semidefinite P (n x n, upper triangle read), by elimination with pivoting; Y is
 * triangular up to a permutation. What is left below 16 n epsilon of each variance counts as
 * rounding, hence as zero. DSE_ENOTPD when P is indefinite beyond that, DSE_ENONFINITE; Y and d are
 * then undefined. */
enum dse_status dse_semidefinite_rows(int n, int s, const dse_real *P, dse_real *Y, dse_real *d);

/* T, d of a symmetric positive semidefinite P (n x n); same errors. */
#define DSE_FACTORED_FROM_SCRATCH(n) (DSE_FACTORED_SIZE(n) + (n))
enum dse_status dse_factored_from(int n, const dse_real *P, dse_real *T, dse_real *d,
                                  dse_real *scratch);

/* P (n x n, both triangles) = T' diag(d) T. */
void dse_factored_expand(int n, const dse_real *T, const dse_real *d, dse_real *P);

/* The diagonal of P. */
void dse_factored_diagonal(int n, const dse_real *T, const dse_real *d, dse_real *variance);

/* No NaN and no infinity in T or d. */
bool dse_factored_is_finite(int n, const dse_real *T, const dse_real *d);

/* Time update: factors Tp, dp of F P F' + w Q; Q (n x n) positive semidefinite or NULL, w >= 0.
 * Tp may be T and dp may be d. The sum is formed and factored where that loses no more than half of
 * the digits, else weighted Gram-Schmidt (two to three times the work) avoids the sum.
 * DSE_ENONFINITE; DSE_ENOTPD (Q, noticed only where P is nearly singular); Tp and dp are then
 * undefined. */
#define DSE_FACTORED_PREDICT_SCRATCH(n)                                                            \
    (2 * DSE_FACTORED_SIZE(n) + 2 * (n) + 4 * DSE_FACTORED_STRIDE(n))
enum dse_status dse_factored_predict(int n, const dse_real *T, const dse_real *d, const dse_real *Q,
                                     dse_real w, const dse_real *F, dse_real *Tp, dse_real *dp,
                                     dse_real *scratch);

/* G (n x m, rows of DSE_FACTORED_STRIDE(m) columns) = T H', H m x n: what the measurement updates
 * need to know of H. scratch: as large as G. */
void dse_factored_project(int n, int m, const dse_real *T, const dse_real *H, dse_real *G,
                          dse_real *scratch);

/* h' P h for row c of H: the variance of h' x. */
dse_real dse_factored_form(int n, int m, const dse_real *d, const dse_real *G, int c);

/* Measurement update with m outputs y = H x + e of independent noises, var(e_c) = r_c > 0, one
 * after the other. G (n x m) = T H' and the innovations e (m) are overwritten. Results: the factors
 * Tn, dn (Tn may be T, dn may be d), the correction dx (n) of the state, and as value the
 * normalised innovation squared e' (H P H' + R)^-1 e. Nothing is checked: overflow leaves
 * infinities or NaN. */
#define DSE_FACTORED_UPDATE_SCRATCH(n, m)                                                          \
    (2 * (3 * (n) + DSE_FACTORED_STRIDE(n) + DSE_FACTORED_STRIDE(m)) + 2 * (n) + 2)
dse_real dse_factored_update(int n, int m, const dse_real *T, const dse_real *d, dse_real *G,
                             const dse_real *r, dse_real *e, dse_real *Tn, dse_real *dn,
                             dse_real *dx, dse_real *scratch);

#endif
