/* Recorded runs: the measurements are fed to a network, its estimates compared after each sample.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../../unit/second_order_network.h"
#include "dse/quadratic.h"
#include "parts.h"

struct setting {
    int nx, ny, nodes;
    double Ts;
    double A[NETWORK_NX * NETWORK_NX], d[NETWORK_NX];
    double R[NETWORK_NY * NETWORK_NY], S0[NETWORK_NX * NETWORK_NX], Q[NETWORK_NX * NETWORK_NX];
    struct dse_quadratic_term term[DSE_QUADRATIC_MAX_TERMS(NETWORK_NX)];
    struct dse_quadratic system;
    struct dse_model model;
    struct second_order_network network;
};

/* The numbers of object[key] into `out`, at most `capacity`; how many there are, -1: too many. */
static int read_numbers(const json_t *object, const char *key, int capacity, double *out)
{
    int count = 0;
    double *numbers = golden_numbers(json_object_get(object, key), &count);
    if (count <= capacity)
        memcpy(out, numbers, (size_t)count * sizeof *out);
    free(numbers);
    return count <= capacity ? count : -1;
}

static int read_terms(struct setting *s, const json_t *root)
{
    double flat[4 * DSE_QUADRATIC_MAX_TERMS(NETWORK_NX)];
    const int count = read_numbers(root, "terms", 4 * DSE_QUADRATIC_MAX_TERMS(NETWORK_NX), flat);
    for (int q = 0; q + 3 < count; q += 4)
        s->term[q / 4] = (struct dse_quadratic_term){(int)flat[q], (int)flat[q + 1],
                                                     (int)flat[q + 2], flat[q + 3]};
    return count < 0 ? -1 : count / 4;
}

static int read_setting(struct setting *s, const json_t *root)
{
    struct second_order_network *network = &s->network;
    double links[NETWORK_NODES * NETWORK_NODES] = {0}, C[NETWORK_NODES * NETWORK_NY * NETWORK_NX];
    double w0[NETWORK_NODES * NETWORK_NX];
    s->nodes = network->nodes = (int)json_array_size(json_object_get(root, "w0"));
    s->nx = read_numbers(root, "d", NETWORK_NX, s->d);
    s->ny = (int)json_array_size(json_object_get(root, "R"));
    const int terms = read_terms(s, root);
    const int nx = s->nx, ny = s->ny, nodes = s->nodes;
    if (nx < 1 || ny < 1 || ny > NETWORK_NY || nodes < 1 || nodes > NETWORK_NODES || terms < 0 ||
        read_numbers(root, "A", NETWORK_NX * NETWORK_NX, s->A) != nx * nx ||
        read_numbers(root, "R", NETWORK_NY * NETWORK_NY, s->R) != ny * ny ||
        read_numbers(root, "S0", NETWORK_NX * NETWORK_NX, s->S0) != nx * nx ||
        read_numbers(root, "adjacency", NETWORK_NODES * NETWORK_NODES, links) != nodes * nodes ||
        read_numbers(root, "C", NETWORK_NODES * NETWORK_NY * NETWORK_NX, C) != nodes * ny * nx ||
        read_numbers(root, "w0", NETWORK_NODES * NETWORK_NX, w0) != nodes * nx)
        return GOLDEN_FAIL;
    s->Ts = golden_number(root, "Ts", 1);
    for (int i = 0; i < nodes; i++) {
        for (int j = 0; j < nodes; j++)
            network->hears[i][j] = links[i * nodes + j] > 0;
        memcpy(network->C[i], C + i * ny * nx, (size_t)(ny * nx) * sizeof *C);
        memcpy(network->w0[i], w0 + i * nx, (size_t)nx * sizeof *w0);
    }
    s->system = (struct dse_quadratic){.A = s->A, .d = s->d, .terms = terms, .term = s->term};
    dse_quadratic_model(&s->model, nx, 0, 0, &s->system);
    return GOLDEN_PASS;
}

static int read_case(struct setting *s, const json_t *entry, int substeps)
{
    static const struct {
        const char *name;
        enum dse_dso_scheme scheme;
        enum dse_dso_memory memory;
        enum dse_second_order_kind kind;
    } algorithms[] = {
        {"local", DSE_DSO_ALONE, 0, DSE_SECOND_ORDER},
        {"local_ekf", DSE_DSO_ALONE, 0, DSE_SECOND_ORDER_EXTENDED},
        {"A-I_literal", DSE_DSO_A_LITERAL, 0, DSE_SECOND_ORDER},
        {"A-I_star", DSE_DSO_A_INFORMATION, DSE_DSO_PERSISTENT, DSE_SECOND_ORDER},
        {"A-II_persistent", DSE_DSO_A_COVARIANCE, DSE_DSO_PERSISTENT, DSE_SECOND_ORDER},
        {"A-II_restart", DSE_DSO_A_COVARIANCE, DSE_DSO_RESTART, DSE_SECOND_ORDER},
        {"A-II_average", DSE_DSO_A_COVARIANCE, DSE_DSO_AVERAGE, DSE_SECOND_ORDER},
        {"B-I", DSE_DSO_B, 0, DSE_SECOND_ORDER},
        {"C-I", DSE_DSO_C, 0, DSE_SECOND_ORDER},
        {"B-I_inf", DSE_DSO_B_INFORMATION, 0, DSE_SECOND_ORDER},
        {"C-I_inf", DSE_DSO_C_INFORMATION, 0, DSE_SECOND_ORDER},
        {"B-I_sums_literal", DSE_DSO_B_LITERAL, 0, DSE_SECOND_ORDER},
        {"C-I_sums_literal", DSE_DSO_C_LITERAL, 0, DSE_SECOND_ORDER},
    };
    const json_t *params = json_object_get(entry, "params");
    const double weight = golden_number(params, "eps", 0);
    for (size_t a = 0; a < sizeof algorithms / sizeof algorithms[0]; a++) {
        if (!golden_is(entry, "algorithm", algorithms[a].name))
            continue;
        s->network.base = (struct dse_dso_config){
            .filter = {.model = &s->model,
                       .ny = s->ny,
                       .kind = algorithms[a].kind,
                       .S0 = s->S0,
                       .R = s->R,
                       .substeps = substeps},
            .scheme = algorithms[a].scheme,
            .memory = algorithms[a].memory,
            .delta = weight,
            .epsilon = weight,
            .alpha = golden_number(params, "alpha", 0),
            .rounds = (int)golden_number(params, "ncons", 0),
            .normalised = json_is_true(json_object_get(params, "normalise")),
        };
        if (read_numbers(params, "Q", NETWORK_NX * NETWORK_NX, s->Q) == s->nx * s->nx)
            s->network.base.filter.Q = s->Q;
        return network_make(&s->network) == DSE_OK ? GOLDEN_PASS : GOLDEN_FAIL;
    }
    return GOLDEN_UNSUPPORTED;
}

