/* golden_coordinated_mhe FILE.json ...
 *
 * Compares the linear moving horizon estimator with reference data of the coordinated schemes:
 * the centralised and the decentralised estimates of a run, and the covariance of the newest
 * estimate with the corner of the inverse of the reference's Hessian. Exit code 0: all within their
 * tolerance; 1: some are not, or a file cannot be read; 2: the layout is not supported. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "dse/linalg.h"
#include "dse/linear_mhe.h"
#include "golden.h"

/* Absolute, as the reference states it for centralised and decentralised estimates. */
#define ESTIMATE 1e-7
/* Covariances, relative to the largest entry: the reference's matrices have 1e-10, and inverting
 * them loses some digits. */
#define COVARIANCE 1e-8

enum { NX = 9, NY = 3, HORIZON = 10, PARTS = 3, WINDOW = 3 };

static dse_real memory[DSE_LINEAR_MHE_STORAGE(NX, NY, HORIZON)];

/* A linear plant or a subsystem of it. */
struct plant {
    int nx, ny;
    double A[NX * NX], C[NY * NX], Q[NX * NX], R[NY * NY], x0[NX];
};

static int report(const char *name, double deviation, double tolerance)
{
    const int pass = isfinite(deviation) && deviation <= tolerance;
    printf("  %-36s deviation %9.2e  tolerance %7.1e  %s\n", name, deviation, tolerance,
           pass ? "ok" : "FAILED");
    return pass ? GOLDEN_PASS : GOLDEN_FAIL;
}

static enum dse_status start(struct dse_linear_mhe *mhe, struct dse_linear_mhe_config *config,
                             const struct plant *plant, int horizon, int min_horizon)
{
    struct dse_arena arena;
    *config = (struct dse_linear_mhe_config){.nx = plant->nx,
                                             .ny = plant->ny,
                                             .linear = {plant->A, NULL, plant->C, NULL},
                                             .horizon = horizon,
                                             .arrival = DSE_ARRIVAL_NONE,
                                             .min_horizon = min_horizon,
                                             .x0 = plant->x0,
                                             .Q = plant->Q,
                                             .R = plant->R};
    dse_arena_init(&arena, memory, (int)(sizeof memory / sizeof memory[0]));
    return dse_linear_mhe_init(mhe, config, &arena);
}

/* ---- runs ---- */

/* Numbers of a run; freed together. */
struct run {
    int nx, ny, parts, samples, horizon, min_horizon;
    int n_i[PARTS];
    double *A, *Q, *R, *xhat0, *x, *v, *y, *centralized, *decentralized;
};

static void free_run(struct run *run)
{
    double *all[] = {run->A, run->Q, run->R,           run->xhat0,        run->x,
                     run->v, run->y, run->centralized, run->decentralized};
    for (size_t i = 0; i < sizeof all / sizeof all[0]; i++)
        free(all[i]);
}

static double *numbers(const json_t *root, const char *key, int expected, int *wrong)
{
    int count;
    double *list = golden_numbers(json_object_get(root, key), &count);
    if (expected < 0 ? count == 0 : count != expected) {
        printf("  '%s' has %d numbers, %d expected\n", key, count, expected);
        *wrong = 1;
    }
    return list;
}

static int read_run(const json_t *root, struct run *run)
{
    const json_t *config = json_object_get(root, "config"), *sizes = json_object_get(root, "n_i");
    int wrong = 0;
    *run = (struct run){.parts = (int)json_array_size(sizes)};
    run->horizon = (int)golden_number(config, "Hp", 0);
    run->min_horizon = (int)golden_number(config, "Hmin", 0);
    run->samples = (int)golden_number(config, "K", 0) + 1;
    run->ny = run->parts; /* one output per subsystem */
    if (run->parts < 1 || run->parts > PARTS || run->horizon < 1 || run->horizon > HORIZON)
        return GOLDEN_UNSUPPORTED;
    int blocks = 0;
    for (int i = 0; i < run->parts; i++) {
        run->n_i[i] = (int)json_integer_value(json_array_get(sizes, (size_t)i));
        run->nx += run->n_i[i];
        blocks += run->n_i[i] * run->n_i[i];
    }
    if (run->nx > NX)
        return GOLDEN_UNSUPPORTED;
    run->A = numbers(root, "A", run->nx * run->nx, &wrong);
    run->Q = numbers(root, "Q", blocks, &wrong);
    run->R = numbers(root, "R", run->parts, &wrong);
    run->xhat0 = numbers(config, "xhat0", run->nx, &wrong);
    run->x = numbers(root, "x", run->samples * run->nx, &wrong);
    run->v = numbers(root, "v", run->samples * run->ny, &wrong);
    run->y = numbers(root, "y", run->samples * run->ny, &wrong);
    run->centralized = numbers(root, "centralized", run->samples * run->nx, &wrong);
    run->decentralized = numbers(root, "decentralized", run->samples * run->nx, &wrong);
    return wrong ? GOLDEN_FAIL : GOLDEN_PASS;
}

