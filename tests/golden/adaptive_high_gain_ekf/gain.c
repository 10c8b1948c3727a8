/* theta_adaptation.json: the gain under given innovations. */
#include <stdio.h>
#include <stdlib.h>

#include "dse/high_gain_ekf.h"
#include "parts.h"

static int gain_case(const json_t *reference)
{
    const json_t *params = json_object_get(reference, "params");
    const struct dse_gain_adaptation adaptation = {
        .theta_m = golden_number(params, "thm", 0),
        .rise_time = golden_number(params, "dT", 0),
        .relaxation = golden_number(params, "lam", 0),
        .sharpness = golden_number(params, "beta", 0),
        .threshold = golden_number(params, "m", 0),
    };
    const double h = golden_number(reference, "Ts_h", 0);
    int count;
    double *J = golden_numbers(json_object_get(reference, "J"), &count);
    double *mu = calloc((size_t)count + 1, sizeof *mu);
    double *theta = calloc((size_t)count + 1, sizeof *theta);
    int result = GOLDEN_FAIL;
    if (mu != NULL && theta != NULL) {
        double now = 1;
        for (int k = 0; k < count; k++) {
            now = dse_gain_adaptation_step(&adaptation, h, J[k], now);
            mu[k] = dse_gain_adaptation_mu(&adaptation, J[k]);
            theta[k] = now;
        }
        /* one row per value: each is judged relative to itself or to 1e-3 of the largest */
        result = golden_compare(reference, "mu", count, 1, mu, 1e-12) |
                 golden_compare(reference, "theta", count, 1, theta, 1e-12);
    }
    free(J);
    free(mu);
    free(theta);
    return result;
}

int golden_gain_file(const json_t *root)
{
    const json_t *cases = json_object_get(root, "cases");
    int result = json_array_size(cases) > 0 ? GOLDEN_PASS : GOLDEN_FAIL;
    for (size_t k = 0; k < json_array_size(cases); k++) {
        result |= gain_case(json_array_get(cases, k));
    }
    return result;
}
