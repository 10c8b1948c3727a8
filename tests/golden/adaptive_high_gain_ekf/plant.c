/* plant_*cstr*.json: parameters, steady state, points and a trajectory of a reactor network. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dse/ode.h"
#include "parts.h"

enum { MAX_N = 8 };

/* The feed of the file: constant, or that of section 4.7, F_0 = 10 (1 + 0.9 sin(0.008 t)), t in s.
 */
struct feed {
    const struct golden_plant *plant;
    int varies;
};

static void inputs_at(const struct feed *feed, double t, double *u)
{
    memcpy(u, feed->plant->nominal_u, sizeof feed->plant->nominal_u);
    if (feed->varies) {
        const double w = 0.008 * 3600;
        u[0] = 10 * (1 + 0.9 * sin(w * t));
        u[1] = 10 * 0.9 * w * cos(w * t);
    }
}

/* Parameters of the shipped set beside those of the file, as two columns of numbers. */
struct parameter_list {
    const struct golden_plant *plant;
    int count;
    double shipped[DSE_PLANT_MAX_PARAMETERS], file[DSE_PLANT_MAX_PARAMETERS];
};

static void parameter(struct parameter_list *list, const char *name, double value)
{
    const struct dse_plant *plant = list->plant->plant;
    int k = 0;
    while (k < plant->n_parameters && strcmp(plant->parameters[k].name, name) != 0) {
        k++;
    }
    list->shipped[list->count] = k < plant->n_parameters ? list->plant->set->values[k] : NAN;
    list->file[list->count++] = value;
}

/* stem1, stem2 ... with a tail: "k10", "k20" for the array k0 of the file. */
static void numbered(struct parameter_list *list, const json_t *array, const char *stem,
                     const char *tail)
{
    int count;
    double *values = golden_numbers(array, &count);
    for (int k = 0; k < count && list->count < DSE_PLANT_MAX_PARAMETERS - 3; k++) {
        char name[32];
        snprintf(name, sizeof name, "%s%d%s", stem, k + 1, tail);
        parameter(list, name, values[k]);
    }
    free(values);
}

/* Flows are not compared one by one: they are in every derivative below. */
static int parameters(const struct golden_plant *plant, const json_t *root)
{
    struct parameter_list list = {.plant = plant};
    numbered(&list, json_object_get(root, "V"), "V", "");
    numbered(&list, json_object_get(root, "Qh"), "Qh", "");
    numbered(&list, json_object_get(root, "dH"), "dH", "");
    numbered(&list, json_object_get(root, "k0"), "k", "0");
    numbered(&list, json_object_get(root, "Ea"), "E", "");
    parameter(&list, "rho", golden_number(root, "rho", NAN));
    parameter(&list, "cp", golden_number(root, "cp", NAN));
    parameter(&list, "R", golden_number(root, "Rgas", NAN));
    /* one row: every parameter is a column of its own */
    return golden_compare_numbers("parameters", 1, list.count, list.shipped, list.file, 1e-12);
}

/* All quantities of one point into the columns of the tables. */
struct tables {
    double *f, *h, *dfdx, *z, *zdot, *row2, *decoded;
};

static int evaluate(const struct feed *feed, const json_t *point, const struct tables *at)
{
    const struct dse_model *model = &feed->plant->model;
    const struct dse_normal_form *form = &feed->plant->form;
    const double t = golden_number(point, "t", 0);
    double u[DSE_PLANT_MAX_INPUTS], F[4];
    int n_x, n_w;
    double *x = golden_numbers(json_object_get(point, "x"), &n_x);
    double *w = golden_numbers(json_object_get(point, "w"), &n_w);
    inputs_at(feed, t, u);
    int ok = n_x == model->nx && n_w == model->nx && model->f(model, t, x, u, at->f) == DSE_OK &&
             model->h(model, t, x, u, at->h) == DSE_OK &&
             model->dfdx(model, t, x, u, at->dfdx) == DSE_OK &&
             form->encode(form, t, x, u, at->z) == DSE_OK &&
             form->field(form, t, at->z, u, at->zdot) == DSE_OK &&
             form->decode(form, t, at->z, u, at->decoded) == DSE_OK;
    for (int i = 0; ok && i < form->p; i++) {
        ok = form->jacobian(form, i, t, at->z, u, F) == DSE_OK;
        at->row2[2 * i] = F[2];
        at->row2[2 * i + 1] = F[3];
    }
    for (int k = 0; ok && k < model->nx; k++) {
        at->f[k] += w[k];
    }
    free(x);
    free(w);
    return ok;
}

/* One key of all points, row by row, against the table. */
static int compare_points(const char *name, const json_t *points, const char *key, int columns,
                          const double *got, double tolerance)
{
    const int rows = (int)json_array_size(points);
    json_t *column = json_array();
    for (int r = 0; r < rows; r++) {
        json_array_append(column, json_object_get(json_array_get(points, (size_t)r), key));
    }
    json_t *object = json_pack("{s:o}", key, column);
    const int result = golden_compare_as(name, object, key, rows, columns, got, tolerance);
    json_decref(object);
    return result;
}

