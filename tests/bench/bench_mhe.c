/* Time of one sample of the linear moving horizon estimator: a new sample comes in, the window of N
 * slides and is solved for all its states. Beside it the floor: solving the same normal equations
 * Psi X = c with a Cholesky factor made beforehand, banded (half-bandwidth 2 n - 1) and dense, with
 * the library's own inner products. Contenders take turns, so that whatever else the machine does
 * hits all alike. Prints a table; exits with 1 when a contender fails or when they disagree. */
#include "dse/linear_mhe.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "dse/linalg.h"
#include "dse/math.h"
#include "dse/random.h"

#define NX_MAX  30
#define NY_MAX  10
#define N_MAX   20
#define UNKNOWN 300 /* n N, at most */
#define SAMPLES 512
#define TURNS   151
#define REPEAT  20 /* samples in a turn */

struct size {
    int n, m, N;
};
static const struct size sizes[] = {{4, 2, 10}, {8, 4, 20}, {30, 10, 10}};

/* ---- the system: noises Q = R = I, a spectral radius of about 0.9 ---- */

static dse_real A[NX_MAX * NX_MAX], C[NY_MAX * NX_MAX], Q[NX_MAX * NX_MAX], R[NY_MAX * NY_MAX];
static dse_real P0[NX_MAX * NX_MAX], samples[SAMPLES][NY_MAX];

static void make_system(const struct size *size)
{
    struct dse_random random;
    dse_real x[NX_MAX] = {0}, next[NX_MAX];
    const int n = size->n, m = size->m;
    const dse_real scale = DSE_REAL(0.9) / dse_sqrt((dse_real)n);
    dse_random_init(&random, 1, (uint64_t)n);
    for (int i = 0; i < n * n; i++)
        A[i] = scale * (dse_real)dse_random_normal(&random);
    for (int i = 0; i < m * n; i++)
        C[i] = (dse_real)dse_random_normal(&random);
    dse_mat_identity(n, Q);
    dse_mat_identity(n, P0);
    dse_mat_identity(m, R);
    for (int k = 0; k < SAMPLES; k++) {
        dse_mat_vec(m, n, C, x, samples[k]);
        for (int j = 0; j < m; j++)
            samples[k][j] += (dse_real)dse_random_normal(&random);
        dse_mat_vec(n, n, A, x, next);
        for (int i = 0; i < n; i++)
            x[i] = next[i] + (dse_real)dse_random_normal(&random);
    }
}

/* ---- the estimator ---- */

static dse_real memory[3][DSE_LINEAR_MHE_STORAGE(NX_MAX, NY_MAX, N_MAX)];
static struct dse_linear_mhe_config config[3];
static struct dse_linear_mhe mhe[3];
enum { FREE, PRIOR, KALMAN };

static bool feed(struct dse_linear_mhe *estimator, long k)
{
    const struct dse_measurement sample = {samples[k % SAMPLES], NULL};
    return (k == 0 || dse_linear_mhe_advance(estimator, NULL) == DSE_OK) &&
           dse_linear_mhe_measure(estimator, 0, NULL, &sample) == DSE_OK;
}

static bool make_estimators(const struct size *size)
{
    static const enum dse_arrival arrivals[] = {DSE_ARRIVAL_NONE, DSE_ARRIVAL_CONSTANT,
                                                DSE_ARRIVAL_KALMAN};
    bool ok = true;
    for (int e = 0; e < 3; e++) {
        struct dse_arena arena;
        config[e] = (struct dse_linear_mhe_config){.nx = size->n,
                                                   .ny = size->m,
                                                   .linear = {A, NULL, C, NULL},
                                                   .horizon = size->N,
                                                   .arrival = arrivals[e],
                                                   .P0 = P0,
                                                   .Q = Q,
                                                   .R = R};
        dse_arena_init(&arena, memory[e], (int)(sizeof memory[e] / sizeof memory[e][0]));
        ok = ok && dse_linear_mhe_init(&mhe[e], &config[e], &arena) == DSE_OK;
        for (long k = 0; k < size->N && ok; k++)
            ok = feed(&mhe[e], k) && dse_linear_mhe_solve(&mhe[e]) == DSE_OK;
    }
    return ok;
}

static bool run_estimator(const struct size *size, int e)
{
    (void)size;
    for (int r = 0; r < REPEAT; r++)
        if (!feed(&mhe[e], mhe[e].newest + 1) || dse_linear_mhe_solve(&mhe[e]) != DSE_OK)
            return false;
    return true;
}

static volatile dse_real sink;

static bool run_certificate(const struct size *size, int e)
{
    (void)size;
    for (int r = 0; r < REPEAT; r++)
        sink = dse_linear_mhe_certify(&mhe[e], dse_linear_mhe_window(&mhe[e]));
    return true;
}

/* ---- the floor: Psi X = c with Psi = L L' made beforehand ---- */

static dse_real dense[UNKNOWN * UNKNOWN];     /* L */
static dse_real band[UNKNOWN * (2 * NX_MAX)]; /* its columns from the diagonal down */
static dse_real inverse_pivot[UNKNOWN], c[UNKNOWN], solution[UNKNOWN];
static long floor_sample;

