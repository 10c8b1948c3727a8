/* Time of one bounded window: a new sample comes in, the window of N slides, and its states are
 * estimated within bounds on them and on the disturbances. The estimator and the window QP against
 * HPIPM, OSQP and DAQP, where the casadi wheel has them, in one run on the same samples. Contenders
 * take turns, so that whatever else the machine does hits all alike. Prints a table; exits with 1
 * when a contender fails or disagrees with the window QP. */
#include "bench_mhe_bounded.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "dse/linalg.h"
#include "dse/random.h"

static const struct size {
    int n, m, N;
    double x_max, w_max;
} sizes[] = {{4, 2, 10, 2.5, 1.2}, {8, 4, 20, 2.5, 1.2}, {30, 10, 10, 2.5, 1.2}};

static const struct contender *const contenders[] = {
    &bench_mhe_window_qp, &bench_mhe_estimator,
#ifdef BENCH_HPIPM
    &bench_mhe_hpipm,
#endif
#ifdef BENCH_OSQP
    &bench_mhe_osqp,
#endif
#ifdef BENCH_DAQP
    &bench_mhe_daqp,
#endif
};
enum { CONTENDERS = sizeof contenders / sizeof contenders[0], TURNS = 200 };

static struct windows windows;
static double ns[CONTENDERS][TURNS], effort[CONTENDERS], apart[CONTENDERS];

/* The bounds hold for the truth, too: disturbances and states are clipped to them. */
static void make_windows(const struct size *size)
{
    struct dse_random random;
    double x[NX_MAX] = {0}, next[NX_MAX];
    const int n = size->n, m = size->m;
    windows =
        (struct windows){.n = n, .m = m, .N = size->N, .x_max = size->x_max, .w_max = size->w_max};
    dse_random_init(&random, 1, (uint64_t)n);
    for (int i = 0; i < n * n; i++)
        windows.A[i] = 0.9 / sqrt(n) * dse_random_normal(&random);
    for (int i = 0; i < m * n; i++)
        windows.C[i] = dse_random_normal(&random);
    for (int k = 0; k < SAMPLES; k++) {
        dse_mat_vec(m, n, windows.C, x, windows.y[k]);
        for (int j = 0; j < m; j++)
            windows.y[k][j] += dse_random_normal(&random);
        dse_mat_vec(n, n, windows.A, x, next);
        for (int i = 0; i < n; i++) {
            const double w = fmax(-size->w_max, fmin(size->w_max, dse_random_normal(&random)));
            x[i] = fmax(-size->x_max, fmin(size->x_max, next[i] + w));
        }
    }
}

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

static bool run(void)
{
    const int all = windows.n * windows.N;
    for (int k = 0; k < CONTENDERS; k++) {
        effort[k] = apart[k] = 0;
        if (!contenders[k]->make(&windows))
            return false;
    }
    for (int turn = 0; turn < TURNS; turn++) {
        for (int k = 0; k < CONTENDERS; k++) {
            const double begin = now_ns();
            if (!contenders[k]->step(&windows)) {
                printf("%s failed in turn %d\n", contenders[k]->name, turn);
                return false;
            }
            ns[k][turn] = now_ns() - begin;
            effort[k] += contenders[k]->effort() / TURNS;
            for (int i = 0; i < all; i++)
                apart[k] = fmax(apart[k],
                                fabs(contenders[k]->solution()[i] - contenders[0]->solution()[i]));
        }
    }
    for (int k = 0; k < CONTENDERS; k++) {
        contenders[k]->drop();
        qsort(ns[k], TURNS, sizeof ns[k][0], compare);
        if (!(apart[k] < 1e-3))
            printf("%s disagrees by %.1e\n", contenders[k]->name, apart[k]);
    }
    return true;
}

int main(void)
{
    bool agree = true;
    printf("Bounded window of the moving horizon estimator, slid by one sample and solved\n");
    for (size_t s = 0; s < sizeof sizes / sizeof sizes[0]; s++) {
        make_windows(&sizes[s]);
        if (!run())
            return 1;
        printf("n = %d, m = %d, N = %d           fastest us   median us   to the first  active or "
               "iterations  apart\n",
               sizes[s].n, sizes[s].m, sizes[s].N);
        for (int k = 0; k < CONTENDERS; k++) {
            printf("  %-28s %9.1f  %9.1f  %13.2f  %20.1f  %.0e\n", contenders[k]->name,
                   ns[k][0] / 1e3, ns[k][TURNS / 2] / 1e3, ns[k][TURNS / 2] / ns[0][TURNS / 2],
                   effort[k], apart[k]);
            agree = agree && apart[k] < 1e-3;
        }
    }
    return agree ? 0 : 1;
}
