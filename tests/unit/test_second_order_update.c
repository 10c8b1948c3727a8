/* Second-order filter: the measurement update, health, and everything that can go wrong. */
#include <math.h>
#include <string.h>

#include "dse/linalg.h"
#include "dse/second_order.h"
#include "near.h"
#include "second_order_plants.h"

enum { STORAGE = DSE_SECOND_ORDER_STORAGE(NX, NX) };

static struct dse_model model;
static const dse_real w0[NX] = {2, 1, 3};
static const dse_real S0[NX * NX] = {2, 1, 0, 1, 3, DSE_REAL(-0.5), 0, DSE_REAL(-0.5), 1};
static const dse_real C[NX * NX] = {1, 1, 0, 1, 0, 1, 0, 2, -1};
/* correlated */
static const dse_real R[NX * NX] = {DSE_REAL(0.5), DSE_REAL(0.2),  0, DSE_REAL(0.2),
                                    DSE_REAL(0.4), DSE_REAL(-0.1), 0, DSE_REAL(-0.1),
                                    DSE_REAL(0.3)};

static struct dse_second_order_config three_channels(void)
{
    model = plant_model("quadratic_ex4");
    return (struct dse_second_order_config){
        .model = &model, .ny = NX, .C = C, .x0 = w0, .S0 = S0, .R = R};
}

static enum dse_status try_start(struct dse_second_order *filter,
                                 const struct dse_second_order_config *config)
{
    static dse_real memory[STORAGE];
    struct dse_arena arena;
    dse_arena_init(&arena, memory, STORAGE);
    return dse_second_order_init(filter, config, &arena);
}

static void start(struct dse_second_order *filter, const struct dse_second_order_config *config)
{
    assert_int_equal(try_start(filter, config), DSE_OK);
}

/* G = S C'(C S C' + R)^-1, x = w + G (y - C w), Sigma = S - G C S (3.59), for the first and the
 * last channel. */
static void a_missing_channel_leaves_the_gain_of_the_others(void **state)
{
    (void)state;
    static const dse_real C2[2 * NX] = {1, 1, 0, 0, 2, -1};
    static const dse_real R2[4] = {DSE_REAL(0.5), 0, 0, DSE_REAL(0.3)};
    static const dse_real y[NX] = {DSE_REAL(3.5), NAN, -2};
    const dse_real y2[2] = {y[0], y[2]};
    dse_real CS[2 * NX], V[4], G[2 * NX], x[NX], Sigma[NX * NX];
    dse_mat_mul(2, NX, NX, C2, S0, CS);
    dse_mat_mul_nt(2, NX, 2, CS, C2, V);
    for (int i = 0; i < 4; i++)
        V[i] += R2[i];
    memcpy(G, CS, sizeof G);
    assert_int_equal(dse_cholesky(2, V, V), DSE_OK);
    dse_cholesky_solve(2, V, NX, G); /* G' */
    memcpy(x, w0, sizeof x);
    memcpy(Sigma, S0, sizeof Sigma);
    for (int l = 0; l < 2; l++) {
        dse_axpy(NX, y2[l] - dse_dot(NX, C2 + l * NX, w0), G + l * NX, x);
        for (int i = 0; i < NX; i++)
            dse_axpy(NX, -G[l * NX + i], CS + l * NX, Sigma + i * NX);
    }
    const struct dse_second_order_config config = three_channels();
    struct dse_second_order filter;
    start(&filter, &config);
    const struct dse_measurement measurement = {y, NULL};
    assert_int_equal(dse_second_order_update(&filter, &measurement), DSE_OK);
    assert_agree(NX, dse_second_order_state(&filter), x, TOLERANCE(1e-13, 1e-5));
    assert_agree(NX * NX, dse_second_order_covariance(&filter), Sigma, TOLERANCE(1e-13, 1e-5));
    assert_int_equal(dse_second_order_used(&filter), 2);
    assert_near(dse_second_order_innovation(&filter)[0], y[0] - 3, TOLERANCE(1e-14, 1e-6));
    assert_near(dse_second_order_innovation(&filter)[1], 0, 0);
    assert_int_equal(dse_second_order_counts(&filter)->nonfinite, 1);
}

