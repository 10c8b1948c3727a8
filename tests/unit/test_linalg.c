/* Dense kernels against their defining residuals over sizes 1 .. 30. Tolerances are multiples of
 * the unit roundoff, the size and the norms involved, so that they hold for double and float. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "dse/linalg.h"
#include "dse/math.h"
#include "random_matrix.h"

#define N_MAX 30
#define AREA  (N_MAX * N_MAX)
#define EPS   DSE_REAL_EPSILON

static const int sizes[] = {1, 2, 3, 4, 5, 7, 8, 9, 12, 15, 16, 17, 23, 29, 30};
#define N_SIZES ((int)(sizeof sizes / sizeof sizes[0]))

/* Largest absolute difference of two arrays. */
static dse_real distance(int n, const dse_real *a, const dse_real *b)
{
    dse_real worst = 0;
    for (int i = 0; i < n; i++) {
        const dse_real d = dse_abs(a[i] - b[i]);
        if (!(d <= worst))
            worst = d;
    }
    return worst;
}

static void assert_below(dse_real value, dse_real bound)
{
    if (!(value <= bound)) {
        print_error("%g exceeds %g\n", (double)value, (double)bound);
        fail();
    }
}

/* C = op(A) op(B) as the textbook writes it, one scalar product at a time. */
static void reference_product(int m, int k, int n, const dse_real *A, int a_row, int a_col,
                              const dse_real *B, int b_row, int b_col, dse_real *C)
{
    for (int i = 0; i < m; i++) {
        for (int j = 0; j < n; j++) {
            dse_real sum = 0;
            for (int p = 0; p < k; p++)
                sum += A[i * a_row + p * a_col] * B[p * b_row + j * b_col];
            C[i * n + j] = sum;
        }
    }
}

/* A = G G' + n I, well conditioned. */
static void fill_spd(int n, dse_real *A)
{
    static dse_real G[AREA];
    fill(n * n, G);
    reference_product(n, n, n, G, n, 1, G, 1, n, A);
    for (int i = 0; i < n; i++)
        A[i * n + i] += (dse_real)n;
}

static void products_equal_the_definition(void **state)
{
    (void)state;
    static dse_real A[AREA], B[AREA], C[AREA], expected[AREA];
    for (int im = 0; im < N_SIZES; im++) {
        for (int ik = 0; ik < N_SIZES; ik += 3) {
            const int m = sizes[im], k = sizes[ik], n = sizes[(im + ik) % N_SIZES];
            const dse_real bound = 4 * (dse_real)k * EPS;
            fill(AREA, A);
            fill(AREA, B);
            dse_mat_mul(m, k, n, A, B, C);
            reference_product(m, k, n, A, k, 1, B, n, 1, expected);
            assert_below(distance(m * n, C, expected), bound);
            dse_mat_mul_nt(m, k, n, A, B, C);
            reference_product(m, k, n, A, k, 1, B, 1, k, expected);
            assert_below(distance(m * n, C, expected), bound);
            dse_mat_mul_tn(m, k, n, A, B, C);
            reference_product(m, k, n, A, 1, m, B, n, 1, expected);
            assert_below(distance(m * n, C, expected), bound);
            dse_mat_vec(m, k, A, B, C);
            reference_product(m, k, 1, A, k, 1, B, 1, 1, expected);
            assert_below(distance(m, C, expected), bound);
            dse_mat_tvec(k, m, A, B, C);
            reference_product(m, k, 1, A, 1, m, B, 1, 1, expected);
            assert_below(distance(m, C, expected), bound);
        }
    }
}

/* expected = D + sign expected. */
static void add_scaled(int n, dse_real sign, const dse_real *D, dse_real *expected)
{
    for (int i = 0; i < n; i++)
        expected[i] = D[i] + sign * expected[i];
}

