/* Symmetric positive definite block-tridiagonal systems, as windows have them:
 *
 *     D_0   U_0                          x_0      b_0
 *     U_0'  D_1   U_1                    x_1      b_1
 *           U_1'  D_2   ..            *  ..    =  ..        blocks n x n
 *                 ..    D_{H-1}          x_{H-1}  b_{H-1}
 *
 * factored from the first block on. The effort is linear in H, and because the Schur complement of
 * the last block is the inverse of the corner of the inverse, its factor is that of the covariance
 * of the newest state. */
#ifndef DSE_MHE_CHAIN_INTERNAL_H
#define DSE_MHE_CHAIN_INTERNAL_H

#include "dse/coordinated_mhe.h"

/* Takes the memory of a chain of `capacity` blocks, DSE_MHE_CHAIN_STORAGE reals. */
void mhe_chain_take(struct dse_mhe_chain *chain, int n, int capacity, struct dse_arena *arena);

/* D_t = L_t L_t' + V_{t-1}' V_{t-1},  U_t = L_t V_t. DSE_ENOTPD: not positive definite to working
 * precision. */
enum dse_status mhe_chain_factor(struct dse_mhe_chain *chain);

/* x <- the solution of P x = x. */
void mhe_chain_solve(const struct dse_mhe_chain *chain, dse_real *x);

/* y_t (n) = (P x)_t. */
void mhe_chain_multiply_row(const struct dse_mhe_chain *chain, const dse_real *x, int t,
                            dse_real *y);

/* max_t |P x - b|_t / (|P| |x| + |b|)_t, componentwise over the largest sizes of the window. */
dse_real mhe_chain_residual(const struct dse_mhe_chain *chain, const dse_real *x,
                            const dse_real *b);

#endif