/* Correlated noises: the information form M = (S^-1 + C'R^-1 C)^-1 gives the same covariance. */
static void correlated_noises_count_as_such(void **state)
{
    (void)state;
    dse_real inverse[NX * NX], L[NX * NX], X[NX * NX], Y[NX * NX], M[NX * NX];
    dse_mat_identity(NX, inverse);
    assert_int_equal(dse_cholesky(NX, S0, L), DSE_OK);
    dse_cholesky_solve(NX, L, NX, inverse);
    memcpy(X, C, sizeof X);
    assert_int_equal(dse_cholesky(NX, R, L), DSE_OK);
    dse_lower_solve(NX, L, NX, X);
    dse_mat_mul_tn(NX, NX, NX, X, X, Y);
    for (int i = 0; i < NX * NX; i++)
        inverse[i] += Y[i];
    dse_mat_identity(NX, M);
    assert_int_equal(dse_cholesky(NX, inverse, L), DSE_OK);
    dse_cholesky_solve(NX, L, NX, M);
    const struct dse_second_order_config config = three_channels();
    struct dse_second_order filter;
    start(&filter, &config);
    const struct dse_measurement measurement = {w0, NULL};
    assert_int_equal(dse_second_order_update(&filter, &measurement), DSE_OK);
    assert_agree(NX * NX, dse_second_order_covariance(&filter), M, TOLERANCE(1e-13, 1e-5));
}

/* A measurement 1e12 (float: 1e5) times better than the prediction. */
static void the_covariance_stays_semidefinite_with_tiny_noise(void **state)
{
    (void)state;
    const dse_real tiny[1] = {TOLERANCE(1e-12, 1e-5)};
    dse_real Z[NX * NX], d[NX];
    struct dse_second_order_config config = three_channels();
    config.ny = 1;
    config.R = tiny;
    struct dse_second_order filter;
    start(&filter, &config);
    const dse_real y[1] = {3};
    const struct dse_measurement measurement = {y, NULL};
    for (int k = 1; k <= 30; k++) {
        assert_int_equal(dse_second_order_predict(&filter, DSE_REAL(0.1) * (dse_real)k, NULL),
                         DSE_OK);
        assert_int_equal(dse_second_order_update(&filter, &measurement), DSE_OK);
        const dse_real *S = dse_second_order_covariance(&filter);
        assert_int_equal(dse_semidefinite_rows(NX, NX, S, Z, d), DSE_OK);
        dse_real variance = 0;
        for (int i = 0; i < NX; i++)
            variance += C[i] * dse_dot(NX, S + i * NX, C);
        assert_true(variance <= 2 * tiny[0]);
    }
}

static void the_gate_refuses_an_outlier(void **state)
{
    (void)state;
    struct dse_second_order_config config = three_channels();
    config.gate = 4;
    struct dse_second_order filter;
    start(&filter, &config);
    /* standard deviations of the innovations: sqrt(7.5), sqrt(3.4), sqrt(15.3) */
    const dse_real y[NX] = {3 + DSE_REAL(4.01) * dse_sqrt(DSE_REAL(7.5)),
                            5 + DSE_REAL(3.99) * dse_sqrt(DSE_REAL(3.4)), -1};
    const struct dse_measurement measurement = {y, NULL};
    assert_int_equal(dse_second_order_update(&filter, &measurement), DSE_OK);
    assert_int_equal(dse_second_order_used(&filter), 2);
    assert_int_equal(dse_second_order_counts(&filter)->rejected, 1);
    assert_int_equal(dse_second_order_health(&filter), DSE_HEALTH_REJECTING);
}

