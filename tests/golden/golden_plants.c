/* golden_plants FILE.json ...
 *
 * Compares shipped plants with reference data of independent implementations, by what a file has:
 *   points      derivative f, outputs y and Jacobian J at (t, x, u)
 *   trajectory  states under the inputs of the experiment, by CVODE with the default tolerances
 *   A           the exact discretisation of the Jacobian at the steady state
 * Exit code 0: all within tolerance; 1: some are not, or a file cannot be read. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dse/linalg.h"
#include "golden.h"
#include "sim/simulator.h"

/* Of the reference data, relative. */
#define POINT      1e-10
#define TRAJECTORY 1e-7
#define DISCRETE   1e-10

enum { MAX_NX = 9, MAX_NU = 3, MAX_NY = 12, MAX_PREPARED = 256, MAX_ROWS = 64 };

struct subject {
    const struct dse_plant *plant;
    dse_real prepared[MAX_PREPARED];
    struct dse_model model;
    double u[MAX_NU];
};

static bool read_subject(const json_t *root, struct subject *s)
{
    const char *set = json_string_value(json_object_get(root, "set"));
    const json_t *inputs = json_object_get(root, "inputs");
    s->plant = dse_plant_find(json_string_value(json_object_get(root, "plant")));
    if (s->plant == NULL || s->plant->nx > MAX_NX || s->plant->ny > MAX_NY ||
        s->plant->nu > MAX_NU || s->plant->prepared_size > MAX_PREPARED)
        return false;
    for (int i = 0; i < s->plant->nu; i++)
        s->u[i] = inputs != NULL ? json_number_value(json_array_get(inputs, (size_t)i))
                                 : (double)s->plant->inputs[i].nominal;
    for (int i = 0; i < s->plant->n_sets; i++) {
        if (set != NULL && strcmp(s->plant->sets[i].name, set) != 0)
            continue;
        if (s->plant->prepare(s->plant->sets[i].values, s->prepared) != DSE_OK)
            return false;
        s->plant->model(s->prepared, &s->model);
        return true;
    }
    return false;
}

/* The numbers object[key] in `to`; false when they are not `count`. */
static bool read_numbers(const json_t *object, const char *key, int count, double *to)
{
    int found;
    double *list = golden_numbers(json_object_get(object, key), &found);
    const bool good = found == count;
    if (good)
        memcpy(to, list, (size_t)count * sizeof *to);
    free(list);
    return good;
}

/* ---- points ---- */

static int compare_point(const struct subject *s, const json_t *point)
{
    const struct dse_model *m = &s->model;
    double x[MAX_NX], u[MAX_NU], f[MAX_NX], y[MAX_NY], J[MAX_NX * MAX_NX];
    const double t = golden_number(point, "t", 0);
    memcpy(u, s->u, sizeof u);
    if (!read_numbers(point, "x", m->nx, x) ||
        (json_object_get(point, "u") != NULL && !read_numbers(point, "u", m->nu, u)) ||
        m->f(m, t, x, u, f) != DSE_OK || m->h(m, t, x, u, y) != DSE_OK ||
        m->dfdx(m, t, x, u, J) != DSE_OK)
        return GOLDEN_FAIL;
    int result = golden_compare(point, "f", 1, m->nx, f, POINT);
    if (json_object_get(point, "y") != NULL)
        result |= golden_compare(point, "y", 1, m->ny, y, POINT);
    if (json_object_get(point, "J") != NULL)
        result |= golden_compare(point, "J", m->nx, m->nx, J, POINT);
    if (s->plant->complete != NULL) { /* the reference's states are complete */
        double whole[MAX_NX];
        memcpy(whole, x, sizeof whole);
        s->plant->complete(s->prepared, t, u, whole);
        result |= golden_compare_as("completed x", point, "x", 1, m->nx, whole, POINT);
    }
    return result;
}

/* ---- trajectories ---- */

#define HALF_PI 1.5707963267948966

/* u = (cos 2t, 5 from t = 2 and 2 from t = 5 on), v = 5 sin t; samples every 0.25. */
static const struct sim_signal_step steps[] = {{8, 5}, {20, 2}};
static const struct sim_drive of_uio[] = {
    {.input = 0, .signal = {.kind = SIM_SINUSOID, .amplitude = 1, .omega = 2, .phase = HALF_PI}},
    {.input = 1, .signal = {.kind = SIM_STEPS, .steps = steps, .n_steps = 2}},
    {.input = 2, .signal = {.kind = SIM_SINUSOID, .amplitude = 5, .omega = 1}}};