/* The same result in new memory and in place of the summand. */
static void products_are_added_to_what_is_given(void **state)
{
    (void)state;
    static dse_real A[AREA], B[AREA], C[AREA], D[AREA], expected[AREA];
    for (int im = 0; im < N_SIZES; im++) {
        for (int ik = 0; ik < N_SIZES; ik += 3) {
            const int m = sizes[im], k = sizes[ik], n = sizes[(im + ik) % N_SIZES];
            const dse_real bound = 4 * (dse_real)(k + 1) * EPS;
            fill(AREA, A);
            fill(AREA, B);
            fill(AREA, D);
            reference_product(m, k, n, A, k, 1, B, n, 1, expected);
            add_scaled(m * n, 1, D, expected);
            dse_mat_mul_add(m, k, n, A, B, D, C);
            assert_below(distance(m * n, C, expected), bound);
            dse_mat_mul_subtract(m, k, n, A, B, C, C);
            assert_below(distance(m * n, C, D), 2 * bound);
            dse_mat_mul_subtract(m, k, n, A, B, D, C);
            reference_product(m, k, n, A, k, 1, B, n, 1, expected);
            add_scaled(m * n, -1, D, expected);
            assert_below(distance(m * n, C, expected), bound);
            dse_mat_mul_add(m, k, n, A, B, C, C);
            assert_below(distance(m * n, C, D), 2 * bound);

            reference_product(m, k, 1, A, k, 1, B, 1, 1, expected);
            add_scaled(m, 1, D, expected);
            dse_mat_vec_add(m, k, A, B, D, C);
            assert_below(distance(m, C, expected), bound);
            for (int i = 0; i < m; i++)
                C[i] = D[i];
            dse_mat_vec_add(m, k, A, B, C, C);
            assert_below(distance(m, C, expected), bound);
            reference_product(m, k, 1, A, 1, m, B, 1, 1, expected);
            add_scaled(m, 1, D, expected);
            dse_mat_tvec_add(k, m, A, B, D, C);
            assert_below(distance(m, C, expected), bound);
            for (int i = 0; i < m; i++)
                C[i] = D[i];
            dse_mat_tvec_add(k, m, A, B, C, C);
            assert_below(distance(m, C, expected), bound);
        }
    }
}

static void transpose_and_identity_place_every_entry(void **state)
{
    (void)state;
    dse_real A[6] = {1, 2, 3, 4, 5, 6}, B[6];
    const dse_real expected[6] = {1, 4, 2, 5, 3, 6};
    dse_mat_transpose(2, 3, A, B);
    assert_below(distance(6, B, expected), 0);
    const dse_real identity[4] = {1, 0, 0, 1};
    dse_mat_identity(2, A);
    assert_below(distance(4, A, identity), 0);
}

static void axpy_and_dot_use_every_element(void **state)
{
    (void)state;
    for (int n = 0; n <= 9; n++) {
        dse_real x[10], y[10], expected = 0;
        for (int i = 0; i < 10; i++) {
            x[i] = (dse_real)(i + 1);
            y[i] = (dse_real)(1 << i);
        }
        for (int i = 0; i < n; i++)
            expected += x[i] * y[i];
        assert_true(dse_dot(n, x, y) == expected);
        dse_axpy(n, 2, x, y);
        for (int i = 0; i < 10; i++)
            assert_true(y[i] == (dse_real)(1 << i) + (i < n ? 2 * x[i] : 0));
    }
}

static void norm2_neither_overflows_nor_underflows(void **state)
{
    (void)state;
    const dse_real scales[] = {DSE_REAL_MIN, 1, DSE_REAL_MAX / 8};
    for (int s = 0; s < 3; s++) {
        const dse_real x[2] = {3 * scales[s], -4 * scales[s]};
        assert_below(dse_abs(dse_norm2(2, x) / scales[s] - 5), 8 * EPS);
        assert_true(dse_norm_max(2, x) == 4 * scales[s]);
    }
    const dse_real zero[2] = {0, 0};
    assert_true(dse_norm2(2, zero) == 0);
    assert_true(dse_norm2(0, zero) == 0);
}

static void norms_do_not_overlook_a_nan(void **state)
{
    (void)state;
    const dse_real nan = (dse_real)__builtin_nan("");
    for (int i = 0; i < 3; i++) {
        dse_real x[3] = {1, 2, 3};
        x[i] = nan;
        assert_true(dse_norm_max(3, x) != dse_norm_max(3, x));
        assert_true(dse_norm2(3, x) != dse_norm2(3, x));
    }
}

