/* Time of one extended-Kalman-filter step (predict and update) against other implementations
 * in the same run. Contenders take turns in short rounds, so that whatever else the machine does
 * hits all alike; the fastest round of each is what its code can do, the median what it does.
 * Prints a table; exits with 1 only when contenders disagree about the estimate. */
#define _POSIX_C_SOURCE 200809L /* NOLINT(bugprone-reserved-identifier): how POSIX is asked for */

#include "bench_ekf.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define SAMPLES        64  /* different measurements, used in a circle */
#define ROUNDS         301 /* per contender and size */
#define ROUND_NS       40000.0
#define MAX_CONTENDERS 6

#ifdef DSE_REAL_IS_float
#define PRECISION "float"
#define AGREEMENT 1e-3
#else
#define PRECISION "double"
#define AGREEMENT 1e-10
#endif

static dse_real jacobian_f[BENCH_NX_MAX * BENCH_NX_MAX];
static dse_real jacobian_h[BENCH_NY_MAX * BENCH_NX_MAX];
static dse_real samples[SAMPLES][BENCH_NY_MAX];

/* ---- a model that costs next to nothing ---- */

static enum dse_status f(const struct dse_model *model, dse_real t, const dse_real *x,
                         const dse_real *u, dse_real *next)
{
    (void)t;
    (void)u;
    for (int i = 0; i < model->nx; i++)
        next[i] = (dse_real)0.5 * x[i];
    return DSE_OK;
}

static enum dse_status h(const struct dse_model *model, dse_real t, const dse_real *x,
                         const dse_real *u, dse_real *y)
{
    (void)t;
    (void)u;
    for (int j = 0; j < model->ny; j++)
        y[j] = (dse_real)0.01 * x[j];
    return DSE_OK;
}

static enum dse_status dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                            const dse_real *u, dse_real *F)
{
    (void)t;
    (void)u;
    (void)x;
    memcpy(F, jacobian_f, sizeof *F * (size_t)(model->nx * model->nx));
    return DSE_OK;
}

static enum dse_status dhdx(const struct dse_model *model, dse_real t, const dse_real *x,
                            const dse_real *u, dse_real *H)
{
    (void)t;
    (void)u;
    (void)x;
    memcpy(H, jacobian_h, sizeof *H * (size_t)(model->ny * model->nx));
    return DSE_OK;
}

static dse_real uniform(void)
{
    static unsigned long long state = 1;
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (dse_real)((double)(state >> 11) / 4503599627370496.0 - 1.0);
}

/* Dense F and H (not the derivatives of f and h, which must not cost anything), correlated Q,
 * diagonal R. */
static void make_problem(struct problem *problem, int nx, int ny)
{
    problem->model = (struct dse_model){
        .time = DSE_DISCRETE, .nx = nx, .ny = ny, .f = f, .h = h, .dfdx = dfdx, .dhdx = dhdx};
    for (int i = 0; i < nx * nx; i++)
        jacobian_f[i] = uniform() / (dse_real)sqrt((double)nx);
    for (int i = 0; i < ny * nx; i++)
        jacobian_h[i] = uniform();
    for (int i = 0; i < nx; i++) {
        for (int j = 0; j < nx; j++) {
            problem->P0[i * nx + j] = i == j;
            problem->Q[i * nx + j] = (dse_real)(i == j ? 0.1 : 0.1 / (1 + nx + abs(i - j)));
        }
    }
    for (int i = 0; i < ny; i++)
        for (int j = 0; j < ny; j++)
            problem->R[i * ny + j] = (dse_real)(i == j ? 0.5 : 0);
    for (int k = 0; k < SAMPLES; k++)
        for (int j = 0; j < ny; j++)
            samples[k][j] = uniform();
}

/* ---- measuring ---- */

struct entry {
    const struct contender *contender;
    double ns[ROUNDS]; /* per step, sorted in the end */
    dse_real x[BENCH_NX_MAX], P[BENCH_NX_MAX * BENCH_NX_MAX];
};

static double now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

static double time_round(const struct contender *contender, int steps)
{
    static dse_real t; /* never goes back, for no contender */
    const double begin = now_ns();
    for (int k = 0; k < steps; k++, t += 1)
        if (contender->step(t, samples[k % SAMPLES]) != 0) {
            printf("%s: step failed\n", contender->name);
            exit(1);
        }
    return (now_ns() - begin) / steps;
}