static void health_says_what_the_estimate_stands_on(void **state)
{
    (void)state;
    const struct dse_second_order_config config = three_channels();
    struct dse_second_order filter;
    static const bool none[NX] = {false};
    const struct dse_measurement good = {w0, NULL}, missing = {w0, none};
    start(&filter, &config);
    assert_int_equal(dse_second_order_health(&filter), DSE_HEALTH_INITIALISING);
    assert_int_equal(dse_second_order_update(&filter, &missing), DSE_OK);
    assert_int_equal(dse_second_order_health(&filter), DSE_HEALTH_INITIALISING);
    assert_int_equal(dse_second_order_update(&filter, &good), DSE_OK);
    assert_int_equal(dse_second_order_health(&filter), DSE_HEALTH_TRACKING);
    assert_int_equal(dse_second_order_predict(&filter, 1, NULL), DSE_OK);
    assert_int_equal(dse_second_order_health(&filter), DSE_HEALTH_TRACKING);
    assert_int_equal(dse_second_order_predict(&filter, 2, NULL), DSE_OK);
    assert_int_equal(dse_second_order_health(&filter), DSE_HEALTH_COASTING);
    assert_int_equal(dse_second_order_update(&filter, &missing), DSE_OK);
    assert_int_equal(dse_second_order_health(&filter), DSE_HEALTH_COASTING);
    assert_int_equal(dse_second_order_counts(&filter)->missing, 2 * NX);
    assert_int_equal(dse_second_order_counts(&filter)->used, NX);
}

static void a_step_that_fails_changes_nothing(void **state)
{
    (void)state;
    struct dse_second_order_config config = three_channels();
    config.max_steps = 2;
    struct dse_second_order filter;
    start(&filter, &config);
    dse_real S[NX * NX];
    memcpy(S, dse_second_order_covariance(&filter), sizeof S);
    const struct {
        dse_real t;
        enum dse_status status;
    } cases[] = {{-1, DSE_EINVAL}, {NAN, DSE_EINVAL}, {INFINITY, DSE_EINVAL}, {50, DSE_ENOCONV}};
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++) {
        assert_int_equal(dse_second_order_predict(&filter, cases[c].t, NULL), cases[c].status);
        assert_int_equal(dse_second_order_health(&filter), DSE_HEALTH_DIVERGED);
        assert_all_near(NX, dse_second_order_state(&filter), w0, 0);
        assert_all_near(NX * NX, dse_second_order_covariance(&filter), S, 0);
        assert_near(dse_second_order_time(&filter), 0, 0);
    }
    const dse_real huge[NX] = {DSE_REAL_MAX, -DSE_REAL_MAX, DSE_REAL_MAX};
    const struct dse_measurement measurement = {huge, NULL};
    assert_int_equal(dse_second_order_update(&filter, &measurement), DSE_ENONFINITE);
    assert_all_near(NX, dse_second_order_state(&filter), w0, 0);
    assert_int_equal(dse_second_order_counts(&filter)->failed, 5);
    const struct dse_measurement good = {w0, NULL};
    assert_int_equal(dse_second_order_update(&filter, &good), DSE_OK);
    assert_int_equal(dse_second_order_health(&filter), DSE_HEALTH_TRACKING);
}

/* A state from which no step is short enough. */
static void a_hopeless_prediction_ends(void **state)
{
    (void)state;
    struct dse_second_order_config config = three_channels();
    const dse_real far[NX] = {TOLERANCE(1e200, 1e25), 1, 1};
    config.x0 = far;
    for (config.substeps = 0; config.substeps < 20; config.substeps += 10) {
        struct dse_second_order filter;
        start(&filter, &config);
        const enum dse_status status = dse_second_order_predict(&filter, 1, NULL);
        assert_true(status == DSE_ENOCONV || status == DSE_ENONFINITE);
        assert_all_near(NX, dse_second_order_state(&filter), far, 0);
    }
}

static void an_estimate_can_be_set_anew(void **state)
{
    (void)state;
    static const dse_real indefinite[NX * NX] = {1, 2, 0, 2, 1, 0, 0, 0, 1};
    static const dse_real skew[NX * NX] = {1, 1, 0, 0, 1, 0, 0, 0, 1};
    static const dse_real x[NX] = {-1, 0, 1}, broken[NX] = {0, NAN, 0};
    const struct dse_second_order_config config = three_channels();
    struct dse_second_order filter;
    start(&filter, &config);
    assert_int_equal(dse_second_order_set(&filter, 5, x, indefinite), DSE_ENOTPD);
    assert_int_equal(dse_second_order_set(&filter, 5, x, skew), DSE_EINVAL);
    assert_int_equal(dse_second_order_set(&filter, 5, broken, NULL), DSE_ENONFINITE);
    assert_int_equal(dse_second_order_set(&filter, NAN, x, NULL), DSE_ENONFINITE);
    assert_all_near(NX, dse_second_order_state(&filter), w0, 0);
    assert_int_equal(dse_second_order_set(&filter, 5, x, NULL), DSE_OK);
    assert_all_near(NX, dse_second_order_state(&filter), x, 0);
    assert_agree(NX * NX, dse_second_order_covariance(&filter), S0, TOLERANCE(1e-14, 1e-6));
    assert_int_equal(dse_second_order_set(&filter, 6, w0, unit_covariance), DSE_OK);
    assert_all_near(NX * NX, dse_second_order_covariance(&filter), unit_covariance, 0);
    assert_near(dse_second_order_time(&filter), 6, 0);
}