static void assert_symmetric(int n, const dse_real *S)
{
    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++)
            assert_true(S[i * n + j] == S[j * n + i]);
}

static void congruence_equals_the_product_and_is_symmetric_to_the_bit(void **state)
{
    (void)state;
    static dse_real A[AREA], P[AREA], Q[AREA], S[AREA], T[AREA], expected[AREA], scratch[AREA];
    for (int im = 0; im < N_SIZES; im++) {
        for (int in = 0; in < N_SIZES; in++) {
            const int m = sizes[im], n = sizes[in];
            fill(m * n, A);
            fill_spd(n, P);
            fill_spd(m, Q);
            reference_product(m, n, n, A, n, 1, P, n, 1, T);
            reference_product(m, n, m, T, n, 1, A, 1, n, expected);
            const dse_real bound = 8 * EPS * (dse_real)(n * n) * dse_norm_max(n * n, P);
            dse_sym_congruence(m, n, A, P, NULL, S, scratch);
            assert_symmetric(m, S);
            assert_below(distance(m * m, S, expected), bound);
            dse_axpy(m * m, 1, Q, expected);
            dse_sym_congruence(m, n, A, P, Q, S, scratch);
            assert_symmetric(m, S);
            assert_below(distance(m * m, S, expected), bound);
        }
        const int n = sizes[im]; /* S = P = Q */
        fill_spd(n, P);
        dse_sym_congruence(n, n, A, P, P, S, scratch);
        dse_sym_congruence(n, n, A, P, P, P, scratch);
        assert_below(distance(n * n, S, P), 0);
    }
}

static void rank1_update_equals_the_outer_product_and_is_symmetric(void **state)
{
    (void)state;
    static dse_real S[AREA], expected[AREA], v[N_MAX];
    for (int in = 0; in < N_SIZES; in++) {
        const int n = sizes[in];
        fill_spd(n, S);
        fill(n, v);
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++)
                expected[i * n + j] = S[i * n + j] + DSE_REAL(-0.7) * v[i] * v[j];
        dse_sym_rank1(n, DSE_REAL(-0.7), v, S);
        assert_symmetric(n, S);
        assert_below(distance(n * n, S, expected), 4 * EPS * dse_norm_max(n * n, S));
    }
}

static void enforced_symmetry_is_the_mean_of_both_triangles(void **state)
{
    (void)state;
    dse_real S[9] = {1, 2, 3, 4, 5, 6, 7, 8, 9};
    const dse_real expected[9] = {1, 3, 5, 3, 5, 7, 5, 7, 9};
    dse_sym_enforce(3, S);
    assert_below(distance(9, S, expected), 0);
}

static void cholesky_reproduces_the_matrix_and_reads_the_lower_triangle_only(void **state)
{
    (void)state;
    static dse_real A[AREA], L[AREA], product[AREA];
    for (int in = 0; in < N_SIZES; in++) {
        const int n = sizes[in];
        fill_spd(n, A);
        const dse_real bound = 4 * (dse_real)n * EPS * dse_norm_max(n * n, A);
        for (int i = 0; i < n * n; i++)
            L[i] = A[i];
        for (int i = 0; i < n; i++)
            for (int j = i + 1; j < n; j++)
                L[i * n + j] = (dse_real)__builtin_nan("");
        assert_int_equal(dse_cholesky(n, L, L), DSE_OK); /* in place */
        for (int i = 0; i < n; i++)
            for (int j = i + 1; j < n; j++)
                assert_true(L[i * n + j] == 0);
        reference_product(n, n, n, L, n, 1, L, 1, n, product);
        assert_below(distance(n * n, product, A), bound);
    }
}

