/* Quadratic systems: terms, model, Jacobian, trace and the certificate of stability. */
#include <math.h>

#include "dse/quadratic.h"
#include "dse/random.h"
#include "near.h"

#define N 3

/* Example 4 (4.56): x1' = -x1 - x1 x2, x2' = -x3 + x1^2, x3' = x2, with F_1 as printed, not
 * symmetric. */
static const dse_real A[N * N] = {-1, 0, 0, 0, 0, -1, 0, 1, 0};
static const dse_real F[N * N * N] = {0, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0,
                                      0, 0, 0, 0,  0, 0, 0, 0, 0, 0, 0, 0, 0};
static const dse_real C[N] = {1, 1, 0};
static const dse_real x[N] = {2, 3, -5};

static struct dse_quadratic example(struct dse_quadratic_term *term, int capacity)
{
    struct dse_quadratic system = {.A = A, .C = C, .term = term};
    system.terms = dse_quadratic_terms(N, F, capacity, term);
    return system;
}

static void forms_become_symmetric_terms(void **state)
{
    (void)state;
    struct dse_quadratic_term term[2];
    const struct dse_quadratic system = example(term, 2);
    assert_int_equal(system.terms, 2);
    assert_true(term[0].k == 0 && term[0].i == 0 && term[0].j == 1 && term[0].value == -1);
    assert_true(term[1].k == 1 && term[1].i == 0 && term[1].j == 0 && term[1].value == 1);
    assert_int_equal(dse_quadratic_terms(N, F, 1, term), 2);
}

static void the_model_is_the_printed_equations(void **state)
{
    (void)state;
    const dse_real d[N] = {DSE_REAL(0.5), 0, -1}, B[N] = {0, 2, 0}, u[1] = {4};
    struct dse_quadratic_term term[2];
    struct dse_quadratic system = example(term, 2);
    system.d = d;
    system.B = B;
    struct dse_model model;
    dse_quadratic_model(&model, N, 1, 1, &system);
    dse_real dx[N], y[1];
    assert_int_equal(model.f(&model, 0, x, u, dx), DSE_OK);
    const dse_real want[N] = {-2 - 6 + DSE_REAL(0.5), 5 + 4 + 8, 3 - 1};
    assert_all_near(N, dx, want, 0);
    assert_int_equal(model.h(&model, 0, x, u, y), DSE_OK);
    assert_near(y[0], 5, 0);
}

static void the_jacobian_is_that_of_the_equations(void **state)
{
    (void)state;
    struct dse_quadratic_term term[2];
    const struct dse_quadratic system = example(term, 2);
    struct dse_model model;
    dse_quadratic_model(&model, N, 0, 1, &system);
    dse_real scratch[DSE_MODEL_CHECK_SCRATCH(N, 1)], worst_f = 1, worst_h = 1;
    assert_int_equal(dse_model_check_jacobians(&model, 0, x, NULL, scratch, &worst_f, &worst_h),
                     DSE_OK);
    assert_near(worst_f, 0, TOLERANCE(1e-6, 1e-2));
    assert_near(worst_h, 0, TOLERANCE(1e-6, 1e-2));
}

/* tr(F_k S) for dense, random F and S. */
static void the_trace_term_is_that_of_the_dense_forms(void **state)
{
    (void)state;
    struct dse_random random;
    dse_random_init(&random, 1, 0);
    dse_real dense[N * N * N], S[N * N];
    for (int i = 0; i < N * N * N; i++)
        dense[i] = (dse_real)dse_random_normal(&random);
    for (int i = 0; i < N; i++)
        for (int j = 0; j <= i; j++)
            S[i * N + j] = S[j * N + i] = (dse_real)dse_random_normal(&random);
    struct dse_quadratic_term term[DSE_QUADRATIC_MAX_TERMS(N)];
    const struct dse_quadratic system = {
        .A = A,
        .terms = dse_quadratic_terms(N, dense, DSE_QUADRATIC_MAX_TERMS(N), term),
        .term = term};
    dse_real got[N] = {0}, want[N] = {0}, sum[N] = {0}, form[N] = {0};
    dse_quadratic_add_trace(N, &system, S, got);
    dse_quadratic_add(&system, x, sum);
    for (int k = 0; k < N; k++)
        for (int i = 0; i < N; i++)
            for (int j = 0; j < N; j++) {
                want[k] += dense[(k * N + i) * N + j] * S[j * N + i];
                form[k] += dense[(k * N + i) * N + j] * x[i] * x[j];
            }
    assert_all_near(N, got, want, TOLERANCE(1e-13, 1e-4));
    assert_all_near(N, sum, form, TOLERANCE(1e-12, 1e-3));
}

static void the_thesis_example_is_certified_stable(void **state)
{
    (void)state;
    struct dse_quadratic_term term[2];
    const struct dse_quadratic system = example(term, 2);
    struct dse_quadratic_certificate certificate;
    dse_real scratch[DSE_QUADRATIC_CERTIFICATE_SCRATCH(N)];
    assert_int_equal(dse_quadratic_certify(N, &system, &certificate, scratch), DSE_OK);
    assert_true(certificate.dissipative);
    assert_true(certificate.lossless);
    assert_near(certificate.cubic, 0, 0);
}

static void what_breaks_either_property_is_noticed(void **state)
{
    (void)state;
    struct dse_quadratic_term term[2];
    struct dse_quadratic system = example(term, 2);
    struct dse_quadratic_certificate certificate;
    dse_real scratch[DSE_QUADRATIC_CERTIFICATE_SCRATCH(N)];
    term[1].value = 2; /* x1^2 (-x2) + 2 x2 x1^2 = x1^2 x2 */
    assert_int_equal(dse_quadratic_certify(N, &system, &certificate, scratch), DSE_OK);
    assert_true(certificate.dissipative);
    assert_false(certificate.lossless);
    assert_near(certificate.cubic, DSE_REAL(0.5), 0);
    dse_real growing[N * N];
    for (int i = 0; i < N * N; i++)
        growing[i] = A[i];
    growing[8] = DSE_REAL(1e-3);
    system.A = growing;
    assert_int_equal(dse_quadratic_certify(N, &system, &certificate, scratch), DSE_OK);
    assert_false(certificate.dissipative);
}

static void faults_have_their_code(void **state)
{
    (void)state;
    struct dse_quadratic_term term[2];
    struct dse_quadratic system = example(term, 2);
    assert_int_equal(dse_quadratic_check(N, 0, 1, &system), DSE_OK);
    term[0].j = N;
    assert_int_equal(dse_quadratic_check(N, 0, 1, &system), DSE_EINVAL);
    term[0].j = 1;
    term[0].i = 2;
    assert_int_equal(dse_quadratic_check(N, 0, 1, &system), DSE_EINVAL);
    term[0].i = 0;
    term[0].value = (dse_real)NAN;
    assert_int_equal(dse_quadratic_check(N, 0, 1, &system), DSE_ENONFINITE);
    term[0].value = -1;
    assert_int_equal(dse_quadratic_check(N, 1, 1, &system), DSE_EINVAL); /* no B */
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(forms_become_symmetric_terms),
        cmocka_unit_test(the_model_is_the_printed_equations),
        cmocka_unit_test(the_jacobian_is_that_of_the_equations),
        cmocka_unit_test(the_trace_term_is_that_of_the_dense_forms),
        cmocka_unit_test(the_thesis_example_is_certified_stable),
        cmocka_unit_test(what_breaks_either_property_is_noticed),
        cmocka_unit_test(faults_have_their_code),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
