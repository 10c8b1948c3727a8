/* Active set of a window: what its parts share. See dse/active_set.h. */
#ifndef DSE_MHE_ACTIVE_SET_INTERNAL_H
#define DSE_MHE_ACTIVE_SET_INTERNAL_H

#include "dse/active_set.h"

/* Violations and multipliers of the wrong sign below this, relative to their size, are rounding. */
#define ACTIVE_SET_ROUNDING                                                                        \
    (sizeof(dse_real) == sizeof(double) ? DSE_REAL(1e-12) : 64 * DSE_REAL_EPSILON)

/* A pivot or curvature below this, relative to the terms that it is made of, says: dependent. */
#define ACTIVE_SET_DEPENDENT                                                                       \
    (sizeof(dse_real) == sizeof(double) ? DSE_REAL(1e-11) : 128 * DSE_REAL_EPSILON)

/* ---- constraints (active_set.c) ---- */

static inline int active_set_stride(const struct dse_active_set *set)
{
    return set->nz + set->nr;
}

static inline int active_set_constraints(const struct dse_active_set *set)
{
    return set->stages * active_set_stride(set) - set->nr;
}

static inline bool active_set_is_bounded(dse_real bound)
{
    return bound > -DSE_REAL_MAX && bound < DSE_REAL_MAX;
}

/* Bound of constraint k at the side (-1 or 1); +-DSE_REAL_MAX: none. */
dse_real active_set_bound(const struct dse_active_set *set, int k, int side);
bool active_set_is_equality(const struct dse_active_set *set, int k);
/* n_k'z. */
dse_real active_set_value(const struct dse_active_set *set, int k, const dse_real *z);
/* v += a n_k. */
void active_set_add_normal(const struct dse_active_set *set, int k, dse_real a, dse_real *v);
/* DSE_EINVAL: a lower bound above its upper one; DSE_ENONFINITE: a NaN. */
enum dse_status active_set_check_bounds(const struct dse_active_set *set);
/* What an error of constraint k is measured against. */
dse_real active_set_size(const struct dse_active_set *set, int k);

/* ---- the set (active_set.c) ---- */

void active_set_init(struct dse_active_set *set, int nz, int nr, int capacity, int max_active,
                     struct dse_arena *arena);
/* Another problem: members that are not bounded any more leave, equalities enter. */
void active_set_begin(struct dse_active_set *set, int stages,
                      const struct dse_window_bounds *bounds);
void active_set_clear(struct dse_active_set *set);
/* K has changed: no column holds any more. */
void active_set_forget_columns(struct dse_active_set *set);
/* The window has slid by one stage. */
void active_set_slide(struct dse_active_set *set);
/* At place `at` of the members; false: no room. */
bool active_set_insert(struct dse_active_set *set, int at, int k, int side);
void active_set_remove(struct dse_active_set *set, int at);
void active_set_sort(struct dse_active_set *set);

/* ---- linear algebra (active_set_solve.c) ---- */

/* The column K n_k; NULL: failed. */
const dse_real *active_set_column(struct dse_active_set *set, int k);
/* Columns and factor of all members; members that depend on those before them leave. */
enum dse_status active_set_factor(struct dse_active_set *set);
/* step = S^-1 step, for `count` members. */
void active_set_solve_factor(const struct dse_active_set *set, dse_real *step);
/* z = K c -> the solution with all members active, y its multipliers. */
void active_set_solve(struct dse_active_set *set, dse_real *z);
/* Both: factors the members and solves from free = K c into z. DSE_ENONFINITE too. */
enum dse_status active_set_solve_members(struct dse_active_set *set, const dse_real *free,
                                         dse_real *z);
/* dz = K r -> the correction of a solution whose stationarity misses by r, with z the solution; y
 * is corrected. */
void active_set_correct(struct dse_active_set *set, const dse_real *z, dse_real *dz);
/* v = K c -> (K - K N' S^-1 N K) c: the derivative of the solution along c. */
void active_set_project(struct dse_active_set *set, dse_real *v);
/* v <- v - K N' step. */
void active_set_subtract(const struct dse_active_set *set, const dse_real *step, dse_real *v);
/* sum_i |n_ki v_i|: what n_k'v consists of. */
dse_real active_set_terms(const struct dse_active_set *set, int k, const dse_real *v);

/* ---- search (active_set_swap.c, active_set_dual.c) ---- */

struct active_set_violators {
    int wrong;    /* members whose multiplier has the wrong sign */
    int violated; /* inactive constraints that are violated */
    int worst;    /* the most violated constraint relative to its size, -1: none */
    int worst_side;
};
/* set->size and row_size for these z. */
void active_set_measure(struct dse_active_set *set, const dse_real *z);
struct active_set_violators active_set_judge(struct dse_active_set *set, const dse_real *z);
/* From the set at hand to the optimal one. `free`: K c; z: the solution. */
enum dse_status active_set_search(struct dse_active_set *set, const dse_real *free, int max_passes,
                                  int max_steps, dse_real *z);
enum dse_status active_set_search_dual(struct dse_active_set *set, const dse_real *free,
                                       int max_steps, dse_real *z);
/* Whether multiplier y of constraint k at that side is wrong beyond rounding. */
bool active_set_is_wrong(const struct dse_active_set *set, int k, dse_real y, dse_real largest);
/* max_k |y_k| size_k over the members. */
dse_real active_set_largest_force(const struct dse_active_set *set);

#endif
