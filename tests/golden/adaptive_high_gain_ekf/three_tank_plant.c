/* plant_threetank.json: parameters, derived constants, points and a trajectory of the three tanks.
 * The file has the plant's true levels (three states) and the estimators' r = (r11, r12, r2, r31,
 * r32), which is the order of the shipped plant's states. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dse/ode.h"
#include "parts.h"

enum { N = 5, P = 3, POINTS = 64, ROWS = 256 };

/* Which of the five states are levels. */
static const int level[P] = {0, 2, 3};

static double value_of(const struct golden_plant *plant, const char *name)
{
    for (int k = 0; k < plant->plant->n_parameters; k++) {
        if (strcmp(plant->plant->parameters[k].name, name) == 0) {
            return plant->set->values[k];
        }
    }
    return NAN;
}

static int compare_named(const struct golden_plant *plant, const char *title, const json_t *file,
                         const char *const *names, int count)
{
    double shipped[16], reference[16];
    for (int k = 0; k < count; k++) {
        shipped[k] = value_of(plant, names[k]);
        reference[k] = golden_number(file, names[k], NAN);
    }
    return golden_compare_numbers(title, 1, count, shipped, reference, 1e-12);
}

/* Sets, nominal inputs and the constants that `prepare` derives: p1 p2 d1 d2 d3 b1 b2. */
static int parameters(const struct golden_plant *identified, const struct golden_plant *rig,
                      const json_t *root)
{
    static const char *const fitted[] = {"ap1", "ap2", "ad1", "ad2", "ad3", "b1", "b2"};
    static const char *const geometry[] = {"S", "Sp", "Sd", "g"};
    static const char *const derived[] = {"p1", "p2", "d1", "d2", "d3", "b1", "b2"};
    double coef[7];
    for (int k = 0; k < 7; k++) {
        coef[k] = golden_number(json_object_get(root, "coef"), derived[k], NAN);
    }
    const double rig_ad2 = value_of(rig, "ad2");
    const double reference_ad2 = golden_number(root, "surrogate_plant_ad2", NAN);
    return compare_named(identified, "parameters", json_object_get(root, "params"), fitted, 7) |
           compare_named(identified, "geometry", root, geometry, 4) |
           golden_compare_numbers("derived", 1, 7, identified->prepared, coef, 1e-12) |
           golden_compare_numbers("ad2 of the rig", 1, 1, &rig_ad2, &reference_ad2, 1e-12) |
           golden_compare_as("inputs", root, "u_ss", 1, 2, identified->nominal_u, 1e-12);
}

/* ---- points ---- */

struct tables {
    double f[POINTS * N], levels[POINTS * P], h[POINTS * P], z[POINTS * N], zdot[POINTS * N],
        row_1[POINTS * 2], row_3[POINTS * 2], F_2[POINTS], decoded[POINTS * N];
};

static int evaluate(const struct golden_plant *plant, const json_t *point, int row,
                    struct tables *at)
{
    const struct dse_model *model = &plant->model;
    const struct dse_normal_form *form = &plant->form;
    int n_r, n_u;
    double F[4];
    double *r = golden_numbers(json_object_get(point, "r"), &n_r);
    double *u = golden_numbers(json_object_get(point, "u"), &n_u);
    double *z = at->z + row * N, *f = at->f + row * N;
    int ok = n_r == N && n_u == 2 && model->f(model, 0, r, u, f) == DSE_OK &&
             model->h(model, 0, r, u, at->h + row * P) == DSE_OK &&
             form->encode(form, 0, r, u, z) == DSE_OK &&
             form->field(form, 0, z, u, at->zdot + row * N) == DSE_OK &&
             form->decode(form, 0, z, u, at->decoded + row * N) == DSE_OK &&
             form->jacobian(form, 1, 0, z, u, &at->F_2[row]) == DSE_OK;
    for (int k = 0; ok && k < P; k++) {
        at->levels[row * P + k] = f[level[k]];
    }
    for (int side = 0; ok && side < 2; side++) {
        ok = form->jacobian(form, 2 * side, 0, z, u, F) == DSE_OK;
        memcpy((side == 0 ? at->row_1 : at->row_3) + row * 2, F + 2, 2 * sizeof *F);
    }
    free(r);
    free(u);
    return ok;
}

