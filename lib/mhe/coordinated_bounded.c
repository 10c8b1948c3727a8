/* Coordinated moving horizon estimation: an agent's problems with bounds, as window QPs. */
#include <stddef.h>
#include <stdint.h>

#include "coordinated_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"

static dse_real bound(const dse_real *values, int i, dse_real none)
{
    return values ? values[i] : none;
}

static int max_active(const struct dse_mhe_local *local, int nz)
{
    const int all = local->N * nz, asked = local->config->max_active;
    return asked > 0 && asked < all ? asked : all;
}

/* Memory for pointers, which may want a stricter alignment than reals. */
static const dse_real **take_pointers(int count, struct dse_arena *arena)
{
    unsigned char *at = (unsigned char *)dse_arena_take(arena, DSE_MHE_POINTERS(count));
    while ((uintptr_t)at % _Alignof(dse_real *) != 0)
        at += sizeof(dse_real);
    return (const dse_real **)(void *)at;
}

static enum dse_status take(struct dse_mhe_local *local, struct dse_mhe_bounded *b, int nz, int nr,
                            const struct dse_window_qp_backend *backend, struct dse_arena *arena)
{
    const int N = local->N;
    b->config = (struct dse_window_qp_config){
        .nz = nz, .nr = nr, .stages = N, .max_active = max_active(local, nz), .backend = backend};
    b->below = dse_arena_take(arena, nz * nz);
    b->c = dse_arena_take(arena, N * nz);
    b->lower = dse_arena_take(arena, N * nz);
    b->upper = dse_arena_take(arena, N * nz);
    b->row_lower = dse_arena_take(arena, (N - 1) * nr);
    b->row_upper = dse_arena_take(arena, (N - 1) * nr);
    b->diagonal_block = take_pointers(N, arena);
    b->below_block = take_pointers(N, arena);
    b->problem = (struct dse_window_qp_problem){.diagonal = b->diagonal_block,
                                                .below = b->below_block,
                                                .c = b->c,
                                                .bounds = {.lower = b->lower, .upper = b->upper}};
    return dse_window_qp_init(&b->qp, &b->config, arena);
}

/* z = x with rows w = x(t+1) - A x(t) - h. */
static enum dse_status init_own(struct dse_mhe_local *local, struct dse_arena *arena)
{
    const struct dse_mhe_subsystem *s = local->subsystem;
    struct dse_mhe_bounded *b = &local->own_qp;
    const int nx = local->nx;
    b->E = dse_arena_take(arena, nx * nx);
    const enum dse_status status = take(local, b, nx, nx, local->config->backend, arena);
    if (status != DSE_OK)
        return status;
    for (int i = 0; i < nx; i++) {
        for (int j = 0; j < nx; j++) {
            b->E[i * nx + j] = -s->A[i * nx + j];
            b->below[i * nx + j] = -local->disturbance.AtS[j * nx + i];
        }
    }
    for (int i = 0; i < local->N * nx; i++) {
        b->lower[i] = bound(s->x_min, i % nx, -DSE_REAL_MAX);
        b->upper[i] = bound(s->x_max, i % nx, DSE_REAL_MAX);
    }
    b->problem.bounds.E = b->E;
    b->problem.bounds.row_lower = b->row_lower;
    b->problem.bounds.row_upper = b->row_upper;
    for (int t = 0; t < local->N; t++) {
        b->diagonal_block[t] = local->own_chain.D + t * nx * nx;
        b->below_block[t] = b->below;
    }
    return DSE_OK;
}

/* z = (x, w), bounds only. */
static enum dse_status init_price(struct dse_mhe_local *local, struct dse_arena *arena)
{
    const struct dse_mhe_subsystem *s = local->subsystem;
    struct dse_mhe_bounded *b = &local->price_qp;
    const int nx = local->nx, nz = 2 * nx, N = local->N;
    b->D = dse_arena_take(arena, N * nz * nz);
    b->U = dse_arena_take(arena, (N - 1) * nz * nz);
    const enum dse_status status = take(local, b, nz, 0, local->config->price_backend, arena);
    if (status != DSE_OK)
        return status;
    for (int t = 0; t < N; t++) {
        for (int i = 0; i < nx; i++) {
            b->lower[t * nz + i] = bound(s->x_min, i, -DSE_REAL_MAX);
            b->upper[t * nz + i] = bound(s->x_max, i, DSE_REAL_MAX);
        }
        b->diagonal_block[t] = b->D + t * nz * nz;
        b->below_block[t] = b->below;
    }
    return DSE_OK;
}

enum dse_status mhe_bounded_init(struct dse_mhe_local *local, struct dse_arena *arena)
{
    const enum dse_status status = init_own(local, arena);
    if (status != DSE_OK || local->settings->scheme != DSE_MHE_PRICE)
        return status;
    return init_price(local, arena);
}

