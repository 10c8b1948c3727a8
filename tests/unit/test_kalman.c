/* The linear Kalman filter against the textbook's dense form, statistics and hard cases. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "dense_filter.h"
#include "dse/kalman.h"
#include "dse/math.h"
#include "near.h"
#include "random_matrix.h"

#define NX_MAX 12
#define NY_MAX 6
#define EPS    DSE_REAL_EPSILON
/* Agreement with the dense form: 1e-9 in double precision. */
#define AGREEMENT DSE_REAL(4.6e6 * (double)DSE_REAL_EPSILON)

static dse_real memory[DSE_KALMAN_STORAGE_CONTINUOUS(NX_MAX, 1, NY_MAX)];

/* M = G G' / 4 + floor I. */
static void fill_spd(int n, dse_real floor, dse_real *M)
{
    dse_real G[NX_MAX * NX_MAX];
    fill_scaled(n, n * n, G);
    dense_product(n, n, n, G, G, 1, M);
    for (int i = 0; i < n; i++)
        M[i * n + i] += floor;
}

struct system {
    int nx, ny;
    dse_real A[NX_MAX * NX_MAX], B[NX_MAX], C[NY_MAX * NX_MAX], D[NY_MAX];
    dse_real Q[NX_MAX * NX_MAX], R[NY_MAX * NY_MAX], P0[NX_MAX * NX_MAX], x0[NX_MAX];
};

static void random_system(struct system *s, int nx, int ny, bool correlated)
{
    s->nx = nx;
    s->ny = ny;
    fill_scaled(nx, nx * nx, s->A);
    fill_scaled(1, nx, s->B);
    fill_scaled(nx, ny * nx, s->C);
    fill_scaled(1, ny, s->D);
    fill_spd(nx, DSE_REAL(0.01), s->Q);
    fill_spd(ny, DSE_REAL(0.1), s->R);
    for (int i = 0; i < ny * ny && !correlated; i++)
        s->R[i] = i % (ny + 1) == 0 ? s->R[i] : 0;
    fill_spd(nx, 1, s->P0);
    fill_scaled(1, nx, s->x0);
}

static struct dse_kalman_config config_of(const struct system *s)
{
    return (struct dse_kalman_config){.nx = s->nx,
                                      .nu = 1,
                                      .ny = s->ny,
                                      .linear = {s->A, s->B, s->C, s->D},
                                      .x0 = s->x0,
                                      .P0 = s->P0,
                                      .Q = s->Q,
                                      .R = s->R};
}

static enum dse_status start(struct dse_kalman *kalman, const struct dse_kalman_config *config)
{
    struct dse_arena arena;
    dse_arena_init(&arena, memory, (int)(sizeof memory / sizeof memory[0]));
    return dse_kalman_init(kalman, config, &arena);
}

/* Runs library and textbook side by side; channels are missing where the pattern says so. */
static void compare_with_textbook(const struct system *s, bool with_missing)
{
    const int nx = s->nx, ny = s->ny;
    const struct dse_kalman_config config = config_of(s);
    struct dse_kalman kalman;
    dse_real x[NX_MAX], P[NX_MAX * NX_MAX], result[NX_MAX * NX_MAX];
    assert_int_equal(start(&kalman, &config), DSE_OK);
    const struct dse_ekf *ekf = dse_kalman_ekf(&kalman);
    for (int i = 0; i < nx; i++)
        x[i] = s->x0[i];
    for (int i = 0; i < nx * nx; i++)
        P[i] = s->P0[i];
    for (int k = 1; k <= 50; k++) {
        dse_real y[NY_MAX], u = uniform(), moved[NX_MAX];
        dse_real H[NY_MAX * NX_MAX], R[NY_MAX * NY_MAX], e[NY_MAX];
        bool valid[NY_MAX];
        assert_int_equal(dse_kalman_predict(&kalman, (dse_real)k, &u), DSE_OK);
        dense_product(nx, nx, 1, s->A, x, 0, moved);
        for (int i = 0; i < nx; i++)
            x[i] = moved[i] + s->B[i] * u;
        dense_predict(nx, s->A, s->Q, P);
        int used = 0, index[NY_MAX];
        for (int j = 0; j < ny; j++) {
            y[j] = uniform();
            valid[j] = !with_missing || uniform() > DSE_REAL(-0.2);
            if (valid[j])
                index[used++] = j;
        }
        for (int a = 0; a < used; a++) { /* rows and columns of what is there */
            const int j = index[a];
            e[a] = y[j] - s->D[j] * u;
            for (int i = 0; i < nx; i++) {
                H[a * nx + i] = s->C[j * nx + i];
                e[a] -= H[a * nx + i] * x[i];
            }
            for (int b = 0; b < used; b++)
                R[a * used + b] = s->R[j * ny + index[b]];
        }
        const struct dse_measurement measurement = {y, valid};
        assert_int_equal(dse_kalman_update(&kalman, (dse_real)k, &u, &measurement), DSE_OK);
        const dse_real nis = dense_update(nx, used, H, R, e, x, P);
        assert_int_equal(dse_ekf_used(ekf), used);
        assert_agree(nx, dse_ekf_state(ekf), x, AGREEMENT);
        dse_ekf_covariance(ekf, result);
        assert_agree(nx * nx, result, P, AGREEMENT);
        dse_ekf_variance(ekf, moved);
        for (int i = 0; i < nx; i++)
            assert_agree(1, moved + i, P + i * nx + i, AGREEMENT);
        assert_agree(used > 0, &(dse_real){dse_ekf_nis(ekf)}, &nis, AGREEMENT);
    }
}

