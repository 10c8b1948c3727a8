/* Small dense linear algebra: row-major, contiguous, fixed summation order, no allocation.
 * "lower" kernels read and write only the lower triangle of a symmetric matrix unless they say
 * that they fill both. No output aliases an input unless the comment says that it may. */
#ifndef DSE_LINALG_H
#define DSE_LINALG_H

#include "dse/real.h"
#include "dse/status.h"

/* ---- products (lib/linalg/product.c) ---- */

/* C (m x n) = A (m x k) B (k x n). */
void dse_mat_mul(int m, int k, int n, const dse_real *A, const dse_real *B, dse_real *C);
/* C (m x n) = D + A B and D - A B; D may be C. */
void dse_mat_mul_add(int m, int k, int n, const dse_real *A, const dse_real *B, const dse_real *D,
                     dse_real *C);
void dse_mat_mul_subtract(int m, int k, int n, const dse_real *A, const dse_real *B,
                          const dse_real *D, dse_real *C);
/* C (m x n) = A (m x k) B', B is n x k. */
void dse_mat_mul_nt(int m, int k, int n, const dse_real *A, const dse_real *B, dse_real *C);
/* C (m x n) = A' B, A is k x m, B is k x n. */
void dse_mat_mul_tn(int m, int k, int n, const dse_real *A, const dse_real *B, dse_real *C);
/* y (m) = A (m x n) x. */
void dse_mat_vec(int m, int n, const dse_real *A, const dse_real *x, dse_real *y);
/* y (n) = A' x, A is m x n. */
void dse_mat_tvec(int m, int n, const dse_real *A, const dse_real *x, dse_real *y);
/* y (m) = z + A x and y (n) = z + A' x; z may be y. */
void dse_mat_vec_add(int m, int n, const dse_real *A, const dse_real *x, const dse_real *z,
                     dse_real *y);
void dse_mat_tvec_add(int m, int n, const dse_real *A, const dse_real *x, const dse_real *z,
                      dse_real *y);
dse_real dse_dot(int n, const dse_real *x, const dse_real *y);
/* y += a x. */
void dse_axpy(int n, dse_real a, const dse_real *x, dse_real *y);
/* B (n x m) = A', A is m x n. */
void dse_mat_transpose(int m, int n, const dse_real *A, dse_real *B);
void dse_mat_identity(int n, dse_real *A);
/* Euclidean norm, safe against overflow. */
dse_real dse_norm2(int n, const dse_real *x);
/* Largest absolute entry. */
dse_real dse_norm_max(int n, const dse_real *x);

/* ---- symmetric kernels (lib/linalg/symmetric.c); they fill both triangles ---- */

/* S (m x m) = A P A' + Q, A m x n, P n x n symmetric, Q m x m symmetric or NULL.
 * scratch: m x n. About three quarters of the work of two general products. S may be P when
 * m = n, and may be Q. */
void dse_sym_congruence(int m, int n, const dse_real *A, const dse_real *P, const dse_real *Q,
                        dse_real *S, dse_real *scratch);
/* S (n x n) += a v v'. */
void dse_sym_rank1(int n, dse_real a, const dse_real *v, dse_real *S);
/* S = (S + S') / 2. */
void dse_sym_enforce(int n, dse_real *S);
/* Whether S can be a covariance as far as a look tells: finite (DSE_ENONFINITE) and with triangles
 * that agree but for rounding, half of the digits relative to the variances (DSE_EINVAL). */
enum dse_status dse_sym_check(int n, const dse_real *S);
/* Reals of a packed symmetric matrix: its lower triangle by rows. */
#define DSE_SYM_PACKED(n) ((n) * ((n) + 1) / 2)
/* packed = lower triangle of S (n x n); and S of packed. */
void dse_sym_pack(int n, const dse_real *S, dse_real *packed);
void dse_sym_unpack(int n, const dse_real *packed, dse_real *S);

/* ---- factorisations and solves (lib/linalg/cholesky.c, ldl.c, lu.c, qr.c) ---- */

/* A = L L'; reads the lower triangle of A, writes L (strict upper triangle zero). L may be A.
 * On failure L is undefined.
 * DSE_ENOTPD when a pivot is not positive (or not finite). */
