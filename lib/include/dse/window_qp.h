/* The quadratic programme that the bounded problems of moving horizon estimation share: over a
 * window of H stages z_0 .. z_{H-1} (oldest first, nz unknowns each)
 *
 *     min  1/2 z'Pz - c'z      P positive definite and block-tridiagonal
 *     s.t. lower <= z_j <= upper,   row_lower_j <= E z_j + F z_{j+1} <= row_upper_j
 *
 * Centralised, and local with predicted interaction: z = x, rows = w_j (E = -A, F = I). Local with
 * a price: z_j = (x_j, w_j), bounds only; a stage that has fewer unknowns is filled up with free
 * ones of weight 1.
 *
 * Solved by its active set (dse/active_set.h) on a block-tridiagonal Cholesky factor of P alone: as
 * long as P stays, nothing is factored but the small matrix of the active constraints. The factor
 * is made from the newest stage backwards, so that a change at stage j (a missing value, the
 * arrival cost at stage 0) costs the stages up to j only. A second solver, when there is one, is
 * asked for its active set where one's own search has not ended; its numbers are not used. Whatever
 * the way, a solution counts only when its own certificate, computed from the data of the problem,
 * holds.
 *
 *     static dse_real memory[DSE_WINDOW_QP_STORAGE(3, 3, 10, 57)];
 *     struct dse_window_qp_config config = {.nz = 3, .nr = 3, .stages = 10, .max_active = 57};
 *     dse_window_qp_init(&qp, &config, &arena);
 *     dse_window_qp_factor(&qp, &problem, problem.stages - 1);     (when P has changed)
 *     dse_window_qp_slide(&qp);                                    (when the window has)
 *     dse_window_qp_solve(&qp, &problem);
 *
 * A call that fails leaves the last solution as it was. */
#ifndef DSE_WINDOW_QP_H
#define DSE_WINDOW_QP_H

#include "dse/active_set.h"
#include "dse/arena.h"
#include "dse/real.h"
#include "dse/status.h"

/* The blocks are given by one pointer per stage, so that stages can share them. Everything must
 * stay until the call returns; P until the next dse_window_qp_factor. */
struct dse_window_qp_problem {
    int stages;                      /* H: 1 .. config->stages */
    const dse_real *const *diagonal; /* H pointers: P_jj, nz x nz, symmetric */
    const dse_real *const
        *below;        /* H - 1 pointers: P_{j+1,j}, nz x nz: rows z_{j+1}, columns z_j */
    const dse_real *c; /* H x nz */
    struct dse_window_bounds bounds;
};

/* Another solver. `solve` writes the multipliers that it finds into y, numbered and signed as those
 * of an active set (H (nz + nr), zero: inactive), and may be as inexact as it likes. The problem
 * has been checked: finite numbers, lower <= upper. */
struct dse_window_qp_backend {
    enum dse_status (*solve)(void *context, const struct dse_window_qp_problem *problem,
                             dse_real *y);
    void *context;
};

/* Config and all that it points to must outlive the solver. */
struct dse_window_qp_config {
    int nz;         /* > 0 */
    int nr;         /* rows per pair of stages, >= 0 */
    int stages;     /* H at most, >= 1 */
    int max_active; /* constraints that can be active at once: 1 .. stages nz; 0 (default): all */
    int max_passes; /* of swaps; 0 (default): 20; -1: none but after the backend's answer */
    int max_steps;  /* of the dual method likewise; 0 (default): 5 max_active + 20 */
    /* Largest certificate that is accepted; 0 (default): 1e-10, in single precision 1e-4. */
    dse_real tolerance;
    const struct dse_window_qp_backend *backend; /* NULL (default): none */
};

/* How far (z, y) is from optimal, each part relative to the size of its terms; see
 * dse_window_qp_certify. */
struct dse_window_qp_certificate {
    dse_real primal; /* largest violation of a bound or row */
    dse_real dual;   /* largest entry of P z - c + N'y, or multiplier of the wrong sign */
    dse_real gap;    /* primal minus dual value */
};

struct dse_window_qp_counts {
    long solved, infeasible, failed;
    long by_dual, by_backend; /* solved that way */
    long refinements;
};