static void equals_the_textbook_filter_on_random_systems(void **state)
{
    (void)state;
    for (int nx = 1; nx <= NX_MAX; nx++) {
        for (int ny = 1; ny <= NY_MAX; ny += 2) {
            struct system s;
            random_system(&s, nx, ny, false);
            compare_with_textbook(&s, false);
            random_system(&s, nx, ny, true);
            compare_with_textbook(&s, false);
        }
    }
}

static void missing_channels_are_rows_left_out_also_when_noise_is_correlated(void **state)
{
    (void)state;
    for (int nx = 1; nx <= NX_MAX; nx += 3) {
        for (int ny = 2; ny <= NY_MAX; ny++) {
            struct system s;
            random_system(&s, nx, ny, false);
            compare_with_textbook(&s, true);
            random_system(&s, nx, ny, true);
            compare_with_textbook(&s, true);
        }
    }
}

/* A measurement channel that stands for itself must not change when its neighbour's order does. */
static void order_of_channels_does_not_matter(void **state)
{
    (void)state;
    struct system s, reversed;
    random_system(&s, 6, 4, true);
    reversed = s;
    for (int j = 0; j < 4; j++) {
        for (int i = 0; i < 6; i++)
            reversed.C[(3 - j) * 6 + i] = s.C[j * 6 + i];
        for (int i = 0; i < 4; i++)
            reversed.R[(3 - j) * 4 + 3 - i] = s.R[j * 4 + i];
        s.D[j] = reversed.D[j] = 0;
    }
    dse_real x[6], P[36], x_reversed[6], P_reversed[36];
    const dse_real y[4] = {1, -2, 3, DSE_REAL(0.5)}, y_reversed[4] = {DSE_REAL(0.5), 3, -2, 1},
                   u = 0;
    for (int pass = 0; pass < 2; pass++) {
        struct dse_kalman kalman;
        const struct dse_kalman_config config = config_of(pass ? &reversed : &s);
        const struct dse_measurement measurement = {pass ? y_reversed : y, NULL};
        assert_int_equal(start(&kalman, &config), DSE_OK);
        assert_int_equal(dse_kalman_update(&kalman, 0, &u, &measurement), DSE_OK);
        dse_ekf_covariance(dse_kalman_ekf(&kalman), pass ? P_reversed : P);
        for (int i = 0; i < 6; i++)
            (pass ? x_reversed : x)[i] = dse_ekf_state(dse_kalman_ekf(&kalman))[i];
    }
    assert_agree(6, x, x_reversed, 1000 * EPS);
    assert_agree(36, P, P_reversed, 1000 * EPS);
}

/* Over many runs of a system that is what the filter believes, the normalised errors have the mean
 * of their chi-square distributions: nx and ny, within 5 standard deviations of the mean. */
