/* Matrix exponential, discretisation and Van Loan's integral against closed forms and identities.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "dse/linalg.h"
#include "dse/math.h"
#include "near.h"
#include "random_matrix.h"

#define N_MAX 15
#define AREA  (N_MAX * N_MAX)
#define EPS   DSE_REAL_EPSILON

static void expm_of_a_rotation_is_cosine_and_sine(void **state)
{
    (void)state;
    dse_real E[4], scratch[DSE_EXPM_SCRATCH(2)];
    const dse_real angles[] = {0, DSE_REAL(1e-8), DSE_REAL(0.3), 2, 5, 20, -100};
    for (int c = 0; c < 7; c++) {
        const dse_real w = angles[c], A[4] = {0, w, -w, 0};
        const dse_real cosine = (dse_real)cos((double)w), sine = (dse_real)sin((double)w);
        const dse_real expected[4] = {cosine, sine, -sine, cosine};
        assert_int_equal(dse_expm(2, A, E, scratch), DSE_OK);
        assert_all_near(4, E, expected, 16 * EPS * (1 + dse_abs(w)));
    }
}

static void expm_of_a_nilpotent_shift_is_its_finite_series(void **state)
{
    (void)state;
    enum { n = 9 };
    static dse_real A[n * n], E[n * n], expected[n * n], scratch[DSE_EXPM_SCRATCH(n)];
    for (int i = 0; i + 1 < n; i++)
        A[i * n + i + 1] = 2;
    for (int i = 0; i < n; i++) {
        dse_real term = 1;
        for (int j = i; j < n; j++) {
            expected[i * n + j] = term; /* 2^k / k! on the k-th diagonal */
            term *= 2 / (dse_real)(j - i + 1);
        }
    }
    assert_int_equal(dse_expm(n, A, E, scratch), DSE_OK);
    assert_all_near(n * n, E, expected, 32 * EPS);
}

static void expm_of_the_negative_is_the_inverse(void **state)
{
    (void)state;
    static dse_real A[AREA], E[AREA], inverse[AREA], product[AREA], identity[AREA];
    static dse_real scratch[DSE_EXPM_SCRATCH(N_MAX)];
    for (int n = 1; n <= N_MAX; n++) {
        for (int i = 0; i < n * n; i++)
            A[i] = uniform();
        assert_int_equal(dse_expm(n, A, E, scratch), DSE_OK);
        for (int i = 0; i < n * n; i++)
            A[i] = -A[i];
        assert_int_equal(dse_expm(n, A, inverse, scratch), DSE_OK);
        dse_mat_mul(n, n, n, E, inverse, product);
        dse_mat_identity(n, identity);
        const dse_real size = dse_norm_max(n * n, E) * dse_norm_max(n * n, inverse);
        assert_all_near(n * n, product, identity, 64 * (dse_real)n * EPS * size);
    }
}

static void expm_of_the_double_is_the_square(void **state)
{
    (void)state;
    static dse_real A[AREA], E[AREA], twice[AREA], square[AREA], scratch[DSE_EXPM_SCRATCH(N_MAX)];
    for (int n = 2; n <= N_MAX; n++) {
        for (int i = 0; i < n * n; i++)
            A[i] = uniform() * 3;
        assert_int_equal(dse_expm(n, A, E, scratch), DSE_OK);
        for (int i = 0; i < n * n; i++)
            A[i] *= 2;
        assert_int_equal(dse_expm(n, A, twice, scratch), DSE_OK);
        dse_mat_mul(n, n, n, E, E, square);
        const dse_real size = dse_norm_max(n * n, E);
        assert_all_near(n * n, twice, square, 64 * (dse_real)(n * n) * EPS * size * size);
    }
}

static void expm_refuses_non_finite_input_and_reports_overflow(void **state)
{
    (void)state;
    dse_real E[4], scratch[DSE_EXPM_SCRATCH(2)];
    for (int i = 0; i < 4; i++) {
        dse_real A[4] = {1, 2, 3, 4};
        A[i] = (dse_real)__builtin_nan("");
        assert_int_equal(dse_expm(2, A, E, scratch), DSE_ENONFINITE);
    }
    const dse_real huge[4] = {DSE_REAL(1e4), 0, 0, 0};
    assert_int_equal(dse_expm(2, huge, E, scratch), DSE_ENONFINITE);
}

static void discretisation_of_a_double_integrator_is_exact(void **state)
{
    (void)state;
    const dse_real A[4] = {0, 1, 0, 0}, B[2] = {0, 1}, h = DSE_REAL(0.25);
    const dse_real Ad_expected[4] = {1, h, 0, 1}, Bd_expected[2] = {h * h / 2, h};
    dse_real Ad[4], Bd[2], scratch[DSE_DISCRETISE_SCRATCH(2, 1)];
    assert_int_equal(dse_discretise(2, 1, A, B, h, Ad, Bd, scratch), DSE_OK);
    assert_all_near(4, Ad, Ad_expected, 4 * EPS);
    assert_all_near(2, Bd, Bd_expected, 4 * EPS);
    assert_int_equal(dse_discretise(2, 0, A, NULL, h, Ad, NULL, scratch), DSE_OK);
    assert_all_near(4, Ad, Ad_expected, 4 * EPS);
}