static void cholesky_refuses_what_is_not_positive_definite(void **state)
{
    (void)state;
    const dse_real nan = (dse_real)__builtin_nan(""), inf = (dse_real)__builtin_inf();
    const dse_real cases[][4] = {{0, 0, 0, 1},   {1, 1, 1, 1},     {1, 2, 2, 1},  {-1, 0, 0, 1},
                                 {nan, 0, 0, 1}, {1, nan, nan, 1}, {inf, 0, 0, 1}};
    dse_real L[4];
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++)
        assert_int_equal(dse_cholesky(2, cases[c], L), DSE_ENOTPD);
}

/* |A X - B| for the solution X of a solver. */
static void assert_solves(int n, int m, const dse_real *A, const dse_real *X, const dse_real *B)
{
    static dse_real product[AREA];
    reference_product(n, n, m, A, n, 1, X, m, 1, product);
    const dse_real scale = dse_norm_max(n * n, A) * dse_norm_max(n * m, X) + 1;
    assert_below(distance(n * m, product, B), 16 * (dse_real)n * EPS * scale);
}

static void triangular_solves_undo_their_products(void **state)
{
    (void)state;
    static dse_real A[AREA], L[AREA], Lt[AREA], B[AREA], X[AREA];
    for (int in = 0; in < N_SIZES; in++) {
        const int n = sizes[in], m = sizes[(in * 7) % N_SIZES];
        fill_spd(n, A);
        fill(n * m, B);
        assert_int_equal(dse_cholesky(n, A, L), DSE_OK);
        dse_mat_transpose(n, n, L, Lt);
        for (int i = 0; i < n * m; i++)
            X[i] = B[i];
        dse_lower_solve(n, L, m, X);
        assert_solves(n, m, L, X, B);
        for (int i = 0; i < n * m; i++)
            X[i] = B[i];
        dse_lower_transpose_solve(n, L, m, X);
        assert_solves(n, m, Lt, X, B);
        for (int i = 0; i < n * m; i++)
            X[i] = B[i];
        dse_cholesky_solve(n, L, m, X);
        assert_solves(n, m, A, X, B);
    }
}

static void ldl_reproduces_indefinite_matrices_and_solves_with_them(void **state)
{
    (void)state;
    static dse_real A[AREA], L[AREA], D[N_MAX], LD[AREA], product[AREA], B[AREA], X[AREA];
    for (int in = 0; in < N_SIZES; in++) {
        const int n = sizes[in], m = sizes[(in * 7) % N_SIZES];
        fill_spd(n, A);
        for (int i = n / 2; i < n; i++) /* quasi-definite: [P G'; G -R] */
            for (int j = n / 2; j < n; j++)
                A[i * n + j] = -A[i * n + j];
        assert_int_equal(dse_ldl(n, A, L, D), DSE_OK);
        for (int i = 0; i < n; i++) {
            assert_true(L[i * n + i] == 1);
            for (int j = 0; j < n; j++) {
                if (j > i)
                    assert_true(L[i * n + j] == 0);
                LD[i * n + j] = L[i * n + j] * D[j];
            }
        }
        reference_product(n, n, n, LD, n, 1, L, 1, n, product);
        assert_below(distance(n * n, product, A), 8 * (dse_real)n * EPS * dse_norm_max(n * n, A));
        fill(n * m, B);
        for (int i = 0; i < n * m; i++)
            X[i] = B[i];
        dse_ldl_solve(n, L, D, m, X);
        assert_solves(n, m, A, X, B);
    }
    const dse_real singular[4] = {1, 1, 1, 1}, nan = (dse_real)__builtin_nan("");
    const dse_real spoiled[4] = {nan, 0, 0, 1};
    assert_int_equal(dse_ldl(2, singular, L, D), DSE_ESINGULAR);
    assert_int_equal(dse_ldl(2, spoiled, L, D), DSE_ENONFINITE);
}

