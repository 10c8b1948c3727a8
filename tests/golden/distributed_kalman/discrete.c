/* Reference runs of discrete networks. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "parts.h"

static struct kalman_network network;

/* A(k) as the file lists it; the time of a sample is its number. */
struct listed_plant {
    const double *A; /* count x NX x NX; the last one holds for ever */
    int count;
};

static enum dse_status listed_A(const struct dse_model *model, dse_real t, const dse_real *x,
                                const dse_real *u, dse_real *A)
{
    const struct listed_plant *plant = model->parameters;
    const int k = (int)t < plant->count ? (int)t : plant->count - 1;
    (void)x, (void)u;
    memcpy(A, plant->A + (size_t)(k * NX * NX), sizeof(double) * NX * NX);
    return DSE_OK;
}

static void set_plant(const struct listed_plant *plant)
{
    network.model = (struct dse_model){
        .time = DSE_DISCRETE, .nx = NX, .ny = 1, .parameters = plant, .dfdx = listed_A};
}

/* x <- A(k) x + w. */
static void move(struct golden_run *run, int k)
{
    double A[NX * NX], next[NX];
    network.model.dfdx(&network.model, k, run->x, NULL, A);
    dse_mat_vec(NX, NX, A, run->x, next);
    for (int i = 0; i < NX; i++)
        run->x[i] = next[i] + (run->w != NULL ? run->w[NX * k + i] : 0);
}

static const dse_real *prior(const struct dse_dkf *node)
{
    return node->now;
}

static void go(struct golden_run *run, const char *name)
{
    double y[NETWORK_NODES];
    char label[64];
    for (int k = 0; k <= run->steps && run->worst != GOLDEN_FAIL; k++) {
        golden_run_measure(run, &network, k, y);
        if (network_hear(&network, k, y) != DSE_OK)
            run->worst = GOLDEN_FAIL;
        golden_run_compare_plant(run, k, "plant");
        snprintf(label, sizeof label, "%s: xh", name);
        golden_run_compare(run, &network, k, label, "xhat", dse_dkf_state, NX);
        snprintf(label, sizeof label, "%s: prior", name);
        golden_run_compare(run, &network, k, label, "xbar", prior, NX);
        snprintf(label, sizeof label, "%s: P", name);
        golden_run_compare(run, &network, k, label, "P", dse_dkf_covariance, NX * NX);
        snprintf(label, sizeof label, "%s: D", name);
        golden_run_compare(run, &network, k, label, "D", dse_dkf_direction, NX);
        snprintf(label, sizeof label, "%s: Gamma", name);
        golden_run_compare_gains(run, &network, k, label);
        if (k < run->steps && network_advance(&network) != DSE_OK)
            run->worst = GOLDEN_FAIL;
        move(run, k < run->steps ? k : 0);
    }
}

static bool set_scheme(const char *name)
{
    static const struct {
        const char *name;
        enum dse_dkf_scheme scheme;
        enum dse_dkf_direction direction;
    } schemes[] = {{"none", DSE_DKF_ALONE, DSE_DKF_COVARIANCE},
                   {"edge_P", DSE_DKF_EDGE, DSE_DKF_COVARIANCE},
                   {"node_P", DSE_DKF_NODE, DSE_DKF_COVARIANCE},
                   {"edge_M", DSE_DKF_EDGE, DSE_DKF_FILTERED},
                   {"node_M", DSE_DKF_NODE, DSE_DKF_FILTERED}};
    for (size_t s = 0; s < sizeof schemes / sizeof schemes[0]; s++) {
        if (strcmp(name, schemes[s].name) == 0) {
            network.base.scheme = schemes[s].scheme;
            network.base.direction = schemes[s].direction;
            return true;
        }
    }
    return false;
}

static int last_record(const json_t *records)
{
    return (int)golden_number(json_array_get(records, json_array_size(records) - 1), "k", 0);
}

static int run_filter(const json_t *root, const struct listed_plant *plant, const char *name,
                      const json_t *records)
{
    static const dse_real identity[NX * NX] = {1, 0, 0, 1};
    static dse_real Q[NX * NX];
    struct golden_run run;
    int result = golden_run_load(root, &run, &network);
    Q[0] = Q[3] = golden_number(root, "Qd", 0);
    set_plant(plant);
    network.base.gamma = golden_number(root, "gamma", 0);
    network.base.P0 = identity;
    network.base.Q = Q;
    if (result == GOLDEN_PASS && !set_scheme(name))
        result = GOLDEN_UNSUPPORTED;
    if (result == GOLDEN_PASS && golden_run_make(root, &network) == DSE_OK) {
        run.records = records;
        run.steps = last_record(records);
        go(&run, name);
        result = golden_run_verdict(&run);
    } else {
        result = GOLDEN_FAIL;
    }
    golden_run_free(&run);
    return result;
}

/* DT3: node i uses gains i mod 2; no noise. */
static int run_luenberger(const json_t *root, const json_t *part)
{
    struct golden_run run;
    int result = golden_run_load(root, &run, &network), n_A, n_L, n_D;
    double *A = golden_numbers(json_object_get(part, "A"), &n_A);
    double *L = golden_numbers(json_object_get(part, "L"), &n_L);
    double *D = golden_numbers(json_object_get(part, "D"), &n_D);
    const struct listed_plant plant = {A, 1};
    set_plant(&plant);
    network.base.gamma = golden_number(root, "gamma", 0);
    network.base.scheme = DSE_DKF_EDGE;
    network.base.direction = DSE_DKF_GIVEN;
    if (n_A != NX * NX || n_L != 2 * NX || n_D != 2 * NX)
        result = GOLDEN_FAIL;
    for (int i = 0; result == GOLDEN_PASS && i < run.nodes; i++) {
        network.K[i] = L + (size_t)(NX * (i % 2));
        network.D[i] = D + (size_t)(NX * (i % 2));
    }
    if (result == GOLDEN_PASS && golden_run_make(root, &network) == DSE_OK) {
        run.records = json_object_get(part, "records");
        run.steps = last_record(run.records);
        free(run.w);
        free(run.v);
        run.w = run.v = NULL;
        go(&run, "Luenberger");
        result = golden_run_verdict(&run);
    } else {
        result = GOLDEN_FAIL;
    }
    free(A);
    free(L);
    free(D);
    golden_run_free(&run);
    return result;
}

int golden_discrete_network(const json_t *root)
{
    int count, worst = GOLDEN_PASS;
    double *A = golden_numbers(json_object_get(root, "A_list"), &count);
    const struct listed_plant plant = {A, count / (NX * NX)};
    const char *name;
    const json_t *records;
    json_t *runs = json_object_get(root, "runs");
    json_object_foreach(runs, name, records)
    {
        const int result = run_filter(root, &plant, name, records);
        worst = result != GOLDEN_PASS ? result : worst;
    }
    const int result = run_luenberger(root, json_object_get(root, "luenberger_lti"));
    free(A);
    return json_object_size(runs) == 0 || result != GOLDEN_PASS ? GOLDEN_FAIL : worst;
}