/* u = (-sin t, cos t) */
static const struct sim_drive of_fo[] = {
    {.input = 0,
     .signal = {.kind = SIM_SINUSOID, .amplitude = 1, .omega = 1, .phase = 2 * HALF_PI}},
    {.input = 1, .signal = {.kind = SIM_SINUSOID, .amplitude = 1, .omega = 1, .phase = HALF_PI}}};

static void drive(const struct subject *s, struct sim_config *config)
{
    if (strcmp(s->plant->name, "descriptor_uio") == 0) {
        config->drives = of_uio;
        config->n_drives = 3;
    } else if (strcmp(s->plant->name, "descriptor_fo") == 0) {
        config->drives = of_fo;
        config->n_drives = 2;
    }
}

static int compare_trajectory(const struct subject *s, const json_t *reference)
{
    const int nx = s->plant->nx;
    static double got[MAX_ROWS * MAX_NX];
    char reason[512] = "";
    int rows, n;
    double *t = golden_numbers(json_object_get(reference, "t"), &rows);
    double *x = golden_numbers(json_object_get(reference, "x"), &n);
    struct simulator *sim = NULL;
    bool ok = rows > 1 && rows <= MAX_ROWS && n == rows * nx;
    if (ok) {
        struct sim_config config = {
            .plant = s->plant, .prepared = s->prepared, .x0 = x, .u = s->u, .period = t[1] - t[0]};
        drive(s, &config);
        sim = sim_create(&config, reason, sizeof reason);
    }
    ok = sim != NULL;
    for (int r = 0; ok && r < rows; r++) {
        memcpy(got + r * nx, sim_state(sim), (size_t)nx * sizeof *got);
        ok = fabs(sim_time(sim) - t[r]) < 1e-12 * (1 + t[r]) &&
             (r == rows - 1 || sim_step(sim, reason, sizeof reason));
    }
    if (!ok)
        printf("  nothing to compare: %s\n", reason);
    const int result = ok ? golden_compare(reference, "x", rows, nx, got, TRAJECTORY) : GOLDEN_FAIL;
    sim_destroy(sim);
    free(t);
    free(x);
    return result;
}

/* ---- the linearised plant ---- */

static int compare_discrete(const struct subject *s, const json_t *root)
{
    const struct dse_model *m = &s->model;
    double x[MAX_NX], f[MAX_NX], A[MAX_NX * MAX_NX], exact[MAX_NX * MAX_NX];
    double scratch[DSE_EXPM_SCRATCH(MAX_NX)];
    if (!read_numbers(root, "steady_state", m->nx, x) || m->f(m, 0, x, s->u, f) != DSE_OK ||
        m->dfdx(m, 0, x, s->u, A) != DSE_OK)
        return GOLDEN_FAIL;
    int result =
        golden_compare_as("Jacobian at the steady state", root, "Ac", m->nx, m->nx, A, POINT);
    for (int i = 0; i < m->nx; i++)
        result |= fabs(f[i]) < 1e-6 * s->plant->states[i].scale ? GOLDEN_PASS : GOLDEN_FAIL;
    for (int k = 0; k < m->nx * m->nx; k++)
        A[k] *= golden_number(root, "dt_h", 0);
    if (dse_expm(m->nx, A, exact, scratch) != DSE_OK)
        return GOLDEN_FAIL;
    return result | golden_compare(root, "A", m->nx, m->nx, exact, DISCRETE);
}

static int compare_file(const json_t *root)
{
    static struct subject subject;
    const json_t *trajectory = json_object_get(root, "trajectory"), *point;
    size_t i;
    int result = GOLDEN_PASS;
    if (!read_subject(root, &subject)) {
        printf("  no such plant or set\n");
        return GOLDEN_FAIL;
    }
    json_array_foreach(json_object_get(root, "points"), i, point) result |=
        compare_point(&subject, point);
    if (trajectory != NULL)
        result |= compare_trajectory(&subject, trajectory);
    if (json_object_get(root, "A") != NULL)
        result |= compare_discrete(&subject, root);
    return i > 0 ? result : GOLDEN_FAIL;
}

int main(int argc, char **argv)
{
    return golden_main(argc, argv, compare_file);
}