struct dse_window_qp {
    const struct dse_window_qp_config *config;
    int nz, nr, capacity;
    int stages;   /* of the last solution; 0: none */
    int factored; /* stages of the factor; 0: none */
    struct dse_active_set set;
    dse_real *L;    /* capacity x nz x nz: Cholesky factors, by distance from the newest stage, */
    dse_real *W;    /* capacity x nz x nz: and L_{j+1}^-1 P_{j+1,j} of stage j likewise */
    dse_real *free; /* K c */
    dse_real *z, *z_next; /* the last solution, and the one that is being made; */
    dse_real *y, *y_next; /* their multipliers by constraint */
    int *side;            /* by constraint, of the last solution */
    dse_real *residual;   /* P z - c + N'y */
    dse_real *work;
    dse_real *dual_size; /* nz: the largest sum of terms of a residual */
    dse_real *largest;   /* nz */
    dse_real *product;   /* nz x DSE_ACTIVE_SET_BATCH */
    struct dse_window_qp_certificate certificate;
    enum dse_active_set_path path;
    struct dse_window_qp_counts counts;
};

/* Reals that dse_window_qp_init takes; max_active not 0 here: H nz for all. */
#define DSE_WINDOW_QP_STORAGE(nz, nr, H, max_active)                                               \
    (DSE_ACTIVE_SET_STORAGE(nz, nr, H, max_active) +                                               \
     (H) * ((nz) * (2 * (nz) + 5) + 2 * ((nz) + (nr))) + DSE_ARENA_INTS((H) * ((nz) + (nr))) +     \
     (nz) * (2 + DSE_ACTIVE_SET_BATCH))

/* DSE_EINVAL, DSE_ESTORAGE. */
enum dse_status dse_window_qp_init(struct dse_window_qp *qp,
                                   const struct dse_window_qp_config *config,
                                   struct dse_arena *arena);

/* Factors P, whose stages newer than `newest_changed` are as before (and as many stages newer than
 * it as before). DSE_ENOTPD, DSE_ENONFINITE: there is no factor then. */
enum dse_status dse_window_qp_factor(struct dse_window_qp *qp,
                                     const struct dse_window_qp_problem *problem,
                                     int newest_changed);

/* Solves from the active set of the last solution. DSE_EINVAL: no factor of that many stages, or a
 * lower bound above its upper one; DSE_ENONFINITE; DSE_EINFEASIBLE: no z satisfies the constraints;
 * DSE_ENOCONV: no solution within the limits whose certificate holds. */
enum dse_status dse_window_qp_solve(struct dse_window_qp *qp,
                                    const struct dse_window_qp_problem *problem);

/* ---- the warm start ---- */

/* The window has slid by one sample: the active set of the last solution moves along. */
void dse_window_qp_slide(struct dse_window_qp *qp);
/* The next solution starts with no active constraint. */
void dse_window_qp_forget(struct dse_window_qp *qp);

/* ---- the last solution ---- */

const dse_real *dse_window_qp_z(const struct dse_window_qp *qp); /* stages x nz */
/* Signed multipliers, stages x (nz + nr), by constraint number: positive at the upper bound, zero
 * where inactive:  P z - c + sum_k y_k n_k = 0. */
const dse_real *dse_window_qp_multipliers(const struct dse_window_qp *qp);
/* -1: constraint k is active at its lower bound, 1: at its upper one, 0: inactive. */
int dse_window_qp_side(const struct dse_window_qp *qp, int k);
/* The same as bits (no sides): bit k % 8 of byte k / 8, for stages (nz + nr) constraints. */
void dse_window_qp_bitmap(const struct dse_window_qp *qp, unsigned char *bitmap);

/* ---- sensitivities ---- */

/* The active set is now that of the bitmap (equalities: bits, too), for the factor at hand; the
 * solution stays as it is. For whoever knows a problem and its active set but not its solution.
 * DSE_EINVAL: no factor; DSE_ESTORAGE: more bits than max_active; DSE_ESINGULAR: the constraints
 * depend on each other; the set is then empty. */
enum dse_status dse_window_qp_take_bitmap(struct dse_window_qp *qp,
                                          const struct dse_window_qp_problem *problem,
                                          const unsigned char *bitmap);
/* X = dz/dc X for m right-hand sides (X: stages nz x m) with the active set of the last solution or
 * bitmap: the derivative of z where the active set stays. For a linear term c - B p: dz/dp = -X of
 * X = B. */
enum dse_status dse_window_qp_respond(struct dse_window_qp *qp, int m, dse_real *X);

/* ---- certificate ---- */

/* How far any z (H x nz) with multipliers y (H x (nz + nr)) is from optimal. primal: a violation
 * relative to the largest such entry in the window plus the largest 1 / sqrt(P_ii), which is a
 * standard deviation in estimation; dual: relative to the largest sum of absolute terms of that
 * entry; gap: z'Pz - c'z + sum_k y_k b_k, relative to the absolute terms. Needs no factor. */
struct dse_window_qp_certificate dse_window_qp_certify(struct dse_window_qp *qp,
                                                       const struct dse_window_qp_problem *problem,
                                                       const dse_real *z, const dse_real *y);

#endif
