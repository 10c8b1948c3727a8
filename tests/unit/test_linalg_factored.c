/* Factored covariances against dense formulas, and where dense formulas fail. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "dse/factored.h"
#include "dse/linalg.h"
#include "near.h"
#include "random_matrix.h"

#define N_MAX 30
#define AREA  (DSE_FACTORED_STRIDE(N_MAX) * DSE_FACTORED_STRIDE(N_MAX))
#define EPS   DSE_REAL_EPSILON
#define VAST  DSE_REAL(1e12)
#define TINY  DSE_REAL(1e-12)

static const int sizes[] = {1, 2, 3, 4, 5, 8, 13, 15, 16, 30};
#define N_SIZES ((int)(sizeof sizes / sizeof sizes[0]))

static dse_real T[AREA], d[N_MAX], Tp[AREA], dp[N_MAX];
static dse_real scratch[DSE_FACTORED_PREDICT_SCRATCH(N_MAX)];

/* T for another size: zeros left of the diagonal. */
static void clear_factors(void)
{
    for (int i = 0; i < AREA; i++)
        T[i] = Tp[i] = 0;
}

/* P = G G' with G n x rank: semidefinite when rank < n. */
static void fill_psd(int n, int rank, dse_real *P)
{
    static dse_real G[AREA];
    fill(n * rank, G);
    dse_mat_mul_nt(n, rank, n, G, G, P);
}

/* h' P h. */
static dse_real form(int n, const dse_real *factor, const dse_real *weights, const dse_real *h)
{
    dse_real G[4 * N_MAX], work[4 * N_MAX]; /* one column, padded to four */
    dse_factored_project(n, 1, factor, h, G, work);
    return dse_factored_form(n, 1, weights, G, 0);
}

static void assert_weights_not_negative(int n, const dse_real *weights)
{
    for (int i = 0; i < n; i++)
        assert_true(weights[i] >= 0);
}

static void semidefinite_rows_reproduce_badly_scaled_matrices(void **state)
{
    (void)state;
    static dse_real P[AREA], Y[AREA], weights[N_MAX], sum[AREA];
    for (int in = 0; in < N_SIZES; in++) {
        const int n = sizes[in];
        for (int rank = 0; rank <= n; rank += (n + 2) / 3) {
            dse_real scale[N_MAX];
            fill_psd(n, rank, P);
            for (int i = 0; i < n; i++)
                scale[i] = i % 2 ? DSE_REAL(1e6) : DSE_REAL(1e-6);
            for (int i = 0; i < n * n; i++)
                P[i] *= scale[i / n] * scale[i % n];
            assert_int_equal(dse_semidefinite_rows(n, n, P, Y, weights), DSE_OK);
            int positive = 0;
            for (int i = 0; i < n; i++)
                positive += weights[i] > 0;
            assert_int_equal(positive, rank);
            for (int i = 0; i < n * n; i++) {
                sum[i] = 0;
                for (int k = 0; k < n; k++)
                    sum[i] += weights[k] * Y[k * n + i / n] * Y[k * n + i % n];
                const dse_real size = scale[i / n] * scale[i % n];
                assert_all_near(1, sum + i, P + i, 300 * (dse_real)n * EPS * size);
            }
        }
    }
}

static void factors_reproduce_definite_and_semidefinite_matrices(void **state)
{
    (void)state;
    static dse_real P[AREA], expanded[AREA], diagonal[N_MAX];
    for (int in = 0; in < N_SIZES; in++) {
        const int n = sizes[in];
        for (int rank = 0; rank <= n; rank += (n + 2) / 3) {
            fill_psd(n, rank, P);
            clear_factors();
            assert_int_equal(dse_factored_from(n, P, T, d, scratch), DSE_OK);
            assert_weights_not_negative(n, d);
            dse_factored_expand(n, T, d, expanded);
            assert_all_near(n * n, expanded, P, 300 * (dse_real)(n * n) * EPS);
            dse_factored_diagonal(n, T, d, diagonal);
            for (int i = 0; i < n; i++)
                assert_all_near(1, diagonal + i, expanded + i * n + i, 8 * (dse_real)(n * n) * EPS);
        }
    }
}

static void factors_of_an_indefinite_or_non_finite_matrix_are_refused(void **state)
{
    (void)state;
    const dse_real nan = (dse_real)__builtin_nan(""), inf = (dse_real)__builtin_inf();
    const struct {
        dse_real P[4];
        enum dse_status status;
    } cases[] = {{{-1, 0, 0, 1}, DSE_ENOTPD},
                 {{1, 2, 2, 1}, DSE_ENOTPD},
                 {{0, 0, 0, -1}, DSE_ENOTPD},
                 {{0, 1, 1, 0}, DSE_ENOTPD},
                 {{0, 1, 1, 1}, DSE_ENOTPD},
                 {{nan, 0, 0, 1}, DSE_ENONFINITE},
                 {{1, nan, nan, 1}, DSE_ENONFINITE},
                 {{1, 0, 0, inf}, DSE_ENONFINITE},
                 {{0, 0, 0, 0}, DSE_OK},
                 {{0, 0, 0, 1}, DSE_OK},
                 {{1, 0, 0, 0}, DSE_OK},
                 {{1, 1, 1, 1}, DSE_OK}};
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++)
        assert_int_equal(dse_factored_from(2, cases[c].P, T, d, scratch), cases[c].status);
}

