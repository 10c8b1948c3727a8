/* Active set of a window: columns of K, the factor of S = N K N', solutions. */
#include <stddef.h>

#include "active_set_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"

static int column_length(const struct dse_active_set *set)
{
    return set->capacity * set->nz;
}

/* A column that no member needs. There is one more than there can be members. */
static int free_slot(const struct dse_active_set *set)
{
    for (int s = 0; s < set->slots; s++)
        if (set->owner[s] < 0)
            return s;
    for (int s = 0; s < set->slots; s++)
        if (set->side[set->owner[s]] == 0)
            return s;
    return -1;
}

static bool claim_slot(struct dse_active_set *set, int k)
{
    const int s = free_slot(set);
    if (s < 0)
        return false;
    if (set->owner[s] >= 0)
        set->slot[set->owner[s]] = -1;
    set->owner[s] = k;
    set->slot[k] = s;
    return true;
}

/* Columns of `count` constraints at once, at most a batch. */
static enum dse_status make_columns(struct dse_active_set *set, int count, const int *constraints)
{
    const int nz = set->nz, rows = set->stages * nz, stride = active_set_stride(set);
    dse_real *X = set->several;
    int newest = 0;
    for (int i = 0; i < rows * count; i++)
        X[i] = 0;
    for (int c = 0; c < count; c++) {
        const int k = constraints[c], j = k / stride, i = k % stride;
        newest = j + (i >= nz) > newest ? j + (i >= nz) : newest;
        if (!claim_slot(set, k))
            return DSE_ESTORAGE;
        dse_real *column = set->columns + set->slot[k] * column_length(set);
        for (int p = 0; p < rows; p++)
            column[p] = 0;
        active_set_add_normal(set, k, 1, column);
        for (int p = j * nz; p < (j + 2) * nz && p < rows; p++)
            X[p * count + c] = column[p];
    }
    const enum dse_status status = set->apply(set->context, count, newest, X);
    if (status != DSE_OK) {
        active_set_forget_columns(set);
        return status;
    }
    for (int c = 0; c < count; c++) {
        dse_real *column = set->columns + set->slot[constraints[c]] * column_length(set);
        for (int p = 0; p < rows; p++)
            column[p] = X[p * count + c];
    }
    return DSE_OK;
}

static enum dse_status make_missing_columns(struct dse_active_set *set)
{
    int batch[DSE_ACTIVE_SET_BATCH], count = 0;
    enum dse_status status = DSE_OK;
    for (int m = 0; m < set->count && status == DSE_OK; m++) {
        if (set->slot[set->member[m]] < 0)
            batch[count++] = set->member[m];
        if (count == DSE_ACTIVE_SET_BATCH) {
            status = make_columns(set, count, batch);
            count = 0;
        }
    }
    if (status == DSE_OK && count > 0)
        status = make_columns(set, count, batch);
    return status;
}

const dse_real *active_set_column(struct dse_active_set *set, int k)
{
    if (set->slot[k] < 0 && make_columns(set, 1, &k) != DSE_OK)
        return NULL;
    return set->columns + set->slot[k] * column_length(set);
}

dse_real active_set_terms(const struct dse_active_set *set, int k, const dse_real *v)
{
    const int nz = set->nz, stride = active_set_stride(set), j = k / stride, i = k % stride;
    const dse_real *stage = v + j * nz;
    if (i < nz)
        return dse_abs(stage[i]);
    const int r = i - nz;
    const dse_real *E = set->bounds->E + r * nz, *F = set->bounds->F;
    dse_real sum = F ? 0 : dse_abs(stage[nz + r]);
    for (int p = 0; p < nz; p++) {
        sum += dse_abs(E[p] * stage[p]);
        sum += F ? dse_abs(F[r * nz + p] * stage[nz + p]) : 0;
    }
    return sum;
}

/* Row and pivot of constraint k after `at` members; false: it depends on them.
 *     L_kj = (S_kj - sum_{p<j} L_kp L_jp) / L_jj,  L_kk^2 = S_kk - sum_p L_kp^2. */
static bool append(struct dse_active_set *set, int at, int k, const dse_real *column)
{
    const int width = set->slots;
    dse_real *l = set->L + at * width;
    for (int m = 0; m < at; m++) {
        const dse_real *row = set->L + m * width;
        l[m] = (active_set_value(set, set->member[m], column) - dse_dot(m, l, row)) / row[m];
    }
    const dse_real rest = active_set_value(set, k, column) - dse_dot(at, l, l);
    if (!(rest > ACTIVE_SET_DEPENDENT * active_set_terms(set, k, column)))
        return false;
    l[at] = dse_sqrt(rest);
    return true;
}

enum dse_status active_set_factor(struct dse_active_set *set)
{
    const enum dse_status status = make_missing_columns(set);
    if (status != DSE_OK)
        return status;
    while (set->factored < set->count) {
        const int at = set->factored, k = set->member[at];
        const dse_real *column = set->columns + set->slot[k] * column_length(set);
        if (append(set, at, k, column))
            set->factored++;
        else
            active_set_remove(set, at);
    }
    return DSE_OK;
}

void active_set_solve_factor(const struct dse_active_set *set, dse_real *step)
{
    const int n = set->count, width = set->slots;
    for (int i = 0; i < n; i++) {
        const dse_real *l = set->L + i * width;
        step[i] = (step[i] - dse_dot(i, l, step)) / l[i];
    }
    for (int i = n - 1; i >= 0; i--) {
        const dse_real *l = set->L + i * width;
        step[i] /= l[i];
        dse_axpy(i, -step[i], l, step);
    }
}

void active_set_subtract(const struct dse_active_set *set, const dse_real *step, dse_real *v)
{
    for (int m = 0; m < set->count; m++)
        dse_axpy(set->stages * set->nz, -step[m],
                 set->columns + set->slot[set->member[m]] * column_length(set), v);
}

/* y = S^-1 (N z - b),  z <- z - K N' y. */
void active_set_solve(struct dse_active_set *set, dse_real *z)
{
    for (int m = 0; m < set->count; m++) {
        const int k = set->member[m];
        set->y[m] = active_set_value(set, k, z) - active_set_bound(set, k, set->side[k]);
    }
    active_set_solve_factor(set, set->y);
    active_set_subtract(set, set->y, z);
}

/* dy = S^-1 (N (z + dz) - b),  dz <- dz - K N' dy. */
void active_set_correct(struct dse_active_set *set, const dse_real *z, dse_real *dz)
{
    for (int m = 0; m < set->count; m++) {
        const int k = set->member[m];
        const dse_real off = active_set_value(set, k, z) - active_set_bound(set, k, set->side[k]);
        set->step[m] = active_set_value(set, k, dz) + off;
    }
    active_set_solve_factor(set, set->step);
    active_set_subtract(set, set->step, dz);
    dse_axpy(set->count, 1, set->step, set->y);
}

/* v <- v - K N' S^-1 N v. */
void active_set_project(struct dse_active_set *set, dse_real *v)
{
    for (int m = 0; m < set->count; m++)
        set->step[m] = active_set_value(set, set->member[m], v);
    active_set_solve_factor(set, set->step);
    active_set_subtract(set, set->step, v);
}

enum dse_status active_set_solve_members(struct dse_active_set *set, const dse_real *free,
                                         dse_real *z)
{
    const enum dse_status status = active_set_factor(set);
    if (status != DSE_OK)
        return status;
    for (int i = 0; i < set->stages * set->nz; i++)
        z[i] = free[i];
    active_set_solve(set, z);
    return dse_all_finite(z, set->stages * set->nz) ? DSE_OK : DSE_ENONFINITE;
}
