/* golden_window_qp FILE.json ...
 *
 * Bounded windows of the centralised estimator (three vessels, 9 states, 3 temperatures measured)
 * against an independent solution: by the window QP and by the bounded linear estimator. Exit code
 * 0: all within the reference's tolerance and with its number of active constraints; 1 otherwise.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dse/linalg.h"
#include "dse/linear_mhe.h"
#include "dse/window_qp.h"
#include "golden.h"

/* Absolute, as the reference states it for constrained optima. */
#define TOLERANCE 1e-6

enum { NX = 9, NY = 3, PART = 3, H_MAX = 10, ALL = NX * H_MAX };

struct plant {
    double A[NX * NX], C[NY * NX], Q[NX * NX], R[NY * NY];
    double x_min[NX], x_max[NX], w_min[NX], w_max[NX];
};

static double estimator_memory[DSE_LINEAR_MHE_BOUNDED_STORAGE(NX, NY, H_MAX, ALL)];
static double qp_memory[DSE_WINDOW_QP_STORAGE(NX, NX, H_MAX, ALL)];

static int read(const json_t *object, const char *key, int expected, double *out)
{
    int count;
    double *list = golden_numbers(json_object_get(object, key), &count);
    if (list && count == expected)
        memcpy(out, list, sizeof *out * (size_t)expected);
    free(list);
    return count == expected;
}

static int read_plant(const json_t *root, struct plant *p)
{
    double Q[NX * PART] = {0}, R[NY] = {0};
    *p = (struct plant){.A = {0}};
    const int ok = read(root, "A", NX * NX, p->A) && read(root, "Q", NX * PART, Q) &&
                   read(root, "R", NY, R) && read(root, "xlb", NX, p->x_min) &&
                   read(root, "xub", NX, p->x_max) && read(root, "wlb", NX, p->w_min) &&
                   read(root, "wub", NX, p->w_max);
    for (int i = 0; ok && i < NX; i++) /* blocks of three */
        for (int j = 0; j < PART; j++)
            p->Q[i * NX + i / PART * PART + j] = Q[i * PART + j];
    for (int i = 0; ok && i < NY; i++) {
        p->C[i * NX + i * PART + 2] = 1; /* the temperature */
        p->R[i * NY + i] = R[i];
    }
    return ok;
}

/* ---- by the estimator ---- */

static int estimate(const struct plant *p, int H, const double *y, double *x, int *active)
{
    const struct dse_linear_mhe_config config = {.nx = NX,
                                                 .ny = NY,
                                                 .linear = {p->A, NULL, p->C, NULL},
                                                 .horizon = H,
                                                 .arrival = DSE_ARRIVAL_NONE,
                                                 .min_horizon = H,
                                                 .Q = p->Q,
                                                 .R = p->R,
                                                 .x_min = p->x_min,
                                                 .x_max = p->x_max,
                                                 .w_min = p->w_min,
                                                 .w_max = p->w_max};
    struct dse_linear_mhe mhe;
    struct dse_arena arena;
    dse_arena_init(&arena, estimator_memory, (int)(sizeof estimator_memory / sizeof(double)));
    int ok = dse_linear_mhe_init(&mhe, &config, &arena) == DSE_OK;
    for (int k = 0; k < H && ok; k++) {
        const struct dse_measurement sample = {y + k * NY, NULL};
        ok = (k == 0 || dse_linear_mhe_advance(&mhe, NULL) == DSE_OK) &&
             dse_linear_mhe_measure(&mhe, 0, NULL, &sample) == DSE_OK;
    }
    ok = ok && dse_linear_mhe_solve(&mhe) == DSE_OK && dse_linear_mhe_path(&mhe) <= DSE_PATH_DUAL;
    memcpy(x, dse_linear_mhe_window(&mhe), sizeof *x * (size_t)(NX * H));
    *active = mhe.set.count;
    return ok;
}

/* ---- by the window QP: Psi = M_C + G_A' Q^-1 G_A, c = C' R^-1 y ---- */

static struct {
    double weight[NX * NX], minus_A[NX * NX], below[NX * NX], blocks[H_MAX][NX * NX];
    double c[ALL], lower[ALL], upper[ALL], row_lower[ALL], row_upper[ALL];
    const double *diagonal[H_MAX], *beside[H_MAX];
} window;

