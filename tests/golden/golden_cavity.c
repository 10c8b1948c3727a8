/* golden_cavity FILE.json ...
 *
 * Compares the flow benchmark and its reduced models with an independent implementation:
 *   grid8.json              fields, operators, derivative and half a time unit on 8 x 8 cells
 *   free.json, forced.json  the shipped plant: matrices, points, the trajectory by CVODE, and the
 *                           simulated flow behind it: projections and sensors. F is listed as
 *                           entries [k, i, j, value] of the symmetric forms
 * Exit code 0: all within tolerance; 1: some are not, or a file cannot be read. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dse/quadratic.h"
#include "golden.h"
#include "sim/flow_modes.h"
#include "sim/simulator.h"

/* Relative, of the reference data; the projected modes are those of one eigenproblem solved twice.
 */
#define OPERATOR   1e-10
#define MODEL      1e-9
#define TRAJECTORY 1e-8

/* ---- the grid ---- */

enum {
    N = 8,
    PSI = SIM_FLOW_PSI(N),
    FACES = SIM_FLOW_FACES(N),
    CELLS = SIM_FLOW_SCALAR(N),
    STATE = SIM_FLOW_STATE(N)
};

/* Numbers of the members of a file, one after the other; false when they are not `count`. */
static bool read_fields(const json_t *root, const char *const *keys, int count, double *to)
{
    int have = 0;
    for (; *keys != NULL; keys++) {
        int n;
        double *list = golden_numbers(json_object_get(root, *keys), &n);
        const bool fits = n > 0 && have + n <= count;
        if (fits)
            memcpy(to + have, list, (size_t)n * sizeof *to);
        free(list);
        if (!fits)
            return false;
        have += n;
    }
    return have == count;
}

static int compare_state(const char *what, const json_t *root, const double *z)
{
    int result = GOLDEN_PASS;
    char name[32];
    const char *const keys[] = {"psi", "c", "T"};
    const int first[] = {0, PSI, PSI + CELLS, STATE};
    for (int i = 0; i < 3; i++) {
        snprintf(name, sizeof name, "%s %s", what, keys[i]);
        result |= golden_compare_as(name, root, keys[i], first[i + 1] - first[i], 1, z + first[i],
                                    OPERATOR);
    }
    return result;
}

static int compare_operators(const json_t *root, const double *z, const double *other)
{
    double w[FACES], out[FACES];
    int result = GOLDEN_PASS;
    sim_flow_velocity(N, z, w);
    result |= golden_compare(root, "u", FACES / 2, 1, w, OPERATOR);
    result |= golden_compare(root, "v", FACES / 2, 1, w + FACES / 2, OPERATOR);
    sim_flow_convection(N, w, w, out);
    result |= golden_compare(root, "conv_self", FACES, 1, out, OPERATOR);
    sim_flow_convection(N, other, w, out);
    result |= golden_compare(root, "conv_adv2", FACES, 1, out, OPERATOR);
    sim_flow_laplacian(N, w, out);
    result |= golden_compare(root, "lap_uv", FACES, 1, out, OPERATOR);
    sim_flow_scalar_convection(N, w, z + PSI, out);
    result |= golden_compare(root, "conv_c", CELLS, 1, out, OPERATOR);
    sim_flow_scalar_laplacian(N, z + PSI, out);
    return result | golden_compare(root, "lap_c", CELLS, 1, out, OPERATOR);
}

static int grid_file(const json_t *root)
{
    static const char *const fields[] = {"psi", "c", "T", NULL};
    static const char *const others[] = {"adv2_u", "adv2_v", NULL};
    double z[STATE], dz[STATE], other[FACES];
    struct sim_flow *flow = sim_flow_create(N, false);
    if (flow == NULL || !read_fields(root, others, FACES, other))
        return GOLDEN_FAIL;
    sim_flow_start(N, 0, z);
    int result = compare_state("start", root, z);
    result |= read_fields(root, fields, STATE, z) ? GOLDEN_PASS : GOLDEN_FAIL;
    result |= compare_operators(root, z, other);
    sim_flow_rhs(flow, z, dz);
    result |= compare_state("rhs", json_object_get(root, "rhs"), dz);
    for (int k = 0; k < 20; k++)
        sim_flow_step(flow, 0.025, z);
    result |= compare_state("after", json_object_get(root, "after_0p5_dt0p025"), z);
    sim_flow_destroy(flow);
    return result;
}

/* ---- the reduced models ---- */

enum { NX = SIM_FLOW_MODES, NY = SIM_FLOW_OUTPUTS, SAMPLES = SIM_FLOW_SNAPSHOTS };

