/* Bounded windows: the estimator, with all that it does in a sample, and the window QP alone. */
#include <string.h>

#include "bench_mhe_bounded.h"
#include "dse/linalg.h"
#include "dse/linear_mhe.h"
#include "dse/window_qp.h"

static double identity[NX_MAX * NX_MAX], x_low[UNKNOWNS_MAX], x_high[UNKNOWNS_MAX];
static double w_low[UNKNOWNS_MAX], w_high[UNKNOWNS_MAX], R[NY_MAX * NY_MAX];

static void fill_bounds(const struct windows *w)
{
    for (int i = 0; i < UNKNOWNS_MAX; i++) {
        x_low[i] = -w->x_max;
        x_high[i] = w->x_max;
        w_low[i] = -w->w_max;
        w_high[i] = w->w_max;
    }
    dse_mat_identity(w->n, identity);
    dse_mat_identity(w->m, R);
}

/* ---- the estimator ---- */

static double memory[DSE_LINEAR_MHE_BOUNDED_STORAGE(NX_MAX, NY_MAX, N_MAX, UNKNOWNS_MAX)];
static struct dse_linear_mhe mhe;
static struct dse_linear_mhe_config config;

static bool step_estimator(const struct windows *w)
{
    const struct dse_measurement sample = {window_sample(w, mhe.newest + 1), NULL};
    return dse_linear_mhe_advance(&mhe, NULL) == DSE_OK &&
           dse_linear_mhe_measure(&mhe, 0, NULL, &sample) == DSE_OK &&
           dse_linear_mhe_solve(&mhe) == DSE_OK && dse_linear_mhe_path(&mhe) <= DSE_PATH_DUAL;
}

static bool make_estimator(const struct windows *w)
{
    struct dse_arena arena;
    fill_bounds(w);
    config = (struct dse_linear_mhe_config){.nx = w->n,
                                            .ny = w->m,
                                            .linear = {w->A, NULL, w->C, NULL},
                                            .horizon = w->N,
                                            .arrival = DSE_ARRIVAL_NONE,
                                            .min_horizon = w->N,
                                            .Q = identity,
                                            .R = R,
                                            .x_min = x_low,
                                            .x_max = x_high,
                                            .w_min = w_low,
                                            .w_max = w_high};
    dse_arena_init(&arena, memory, (int)(sizeof memory / sizeof memory[0]));
    if (dse_linear_mhe_init(&mhe, &config, &arena) != DSE_OK)
        return false;
    const struct dse_measurement first = {window_sample(w, 0), NULL};
    bool ok = dse_linear_mhe_measure(&mhe, 0, NULL, &first) == DSE_OK;
    for (int k = 1; k < w->N && ok; k++)
        ok = step_estimator(w);
    return ok;
}

static const double *solution_of_estimator(void)
{
    return dse_linear_mhe_window(&mhe);
}

static double active_of_estimator(void)
{
    return mhe.set.count;
}

static void drop_nothing(void)
{
}

const struct contender bench_mhe_estimator = {
    "dse: the whole estimator", make_estimator,      step_estimator,
    solution_of_estimator,      active_of_estimator, drop_nothing};

/* ---- the window QP ---- */

static double oldest[NX_MAX * NX_MAX], between[NX_MAX * NX_MAX], newest[NX_MAX * NX_MAX];
static double minus_A[NX_MAX * NX_MAX];
static const double *diagonal[N_MAX], *below[N_MAX];

void bench_window_problem(const struct windows *w, struct dse_window_qp_problem *problem)
{
    const int n = w->n, size = n * n;
    fill_bounds(w);
    dse_mat_mul_tn(n, w->m, n, w->C, w->C, newest); /* C'C + I */
    dse_mat_mul_tn(n, n, n, w->A, w->A, oldest);    /* C'C + A'A */
    for (int i = 0; i < size; i++) {
        oldest[i] += newest[i];
        newest[i] += identity[i];
        between[i] = oldest[i] + identity[i];
        minus_A[i] = -w->A[i];
    }
    for (int j = 0; j < w->N; j++) {
        diagonal[j] = j == 0 ? oldest : j + 1 < w->N ? between : newest;
        below[j] = minus_A;
    }
    *problem = (struct dse_window_qp_problem){.stages = w->N, .diagonal = diagonal, .below = below};
    problem->bounds = (struct dse_window_bounds){
        .lower = x_low, .upper = x_high, .E = minus_A, .row_lower = w_low, .row_upper = w_high};
}

void bench_window_linear(const struct windows *w, long k, double *c)
{
    for (int j = 0; j < w->N; j++)
        dse_mat_tvec(w->m, w->n, w->C, window_sample(w, k - w->N + 1 + j), c + j * w->n);
}

static double qp_memory[DSE_WINDOW_QP_STORAGE(NX_MAX, NX_MAX, N_MAX, UNKNOWNS_MAX)];
static struct dse_window_qp qp;
static struct dse_window_qp_config qp_config;
static struct dse_window_qp_problem problem;
static double c[UNKNOWNS_MAX];
static long sample;

static bool make_window_qp(const struct windows *w)
{
    struct dse_arena arena;
    bench_window_problem(w, &problem);
    problem.c = c;
    qp_config = (struct dse_window_qp_config){.nz = w->n, .nr = w->n, .stages = w->N};
    dse_arena_init(&arena, qp_memory, (int)(sizeof qp_memory / sizeof qp_memory[0]));
    sample = w->N - 1;
    bench_window_linear(w, sample, c);
    return dse_window_qp_init(&qp, &qp_config, &arena) == DSE_OK &&
           dse_window_qp_factor(&qp, &problem, w->N - 1) == DSE_OK &&
           dse_window_qp_solve(&qp, &problem) == DSE_OK;
}

static bool step_window_qp(const struct windows *w)
{
    const int all = w->n * w->N;
    memmove(c, c + w->n, (size_t)(all - w->n) * sizeof c[0]);
    dse_mat_tvec(w->m, w->n, w->C, window_sample(w, ++sample), c + all - w->n);
    dse_window_qp_slide(&qp);
    return dse_window_qp_solve(&qp, &problem) == DSE_OK;
}

static const double *solution_of_window_qp(void)
{
    return dse_window_qp_z(&qp);
}

static double active_of_window_qp(void)
{
    return qp.set.count;
}

const struct contender bench_mhe_window_qp = {"dse: window QP alone", make_window_qp,
                                              step_window_qp,         solution_of_window_qp,
                                              active_of_window_qp,    drop_nothing};