static enum dse_status factor_price(struct dse_mhe_local *local)
{
    struct dse_mhe_bounded *b = &local->price_qp;
    const struct dse_mhe_subsystem *s = local->subsystem;
    const int nx = local->nx, nz = 2 * nx, H = local->length;
    struct dse_mhe_chain matrix = {.D = b->D, .U = b->U};
    mhe_price_matrix(&matrix, H, &local->outputs, local->has, &local->disturbance,
                     &local->interaction);
    if (H > 1)
        dse_mat_transpose(nz, nz, b->U, b->below);
    for (int t = 0; t < local->N; t++) { /* the newest sample has no w */
        for (int i = 0; i < nx; i++) {
            const int k = t * nz + nx + i;
            b->lower[k] = t < H - 1 ? bound(s->w_min, i, -DSE_REAL_MAX) : -DSE_REAL_MAX;
            b->upper[k] = t < H - 1 ? bound(s->w_max, i, DSE_REAL_MAX) : DSE_REAL_MAX;
        }
    }
    b->problem.stages = H;
    return dse_window_qp_factor(&b->qp, &b->problem, H - 1);
}

void mhe_bounded_factor(struct dse_mhe_local *local)
{
    struct dse_mhe_bounded *own = &local->own_qp;
    own->problem.stages = local->length;
    if (local->own_status == DSE_OK)
        local->own_status = dse_window_qp_factor(&own->qp, &own->problem, local->length - 1);
    if (local->settings->scheme == DSE_MHE_PRICE && local->price_status == DSE_OK)
        local->price_status = factor_price(local);
}

static dse_real worst(const struct dse_window_qp_certificate *certificate)
{
    return dse_max(dse_max(certificate->primal, certificate->dual), certificate->gap);
}

static int count_active(const struct dse_window_qp *qp, int constraints)
{
    int count = 0;
    for (int k = 0; k < constraints; k++)
        count += dse_window_qp_side(qp, k) != 0;
    return count;
}

enum dse_status mhe_bounded_solve_own(struct dse_mhe_local *local, const dse_real *h)
{
    const struct dse_mhe_subsystem *s = local->subsystem;
    struct dse_mhe_bounded *b = &local->own_qp;
    struct dse_mhe_solution *solution = &local->current;
    const int nx = local->nx, H = local->length;
    for (int i = 0; i < H * nx; i++)
        b->c[i] = local->rhs[i];
    for (int i = 0; i < (H - 1) * nx; i++) { /* w_min + h <= G X <= w_max + h */
        const dse_real offset = h ? h[i] : 0;
        b->row_lower[i] = bound(s->w_min, i % nx, -DSE_REAL_MAX) + offset;
        b->row_upper[i] = bound(s->w_max, i % nx, DSE_REAL_MAX) + offset;
    }
    const enum dse_status status = dse_window_qp_solve(&b->qp, &b->problem);
    if (status != DSE_OK)
        return status;
    const dse_real *z = dse_window_qp_z(&b->qp), *y = dse_window_qp_multipliers(&b->qp);
    for (int i = 0; i < H * nx; i++)
        solution->X[i] = z[i];
    mhe_differences(s, H, solution->X, solution->W);
    for (int t = 0; t < H - 1; t++) { /* lambda = Q^-1 W + y_w */
        dse_real *w = solution->W + t * nx, *lambda = solution->other + t * nx;
        if (h)
            dse_axpy(nx, -1, h + t * nx, w);
        dse_mat_vec(nx, nx, local->disturbance.S, w, lambda);
        dse_axpy(nx, 1, y + t * 2 * nx + nx, lambda);
    }
    local->certificate = worst(&b->qp.certificate);
    local->active = count_active(&b->qp, (2 * H - 1) * nx);
    return DSE_OK;
}

enum dse_status mhe_bounded_solve_price(struct dse_mhe_local *local, const dse_real *p)
{
    struct dse_mhe_bounded *b = &local->price_qp;
    struct dse_mhe_solution *solution = &local->current;
    const int nx = local->nx, nz = 2 * nx, H = local->length;
    if (local->price_status != DSE_OK)
        return local->price_status;
    mhe_differences_transposed(local->subsystem, H, -1, p, local->rhs);
    for (int t = 0; t < H; t++) { /* c_z = (c - g - G'p, p) */
        for (int i = 0; i < nx; i++) {
            b->c[t * nz + i] = local->rhs[t * nx + i];
            b->c[t * nz + nx + i] = t < H - 1 ? p[t * nx + i] : 0;
        }
    }
    const enum dse_status status = dse_window_qp_solve(&b->qp, &b->problem);
    if (status != DSE_OK)
        return status;
    const dse_real *z = dse_window_qp_z(&b->qp);
    for (int t = 0; t < H; t++) {
        for (int i = 0; i < nx; i++) {
            solution->X[t * nx + i] = z[t * nz + i];
            if (t < H - 1)
                solution->W[t * nx + i] = z[t * nz + nx + i];
        }
    }
    mhe_differences(local->subsystem, H, solution->X, solution->other); /* h = G X - W */
    dse_axpy((H - 1) * nx, -1, solution->W, solution->other);
    local->certificate = worst(&b->qp.certificate);
    local->active = count_active(&b->qp, H * nz);
    return DSE_OK;
}