enum dse_status dse_cholesky(int n, const dse_real *A, dse_real *L);
/* X (n x m) = A^-1 B for A = L L', in place of B (row-major, m right-hand sides). */
void dse_cholesky_solve(int n, const dse_real *L, int m, dse_real *B);
/* B <- L^-1 B and B <- L'^-1 B. */
void dse_lower_solve(int n, const dse_real *L, int m, dse_real *B);
void dse_lower_transpose_solve(int n, const dse_real *L, int m, dse_real *B);

/* A = U'U of a symmetric n x n matrix with an envelope (lib/linalg/envelope.c): right of column
 * last[k] >= k row k of its upper triangle is zero, and last never decreases. Reads and writes the
 * upper triangle inside of the envelope only; the bits are those of dse_cholesky. U may be A. On
 * failure U is undefined.
 * DSE_ENOTPD when a pivot is not positive (or not finite). */
enum dse_status dse_envelope_cholesky(int n, const int *last, const dse_real *A, dse_real *U);
/* b <- A^-1 b for A = U'U. */
void dse_envelope_solve(int n, const int *last, const dse_real *U, dse_real *b);

/* A = L D L', L unit lower triangular; D (n). L may be A. For symmetric definite and
 * quasi-definite matrices; DSE_ESINGULAR when a pivot is 0, DSE_ENONFINITE when it is not finite;
 * L and D are then undefined. */
enum dse_status dse_ldl(int n, const dse_real *A, dse_real *L, dse_real *D);
void dse_ldl_solve(int n, const dse_real *L, const dse_real *D, int m, dse_real *B);

/* General square system with partial pivoting: A is overwritten by its factors, pivots (n).
 * DSE_ESINGULAR when a pivot is 0, DSE_ENONFINITE when one is not finite. */
enum dse_status dse_lu(int n, dse_real *A, int *pivots);
void dse_lu_solve(int n, const dse_real *LU, const int *pivots, int m, dse_real *B);

/* Householder QR of A (m x n, m >= n) in place: R in the upper triangle, reflectors below, tau (n).
 * DSE_ESINGULAR when a column lies in the span of those before it to working precision (the factors
 * are complete all the same), DSE_ENONFINITE when A is not finite. */
enum dse_status dse_qr(int m, int n, dse_real *A, dse_real *tau);
/* b (m) <- Q' b. */
void dse_qr_apply_qt(int m, int n, const dse_real *QR, const dse_real *tau, dse_real *b);
/* Least squares: x (n) minimises |A x - b|; b (m) is overwritten. */
void dse_qr_solve(int m, int n, const dse_real *QR, const dse_real *tau, dse_real *b, dse_real *x);
/* L (n x n lower, positive diagonal) with L L' = A A', A n x m, m >= n: the square-root (array)
 * step of a factored filter. A is overwritten. */
void dse_lq_lower(int n, int m, dse_real *A, dse_real *L);

/* ---- functions of matrices (lib/linalg/expm.c) ---- */

/* E = exp(A), n x n: scaling and squaring with the Pade approximant of degree 13.
 * scratch: DSE_EXPM_SCRATCH(n). */
#define DSE_EXPM_SCRATCH(n) (7 * (n) * (n) + (n))
enum dse_status dse_expm(int n, const dse_real *A, dse_real *E, dse_real *scratch);
/* Exact discretisation of x' = A x + B u over h, u held: Ad (n x n), Bd (n x nu). */
#define DSE_DISCRETISE_SCRATCH(n, nu)                                                              \
    (2 * ((n) + (nu)) * ((n) + (nu)) + DSE_EXPM_SCRATCH((n) + (nu)))
enum dse_status dse_discretise(int n, int nu, const dse_real *A, const dse_real *B, dse_real h,
                               dse_real *Ad, dse_real *Bd, dse_real *scratch);
/* Van Loan: Ad = exp(A h) and Qd = int_0^h exp(A s) Q exp(A' s) ds for a noise intensity Q (n x n).
 */
#define DSE_VAN_LOAN_SCRATCH(n) (8 * (n) * (n) + DSE_EXPM_SCRATCH(2 * (n)))
enum dse_status dse_van_loan(int n, const dse_real *A, const dse_real *Q, dse_real h, dse_real *Ad,
                             dse_real *Qd, dse_real *scratch);

#endif
