/* golden_simulator FILE.json ...
 *
 * Compares the plant simulator with reference trajectories of reactor networks:
 *   plant_*cstr*.json   the trajectory, by CVODE with the default tolerances
 *   run_*.json          the plant state at the recorded ticks of a run without noise, by SIM_RK4
 * Exit code 0: all within tolerance; 1: some are not, or a file cannot be read; 2: a file asks for
 * something that the simulator does not support. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "golden.h"
#include "shipped_plant.h"
#include "sim/simulator.h"

#define TOLERANCE_TRAJECTORY 1e-7  /* of the reference data */
#define TOLERANCE_RUN        1e-12 /* the same formula in another language: rounding only */

/* States of a simulation at the wanted samples, row by row, against object["x"]. */
static int compare_states(const struct sim_config *config, const double *samples, int rows,
                          const json_t *object, double tolerance)
{
    char reason[512] = "";
    const int nx = config->plant->nx;
    struct simulator *sim = sim_create(config, reason, sizeof reason);
    double *got = calloc((size_t)rows * (size_t)nx + 1, sizeof *got);
    bool ok = sim != NULL && got != NULL && rows > 0;
    for (int r = 0; ok && r < rows; r++) {
        while (ok && (double)sim_sample(sim) < samples[r])
            ok = sim_step(sim, reason, sizeof reason);
        if (ok)
            memcpy(got + r * nx, sim_state(sim), (size_t)nx * sizeof *got);
    }
    if (!ok)
        printf("  nothing to compare: %s\n", reason);
    int result = ok ? golden_compare(object, "x", rows, nx, got, tolerance) : GOLDEN_FAIL;
    free(got);
    sim_destroy(sim);
    return result;
}

static struct sim_config config_of(const struct golden_plant *plant, const double *x0,
                                   double period, enum sim_integrator integrator)
{
    return (struct sim_config){.plant = plant->plant,
                               .prepared = plant->prepared,
                               .x0 = x0,
                               .u = plant->nominal_u,
                               .period = period,
                               .integrator = integrator};
}

/* The feed of a file without an equilibrium: F_0 = 10 (1 + 0.9 sin(0.008 t)), t in seconds. */
static const struct sim_drive varying_feed = {
    .signal = {.kind = SIM_SINUSOID, .value = 10, .amplitude = 9, .omega = 28.8}};

/* Every row of the trajectory is a sample: its times are equally spaced. */
static int trajectory(const json_t *root, const struct golden_plant *plant)
{
    const json_t *reference = json_object_get(root, "trajectory");
    int rows, n_x0, result = GOLDEN_FAIL;
    double *t = golden_numbers(json_object_get(reference, "t"), &rows);
    double *x0 = golden_numbers(json_object_get(reference, "x0"), &n_x0);
    double period = rows > 1 ? (t[rows - 1] - t[0]) / (rows - 1) : 0;
    bool fits = n_x0 == plant->plant->nx && period > 0;
    for (int r = 0; fits && r < rows; r++)
        fits = fabs(t[r] - r * period) <= 1e-12 * (1 + t[r]);
    if (fits) {
        for (int r = 0; r < rows; r++)
            t[r] = r;
        struct sim_config config = config_of(plant, x0, period, SIM_CVODE);
        config.drives = &varying_feed;
        config.n_drives = json_object_get(root, "steady_state") == NULL ? 1 : 0;
        result = compare_states(&config, t, rows, reference, TOLERANCE_TRAJECTORY);
    } else {
        printf("  the trajectory has another size or varying steps\n");
    }
    free(t);
    free(x0);
    return result;
}

static int run(const json_t *root, const struct golden_plant *plant)
{
    const json_t *record = json_object_get(root, "record");
    int rows, n_x0, result = GOLDEN_FAIL;
    double *k = golden_numbers(json_object_get(record, "k"), &rows);
    double *x0 = golden_numbers(json_object_get(root, "plant_x0"), &n_x0);
    if (n_x0 == plant->plant->nx) {
        const struct sim_config config = config_of(
            plant, x0, golden_number(json_object_get(root, "config"), "Ts_h", 0), SIM_RK4);
        result = compare_states(&config, k, rows, record, TOLERANCE_RUN);
    } else {
        printf("  plant_x0 has another size\n");
    }
    free(k);
    free(x0);
    return result;
}

/* The plant of a file by the reference's name; a plant file itself is known by its heat inputs. */
static const char *plant_name(const json_t *root)
{
    const char *model =
        json_string_value(json_object_get(json_object_get(root, "config"), "model"));
    if (model != NULL)
        return model;
    const json_t *heat = json_array_get(json_object_get(root, "Qh"), 0);
    if (golden_number(root, "n_reactors", 0) == 4)
        return "4cstr";
    if (golden_number(root, "n_reactors", 0) != 2)
        return NULL;
    return json_number_value(heat) > 1.6e4 ? "2cstr_ch2" : "2cstr_ch4";
}

static int check_root(const json_t *root)
{
    const bool is_run = json_object_get(root, "record") != NULL;
    if (is_run && !golden_is(root, "noise", "none")) {
        printf("  only runs without noise are supported\n");
        return GOLDEN_UNSUPPORTED;
    }
    struct golden_plant plant;
    int result = golden_plant_load(&plant, plant_name(root));
    if (result != GOLDEN_PASS)
        return result;
    result = is_run ? run(root, &plant) : trajectory(root, &plant);
    golden_plant_free(&plant);
    return result;
}

int main(int argc, char **argv)
{
    return golden_main(argc, argv, check_root);
}
