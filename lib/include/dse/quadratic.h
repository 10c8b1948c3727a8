/* Quadratic systems: the class of Galerkin models of flows,
 *
 *     x' = d + A x + q(x) (+ B u),   q_k(x) = x'F_k x,   y = C x            (3.44)-(3.47)
 *
 * of the consensus-based second-order observers' source (d and B are extensions). The forms F_k
 * are kept as terms value x_i x_j, i <= j: this is the symmetric F_k whatever way it was written,
 * costs what is not zero, and serves sums, Jacobian and trace alike. */
#ifndef DSE_QUADRATIC_H
#define DSE_QUADRATIC_H

#include <stdbool.h>

#include "dse/model.h"
#include "dse/real.h"
#include "dse/status.h"

/* q_k has the term value x_i x_j: value = F_k[i][j] + F_k[j][i], or F_k[i][i]. */
struct dse_quadratic_term {
    int k, i, j; /* i <= j */
    dse_real value;
};

struct dse_quadratic {
    const dse_real *A; /* nx x nx */
    const dse_real *d; /* nx; NULL: zero */
    const dse_real *B; /* nx x nu; NULL when nu = 0 */
    const dse_real *C; /* ny x nx */
    int terms;
    const struct dse_quadratic_term *term; /* terms */
};

/* Terms that n forms of n x n can have. */
#define DSE_QUADRATIC_MAX_TERMS(n) ((n) * (n) * ((n) + 1) / 2)

/* The terms of F (n x n x n: F[k][i][j]), which need not be symmetric; zeros are left out. Returns
 * how many there are; `term` gets those that fit into `capacity`. */
int dse_quadratic_terms(int n, const dse_real *F, int capacity, struct dse_quadratic_term *term);

/* DSE_EINVAL: an index outside the state, i > j. DSE_ENONFINITE. */
enum dse_status dse_quadratic_check(int nx, int nu, int ny, const struct dse_quadratic *system);

/* Fills a continuous `model`; `system` and what it points to must outlive it. */
void dse_quadratic_model(struct dse_model *model, int nx, int nu, int ny,
                         const struct dse_quadratic *system);
/* The system of such a model; NULL for any other one. */
const struct dse_quadratic *dse_quadratic_of(const struct dse_model *model);

/* dx += q(x). */
void dse_quadratic_add(const struct dse_quadratic *system, const dse_real *x, dse_real *dx);
/* J (nx x nx) += dq/dx = 2 sum_k e_k x'F_k. */
void dse_quadratic_add_jacobian(int nx, const struct dse_quadratic *system, const dse_real *x,
                                dse_real *J);
/* dx += sum_k e_k tr(F_k S): what a covariance S (nx x nx, symmetric) around x adds to the mean of
 * q, the second-order term of (3.48). */
void dse_quadratic_add_trace(int nx, const struct dse_quadratic *system, const dse_real *S,
                             dse_real *dx);

/* |F| = sqrt(sum of all F_k[i][j]^2): |q(x)| <= |F| |x|^2. */
dse_real dse_quadratic_norm(const struct dse_quadratic *system);

/* Certificate of stability of x' = A x + q(x): with V = |x|^2 / 2 and both properties
 * V' = x'(A + A')x / 2 <= 0, and the second-order predictor's |w|^2 + tr S cannot grow either. */
struct dse_quadratic_certificate {
    bool dissipative; /* no eigenvalue of (A + A')/2 is positive, to rounding */
    bool lossless;    /* x'q(x) = 0 for all x, to rounding */
    /* Largest coefficient of the cubic x'q(x), relative to the largest term of q. */
    dse_real cubic;
};

/* Reals of scratch. */
#define DSE_QUADRATIC_CERTIFICATE_SCRATCH(n) (2 * (n) * (n) + (n))
/* DSE_ENONFINITE. The effort grows with the square of the number of terms: a check for the desk. */
enum dse_status dse_quadratic_certify(int nx, const struct dse_quadratic *system,
                                      struct dse_quadratic_certificate *certificate,
                                      dse_real *scratch);

#endif
