/* golden_distributed_observer FILE.json ...
 *
 * Repeats the reference's runs of unknown-input and functional observers, the plant and all nodes
 * integrated as one system, and compares states, estimates, adaptive gains and the norm
 *
 *     ||e||_2 = sqrt( int_0^T sum_i e_i'e_i dt ),  e_i = xh_i - x (or zh_i - L x), trapezoidal
 *
 * Exit code 0: all within their tolerance; 1: some are not, or a file cannot be read; 2: the layout
 * is not supported. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "distributed_observer/parts.h"
#include "golden.h"

/* Relative to the size of what is compared, or 1: what the reference promises. */
#define TOLERANCE 1e-6

static struct rig rig;
static struct matrices store[RIG_NODES];

struct deviations {
    double plant, z, estimate, gain, norm, energy;
};

static void compare(double got, double want, double *worst)
{
    const double d = fabs(got - want) / fmax(1, fabs(want));
    if (!(d <= *worst)) /* NaN counts as worst */
        *worst = d;
}

static void compare_all(int n, const double *got, const double *want, double *worst)
{
    for (int i = 0; i < n; i++)
        compare(got[i], want[i], worst);
}

/* e_i of node i now. */
static int error_of(int i, const double *functional, double *e)
{
    double x[RIG_STATES], u[RIG_OUTPUTS];
    rig_truth(&rig, x, u);
    rig_estimate(&rig, i, e);
    if (functional == NULL) {
        for (int k = 0; k < rig.plant->nx; k++)
            e[k] -= x[k];
        return rig.plant->nx;
    }
    for (int k = 0; k < rig.plant->nx; k++)
        e[0] -= functional[k] * x[k];
    return 1;
}

static double squares(const double *functional)
{
    double sum = 0, e[RIG_STATES];
    for (int i = 0; i < rig.n; i++) {
        const int n = error_of(i, functional, e);
        for (int k = 0; k < n; k++)
            sum += e[k] * e[k];
    }
    return sum;
}

/* e'Pi e per node, for observers whose own state has the error e. */
static void compare_energy(const double *want, int count, double *worst)
{
    for (int i = 0; i < count; i++) {
        double e[RIG_STATES], V = 0;
        const int n = error_of(i, NULL, e);
        for (int k = 0; k < n * n; k++)
            V += e[k / n] * rig.config[i].Pi[k] * e[k % n];
        compare(V, want[i], worst);
    }
}

static void compare_record(const json_t *record, struct deviations *d)
{
    double x[RIG_STATES], u[RIG_OUTPUTS], xh[RIG_STATES];
    int sizes[5];
    double *want[5];
    static const char *const keys[5][2] = {
        {"x", "x"}, {"z", "zeta"}, {"xhat", "zhat"}, {"Gamma_flat", "Gamma_flat"}, {"ePe", "ePe"}};
    for (int k = 0; k < 5; k++) {
        const json_t *list = json_object_get(record, keys[k][0]);
        if (list == NULL)
            list = json_object_get(record, keys[k][1]);
        want[k] = golden_numbers(list, &sizes[k]);
    }
    rig_truth(&rig, x, u);
    compare_all(sizes[0], x, want[0], &d->plant);
    int z = 0, at = 0, gain = 0;
    for (int i = 0; i < rig.n; i++) {
        const int nz = rig.config[i].nz, nx = rig.config[i].nx, n_gain = rig.node[i].n_gain;
        if (sizes[1] > 0)
            compare_all(nz, rig_node(&rig, i), want[1] + z, &d->z);
        rig_estimate(&rig, i, xh);
        compare_all(nx, xh, want[2] + at, &d->estimate);
        if (sizes[3] > 0)
            compare_all(n_gain, rig_node(&rig, i) + nz, want[3] + gain, &d->gain);
        z += nz;
        at += nx;
        gain += n_gain;
    }
    if (at != sizes[2] || (sizes[3] > 0 && gain != sizes[3]))
        d->estimate = INFINITY; /* the file has another number of values */
    compare_energy(want[4], sizes[4], &d->energy);
    for (int k = 0; k < 5; k++)
        free(want[k]);
}

static int report(const char *name, const struct deviations *d)
{
    const double worst =
        fmax(fmax(fmax(d->plant, d->z), fmax(d->estimate, d->gain)), fmax(d->norm, d->energy));
    const int pass = isfinite(worst) && worst <= TOLERANCE;
    printf("  %-26s plant %7.1e  z %7.1e  estimate %7.1e  gain %7.1e  e'Pi e %7.1e  L2 %7.1e  %s\n",
           name, d->plant, d->z, d->estimate, d->gain, d->energy, d->norm, pass ? "ok" : "FAILED");
    return pass ? GOLDEN_PASS : GOLDEN_FAIL;
}

static int check_run(const json_t *root, const char *name, const json_t *run)
{
    const json_t *records = json_object_get(run, "records");
    const double h = golden_number(root, "h", 0);
    const int steps = (int)lround(golden_number(root, "T", 0) / h);
    const double *functional;
    struct deviations d = {0};
    int count;
    if (!make_network(&rig, store, root, run, &functional))
        return GOLDEN_UNSUPPORTED;
    double *x0 = golden_numbers(json_object_get(json_array_get(records, 0), "x"), &count);
    const enum dse_status started = rig_start(&rig, x0);
    free(x0);
    if (started != DSE_OK)
        return GOLDEN_FAIL;
    double sum = 0;
    size_t next = 0;
    for (int k = 0; k <= steps; k++) {
        const json_t *record = json_array_get(records, next);
        if (record != NULL && lround(golden_number(record, "t", -1) / h) == k) {
            compare_record(record, &d);
            next++;
        }
        sum += (k == 0 || k == steps ? 0.5 : 1) * h * squares(functional);
        if (k < steps && rig_step(&rig, h) != DSE_OK)
            return GOLDEN_FAIL;
        rig.t = rig.t0 = (k + 1) * h; /* as the reference counts time */
    }
    if (next != json_array_size(records))
        d.plant = INFINITY;
    compare(sqrt(sum), golden_number(run, "L2", NAN), &d.norm);
    return report(name, &d);
}

static int check_file(const json_t *root)
{
    json_t *runs = json_object_get(root, "runs"), *run;
    const char *name;
    int worst = json_object_size(runs) > 0 ? GOLDEN_PASS : GOLDEN_UNSUPPORTED;
    json_object_foreach(runs, name, run)
    {
        const int result = check_run(root, name, run);
        if (result != GOLDEN_PASS && worst != GOLDEN_FAIL)
            worst = result;
    }
    return worst;
}

int main(int argc, char **argv)
{
    return golden_main(argc, argv, check_file);
}