static void normalised_errors_and_innovations_are_consistent(void **state)
{
    (void)state;
    enum { nx = 3, ny = 2, runs = 400, steps = 30 };
    struct system s;
    random_system(&s, nx, ny, true);
    const struct dse_kalman_config config = config_of(&s);
    dse_real Lq[9], Lr[4], L0[9];
    assert_int_equal(dse_cholesky(nx, s.Q, Lq), DSE_OK);
    assert_int_equal(dse_cholesky(ny, s.R, Lr), DSE_OK);
    assert_int_equal(dse_cholesky(nx, s.P0, L0), DSE_OK);
    double nis = 0, nees = 0;
    for (int run = 0; run < runs; run++) {
        struct dse_kalman kalman;
        assert_int_equal(start(&kalman, &config), DSE_OK);
        const struct dse_ekf *ekf = dse_kalman_ekf(&kalman);
        dse_real x[nx], w[nx], v[ny], y[ny], next[nx], u = 1;
        for (int i = 0; i < nx; i++)
            w[i] = normal();
        dse_mat_vec(nx, nx, L0, w, x);
        dse_axpy(nx, 1, s.x0, x);
        for (int k = 1; k <= steps; k++) {
            for (int i = 0; i < nx; i++)
                w[i] = normal();
            for (int j = 0; j < ny; j++)
                v[j] = normal();
            dse_mat_vec(nx, nx, s.A, x, next); /* x = A x + B u + w */
            dse_mat_vec(nx, nx, Lq, w, x);
            dse_axpy(nx, 1, next, x);
            dse_axpy(nx, u, s.B, x);
            dse_mat_vec(ny, ny, Lr, v, y); /* y = C x + D u + v */
            dse_mat_vec(ny, nx, s.C, x, next);
            dse_axpy(ny, 1, next, y);
            dse_axpy(ny, u, s.D, y);
            const struct dse_measurement measurement = {y, NULL};
            assert_int_equal(dse_kalman_predict(&kalman, (dse_real)k, &u), DSE_OK);
            assert_int_equal(dse_kalman_update(&kalman, (dse_real)k, &u, &measurement), DSE_OK);
            nis += (double)dse_ekf_nis(ekf);
        }
        dse_real P[nx * nx], e[nx], weighted[nx];
        dse_ekf_covariance(ekf, P);
        for (int i = 0; i < nx; i++)
            weighted[i] = e[i] = x[i] - dse_ekf_state(ekf)[i];
        assert_int_equal(dse_cholesky(nx, P, P), DSE_OK);
        dse_cholesky_solve(nx, P, 1, weighted);
        nees += (double)dse_dot(nx, e, weighted);
    }
    assert_true(fabs(nees / runs - nx) < 5 * sqrt(2.0 * nx / runs));
    assert_true(fabs(nis / (runs * steps) - ny) < 5 * sqrt(2.0 * ny / (runs * steps)));
}

/* Near-perfect sensors on an almost unknown state, no process noise: the dense form ends in
 * negative variances, the factors cannot. */
static void covariance_stays_definite_with_tiny_noise_and_huge_prior(void **state)
{
    (void)state;
    const dse_real A[9] = {1, DSE_REAL(0.1), DSE_REAL(0.005), 0, 1, DSE_REAL(0.1), 0, 0, 1};
    const dse_real C[6] = {1, 0, 0, 1, 1, 0};
    const dse_real P0[9] = {DSE_REAL(1e12), 0, 0, 0, DSE_REAL(1e12), 0, 0, 0, DSE_REAL(1e12)};
    const dse_real R[4] = {DSE_REAL(1e-12), 0, 0, DSE_REAL(1e-12)};
    const struct dse_kalman_config config = {
        .nx = 3, .ny = 2, .linear = {A, NULL, C, NULL}, .P0 = P0, .R = R};
    struct dse_kalman kalman;
    assert_int_equal(start(&kalman, &config), DSE_OK);
    const struct dse_ekf *ekf = dse_kalman_ekf(&kalman);
    dse_real x[3] = {1000, -5, 2}, next[3], y[2], variance[3];
    for (int k = 1; k <= 2000; k++) {
        dse_mat_vec(3, 3, A, x, next);
        dse_axpy(3, -1, x, next);
        dse_axpy(3, 1, next, x);
        dse_mat_vec(2, 3, C, x, y);
        const struct dse_measurement measurement = {y, NULL};
        assert_int_equal(dse_kalman_predict(&kalman, (dse_real)k, NULL), DSE_OK);
        assert_int_equal(dse_kalman_update(&kalman, (dse_real)k, NULL, &measurement), DSE_OK);
        dse_ekf_variance(ekf, variance);
        for (int i = 0; i < 3; i++) {
            assert_true(ekf->d[i] > 0);
            assert_true(variance[i] > 0);
        }
        if (k == 3) /* three samples determine three states to a few times the sensor's error */
            for (int i = 0; i < 3; i++)
                assert_true(variance[i] < DSE_REAL(1e-7));
    }
    for (int i = 0; i < 3; i++)
        assert_true(dse_abs(dse_ekf_state(ekf)[i] - x[i]) < 1000 * EPS * (1000 + dse_abs(x[i])));
}

