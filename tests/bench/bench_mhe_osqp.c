/* Bounded windows in OSQP alone, at 1e-8, from its own warm start. */
#include <osqp.h>
#include <string.h>

#include "bench_mhe_bounded.h"
#include "dse/window_qp_osqp.h"

static double memory[DSE_WINDOW_QP_OSQP_STORAGE(NX_MAX, NX_MAX, N_MAX)];
static struct dse_window_qp_osqp osqp;
static struct dse_window_qp_problem problem;
static double c[UNKNOWNS_MAX], q[UNKNOWNS_MAX], x[UNKNOWNS_MAX];
static double l[2 * UNKNOWNS_MAX], u[2 * UNKNOWNS_MAX];
static long sample;
static int unknowns;

static bool solve(const struct windows *w)
{
    OSQPSolver *solver = osqp.solver;
    bench_window_linear(w, sample, c);
    for (int i = 0; i < unknowns; i++)
        q[i] = -c[i] * osqp.scale[i];
    if (osqp_update_data_vec(solver, q, NULL, NULL) != 0 || osqp_solve(solver) != 0)
        return false;
    for (int i = 0; i < unknowns; i++)
        x[i] = solver->solution->x[i] * osqp.scale[i];
    return solver->info->status_val == OSQP_SOLVED;
}

static bool make(const struct windows *w)
{
    struct dse_arena arena;
    bench_window_problem(w, &problem);
    dse_arena_init(&arena, memory, (int)(sizeof memory / sizeof memory[0]));
    if (dse_window_qp_osqp_setup(&osqp, &problem, w->n, w->n, &arena) != DSE_OK)
        return false;
    OSQPSolver *solver = osqp.solver;
    OSQPSettings settings = *solver->settings;
    settings.eps_abs = settings.eps_rel = 1e-8;
    settings.warm_starting = 1;
    unknowns = w->n * w->N;
    const int rows = w->n * (w->N - 1);
    for (int i = 0; i < unknowns + rows; i++) {
        const bool bound = i < unknowns;
        u[i] = bound ? w->x_max / osqp.scale[i] : w->w_max / osqp.row_scale[i - unknowns];
        l[i] = -u[i];
    }
    sample = w->N - 1;
    return osqp_update_settings(solver, &settings) == 0 &&
           osqp_update_data_vec(solver, NULL, l, u) == 0 && solve(w);
}

static bool step(const struct windows *w)
{
    sample++;
    return solve(w);
}

static const double *solution(void)
{
    return x;
}

static double effort(void)
{
    return (double)((OSQPSolver *)osqp.solver)->info->iter;
}

static void drop(void)
{
    dse_window_qp_osqp_cleanup(&osqp);
}

const struct contender bench_mhe_osqp = {"OSQP alone, 1e-8", make, step, solution, effort, drop};
