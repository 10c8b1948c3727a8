/* Quadratic plants: equations, trace term and covariance rate at points, open-loop predictions of
 * filters, and a trajectory. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dse/ode.h"
#include "dse/quadratic.h"
#include "dse/second_order.h"
#include "parts.h"

enum { NX = 3, NY = 2, SUBSTEPS = 400 };

static int worse(int a, int b)
{
    return a != GOLDEN_PASS ? a : b;
}

/* S' = J S + S J' */
static void covariance_rate(const double *J, const double *S, double *rate)
{
    for (int i = 0; i < NX; i++) {
        for (int j = 0; j < NX; j++) {
            rate[i * NX + j] = 0;
            for (int k = 0; k < NX; k++)
                rate[i * NX + j] += J[i * NX + k] * S[k * NX + j] + S[i * NX + k] * J[j * NX + k];
        }
    }
}

static int compare_points(const struct golden_plant *p, const json_t *root)
{
    enum { POINTS = 16 };
    const int ny = p->model.ny;
    double f[POINTS * NX], h[POINTS * NY], J[POINTS * NX * NX], rate[POINTS * NX * NX];
    double trace[POINTS * NX] = {0};
    int count = 0, n_S = 0;
    double *x = golden_numbers(json_object_get(root, "x"), &count);
    double *S = golden_numbers(json_object_get(root, "S"), &n_S);
    const int points = count / NX;
    int result = points > 0 && points <= POINTS && n_S == count * NX ? GOLDEN_PASS : GOLDEN_FAIL;
    for (int k = 0; result == GOLDEN_PASS && k < points; k++) {
        const double *xk = x + k * NX, *Sk = S + k * NX * NX;
        p->model.f(&p->model, 0, xk, NULL, f + k * NX);
        p->model.h(&p->model, 0, xk, NULL, h + k * ny);
        p->model.dfdx(&p->model, 0, xk, NULL, J + k * NX * NX);
        covariance_rate(J + k * NX * NX, Sk, rate + k * NX * NX);
        dse_quadratic_add_trace(NX, dse_quadratic_of(&p->model), Sk, trace + k * NX);
    }
    if (result == GOLDEN_PASS) {
        result = worse(result, golden_compare(root, "f", points, NX, f, 1e-10));
        result = worse(result, golden_compare(root, "h", points, ny, h, 1e-10));
        result = worse(result, golden_compare(root, "jac", points, NX * NX, J, 1e-10));
        result = worse(result, golden_compare(root, "trace_term", points, NX, trace, 1e-10));
        result = worse(result, golden_compare(root, "Sdot", points, NX * NX, rate, 1e-10));
    }
    free(x);
    free(S);
    return result;
}

/* From w0, S0 through all times without a measurement. */
static int compare_predictor(const struct golden_plant *p, const json_t *root, const char *key,
                             enum dse_second_order_kind kind)
{
    enum { TIMES = 8, STORAGE = DSE_SECOND_ORDER_STORAGE(NX, 0) };
    static double memory[STORAGE];
    const json_t *run = json_object_get(root, key);
    int count = 0, n_w = 0, n_S = 0;
    double *t = golden_numbers(json_object_get(run, "t"), &count);
    double *w0 = golden_numbers(json_object_get(run, "w0"), &n_w);
    double *S0 = golden_numbers(json_object_get(run, "S0"), &n_S);
    double w[TIMES * NX], S[TIMES * NX * NX], none = 0;
    int result =
        count > 0 && count <= TIMES && n_w == NX && n_S == NX * NX ? GOLDEN_PASS : GOLDEN_FAIL;
    const struct dse_second_order_config config = {.model = &p->model,
                                                   .C = &none,
                                                   .kind = kind,
                                                   .x0 = w0,
                                                   .S0 = S0,
                                                   .rtol = 1e-12,
                                                   .atol = 1e-14};
    struct dse_second_order filter;
    struct dse_arena arena;
    dse_arena_init(&arena, memory, STORAGE);
    if (result == GOLDEN_PASS && dse_second_order_init(&filter, &config, &arena) != DSE_OK)
        result = GOLDEN_FAIL;
    for (int k = 0; result == GOLDEN_PASS && k < count; k++) {
        if (dse_second_order_predict(&filter, t[k], NULL) != DSE_OK)
            result = GOLDEN_FAIL;
        memcpy(w + k * NX, dse_second_order_state(&filter), NX * sizeof *w);
        memcpy(S + k * NX * NX, dse_second_order_covariance(&filter), NX * NX * sizeof *S);
    }
    printf("  %s\n", key);
    if (result == GOLDEN_PASS) {
        result = worse(result, golden_compare(run, "w", count, NX, w, 1e-8));
        result = worse(result, golden_compare(run, "S", count, NX * NX, S, 1e-8));
    }
    free(t);
    free(w0);
    free(S0);
    return result;
}

static int compare_trajectory(const struct golden_plant *p, const json_t *root)
{
    enum { TIMES = 32 };
    const json_t *run = json_object_get(root, "trajectory");
    int count = 0, n_x0 = 0;
    double *t = golden_numbers(json_object_get(run, "t"), &count);
    double *x = golden_numbers(json_object_get(run, "x0"), &n_x0);
    double got[TIMES * NX], scratch[DSE_RK4_SCRATCH(NX)], now = 0;
    int result = count > 0 && count <= TIMES && n_x0 == NX ? GOLDEN_PASS : GOLDEN_FAIL;
    for (int k = 0; result == GOLDEN_PASS && k < count; k++) {
        const double h = (t[k] - now) / SUBSTEPS;
        for (int s = 0; s < SUBSTEPS; s++)
            dse_rk4_model_step(&p->model, 0, h, NULL, x, scratch);
        now = t[k];
        memcpy(got + k * NX, x, NX * sizeof *x);
    }
    if (result == GOLDEN_PASS)
        result = golden_compare_as("trajectory", run, "x", count, NX, got, 1e-8);
    free(t);
    free(x);
    return result;
}

int golden_quadratic_plant(const json_t *root)
{
    struct golden_plant p;
    memset(&p, 0, sizeof p);
    p.plant = dse_plant_find(json_string_value(json_object_get(root, "plant")));
    double prepared[1] = {0};
    if (p.plant == NULL || p.plant->nx != NX || p.plant->ny > NY || p.plant->prepared_size > 1)
        return GOLDEN_FAIL;
    if (p.plant->prepare(p.plant->sets[0].values, prepared) != DSE_OK)
        return GOLDEN_FAIL;
    p.plant->model(prepared, &p.model);
    int result = compare_points(&p, root);
    result = worse(result, compare_predictor(&p, root, "predictor_second_order", DSE_SECOND_ORDER));
    result = worse(result, compare_predictor(&p, root, "predictor_ekf", DSE_SECOND_ORDER_EXTENDED));
    return worse(result, compare_trajectory(&p, root));
}
