/* Single windows of a reference: step by step, and with bounds. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "coordination.h"

/* Converged windows, absolute, as the reference states it; constrained optima and barrier. */
#define WINDOW  1e-7
#define OPTIMUM 1e-6

static void run_to(struct network *w, long from, long to)
{
    for (long k = from; k <= to; k++)
        coordination_sample(&w->net, k, w->y + k * w->parts, NULL);
}

/* ---- price-driven: from any price two rounds ---- */

static double stack_deviation(const json_t *record, const char *key, const double *got, int size)
{
    int count;
    double *want = golden_numbers(json_object_get(record, key), &count), worst = 0;
    for (int e = 0; e < count; e++)
        worst = fmax(worst, fabs(want[e] - got[e]));
    free(want);
    return count == size ? worst : INFINITY;
}

int compare_price_window(const json_t *root, const json_t *window)
{
    struct network w;
    int count, result = network_read(root, &w);
    w.net.settings.scheme = DSE_MHE_PRICE;
    if (result != GOLDEN_PASS || network_start(&w) != GOLDEN_PASS) {
        network_free(&w);
        return report("price window", INFINITY, WINDOW);
    }
    const long k = (long)golden_number(window, "k", 0);
    const int m = (w.net.settings.horizon - 1) * w.n;
    run_to(&w, 0, k - 1);
    double *p0 = golden_numbers(json_object_get(window, "p0"), &count);
    for (int e = 0; e < m && count == m; e++)
        w.net.coordinator.p[e] = p0[e];
    free(p0);
    run_to(&w, k, k);
    double size = 0;
    for (int e = 0; e < m; e++)
        size = fmax(size, fabs(dse_mhe_coordinator_price(&w.net.coordinator)[e]));
    result = report(
        "price window: rounds",
        fabs(golden_number(window, "its", 0) - dse_mhe_coordinator_iterations(&w.net.coordinator)),
        0);
    result |= report("price window: X", window_deviation(&w, json_object_get(window, "X")), WINDOW);
    /* relative: the Hessian's condition number is 6e7 */
    result |= report("price window: p, relative",
                     stack_deviation(window, "p", w.net.coordinator.p, m) / size, WINDOW);
    result |=
        report("price window: h", stack_deviation(window, "H", w.net.coordinator.other, m), WINDOW);
    network_free(&w);
    return result;
}

/* ---- prediction-driven: from X = W = 0, as a coordinator starts that comes late ---- */

int compare_prediction_window(const json_t *root, const json_t *window)
{
    struct network w;
    const json_t *steps = json_object_get(window, "iterations");
    const int count = (int)json_array_size(steps);
    const long k = (long)golden_number(window, "k", 0);
    double worst = 0;
    int result = GOLDEN_PASS;
    for (int s = 1; s <= count + 1 && result == GOLDEN_PASS; s++) {
        result = network_read(root, &w);
        w.net.config.eps = golden_number(window, "eps", 0);
        w.net.config.max_iter = s <= count ? s : 200;
        if (result == GOLDEN_PASS && network_start(&w) == GOLDEN_PASS) {
            w.net.without_coordinator = true;
            run_to(&w, 0, k - 1);
            w.net.without_coordinator = false;
            run_to(&w, k, k);
            const double d = dse_mhe_coordinator_error(&w.net.coordinator);
            const json_t *step = json_array_get(steps, (size_t)(s - 1));
            if (s <= count)
                worst = fmax(worst, fabs(d / golden_number(step, "d", 0) - 1));
        } else {
            result = GOLDEN_FAIL;
        }
        if (s > count && result == GOLDEN_PASS) {
            result |= report("prediction window: X",
                             window_deviation(&w, json_object_get(window, "X")), WINDOW);
            result |= report("prediction window: rounds",
                             fabs(golden_number(window, "its", 0) -
                                  dse_mhe_coordinator_iterations(&w.net.coordinator)),
                             0);
        }
        network_free(&w);
    }
    return result | report("prediction window: d, relative", worst, 1e-9);
}

/* ---- with bounds ---- */

struct bounds {
    double *x_min, *x_max, *w_min, *w_max;
};

static void set_bounds(struct network *w, const struct bounds *bounds)
{
    for (int i = 0; i < w->parts; i++) {
        w->subsystems[i].x_min = bounds->x_min + i * w->nx;
        w->subsystems[i].x_max = bounds->x_max + i * w->nx;
        w->subsystems[i].w_min = bounds->w_min + i * w->nx;
        w->subsystems[i].w_max = bounds->w_max + i * w->nx;
    }
}

/* One way to run the network through the windows of a record. */
struct way {
    const char *name, *key, *rounds; /* reference stack and counts, NULL: not compared */
    enum dse_mhe_price_start start;
    double eps, barrier;
    int anderson;
    double tolerance;
};