static void lu_solves_general_systems_that_need_pivoting(void **state)
{
    (void)state;
    static dse_real A[AREA], LU[AREA], B[AREA], X[AREA];
    int pivots[N_MAX];
    for (int in = 0; in < N_SIZES; in++) {
        const int n = sizes[in], m = sizes[(in * 7) % N_SIZES];
        fill(n * n, A);
        for (int i = 0; i < n; i++) /* zero diagonal, dominant cyclic shift */
            A[i * n + i] = n > 1 ? 0 : 1;
        for (int i = 0; n > 1 && i < n; i++)
            A[i * n + (i + 1) % n] += (dse_real)n;
        fill(n * m, B);
        for (int i = 0; i < n * n; i++)
            LU[i] = A[i];
        for (int i = 0; i < n * m; i++)
            X[i] = B[i];
        assert_int_equal(dse_lu(n, LU, pivots), DSE_OK);
        dse_lu_solve(n, LU, pivots, m, X);
        assert_solves(n, m, A, X, B);
    }
}

static void lu_reports_singular_and_non_finite_matrices(void **state)
{
    (void)state;
    int pivots[3];
    dse_real singular[9] = {1, 2, 3, 2, 4, 6, 1, 0, 1};
    assert_int_equal(dse_lu(3, singular, pivots), DSE_ESINGULAR);
    for (int i = 0; i < 9; i++) {
        dse_real A[9] = {2, 1, 1, 1, 3, 1, 1, 1, 4};
        A[i] = (dse_real)__builtin_nan("");
        assert_int_equal(dse_lu(3, A, pivots), DSE_ENONFINITE);
    }
}

static void qr_least_squares_leaves_a_residual_orthogonal_to_the_columns(void **state)
{
    (void)state;
    static dse_real A[AREA], QR[AREA], tau[N_MAX], b[N_MAX], c[N_MAX], x[N_MAX], r[N_MAX];
    static dse_real gradient[N_MAX];
    for (int im = 0; im < N_SIZES; im++) {
        for (int in = 0; in <= im; in++) {
            const int m = sizes[im], n = sizes[in];
            fill(m * n, A);
            for (int i = 0; i < n; i++)
                A[i * n + i] += 3;
            fill(m, b);
            for (int i = 0; i < m * n; i++)
                QR[i] = A[i];
            for (int i = 0; i < m; i++)
                c[i] = b[i];
            assert_int_equal(dse_qr(m, n, QR, tau), DSE_OK);
            dse_qr_solve(m, n, QR, tau, c, x);
            reference_product(m, n, 1, A, n, 1, x, 1, 1, r);
            for (int i = 0; i < m; i++)
                r[i] -= b[i];
            reference_product(n, m, 1, A, 1, n, r, 1, 1, gradient); /* A'(A x - b) = 0 */
            const dse_real scale = (dse_real)(m * n) * (1 + dse_norm_max(n, x));
            assert_below(dse_norm_max(n, gradient), 64 * EPS * scale);
        }
    }
}

static void qr_keeps_lengths_and_the_gram_matrix(void **state)
{
    (void)state;
    static dse_real A[AREA], R[AREA], tau[N_MAX], b[N_MAX], gram[AREA], expected[AREA];
    for (int in = 0; in < N_SIZES; in++) {
        const int m = sizes[in], n = (m + 1) / 2;
        fill(m * n, A);
        for (int i = 0; i < n; i++)
            A[i * n + i] += 3;
        reference_product(n, m, n, A, 1, n, A, n, 1, expected); /* A'A = R'R */
        assert_int_equal(dse_qr(m, n, A, tau), DSE_OK);
        fill(m, b);
        const dse_real length = dse_norm2(m, b);
        dse_qr_apply_qt(m, n, A, tau, b);
        assert_below(dse_abs(dse_norm2(m, b) - length), 16 * (dse_real)m * EPS * length);
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++)
                R[i * n + j] = j >= i ? A[i * n + j] : 0;
        reference_product(n, n, n, R, 1, n, R, n, 1, gram);
        const dse_real bound = 16 * (dse_real)m * EPS * dse_norm_max(n * n, expected);
        assert_below(distance(n * n, gram, expected), bound);
    }
}

static void qr_reports_missing_rank_and_non_finite_entries(void **state)
{
    (void)state;
    dse_real tau[2];
    dse_real dependent[6] = {1, 2, 2, 4, 3, 6}, zero[6] = {0}, spoiled[6] = {1, 0, 0, 1, 0, 0};
    spoiled[4] = (dse_real)__builtin_nan("");
    assert_int_equal(dse_qr(3, 2, dependent, tau), DSE_ESINGULAR);
    assert_int_equal(dse_qr(3, 2, zero, tau), DSE_ESINGULAR);
    assert_int_equal(dse_qr(3, 2, spoiled, tau), DSE_ENONFINITE);
}