static int compare_points(const json_t *points, const char *name, const char *key, int columns,
                          const double *got)
{
    const int rows = (int)json_array_size(points);
    json_t *column = json_array();
    for (int r = 0; r < rows; r++) {
        json_t *value = json_object_get(json_array_get(points, (size_t)r), key);
        if (json_is_array(value)) {
            json_array_append(column, value);
        } else {
            json_array_append_new(column, json_pack("[O]", value));
        }
    }
    json_t *object = json_pack("{s:o}", key, column);
    const int result = golden_compare_as(name, object, key, rows, columns, got, 1e-10);
    json_decref(object);
    return result;
}

static int points(const struct golden_plant *plant, const json_t *all)
{
    static struct tables at;
    const int rows = (int)json_array_size(all);
    for (int r = 0; r < rows; r++) {
        if (r >= POINTS || !evaluate(plant, json_array_get(all, (size_t)r), r, &at)) {
            printf("  point %d cannot be evaluated\n", r);
            return GOLDEN_FAIL;
        }
    }
    return compare_points(all, "f", "f_r", N, at.f) |
           compare_points(all, "f of the levels", "f_levels", P, at.levels) |
           compare_points(all, "h", "levels", P, at.h) | compare_points(all, "z", "z", N, at.z) |
           compare_points(all, "zdot", "zdot", N, at.zdot) |
           compare_points(all, "F_1", "row2_F1", 2, at.row_1) |
           compare_points(all, "F_2", "F2", 1, at.F_2) |
           compare_points(all, "F_3", "row2_F3", 2, at.row_3) |
           compare_points(all, "r of decode", "r", N, at.decoded);
}

/* ---- trajectory ---- */

struct driven {
    const struct golden_plant *plant;
    const double *u;
};

static enum dse_status rhs(void *context, dse_real t, const dse_real *x, dse_real *dx)
{
    const struct driven *driven = context;
    return driven->plant->model.f(&driven->plant->model, t, x, driven->u, dx);
}

/* Steps of 0.18 s: their error is far below the tolerance. */
static int trajectory(const struct golden_plant *plant, const json_t *reference)
{
    static double got[ROWS * P];
    double scratch[DSE_RK4_SCRATCH(N)];
    int rows, n_u, n_first;
    double *t = golden_numbers(json_object_get(reference, "t"), &rows);
    double *u = golden_numbers(json_object_get(reference, "u"), &n_u);
    double *first =
        golden_numbers(json_array_get(json_object_get(reference, "levels"), 0), &n_first);
    struct driven driven = {plant, u};
    int result = GOLDEN_FAIL;
    if (rows >= 1 && rows <= ROWS && n_u == 2 && n_first == P) {
        double x[N] = {first[0], first[0] - first[1], first[1], first[2], first[2] - first[1]};
        enum dse_status status = DSE_OK;
        for (int r = 0; r < rows && status == DSE_OK; r++) {
            const double span = r > 0 ? t[r] - t[r - 1] : 0;
            for (int s = 0; r > 0 && s < 100 && status == DSE_OK; s++) {
                status = dse_rk4_step(rhs, &driven, t[r - 1] + span * s / 100, span / 100, N, x,
                                      scratch);
            }
            for (int k = 0; k < P; k++) {
                got[r * P + k] = x[level[k]];
            }
        }
        if (status == DSE_OK) {
            result =
                golden_compare_as("levels of traject.", reference, "levels", rows, P, got, 1e-7);
        }
    }
    free(t);
    free(u);
    free(first);
    return result;
}

int golden_three_tank_plant_file(const json_t *root)
{
    struct golden_plant identified, rig;
    int result = golden_plant_load(&identified, "threetank");
    if (result != GOLDEN_PASS) {
        return result;
    }
    result = golden_plant_load(&rig, "threetank_rig");
    if (result == GOLDEN_PASS) {
        result = parameters(&identified, &rig, root) |
                 points(&identified, json_object_get(root, "points")) |
                 trajectory(&identified, json_object_get(root, "trajectory"));
        golden_plant_free(&rig);
    }
    golden_plant_free(&identified);
    return result;
}
