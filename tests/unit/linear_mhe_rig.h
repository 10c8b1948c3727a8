/* Random linear systems, runs of them, and the estimator on such a run; the Kalman filter beside
 * it.
 */
#ifndef LINEAR_MHE_RIG_H
#define LINEAR_MHE_RIG_H

#include <math.h>
#include <stdbool.h>

#include "dense_filter.h"
#include "dse/kalman.h"
#include "dse/linalg.h"
#include "dse/linear_mhe.h"
#include "dse/math.h"
#include "near.h"
#include "random_matrix.h"

#define NX_MAX 8
#define NY_MAX 3
#define N_MAX  8
#define STEPS  24
#define EPS    DSE_REAL_EPSILON
/* Agreement with the Kalman filter and with dense references: 1e-9 in double precision. */
#define AGREEMENT DSE_REAL(4.6e6 * (double)DSE_REAL_EPSILON)
/* What a correct solution is certified with. */
#define TIGHT (1000 * EPS)

static dse_real memory[DSE_LINEAR_MHE_STORAGE(NX_MAX, NY_MAX, N_MAX)];
static dse_real kalman_memory[DSE_KALMAN_STORAGE(NX_MAX, NY_MAX)];

/* 0 .. n - 1. */
static inline int choose(int n)
{
    const int k = (int)((0.5 + 0.5 * (double)uniform()) * n);
    return k < n ? k : n - 1;
}

static inline void fill_by(int n, int count, dse_real scale, dse_real *M)
{
    fill_scaled(n, count, M);
    for (int i = 0; i < count; i++)
        M[i] *= scale;
}

/* M = G' G / 4 + floor I with G rank x n. */
static inline void fill_semidefinite(int n, int rank, dse_real floor, dse_real *M)
{
    dse_real G[NX_MAX * NX_MAX];
    fill_by(n, rank * n, 1, G);
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++) {
            M[i * n + j] = i == j ? floor : 0;
            for (int p = 0; p < rank; p++)
                M[i * n + j] += G[p * n + i] * G[p * n + j];
        }
    }
}

struct system {
    int nx, ny;
    dse_real A[NX_MAX * NX_MAX], B[NX_MAX], C[NY_MAX * NX_MAX], D[NY_MAX];
    dse_real Q[NX_MAX * NX_MAX], R[NY_MAX * NY_MAX], P0[NX_MAX * NX_MAX], x0[NX_MAX];
};

/* scale 1: mostly stable, 2: mostly unstable. */
static inline void random_system(struct system *s, int nx, int ny, int noise_rank, int prior_rank,
                                 dse_real scale)
{
    *s = (struct system){.nx = nx, .ny = ny};
    fill_by(nx, nx * nx, scale, s->A);
    fill_by(1, nx, 1, s->B);
    fill_by(1, ny * nx, 1, s->C);
    fill_by(1, ny, 1, s->D);
    fill_semidefinite(nx, noise_rank, noise_rank == nx ? DSE_REAL(0.01) : 0, s->Q);
    fill_semidefinite(ny, ny, DSE_REAL(0.1), s->R);
    fill_semidefinite(nx, prior_rank, prior_rank == nx ? 1 : 0, s->P0);
    fill_by(1, nx, 1, s->x0);
}

static inline struct dse_linear_mhe_config config_of(const struct system *s, int N,
                                                     enum dse_arrival arrival)
{
    return (struct dse_linear_mhe_config){.nx = s->nx,
                                          .nu = 1,
                                          .ny = s->ny,
                                          .linear = {s->A, s->B, s->C, s->D},
                                          .horizon = N,
                                          .arrival = arrival,
                                          .x0 = s->x0,
                                          .P0 = s->P0,
                                          .Q = s->Q,
                                          .R = s->R};
}

static inline enum dse_status start(struct dse_linear_mhe *mhe,
                                    const struct dse_linear_mhe_config *config)
{
    struct dse_arena arena;
    dse_arena_init(&arena, memory, (int)(sizeof memory / sizeof memory[0]));
    return dse_linear_mhe_init(mhe, config, &arena);
}

/* A run of data: of the system itself, with noises of about the right size. */
struct data {
    dse_real u[STEPS], y[STEPS][NY_MAX];
    bool valid[STEPS][NY_MAX];
};

static inline void simulate(const struct system *s, int dropouts_percent, struct data *data)
{
    dse_real x[NX_MAX], next[NX_MAX], v[NX_MAX], w[NX_MAX];
    for (int i = 0; i < s->nx; i++)
        x[i] = s->x0[i];
    for (int k = 0; k < STEPS; k++) {
        data->u[k] = uniform();
        for (int j = 0; j < s->ny; j++) {
            data->y[k][j] = s->D[j] * data->u[k] + uniform() / 2;
            for (int i = 0; i < s->nx; i++)
                data->y[k][j] += s->C[j * s->nx + i] * x[i];
            data->valid[k][j] = choose(100) >= dropouts_percent;
        }
        for (int i = 0; i < s->nx; i++)
            v[i] = uniform();
        dense_product(s->nx, s->nx, 1, s->Q, v, 0, w);
        dense_product(s->nx, s->nx, 1, s->A, x, 0, next);
        for (int i = 0; i < s->nx; i++)
            x[i] = next[i] + s->B[i] * data->u[k] + w[i];
    }
}

static inline struct dse_measurement sample_of(const struct data *data, int k)
{
    return (struct dse_measurement){data->y[k], data->valid[k]};
}

/* The Kalman filter's newest estimates of a run. */
struct filtered {
    dse_real x[STEPS][NX_MAX], P[STEPS][NX_MAX * NX_MAX];
};

static inline void filter(const struct system *s, const struct data *data, struct filtered *out)
{
    const struct dse_kalman_config config = {.nx = s->nx,
                                             .nu = 1,
                                             .ny = s->ny,
                                             .linear = {s->A, s->B, s->C, s->D},
                                             .x0 = s->x0,
                                             .P0 = s->P0,
                                             .Q = s->Q,
                                             .R = s->R};
    struct dse_kalman kalman;
    struct dse_arena arena;
    dse_arena_init(&arena, kalman_memory, (int)(sizeof kalman_memory / sizeof kalman_memory[0]));
    assert_int_equal(dse_kalman_init(&kalman, &config, &arena), DSE_OK);
    for (int k = 0; k < STEPS; k++) {
        const struct dse_measurement sample = sample_of(data, k);
        if (k > 0)
            assert_int_equal(dse_kalman_predict(&kalman, (dse_real)k, &data->u[k - 1]), DSE_OK);
        assert_int_equal(dse_kalman_update(&kalman, (dse_real)k, &data->u[k], &sample), DSE_OK);
        for (int i = 0; i < s->nx; i++)
            out->x[k][i] = dse_ekf_state(dse_kalman_ekf(&kalman))[i];
        dse_ekf_covariance(dse_kalman_ekf(&kalman), out->P[k]);
    }
}

/* One sample of a run, solved. */
static inline void step(struct dse_linear_mhe *mhe, const struct data *data, int k)
{
    const struct dse_measurement sample = sample_of(data, k);
    if (k > 0)
        assert_int_equal(dse_linear_mhe_advance(mhe, &data->u[k - 1]), DSE_OK);
    assert_int_equal(dse_linear_mhe_measure(mhe, 0, &data->u[k], &sample), DSE_OK);
    assert_int_equal(dse_linear_mhe_solve(mhe), DSE_OK);
    assert_true(dse_linear_mhe_sample(mhe) == k);
}

#endif