static void lq_gives_the_positive_square_root_of_the_gram_matrix(void **state)
{
    (void)state;
    static dse_real A[2 * AREA], L[AREA], product[AREA], expected[AREA];
    for (int in = 0; in < N_SIZES; in++) {
        for (int extra = 0; extra <= N_MAX; extra += 10) {
            const int n = sizes[in], m = n + extra;
            fill(n * m, A);
            reference_product(n, m, n, A, m, 1, A, 1, m, expected);
            dse_lq_lower(n, m, A, L);
            for (int i = 0; i < n; i++) {
                assert_true(L[i * n + i] > 0);
                for (int j = i + 1; j < n; j++)
                    assert_true(L[i * n + j] == 0);
            }
            reference_product(n, n, n, L, n, 1, L, 1, n, product);
            assert_below(distance(n * n, product, expected), 16 * (dse_real)m * EPS * (dse_real)m);
        }
    }
    dse_real rank1[6] = {1, 2, 3, 2, 4, 6}; /* a singular Gram matrix has a singular root */
    dse_lq_lower(2, 3, rank1, L);
    assert_below(dse_abs(L[3]), 16 * EPS);
    assert_below(dse_abs(L[2] - 2 * L[0]), 16 * EPS);
}

static void covariance_check_tells_nonfinite_and_unequal_triangles_apart(void **state)
{
    (void)state;
    const dse_real fine[] = {4, 1, 1, 9};
    const dse_real rounded[] = {4, 1, 1 + 4 * DSE_REAL_EPSILON, 9};
    const dse_real lopsided[] = {4, 1, DSE_REAL(1.1), 9};
    const dse_real broken[] = {4, DSE_REAL(NAN), 1, 9};
    assert_int_equal(dse_sym_check(2, fine), DSE_OK);
    assert_int_equal(dse_sym_check(2, rounded), DSE_OK);
    assert_int_equal(dse_sym_check(2, lopsided), DSE_EINVAL);
    assert_int_equal(dse_sym_check(2, broken), DSE_ENONFINITE);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(covariance_check_tells_nonfinite_and_unequal_triangles_apart),
        cmocka_unit_test(products_equal_the_definition),
        cmocka_unit_test(products_are_added_to_what_is_given),
        cmocka_unit_test(transpose_and_identity_place_every_entry),
        cmocka_unit_test(axpy_and_dot_use_every_element),
        cmocka_unit_test(norm2_neither_overflows_nor_underflows),
        cmocka_unit_test(norms_do_not_overlook_a_nan),
        cmocka_unit_test(congruence_equals_the_product_and_is_symmetric_to_the_bit),
        cmocka_unit_test(rank1_update_equals_the_outer_product_and_is_symmetric),
        cmocka_unit_test(enforced_symmetry_is_the_mean_of_both_triangles),
        cmocka_unit_test(cholesky_reproduces_the_matrix_and_reads_the_lower_triangle_only),
        cmocka_unit_test(cholesky_refuses_what_is_not_positive_definite),
        cmocka_unit_test(triangular_solves_undo_their_products),
        cmocka_unit_test(ldl_reproduces_indefinite_matrices_and_solves_with_them),
        cmocka_unit_test(lu_solves_general_systems_that_need_pivoting),
        cmocka_unit_test(lu_reports_singular_and_non_finite_matrices),
        cmocka_unit_test(qr_least_squares_leaves_a_residual_orthogonal_to_the_columns),
        cmocka_unit_test(qr_keeps_lengths_and_the_gram_matrix),
        cmocka_unit_test(qr_reports_missing_rank_and_non_finite_entries),
        cmocka_unit_test(lq_gives_the_positive_square_root_of_the_gram_matrix),
    };
    return cmocka_run_group_tests_name("linalg", tests, NULL, NULL);
}
