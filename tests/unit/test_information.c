/* Fusion in information form: against the covariance form, with singular covariances, with channels
 * missing, and what it refuses. */
#include "dse/information.h"

#include "dse/linalg.h"
#include "near.h"
#include "random_matrix.h"

enum { NX = 5, NY = 3, MOST = NX * NX };

/* S = G G' / columns + shift I, G n x columns. */
static void gram(int n, int columns, dse_real shift, dse_real *S)
{
    dse_real G[MOST];
    fill(n * columns, G);
    dse_mat_mul_nt(n, columns, n, G, G, S);
    for (int k = 0; k < n * n; k++)
        S[k] = S[k] / (dse_real)columns + (k % (n + 1) == 0 ? shift : 0);
}

struct problem {
    dse_real x[NX], P[NX * NX], C[NY * NX], R[NY * NY], y[NY];
};

static struct problem problem(int rank)
{
    struct problem p;
    fill(NX, p.x);
    fill(NY * NX, p.C);
    fill(NY, p.y);
    gram(NX, rank, 0, p.P);
    gram(NY, NY, DSE_REAL(0.1), p.R);
    return p;
}

/* K = P C'(C P C' + R)^-1, x + K (y - C x), Joseph's form; ny channels. */
static void covariance_form(int ny, const struct problem *p, const dse_real *C, const dse_real *R,
                            const dse_real *y, dse_real *x, dse_real *M)
{
    dse_real CP[NY * NX], S[NY * NY], K[NX * NY], J[NX * NX], KR[NX * NX], scratch[NX * NX];
    dse_mat_mul(ny, NX, NX, C, p->P, CP);
    dse_sym_congruence(ny, NX, C, p->P, R, S, scratch);
    assert_int_equal(dse_cholesky(ny, S, S), DSE_OK);
    dse_cholesky_solve(ny, S, NX, CP);
    dse_mat_transpose(ny, NX, CP, K);
    dse_mat_mul(NX, ny, NX, K, C, J);
    for (int k = 0; k < NX * NX; k++)
        J[k] = (dse_real)(k % (NX + 1) == 0) - J[k];
    dse_sym_congruence(NX, ny, K, R, NULL, KR, scratch);
    dse_sym_congruence(NX, NX, J, p->P, KR, M, scratch);
    for (int i = 0; i < NX; i++) {
        x[i] = p->x[i];
        for (int l = 0; l < ny; l++)
            x[i] += K[i * ny + l] * (y[l] - dse_dot(NX, C + l * NX, p->x));
    }
}

static enum dse_status information_of(const struct problem *p, const bool *valid, dse_real *u,
                                      dse_real *Y, int *used)
{
    dse_real scratch[DSE_INFORMATION_OF_SCRATCH(NX, NY)];
    const struct dse_measurement sample = {p->y, valid};
    return dse_information_of(NX, NY, p->C, p->R, &sample, u, Y, used, scratch);
}

/* ---- the same as the covariance form ---- */

static void information_form_is_the_covariance_form_also_where_P_is_singular(void **state)
{
    (void)state;
    for (int rank = 1; rank <= NX; rank++) {
        const struct problem p = problem(rank);
        dse_real u[NX], Y[NX * NX], x[NX], M[NX * NX], want_x[NX], want_M[NX * NX];
        dse_real scratch[DSE_INFORMATION_SCRATCH(NX)];
        int used = 0;
        assert_int_equal(information_of(&p, NULL, u, Y, &used), DSE_OK);
        assert_int_equal(used, NY);
        assert_int_equal(dse_information_update(NX, p.x, p.P, u, Y, x, M, scratch), DSE_OK);
        covariance_form(NY, &p, p.C, p.R, p.y, want_x, want_M);
        assert_agree(NX, x, want_x, TOLERANCE(1e-12, 1e-3));
        assert_agree(NX * NX, M, want_M, TOLERANCE(1e-12, 1e-3));
    }
}

/* A zero covariance knows everything: information changes nothing. */
static void without_uncertainty_nothing_is_learned(void **state)
{
    (void)state;
    struct problem p = problem(NX);
    dse_real u[NX], Y[NX * NX], x[NX], scratch[DSE_INFORMATION_SCRATCH(NX)];
    for (int k = 0; k < NX * NX; k++)
        p.P[k] = 0;
    assert_int_equal(information_of(&p, NULL, u, Y, NULL), DSE_OK);
    assert_int_equal(dse_information_update(NX, p.x, p.P, u, Y, x, p.P, scratch), DSE_OK);
    assert_all_near(NX, x, p.x, 0);
    assert_true(dse_norm_max(NX * NX, p.P) == 0);
}

