/* Window QP: an OSQP workspace on a host. */
#include <osqp.h>
#include <stddef.h>

#include "dse/math.h"
#include "dse/window_qp_osqp.h"
#include "window_qp_osqp_internal.h"

_Static_assert(sizeof(OSQPFloat) <= sizeof(dse_real) && sizeof(OSQPInt) <= sizeof(dse_real),
               "a real of the arena holds a number of OSQP's");

/* Matrices and vectors while OSQP copies them: in the arena, given back after that. */
struct parts {
    OSQPFloat *P_x, *A_x, *q, *l, *u;
    OSQPInt *P_i, *P_p, *A_i, *A_p;
};

static OSQPFloat *take_numbers(struct dse_arena *arena, int count)
{
    return (void *)dse_arena_take(arena, count);
}

static OSQPInt *take_indices(struct dse_arena *arena, int count)
{
    return (void *)dse_arena_take(arena, count);
}

/* DSE_WINDOW_QP_OSQP_PARTS, all zero. */
static struct parts take_parts(struct dse_arena *arena, int n, int m, int P_count, int A_count)
{
    return (struct parts){.P_x = take_numbers(arena, P_count),
                          .A_x = take_numbers(arena, A_count),
                          .q = take_numbers(arena, n),
                          .l = take_numbers(arena, m),
                          .u = take_numbers(arena, m),
                          .P_i = take_indices(arena, P_count),
                          .P_p = take_indices(arena, n + 1),
                          .A_i = take_indices(arena, A_count),
                          .A_p = take_indices(arena, n + 1)};
}

/* scale = 1 / sqrt(P_ii), row_scale = |N_r S|. */
static bool find_scales(const struct dse_window_qp_problem *problem, int nz, int nr,
                        dse_real *scale, dse_real *row_scale)
{
    const int H = problem->stages;
    const struct dse_window_bounds *b = &problem->bounds;
    for (int i = 0; i < H * nz; i++)
        scale[i] = 1 / dse_sqrt(problem->diagonal[i / nz][i % nz * (nz + 1)]);
    for (int r = 0; r < (H - 1) * nr; r++) {
        const dse_real *s = scale + r / nr * nz, *next = s + nz;
        dse_real sum = 0;
        for (int i = 0; i < nz; i++) {
            const dse_real e = b->E[r % nr * nz + i] * s[i];
            const dse_real f = (b->F ? b->F[r % nr * nz + i] : (dse_real)(i == r % nr)) * next[i];
            sum += e * e + f * f;
        }
        row_scale[r] = sum > 0 ? dse_sqrt(sum) : 1;
    }
    return dse_all_finite(scale, H * nz) && dse_all_finite(row_scale, (H - 1) * nr);
}

static void fill_P_pattern(int nz, int H, struct parts *p)
{
    OSQPInt count = 0;
    for (int c = 0; c < H * nz; c++) {
        const int first = c < nz ? 0 : (c / nz - 1) * nz;
        p->P_p[c] = count;
        for (int r = first; r <= c; r++)
            p->P_i[count++] = r;
    }
    p->P_p[H * nz] = count;
}

/* Column (j, i): its bound, F_.i of the rows from stage j - 1, E_.i of those from stage j. */
static void fill_A(const struct dse_window_qp_osqp *osqp,
                   const struct dse_window_qp_problem *problem, struct parts *p)
{
    const int nz = osqp->nz, nr = osqp->nr, H = osqp->stages;
    const struct dse_window_bounds *b = &problem->bounds;
    OSQPInt count = 0;
    for (int c = 0; c < H * nz; c++) {
        const int j = c / nz, i = c % nz;
        p->A_p[c] = count;
        p->A_i[count] = c;
        p->A_x[count++] = 1;
        for (int from = j - 1; from <= j; from++) {
            for (int r = 0; r < nr && from >= 0 && from + 1 < H; r++) {
                const dse_real F = b->F ? b->F[r * nz + i] : (dse_real)(i == r);
                const dse_real a = from < j ? F : b->E[r * nz + i];
                p->A_i[count] = H * nz + from * nr + r;
                p->A_x[count++] = (OSQPFloat)(a * osqp->scale[c] / osqp->row_scale[from * nr + r]);
            }
        }
    }
    p->A_p[H * nz] = count;
}

static void fill_settings(OSQPSettings *settings)
{
    osqp_set_default_settings(settings);
    settings->verbose = 0;
    settings->eps_abs = (OSQPFloat)1e-6;
    settings->eps_rel = (OSQPFloat)1e-6;
    settings->max_iter = 20000;
    settings->adaptive_rho = OSQP_ADAPTIVE_RHO_UPDATE_ITERATIONS; /* by iterations, not by time */
    settings->adaptive_rho_interval = 50;
    settings->profiler_level = 0;
}

static bool set_up(struct dse_window_qp_osqp *osqp, const struct dse_window_qp_problem *problem,
                   struct dse_arena *arena)
{
    const int nz = osqp->nz, H = osqp->stages, n = H * nz, m = n + (H - 1) * osqp->nr;
    const int P_count = H * nz * (nz + 1) / 2 + (H - 1) * nz * nz;
    const int A_count = n + 2 * (H - 1) * osqp->nr * nz;
    const int kept = arena->used;
    struct parts p = take_parts(arena, n, m, P_count, A_count);
    OSQPSettings settings;
    OSQPSolver *solver = NULL;
    OSQPCscMatrix P, A;
    fill_P_pattern(nz, H, &p);
    window_qp_osqp_write_P(osqp, problem, p.P_x);
    fill_A(osqp, problem, &p);
    for (int i = 0; i < m; i++) {
        p.l[i] = -OSQP_INFTY;
        p.u[i] = OSQP_INFTY;
    }
    OSQPCscMatrix_set_data(&P, n, n, P_count, p.P_x, p.P_i, p.P_p);
    OSQPCscMatrix_set_data(&A, m, n, A_count, p.A_x, p.A_i, p.A_p);
    fill_settings(&settings);
    const bool ok = osqp_setup(&solver, &P, p.q, &A, p.l, p.u, m, n, &settings) == 0;
    arena->used = kept;
    osqp->solver = solver;
    return ok;
}

enum dse_status dse_window_qp_osqp_setup(struct dse_window_qp_osqp *osqp,
                                         const struct dse_window_qp_problem *problem, int nz,
                                         int nr, struct dse_arena *arena)
{
    const int H = problem->stages;
    if (nz < 1 || nr < 0 || H < 1 || (nr > 0 && !problem->bounds.E))
        return DSE_EINVAL;
    if (arena->capacity - arena->used < DSE_WINDOW_QP_OSQP_STORAGE(nz, nr, H))
        return DSE_ESTORAGE;
    dse_real *scale = dse_arena_take(arena, H * nz);
    dse_real *row_scale = dse_arena_take(arena, (H - 1) * nr);
    *osqp = (struct dse_window_qp_osqp){
        .nz = nz, .nr = nr, .stages = H, .scale = scale, .row_scale = row_scale};
    osqp->numbers = dse_arena_take(arena, DSE_WINDOW_QP_OSQP_NUMBERS(nz, nr, H));
    if (!find_scales(problem, nz, nr, scale, row_scale))
        return DSE_EINVAL;
    if (set_up(osqp, problem, arena))
        return DSE_OK;
    dse_window_qp_osqp_cleanup(osqp);
    return DSE_ENOCONV;
}

void dse_window_qp_osqp_cleanup(struct dse_window_qp_osqp *osqp)
{
    if (osqp->solver)
        (void)osqp_cleanup(osqp->solver);
    osqp->solver = NULL;
}
