/* Bounded windows in HPIPM: an optimal control problem with the disturbances as inputs, whose
 * matrices are set once and whose linear terms slide. */
#include <blasfeo_d_aux_ext_dep.h>
#include <hpipm_common.h>
#include <hpipm_d_ocp_qp.h>
#include <hpipm_d_ocp_qp_dim.h>
#include <hpipm_d_ocp_qp_ipm.h>
#include <hpipm_d_ocp_qp_sol.h>
#include <stdlib.h>

#include "bench_mhe_bounded.h"
#include "dse/linalg.h"

static struct d_ocp_qp_dim dim;
static struct d_ocp_qp qp;
static struct d_ocp_qp_sol sol;
static struct d_ocp_qp_ipm_arg arg;
static struct d_ocp_qp_ipm_ws ws;
static void *memory[5];
static double x[UNKNOWNS_MAX];
static long sample;
static int horizon, states;

static bool take(int which, hpipm_size_t bytes)
{
    memory[which] = malloc(bytes);
    return memory[which] != NULL;
}

static void linear_terms(const struct windows *w)
{
    double q[NX_MAX];
    for (int j = 0; j < w->N; j++) {
        dse_mat_tvec(w->m, w->n, w->C, window_sample(w, sample - w->N + 1 + j), q);
        for (int i = 0; i < w->n; i++)
            q[i] = -q[i];
        d_ocp_qp_set_q(j, q, &qp);
    }
}

static bool solve(void)
{
    int status;
    d_ocp_qp_ipm_solve(&qp, &sol, &arg, &ws);
    d_ocp_qp_ipm_get_status(&ws, &status);
    for (int j = 0; j < horizon; j++)
        d_ocp_qp_sol_get_x(j, &sol, x + j * states);
    return status == 0;
}

/* HPIPM's matrices are column-major. */
static void set_matrices(const struct windows *w)
{
    const int n = w->n;
    double A[NX_MAX * NX_MAX], I[NX_MAX * NX_MAX], weight[NX_MAX * NX_MAX];
    double x_low[NX_MAX], x_high[NX_MAX], w_low[NX_MAX], w_high[NX_MAX];
    int all[NX_MAX];
    dse_mat_transpose(n, n, w->A, A);
    dse_mat_identity(n, I);
    dse_mat_mul_tn(n, w->m, n, w->C, w->C, weight);
    for (int i = 0; i < n; i++) {
        all[i] = i;
        x_high[i] = w->x_max;
        x_low[i] = -w->x_max;
        w_high[i] = w->w_max;
        w_low[i] = -w->w_max;
    }
    for (int j = 0; j < w->N; j++) {
        d_ocp_qp_set_Q(j, weight, &qp);
        d_ocp_qp_set_idxbx(j, all, &qp);
        d_ocp_qp_set_lbx(j, x_low, &qp);
        d_ocp_qp_set_ubx(j, x_high, &qp);
        if (j + 1 == w->N)
            break;
        d_ocp_qp_set_A(j, A, &qp);
        d_ocp_qp_set_B(j, I, &qp);
        d_ocp_qp_set_R(j, I, &qp);
        d_ocp_qp_set("idxbu", j, all, &qp);
        d_ocp_qp_set("lbu", j, w_low, &qp);
        d_ocp_qp_set("ubu", j, w_high, &qp);
    }
}

static bool make(const struct windows *w)
{
    int nx[N_MAX], nu[N_MAX], none[N_MAX] = {0}, iterations = 50;
    double tolerance = 1e-8;
    const int last = w->N - 1;
    horizon = w->N;
    states = w->n;
    for (int j = 0; j <= last; j++) {
        nx[j] = w->n;
        nu[j] = j < last ? w->n : 0;
    }
    if (!take(0, d_ocp_qp_dim_memsize(last)))
        return false;
    d_ocp_qp_dim_create(last, &dim, memory[0]);
    d_ocp_qp_dim_set_all(nx, nu, nx, nu, none, none, &dim);
    if (!take(1, d_ocp_qp_memsize(&dim)) || !take(2, d_ocp_qp_sol_memsize(&dim)) ||
        !take(3, d_ocp_qp_ipm_arg_memsize(&dim)))
        return false;
    d_ocp_qp_create(&dim, &qp, memory[1]);
    d_ocp_qp_set_all_zero(&qp);
    d_ocp_qp_sol_create(&dim, &sol, memory[2]);
    d_ocp_qp_ipm_arg_create(&dim, &arg, memory[3]);
    d_ocp_qp_ipm_arg_set_default(SPEED, &arg);
    d_ocp_qp_ipm_arg_set_iter_max(&iterations, &arg);
    d_ocp_qp_ipm_arg_set_tol_stat(&tolerance, &arg);
    d_ocp_qp_ipm_arg_set_tol_eq(&tolerance, &arg);
    d_ocp_qp_ipm_arg_set_tol_ineq(&tolerance, &arg);
    d_ocp_qp_ipm_arg_set_tol_comp(&tolerance, &arg);
    if (!take(4, d_ocp_qp_ipm_ws_memsize(&dim, &arg)))
        return false;
    d_ocp_qp_ipm_ws_create(&dim, &arg, &ws, memory[4]);
    set_matrices(w);
    sample = last;
    linear_terms(w);
    return solve();
}

static bool step(const struct windows *w)
{
    sample++;
    linear_terms(w);
    return solve();
}

static const double *solution(void)
{
    return x;
}

static double effort(void)
{
    int iterations;
    d_ocp_qp_ipm_get_iter(&ws, &iterations);
    return iterations;
}

static void drop(void)
{
    for (int i = 0; i < 5; i++) {
        free(memory[i]);
        memory[i] = NULL;
    }
}

const struct contender bench_mhe_hpipm = {"HPIPM, 1e-8", make, step, solution, effort, drop};
