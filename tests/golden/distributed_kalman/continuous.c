/* Reference runs of continuous networks. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "parts.h"

static struct kalman_network network;
static const dse_real identity[NX * NX] = {1, 0, 0, 1};

/* Runs the network that has been made along the file, comparing wherever it has a record. */
static void go(struct golden_run *run, const char *name)
{
    double y[NETWORK_NODES];
    char label[64];
    for (int k = 0; k <= run->steps && run->worst != GOLDEN_FAIL; k++) {
        const double t = k * run->h;
        golden_run_measure(run, &network, k, y);
        if (network_hear(&network, t, y) != DSE_OK)
            run->worst = GOLDEN_FAIL;
        snprintf(label, sizeof label, "%s: plant", name);
        golden_run_compare_plant(run, k, label);
        snprintf(label, sizeof label, "%s: xh", name);
        golden_run_compare(run, &network, k, label, "xhat", dse_dkf_state, NX);
        snprintf(label, sizeof label, "%s: P", name);
        golden_run_compare(run, &network, k, label, "P", dse_dkf_covariance, NX * NX);
        snprintf(label, sizeof label, "%s: W", name);
        golden_run_compare(run, &network, k, label, "W", dse_dkf_lyapunov, NX * NX);
        snprintf(label, sizeof label, "%s: Gamma", name);
        golden_run_compare_gains(run, &network, k, label);
        if (k == run->steps)
            break;
        if (network_advance(&network) != DSE_OK ||
            plant_step(&network.model, t, run->h, run->w != NULL ? run->w + NX * k : NULL,
                       run->x) != DSE_OK) {
            printf("  %s: step %d failed\n", name, k);
            run->worst = GOLDEN_FAIL;
        }
    }
}

/* ---- time-varying networks of all schemes ---- */

static bool set_scheme(const json_t *options)
{
    static const struct {
        const char *name;
        enum dse_dkf_scheme scheme;
    } schemes[] = {{"none", DSE_DKF_ALONE},
                   {"edge", DSE_DKF_EDGE},
                   {"node", DSE_DKF_NODE},
                   {"global", DSE_DKF_GLOBAL},
                   {"std", DSE_DKF_STANDARD}};
    network.base.gamma = golden_number(options, "gamma", 0);
    network.base.sigma = golden_number(options, "leak", 0);
    if (json_is_true(json_object_get(options, "rem26")))
        network.base.direction = DSE_DKF_GAIN;
    for (size_t s = 0; s < sizeof schemes / sizeof schemes[0]; s++) {
        if (golden_is(options, "variant", schemes[s].name)) {
            network.base.scheme = schemes[s].scheme;
            return true;
        }
    }
    return false;
}

int golden_adaptive_networks(const json_t *root)
{
    const char *name;
    const json_t *reference;
    json_t *runs = json_object_get(root, "runs");
    int worst = GOLDEN_PASS;
    json_object_foreach(runs, name, reference)
    {
        struct golden_run run;
        int result = golden_run_load(root, &run, &network);
        if (result == GOLDEN_PASS && !set_scheme(json_object_get(reference, "options")))
            result = GOLDEN_UNSUPPORTED;
        network.base.beta = golden_number(root, "beta", 1);
        network.base.P0 = identity;
        network.base.Q = identity;
        if (result == GOLDEN_PASS) {
            run.records = json_object_get(reference, "records");
            if (golden_run_make(root, &network) != DSE_OK)
                run.worst = GOLDEN_FAIL;
            go(&run, name);
            result = golden_run_verdict(&run);
        }
        golden_run_free(&run);
        worst = result != GOLDEN_PASS ? result : worst;
    }
    return json_object_size(runs) > 0 ? worst : GOLDEN_FAIL;
}

/* ---- gains made offline ---- */

static bool fetch_matrix(const json_t *object, const char *key, int count, dse_real *M)
{
    const json_t *rows = json_object_get(object, key);
    int k = 0;
    for (size_t r = 0; r < json_array_size(rows); r++) {
        const json_t *row = json_array_get(rows, r);
        for (size_t c = 0; c < json_array_size(row) && k < count; c++)
            M[k++] = json_number_value(json_array_get(row, c));
    }
    return k == count;
}

/* KF8: the plant without its swing, K and D from algebraic Riccati and Lyapunov equations. */
int golden_offline_network(const json_t *root)
{
    static dse_real K[NETWORK_NODES][NX], D[NETWORK_NODES][NX];
    const json_t *design = json_object_get(root, "design");
    struct golden_run run;
    int result = golden_run_load(root, &run, &network);
    network.model.parameters = NULL;
    network.base.scheme = DSE_DKF_EDGE;
    network.base.direction = DSE_DKF_GIVEN;
    network.base.gamma = golden_number(root, "gamma", 0);
    network.base.beta = golden_number(root, "beta", 1);
    for (int i = 0; result == GOLDEN_PASS && i < run.nodes; i++) {
        const json_t *node = json_array_get(design, (size_t)i);
        if (!fetch_matrix(node, "C", NX, network.C[i]) || !fetch_matrix(node, "K", NX, K[i]) ||
            !fetch_matrix(node, "D_U_eye", NX, D[i]))
            result = GOLDEN_FAIL;
        network.K[i] = K[i];
        network.D[i] = D[i];
    }
    if (result == GOLDEN_PASS && golden_run_make(root, &network) == DSE_OK) {
        run.records = json_object_get(root, "records");
        go(&run, "offline gains");
        result = golden_run_verdict(&run);
    } else {
        result = GOLDEN_FAIL;
    }
    golden_run_free(&run);
    return result;
}

/* KF9: constant gains L, D = W C' from the Lyapunov equation that runs along. */
int golden_luenberger_network(const json_t *root)
{
    static dse_real L[NETWORK_NODES][NX], S[NX * NX];
    struct golden_run run;
    int result = golden_run_load(root, &run, &network);
    network.base.scheme = DSE_DKF_EDGE;
    network.base.direction = DSE_DKF_LYAPUNOV;
    network.base.gamma = golden_number(root, "gamma", 0);
    network.base.beta = golden_number(root, "beta", 1);
    network.base.S = S;
    if (!fetch_matrix(root, "S", NX * NX, S))
        result = GOLDEN_FAIL;
    const json_t *gains = json_object_get(root, "L");
    for (int i = 0; result == GOLDEN_PASS && i < run.nodes; i++) {
        int count;
        double *column = golden_numbers(json_array_get(gains, (size_t)i), &count);
        if (count == NX)
            memcpy(L[i], column, sizeof L[i]);
        else
            result = GOLDEN_FAIL;
        free(column);
        network.K[i] = L[i];
    }
    if (result == GOLDEN_PASS && golden_run_make(root, &network) == DSE_OK) {
        run.records = json_object_get(root, "records");
        go(&run, "Luenberger");
        result = golden_run_verdict(&run);
    } else {
        result = GOLDEN_FAIL;
    }
    golden_run_free(&run);
    return result;
}