static int fill_window(const struct plant *p, int H, const double *y)
{
    double past[NX * NX], data[NX * NX] = {0};
    memset(&window, 0, sizeof window);
    memcpy(past, p->Q, sizeof past);
    dse_mat_identity(NX, window.weight);
    if (dse_cholesky(NX, past, past) != DSE_OK)
        return 0;
    dse_cholesky_solve(NX, past, NX, window.weight); /* Q^-1 */
    for (int i = 0; i < NX * NX; i++)
        window.minus_A[i] = -p->A[i];
    dse_mat_mul(NX, NX, NX, window.weight, window.minus_A, window.below);
    dse_mat_mul_tn(NX, NX, NX, window.minus_A, window.below, past);
    for (int i = 0; i < NY; i++)
        data[(i * PART + 2) * (NX + 1)] = 1 / p->R[i * NY + i];
    for (int j = 0; j < H; j++) {
        for (int i = 0; i < NX * NX; i++)
            window.blocks[j][i] = data[i] + (j + 1 < H) * past[i] + (j > 0) * window.weight[i];
        for (int i = 0; i < NY; i++)
            window.c[j * NX + i * PART + 2] = y[j * NY + i] / p->R[i * NY + i];
        window.diagonal[j] = window.blocks[j];
        window.beside[j] = window.below;
        memcpy(window.lower + j * NX, p->x_min, sizeof p->x_min);
        memcpy(window.upper + j * NX, p->x_max, sizeof p->x_max);
        memcpy(window.row_lower + j * NX, p->w_min, sizeof p->w_min);
        memcpy(window.row_upper + j * NX, p->w_max, sizeof p->w_max);
    }
    return 1;
}

static int solve(const struct plant *p, int H, const double *y, double *x, int *active)
{
    const struct dse_window_qp_config config = {.nz = NX, .nr = NX, .stages = H_MAX};
    const struct dse_window_qp_problem problem = {.stages = H,
                                                  .diagonal = window.diagonal,
                                                  .below = window.beside,
                                                  .c = window.c,
                                                  .bounds = {.lower = window.lower,
                                                             .upper = window.upper,
                                                             .E = window.minus_A,
                                                             .row_lower = window.row_lower,
                                                             .row_upper = window.row_upper}};
    struct dse_window_qp qp;
    struct dse_arena arena;
    dse_arena_init(&arena, qp_memory, (int)(sizeof qp_memory / sizeof(double)));
    const int ok = fill_window(p, H, y) && dse_window_qp_init(&qp, &config, &arena) == DSE_OK &&
                   dse_window_qp_factor(&qp, &problem, H - 1) == DSE_OK &&
                   dse_window_qp_solve(&qp, &problem) == DSE_OK;
    if (!ok)
        return 0;
    memcpy(x, dse_window_qp_z(&qp), sizeof *x * (size_t)(NX * H));
    *active = qp.set.count;
    return 1;
}

/* ---- comparison ---- */

/* The reference stacks by vessel, then by time. */
static double apart(int H, const double *x, const double *reference)
{
    double largest = 0;
    for (int j = 0; j < H; j++)
        for (int i = 0; i < NX; i++)
            largest = fmax(largest, fabs(x[j * NX + i] -
                                         reference[i / PART * PART * H + j * PART + i % PART]));
    return largest;
}

static int check(const char *who, int k, int ok, double deviation, int active, int expected)
{
    const int pass = ok && deviation <= TOLERANCE && active == expected;
    printf("  k = %-3d %-10s deviation %8.1e  tolerance %7.1e  active %d of %d  %s\n", k, who,
           deviation, TOLERANCE, active, expected, pass ? "ok" : "FAILED");
    return pass ? GOLDEN_PASS : GOLDEN_FAIL;
}

static int check_window(const struct plant *p, const json_t *object)
{
    const int H = (int)golden_number(object, "H", 0), k = (int)golden_number(object, "k", 0);
    const int expected = (int)golden_number(object, "active", -1);
    double y[H_MAX * NY] = {0}, reference[ALL] = {0}, x[ALL] = {0};
    int active = -1;
    if (H < 1 || H > H_MAX || !read(object, "y", H * NY, y) ||
        !read(object, "X", H * NX, reference))
        return GOLDEN_FAIL;
    int ok = solve(p, H, y, x, &active);
    int result = check("window QP", k, ok, apart(H, x, reference), active, expected);
    ok = estimate(p, H, y, x, &active);
    result |= check("estimator", k, ok, apart(H, x, reference), active, expected);
    return result;
}

static int check_file(const json_t *root)
{
    struct plant plant;
    int result = GOLDEN_FAIL;
    if (read_plant(root, &plant)) {
        const json_t *windows = json_object_get(root, "windows");
        const size_t count = json_array_size(windows);
        result = count > 0 ? GOLDEN_PASS : GOLDEN_FAIL;
        for (size_t i = 0; i < count; i++)
            result |= check_window(&plant, json_array_get(windows, i));
    } else {
        printf("  cannot be read\n");
    }
    return result;
}

int main(int argc, char **argv)
{
    return golden_main(argc, argv, check_file);
}
