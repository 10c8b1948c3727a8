/* Bounded windows in DAQP: dense, its matrices set up once. */
#include <api.h>
#include <stdlib.h>
#include <utils.h>

#include "bench_mhe_bounded.h"
#include "dse/window_qp.h"

static DAQPWorkspace work;
static DAQPProblem qp;
static DAQPResult result;
static struct dse_window_qp_problem problem;
static double *H, *rows;
static double f[UNKNOWNS_MAX], upper[2 * UNKNOWNS_MAX], lower[2 * UNKNOWNS_MAX];
static double x[UNKNOWNS_MAX], multipliers[2 * UNKNOWNS_MAX];
static int sense[2 * UNKNOWNS_MAX];
static long sample;

static void fill_dense(const struct windows *w)
{
    const int n = w->n, all = n * w->N;
    for (int j = 0; j < w->N; j++) {
        for (int i = 0; i < n * n; i++) {
            const int row = j * n + i / n, column = j * n + i % n;
            H[row * all + column] = problem.diagonal[j][i];
            if (j + 1 == w->N)
                continue;
            H[(row + n) * all + column] = problem.below[j][i];
            H[column * all + row + n] = problem.below[j][i];
            rows[row * all + column] = problem.bounds.E[i];
            rows[row * all + column + n] = i / n == i % n;
        }
    }
}

static void linear_term(const struct windows *w)
{
    bench_window_linear(w, sample, f);
    for (int i = 0; i < w->n * w->N; i++)
        f[i] = -f[i];
}

static bool solve(void)
{
    daqp_solve(&result, &work);
    return result.exitflag > 0;
}

static bool make(const struct windows *w)
{
    const int all = w->n * w->N, count = all - w->n;
    bench_window_problem(w, &problem);
    H = calloc((size_t)(all * all), sizeof *H);
    rows = calloc((size_t)(count * all), sizeof *rows);
    if (!H || !rows)
        return false;
    fill_dense(w);
    for (int i = 0; i < all + count; i++) {
        upper[i] = i < all ? w->x_max : w->w_max;
        lower[i] = -upper[i];
        sense[i] = 0;
    }
    sample = w->N - 1;
    linear_term(w);
    qp = (DAQPProblem){.n = all,
                       .m = all + count,
                       .ms = all,
                       .H = H,
                       .f = f,
                       .A = rows,
                       .bupper = upper,
                       .blower = lower,
                       .sense = sense};
    work = (DAQPWorkspace){.settings = NULL};
    double seconds;
    if (setup_daqp(&qp, &work, &seconds) < 0)
        return false;
    work.settings->primal_tol = 1e-8;
    result.x = x;
    result.lam = multipliers;
    return solve();
}

static bool step(const struct windows *w)
{
    sample++;
    linear_term(w);
    return update_ldp(UPDATE_v | UPDATE_d, &work) >= 0 && solve();
}

static const double *solution(void)
{
    return x;
}

static double effort(void)
{
    return result.iter;
}

static void drop(void)
{
    free_daqp_workspace(&work);
    free_daqp_ldp(&work);
    free(H);
    free(rows);
}

const struct contender bench_mhe_daqp = {"DAQP, 1e-8", make, step, solution, effort, drop};
