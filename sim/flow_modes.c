/* Modes, projections and sensors of the flow benchmark. */
#include "sim/flow_modes.h"

#include <stdlib.h>
#include <string.h>

enum {
    N = SIM_FLOW_CELLS,
    PSI = SIM_FLOW_PSI(N),
    FACES = SIM_FLOW_FACES(N),
    SCALAR = SIM_FLOW_SCALAR(N),
    STATE = SIM_FLOW_STATE(N),
    VELOCITIES = 4,
    CONTAMINANTS = 3,
    SENSORS = 4
};

static const int cells[SENSORS][2] = {{9, 9}, {22, 9}, {22, 22}, {9, 22}};

struct sim_flow_plant {
    struct sim_flow *flow;
    double z[STATE];
    double w[FACES]; /* the velocity of z */
    /* As states: a velocity mode has a stream function only, the others one scalar only. */
    double mode[SIM_FLOW_MODES][STATE];
    double velocity[VELOCITIES][FACES];
};

/* The part of a state that mode k is of. */
static void part(int k, int *first, int *count)
{
    *first = k < VELOCITIES ? 0 : k < VELOCITIES + CONTAMINANTS ? PSI : PSI + SCALAR;
    *count = k < VELOCITIES ? PSI : SCALAR;
}

/* mode_k = sum_s weight_ks snapshot_s */
static void make_modes(struct sim_flow_plant *plant, bool forced)
{
    const double(*weights)[SIM_FLOW_ALL_SNAPSHOTS] =
        forced ? sim_flow_weights_forced : sim_flow_weights_free;
    const int steps = 10; /* SIM_FLOW_PERIOD / SIM_FLOW_DT */
    for (int s = 0; s < SIM_FLOW_ALL_SNAPSHOTS; s++) {
        if (s % SIM_FLOW_SNAPSHOTS == 0)
            sim_flow_start(N, 1 + s / SIM_FLOW_SNAPSHOTS, plant->z);
        else
            for (int i = 0; i < steps; i++)
                sim_flow_step(plant->flow, SIM_FLOW_DT, plant->z);
        for (int k = 0; k < SIM_FLOW_MODES; k++) {
            int first, count;
            part(k, &first, &count);
            for (int i = first; i < first + count; i++)
                plant->mode[k][i] += weights[k][s] * plant->z[i];
        }
    }
    for (int k = 0; k < VELOCITIES; k++)
        sim_flow_velocity(N, plant->mode[k], plant->velocity[k]);
}

struct sim_flow_plant *sim_flow_plant_create(const char *name, int run)
{
    const bool forced = strcmp(name, "cavity_forced") == 0;
    if ((!forced && strcmp(name, "cavity_free") != 0) || run < 0 || run >= SIM_FLOW_RUNS)
        return NULL;
    struct sim_flow_plant *plant = calloc(1, sizeof *plant);
    if (plant == NULL || (plant->flow = sim_flow_create(N, forced)) == NULL) {
        free(plant);
        return NULL;
    }
    make_modes(plant, forced);
    sim_flow_start(N, run, plant->z);
    sim_flow_velocity(N, plant->z, plant->w);
    return plant;
}

void sim_flow_plant_destroy(struct sim_flow_plant *plant)
{
    if (plant == NULL)
        return;
    sim_flow_destroy(plant->flow);
    free(plant);
}

void sim_flow_plant_advance(struct sim_flow_plant *plant, double period)
{
    int steps = (int)(period / SIM_FLOW_DT + 0.999999);
    steps = steps < 1 ? 1 : steps;
    for (int s = 0; s < steps; s++)
        sim_flow_step(plant->flow, period / steps, plant->z);
    sim_flow_velocity(N, plant->z, plant->w);
}

/* h^2 times the dot product. */
static double product(int count, const double *a, const double *b)
{
    double sum = 0;
    for (int i = 0; i < count; i++)
        sum += a[i] * b[i];
    return sum / (N * N);
}

void sim_flow_plant_state(const struct sim_flow_plant *plant, double *x)
{
    for (int k = 0; k < SIM_FLOW_MODES; k++) {
        int first, count;
        part(k, &first, &count);
        x[k] = k < VELOCITIES ? product(FACES, plant->velocity[k], plant->w)
                              : product(count, plant->mode[k] + first, plant->z + first);
    }
}

void sim_flow_plant_outputs(const struct sim_flow_plant *plant, double *y)
{
    const double *u = plant->w, *v = plant->w + N * (N + 1);
    for (int s = 0; s < SENSORS; s++) {
        const int i = cells[s][0], j = cells[s][1];
        y[3 * s] =
            (u[i * N + j] + u[(i + 1) * N + j] + v[i * (N + 1) + j] + v[i * (N + 1) + j + 1]) / 2;
        y[3 * s + 1] = plant->z[PSI + i * N + j];
        y[3 * s + 2] = plant->z[PSI + SCALAR + i * N + j];
    }
}