/* x2 is a known constant, noise drives x1 through one direction only. */
static void singular_noise_and_known_states_are_allowed(void **state)
{
    (void)state;
    const dse_real A[9] = {1, 1, 0, 0, 1, 0, 0, 0, 1}, C[3] = {1, 0, 1}, R[1] = {DSE_REAL(0.1)};
    const dse_real P0[9] = {1, 0, 0, 0, 1, 0, 0, 0, 0}, x0[3] = {0, 0, 7};
    const dse_real Q[9] = {DSE_REAL(0.25), DSE_REAL(0.5), 0, DSE_REAL(0.5), 1, 0, 0, 0, 0};
    const struct dse_kalman_config config = {
        .nx = 3, .ny = 1, .linear = {A, NULL, C, NULL}, .x0 = x0, .P0 = P0, .Q = Q, .R = R};
    struct dse_kalman kalman;
    assert_int_equal(start(&kalman, &config), DSE_OK);
    const struct dse_ekf *ekf = dse_kalman_ekf(&kalman);
    dse_real x[3] = {0, 0, 7}, P[9], result[9];
    for (int i = 0; i < 9; i++)
        P[i] = P0[i];
    for (int k = 1; k <= 100; k++) {
        const dse_real y = uniform();
        const struct dse_measurement measurement = {&y, NULL};
        assert_int_equal(dse_kalman_predict(&kalman, (dse_real)k, NULL), DSE_OK);
        assert_int_equal(dse_kalman_update(&kalman, (dse_real)k, NULL, &measurement), DSE_OK);
        x[0] += x[1];
        dense_predict(3, A, Q, P);
        const dse_real e = y - x[0] - x[2];
        (void)dense_update(3, 1, C, R, &e, x, P);
        dse_ekf_covariance(ekf, result);
        assert_agree(9, result, P, AGREEMENT);
        assert_agree(3, dse_ekf_state(ekf), x, AGREEMENT);
        assert_true(result[8] == 0 && dse_ekf_state(ekf)[2] == 7);
    }
}

/* Without process noise the variance of a decaying state goes to zero through the smallest numbers
 * that there are; the filter goes on. */