/* ---- configuration ---- */

static void what_makes_no_filter_is_refused(void **state)
{
    (void)state;
    static const dse_real negative[NX * NX] = {-1, 0, 0, 0, 1, 0, 0, 0, 1};
    static const dse_real broken[NX * NX] = {NAN, 0, 0, 0, 1, 0, 0, 0, 1};
    static const dse_real no_noise[NX * NX] = {0};
    const struct dse_linear linear = {.A = S0, .C = C};
    struct dse_model other;
    dse_linear_model(&other, DSE_CONTINUOUS, NX, 0, NX, &linear);
    struct dse_second_order_config cases[16];
    for (int c = 0; c < 16; c++)
        cases[c] = three_channels();
    enum dse_status want[16] = {0};
    int n = 0;
    cases[n].model = NULL, want[n++] = DSE_EINVAL;
    cases[n].model = &other, want[n++] = DSE_EINVAL;
    cases[n].ny = -1, want[n++] = DSE_EINVAL;
    cases[n].kind = (enum dse_second_order_kind)3, want[n++] = DSE_EINVAL;
    cases[n].S0 = NULL, want[n++] = DSE_EINVAL;
    cases[n].R = NULL, want[n++] = DSE_EINVAL;
    cases[n].gate = -1, want[n++] = DSE_EINVAL;
    cases[n].rtol = NAN, want[n++] = DSE_EINVAL;
    cases[n].substeps = -1, want[n++] = DSE_EINVAL;
    cases[n].t0 = INFINITY, want[n++] = DSE_EINVAL;
    cases[n].S0 = negative, want[n++] = DSE_ENOTPD;
    cases[n].Q = negative, want[n++] = DSE_ENOTPD;
    cases[n].R = no_noise, want[n++] = DSE_ENOTPD;
    cases[n].Q = broken, want[n++] = DSE_ENONFINITE;
    cases[n].C = broken, want[n++] = DSE_ENONFINITE;
    cases[n].x0 = broken, want[n++] = DSE_ENONFINITE;
    for (int c = 0; c < n; c++) {
        struct dse_second_order filter;
        if (try_start(&filter, &cases[c]) != want[c])
            fail_msg("case %d", c);
    }
}

static void storage_is_what_it_says(void **state)
{
    (void)state;
    static dse_real memory[STORAGE];
    const struct dse_second_order_config config = three_channels();
    struct dse_second_order filter;
    struct dse_arena arena;
    dse_arena_init(&arena, memory, STORAGE - 1);
    assert_int_equal(dse_second_order_init(&filter, &config, &arena), DSE_ESTORAGE);
    dse_arena_init(&arena, memory, STORAGE);
    assert_int_equal(dse_second_order_init(&filter, &config, &arena), DSE_OK);
    assert_int_equal(arena.used, STORAGE);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_missing_channel_leaves_the_gain_of_the_others),
        cmocka_unit_test(correlated_noises_count_as_such),
        cmocka_unit_test(the_covariance_stays_semidefinite_with_tiny_noise),
        cmocka_unit_test(the_gate_refuses_an_outlier),
        cmocka_unit_test(health_says_what_the_estimate_stands_on),
        cmocka_unit_test(a_step_that_fails_changes_nothing),
        cmocka_unit_test(a_hopeless_prediction_ends),
        cmocka_unit_test(an_estimate_can_be_set_anew),
        cmocka_unit_test(what_makes_no_filter_is_refused),
        cmocka_unit_test(storage_is_what_it_says),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