/* The state that output j measures: y - v says it. -1: none. */
static int measured_state(const struct run *run, int j)
{
    for (int i = 0; i < run->nx; i++) {
        double worst = 0;
        for (int k = 0; k < run->samples; k++)
            worst = fmax(worst, fabs(run->y[k * run->ny + j] - run->v[k * run->ny + j] -
                                     run->x[k * run->nx + i]));
        if (worst < 1e-9)
            return i;
    }
    return -1;
}

/* Subsystems `from` .. `to` - 1 with what couples them; first: their first state. */
static int make_plant(const struct run *run, int from, int to, struct plant *plant, int *first)
{
    int begin = 0, end = 0, q = 0;
    for (int i = 0; i < to; i++) {
        begin += i < from ? run->n_i[i] : 0;
        end += run->n_i[i];
    }
    *plant = (struct plant){.nx = end - begin, .ny = to - from};
    *first = begin;
    const int nx = plant->nx, ny = plant->ny;
    for (int i = 0; i < nx; i++) {
        plant->x0[i] = run->xhat0[begin + i];
        for (int p = 0; p < nx; p++)
            plant->A[i * nx + p] = run->A[(begin + i) * run->nx + begin + p];
    }
    for (int s = 0, at = 0; s < to; at += run->n_i[s], s++) {
        const int n = run->n_i[s];
        for (int e = 0; e < n * n && s >= from; e++)
            plant->Q[(at - begin + e / n) * nx + at - begin + e % n] = run->Q[q + e];
        q += n * n;
    }
    for (int j = 0; j < ny; j++) {
        const int state = measured_state(run, from + j) - begin;
        if (state < 0 || state >= nx)
            return GOLDEN_FAIL;
        plant->C[j * nx + state] = 1;
        plant->R[j * ny + j] = run->R[from + j];
    }
    return GOLDEN_PASS;
}

/* Estimates subsystems from .. to - 1 and compares with the columns of theirs. */
static int compare_part(const struct run *run, int from, int to, const double *expected,
                        double *deviation, double *certificate)
{
    struct plant plant;
    struct dse_linear_mhe_config config;
    struct dse_linear_mhe mhe;
    int first;
    if (make_plant(run, from, to, &plant, &first) != GOLDEN_PASS ||
        start(&mhe, &config, &plant, run->horizon, run->min_horizon) != DSE_OK)
        return GOLDEN_FAIL;
    for (int k = 0; k < run->samples; k++) {
        const struct dse_measurement sample = {run->y + k * run->ny + from, NULL};
        if ((k > 0 && dse_linear_mhe_advance(&mhe, NULL) != DSE_OK) ||
            dse_linear_mhe_measure(&mhe, 0, NULL, &sample) != DSE_OK ||
            dse_linear_mhe_solve(&mhe) != DSE_OK)
            return GOLDEN_FAIL;
        for (int i = 0; i < plant.nx; i++)
            *deviation = fmax(*deviation, fabs(dse_linear_mhe_state(&mhe)[i] -
                                               expected[k * run->nx + first + i]));
        *certificate = fmax(*certificate, dse_linear_mhe_certificate(&mhe));
    }
    return GOLDEN_PASS;
}

static int check_run(const json_t *root)
{
    struct run run;
    int result = read_run(root, &run);
    double centralized = 0, decentralized = 0, certificate = 0;
    if (result == GOLDEN_PASS)
        result = compare_part(&run, 0, run.parts, run.centralized, &centralized, &certificate);
    for (int i = 0; i < run.parts && result == GOLDEN_PASS; i++)
        result = compare_part(&run, i, i + 1, run.decentralized, &decentralized, &certificate);
    if (result == GOLDEN_PASS) {
        result |= report("centralised estimates", centralized, ESTIMATE);
        result |= report("decentralised estimates", decentralized, ESTIMATE);
        result |= report("certificates", certificate, 1e-12);
    } else {
        printf("  the run could not be repeated\n");
    }
    free_run(&run);
    return result;
}

/* ---- matrices of a window of three samples ---- */

enum { STACK = 12, TRANSITIONS = 8, PLANT = 4, BLOCK = 2 };

/* Place of state i at time t in the reference's order: subsystem, then time, then state. */
static int stacked(int times, int t, int i)
{
    return i / BLOCK * times * BLOCK + t * BLOCK + i % BLOCK;
}

