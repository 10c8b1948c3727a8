/* The linear moving horizon estimator against the Kalman filter and dense least squares. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

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
static int choose(int n)
{
    const int k = (int)((0.5 + 0.5 * (double)uniform()) * n);
    return k < n ? k : n - 1;
}

static void fill_by(int n, int count, dse_real scale, dse_real *M)
{
    fill_scaled(n, count, M);
    for (int i = 0; i < count; i++)
        M[i] *= scale;
}

/* M = G' G / 4 + floor I with G rank x n. */
static void fill_semidefinite(int n, int rank, dse_real floor, dse_real *M)
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
static void random_system(struct system *s, int nx, int ny, int noise_rank, int prior_rank,
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

static struct dse_linear_mhe_config config_of(const struct system *s, int N,
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

static enum dse_status start(struct dse_linear_mhe *mhe, const struct dse_linear_mhe_config *config)
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

static void simulate(const struct system *s, int dropouts_percent, struct data *data)
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

static struct dse_measurement sample_of(const struct data *data, int k)
{
    return (struct dse_measurement){data->y[k], data->valid[k]};
}

/* The Kalman filter's newest estimates of a run. */
struct filtered {
    dse_real x[STEPS][NX_MAX], P[STEPS][NX_MAX * NX_MAX];
};

static void filter(const struct system *s, const struct data *data, struct filtered *out)
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
static void step(struct dse_linear_mhe *mhe, const struct data *data, int k)
{
    const struct dse_measurement sample = sample_of(data, k);
    if (k > 0)
        assert_int_equal(dse_linear_mhe_advance(mhe, &data->u[k - 1]), DSE_OK);
    assert_int_equal(dse_linear_mhe_measure(mhe, 0, &data->u[k], &sample), DSE_OK);
    assert_int_equal(dse_linear_mhe_solve(mhe), DSE_OK);
    assert_true(dse_linear_mhe_sample(mhe) == k);
}

/* ---- the Kalman filter ---- */

static void equals_the_kalman_filter_on_a_thousand_random_systems(void **state)
{
    (void)state;
    random_state = 1;
    for (int trial = 0; trial < 1000; trial++) {
        const int nx = 1 + trial % NX_MAX, ny = 1 + choose(NY_MAX), N = 1 + choose(N_MAX);
        const int noise_rank = trial % 3 == 0 ? nx : choose(nx + 1);
        const int prior_rank = trial % 5 == 0 ? choose(nx + 1) : nx;
        struct system s;
        struct data data;
        struct filtered expected;
        struct dse_linear_mhe mhe;
        dse_real P[NX_MAX * NX_MAX];
        random_system(&s, nx, ny, noise_rank, prior_rank, trial % 2 ? 2 : 1);
        simulate(&s, trial % 4 == 0 ? 0 : 25, &data);
        filter(&s, &data, &expected);
        const struct dse_linear_mhe_config config = config_of(&s, N, DSE_ARRIVAL_KALMAN);
        assert_int_equal(start(&mhe, &config), DSE_OK);
        for (int k = 0; k < STEPS; k++) {
            step(&mhe, &data, k);
            assert_agree(nx, dse_linear_mhe_state(&mhe), expected.x[k], AGREEMENT);
            assert_int_equal(dse_linear_mhe_covariance(&mhe, P), DSE_OK);
            assert_agree(nx * nx, P, expected.P[k], AGREEMENT);
            assert_true(dse_linear_mhe_certificate(&mhe) < TIGHT);
        }
    }
}

/* Values come up to N - 1 samples late: as soon as all are there, the estimate is that of the
 * filter that had them in time. */
static void late_values_count_as_if_they_had_come_in_time(void **state)
{
    (void)state;
    enum { N = 5, LATE = N - 1 };
    random_state = 2;
    for (int nx = 1; nx <= NX_MAX; nx++) {
        struct system s;
        struct data data, delayed;
        struct filtered expected;
        struct dse_linear_mhe mhe;
        random_system(&s, nx, 2, nx / 2, nx, 1);
        simulate(&s, 10, &data);
        filter(&s, &data, &expected);
        delayed = data;
        for (int k = 0; k < STEPS - LATE; k++) /* channel 1 comes late, or with the others */
            delayed.valid[k][1] = delayed.valid[k][1] && k % 3 == 0;
        const struct dse_linear_mhe_config config = config_of(&s, N, DSE_ARRIVAL_KALMAN);
        assert_int_equal(start(&mhe, &config), DSE_OK);
        for (int k = 0; k < STEPS; k++) {
            step(&mhe, &delayed, k);
            if (k < LATE)
                continue;
            const bool only_late[2] = {false, data.valid[k - LATE][1]};
            const struct dse_measurement late = {data.y[k - LATE], only_late};
            assert_int_equal(dse_linear_mhe_measure(&mhe, LATE, &data.u[k - LATE], &late), DSE_OK);
        }
        assert_int_equal(dse_linear_mhe_solve(&mhe), DSE_OK);
        assert_agree(nx, dse_linear_mhe_state(&mhe), expected.x[STEPS - 1], AGREEMENT);
        assert_true(dse_linear_mhe_counts(&mhe)->late > 0);
    }
}

/* ---- dense least squares ---- */

#define UNKNOWNS (2 * N_MAX * NX_MAX)

/* The optimality system of a window as one dense matrix in states and multipliers. */
struct dense {
    int n; /* unknowns */
    dse_real M[UNKNOWNS * UNKNOWNS], v[UNKNOWNS];
};

/* C' R^-1 C and C' R^-1 (y - D u) of the channels that sample k has, at row and column `at`. */
static void dense_sample(const struct system *s, const struct data *data, int k, int at,
                         struct dense *dense)
{
    const int nx = s->nx, ny = s->ny;
    dse_real R[NY_MAX * NY_MAX] = {0}, inverse[NY_MAX * NY_MAX] = {0};
    for (int a = 0; a < ny; a++)
        for (int b = 0; b < ny; b++)
            R[a * ny + b] =
                data->valid[k][a] && data->valid[k][b] ? s->R[a * ny + b] : (dse_real)(a == b);
    dense_inverse(ny, R, inverse);
    for (int ab = 0; ab < ny * ny; ab++) {
        const int a = ab / ny, b = ab % ny;
        for (int i = 0; i < nx && data->valid[k][a] && data->valid[k][b]; i++) {
            const dse_real weight = s->C[a * nx + i] * inverse[ab];
            dense->v[at + i] += weight * (data->y[k][b] - s->D[b] * data->u[k]);
            for (int p = 0; p < nx; p++)
                dense->M[(at + i) * dense->n + at + p] += weight * s->C[b * nx + p];
        }
    }
}

/* The samples first .. first + H - 1, where Q and P need no inverse; LU with pivoting.
 * xbar NULL: no arrival cost. */
static void dense_window(const struct system *s, const struct data *data, int first, int H,
                         const dse_real *xbar, dse_real *x)
{
    static struct dense dense;
    int pivots[UNKNOWNS];
    const int nx = s->nx, half = H * nx, n = 2 * half;
    dense = (struct dense){.n = n};
    for (int j = 0; j < H; j++) {
        const int at = j * nx;
        dense_sample(s, data, first + j, at, &dense);
        for (int i = 0; i < nx; i++) {
            dse_real *dual = dense.M + (at + i) * n, *primal = dense.M + (half + at + i) * n;
            dual[half + at + i] = 1; /* .. - A' lambda_{j+1} + lambda_j = .. */
            for (int p = 0; p < nx && j + 1 < H; p++)
                dual[half + at + nx + p] = -s->A[p * nx + i];
            if (j == 0 && !xbar) { /* lambda_0 = 0 */
                primal[half + i] = 1;
                continue;
            }
            primal[at + i] = 1; /* x_j - A x_{j-1} - Q lambda_j = b, or xbar with P0 */
            for (int p = 0; p < nx; p++) {
                primal[half + at + p] = j > 0 ? -s->Q[i * nx + p] : -s->P0[i * nx + p];
                if (j > 0)
                    primal[at - nx + p] = -s->A[i * nx + p];
            }
            dense.v[half + at + i] = j > 0 ? s->B[i] * data->u[first + j - 1] : xbar[i];
        }
    }
    assert_int_equal(dse_lu(n, dense.M, pivots), DSE_OK);
    dse_lu_solve(n, dense.M, pivots, 1, dense.v);
    for (int i = 0; i < half; i++)
        x[i] = dense.v[i];
}

/* P0 is kept, so the dense reference of arrival CONSTANT needs only xbar. */
static void the_whole_window_equals_dense_least_squares(void **state)
{
    (void)state;
    random_state = 3;
    for (int trial = 0; trial < 60; trial++) {
        const int nx = 1 + trial % 5, ny = 1 + choose(NY_MAX), N = 2 + choose(N_MAX - 1);
        const bool none = trial % 2 == 0;
        struct system s;
        struct data data;
        struct dse_linear_mhe mhe;
        random_system(&s, nx, ny, choose(nx + 1), none ? nx : choose(nx + 1), 1);
        for (int i = 0; i < nx && trial % 3 == 0; i++)
            s.A[i * nx] = 0; /* a singular A */
        simulate(&s, none ? 0 : 25, &data);
        struct dse_linear_mhe_config config =
            config_of(&s, N, none ? DSE_ARRIVAL_NONE : DSE_ARRIVAL_CONSTANT);
        config.min_horizon = N; /* an unobservable pair is seen below, and left out */
        assert_int_equal(start(&mhe, &config), DSE_OK);
        dse_real expected[N_MAX * NX_MAX] = {0}, xbar[NX_MAX], newest[STEPS][NX_MAX];
        for (int k = 0; k < STEPS; k++) {
            const int H = k + 1 < N ? k + 1 : N, first = k + 1 - H;
            const struct dse_measurement sample = sample_of(&data, k);
            if (k > 0)
                assert_int_equal(dse_linear_mhe_advance(&mhe, &data.u[k - 1]), DSE_OK);
            assert_int_equal(dse_linear_mhe_measure(&mhe, 0, &data.u[k], &sample), DSE_OK);
            const enum dse_status status = dse_linear_mhe_solve(&mhe);
            if (none && status == DSE_ESINGULAR) {
                assert_true(N * ny < nx); /* too few data in any window */
                break;
            }
            assert_int_equal(status, DSE_OK);
            assert_int_equal(dse_linear_mhe_length(&mhe), H);
            for (int i = 0; i < nx; i++) {
                newest[k][i] = dse_linear_mhe_state(&mhe)[i];
                xbar[i] = s.x0[i];
            }
            if (first > 0) { /* A x + B u of what was said of the last sample that left */
                dense_product(nx, nx, 1, s.A, newest[first - 1], 0, xbar);
                dse_axpy(nx, data.u[first - 1], s.B, xbar);
            }
            if (none && H < N)
                continue;
            dense_window(&s, &data, first, H, none ? NULL : xbar, expected);
            /* without prior the data alone must carry the oldest states */
            assert_agree(H * nx, dse_linear_mhe_window(&mhe), expected,
                         none ? 100 * AGREEMENT : AGREEMENT);
        }
    }
}

/* Samples that nobody asked an estimate for leave a prediction in its place. */
static void samples_without_a_solution_leave_a_predicted_arrival_cost(void **state)
{
    (void)state;
    enum { nx = 3, N = 3, LAST = 9 };
    random_state = 14;
    struct system s;
    struct data data;
    struct dse_linear_mhe mhe;
    dse_real xbar[nx], moved[nx], expected[N * nx] = {0};
    random_system(&s, nx, 2, nx, nx, 1);
    simulate(&s, 0, &data);
    const struct dse_linear_mhe_config config = config_of(&s, N, DSE_ARRIVAL_CONSTANT);
    assert_int_equal(start(&mhe, &config), DSE_OK);
    for (int i = 0; i < nx; i++)
        xbar[i] = s.x0[i];
    for (int k = 0; k <= LAST; k++) {
        const struct dse_measurement sample = sample_of(&data, k);
        if (k > 0)
            assert_int_equal(dse_linear_mhe_advance(&mhe, &data.u[k - 1]), DSE_OK);
        assert_int_equal(dse_linear_mhe_measure(&mhe, 0, &data.u[k], &sample), DSE_OK);
        if (k > LAST - N) /* as long as that sample is not yet the oldest of the window */
            continue;
        dense_product(nx, nx, 1, s.A, xbar, 0, moved);
        for (int i = 0; i < nx; i++)
            xbar[i] = moved[i] + s.B[i] * data.u[k];
    }
    assert_int_equal(dse_linear_mhe_solve(&mhe), DSE_OK);
    dense_window(&s, &data, LAST + 1 - N, N, xbar, expected);
    assert_agree(N * nx, dse_linear_mhe_window(&mhe), expected, AGREEMENT);
}

/* Psi = C'R^-1 C + G_A' Q^-1 G_A and its inverse, dense. */
static void covariance_without_arrival_cost_is_the_corner_of_the_inverse_hessian(void **state)
{
    (void)state;
    enum { nx = 2, H = 4, n = nx * H };
    random_state = 4;
    struct system s;
    struct data data;
    struct dse_linear_mhe mhe;
    dse_real Psi[n * n] = {0}, inverse[n * n], Q[4], Qi[4], P[4], corner[4];
    random_system(&s, nx, 1, nx, nx, 1);
    simulate(&s, 0, &data);
    const struct dse_linear_mhe_config config = config_of(&s, H, DSE_ARRIVAL_NONE);
    assert_int_equal(start(&mhe, &config), DSE_OK);
    assert_int_equal(dse_linear_mhe_covariance(&mhe, P), DSE_ENODATA);
    for (int k = 0; k < H + 2; k++)
        step(&mhe, &data, k);
    for (int i = 0; i < 4; i++)
        Q[i] = s.Q[i];
    dense_inverse(nx, Q, Qi);
    for (int j = 0; j < H; j++) {
        for (int a = 0; a < nx; a++)
            for (int b = 0; b < nx; b++)
                Psi[(j * nx + a) * n + j * nx + b] += s.C[a] * s.C[b] / s.R[0];
        dse_real row[nx * 2 * nx] = {0}; /* [-A I] */
        for (int i = 0; i < nx; i++) {
            for (int p = 0; p < nx; p++)
                row[i * 2 * nx + p] = -s.A[i * nx + p];
            row[i * 2 * nx + nx + i] = 1;
        }
        for (int a = 0; a < 2 * nx && j + 1 < H; a++)
            for (int b = 0; b < 2 * nx; b++)
                for (int p = 0; p < nx; p++)
                    for (int q = 0; q < nx; q++)
                        Psi[(j * nx + a) * n + j * nx + b] +=
                            row[p * 2 * nx + a] * Qi[p * nx + q] * row[q * 2 * nx + b];
    }
    dense_inverse(n, Psi, inverse);
    for (int a = 0; a < nx; a++)
        for (int b = 0; b < nx; b++)
            corner[a * nx + b] = inverse[(n - nx + a) * n + n - nx + b];
    assert_int_equal(dse_linear_mhe_covariance(&mhe, P), DSE_OK);
    assert_agree(4, P, corner, AGREEMENT);
}

/* ---- certificate ---- */

static void certificate_is_small_at_the_solution_and_large_beside_it(void **state)
{
    (void)state;
    random_state = 5;
    for (int trial = 0; trial < 90; trial++) {
        const enum dse_arrival arrival = (enum dse_arrival)(trial % 3);
        const int nx = 1 + trial % 6, N = 6;
        struct system s;
        struct data data;
        struct dse_linear_mhe mhe;
        random_system(&s, nx, 2, arrival == DSE_ARRIVAL_NONE ? nx : choose(nx + 1), nx, 1);
        simulate(&s, 0, &data);
        const struct dse_linear_mhe_config config = config_of(&s, N, arrival);
        assert_int_equal(start(&mhe, &config), DSE_OK);
        for (int k = 0; k < 12; k++)
            step(&mhe, &data, k);
        dse_real x[6 * NX_MAX], size = 0;
        for (int i = 0; i < N * nx; i++) {
            x[i] = dse_linear_mhe_window(&mhe)[i];
            size = dse_max(size, dse_abs(x[i]));
        }
        assert_true(dse_linear_mhe_certificate(&mhe) < TIGHT);
        assert_true(dse_linear_mhe_certify(&mhe, x) == dse_linear_mhe_certificate(&mhe));
        const dse_real shift = dse_sqrt(EPS) * size; /* 1.5e-8: half of the digits */
        for (int i = 0; i < N * nx; i++) {
            x[i] += shift;
            assert_true(dse_linear_mhe_certify(&mhe, x) > DSE_REAL(1e-3) * dse_sqrt(EPS));
            x[i] -= shift;
        }
    }
}

/* Factors that are wrong in half of their digits still lead to the solution. */
static void errors_of_the_factors_are_corrected_by_the_residual(void **state)
{
    (void)state;
    enum { nx = 4, N = 6 };
    for (int trial = 0; trial < 3; trial++) {
        random_state = 13;
        struct system s;
        struct data data;
        struct dse_linear_mhe mhe;
        dse_real expected[N * nx];
        random_system(&s, nx, 2, nx, nx, 1);
        simulate(&s, 0, &data);
        const struct dse_linear_mhe_config config = config_of(&s, N, (enum dse_arrival)trial);
        for (int pass = 0; pass < 2; pass++) {
            assert_int_equal(start(&mhe, &config), DSE_OK);
            for (int i = 0; i < N * 3 * nx * nx && pass == 1; i++)
                mhe.complete[i] *= 1 + dse_sqrt(EPS) * uniform();
            for (int k = 0; k < 10; k++)
                step(&mhe, &data, k);
            for (int i = 0; i < N * nx && pass == 0; i++)
                expected[i] = dse_linear_mhe_window(&mhe)[i];
        }
        assert_agree(N * nx, dse_linear_mhe_window(&mhe), expected, 1000 * EPS);
        assert_true(dse_linear_mhe_certificate(&mhe) < TIGHT);
        assert_true(dse_linear_mhe_counts(&mhe)->refinements >= 5);
    }
}

static void a_solution_above_the_tolerance_is_refused_and_the_estimate_kept(void **state)
{
    (void)state;
    random_state = 6;
    struct system s;
    struct data data;
    struct dse_linear_mhe mhe;
    random_system(&s, 4, 2, 4, 4, 1);
    simulate(&s, 0, &data);
    struct dse_linear_mhe_config config = config_of(&s, 4, DSE_ARRIVAL_KALMAN);
    assert_int_equal(start(&mhe, &config), DSE_OK);
    for (int k = 0; k < 8; k++)
        step(&mhe, &data, k);
    dse_real before[4 * 4], P[16];
    for (int i = 0; i < 16; i++)
        before[i] = dse_linear_mhe_window(&mhe)[i];
    config.tolerance = DSE_REAL_MIN;
    assert_int_equal(dse_linear_mhe_advance(&mhe, &data.u[7]), DSE_OK);
    const struct dse_measurement sample = sample_of(&data, 8);
    assert_int_equal(dse_linear_mhe_measure(&mhe, 0, &data.u[8], &sample), DSE_OK);
    assert_int_equal(dse_linear_mhe_solve(&mhe), DSE_ENOCONV);
    assert_true(dse_linear_mhe_sample(&mhe) == 7);
    assert_memory_equal(before, dse_linear_mhe_window(&mhe), sizeof before);
    assert_int_equal(dse_linear_mhe_covariance(&mhe, P), DSE_ENODATA);
    assert_int_equal(dse_linear_mhe_health(&mhe), DSE_HEALTH_DIVERGED);
    assert_int_equal((int)dse_linear_mhe_counts(&mhe)->failed, 1);
    config.tolerance = 0;
    assert_int_equal(dse_linear_mhe_solve(&mhe), DSE_OK);
    assert_true(dse_linear_mhe_sample(&mhe) == 8);
    assert_int_equal(dse_linear_mhe_health(&mhe), DSE_HEALTH_TRACKING);
}

/* ---- windows ---- */

static void short_windows_without_arrival_cost_are_predicted_from_x0(void **state)
{
    (void)state;
    enum { nx = 3, N = 6 };
    random_state = 7;
    struct system s;
    struct data data;
    struct dse_linear_mhe mhe;
    random_system(&s, nx, 1, nx, nx, 1);
    simulate(&s, 0, &data);
    struct dse_linear_mhe_config config = config_of(&s, N, DSE_ARRIVAL_NONE);
    dse_real x[nx], next[nx], expected[N * nx] = {0}, P[nx * nx];
    for (int least = 0; least <= 5; least += 5) { /* 0: nx samples */
        config.min_horizon = least;
        assert_int_equal(start(&mhe, &config), DSE_OK);
        assert_agree(nx, dse_linear_mhe_state(&mhe), s.x0, 0);
        for (int i = 0; i < nx; i++)
            x[i] = s.x0[i];
        for (int k = 0; k < N; k++) {
            step(&mhe, &data, k);
            const bool solved = k + 1 >= (least ? least : nx);
            assert_int_equal(dse_linear_mhe_length(&mhe), k + 1);
            assert_int_equal(dse_linear_mhe_health(&mhe),
                             solved ? DSE_HEALTH_TRACKING : DSE_HEALTH_INITIALISING);
            assert_int_equal(dse_linear_mhe_covariance(&mhe, P), solved ? DSE_OK : DSE_ENODATA);
            if (solved) {
                dense_window(&s, &data, 0, k + 1, NULL, expected);
                assert_agree((k + 1) * nx, dse_linear_mhe_window(&mhe), expected, AGREEMENT * 100);
            } else {
                assert_agree(nx, dse_linear_mhe_state(&mhe), x, 100 * EPS);
            }
            dense_product(nx, nx, 1, s.A, x, 0, next);
            for (int i = 0; i < nx; i++)
                x[i] = next[i] + s.B[i] * data.u[k];
        }
    }
}

/* The factors made at init and those made for an incomplete window are the same thing. */
static void a_gap_that_is_filled_leaves_no_trace(void **state)
{
    (void)state;
    random_state = 8;
    static dse_real other_memory[DSE_LINEAR_MHE_STORAGE(5, 2, 6)];
    struct system s;
    struct data data, gappy;
    struct dse_linear_mhe mhe, other;
    struct dse_arena arena;
    random_system(&s, 5, 2, 3, 5, 1);
    simulate(&s, 0, &data);
    gappy = data;
    for (int k = 0; k < STEPS; k++)
        gappy.valid[k][k % 2] = k % 3 > 0;
    const struct dse_linear_mhe_config config = config_of(&s, 6, DSE_ARRIVAL_CONSTANT);
    assert_int_equal(start(&mhe, &config), DSE_OK);
    dse_arena_init(&arena, other_memory, DSE_LINEAR_MHE_STORAGE(5, 2, 6));
    assert_int_equal(dse_linear_mhe_init(&other, &config, &arena), DSE_OK);
    for (int k = 0; k < STEPS; k++) {
        step(&mhe, &data, k);
        const struct dse_measurement first = sample_of(&gappy, k), second = sample_of(&data, k);
        if (k > 0)
            assert_int_equal(dse_linear_mhe_advance(&other, &data.u[k - 1]), DSE_OK);
        assert_int_equal(dse_linear_mhe_measure(&other, 0, &data.u[k], &first), DSE_OK);
        assert_int_equal(dse_linear_mhe_solve(&other), DSE_OK);
        assert_int_equal(dse_linear_mhe_measure(&other, 0, &data.u[k], &second), DSE_OK);
        assert_int_equal(dse_linear_mhe_solve(&other), DSE_OK);
        assert_memory_equal(dse_linear_mhe_window(&other), dse_linear_mhe_window(&mhe),
                            sizeof(dse_real) * 5 * (size_t)dse_linear_mhe_length(&mhe));
    }
}

static void missing_values_are_counted_and_told_apart(void **state)
{
    (void)state;
    enum { nx = 2, ny = 3, N = 3 };
    random_state = 9;
    struct system s;
    struct dse_linear_mhe mhe;
    random_system(&s, nx, ny, nx, nx, 1);
    const struct dse_linear_mhe_config config = config_of(&s, N, DSE_ARRIVAL_KALMAN);
    assert_int_equal(start(&mhe, &config), DSE_OK);
    const dse_real u = 1, y[ny] = {1, (dse_real)__builtin_nan(""), 2};
    const bool valid[ny] = {true, true, false}, nothing[ny] = {false, false, false};
    const struct dse_measurement some = {y, valid}, none = {y, nothing};
    const struct dse_linear_mhe_counts *counts = dse_linear_mhe_counts(&mhe);
    assert_int_equal(dse_linear_mhe_solve(&mhe), DSE_OK); /* the prior alone */
    assert_int_equal(dse_linear_mhe_health(&mhe), DSE_HEALTH_INITIALISING);
    assert_agree(nx, dse_linear_mhe_state(&mhe), s.x0, EPS);
    assert_int_equal(dse_linear_mhe_measure(&mhe, 0, &u, &some), DSE_OK);
    assert_int_equal(dse_linear_mhe_measure(&mhe, 0, &u, &some), DSE_OK);
    assert_true(counts->used == 2 && counts->replaced == 1 && counts->nonfinite == 2);
    assert_true(counts->missing == 2 && counts->late == 0);
    assert_int_equal(dse_linear_mhe_solve(&mhe), DSE_OK);
    assert_int_equal(dse_linear_mhe_health(&mhe), DSE_HEALTH_TRACKING);
    assert_int_equal(dse_linear_mhe_advance(&mhe, &u), DSE_OK);
    assert_int_equal(dse_linear_mhe_measure(&mhe, 0, &u, &none), DSE_OK);
    assert_int_equal(dse_linear_mhe_solve(&mhe), DSE_OK);
    assert_int_equal(dse_linear_mhe_health(&mhe), DSE_HEALTH_COASTING);
    assert_int_equal(dse_linear_mhe_measure(&mhe, 1, &u, &some), DSE_OK);
    assert_true(counts->late == 1 && counts->outdated == 0);
    assert_int_equal(dse_linear_mhe_measure(&mhe, 2, &u, &some), DSE_ENODATA);
    assert_int_equal(dse_linear_mhe_measure(&mhe, -1, &u, &some), DSE_EINVAL);
    assert_int_equal(dse_linear_mhe_measure(&mhe, 0, &y[1], &some), DSE_ENONFINITE);
    assert_true(counts->outdated == 1 && counts->used == 3);
    assert_int_equal(dse_linear_mhe_advance(&mhe, &y[1]), DSE_ENONFINITE);
    assert_int_equal(dse_linear_mhe_advance(&mhe, NULL), DSE_EINVAL);
}

/* A replaced value is the last one that came, in a window of its own as in the filter. */
static void a_value_that_comes_again_replaces_the_earlier_one(void **state)
{
    (void)state;
    enum { nx = 3, N = 4 };
    random_state = 10;
    struct system s;
    struct data data;
    struct filtered expected;
    struct dse_linear_mhe mhe;
    random_system(&s, nx, 2, nx, nx, 1);
    simulate(&s, 0, &data);
    filter(&s, &data, &expected);
    const struct dse_linear_mhe_config config = config_of(&s, N, DSE_ARRIVAL_KALMAN);
    assert_int_equal(start(&mhe, &config), DSE_OK);
    const dse_real wrong[2] = {100, -100};
    const struct dse_measurement mistake = {wrong, NULL};
    for (int k = 0; k < STEPS; k++) {
        if (k > 0)
            assert_int_equal(dse_linear_mhe_advance(&mhe, &data.u[k - 1]), DSE_OK);
        assert_int_equal(dse_linear_mhe_measure(&mhe, 0, &data.u[k], &mistake), DSE_OK);
        for (int age = k < N - 1 ? k : N - 1; age >= 0; age -= N - 1) {
            const struct dse_measurement right = sample_of(&data, k - age);
            assert_int_equal(dse_linear_mhe_measure(&mhe, age, &data.u[k - age], &right), DSE_OK);
        }
        const struct dse_measurement right = sample_of(&data, k);
        assert_int_equal(dse_linear_mhe_measure(&mhe, 0, &data.u[k], &right), DSE_OK);
        assert_int_equal(dse_linear_mhe_solve(&mhe), DSE_OK);
        assert_agree(nx, dse_linear_mhe_state(&mhe), expected.x[k], AGREEMENT);
    }
}

/* ---- failures ---- */

static void a_window_that_does_not_determine_the_states_says_so(void **state)
{
    (void)state;
    const dse_real A[4] = {1, 1, 0, 1}, C[2] = {1, 0}, R[1] = {1}, Q[4] = {1, 0, 0, 1};
    const struct dse_linear_mhe_config config = {.nx = 2,
                                                 .ny = 1,
                                                 .linear = {A, NULL, C, NULL},
                                                 .horizon = 3,
                                                 .arrival = DSE_ARRIVAL_NONE,
                                                 .Q = Q,
                                                 .R = R};
    struct dse_linear_mhe mhe;
    assert_int_equal(start(&mhe, &config), DSE_OK);
    dse_real x[2] = {0, 0};
    for (int k = 0; k < 12; k++) {
        const dse_real y = uniform();
        const bool valid = k < 4 || k > 7; /* two of three samples are too few, one is missing */
        const struct dse_measurement sample = {&y, &valid};
        if (k > 0)
            assert_int_equal(dse_linear_mhe_advance(&mhe, NULL), DSE_OK);
        assert_int_equal(dse_linear_mhe_measure(&mhe, 0, NULL, &sample), DSE_OK);
        const bool determined = k < 5 || k > 8;
        assert_int_equal(dse_linear_mhe_solve(&mhe), determined ? DSE_OK : DSE_ESINGULAR);
        if (determined) {
            for (int i = 0; i < 2; i++)
                x[i] = dse_linear_mhe_state(&mhe)[i];
        } else {
            assert_int_equal(dse_linear_mhe_health(&mhe), DSE_HEALTH_UNOBSERVABLE);
            assert_true(dse_linear_mhe_sample(&mhe) == 4);
            assert_agree(2, dse_linear_mhe_state(&mhe), x, 0);
        }
    }
}

/* A state that the outputs never see, mixed with the others: only rounding makes the window
 * regular. */
static void a_hidden_state_is_not_taken_for_an_observed_one(void **state)
{
    (void)state;
    enum { nx = 3 };
    random_state = 15;
    for (int trial = 0; trial < 100; trial++) {
        dse_real T[9], copy[9], inverse[9], A[9], C[3], part[9];
        const dse_real modes[9] = {DSE_REAL(0.5), 1, 0, 0, DSE_REAL(0.7), 0, 0, 0, DSE_REAL(0.9)};
        const dse_real seen[3] = {1, 0, 0}, R[1] = {1}, Q[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
        for (int i = 0; i < 9; i++) { /* diagonally dominant: well conditioned */
            T[i] = (i % 4 == 0 ? 3 : 0) + uniform();
            copy[i] = T[i];
        }
        dense_inverse(nx, copy, inverse); /* z = T^-1 x, z+ = modes z, y = z_0 */
        dense_product(nx, nx, nx, T, modes, 0, part);
        dense_product(nx, nx, nx, part, inverse, 0, A);
        dense_product(1, nx, nx, seen, inverse, 0, C);
        const struct dse_linear_mhe_config config = {.nx = nx,
                                                     .ny = 1,
                                                     .linear = {A, NULL, C, NULL},
                                                     .horizon = 6,
                                                     .arrival = DSE_ARRIVAL_NONE,
                                                     .Q = Q,
                                                     .R = R};
        struct dse_linear_mhe mhe;
        assert_int_equal(start(&mhe, &config), DSE_OK);
        for (int k = 0; k < 8; k++) {
            const dse_real y = uniform();
            const struct dse_measurement sample = {&y, NULL};
            if (k > 0)
                assert_int_equal(dse_linear_mhe_advance(&mhe, NULL), DSE_OK);
            assert_int_equal(dse_linear_mhe_measure(&mhe, 0, NULL, &sample), DSE_OK);
            assert_int_equal(dse_linear_mhe_solve(&mhe), k + 1 < nx ? DSE_OK : DSE_ESINGULAR);
        }
        assert_int_equal(dse_linear_mhe_health(&mhe), DSE_HEALTH_UNOBSERVABLE);
    }
}

static void overflow_is_reported_and_the_estimate_kept(void **state)
{
    (void)state;
    const dse_real huge = DSE_REAL_MAX / 4, A[1] = {huge}, C[1] = {1}, R[1] = {1}, P0[1] = {1};
    const struct dse_linear_mhe_config config = {
        .nx = 1, .ny = 1, .linear = {A, NULL, C, NULL}, .horizon = 1, .P0 = P0, .R = R};
    struct dse_linear_mhe mhe;
    assert_int_equal(start(&mhe, &config), DSE_OK);
    const dse_real y = 100;
    const struct dse_measurement sample = {&y, NULL};
    assert_int_equal(dse_linear_mhe_measure(&mhe, 0, NULL, &sample), DSE_OK);
    assert_int_equal(dse_linear_mhe_solve(&mhe), DSE_OK);
    const dse_real x = dse_linear_mhe_state(&mhe)[0];
    assert_true(dse_abs(x - 50) < 1000 * EPS);
    assert_int_equal(dse_linear_mhe_advance(&mhe, NULL), DSE_ENONFINITE);
    assert_int_equal(dse_linear_mhe_solve(&mhe), DSE_OK); /* nothing has changed */
    assert_true(dse_linear_mhe_state(&mhe)[0] == x && dse_linear_mhe_sample(&mhe) == 0);
}

static void impossible_configurations_are_refused_with_their_own_code(void **state)
{
    (void)state;
    random_state = 11;
    struct system s;
    random_system(&s, 3, 2, 3, 3, 1);
    const struct dse_linear_mhe_config good = config_of(&s, 4, DSE_ARRIVAL_KALMAN);
    const dse_real nan = (dse_real)__builtin_nan("");
    const dse_real indefinite[9] = {1, 2, 0, 2, 1, 0, 0, 0, 1}, spoiled[9] = {nan, 0, 0, 0, 1};
    const dse_real negative[4] = {1, 2, 2, 1},
                   lopsided[9] = {1, 0, 0, DSE_REAL(0.5), 1, 0, 0, 0, 1};
    enum { CASES = 22 };
    struct dse_linear_mhe_config c[CASES];
    enum dse_status expected[CASES];
    for (int i = 0; i < CASES; i++) {
        c[i] = good;
        expected[i] = i < 15 ? DSE_EINVAL : DSE_ENONFINITE;
    }
    c[0].nx = 0;
    c[1].ny = 0;
    c[2].nu = -1;
    c[3].horizon = 0;
    c[4].linear.A = NULL;
    c[5].linear.B = NULL;
    c[6].linear.C = NULL;
    c[7].R = NULL;
    c[8].P0 = NULL;
    c[9].min_horizon = 5;
    c[10].arrival = (enum dse_arrival)3;
    c[11].tolerance = nan;
    c[12].tolerance = -1;
    c[13].P0 = lopsided;
    c[14].Q = lopsided;
    c[15].P0 = spoiled;
    c[16].Q = spoiled;
    c[17].linear.A = spoiled;
    c[18].x0 = spoiled;
    c[19].P0 = indefinite;
    c[20].Q = indefinite;
    c[21].R = negative;
    expected[19] = expected[20] = expected[21] = DSE_ENOTPD;
    struct dse_linear_mhe mhe;
    for (int i = 0; i < CASES; i++)
        assert_int_equal(start(&mhe, &c[i]), expected[i]);
    struct dse_linear_mhe_config free_start = good;
    free_start.arrival = DSE_ARRIVAL_NONE;
    free_start.P0 = NULL;
    free_start.Q = NULL;
    free_start.x0 = NULL;
    assert_int_equal(start(&mhe, &free_start), DSE_OK);
    assert_int_equal(start(&mhe, &good), DSE_OK);
}

static void storage_constant_is_what_init_takes(void **state)
{
    (void)state;
    random_state = 12;
    for (int nx = 1; nx <= NX_MAX; nx += 3) {
        for (int ny = 1; ny <= NY_MAX; ny++) {
            struct system s;
            struct dse_linear_mhe mhe;
            struct dse_arena arena;
            random_system(&s, nx, ny, nx, nx, 1);
            const struct dse_linear_mhe_config config = config_of(&s, 5, DSE_ARRIVAL_KALMAN);
            const int size = DSE_LINEAR_MHE_STORAGE(nx, ny, 5);
            dse_arena_init(&arena, memory, size);
            assert_int_equal(dse_linear_mhe_init(&mhe, &config, &arena), DSE_OK);
            assert_int_equal(arena.used, size);
            dse_arena_init(&arena, memory, size - 1);
            assert_int_equal(dse_linear_mhe_init(&mhe, &config, &arena), DSE_ESTORAGE);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(equals_the_kalman_filter_on_a_thousand_random_systems),
        cmocka_unit_test(late_values_count_as_if_they_had_come_in_time),
        cmocka_unit_test(the_whole_window_equals_dense_least_squares),
        cmocka_unit_test(samples_without_a_solution_leave_a_predicted_arrival_cost),
        cmocka_unit_test(covariance_without_arrival_cost_is_the_corner_of_the_inverse_hessian),
        cmocka_unit_test(certificate_is_small_at_the_solution_and_large_beside_it),
        cmocka_unit_test(errors_of_the_factors_are_corrected_by_the_residual),
        cmocka_unit_test(a_solution_above_the_tolerance_is_refused_and_the_estimate_kept),
        cmocka_unit_test(short_windows_without_arrival_cost_are_predicted_from_x0),
        cmocka_unit_test(a_gap_that_is_filled_leaves_no_trace),
        cmocka_unit_test(missing_values_are_counted_and_told_apart),
        cmocka_unit_test(a_value_that_comes_again_replaces_the_earlier_one),
        cmocka_unit_test(a_window_that_does_not_determine_the_states_says_so),
        cmocka_unit_test(a_hidden_state_is_not_taken_for_an_observed_one),
        cmocka_unit_test(overflow_is_reported_and_the_estimate_kept),
        cmocka_unit_test(impossible_configurations_are_refused_with_their_own_code),
        cmocka_unit_test(storage_constant_is_what_init_takes),
    };
    return cmocka_run_group_tests_name("linear_mhe", tests, NULL, NULL);
}