/* Psi = blockdiag(C'C) + G'G with G the rows x_{j+1} - A x_j. */
static bool make_floor(const struct size *size)
{
    const int n = size->n, N = size->N, all = n * N, width = 2 * n;
    memset(dense, 0, sizeof dense);
    for (int j = 0; j < N; j++) {
        for (int a = 0; a < n; a++) {
            dse_real *row = dense + (j * n + a) * all + j * n;
            for (int b = 0; b < n; b++) {
                for (int i = 0; i < size->m; i++)
                    row[b] += C[i * n + a] * C[i * n + b];
                for (int i = 0; i < n && j + 1 < N; i++)
                    row[b] += A[i * n + a] * A[i * n + b];
                row[b] += j > 0 && a == b;
                if (j > 0)
                    row[b - n] = -A[a * n + b];
            }
        }
    }
    if (dse_cholesky(all, dense, dense) != DSE_OK)
        return false;
    for (int i = 0; i < all; i++) {
        inverse_pivot[i] = 1 / dense[i * all + i];
        for (int k = 0; k < width && i + k < all; k++)
            band[i * width + k] = dense[(i + k) * all + i];
    }
    floor_sample = 0;
    return true;
}

/* The linear term slides, and C'y of the new sample joins. */
static void feed_floor(const struct size *size)
{
    const int n = size->n, all = n * size->N;
    memmove(c, c + n, (size_t)(all - n) * sizeof c[0]);
    dse_mat_tvec(size->m, n, C, samples[floor_sample++ % SAMPLES], c + all - n);
    memcpy(solution, c, (size_t)all * sizeof c[0]);
}

static void solve_band(int all, int width, dse_real *x)
{
    for (int i = 0; i < all; i++) {
        const int below = i + width <= all ? width - 1 : all - 1 - i;
        x[i] *= inverse_pivot[i];
        dse_axpy(below, -x[i], band + i * width + 1, x + i + 1);
    }
    for (int i = all - 1; i >= 0; i--) {
        const int below = i + width <= all ? width - 1 : all - 1 - i;
        x[i] = (x[i] - dse_dot(below, band + i * width + 1, x + i + 1)) * inverse_pivot[i];
    }
}

static bool run_band(const struct size *size, int unused)
{
    (void)unused;
    for (int r = 0; r < REPEAT; r++) {
        feed_floor(size);
        solve_band(size->n * size->N, 2 * size->n, solution);
    }
    return true;
}

static bool run_dense(const struct size *size, int unused)
{
    (void)unused;
    for (int r = 0; r < REPEAT; r++) {
        feed_floor(size);
        dse_cholesky_solve(size->n * size->N, dense, 1, solution);
    }
    return true;
}

/* Both floors and the estimator without arrival cost, on the same samples. */
static bool agree(const struct size *size)
{
    const int all = size->n * size->N;
    for (int which = 0; which < 2; which++) {
        floor_sample = mhe[FREE].newest + 1 - size->N;
        for (int k = 0; k < size->N; k++)
            feed_floor(size);
        if (which == 0)
            solve_band(all, 2 * size->n, solution);
        else
            dse_cholesky_solve(all, dense, 1, solution);
        const dse_real bound = DSE_REAL(1e-9) * dse_norm_max(all, solution);
        dse_axpy(all, -1, dse_linear_mhe_window(&mhe[FREE]), solution);
        if (!(dse_norm_max(all, solution) <= bound))
            return false;
    }
    return true;
}

/* ---- measuring ---- */

static const struct contender {
    const char *name;
    bool (*run)(const struct size *size, int which);
    int which;
} contenders[] = {
    {"floor: banded, factored", run_band, 0},
    {"floor: dense, factored", run_dense, 0},
    {"mhe, no arrival cost", run_estimator, FREE},
    {"mhe, constant arrival cost", run_estimator, PRIOR},
    {"mhe, Kalman arrival cost", run_estimator, KALMAN},
    {"  the certificate of them", run_certificate, FREE},
};
enum { CONTENDERS = sizeof contenders / sizeof contenders[0], SOLVER = 2, CERTIFICATE = 5 };

static double now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

static int compare(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double ns[CONTENDERS][TURNS]; /* per sample */

static bool measure(const struct size *size)
{
    for (int turn = -2; turn < TURNS; turn++) {
        for (int k = 0; k < CONTENDERS; k++) {
            const double begin = now_ns();
            if (!contenders[k].run(size, contenders[k].which)) {
                printf("%s: failed\n", contenders[k].name);
                return false;
            }
            if (turn >= 0)
                ns[k][turn] = (now_ns() - begin) / REPEAT;
        }
    }
    for (int k = 0; k < CONTENDERS; k++)
        qsort(ns[k], TURNS, sizeof ns[k][0], compare);
    return true;
}

static bool bench(const struct size *size)
{
    make_system(size);
    if (!make_estimators(size) || !make_floor(size) || !measure(size))
        return false;
    if (!agree(size)) {
        printf("(%d, %d, %d): the estimator and the floors disagree\n", size->n, size->m, size->N);
        return false;
    }
    printf("n = %d, m = %d, N = %d                fastest ns   median ns   to banded\n", size->n,
           size->m, size->N);
    for (int k = 0; k < CONTENDERS; k++)
        printf("  %-32s %10.0f  %10.0f  %10.2f\n", contenders[k].name, ns[k][0], ns[k][TURNS / 2],
               ns[k][0] / ns[0][0]);
    printf("  %-32s %10.0f  %10.0f  %10.2f\n", "  no arrival cost without it",
           ns[SOLVER][0] - ns[CERTIFICATE][0], ns[SOLVER][TURNS / 2] - ns[CERTIFICATE][TURNS / 2],
           (ns[SOLVER][0] - ns[CERTIFICATE][0]) / ns[0][0]);
    return true;
}

int main(void)
{
    printf("Window of the linear moving horizon estimator, slid by one sample and solved (%s)\n",
           sizeof(dse_real) == sizeof(double) ? "double" : "float");
    for (size_t s = 0; s < sizeof sizes / sizeof sizes[0]; s++)
        if (!bench(&sizes[s]))
            return 1;
    return 0;
}