/* A, C, Q, R of states begin .. begin + nx - 1 from the stacked matrices, at their first time. */
static void unstack(const double *GA, const double *CRC, const double *Qinv, int begin, int nx,
                    struct plant *plant)
{
    *plant = (struct plant){.nx = nx, .ny = nx / BLOCK};
    for (int i = 0; i < nx; i++) {
        const int row = stacked(WINDOW - 1, 0, begin + i), at = stacked(WINDOW, 0, begin + i);
        for (int p = 0; p < nx; p++)
            plant->A[i * nx + p] = -GA[row * STACK + stacked(WINDOW, 0, begin + p)];
        plant->Q[i * nx + i] = 1 / Qinv[row * TRANSITIONS + row];
        if (CRC[at * STACK + at] > 0) {
            const int j = i / BLOCK;
            plant->C[j * nx + i] = 1;
            plant->R[j * plant->ny + j] = 1 / CRC[at * STACK + at];
        }
    }
}

/* The newest states' corner of the inverse of the Hessian. */
static int inverse_corner(const double *hessian, int begin, int nx, double *corner)
{
    double L[STACK * STACK], inverse[STACK * STACK];
    dse_mat_identity(STACK, inverse);
    if (dse_cholesky(STACK, hessian, L) != DSE_OK)
        return GOLDEN_FAIL;
    dse_cholesky_solve(STACK, L, STACK, inverse);
    for (int i = 0; i < nx; i++)
        for (int p = 0; p < nx; p++)
            corner[i * nx + p] = inverse[stacked(WINDOW, WINDOW - 1, begin + i) * STACK +
                                         stacked(WINDOW, WINDOW - 1, begin + p)];
    return GOLDEN_PASS;
}

static int compare_covariance(const char *name, const struct plant *plant, const double *expected)
{
    struct dse_linear_mhe_config config;
    struct dse_linear_mhe mhe;
    double P[PLANT * PLANT], largest = 0, deviation = 0;
    const double y[PARTS] = {0};
    const struct dse_measurement sample = {y, NULL};
    enum dse_status status = start(&mhe, &config, plant, WINDOW, WINDOW);
    for (int k = 0; k < WINDOW && status == DSE_OK; k++) {
        if (k > 0)
            status = dse_linear_mhe_advance(&mhe, NULL);
        if (status == DSE_OK)
            status = dse_linear_mhe_measure(&mhe, 0, NULL, &sample);
    }
    if (status != DSE_OK || dse_linear_mhe_solve(&mhe) != DSE_OK ||
        dse_linear_mhe_covariance(&mhe, P) != DSE_OK)
        return report(name, INFINITY, COVARIANCE);
    for (int i = 0; i < plant->nx * plant->nx; i++) {
        largest = fmax(largest, fabs(expected[i]));
        deviation = fmax(deviation, fabs(P[i] - expected[i]));
    }
    return report(name, deviation / largest, COVARIANCE);
}

static int check_matrices(const json_t *root)
{
    static const struct {
        const char *name, *hessian;
        int begin, nx;
    } cases[] = {{"covariance, centralised", "Psi", 0, PLANT},
                 {"covariance, subsystem 1 alone", "Om", 0, BLOCK},
                 {"covariance, subsystem 2 alone", "Om", BLOCK, BLOCK}};
    int wrong = 0, result = GOLDEN_PASS;
    double *GA = numbers(root, "GA", TRANSITIONS * STACK, &wrong);
    double *CRC = numbers(root, "CRC", STACK * STACK, &wrong);
    double *Qinv = numbers(root, "Qinv", TRANSITIONS * TRANSITIONS, &wrong);
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++) {
        struct plant plant;
        double corner[PLANT * PLANT];
        double *hessian = numbers(root, cases[c].hessian, STACK * STACK, &wrong);
        if (wrong || inverse_corner(hessian, cases[c].begin, cases[c].nx, corner) != GOLDEN_PASS) {
            result = GOLDEN_FAIL;
        } else {
            unstack(GA, CRC, Qinv, cases[c].begin, cases[c].nx, &plant);
            result |= compare_covariance(cases[c].name, &plant, corner);
        }
        free(hessian);
    }
    free(GA);
    free(CRC);
    free(Qinv);
    return result;
}

static int check_file(const json_t *root)
{
    int result = GOLDEN_UNSUPPORTED;
    if (json_object_get(root, "centralized") != NULL)
        result = check_run(root);
    else if (json_object_get(root, "CSTR2_H3") != NULL)
        result = check_matrices(json_object_get(root, "CSTR2_H3"));
    return result;
}

int main(int argc, char **argv)
{
    return golden_main(argc, argv, check_file);
}
