/* The library's filter. */
#include <stddef.h>

#include "bench_ekf.h"
#include "dse/ekf.h"

static dse_real memory[DSE_EKF_STORAGE(BENCH_NX_MAX, BENCH_NY_MAX)];
static struct dse_ekf_config config;
static struct dse_ekf ekf;

static void start(const struct problem *problem)
{
    struct dse_arena arena;
    dse_arena_init(&arena, memory, (int)(sizeof memory / sizeof memory[0]));
    config = (struct dse_ekf_config){
        .model = &problem->model, .P0 = problem->P0, .Q = problem->Q, .R = problem->R};
    (void)dse_ekf_init(&ekf, &config, &arena);
}

static int step(dse_real t, const dse_real *y)
{
    const struct dse_measurement measurement = {y, NULL};
    if (dse_ekf_predict(&ekf, t, NULL) != DSE_OK)
        return 1;
    return dse_ekf_update(&ekf, t, NULL, &measurement) != DSE_OK;
}

static void read(dse_real *x, dse_real *P)
{
    for (int i = 0; i < ekf.nx; i++)
        x[i] = dse_ekf_state(&ekf)[i];
    dse_ekf_covariance(&ekf, P);
}

const struct contender bench_ekf_dse[1] = {{"dse", 0, 0, start, step, read}};
