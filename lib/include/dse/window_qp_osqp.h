/* OSQP as the window QP's second opinion (struct dse_window_qp_backend): one of its workspaces, set
 * up on a host (dse_window_qp_osqp_setup, library dse_osqp) or generated as C for a microcontroller
 * by `dse design qp`. The same code runs on both.
 *
 * The workspace knows the problem in scaled unknowns z = scale zs, with bounds first (stage by
 * stage) and rows after them, the latter divided by row_scale:
 *
 *     min 1/2 zs'(S P S) zs - (S c)'zs,   l <= [I; N S / row_scale] zs <= u,   S = diag(scale).
 *
 * Where OSQP cannot change P (a generated workspace for vectors), its active set is that of the P
 * it was made for: a guess, which is all that it has to be. */
#ifndef DSE_WINDOW_QP_OSQP_H
#define DSE_WINDOW_QP_OSQP_H

#include "dse/arena.h"
#include "dse/real.h"
#include "dse/status.h"
#include "dse/window_qp.h"

struct dse_window_qp_osqp {
    void *solver; /* OSQPSolver * */
    int nz, nr, stages;
    const dse_real *scale;     /* stages x nz */
    const dse_real *row_scale; /* (stages - 1) x nr */
    /* DSE_WINDOW_QP_OSQP_NUMBERS(nz, nr, stages) for q, l, u and P, in OSQP's type of number, which
     * may not be larger than dse_real. */
    void *numbers;
};

#define DSE_WINDOW_QP_OSQP_NUMBERS(nz, nr, H)                                                      \
    (3 * (H) * (nz) + 2 * ((H)-1) * (nr) + (H) * (nz) * ((nz) + 1) / 2 + ((H)-1) * (nz) * (nz))
/* Reals that dse_window_qp_osqp_setup keeps, .. */
#define DSE_WINDOW_QP_OSQP_KEPT(nz, nr, H)                                                         \
    (DSE_WINDOW_QP_OSQP_NUMBERS(nz, nr, H) + (H) * (nz) + ((H)-1) * (nr))
/* .. those that it needs besides until it returns: the matrices that OSQP copies, .. */
#define DSE_WINDOW_QP_OSQP_PARTS(nz, nr, H)                                                        \
    (2 * ((H) * (nz) * ((nz) + 1) / 2 + ((H)-1) * (nz) * (nz) + (H) * (nz) +                       \
          2 * ((H)-1) * (nr) * (nz)) +                                                             \
     5 * (H) * (nz) + 2 * ((H)-1) * (nr) + 2)
/* .. and both. */
#define DSE_WINDOW_QP_OSQP_STORAGE(nz, nr, H)                                                      \
    (DSE_WINDOW_QP_OSQP_KEPT(nz, nr, H) + DSE_WINDOW_QP_OSQP_PARTS(nz, nr, H))

/* `solve` of the backend, with a struct dse_window_qp_osqp as context. DSE_EDIM: not the number of
 * stages that the workspace is for; DSE_ENONFINITE: a constraint whose scale is wrong, or OSQP's
 * result; DSE_ENOCONV: it has none. */
enum dse_status dse_window_qp_osqp_solve(void *context, const struct dse_window_qp_problem *problem,
                                         dse_real *y);

/* Hosts only: makes a workspace for P, E and F of the problem (OSQP allocates).
 * DSE_ESTORAGE, DSE_EINVAL; DSE_ENOCONV: OSQP refuses. */
enum dse_status dse_window_qp_osqp_setup(struct dse_window_qp_osqp *osqp,
                                         const struct dse_window_qp_problem *problem, int nz,
                                         int nr, struct dse_arena *arena);
void dse_window_qp_osqp_cleanup(struct dse_window_qp_osqp *osqp);

#endif
