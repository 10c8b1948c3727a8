/* Active set of a window: constraints and members. */
#include "dse/active_set.h"

#include <stddef.h>

#include "active_set_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"

dse_real active_set_bound(const struct dse_active_set *set, int k, int side)
{
    const struct dse_window_bounds *b = set->bounds;
    const int stride = active_set_stride(set), j = k / stride, i = k % stride;
    const dse_real none = side > 0 ? DSE_REAL_MAX : -DSE_REAL_MAX;
    if (i < set->nz) {
        const dse_real *bound = side > 0 ? b->upper : b->lower;
        return bound ? bound[j * set->nz + i] : none;
    }
    const dse_real *bound = side > 0 ? b->row_upper : b->row_lower;
    return bound ? bound[j * set->nr + i - set->nz] : none;
}

bool active_set_is_equality(const struct dse_active_set *set, int k)
{
    const dse_real upper = active_set_bound(set, k, 1);
    return active_set_is_bounded(upper) && active_set_bound(set, k, -1) == upper;
}

/* z_ji, or E_i z_j + F_i z_{j+1}. */
dse_real active_set_value(const struct dse_active_set *set, int k, const dse_real *z)
{
    const int nz = set->nz, stride = active_set_stride(set), j = k / stride, i = k % stride;
    const dse_real *stage = z + j * nz;
    if (i < nz)
        return stage[i];
    const int r = i - nz;
    const dse_real next =
        set->bounds->F ? dse_dot(nz, set->bounds->F + r * nz, stage + nz) : stage[nz + r];
    return dse_dot(nz, set->bounds->E + r * nz, stage) + next;
}

void active_set_add_normal(const struct dse_active_set *set, int k, dse_real a, dse_real *v)
{
    const int nz = set->nz, stride = active_set_stride(set), j = k / stride, i = k % stride;
    dse_real *stage = v + j * nz;
    if (i < nz) {
        stage[i] += a;
        return;
    }
    const int r = i - nz;
    dse_axpy(nz, a, set->bounds->E + r * nz, stage);
    if (set->bounds->F)
        dse_axpy(nz, a, set->bounds->F + r * nz, stage + nz);
    else
        stage[nz + r] += a;
}

dse_real active_set_size(const struct dse_active_set *set, int k)
{
    const int i = k % active_set_stride(set);
    return i < set->nz ? set->size[i] : set->row_size[i - set->nz];
}

enum dse_status active_set_check_bounds(const struct dse_active_set *set)
{
    for (int k = 0; k < active_set_constraints(set); k++) {
        const dse_real lower = active_set_bound(set, k, -1), upper = active_set_bound(set, k, 1);
        if (lower != lower || upper != upper)
            return DSE_ENONFINITE;
        if (lower > upper || lower >= DSE_REAL_MAX || upper <= -DSE_REAL_MAX)
            return DSE_EINVAL;
    }
    return DSE_OK;
}

void active_set_init(struct dse_active_set *set, int nz, int nr, int capacity, int max_active,
                     struct dse_arena *arena)
{
    const int all = capacity * (nz + nr), slots = max_active + 1;
    *set = (struct dse_active_set){.nz = nz,
                                   .nr = nr,
                                   .capacity = capacity,
                                   .max_active = max_active,
                                   .slots = max_active + 1};
    set->columns = dse_arena_take(arena, slots * capacity * nz);
    set->L = dse_arena_take(arena, slots * slots);
    set->several = dse_arena_take(arena, capacity * nz * DSE_ACTIVE_SET_BATCH);
    set->rows = dse_arena_take(arena, capacity * nr);
    set->unit = dse_arena_take(arena, nz + nr);
    set->size = dse_arena_take(arena, nz);
    set->row_size = dse_arena_take(arena, nr);
    set->y = dse_arena_take(arena, slots);
    set->step = dse_arena_take(arena, slots);
    set->kept = dse_arena_take(arena, slots);
    set->member = (int *)(void *)dse_arena_take(arena, DSE_ARENA_INTS(slots));
    set->owner = (int *)(void *)dse_arena_take(arena, DSE_ARENA_INTS(slots));
    set->slot = (int *)(void *)dse_arena_take(arena, DSE_ARENA_INTS(all));
    set->side = (int *)(void *)dse_arena_take(arena, DSE_ARENA_INTS(all));
    active_set_forget_columns(set);
}

void active_set_clear(struct dse_active_set *set)
{
    for (int m = 0; m < set->count; m++)
        set->side[set->member[m]] = 0;
    set->count = 0;
    set->factored = 0;
}

void active_set_forget_columns(struct dse_active_set *set)
{
    for (int k = 0; k < set->capacity * active_set_stride(set); k++)
        set->slot[k] = -1;
    for (int s = 0; s < set->slots; s++)
        set->owner[s] = -1;
    set->factored = 0;
}

/* Constraint k becomes k - (nz + nr): that of the stage before. Columns stay with their number: K
 * belongs to the window and not to the samples. */
void active_set_slide(struct dse_active_set *set)
{
    const int stride = active_set_stride(set);
    int kept = 0;
    for (int m = 0; m < set->count; m++) {
        const int k = set->member[m], side = set->side[k];
        set->side[k] = 0; /* in ascending order: nobody's new place is overwritten */
        if (k < stride)
            continue;
        set->member[kept++] = k - stride;
        set->side[k - stride] = side;
    }
    set->count = kept;
    set->factored = 0;
}

bool active_set_insert(struct dse_active_set *set, int at, int k, int side)
{
    if (set->count >= set->max_active)
        return false;
    for (int m = set->count; m > at; m--) {
        set->member[m] = set->member[m - 1];
        set->y[m] = set->y[m - 1];
    }
    set->member[at] = k;
    set->y[at] = 0;
    set->side[k] = side;
    set->count++;
    set->factored = set->factored < at ? set->factored : at;
    return true;
}

void active_set_remove(struct dse_active_set *set, int at)
{
    set->side[set->member[at]] = 0;
    set->count--;
    for (int m = at; m < set->count; m++) {
        set->member[m] = set->member[m + 1];
        set->y[m] = set->y[m + 1];
    }
    set->factored = set->factored < at ? set->factored : at;
}

/* By insertion: the set is nearly in order. */
void active_set_sort(struct dse_active_set *set)
{
    for (int m = 1; m < set->count; m++) {
        const int k = set->member[m];
        const dse_real y = set->y[m];
        int at = m;
        for (; at > 0 && set->member[at - 1] > k; at--) {
            set->member[at] = set->member[at - 1];
            set->y[at] = set->y[at - 1];
        }
        set->member[at] = k;
        set->y[at] = y;
        if (at < m && set->factored > at)
            set->factored = at;
    }
}

void active_set_begin(struct dse_active_set *set, int stages,
                      const struct dse_window_bounds *bounds)
{
    set->stages = stages;
    set->bounds = bounds;
    const int all = active_set_constraints(set);
    for (int m = set->count - 1; m >= 0; m--) {
        const int k = set->member[m];
        if (k >= all || !active_set_is_bounded(active_set_bound(set, k, set->side[k])))
            active_set_remove(set, m);
    }
    for (int k = 0, at = 0; k < all; k++) {
        if (at < set->count && set->member[at] == k)
            at++;
        else if (active_set_is_equality(set, k))
            at += active_set_insert(set, at, k, 1);
    }
}
