/* Reading a reference run and comparing with it. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "parts.h"

static double *numbers(const json_t *root, const char *key, int *count)
{
    const json_t *array = json_object_get(root, key);
    *count = 0;
    return json_is_array(array) ? golden_numbers(array, count) : NULL;
}

/* Copies object[key] (count numbers) to x; false when it has another size. */
static bool fetch(const json_t *root, const char *key, int count, double *x)
{
    int found;
    double *all = numbers(root, key, &found);
    if (found == count)
        memcpy(x, all, (size_t)count * sizeof *x);
    else
        printf("  '%s' has %d numbers, %d expected\n", key, found, count);
    free(all);
    return found == count;
}

static bool fetch_nodes(const json_t *root, struct kalman_network *network)
{
    double types[NETWORK_NODES], R[NETWORK_NODES], starts[NETWORK_NODES * NX];
    const char *guess = json_object_get(root, "xhat0") != NULL ? "xhat0" : "xbar0";
    const char *noise = json_object_get(root, "Rd") != NULL ? "Rd" : "R";
    const int n = network->nodes;
    if (!fetch(root, guess, n * NX, starts))
        return false;
    for (int i = 0; i < n; i++)
        memcpy(network->x0[i], starts + NX * i, sizeof(double) * NX);
    if (json_object_get(root, noise) != NULL) {
        if (!fetch(root, noise, n, R))
            return false;
        for (int i = 0; i < n; i++)
            network->R[i][0] = R[i];
    }
    if (json_object_get(root, "sensor_type") == NULL)
        return true; /* sensors come with a design */
    if (!fetch(root, "sensor_type", n, types))
        return false;
    for (int i = 0; i < n; i++)
        network_sense(network, i, (int)types[i]);
    return true;
}

int golden_run_load(const json_t *root, struct golden_run *run, struct kalman_network *network)
{
    const json_t *guess = json_object_get(root, "xhat0");
    if (guess == NULL)
        guess = json_object_get(root, "xbar0");
    int n_w;
    *run = (struct golden_run){.nodes = (int)json_array_size(guess),
                               .h = golden_number(root, "h", 0),
                               .worst = GOLDEN_PASS};
    if (run->nodes < 1 || run->nodes > NETWORK_NODES || !(run->h > 0))
        return GOLDEN_UNSUPPORTED;
    *network = (struct kalman_network){.nodes = run->nodes, .model = swinging_plant()};
    network->base.period = run->h;
    network->base.sensor.ny = 1;
    if (!fetch(root, "x0", NX, run->x) || !fetch_nodes(root, network))
        return GOLDEN_FAIL;
    run->w = numbers(root, "w", &n_w);
    run->v = numbers(root, "v", &run->n_v);
    run->n_v /= run->nodes;
    const int noises = n_w / NX;
    run->steps = (int)golden_number(root, "nsteps", noises);
    const bool enough = run->w == NULL || (n_w >= NX * run->steps && run->n_v >= run->steps);
    return run->steps > 0 && enough ? GOLDEN_PASS : GOLDEN_FAIL;
}

int golden_run_verdict(const struct golden_run *run)
{
    return run->compared > 0 ? run->worst : GOLDEN_FAIL;
}

void golden_run_free(struct golden_run *run)
{
    free(run->w);
    free(run->v);
}

enum dse_status golden_run_make(const json_t *root, struct kalman_network *network)
{
    static int pairs[2 * NETWORK_EDGES];
    int count;
    double *ends = numbers(root, "edges", &count);
    for (int k = 0; k < count && k < 2 * NETWORK_EDGES; k++)
        pairs[k] = (int)ends[k];
    free(ends);
    return count / 2 <= NETWORK_EDGES ? network_make(network, count / 2, pairs, false)
                                      : DSE_ESTORAGE;
}

void golden_run_measure(const struct golden_run *run, const struct kalman_network *network, int k,
                        double *y)
{
    for (int i = 0; i < run->nodes; i++) {
        y[i] = dse_dot(NX, network->C[i], run->x);
        if (run->v != NULL && k < run->n_v)
            y[i] += run->v[i * run->n_v + k];
    }
}

const json_t *golden_run_record(const struct golden_run *run, int k)
{
    for (size_t r = 0; r < json_array_size(run->records); r++) {
        const json_t *record = json_array_get(run->records, r);
        if ((int)golden_number(record, "k", -1) == k)
            return record;
    }
    return NULL;
}

/* Absolute deviation over the largest number: states and gains pass through zero. */
static void judge(struct golden_run *run, int k, const char *name, const char *key, int count,
                  const double *got)
{
    const json_t *want_json = json_object_get(golden_run_record(run, k), key);
    if (!json_is_array(want_json))
        return;
    int found;
    double *want = golden_numbers(want_json, &found), largest = 0, deviation = 0;
    bool finite = found == count;
    for (int c = 0; finite && c < count; c++) {
        finite = isfinite(got[c]) && isfinite(want[c]);
        largest = fmax(largest, fabs(want[c]));
        deviation = fmax(deviation, fabs(got[c] - want[c]));
    }
    free(want);
    run->compared++;
    const bool pass = finite && deviation <= GOLDEN_STATES * fmax(largest, 1e-12);
    if (!pass || k == run->steps)
        printf("  %-28s k %4d  %4d numbers  deviation %9.2e of %9.2e  %s\n", name, k, count,
               deviation, largest, pass ? "ok" : "FAILED");
    if (!pass)
        run->worst = GOLDEN_FAIL;
}

void golden_run_compare(struct golden_run *run, const struct kalman_network *network, int k,
                        const char *name, const char *key, golden_of_node of_node, int per_node)
{
    static double got[NETWORK_NODES * NETWORK_NX * NETWORK_NX];
    for (int i = 0; i < run->nodes; i++) {
        const dse_real *values = of_node(&network->node[i]);
        for (int c = 0; c < per_node; c++)
            got[i * per_node + c] = values != NULL ? values[c] : NAN;
    }
    judge(run, k, name, key, run->nodes * per_node, got);
}

void golden_run_compare_gains(struct golden_run *run, const struct kalman_network *network, int k,
                              const char *name)
{
    static double got[NETWORK_EDGES];
    int count = 0;
    for (int i = 0; i < run->nodes; i++) {
        const dse_real *gain;
        for (int j = 0; (gain = dse_dkf_gain(&network->node[i], j)) != NULL; j++)
            got[count++] = gain[0];
    }
    if (count > 0)
        judge(run, k, name, "Gamma", count, got);
}

void golden_run_compare_plant(struct golden_run *run, int k, const char *name)
{
    judge(run, k, name, "x", NX, run->x);
}