static void channels_that_are_missing_or_not_finite_are_left_out(void **state)
{
    (void)state;
    const bool valid[NY] = {true, false, true};
    struct problem p = problem(NX);
    dse_real u[NX], Y[NX * NX], x[NX], M[NX * NX], want_x[NX], want_M[NX * NX];
    dse_real scratch[DSE_INFORMATION_SCRATCH(NX)];
    int used = 0;
    p.y[2] = dse_sqrt(-1); /* channel 0 is left, with the variance R_00 */
    assert_int_equal(information_of(&p, valid, u, Y, &used), DSE_OK);
    assert_int_equal(used, 1);
    assert_int_equal(dse_information_update(NX, p.x, p.P, u, Y, x, M, scratch), DSE_OK);
    covariance_form(1, &p, p.C, p.R, p.y, want_x, want_M);
    assert_agree(NX, x, want_x, TOLERANCE(1e-12, 1e-3));
    assert_agree(NX * NX, M, want_M, TOLERANCE(1e-12, 1e-3));
    p.y[0] = p.y[2];
    assert_int_equal(information_of(&p, valid, u, Y, &used), DSE_OK);
    assert_true(used == 0 && dse_norm_max(NX, u) == 0 && dse_norm_max(NX * NX, Y) == 0);
    assert_int_equal(dse_information_update(NX, p.x, p.P, u, Y, x, M, scratch), DSE_OK);
    assert_all_near(NX, x, p.x, 0);
    assert_agree(NX * NX, M, p.P, TOLERANCE(1e-14, 1e-5));
}

/* Independent sensors: the sum of what each knows is what all know. */
static void information_of_independent_sensors_adds_up(void **state)
{
    (void)state;
    struct problem p = problem(NX);
    dse_real u[NX], Y[NX * NX], sum_u[NX] = {0}, sum_Y[NX * NX] = {0};
    for (int r = 0; r < NY; r++)
        for (int c = 0; c < NY; c++)
            p.R[r * NY + c] = r == c ? (dse_real)(r + 1) : 0;
    for (int r = 0; r < NY; r++) {
        dse_real scratch[DSE_INFORMATION_OF_SCRATCH(NX, 1)];
        const struct dse_measurement one = {p.y + r, NULL};
        assert_int_equal(
            dse_information_of(NX, 1, p.C + r * NX, &p.R[r * NY + r], &one, u, Y, NULL, scratch),
            DSE_OK);
        dse_axpy(NX, 1, u, sum_u);
        dse_axpy(NX * NX, 1, Y, sum_Y);
    }
    assert_int_equal(information_of(&p, NULL, u, Y, NULL), DSE_OK);
    assert_agree(NX, u, sum_u, TOLERANCE(1e-14, 1e-5));
    assert_agree(NX * NX, Y, sum_Y, TOLERANCE(1e-14, 1e-5));
}

/* N^-1 = Q^-1 - Q^-1 A (M^-1 + A'Q^-1 A)^-1 A'Q^-1 (4.25), where Q has an inverse. */
static void inverse_time_update_is_the_plain_one_where_Q_has_an_inverse(void **state)
{
    (void)state;
    dse_real A[NX * NX], M[NX * NX], Q[NX * NX], N[NX * NX], scratch[NX * NX];
    dse_real Mi[NX * NX], Qi[NX * NX], inner[NX * NX], B[NX * NX], Ni[NX * NX], I[NX * NX];
    fill(NX * NX, A);
    gram(NX, NX, DSE_REAL(0.3), M);
    gram(NX, NX, DSE_REAL(0.3), Q);
    dse_sym_congruence(NX, NX, A, M, Q, N, scratch);
    dse_mat_identity(NX, Mi);
    dse_mat_identity(NX, Qi);
    assert_int_equal(dse_cholesky(NX, M, scratch), DSE_OK);
    dse_cholesky_solve(NX, scratch, NX, Mi);
    assert_int_equal(dse_cholesky(NX, Q, scratch), DSE_OK);
    dse_cholesky_solve(NX, scratch, NX, Qi);
    dse_mat_mul(NX, NX, NX, Qi, A, B); /* Q^-1 A */
    dse_mat_mul_tn(NX, NX, NX, A, B, inner);
    dse_axpy(NX * NX, 1, Mi, inner);
    assert_int_equal(dse_cholesky(NX, inner, inner), DSE_OK);
    dse_mat_transpose(NX, NX, B, scratch);
    dse_cholesky_solve(NX, inner, NX, scratch);
    dse_mat_mul(NX, NX, NX, B, scratch, Ni);
    for (int k = 0; k < NX * NX; k++)
        Ni[k] = Qi[k] - Ni[k];
    dse_mat_mul(NX, NX, NX, N, Ni, I);
    for (int k = 0; k < NX * NX; k++)
        assert_near(I[k], k % (NX + 1) == 0, TOLERANCE(1e-12, 1e-3));
}

/* ---- what it keeps ---- */

