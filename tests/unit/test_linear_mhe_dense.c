/* The linear moving horizon estimator: whole windows against dense least squares. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "linear_mhe_dense.h"

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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_whole_window_equals_dense_least_squares),
        cmocka_unit_test(samples_without_a_solution_leave_a_predicted_arrival_cost),
        cmocka_unit_test(covariance_without_arrival_cost_is_the_corner_of_the_inverse_hessian),
    };
    return cmocka_run_group_tests_name("linear_mhe_dense", tests, NULL, NULL);
}
