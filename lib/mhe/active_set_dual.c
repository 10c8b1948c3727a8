/* Active set of a window: the dual method of Goldfarb and Idnani. From a set whose multipliers all
 * have the right sign, one violated constraint p enters with a multiplier that grows by t:
 *
 *     r = S^-1 N K n_p,   y <- y -+ t r,   z <- z -+ t (K n_p - K N' r),
 *
 * until p is satisfied (it joins the set) or a multiplier of the set reaches zero (its constraint
 * leaves, and p goes on). When p cannot be satisfied and nothing stands in its way, no point is
 * feasible. */
#include <stddef.h>

#include "active_set_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"

/* The member with the multiplier that is most wrong; -1: none. */
static int most_wrong(const struct dse_active_set *set)
{
    const dse_real largest = active_set_largest_force(set);
    int worst = -1;
    dse_real smallest = 0;
    for (int m = 0; m < set->count; m++) {
        const int k = set->member[m];
        const dse_real force = (dse_real)set->side[k] * set->y[m] * active_set_size(set, k);
        if (active_set_is_wrong(set, k, set->y[m], largest) && force < smallest) {
            smallest = force;
            worst = m;
        }
    }
    return worst;
}

/* Members leave until all multipliers have the right sign. */
static enum dse_status make_dual_feasible(struct dse_active_set *set, const dse_real *free,
                                          dse_real *z)
{
    for (;;) {
        const enum dse_status status = active_set_solve_members(set, free, z);
        if (status != DSE_OK)
            return status;
        (void)active_set_judge(set, z); /* for the sizes */
        const int wrong = most_wrong(set);
        if (wrong < 0)
            return DSE_OK;
        active_set_remove(set, wrong);
    }
}

/* A member's share in n_p = sum_m r_m n_m below this, relative to sizes, is rounding. */
#define NO_SHARE (100 * ACTIVE_SET_ROUNDING)

/* The longest step that no multiplier forbids, and whose (-1: none). `side` is that of p. */
static dse_real longest_step(const struct dse_active_set *set, int p, int side, int *blocking)
{
    const dse_real least = NO_SHARE * active_set_size(set, p);
    dse_real longest = DSE_REAL_MAX;
    *blocking = -1;
    for (int m = 0; m < set->count; m++) {
        const int k = set->member[m];
        const dse_real decrease = (dse_real)(set->side[k] * side) * set->step[m];
        if (!(decrease * active_set_size(set, k) > least) || active_set_is_equality(set, k))
            continue;
        const dse_real force = (dse_real)set->side[k] * set->y[m];
        const dse_real t = (force > 0 ? force : 0) / decrease;
        if (t < longest) {
            longest = t;
            *blocking = m;
        }
    }
    return longest;
}

/* step = r and direction = K n_p - K N' r, where N direction = 0; corrected once, because members
 * that nearly depend on each other cost digits. The curvature n_p'direction; 0: p depends. */
static dse_real find_direction(struct dse_active_set *set, int p, const dse_real *column,
                               dse_real *direction)
{
    for (int i = 0; i < set->stages * set->nz; i++)
        direction[i] = column[i];
    for (int m = 0; m < set->count; m++)
        set->step[m] = 0;
    for (int pass = 0; pass < 2; pass++) {
        for (int m = 0; m < set->count; m++)
            set->kept[m] = active_set_value(set, set->member[m], direction);
        active_set_solve_factor(set, set->kept);
        active_set_subtract(set, set->kept, direction);
        dse_axpy(set->count, 1, set->kept, set->step);
    }
    const dse_real curvature = active_set_value(set, p, direction);
    dse_real terms = active_set_terms(set, p, column);
    for (int m = 0; m < set->count; m++) /* what the difference is made of */
        terms += dse_abs(set->step[m] * active_set_value(set, set->member[m], column));
    return curvature > ACTIVE_SET_DEPENDENT * terms ? curvature : 0;
}

/* Constraint p, violated at that side, enters; others may leave. */
static enum dse_status enter(struct dse_active_set *set, int p, int side, int max_steps,
                             dse_real *z)
{
    dse_real y = 0;
    while (set->steps < max_steps) {
        set->steps++;
        enum dse_status status = active_set_factor(set);
        const dse_real *column = status == DSE_OK ? active_set_column(set, p) : NULL;
        if (!column)
            return status != DSE_OK ? status : DSE_ENOCONV;
        dse_real *direction = set->several; /* free between columns */
        const dse_real curvature = find_direction(set, p, column, direction);
        const dse_real off =
            (dse_real)side * (active_set_value(set, p, z) - active_set_bound(set, p, side));
        const dse_real full = curvature > 0 ? (off > 0 ? off : 0) / curvature : DSE_REAL_MAX;
        int blocking;
        const dse_real partial = longest_step(set, p, side, &blocking);
        if (blocking < 0 && !(curvature > 0))
            return DSE_EINFEASIBLE;
        const dse_real t = full <= partial ? full : partial;
        y += (dse_real)side * t;
        dse_axpy(set->stages * set->nz, -(dse_real)side * t, direction, z);
        dse_axpy(set->count, -(dse_real)side * t, set->step, set->y);
        if (full <= partial) {
            if (!active_set_insert(set, set->count, p, side))
                return DSE_ENOCONV;
            set->y[set->count - 1] = y;
            return DSE_OK;
        }
        active_set_remove(set, blocking);
    }
    return DSE_ENOCONV;
}

enum dse_status active_set_search_dual(struct dse_active_set *set, const dse_real *free,
                                       int max_steps, dse_real *z)
{
    enum dse_status status = make_dual_feasible(set, free, z);
    while (status == DSE_OK) {
        const struct active_set_violators v = active_set_judge(set, z);
        if (v.worst < 0)
            break;
        status = enter(set, v.worst, v.worst_side, max_steps, z);
    }
    if (status != DSE_OK)
        return status;
    active_set_sort(set);
    status = active_set_solve_members(set, free, z);
    if (status != DSE_OK)
        return status;
    const struct active_set_violators v = active_set_judge(set, z);
    return v.wrong + v.violated == 0 ? DSE_OK : DSE_ENOCONV;
}