/* Variances from 1e-8 to 1e8, precise sensors: no result is ever less than semidefinite. */
static void covariances_stay_symmetric_and_semidefinite_over_sixteen_decades(void **state)
{
    (void)state;
    for (int trial = 0; trial < 200; trial++) {
        struct problem p = problem(NX);
        dse_real u[NX], Y[NX * NX], x[NX], M[NX * NX], scratch[DSE_INFORMATION_SCRATCH(NX)];
        for (int r = 0; r < NX; r++) {
            const dse_real scale = dse_pow(10, (dse_real)(trial % 9 - 4) * (dse_real)(r - 2) / 2);
            for (int c = 0; c < NX; c++) {
                p.P[r * NX + c] *= scale;
                p.P[c * NX + r] *= scale;
            }
        }
        for (int k = 0; k < NY * NY; k++)
            p.R[k] *= TOLERANCE(1e-8, 1e-3);
        assert_int_equal(information_of(&p, NULL, u, Y, NULL), DSE_OK);
        assert_int_equal(dse_information_update(NX, p.x, p.P, u, Y, x, M, scratch), DSE_OK);
        for (int r = 0; r < NX; r++) {
            assert_true(M[r * NX + r] >= 0);
            for (int c = 0; c < r; c++) {
                const dse_real m = M[r * NX + c];
                assert_true(m == M[c * NX + r]);
                assert_true(m * m <= M[r * NX + r] * M[c * NX + c] * (1 + 64 * DSE_REAL_EPSILON));
            }
        }
    }
}

/* P = p I and Y = c c', for which M = p I - p^2 c c' / (1 + p c'c): the directions across c keep p
 * although 1 is lost beside p c'c. */
static void precise_information_leaves_the_other_directions_alone(void **state)
{
    (void)state;
    const dse_real p = TOLERANCE(1e6, 1e3), size = TOLERANCE(1e5, 1e2);
    dse_real P[NX * NX] = {0}, Y[NX * NX], c[NX], want[NX * NX], M[NX * NX];
    dse_real x[NX] = {0}, u[NX] = {0}, scratch[DSE_INFORMATION_SCRATCH(NX)];
    for (int i = 0; i < NX; i++) {
        P[i * NX + i] = p;
        c[i] = size * (dse_real)(i + 1);
    }
    const dse_real cc = dse_dot(NX, c, c);
    for (int k = 0; k < NX * NX; k++) {
        const dse_real both = c[k / NX] * c[k % NX];
        Y[k] = both;
        want[k] = P[k] - p * (both / cc) * (p * cc / (1 + p * cc));
    }
    assert_int_equal(dse_information_update(NX, x, P, u, Y, x, M, scratch), DSE_OK);
    assert_agree(NX * NX, M, want, TOLERANCE(1e-7, 2e-3)); /* eps sqrt(p c'c) */
}

static void what_cannot_be_a_covariance_is_refused_and_nothing_changes(void **state)
{
    (void)state;
    struct problem p = problem(NX);
    dse_real u[NX], Y[NX * NX], x[NX] = {7}, M[NX * NX] = {7};
    dse_real scratch[DSE_INFORMATION_SCRATCH(NX)];
    assert_int_equal(information_of(&p, NULL, u, Y, NULL), DSE_OK);

    struct problem bad = p;
    bad.P[0] = -1;
    assert_int_equal(dse_information_update(NX, p.x, bad.P, u, Y, x, M, scratch), DSE_ENOTPD);
    dse_real negative[NX * NX];
    for (int k = 0; k < NX * NX; k++)
        negative[k] = k % (NX + 1) == 0 ? DSE_REAL(-1e6) : 0; /* P^-1 + Y is not positive */
    assert_int_equal(dse_information_update(NX, p.x, p.P, u, negative, x, M, scratch), DSE_ENOTPD);
    u[1] = dse_sqrt(-1);
    assert_int_equal(dse_information_update(NX, p.x, p.P, u, Y, x, M, scratch), DSE_ENONFINITE);
    assert_true(x[0] == 7 && M[0] == 7 && x[1] == 0);

    bad = p;
    bad.R[0] = 0;
    assert_int_equal(information_of(&bad, NULL, u, Y, NULL), DSE_ENOTPD);
    bad = p;
    bad.C[1] = dse_sqrt(-1);
    assert_int_equal(information_of(&bad, NULL, u, Y, NULL), DSE_ENONFINITE);
}

static void packed_matrices_come_back(void **state)
{
    (void)state;
    dse_real S[NX * NX], packed[DSE_SYM_PACKED(NX) + 1], back[NX * NX];
    gram(NX, NX, 0, S);
    packed[DSE_SYM_PACKED(NX)] = 7;
    dse_sym_pack(NX, S, packed);
    assert_true(packed[DSE_SYM_PACKED(NX)] == 7 && packed[1] == S[NX] && packed[2] == S[NX + 1]);
    dse_sym_unpack(NX, packed, back);
    dse_sym_enforce(NX, S);
    assert_agree(NX * NX, back, S, 2 * DSE_REAL_EPSILON);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(information_form_is_the_covariance_form_also_where_P_is_singular),
        cmocka_unit_test(without_uncertainty_nothing_is_learned),
        cmocka_unit_test(channels_that_are_missing_or_not_finite_are_left_out),
        cmocka_unit_test(information_of_independent_sensors_adds_up),
        cmocka_unit_test(inverse_time_update_is_the_plain_one_where_Q_has_an_inverse),
        cmocka_unit_test(covariances_stay_symmetric_and_semidefinite_over_sixteen_decades),
        cmocka_unit_test(precise_information_leaves_the_other_directions_alone),
        cmocka_unit_test(what_cannot_be_a_covariance_is_refused_and_nothing_changes),
        cmocka_unit_test(packed_matrices_come_back),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