static int compare_matrices(const json_t *root, const struct dse_plant *plant,
                            const struct dse_quadratic *system)
{
    int result = golden_compare(root, "A", NX * NX, 1, system->A, MODEL);
    result |= golden_compare(root, "C", NX * NY, 1, system->C, MODEL);
    result |= golden_compare(root, "train_x0", NX * 3, 1, plant->sets[1].x0, MODEL);
    /* the entries of F_k: half a term off the diagonal */
    double F[NX][NX][NX] = {{{0}}};
    for (int s = 0; s < system->terms; s++) {
        const struct dse_quadratic_term *t = &system->term[s];
        F[t->k][t->i][t->j] = F[t->k][t->j][t->i] = t->i == t->j ? t->value : t->value / 2;
    }
    int count;
    double *want = golden_numbers(json_object_get(root, "F"), &count);
    double wanted[NX][NX][NX] = {{{0}}};
    for (int s = 0; s + 3 < count; s += 4)
        wanted[(int)want[s]][(int)want[s + 1]][(int)want[s + 2]] = want[s + 3];
    free(want);
    result |= golden_compare_numbers("F", NX * NX * NX, 1, &F[0][0][0], &wanted[0][0][0], MODEL);
    if (system->d != NULL)
        result |= golden_compare(root, "d", NX, 1, system->d, MODEL);
    return result;
}

static int compare_points(const json_t *root, const struct dse_model *model)
{
    int result = GOLDEN_PASS;
    size_t i;
    const json_t *point, *points = json_object_get(root, "points");
    json_array_foreach(points, i, point)
    {
        static const char *const state[] = {"x", NULL};
        double x[NX], f[NX], J[NX * NX];
        if (!read_fields(point, state, NX, x) || model->f(model, 0, x, NULL, f) != DSE_OK ||
            model->dfdx(model, 0, x, NULL, J) != DSE_OK)
            return GOLDEN_FAIL;
        result |= golden_compare(point, "f", NX, 1, f, MODEL);
        result |= golden_compare(point, "jac", NX * NX, 1, J, MODEL);
    }
    return i > 0 ? result : GOLDEN_FAIL;
}

static int compare_run(const json_t *root, const struct dse_plant *plant,
                       enum sim_integrator integrator, const char *states, const char *outputs)
{
    static double x[SAMPLES][NX], y[SAMPLES][NY];
    const double prepared[1] = {0}, u[1] = {0};
    char reason[512] = "";
    const struct sim_config config = {.plant = plant,
                                      .prepared = prepared,
                                      .x0 = plant->sets[0].x0,
                                      .u = u,
                                      .period = SIM_FLOW_PERIOD,
                                      .integrator = integrator,
                                      .rtol = 1e-12, /* BDF errors gather over many steps */
                                      .atol = 1e-14};
    struct simulator *sim = sim_create(&config, reason, sizeof reason);
    for (int k = 0; sim != NULL && k < SAMPLES; k++) {
        memcpy(x[k], sim_state(sim), sizeof x[k]);
        memcpy(y[k], sim_output(sim), sizeof y[k]);
        if (!sim_step(sim, reason, sizeof reason))
            break;
    }
    printf("%s", reason);
    if (sim == NULL || reason[0] != '\0')
        return GOLDEN_FAIL;
    sim_destroy(sim);
    int result = golden_compare(root, states, SAMPLES, NX, x[0], TRAJECTORY);
    if (outputs != NULL)
        result |= golden_compare(root, outputs, SAMPLES, NY, y[0], TRAJECTORY);
    return result;
}

static int model_file(const json_t *root)
{
    const struct dse_plant *plant =
        dse_plant_find(json_string_value(json_object_get(root, "plant")));
    const double prepared[1] = {0};
    if (plant == NULL)
        return GOLDEN_FAIL;
    struct dse_model model;
    plant->model(prepared, &model);
    const struct dse_quadratic *system = dse_quadratic_of(&model);
    if (system == NULL)
        return GOLDEN_FAIL;
    int result = compare_matrices(root, plant, system);
    result |= compare_points(root, &model);
    result |= compare_run(root, plant, SIM_CVODE, "reduced", NULL);
    return result | compare_run(root, plant, SIM_FLOW, "projected", "sensors");
}

static int check_file(const json_t *root)
{
    return json_object_get(root, "plant") == NULL ? grid_file(root) : model_file(root);
}

int main(int argc, char **argv)
{
    return golden_main(argc, argv, check_file);
}
