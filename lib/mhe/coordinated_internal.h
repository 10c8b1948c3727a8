/* Coordinated moving horizon estimation: what agents and coordinator share.
 *
 * With G_ii X_i the stacked x_i(t+1) - A_ii x_i(t), the problems of an agent are, in X_i alone,
 *
 *     own         1/2 X'M_C X - c'X + 1/2 |G X - h|^2_{Q^-1} + g'X                        (4.2)
 *     with price  1/2 X'M_C X - c'X + 1/2 |G X - h|^2_{Q^-1} + 1/2 |h|^2_{D^-1} + g'X + p'h  (3.34)
 *
 * where g = Th_i'p; h is given in the first and free in the second. */
#ifndef DSE_MHE_COORDINATED_INTERNAL_H
#define DSE_MHE_COORDINATED_INTERNAL_H

#include "chain_internal.h"
#include "dse/coordinated_mhe.h"

/* ---- messages ---- */

/* Sample numbers travel modulo this, so that single precision carries them exactly. */
#define MHE_SAMPLE_WRAP 16777216L

enum { MHE_SAMPLE, MHE_ROUND, MHE_LENGTH, MHE_FLAGS, MHE_COST };

/* Down. */
enum {
    MHE_STOP = 1,
    MHE_STOP_CONVERGED = 2,
    MHE_STOP_SINGULAR = 4,
    MHE_UNBOUNDED = 8, /* answer without bounds: the start of the closed-form price (4.5) */
    MHE_ACCEPTED = 16, /* the point of the last answer is the best so far */
    MHE_START = 32,    /* the message ends with X_i as the coordinator has it */
    MHE_STOP_DIVERGED = 64
};
/* Up. */
enum { MHE_FRESH = 1, MHE_SENT = 2, MHE_UP_INFEASIBLE = 4, MHE_UP_SINGULAR = 8 };

/* Bits in reals, DSE_MHE_BITS_PER_REAL each. */
void mhe_bits_clear(int count, dse_real *words);
void mhe_bit_set(dse_real *words, int bit);
bool mhe_bit_get(const dse_real *words, int bit);

/* The number at `index` of a header: an integer of 0 .. MHE_SAMPLE_WRAP, or -1. */
long mhe_header_get(const dse_real *message, int index);

/* ---- subsystems (coordinated_subsystem.c) ---- */

/* DSE_EINVAL, DSE_ENONFINITE, DSE_ENOTPD: the prior. */
enum dse_status mhe_subsystem_check(const struct dse_mhe_subsystem *subsystem);
bool mhe_subsystem_is_bounded(const struct dse_mhe_subsystem *subsystem);
enum dse_status mhe_settings_check(const struct dse_mhe_settings *settings);

void mhe_outputs_take(struct dse_mhe_outputs *outputs, int nx, int ny, struct dse_arena *arena);
enum dse_status mhe_outputs_set(struct dse_mhe_outputs *outputs,
                                const struct dse_mhe_subsystem *subsystem);
/* M (rows of `stride`) += C'R^-1C of the channels that there are (has: ny, not 0). */
void mhe_outputs_add(struct dse_mhe_outputs *outputs, const dse_real *has, int stride, dse_real *M);
/* c (nx) = C'R^-1 y of the channels that there are. */
void mhe_outputs_project(struct dse_mhe_outputs *outputs, const dse_real *has, const dse_real *y,
                         dse_real *c);
/* z (nx) = C'R^-1C x of the channels that there are. */
void mhe_outputs_apply(struct dse_mhe_outputs *outputs, const dse_real *has, const dse_real *x,
                       dse_real *z);

enum mhe_penalty_kind {
    MHE_PENALTY_DISTURBANCE, /* S = Q^-1 */
    MHE_PENALTY_PRICE,       /* S = (Q + D)^-1, T, V */
    MHE_PENALTY_INTERACTION  /* S = D^-1, zero without D */
};
void mhe_penalty_take(struct dse_mhe_penalty *penalty, int nx, struct dse_arena *arena);
/* scratch: 2 nx nx. DSE_ENOTPD. */
enum dse_status mhe_penalty_set(struct dse_mhe_penalty *penalty, enum mhe_penalty_kind kind,
                                const struct dse_mhe_subsystem *subsystem, dse_real *scratch);
/* B (n x n) = A^-1 of a symmetric positive definite A; scratch: n n. */
enum dse_status mhe_inverse(int n, const dse_real *A, dse_real *B, dse_real *scratch);

/* The matrix of a window: M_C + G'S G + prior (+ stage cost). has: length x ny. */
void mhe_window_matrix(struct dse_mhe_chain *chain, int length, struct dse_mhe_outputs *outputs,
                       const dse_real *has, const struct dse_mhe_penalty *penalty);

/* That of the problem with a price in z_t = (x_t, w_t), h eliminated (4.5). */
void mhe_price_matrix(struct dse_mhe_chain *chain, int length, struct dse_mhe_outputs *outputs,
                      const dse_real *has, const struct dse_mhe_penalty *disturbance,
                      const struct dse_mhe_penalty *interaction);

/* y ((length-1) nx) = G X;  x (length nx) += a G'v. */
void mhe_differences(const struct dse_mhe_subsystem *subsystem, int length, const dse_real *X,
                     dse_real *y);
void mhe_differences_transposed(const struct dse_mhe_subsystem *subsystem, int length, dse_real a,
                                const dse_real *v, dse_real *x);

/* ---- the bounded problems of an agent (coordinated_bounded.c) ---- */

enum dse_status mhe_bounded_init(struct dse_mhe_local *local, struct dse_arena *arena);
/* After a change of the window's matrices. */
void mhe_bounded_factor(struct dse_mhe_local *local);
/* X, W, lambda of the own problem with linear term local->rhs and interaction h; of the problem
 * with price (X, W, h) for local->g and p. */
enum dse_status mhe_bounded_solve_own(struct dse_mhe_local *local, const dse_real *h);
enum dse_status mhe_bounded_solve_price(struct dse_mhe_local *local, const dse_real *p);

/* ---- the log barrier (coordinated_barrier.c) ---- */
/* Solves the own problem with linear term local->rhs = c - g and interaction h. */
enum dse_status mhe_barrier_solve(struct dse_mhe_local *local, const dse_real *h);

/* ---- the local problems (coordinated_solve.c) ---- */

/* Factors what the window at hand needs. */
void mhe_local_factor(struct dse_mhe_local *local);
/* Solves the own problem with g and h (NULL: zero). */
enum dse_status mhe_local_solve_own(struct dse_mhe_local *local, const dse_real *g,
                                    const dse_real *h);
enum dse_status mhe_local_solve_price(struct dse_mhe_local *local, const dse_real *g,
                                      const dse_real *p, bool without_bounds);

#endif
