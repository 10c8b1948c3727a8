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
    DSE_PATH_HELD = 3,    /* none: the last solution, which satisfies the bounds, moved on */
    DSE_PATH_FREE = 4     /* none: the solution without bounds */
};

/* X (H nz x count, row-major) <- K X; the rows of stages newer than `newest` are zero on entry. */
typedef enum dse_status dse_active_set_apply(void *context, int count, int newest, dse_real *X);

/* Right-hand sides that are solved for together. */
#define DSE_ACTIVE_SET_BATCH 8

struct dse_active_set {
    int nz, nr;
    int capacity; /* stages, at most */
    int stages;   /* H of the problem at hand */
    int max_active;
    int slots; /* max_active + 1: the dual method looks at one that is not a member */
    dse_active_set_apply *apply;
    void *context;
    const struct dse_window_bounds *bounds;
    dse_real *unit;       /* nz: a size that matters of each entry of a stage, */
    dse_real *size;       /* nz: and the largest in the window at hand plus that; */
    dse_real *row_size;   /* nr: likewise of the rows */
    const dse_real *free; /* K c */
    dse_real blur;        /* how much larger that is, at least 1: its rounding is in the solution */
    int *member;          /* slots: active constraints, in the order of the factor */
    int count;            /* of them */
    int factored;         /* so many of them are in the factor */
    int *slot;            /* capacity (nz + nr): where the column of a constraint is, -1: nowhere */
    int *owner;           /* slots: constraint that a column belongs to, -1: none */
    int *side;         /* capacity (nz + nr): -1 at the lower bound, 1 at the upper, 0 inactive */
    dse_real *columns; /* slots x (capacity nz): K n_k */
    dse_real *L;       /* slots x slots: S = L L' */
    dse_real *y;       /* slots: multipliers of the members */
    dse_real *step;    /* slots */
    dse_real *kept;    /* slots: multipliers before a correction */
    dse_real *several; /* capacity nz x DSE_ACTIVE_SET_BATCH */
    dse_real *rows;    /* capacity nr: values of the rows */
    int passes, steps; /* of the last search: swaps, steps of the dual method */
};

/* Reals that an active set takes. */
#define DSE_ACTIVE_SET_STORAGE(nz, nr, H, max_active)                                              \
    (DSE_ACTIVE_SET_SLOTS(nz, H, (max_active) + 1) + 2 * DSE_ARENA_INTS((H) * ((nz) + (nr))) +     \
     2 * ((nz) + (nr)) + (H) * ((nz)*DSE_ACTIVE_SET_BATCH + (nr)))
#define DSE_ACTIVE_SET_SLOTS(nz, H, slots)                                                         \
    (2 * DSE_ARENA_INTS(slots) + (slots) * ((H) * (nz) + (slots) + 3))

#endif