static void van_loan_of_a_double_integrator_is_exact(void **state)
{
    (void)state;
    const dse_real A[4] = {0, 1, 0, 0}, Q[4] = {0, 0, 0, 2};
    const dse_real steps[] = {DSE_REAL(0.01), DSE_REAL(0.5), 8};
    dse_real Ad[4], Qd[4], scratch[DSE_VAN_LOAN_SCRATCH(2)];
    for (int c = 0; c < 3; c++) {
        const dse_real h = steps[c];
        const dse_real Ad_expected[4] = {1, h, 0, 1};
        const dse_real Qd_expected[4] = {2 * h * h * h / 3, h * h, h * h, 2 * h};
        assert_int_equal(dse_van_loan(2, A, Q, h, Ad, Qd, scratch), DSE_OK);
        assert_all_near(4, Ad, Ad_expected, 8 * EPS * (1 + h));
        assert_all_near(4, Qd, Qd_expected, 32 * EPS * (1 + Qd_expected[0]));
    }
}

/* Stationary covariance of x' = -a x + w is q / 2a; exp(a h) alone would overflow. */
static void van_loan_stands_a_stiff_plant_over_a_long_step(void **state)
{
    (void)state;
    const dse_real A[4] = {-1000, 0, 0, DSE_REAL(-0.5)}, Q[4] = {2, 0, 0, 1};
    const dse_real decay = (dse_real)exp(-5.0);
    const dse_real Ad_expected[4] = {0, 0, 0, decay};
    const dse_real Qd_expected[4] = {DSE_REAL(1e-3), 0, 0, 1 - (dse_real)exp(-10.0)};
    dse_real Ad[4], Qd[4], scratch[DSE_VAN_LOAN_SCRATCH(2)];
    assert_int_equal(dse_van_loan(2, A, Q, 10, Ad, Qd, scratch), DSE_OK);
    /* 14 doublings, each of which doubles a relative rounding error. */
    const dse_real bound = 16384 * EPS;
    assert_all_near(4, Ad, Ad_expected, bound * decay);
    assert_all_near(1, Qd, Qd_expected, bound * Qd_expected[0]);
    assert_all_near(4, Qd, Qd_expected, bound);
}

/* d/dh Qd = A Qd + Qd A' + Q: the integral over 2h from two halves must satisfy
 * Qd(2h) = Qd(h) + Ad(h) Qd(h) Ad(h)'. */
static void van_loan_composes_over_two_halves(void **state)
{
    (void)state;
    static dse_real A[AREA], G[AREA], Q[AREA], Ad[AREA], Qd[AREA], Ad2[AREA], Qd2[AREA];
    static dse_real composed[AREA], scratch[DSE_VAN_LOAN_SCRATCH(N_MAX)];
    for (int n = 1; n <= N_MAX; n++) {
        for (int i = 0; i < n * n; i++) {
            A[i] = uniform();
            G[i] = uniform();
        }
        dse_mat_mul_nt(n, n, n, G, G, Q);
        const dse_real h = DSE_REAL(0.37);
        assert_int_equal(dse_van_loan(n, A, Q, h, Ad, Qd, scratch), DSE_OK);
        assert_int_equal(dse_van_loan(n, A, Q, 2 * h, Ad2, Qd2, scratch), DSE_OK);
        dse_sym_congruence(n, n, Ad, Qd, Qd, composed, scratch);
        const dse_real bound = 100 * (dse_real)n * EPS * (1 + dse_norm_max(n * n, Qd2));
        assert_all_near(n * n, Qd2, composed, bound);
        dse_mat_mul(n, n, n, Ad, Ad, composed);
        assert_all_near(n * n, Ad2, composed, bound);
        for (int i = 0; i < n; i++)
            for (int j = 0; j < i; j++)
                assert_true(Qd2[i * n + j] == Qd2[j * n + i]);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(expm_of_a_rotation_is_cosine_and_sine),
        cmocka_unit_test(expm_of_a_nilpotent_shift_is_its_finite_series),
        cmocka_unit_test(expm_of_the_negative_is_the_inverse),
        cmocka_unit_test(expm_of_the_double_is_the_square),
        cmocka_unit_test(expm_refuses_non_finite_input_and_reports_overflow),
        cmocka_unit_test(discretisation_of_a_double_integrator_is_exact),
        cmocka_unit_test(van_loan_of_a_double_integrator_is_exact),
        cmocka_unit_test(van_loan_stands_a_stiff_plant_over_a_long_step),
        cmocka_unit_test(van_loan_composes_over_two_halves),
    };
    return cmocka_run_group_tests_name("linalg_expm", tests, NULL, NULL);
}