static void a_state_without_noise_becomes_known_exactly(void **state)
{
    (void)state;
    const dse_real A[9] = {DSE_REAL(0.3), 1, 0, 0, DSE_REAL(0.4), 1, 0, 0, DSE_REAL(0.5)};
    const dse_real C[3] = {1, 0, 0}, R[1] = {1}, P0[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    for (int nx = 1; nx <= 3; nx += 2) {
        const struct dse_kalman_config config = {
            .nx = nx, .ny = 1, .linear = {A, NULL, C, NULL}, .P0 = P0, .R = R};
        struct dse_kalman kalman;
        assert_int_equal(start(&kalman, &config), DSE_OK);
        dse_real variance[3];
        for (int k = 1; k <= 1200; k++) {
            const dse_real y = uniform();
            const struct dse_measurement measurement = {&y, NULL};
            assert_int_equal(dse_kalman_predict(&kalman, (dse_real)k, NULL), DSE_OK);
            assert_int_equal(dse_kalman_update(&kalman, (dse_real)k, NULL, &measurement), DSE_OK);
        }
        dse_ekf_variance(dse_kalman_ekf(&kalman), variance);
        for (int i = 0; i < nx; i++)
            assert_true(variance[i] >= 0 && variance[i] < DSE_REAL_MIN);
    }
}

static void a_sampled_continuous_system_is_its_exact_discretisation(void **state)
{
    (void)state;
    enum { nx = 3 };
    struct system s;
    random_system(&s, nx, 2, true);
    struct dse_kalman_config config = config_of(&s);
    config.period = DSE_REAL(0.7);
    struct dse_kalman kalman;
    assert_int_equal(start(&kalman, &config), DSE_OK);
    dse_real Ad[9], Bd[3], Qd[9], scratch[DSE_VAN_LOAN_SCRATCH(nx) + DSE_DISCRETISE_SCRATCH(nx, 1)];
    assert_int_equal(dse_van_loan(nx, s.A, s.Q, config.period, Ad, Qd, scratch), DSE_OK);
    assert_int_equal(dse_discretise(nx, 1, s.A, s.B, config.period, Ad, Bd, scratch), DSE_OK);
    dse_real x[nx], P[nx * nx], result[nx * nx];
    const dse_real u = 2;
    dense_product(nx, nx, 1, Ad, s.x0, 0, x);
    for (int i = 0; i < nx; i++)
        x[i] += Bd[i] * u;
    for (int i = 0; i < nx * nx; i++)
        P[i] = s.P0[i];
    dense_predict(nx, Ad, Qd, P);
    assert_int_equal(dse_kalman_predict(&kalman, config.period, &u), DSE_OK);
    dse_ekf_covariance(dse_kalman_ekf(&kalman), result);
    assert_agree(nx, dse_ekf_state(dse_kalman_ekf(&kalman)), x, 100 * EPS);
    assert_agree(nx * nx, result, P, 100 * EPS);
}

static void impossible_configurations_are_refused_with_their_own_code(void **state)
{
    (void)state;
    struct system s;
    random_system(&s, 3, 2, true);
    const struct dse_kalman_config good = config_of(&s);
    const dse_real nan = (dse_real)__builtin_nan("");
    const dse_real indefinite[9] = {1, 2, 0, 2, 1, 0, 0, 0, 1}, spoiled[9] = {nan, 0, 0, 0, 1};
    const dse_real negative[4] = {1, 2, 2, 1},
                   lopsided[9] = {1, 0, 0, DSE_REAL(0.5), 1, 0, 0, 0, 1};
    const dse_real lopsided_pair[4] = {1, 0, DSE_REAL(0.5), 1};
    enum { CASES = 16 };
    struct dse_kalman_config c[CASES];
    enum dse_status expected[CASES];
    for (int i = 0; i < CASES; i++) {
        c[i] = good;
        expected[i] = DSE_EINVAL;
    }
    c[0].nx = 0;
    c[1].ny = -1;
    c[2].linear.A = NULL;
    c[3].linear.B = NULL;
    c[4].linear.C = NULL;
    c[5].P0 = NULL;
    c[6].R = NULL;
    c[7].period = -1;
    c[8].gate = nan;
    c[9].P0 = indefinite;
    expected[9] = DSE_ENOTPD;
    c[10].Q = indefinite;
    expected[10] = DSE_ENOTPD;
    c[11].R = negative;
    expected[11] = DSE_ENOTPD;
    c[12].P0 = spoiled;
    expected[12] = DSE_ENONFINITE;
    c[13].P0 = lopsided;
    c[14].Q = lopsided;
    c[15].R = lopsided_pair;
    struct dse_kalman kalman;
    for (int i = 0; i < CASES; i++)
        assert_int_equal(start(&kalman, &c[i]), expected[i]);
    assert_int_equal(start(&kalman, &good), DSE_OK);
}

static void storage_constant_is_what_init_takes(void **state)
{
    (void)state;
    for (int continuous = 0; continuous < 2; continuous++) {
        struct system s;
        random_system(&s, 3, 2, true);
        struct dse_kalman_config config = config_of(&s);
        config.period = (dse_real)continuous;
        const int size =
            continuous ? DSE_KALMAN_STORAGE_CONTINUOUS(3, 1, 2) : DSE_KALMAN_STORAGE(3, 2);
        struct dse_kalman kalman;
        struct dse_arena arena;
        dse_arena_init(&arena, memory, size);
        assert_int_equal(dse_kalman_init(&kalman, &config, &arena), DSE_OK);
        if (!continuous)
            assert_int_equal(arena.used, size);
        for (int less = 0; less < (continuous ? 50 : size); less++) {
            dse_arena_init(&arena, memory, less);
            assert_int_equal(dse_kalman_init(&kalman, &config, &arena), DSE_ESTORAGE);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(equals_the_textbook_filter_on_random_systems),
        cmocka_unit_test(missing_channels_are_rows_left_out_also_when_noise_is_correlated),
        cmocka_unit_test(order_of_channels_does_not_matter),
        cmocka_unit_test(normalised_errors_and_innovations_are_consistent),
        cmocka_unit_test(covariance_stays_definite_with_tiny_noise_and_huge_prior),
        cmocka_unit_test(singular_noise_and_known_states_are_allowed),
        cmocka_unit_test(a_state_without_noise_becomes_known_exactly),
        cmocka_unit_test(a_sampled_continuous_system_is_its_exact_discretisation),
        cmocka_unit_test(impossible_configurations_are_refused_with_their_own_code),
        cmocka_unit_test(storage_constant_is_what_init_takes),
    };
    return cmocka_run_group_tests_name("kalman", tests, NULL, NULL);
}