/* Expected F P F' + w Q. */
static void dense_prediction(int n, const dse_real *F, const dse_real *P, const dse_real *Q,
                             dse_real w, dse_real *expected)
{
    static dse_real work[AREA];
    dse_sym_congruence(n, n, F, P, NULL, expected, work);
    for (int i = 0; Q && i < n * n; i++)
        expected[i] += w * Q[i];
}

static void prediction_equals_the_dense_formula_for_any_rank(void **state)
{
    (void)state;
    static dse_real P[AREA], Q[AREA], F[AREA], expected[AREA], result[AREA];
    for (int in = 0; in < N_SIZES; in++) {
        clear_factors();
        const int n = sizes[in], ranks[3] = {0, (n + 1) / 2, n};
        for (int c = 0; c < 9; c++) { /* singular sums take the orthogonal way, regular ones not */
            fill_psd(n, ranks[c / 3], P);
            fill_psd(n, ranks[c % 3], Q);
            fill(n * n, F);
            const bool noise = ranks[c % 3] > 0;
            clear_factors();
            dense_prediction(n, F, P, noise ? Q : NULL, DSE_REAL(0.3), expected);
            assert_int_equal(dse_factored_from(n, P, T, d, scratch), DSE_OK);
            assert_int_equal(
                dse_factored_predict(n, T, d, noise ? Q : NULL, DSE_REAL(0.3), F, Tp, dp, scratch),
                DSE_OK);
            assert_weights_not_negative(n, dp);
            assert_true(dse_factored_is_finite(n, Tp, dp));
            dse_factored_expand(n, Tp, dp, result);
            const dse_real scale = 1 + dse_norm_max(n * n, expected);
            assert_all_near(n * n, result, expected, 300 * (dse_real)(n * n) * EPS * scale);
            assert_int_equal(
                dse_factored_predict(n, T, d, noise ? Q : NULL, DSE_REAL(0.3), F, T, d, scratch),
                DSE_OK); /* in place */
            assert_all_near(n, d, dp, 0);
        }
    }
}

/* Two states that differ by 1e-12 of variance on top of 1e12: the dense sum cannot hold that. */
static void prediction_keeps_a_difference_that_a_dense_sum_would_lose(void **state)
{
    (void)state;
    dse_real Tc[8] = {1, 1, 0, 0, 0, 1, 0, 0}, dc[2] = {VAST, TINY}; /* x2 = x1 + tiny */
    const dse_real identity[4] = {1, 0, 0, 1};
    const dse_real difference[2] = {-1, 1};
    for (int step = 0; step < 100; step++) {
        assert_int_equal(dse_factored_predict(2, Tc, dc, NULL, 0, identity, Tc, dc, scratch),
                         DSE_OK);
    }
    const dse_real variance = form(2, Tc, dc, difference);
    assert_all_near(1, &variance, &(dse_real){TINY}, 1000 * EPS * TINY);
}

static void prediction_reports_non_finite_results_and_an_indefinite_noise(void **state)
{
    (void)state;
    const dse_real P[4] = {1, 0, 0, 1}, indefinite[4] = {-5, 0, 0, -5};
    clear_factors();
    assert_int_equal(dse_factored_from(2, P, T, d, scratch), DSE_OK);
    for (int i = 0; i < 4; i++) {
        dse_real F[4] = {1, 0, 0, 1};
        F[i] = (dse_real)(i % 2 ? __builtin_nan("") : __builtin_inf());
        assert_int_equal(dse_factored_predict(2, T, d, P, 1, F, Tp, dp, scratch), DSE_ENONFINITE);
    }
    assert_int_equal(dse_factored_predict(2, T, d, indefinite, 1, P, Tp, dp, scratch), DSE_ENOTPD);
}

/* Wherever it stands: in every row and column of the triangle and in d. */
static void a_single_non_finite_number_is_found(void **state)
{
    (void)state;
    for (int in = 0; in < N_SIZES; in++) {
        const int n = sizes[in], stride = DSE_FACTORED_STRIDE(n);
        clear_factors();
        for (int i = 0; i < n; i++)
            d[i] = T[i * stride + i] = 1;
        assert_true(dse_factored_is_finite(n, T, d));
        for (int i = 0; i < n; i++) {
            d[i] = (dse_real)__builtin_inf();
            assert_false(dse_factored_is_finite(n, T, d));
            d[i] = 1;
            for (int j = i + 1; j < n; j++) {
                T[i * stride + j] = (dse_real)__builtin_nan("");
                assert_false(dse_factored_is_finite(n, T, d));
                T[i * stride + j] = 0;
            }
        }
    }
}

