/* Factorisation within an envelope: the numbers of the dense one, without touching what is outside.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

#include "dse/linalg.h"
#include "near.h"
#include "random_matrix.h"

enum { MOST = 40 };

static dse_real A[MOST * MOST], U[MOST * MOST], L[MOST * MOST];
static int last[MOST];

/* Ends that never decrease: diagonal, full, and random ones. */
static void make_envelope(int kind, int n)
{
    int end = 0;
    for (int k = 0; k < n; k++) {
        const int here = k + (int)(5 * (1 + (double)uniform()) / 2);
        end = kind == 0 ? k : kind == 1 ? n - 1 : here > end ? here : end;
        last[k] = end < n ? end : n - 1;
    }
}

/* Symmetric, dominated by its diagonal, zero outside of the envelope. */
static void make_matrix(int n)
{
    memset(A, 0, sizeof A);
    for (int k = 0; k < n; k++) {
        A[k * n + k] = (dse_real)(n + 1);
        for (int j = k + 1; j <= last[k]; j++)
            A[k * n + j] = A[j * n + k] = uniform();
    }
}

static void the_factor_is_the_dense_one_bit_for_bit(void **state)
{
    (void)state;
    random_state = 1;
    for (int n = 1; n <= MOST; n++) {
        for (int kind = 0; kind < 4; kind++) {
            make_envelope(kind, n);
            make_matrix(n);
            assert_int_equal(dse_cholesky(n, A, L), DSE_OK);
            assert_int_equal(dse_envelope_cholesky(n, last, A, U), DSE_OK);
            for (int k = 0; k < n; k++)
                for (int j = k; j <= last[k]; j++)
                    assert_memory_equal(&U[k * n + j], &L[j * n + k], sizeof U[0]);
        }
    }
}

static void what_is_outside_of_the_envelope_is_neither_read_nor_written(void **state)
{
    (void)state;
    random_state = 2;
    const int n = 30;
    make_envelope(2, n);
    make_matrix(n);
    assert_int_equal(dse_envelope_cholesky(n, last, A, U), DSE_OK);
    for (int k = 0; k < n; k++)
        for (int j = 0; j < n; j++)
            if (j < k || j > last[k])
                A[k * n + j] = (dse_real)NAN;
    assert_int_equal(dse_envelope_cholesky(n, last, A, A), DSE_OK); /* in place */
    for (int k = 0; k < n; k++)
        for (int j = 0; j < n; j++)
            assert_true(j < k || j > last[k] ? isnan((double)A[k * n + j])
                                             : A[k * n + j] == U[k * n + j]);
    dse_real b[MOST];
    fill(n, b);
    dse_envelope_solve(n, last, A, b);
    assert_true(dse_all_finite(b, n));
}

static void the_solution_satisfies_the_equations(void **state)
{
    (void)state;
    random_state = 3;
    for (int n = 1; n <= MOST; n += 3) {
        dse_real b[MOST], x[MOST], Ax[MOST];
        make_envelope(3, n);
        make_matrix(n);
        fill(n, b);
        memcpy(x, b, sizeof x);
        assert_int_equal(dse_envelope_cholesky(n, last, A, U), DSE_OK);
        dse_envelope_solve(n, last, U, x);
        dse_mat_vec(n, n, A, x, Ax);
        for (int i = 0; i < n; i++)
            assert_true(fabs((double)(Ax[i] - b[i])) <= 20 * (double)DSE_REAL_EPSILON);
    }
}

static void a_pivot_that_is_not_positive_is_refused(void **state)
{
    (void)state;
    const int full[2] = {1, 1};
    const dse_real cases[][4] = {
        {1, 2, 0, 1}, {0, 0, 0, 1}, {-1, 0, 0, 1}, {1, 1, 0, 1}, {(dse_real)NAN, 0, 0, 1}};
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++)
        assert_int_equal(dse_envelope_cholesky(2, full, cases[c], U), DSE_ENOTPD);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_factor_is_the_dense_one_bit_for_bit),
        cmocka_unit_test(what_is_outside_of_the_envelope_is_neither_read_nor_written),
        cmocka_unit_test(the_solution_satisfies_the_equations),
        cmocka_unit_test(a_pivot_that_is_not_positive_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
