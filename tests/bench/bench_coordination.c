/* Time and messages of one sample of the coordinated moving horizon estimators against the
 * centralised one, for 2 to 64 subsystems in a chain and in a grid: of the same total size, and of
 * growing size; without and with bounds. Everything runs in one process; printed are the time of
 * all together and the time on the longest way, coordinator plus slowest agent, which a network of
 * machines would have beside its messages. Exits with 1 when the centralised or the price-driven
 * estimator fails, or when what a scheme has converged to is not the estimate. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "coordination_rig.h"
#include "dse/random.h"

enum {
    N = 10,
    SAMPLES = 60, /* of a run, of which the first ones fill the window */
    FIRST = 20,
    STATES = 192 /* at most */
};

struct plant {
    int parts, nx, ny, n;
    bool grid;
    dse_real *A, *C, *Q, *R; /* the whole plant */
    dse_real *A_ii, *C_i, *Q_i, *R_i, *D_i;
    dse_real *y;
    dse_real x_min[STATES], x_max[STATES], w_min[STATES], w_max[STATES];
    struct dse_mhe_subsystem subsystems[RIG_MAX_PARTS], whole;
};

/* Of this process: the machine may have other things to do. */
static double seconds(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static dse_real *zeros(int count)
{
    dse_real *memory = calloc((size_t)count, sizeof *memory);
    if (memory == NULL)
        abort();
    return memory;
}

/* ---- the plants ---- */

static int grid_width(int parts)
{
    int width = 1;
    while (width * width < parts)
        width *= 2;
    return width;
}

static bool are_coupled(const struct plant *plant, int i, int l)
{
    const int width = plant->grid ? grid_width(plant->parts) : plant->parts;
    const int rows = abs(i / width - l / width), columns = abs(i % width - l % width);
    return rows + columns == 1;
}

/* No row's sum of absolute values above 0.95: stable, whatever the random numbers were. */
static void make_stable(struct plant *plant)
{
    const int n = plant->n, nx = plant->nx;
    for (int r = 0; r < n; r++) {
        double sum = 0;
        for (int c = 0; c < n; c++)
            sum += fabs((double)plant->A[r * n + c]);
        for (int c = 0; c < n && sum > 0.95; c++)
            plant->A[r * n + c] *= (dse_real)(0.95 / sum);
        for (int c = 0; c < nx; c++)
            plant->A_ii[r * nx + c] = plant->A[r * n + r / nx * nx + c];
    }
}

static void make_matrices(struct plant *plant, struct dse_random *random)
{
    const int n = plant->n, nx = plant->nx, ny = plant->ny;
    for (int r = 0; r < n; r++) {
        for (int c = 0; c < n; c++) {
            const int i = r / nx, l = c / nx;
            const double scale = i == l ? 0.3 : are_coupled(plant, i, l) ? 0.03 : 0;
            double value = scale * dse_random_normal(random) / sqrt((double)nx);
            value += r == c ? 0.4 : 0;
            plant->A[r * n + c] = (dse_real)value;
        }
    }
    make_stable(plant);
    for (int i = 0; i < plant->parts; i++) {
        for (int e = 0; e < ny * nx; e++) {
            plant->C_i[i * ny * nx + e] = (dse_real)dse_random_normal(random);
            plant->C[(i * ny + e / nx) * n + i * nx + e % nx] = plant->C_i[i * ny * nx + e];
        }
        for (int a = 0; a < nx; a++) {
            plant->Q_i[i * nx * nx + a * (nx + 1)] = 1;
            plant->D_i[i * nx * nx + a * (nx + 1)] = 10;
            plant->Q[(i * nx + a) * (n + 1)] = 1;
        }
        for (int j = 0; j < ny; j++) {
            plant->R_i[i * ny * ny + j * (ny + 1)] = 1;
            plant->R[(i * ny + j) * (plant->parts * ny + 1)] = 1;
        }
    }
}

static void make_data(struct plant *plant, struct dse_random *random)
{
    dse_real x[STATES] = {0}, next[STATES];
    const int n = plant->n, outputs = plant->parts * plant->ny;
    for (int k = 0; k < SAMPLES; k++) {
        for (int j = 0; j < outputs; j++) {
            double y = dse_random_normal(random);
            for (int c = 0; c < n; c++)
                y += (double)(plant->C[j * n + c] * x[c]);
            plant->y[k * outputs + j] = (dse_real)y;
        }
        for (int r = 0; r < n; r++) {
            double sum = dse_random_normal(random);
            for (int c = 0; c < n; c++)
                sum += (double)(plant->A[r * n + c] * x[c]);
            next[r] = (dse_real)sum;
        }
        memcpy(x, next, sizeof x);
    }
}

static void make_subsystems(struct plant *plant, bool bounded)
{
    const int nx = plant->nx, ny = plant->ny;
    for (int r = 0; r < plant->n; r++) {
        plant->x_min[r] = DSE_REAL(-3); /* about one in a hundred reaches these */
        plant->x_max[r] = DSE_REAL(3);
        plant->w_min[r] = DSE_REAL(-2);
        plant->w_max[r] = DSE_REAL(2);
    }
    plant->whole = (struct dse_mhe_subsystem){.nx = plant->n,
                                              .ny = plant->parts * ny,
                                              .A = plant->A,
                                              .C = plant->C,
                                              .Q = plant->Q,
                                              .R = plant->R,
                                              .x_min = bounded ? plant->x_min : NULL,
                                              .x_max = bounded ? plant->x_max : NULL,
                                              .w_min = bounded ? plant->w_min : NULL,
                                              .w_max = bounded ? plant->w_max : NULL};
    for (int i = 0; i < plant->parts; i++) {
        struct dse_mhe_subsystem *s = &plant->subsystems[i];
        *s = plant->whole;
        s->nx = nx;
        s->ny = ny;
        s->A = plant->A_ii + i * nx * nx;
        s->C = plant->C_i + i * ny * nx;
        s->Q = plant->Q_i + i * nx * nx;
        s->D = plant->D_i + i * nx * nx;
        s->R = plant->R_i + i * ny * ny;
    }
}

static void make_plant(struct plant *plant, int parts, int nx, bool grid, bool bounded)
{
    struct dse_random random;
    dse_random_init(&random, 1, (uint64_t)(1000 * parts + nx));
    memset(plant, 0, sizeof *plant);
    plant->parts = parts;
    plant->nx = nx;
    plant->ny = (2 * nx + 2) / 3;
    plant->n = parts * nx;
    plant->grid = grid;
    const int n = plant->n, ny = plant->ny, outputs = parts * ny;
    plant->A = zeros(n * n);
    plant->Q = zeros(n * n);
    plant->C = zeros(outputs * n);
    plant->R = zeros(outputs * outputs);
    plant->A_ii = zeros(n * nx);
    plant->Q_i = zeros(n * nx);
    plant->D_i = zeros(n * nx);
    plant->C_i = zeros(outputs * nx);
    plant->R_i = zeros(outputs * ny);
    plant->y = zeros(SAMPLES * outputs);
    make_matrices(plant, &random);
    make_data(plant, &random);
    make_subsystems(plant, bounded);
}

static void free_plant(struct plant *plant)
{
    dse_real *all[] = {plant->A,   plant->C,   plant->Q,   plant->R,   plant->A_ii,
                       plant->C_i, plant->Q_i, plant->R_i, plant->D_i, plant->y};
    for (size_t i = 0; i < sizeof all / sizeof all[0]; i++)
        free(all[i]);
}

/* ---- measurements ---- */

static int ascending(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double *list, int count)
{
    qsort(list, (size_t)count, sizeof *list, ascending);
    return list[count / 2];
}

/* Microseconds of a sample, and the estimates (SAMPLES x n); negative: failed. */
static double time_centralised(const struct plant *plant, dse_real *estimates)
{
    struct coordination_alone alone = {.memory = NULL};
    double times[SAMPLES];
    /* a quarter of all constraints at once is more than these have */
    alone.max_active = plant->n * N / 2;
    if (coordination_alone_start(&alone, N, 2 < plant->nx ? 4 : 2, 0, &plant->whole) != DSE_OK)
        return -1;
    for (int k = 0; k < SAMPLES; k++) {
        const double from = seconds();
        coordination_alone_sample(&alone, k, plant->y + k * plant->whole.ny, NULL);
        times[k] = 1e6 * (seconds() - from);
        if (k >= FIRST && dse_mhe_local_status(&alone.local) != DSE_MHE_CONVERGED)
            return -1;
        memcpy(estimates + k * plant->n, dse_mhe_local_state(&alone.local),
               (size_t)plant->n * sizeof *estimates);
    }
    free(alone.memory);
    return median(times + FIRST, SAMPLES - FIRST);
}

struct result {
    double all, way; /* microseconds */
    double rounds, messages, reals;
    double deviation; /* of the estimates from the centralised ones */
    enum dse_mhe_outcome outcome;
};

static double slowest_agent(const struct coordination *net)
{
    double slowest = 0;
    for (int i = 0; i < net->config.parts; i++)
        slowest = fmax(slowest, net->agent_time[i]);
    return slowest;
}

static bool time_scheme(const struct plant *plant, enum dse_mhe_scheme scheme, bool bounded,
                        const dse_real *estimates, struct result *result)
{
    static struct coordination net;
    static dse_real x[STATES];
    double all[SAMPLES], way[SAMPLES];
    bool ok = true;
    memset(&net, 0, sizeof net);
    *result = (struct result){0};
    net.settings = (struct dse_mhe_settings){
        .scheme = scheme, .horizon = N, .min_horizon = 2 < plant->nx ? 4 : 2};
    net.config = (struct dse_mhe_coordinator_config){.parts = plant->parts,
                                                     .subsystems = plant->subsystems,
                                                     .A = plant->A,
                                                     .eps = DSE_REAL(1e-3),
                                                     .max_iter = 200};
    net.config.anderson = bounded ? 8 : 0;
    net.clock = seconds;
    ok = coordination_start(&net) == DSE_OK;
    for (int k = 0; k < SAMPLES && ok; k++) {
        const double coordinator = net.coordinator_time;
        if (k == FIRST)
            net.messages = net.reals = 0;
        memset(net.agent_time, 0, sizeof net.agent_time);
        const double from = seconds();
        const enum dse_mhe_outcome outcome =
            coordination_sample(&net, k, plant->y + k * plant->whole.ny, NULL);
        all[k] = 1e6 * (seconds() - from);
        way[k] = 1e6 * (net.coordinator_time - coordinator + slowest_agent(&net));
        coordination_state(&net, x);
        ok = k < FIRST || outcome == DSE_MHE_OUTCOME_CONVERGED;
        result->outcome = outcome;
        for (int i = 0; i < plant->n && k >= FIRST; i++)
            result->deviation =
                fmax(result->deviation, fabs((double)(x[i] - estimates[k * plant->n + i])));
        result->rounds += k >= FIRST ? dse_mhe_coordinator_iterations(&net.coordinator) : 0;
    }
    const double count = SAMPLES - FIRST;
    result->all = median(all + FIRST, SAMPLES - FIRST);
    result->way = median(way + FIRST, SAMPLES - FIRST);
    result->rounds /= count;
    result->messages = (double)net.messages / count;
    result->reals = (double)net.reals / count;
    coordination_free(&net);
    return ok;
}

static void print(const char *name, const struct result *r, double centralised)
{
    printf("      %-12s %10.1f %7.2f %10.1f %7.2f %7.1f %9.0f %9.0f   %8.1e\n", name, r->all,
           r->all / centralised, r->way, r->way / centralised, r->rounds, r->messages, r->reals,
           r->deviation);
}

/* 0, or 1 when something is wrong. */
static int run_case(int parts, int nx, bool grid, bool bounded)
{
    static struct plant plant;
    struct result result;
    int wrong = 0;
    make_plant(&plant, parts, nx, grid, bounded);
    dse_real *estimates = zeros(SAMPLES * plant.n);
    const double centralised = time_centralised(&plant, estimates);
    printf("    %2d subsystems of %2d states: centralised %.1f us\n", parts, nx, centralised);
    wrong |= centralised < 0;
    if (!wrong && time_scheme(&plant, DSE_MHE_PREDICTION, bounded, estimates, &result)) {
        print("prediction", &result, centralised);
        wrong |=
            !(result.deviation < 0.02); /* eps of the whole stack and the rate of convergence */
    } else {
        /* a property of the plant: its certificate may be above 1 */
        printf("      prediction   %s\n", result.outcome == DSE_MHE_OUTCOME_DIVERGED
                                              ? "diverges"
                                              : "has not converged after 200 rounds");
    }
    if (time_scheme(&plant, DSE_MHE_PRICE, bounded, estimates, &result)) {
        print("price", &result, centralised); /* with the bias of D */
        wrong |= !(result.deviation < 0.5);
    } else {
        printf("      price        FAILED\n");
        wrong = 1;
    }
    fflush(stdout);
    free(estimates);
    free_plant(&plant);
    return wrong;
}

int main(int argc, char **argv)
{
    /* arguments, for a quick look: the number of subsystems at most; anything: only with bounds */
    const int most = argc > 1 ? atoi(argv[1]) : RIG_MAX_PARTS;
    int wrong = 0;
    printf("Coordinated moving horizon estimation, one sample, N = %d (%s)\n", N,
           sizeof(dse_real) == sizeof(double) ? "double" : "float");
    for (int bounded = argc > 2; bounded < 2; bounded++) {
        for (int grid = 0; grid < 2; grid++) {
            for (int growing = 0; growing < 2; growing++) {
                printf("  %s, %s, %s\n", grid ? "grid" : "chain",
                       growing ? "3 states each" : "64 states together",
                       bounded ? "with bounds" : "without bounds");
                printf("      %-12s %10s %7s %10s %7s %7s %9s %9s   %8s\n", "", "all us", "ratio",
                       "way us", "ratio", "rounds", "messages", "reals", "deviation");
                for (int parts = 2; parts <= most; parts *= 2)
                    wrong |= run_case(parts, growing ? 3 : 64 / parts, grid, bounded);
            }
        }
    }
    return wrong;
}