static int compare(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Largest deviation of an estimate from the first contender's, relative to the largest entry. */
static double deviation(const struct entry *a, const struct entry *b, int nx)
{
    double worst = 0, size = 0, worst_P = 0, size_P = 0;
    for (int i = 0; i < nx; i++) {
        worst = fmax(worst, fabs((double)(a->x[i] - b->x[i])));
        size = fmax(size, fabs((double)a->x[i]));
    }
    for (int i = 0; i < nx * nx; i++) {
        worst_P = fmax(worst_P, fabs((double)(a->P[i] - b->P[i])));
        size_P = fmax(size_P, fabs((double)a->P[i]));
    }
    return fmax(worst / size, worst_P / size_P);
}

static int pick(const struct contender *list, int count, int nx, int ny, struct entry *entry)
{
    for (int i = 0; i < count; i++) {
        if (list[i].nx == 0 || (list[i].nx == nx && list[i].ny == ny)) {
            entry->contender = &list[i];
            return 1;
        }
    }
    return 0;
}

/* A row of the table; 0 when all agree. */
static int bench_size(int nx, int ny)
{
    static struct problem problem;
    static struct entry entries[MAX_CONTENDERS];
    int count = 0, disagree = 0;
    make_problem(&problem, nx, ny);
    count += pick(bench_ekf_dse, 1, nx, ny, &entries[count]);
    count += pick(bench_ekf_loops, 5, nx, ny, &entries[count]);
    count += pick(bench_ekf_eigen, 5, nx, ny, &entries[count]);
#ifdef BENCH_BLASFEO
    count += pick(bench_ekf_blasfeo, 1, nx, ny, &entries[count]);
#endif
    const int first_joseph = count;
    count += pick(bench_ekf_loops_joseph, 5, nx, ny, &entries[count]);
    count += pick(bench_ekf_eigen_joseph, 5, nx, ny, &entries[count]);
    for (int c = 0; c < count; c++) {
        entries[c].contender->start(&problem);
        (void)time_round(entries[c].contender, 10 * SAMPLES);
        entries[c].contender->read(entries[c].x, entries[c].P);
    }
    const double guess = time_round(entries[0].contender, SAMPLES);
    const int steps = SAMPLES * (1 + (int)(ROUND_NS / guess / SAMPLES));
    for (int r = 0; r < ROUNDS; r++)
        for (int c = 0; c < count; c++)
            entries[c].ns[r] = time_round(entries[c].contender, steps);

    double best[2] = {INFINITY, INFINITY}; /* symmetric form, Joseph's form */
    printf("%2d %2d", nx, ny);
    for (int c = 0; c < count; c++) {
        double *form = &best[c >= first_joseph];
        qsort(entries[c].ns, ROUNDS, sizeof entries[c].ns[0], compare);
        printf(" %8.0f/%-8.0f", entries[c].ns[0], entries[c].ns[ROUNDS / 2]);
        if (c > 0)
            *form = fmin(*form, entries[c].ns[0]);
    }
    printf("  %6.2f %6.2f\n", entries[0].ns[0] / best[0], entries[0].ns[0] / best[1]);
    for (int c = 1; c < count; c++) {
        const double d = deviation(&entries[0], &entries[c], nx);
        if (!(d <= AGREEMENT)) {
            printf("       %s deviates from %s by %g\n", entries[c].contender->name,
                   entries[0].contender->name, d);
            disagree = 1;
        }
    }
    return disagree;
}

int main(void)
{
    static const int sizes[][2] = {{2, 1}, {4, 2}, {8, 4}, {15, 6}, {30, 10}};
    int disagree = 0;
    printf("EKF step, " PRECISION ": ns of the fastest round / of the median of %d rounds.\n"
           "J: Joseph's form, else P - W'W. Ratio of dse to the best of each form (fastest).\n"
           "nx ny   dse               loops             eigen           "
#ifdef BENCH_BLASFEO
           "  blasfeo         "
#endif
           "  loops J           eigen J            ratio  to J\n",
           ROUNDS);
    for (size_t s = 0; s < sizeof sizes / sizeof sizes[0]; s++)
        disagree |= bench_size(sizes[s][0], sizes[s][1]);
    return disagree;
}
