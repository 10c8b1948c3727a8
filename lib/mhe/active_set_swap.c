/* Active set of a window: all violators swapped at once, while that helps. */
#include <stddef.h>

#include "active_set_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"

/* Passes without fewer violators than ever before, until the dual method takes over. */
#define PATIENCE 3

/* size_i = max_j |z_ji| + unit_i, and |E| size + |F| size for the rows. */
void active_set_measure(struct dse_active_set *set, const dse_real *z)
{
    const int nz = set->nz;
    for (int i = 0; i < nz; i++)
        set->size[i] = 0;
    for (int j = 0; j < set->stages; j++)
        for (int i = 0; i < nz; i++)
            set->size[i] = dse_max(set->size[i], dse_abs(z[j * nz + i]));
    for (int i = 0; i < nz; i++)
        set->size[i] += set->unit[i];
    for (int r = 0; r < set->nr; r++) {
        const dse_real *E = set->bounds->E + r * nz, *F = set->bounds->F;
        dse_real sum = F ? 0 : set->size[r];
        for (int i = 0; i < nz; i++)
            sum += (dse_abs(E[i]) + (F ? dse_abs(F[r * nz + i]) : 0)) * set->size[i];
        set->row_size[r] = sum;
    }
}

/* blur = max_i max_j |free_ji| / size_i, at least 1. */
static void find_blur(struct dse_active_set *set)
{
    set->blur = 1;
    for (int i = 0; i < set->stages * set->nz; i++) {
        const dse_real ratio = dse_abs(set->free[i]) / set->size[i % set->nz];
        set->blur = ratio > set->blur ? ratio : set->blur;
    }
}

dse_real active_set_largest_force(const struct dse_active_set *set)
{
    dse_real largest = 0;
    for (int m = 0; m < set->count; m++)
        largest = dse_max(largest, dse_abs(set->y[m]) * active_set_size(set, set->member[m]));
    return largest;
}

bool active_set_is_wrong(const struct dse_active_set *set, int k, dse_real y, dse_real largest)
{
    const dse_real force = (dse_real)set->side[k] * y * active_set_size(set, k);
    return force < -ACTIVE_SET_ROUNDING * largest && !active_set_is_equality(set, k);
}

/* By how much the value lies beyond a bound, and beyond which. */
static dse_real excess(const struct dse_active_set *set, int k, dse_real value, int *side)
{
    const dse_real above = value - active_set_bound(set, k, 1);
    const dse_real below = active_set_bound(set, k, -1) - value;
    *side = above > below ? 1 : -1;
    return above > below ? above : below;
}

static void judge_constraint(const struct dse_active_set *set, int k, dse_real value,
                             struct active_set_violators *v, dse_real *worst)
{
    int side;
    if (set->side[k] != 0)
        return;
    const dse_real relative = excess(set, k, value, &side) / active_set_size(set, k);
    if (!(relative > ACTIVE_SET_ROUNDING * set->blur))
        return;
    v->violated++;
    if (relative > *worst) {
        *worst = relative;
        v->worst = k;
        v->worst_side = side;
    }
}

struct active_set_violators active_set_judge(struct dse_active_set *set, const dse_real *z)
{
    struct active_set_violators v = {.worst = -1};
    dse_real worst = 0;
    active_set_measure(set, z);
    find_blur(set);
    const dse_real largest = active_set_largest_force(set);
    for (int m = 0; m < set->count; m++)
        v.wrong += active_set_is_wrong(set, set->member[m], set->y[m], largest);
    const int nz = set->nz, nr = set->nr, stride = nz + nr;
    const bool rows = set->bounds->row_lower || set->bounds->row_upper;
    const bool boxes = set->bounds->lower || set->bounds->upper;
    for (int j = 0; j < set->stages; j++) {
        for (int i = 0; i < nz && boxes; i++)
            judge_constraint(set, j * stride + i, z[j * nz + i], &v, &worst);
        for (int r = 0; r < nr && rows && j + 1 < set->stages; r++) {
            set->rows[j * nr + r] = active_set_value(set, j * stride + nz + r, z);
            judge_constraint(set, j * stride + nz + r, set->rows[j * nr + r], &v, &worst);
        }
    }
    return v;
}

/* Wrong members leave; then the violated constraints enter, while there is room. */
static void swap(struct dse_active_set *set, const dse_real *z)
{
    const dse_real largest = active_set_largest_force(set);
    for (int m = set->count - 1; m >= 0; m--) {
        const int k = set->member[m];
        if (active_set_is_wrong(set, k, set->y[m], largest))
            active_set_remove(set, m);
    }
    const int nz = set->nz, nr = set->nr, stride = nz + nr;
    for (int k = 0, at = 0; k < active_set_constraints(set); k++) {
        if (at < set->count && set->member[at] == k) {
            at++;
            continue;
        }
        const int j = k / stride, i = k % stride;
        const bool rows = set->bounds->row_lower || set->bounds->row_upper;
        if (i >= nz && !rows)
            continue;
        int side;
        const dse_real value = i < nz ? z[j * nz + i] : set->rows[j * nr + i - nz];
        if (!(excess(set, k, value, &side) / active_set_size(set, k) >
              ACTIVE_SET_ROUNDING * set->blur))
            continue;
        at += active_set_insert(set, at, k, side);
    }
}

enum dse_status active_set_search(struct dse_active_set *set, const dse_real *free, int max_passes,
                                  int max_steps, dse_real *z)
{
    int fewest = set->capacity * active_set_stride(set) + 1, patience = PATIENCE;
    set->free = free;
    set->passes = 0;
    set->steps = 0;
    while (set->passes < max_passes) {
        const enum dse_status status = active_set_solve_members(set, free, z);
        if (status != DSE_OK)
            return status;
        set->passes++;
        const struct active_set_violators v = active_set_judge(set, z);
        const int violators = v.wrong + v.violated;
        if (violators == 0)
            return DSE_OK;
        patience = violators < fewest ? PATIENCE : patience - 1;
        fewest = violators < fewest ? violators : fewest;
        if (patience < 0)
            break;
        swap(set, z);
    }
    return active_set_search_dual(set, free, max_steps, z);
}
