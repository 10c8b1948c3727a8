/* Window QP: set-up, the warm start, read access, sensitivities. */
#include "dse/window_qp.h"

#include <stddef.h>

#include "active_set_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"
#include "window_qp_internal.h"

static enum dse_status check_config(const struct dse_window_qp_config *config)
{
    if (config->nz < 1 || config->nr < 0 || config->stages < 1)
        return DSE_EINVAL;
    if (config->max_active < 0 || config->max_active > config->nz * config->stages)
        return DSE_EINVAL;
    if (config->max_passes < -1 || config->max_steps < -1)
        return DSE_EINVAL;
    if (!(config->tolerance >= 0) || !dse_is_finite(config->tolerance))
        return DSE_EINVAL;
    if (config->backend && !config->backend->solve)
        return DSE_EINVAL;
    return DSE_OK;
}

enum dse_status dse_window_qp_init(struct dse_window_qp *qp,
                                   const struct dse_window_qp_config *config,
                                   struct dse_arena *arena)
{
    const enum dse_status status = check_config(config);
    if (status != DSE_OK)
        return status;
    const int nz = config->nz, nr = config->nr, H = config->stages;
    const int max_active = config->max_active > 0 ? config->max_active : nz * H;
    if (arena->capacity - arena->used < DSE_WINDOW_QP_STORAGE(nz, nr, H, max_active))
        return DSE_ESTORAGE;
    *qp = (struct dse_window_qp){.config = config, .nz = nz, .nr = nr, .capacity = H};
    active_set_init(&qp->set, nz, nr, H, max_active, arena);
    qp->L = dse_arena_take(arena, H * nz * nz);
    qp->W = dse_arena_take(arena, H * nz * nz);
    qp->free = dse_arena_take(arena, H * nz);
    qp->z = dse_arena_take(arena, H * nz);
    qp->z_next = dse_arena_take(arena, H * nz);
    qp->residual = dse_arena_take(arena, H * nz);
    qp->work = dse_arena_take(arena, H * nz);
    qp->y = dse_arena_take(arena, H * (nz + nr));
    qp->y_next = dse_arena_take(arena, H * (nz + nr));
    qp->dual_size = dse_arena_take(arena, nz);
    qp->largest = dse_arena_take(arena, nz);
    qp->product = dse_arena_take(arena, nz * DSE_ACTIVE_SET_BATCH);
    qp->side = (int *)(void *)dse_arena_take(arena, DSE_ARENA_INTS(H * (nz + nr)));
    qp->set.apply = window_qp_apply;
    qp->set.context = qp;
    return DSE_OK;
}

/* ---- the warm start ---- */

void dse_window_qp_slide(struct dse_window_qp *qp)
{
    active_set_sort(&qp->set);
    active_set_slide(&qp->set);
}

void dse_window_qp_forget(struct dse_window_qp *qp)
{
    active_set_clear(&qp->set);
}

/* ---- the last solution ---- */

const dse_real *dse_window_qp_z(const struct dse_window_qp *qp)
{
    return qp->z;
}

const dse_real *dse_window_qp_multipliers(const struct dse_window_qp *qp)
{
    return qp->y;
}

int dse_window_qp_side(const struct dse_window_qp *qp, int k)
{
    return qp->side[k];
}

void dse_window_qp_bitmap(const struct dse_window_qp *qp, unsigned char *bitmap)
{
    const int all = qp->stages * (qp->nz + qp->nr);
    for (int b = 0; b < (all + 7) / 8; b++)
        bitmap[b] = 0;
    for (int k = 0; k < all; k++)
        if (qp->side[k] != 0)
            bitmap[k / 8] = (unsigned char)(bitmap[k / 8] | 1U << k % 8);
}

/* ---- sensitivities ---- */

enum dse_status dse_window_qp_take_bitmap(struct dse_window_qp *qp,
                                          const struct dse_window_qp_problem *problem,
                                          const unsigned char *bitmap)
{
    struct dse_active_set *set = &qp->set;
    if (qp->factored == 0 || problem->stages != qp->factored)
        return DSE_EINVAL;
    active_set_clear(set);
    set->stages = problem->stages;
    set->bounds = &problem->bounds;
    for (int k = 0; k < active_set_constraints(set); k++) {
        if (!(bitmap[k / 8] >> k % 8 & 1))
            continue;
        if (!active_set_insert(set, set->count, k, 1)) {
            active_set_clear(set);
            return DSE_ESTORAGE;
        }
    }
    const int wanted = set->count;
    enum dse_status status = active_set_factor(set);
    if (status == DSE_OK && set->count < wanted)
        status = DSE_ESINGULAR;
    if (status != DSE_OK)
        active_set_clear(set);
    return status;
}

/* X = (K - K N' S^-1 N K) X, some columns at a time. */
enum dse_status dse_window_qp_respond(struct dse_window_qp *qp, int m, dse_real *X)
{
    struct dse_active_set *set = &qp->set;
    const int rows = qp->factored * qp->nz;
    if (qp->factored == 0 || set->stages != qp->factored)
        return DSE_EINVAL;
    enum dse_status status = active_set_factor(set);
    for (int first = 0; first < m && status == DSE_OK; first += DSE_ACTIVE_SET_BATCH) {
        const int count = m - first < DSE_ACTIVE_SET_BATCH ? m - first : DSE_ACTIVE_SET_BATCH;
        dse_real *several = set->several;
        for (int i = 0; i < rows; i++)
            for (int c = 0; c < count; c++)
                several[i * count + c] = X[i * m + first + c];
        status = window_qp_apply(qp, count, qp->factored - 1, several);
        for (int c = 0; c < count; c++) {
            for (int i = 0; i < rows; i++)
                qp->work[i] = several[i * count + c];
            active_set_project(set, qp->work);
            for (int i = 0; i < rows; i++)
                X[i * m + first + c] = qp->work[i];
        }
    }
    return status;
}