/* Weights of Anderson's least squares: fractions and their prices beside temperatures. */
static const double x_weight[NX] = {100, 100, 1, 100, 100, 1, 100, 100, 1};
static const double p_weight[NX] = {0.1, 0.1, 1, 0.1, 0.1, 1, 0.1, 0.1, 1};

static int compare_windows(const json_t *section, const struct bounds *bounds,
                           enum dse_mhe_scheme scheme, const struct way *way)
{
    const json_t *windows = json_object_get(section, "windows");
    struct network w;
    double worst = 0, counts = 0;
    char text[64];
    int result = network_read(section, &w);
    w.net.settings.scheme = scheme;
    w.net.settings.barrier = way->barrier;
    w.net.config.eps = way->eps;
    w.net.config.price_start = way->start;
    w.net.config.anderson = way->anderson;
    w.net.config.x_weight = x_weight;
    w.net.config.p_weight = p_weight;
    set_bounds(&w, bounds);
    if (result == GOLDEN_PASS)
        result = network_start(&w);
    long done = -1;
    for (size_t q = 0; q < json_array_size(windows) && result == GOLDEN_PASS; q++) {
        const json_t *record = json_array_get(windows, q);
        const long k = (long)golden_number(record, "k", 0);
        run_to(&w, done + 1, k);
        done = k;
        if (way->key)
            worst = fmax(worst, window_deviation(&w, json_object_get(record, way->key)));
        if (way->rounds)
            counts = fmax(counts, fabs(golden_number(record, way->rounds, -1) -
                                       dse_mhe_coordinator_iterations(&w.net.coordinator)));
    }
    network_free(&w);
    if (way->key) {
        snprintf(text, sizeof text, "%s: X", way->name);
        result |= report(text, worst, way->tolerance);
    }
    if (way->rounds) {
        snprintf(text, sizeof text, "%s: rounds", way->name);
        result |= report(text, counts, 0);
    }
    return result;
}

/* Each agent alone. */
static int compare_alone(const json_t *section, const char *name, const struct bounds *bounds)
{
    const json_t *windows = json_object_get(section, "windows");
    struct network w;
    int result = network_read(section, &w);
    double worst = 0;
    set_bounds(&w, bounds);
    w.net.without_coordinator = true;
    if (result == GOLDEN_PASS)
        result = network_start(&w);
    long done = -1;
    for (size_t q = 0; q < json_array_size(windows) && result == GOLDEN_PASS; q++) {
        const json_t *record = json_array_get(windows, q);
        const long k = (long)golden_number(record, "k", 0);
        run_to(&w, done + 1, k);
        done = k;
        worst = fmax(worst, window_deviation(&w, json_object_get(record, "X_dec")));
    }
    network_free(&w);
    return result | report(name, worst, OPTIMUM);
}

int compare_bounded(const json_t *root)
{
    const json_t *section = json_object_get(root, "bounds");
    const json_t *price = json_object_get(root, "price");
    const json_t *prediction = json_object_get(root, "prediction");
    int count;
    struct bounds bounds = {.x_min = golden_numbers(json_object_get(section, "xlb"), &count),
                            .x_max = golden_numbers(json_object_get(section, "xub"), &count),
                            .w_min = golden_numbers(json_object_get(section, "wlb"), &count),
                            .w_max = golden_numbers(json_object_get(section, "wub"), &count)};
    static const struct way prices[] = {
        {"closed-form start", "X_cenD", "rounds_unc_start", DSE_MHE_START_CLOSED_FORM, 1e-9, 0, 0,
         OPTIMUM},
        {"start from zero", NULL, "rounds_zero_start_eps1e3", DSE_MHE_START_ZERO, 1e-3, 0, 0, 0},
    };
    static const struct way predictions[] = {
        {"hard bounds, Anderson", "X_cen", NULL, DSE_MHE_START_DEFAULT, 1e-9, 0, 8, OPTIMUM},
    };
    int result = GOLDEN_PASS;
    for (size_t i = 0; i < sizeof prices / sizeof prices[0]; i++)
        result |= compare_windows(price, &bounds, DSE_MHE_PRICE, &prices[i]);
    for (size_t i = 0; i < sizeof predictions / sizeof predictions[0]; i++)
        result |= compare_windows(prediction, &bounds, DSE_MHE_PREDICTION, &predictions[i]);
    result |= compare_alone(price, "decentralised, weights of the prices", &bounds);
    result |= compare_alone(prediction, "decentralised, weights of the predictions", &bounds);
    double *all[] = {bounds.x_min, bounds.x_max, bounds.w_min, bounds.w_max};
    result |= compare_whole(price, "centralised, weights of the prices", "X_cen", all, 0, OPTIMUM);
    result |= compare_whole(prediction, "centralised, weights of the predictions", "X_cen", all, 0,
                            OPTIMUM);
    result |= compare_whole(prediction, "centralised, barrier", "X_cen_barrier", all, 1e6, OPTIMUM);
    for (size_t i = 0; i < sizeof all / sizeof all[0]; i++)
        free(all[i]);
    return result;
}
