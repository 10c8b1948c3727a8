/* The active set of a strictly convex quadratic programme over a window of H stages z_j (nz each),
 *
 *     min 1/2 z'Pz - c'z,   lower <= z_j <= upper,   row_lower <= E z_j + F z_{j+1} <= row_upper
 *
 * for whoever can apply K = P^-1: the window QP by a block-tridiagonal factor, the linear moving
 * horizon estimator by its Riccati factors (where P is not even finite when Q is singular). With
 * the active constraints n_k'z = b_k as the rows of N,
 *
 *     S = N K N',   y = S^-1 (N K c - b),   z = K c - K N' y.
 *
 * y_k is the multiplier, signed: positive at the upper bound, negative at the lower one. Each
 * constraint that becomes active costs one solution with K; S is factored densely, so the effort
 * grows with the number of active constraints and not with that of all.
 *
 * First, all violators are swapped at once (inactive and violated: in; active with a multiplier of
 * the wrong sign: out), which ends after a few passes nearly always. When the number of violators
 * has not fallen for a while, the dual method of Goldfarb and Idnani (Math. Programming 27, 1983)
 * takes over from the set at hand: one constraint at a time, with a dual value that rises strictly,
 * so that no set comes again, and with proof when there is no feasible point.
 *
 * Internal to moving horizon estimation: users call dse/window_qp.h or dse/linear_mhe.h. */
#ifndef DSE_ACTIVE_SET_H
#define DSE_ACTIVE_SET_H

#include <stdbool.h>

#include "dse/arena.h"
#include "dse/real.h"
#include "dse/status.h"

/* Constraint number k = j (nz + nr) + i: for i < nz the bound of entry i of z_j, else row i - nz
 * between z_j and z_{j+1}. A bound at or beyond +-DSE_REAL_MAX (infinity included) is none; lower =
 * upper is an equality. NULL: none of that kind on that side. */
struct dse_window_bounds {
    const dse_real *lower, *upper;         /* H x nz */
    const dse_real *E, *F;                 /* nr x nz; F may be NULL: then nr = nz and F = I */
    const dse_real *row_lower, *row_upper; /* (H - 1) x nr */
};

/* How a solution was found. */
enum dse_active_set_path {
    DSE_PATH_SWAPS = 0,   /* passes that swap all violators */
    DSE_PATH_DUAL = 1,    /* the dual method after them */
    DSE_PATH_BACKEND = 2, /* the active set of another solver, refined */
    DSE_PATH_HELD = 3     /* none: the last solution is held */
};

/* columns (count x H nz) = K n_k for these constraints. */
typedef enum dse_status dse_active_set_respond(void *context, int count, const int *constraints,
                                               dse_real *columns);

struct dse_active_set {
    int nz, nr, stages; /* stages: H of the problem at hand */
    int capacity;       /* stages, at most */
    int max_active;
    dse_active_set_respond *respond;
    void *context;
    const struct dse_window_bounds *bounds;
    const dse_real *unit; /* H x nz: a size of each entry of z that matters */
    dse_real *row_unit;   /* nr: likewise of each row */
    int *member;          /* max_active: constraints, in the order of the factor */
    int *column_of;       /* max_active: where the column of each is in `columns` */
    int count;            /* active constraints */
    int factored;         /* so many of them are in the factor */
    signed char *side; /* capacity (nz + nr): -1 at the lower bound, 1 at the upper, 0 inactive */
    dse_real *columns; /* max_active x (capacity nz): K n_k */
    dse_real *S;       /* max_active x max_active, lower triangle, in the order of the columns */
    dse_real *L;       /* max_active x max_active: the factor of S in the order of the members */
    dse_real *y;       /* max_active: multipliers in the order of the members */
    dse_real *step;    /* max_active */
    dse_real *batch;   /* scratch of the swaps */
    int *fresh;        /* max_active: members without a column yet */
    int passes, steps; /* of the last solution: of swaps, of the dual method */
};

#define DSE_ACTIVE_SET_BYTES(count)                                                                \
    ((int)(((count) + (int)sizeof(dse_real) - 1) / (int)sizeof(dse_real)))
/* Reals that an active set takes. */
#define DSE_ACTIVE_SET_STORAGE(nz, nr, H, max_active)                                              \
    (3 * DSE_ARENA_INTS(max_active) + DSE_ACTIVE_SET_BYTES((H) * ((nz) + (nr))) + (nr) +           \
     (max_active) * ((H) * (nz) + 2 * (max_active) + 2))

#endif