static int points(const struct feed *feed, const json_t *all)
{
    enum { MAX_POINTS = 64 };
    static double f[MAX_POINTS][MAX_N], h[MAX_POINTS][MAX_N], dfdx[MAX_POINTS][MAX_N * MAX_N],
        z[MAX_POINTS][MAX_N], zdot[MAX_POINTS][MAX_N], row2[MAX_POINTS][MAX_N],
        decoded[MAX_POINTS][MAX_N];
    const int n = feed->plant->model.nx, p = feed->plant->form.p;
    const int rows = (int)json_array_size(all);
    if (rows < 1 || rows > MAX_POINTS || n > MAX_N) {
        printf("  %d points of %d states do not fit\n", rows, n);
        return GOLDEN_FAIL;
    }
    for (int r = 0; r < rows; r++) {
        const struct tables at = {
            &f[0][0] + r * n,    &h[0][0] + r * p,        &dfdx[0][0] + r * n * n, &z[0][0] + r * n,
            &zdot[0][0] + r * n, &row2[0][0] + r * 2 * p, &decoded[0][0] + r * n};
        if (!evaluate(feed, json_array_get(all, (size_t)r), &at)) {
            printf("  point %d cannot be evaluated\n", r);
            return GOLDEN_FAIL;
        }
    }
    return compare_points("f", all, "f", n, &f[0][0], 1e-10) |
           compare_points("h", all, "h", p, &h[0][0], 1e-10) |
           compare_points("dfdx", all, "dfdx", n * n, &dfdx[0][0], 1e-10) |
           compare_points("z", all, "z", n, &z[0][0], 1e-10) |
           compare_points("zdot_noise_free", all, "zdot_noise_free", n, &zdot[0][0], 1e-10) |
           compare_points("row2_A_plus_bstar", all, "row2_A_plus_bstar", 2 * p, &row2[0][0],
                          1e-10) |
           compare_points("x of decode", all, "x", n, &decoded[0][0], 1e-10);
}

static enum dse_status plant_rhs(void *context, dse_real t, const dse_real *x, dse_real *dx)
{
    const struct feed *feed = context;
    double u[DSE_PLANT_MAX_INPUTS];
    inputs_at(feed, t, u);
    return feed->plant->model.f(&feed->plant->model, t, x, u, dx);
}

/* Steps of a tenth of a second: their error is far below the tolerance of 1e-7. */
static int trajectory(struct feed *feed, const json_t *reference)
{
    enum { MAX_ROWS = 256 };
    static double got[MAX_ROWS * MAX_N];
    const int n = feed->plant->model.nx;
    int rows, n_x0, result = GOLDEN_FAIL;
    double *t = golden_numbers(json_object_get(reference, "t"), &rows);
    double *x = golden_numbers(json_object_get(reference, "x0"), &n_x0);
    double scratch[DSE_RK4_SCRATCH(MAX_N)];
    enum dse_status status = DSE_OK;
    if (n_x0 == n && n <= MAX_N && rows >= 1 && rows <= MAX_ROWS) {
        for (int r = 0; r < rows && status == DSE_OK; r++) {
            const double span = r > 0 ? t[r] - t[r - 1] : 0;
            const int steps = (int)ceil(span * 36000 - 1e-9);
            for (int s = 0; s < steps && status == DSE_OK; s++) {
                status = dse_rk4_step(plant_rhs, feed, t[r - 1] + span * s / steps, span / steps, n,
                                      x, scratch);
            }
            memcpy(got + r * n, x, (size_t)n * sizeof *x);
        }
        result = status == DSE_OK
                     ? golden_compare_as("x of trajectory", reference, "x", rows, n, got, 1e-7)
                     : GOLDEN_FAIL;
    }
    free(t);
    free(x);
    return result;
}

/* The file's equilibrium: the derivative vanishes there (rates are of the order 1e3 per hour). */
static int steady_state(const struct feed *feed, const json_t *reference)
{
    const struct dse_model *model = &feed->plant->model;
    int count;
    double *x = golden_numbers(reference, &count);
    double u[DSE_PLANT_MAX_INPUTS], dx[MAX_N], worst = INFINITY;
    inputs_at(feed, 0, u);
    if (count == model->nx && count <= MAX_N && model->f(model, 0, x, u, dx) == DSE_OK) {
        worst = 0;
        for (int k = 0; k < count; k++) {
            worst = fmax(worst, fabs(dx[k]));
        }
    }
    free(x);
    printf("  %-18s largest derivative %9.2e  tolerance %7.1e  %s\n", "steady_state", worst, 1e-10,
           worst <= 1e-10 ? "ok" : "FAILED");
    return worst <= 1e-10 ? GOLDEN_PASS : GOLDEN_FAIL;
}

int golden_plant_file(const json_t *root)
{
    const json_t *equilibrium = json_object_get(root, "steady_state");
    const int reactors = (int)golden_number(root, "n_reactors", 0);
    /* the two heat inputs tell the operating cases apart */
    const json_t *heat = json_array_get(json_object_get(root, "Qh"), 0);
    const char *name = reactors == 2 && json_number_value(heat) > 1.6e4 ? "2cstr_ch2"
                       : reactors == 2                                  ? "2cstr_ch4"
                       : reactors == 4                                  ? "4cstr"
                                                                        : NULL;
    struct golden_plant plant;
    int result = golden_plant_load(&plant, name);
    if (result != GOLDEN_PASS) {
        return result;
    }
    /* a file without an equilibrium is the one with the varying feed */
    struct feed feed = {&plant, equilibrium == NULL};
    result = parameters(&plant, root) | points(&feed, json_object_get(root, "points")) |
             trajectory(&feed, json_object_get(root, "trajectory"));
    if (equilibrium != NULL) {
        result |= steady_state(&feed, equilibrium);
    }
    golden_plant_free(&plant);
    return result;
}