/* Largest deviation of a vector or matrix from a reference, relative to the largest entry there. */
static double deviation(int count, const double *got, const double *want)
{
    double worst = 0, size = 0;
    for (int i = 0; i < count; i++) {
        worst = fmax(worst, isfinite(got[i]) ? fabs(got[i] - want[i]) : INFINITY);
        size = fmax(size, fabs(want[i]));
    }
    return worst / size;
}

static void disturb(struct setting *s, const json_t *entry, int k)
{
    int count = 0;
    double *mask = golden_numbers(json_object_get(entry, "link_mask"), &count);
    const int nodes = s->nodes, first = k * nodes * nodes;
    for (int i = 0; i < nodes; i++)
        for (int j = 0; j < nodes; j++)
            s->network.lost[i][j] =
                first + nodes * nodes <= count && mask[first + i * nodes + j] == 0;
    free(mask);
    s->network.off[nodes - 1] = k >= golden_number(entry, "off_from", INFINITY);
}

static double compare_node(const struct setting *s, int i, const double *xhat, const double *Sigma,
                           const double *variance)
{
    const int nx = s->nx;
    const struct dse_dso *node = &s->network.node[i];
    double worst = deviation(nx, dse_dso_state(node), xhat);
    if (Sigma != NULL)
        worst = fmax(worst, deviation(nx * nx, dse_dso_covariance(node), Sigma));
    double diagonal[NETWORK_NX];
    for (int l = 0; l < nx; l++)
        diagonal[l] = dse_dso_covariance(node)[l * nx + l];
    if (variance != NULL)
        worst = fmax(worst, deviation(nx, diagonal, variance));
    return worst;
}

static int run_case(struct setting *s, const json_t *entry, int substeps)
{
    const int nx = s->nx, ny = s->ny, nodes = s->nodes;
    int count = 0, n_xhat = 0, n_S = 0, n_variance = 0;
    int result = read_case(s, entry, substeps);
    double *m = golden_numbers(json_object_get(entry, "m"), &count);
    double *xhat = golden_numbers(json_object_get(entry, "xhat"), &n_xhat);
    double *Sigma = golden_numbers(json_object_get(entry, "Sigma"), &n_S);
    double *variance = golden_numbers(json_object_get(entry, "variance"), &n_variance);
    const int samples = count / (nodes * ny);
    double worst = 0;
    if (samples < 1 || n_xhat != samples * nodes * nx)
        result = GOLDEN_FAIL;
    for (int k = 0; result == GOLDEN_PASS && k < samples; k++) {
        disturb(s, entry, k);
        if (network_sample(&s->network, s->Ts * (k + 1), m + k * nodes * ny) != DSE_OK)
            result = GOLDEN_FAIL;
        for (int i = 0; i < nodes; i++) {
            const int at = k * nodes + i;
            worst = fmax(worst,
                         compare_node(s, i, xhat + at * nx, n_S > 0 ? Sigma + at * nx * nx : NULL,
                                      n_variance > 0 ? variance + at * nx : NULL));
        }
    }
    const double tolerance = fmax(1e-6, golden_number(entry, "sensitivity", 0));
    if (!(worst <= tolerance))
        result = GOLDEN_FAIL;
    const char *name = json_string_value(json_object_get(entry, "name"));
    printf("  %-18s %-18s %s %3d samples  deviation %9.2e  tolerance %7.1e  %s\n",
           json_string_value(json_object_get(entry, "algorithm")), name != NULL ? name : "",
           substeps > 0 ? "fixed   " : "adaptive", samples, worst, tolerance,
           result == GOLDEN_PASS ? "ok" : "FAILED");
    free(m);
    free(xhat);
    free(Sigma);
    free(variance);
    return result;
}

/* Every case with the steps of the reference and with adaptive ones. */
int golden_second_order_network(const json_t *root)
{
    static struct setting setting;
    const json_t *cases = json_object_get(root, "cases");
    if (read_setting(&setting, root) != GOLDEN_PASS)
        return GOLDEN_FAIL;
    int result = GOLDEN_PASS;
    for (size_t c = 0; c < json_array_size(cases); c++) {
        const json_t *entry = json_array_get(cases, c);
        const int substeps = (int)golden_number(root, "substeps", 100);
        if (run_case(&setting, entry, substeps) != GOLDEN_PASS ||
            run_case(&setting, entry, 0) != GOLDEN_PASS)
            result = GOLDEN_FAIL;
    }
    return result;
}