/* m outputs at once equal m dense rank-1 updates, in place or not. */
static void updates_equal_the_dense_formula(void **state)
{
    (void)state;
    static dse_real P[AREA], dense[AREA], result[AREA], H[AREA], G[AREA], Tn[AREA], dn[N_MAX];
    dse_real Ph[N_MAX], r[N_MAX], e[N_MAX], x[N_MAX], dx[N_MAX];
    for (int in = 0; in < N_SIZES; in++) {
        for (int im = 0; im < N_SIZES && sizes[im] <= 13; im++) {
            const int n = sizes[in], m = sizes[im];
            clear_factors();
            dse_real nis = 0;
            fill_psd(n, n, P);
            fill(m * n, H);
            fill(m, e);
            assert_int_equal(dse_factored_from(n, P, T, d, scratch), DSE_OK);
            dse_factored_project(n, m, T, H, G, scratch);
            for (int i = 0; i < n * n; i++)
                dense[i] = P[i];
            for (int i = 0; i < n; i++)
                x[i] = 0;
            for (int c = 0; c < m; c++) {
                r[c] = DSE_REAL(0.2) * (dse_real)(c + 1);
                const dse_real *h = H + c * n;
                const dse_real prior = dse_factored_form(n, m, d, G, c);
                dse_mat_vec(n, n, P, h, Ph);
                assert_all_near(1, &prior, &(dse_real){dse_dot(n, h, Ph)},
                                300 * (dse_real)(n * n) * EPS);
                dse_mat_vec(n, n, dense, h, Ph);
                const dse_real s = dse_dot(n, h, Ph) + r[c], left = e[c] - dse_dot(n, h, x);
                dse_axpy(n, left / s, Ph, x);
                dse_sym_rank1(n, -1 / s, Ph, dense);
                nis += left * left / s;
            }
            for (int i = 0; i < AREA; i++)
                Tn[i] = 0;
            dse_real e_copy[N_MAX];
            static dse_real G_copy[AREA];
            for (int c = 0; c < m; c++)
                e_copy[c] = e[c];
            for (int i = 0; i < AREA; i++)
                G_copy[i] = G[i];
            const dse_real bound = 1000 * (dse_real)(n * n) * EPS;
            const dse_real value = dse_factored_update(n, m, T, d, G, r, e, Tn, dn, dx, scratch);
            assert_all_near(1, &value, &nis, bound * (1 + nis));
            assert_all_near(n, dx, x, bound);
            assert_weights_not_negative(n, dn);
            dse_factored_expand(n, Tn, dn, result);
            assert_all_near(n * n, result, dense, bound);
            (void)dse_factored_update(n, m, T, d, G_copy, r, e_copy, T, d, dx, scratch);
            assert_all_near(DSE_FACTORED_SIZE(n), T, Tn, 0);
            assert_all_near(n, d, dn, 0);
        }
    }
}

/* With P = 1e12 and r = 1e-12 a dense update leaves rounding errors of 1e-4 where r belongs. */
static void updates_keep_tiny_variances_below_huge_ones(void **state)
{
    (void)state;
    enum { n = 4 };
    static dse_real P[n * n], H[n * n];
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            P[i * n + j] = i == j ? VAST : DSE_REAL(0.5) * VAST;
    for (int trial = 0; trial < 50; trial++) {
        fill(n * n, H);
        for (int i = 0; i < n; i++)
            H[i * n + i] += 3;
        clear_factors();
        assert_int_equal(dse_factored_from(n, P, T, d, scratch), DSE_OK);
        for (int c = 0; c < n; c++) {
            dse_real G[4 * n], dx[n], e = 0;
            const dse_real r = TINY;
            dse_factored_project(n, 1, T, H + c * n, G, scratch);
            (void)dse_factored_update(n, 1, T, d, G, &r, &e, T, d, dx, scratch);
            assert_weights_not_negative(n, d);
            const dse_real variance = form(n, T, d, H + c * n);
            assert_true(variance > 0);
            if (sizeof(dse_real) == sizeof(double)) /* = r up to cancellation in T h */
                assert_all_near(1, &variance, &r, DSE_REAL(1e-3) * TINY);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(semidefinite_rows_reproduce_badly_scaled_matrices),
        cmocka_unit_test(factors_reproduce_definite_and_semidefinite_matrices),
        cmocka_unit_test(factors_of_an_indefinite_or_non_finite_matrix_are_refused),
        cmocka_unit_test(prediction_equals_the_dense_formula_for_any_rank),
        cmocka_unit_test(prediction_keeps_a_difference_that_a_dense_sum_would_lose),
        cmocka_unit_test(prediction_reports_non_finite_results_and_an_indefinite_noise),
        cmocka_unit_test(a_single_non_finite_number_is_found),
        cmocka_unit_test(updates_equal_the_dense_formula),
        cmocka_unit_test(updates_keep_tiny_variances_below_huge_ones),
    };
    return cmocka_run_group_tests_name("linalg_factored", tests, NULL, NULL);
}
