/* The centralised estimator with bounds, hard and by a barrier: an agent alone with the plant. */
#include <math.h>
#include <stdlib.h>

#include "coordination.h"

struct whole {
    double C[PARTS * NX], Q[NX * NX], R[PARTS * PARTS];
    struct dse_mhe_subsystem subsystem;
    struct coordination_alone alone;
};

static int start(struct whole *whole, const struct network *w, double *const bounds[4],
                 double barrier)
{
    *whole = (struct whole){.C = {0}};
    for (int i = 0; i < w->parts; i++) {
        for (int a = 0; a < w->nx; a++)
            whole->C[i * w->n + i * w->nx + a] = w->C[a];
        for (int e = 0; e < w->nx * w->nx; e++)
            whole->Q[(i * w->nx + e / w->nx) * w->n + i * w->nx + e % w->nx] =
                w->Q[i * w->nx * w->nx + e];
        whole->R[i * w->parts + i] = w->R[i];
    }
    whole->subsystem = (struct dse_mhe_subsystem){.nx = w->n,
                                                  .ny = w->parts,
                                                  .A = w->A,
                                                  .C = whole->C,
                                                  .Q = whole->Q,
                                                  .R = whole->R,
                                                  .x0 = w->x0,
                                                  .x_min = bounds[0],
                                                  .x_max = bounds[1],
                                                  .w_min = bounds[2],
                                                  .w_max = bounds[3]};
    return coordination_alone_start(&whole->alone, w->net.settings.horizon,
                                    w->net.settings.min_horizon, barrier,
                                    &whole->subsystem) == DSE_OK
               ? GOLDEN_PASS
               : GOLDEN_FAIL;
}

/* The reference stacks by subsystem first, the window by time. */
static double deviation(const struct whole *whole, const struct network *w, const json_t *stack)
{
    const struct dse_mhe_local *local = &whole->alone.local;
    const int H = dse_mhe_local_length(local);
    int count;
    double *want = golden_numbers(stack, &count), worst = count == H * w->n ? 0 : INFINITY;
    for (int e = 0; e < count && count == H * w->n; e++) {
        const int i = e / (H * w->nx), t = e / w->nx % H, a = e % w->nx;
        worst = fmax(worst, fabs(want[e] - dse_mhe_local_window(local)[t * w->n + i * w->nx + a]));
    }
    free(want);
    return worst;
}

int compare_whole(const json_t *section, const char *name, const char *key, double *const bounds[4],
                  double barrier, double tolerance)
{
    const json_t *windows = json_object_get(section, "windows");
    struct network w;
    struct whole whole;
    int result = network_read(section, &w);
    double worst = 0;
    whole.alone.memory = NULL;
    if (result == GOLDEN_PASS)
        result = start(&whole, &w, bounds, barrier);
    long k = 0;
    for (size_t q = 0; q < json_array_size(windows) && result == GOLDEN_PASS; q++) {
        const json_t *record = json_array_get(windows, q);
        for (; k <= (long)golden_number(record, "k", 0); k++)
            coordination_alone_sample(&whole.alone, k, w.y + k * w.parts, NULL);
        worst = fmax(worst, deviation(&whole, &w, json_object_get(record, key)));
    }
    free(whole.alone.memory);
    network_free(&w);
    return result | report(name, worst, tolerance);
}
