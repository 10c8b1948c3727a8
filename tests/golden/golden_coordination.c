/* golden_coordination FILE.json ...
 *
 * Compares agents and coordinator with an independent implementation of the price-driven and the
 * prediction-driven scheme: estimates over time, rounds per sample, messages sent, single windows
 * step by step, and windows with bounds. Exit code 0: all within their tolerance; 1: some are not,
 * or a file cannot be read; 2: the layout is not supported. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "coordination/coordination.h"

static const struct {
    const char *key;
    enum dse_mhe_scheme scheme;
    int rounds;    /* exactly, 0: until converged */
    int dead_from; /* the last subsystem is not connected after this sample; -1: always is */
    /* Absolute. 1e-7 as the reference states it; what is wrong about subsystem 3 in the first
     * round of all, before it is known that it never answers, is forgotten within eps. */
    double tolerance;
} runs[] = {
    {"price", DSE_MHE_PRICE, 0, -1, 1e-7},
    {"pred", DSE_MHE_PREDICTION, 0, -1, 1e-7},
    {"pred_shift", DSE_MHE_PREDICTION, 0, -1, 1e-7},
    {"pred_trigger", DSE_MHE_PREDICTION, 0, -1, 1e-7},
    {"pred_premature", DSE_MHE_PREDICTION, 7, -1, 1e-7},
    {"pred_fail_case1", DSE_MHE_PREDICTION, 0, 0, 1e-4},
    {"pred_fail_case2", DSE_MHE_PREDICTION, 0, 15, 1e-7},
};

static int check_runs(const json_t *root)
{
    int result = GOLDEN_UNSUPPORTED;
    for (size_t i = 0; i < sizeof runs / sizeof runs[0]; i++) {
        const json_t *record = json_object_get(root, runs[i].key);
        struct network network;
        if (record == NULL)
            continue;
        int this = network_read(root, &network);
        if (this == GOLDEN_PASS) {
            network.net.settings.scheme = runs[i].scheme;
            network.net.config.max_iter = runs[i].rounds > 0 ? runs[i].rounds : 200;
            network.net.config.fixed_iterations = runs[i].rounds > 0;
            network.net.config.shift = strcmp(runs[i].key, "pred_shift") == 0;
            network.dead_from = runs[i].dead_from;
            this = compare_run(&network, runs[i].key, record, runs[i].tolerance);
        }
        network_free(&network);
        result = result == GOLDEN_UNSUPPORTED ? this : result | this;
    }
    return result;
}

static int check_file(const json_t *root)
{
    int result = GOLDEN_UNSUPPORTED;
    if (json_object_get(root, "bounds") != NULL)
        result = compare_bounded(root);
    else
        result = check_runs(root);
    const json_t *price = json_object_get(json_object_get(root, "price"), "window");
    if (price != NULL)
        result |= compare_price_window(root, price);
    const json_t *prediction = json_object_get(root, "pred_window");
    if (prediction != NULL)
        result |= compare_prediction_window(root, prediction);
    return result;
}

int main(int argc, char **argv)
{
    return golden_main(argc, argv, check_file);
}
