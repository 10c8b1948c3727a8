/* Second-order filter alone: what the source claims of it, and what its predictions promise. */
#include <math.h>
#include <string.h>

#include "dse/ekf.h"
#include "dse/linalg.h"
#include "dse/second_order.h"
#include "near.h"
#include "second_order_plants.h"

enum { STORAGE = DSE_SECOND_ORDER_STORAGE(NX, NX) };

static struct dse_model model;
static const dse_real R_source[4] = {DSE_REAL(0.01), 0, 0, DSE_REAL(0.01)}; /* 1 or 2 outputs */
static const char *const examples[] = {"quadratic_ex3", "quadratic_ex4"};

static void start(struct dse_second_order *filter, const struct dse_second_order_config *config)
{
    static dse_real memory[STORAGE];
    struct dse_arena arena;
    dse_arena_init(&arena, memory, STORAGE);
    assert_int_equal(dse_second_order_init(filter, config, &arena), DSE_OK);
}

static dse_real energy(const struct dse_second_order *filter)
{
    const dse_real *w = dse_second_order_state(filter), *S = dse_second_order_covariance(filter);
    dse_real sum = dse_dot(NX, w, w);
    for (int i = 0; i < NX; i++)
        sum += S[i * NX + i];
    return sum;
}

/* ---- claims of the source ---- */

/* T1; x3 gets no information: its error is 3 exp(-t) to the last digit. */
static void example_3_is_followed_though_x3_is_not_observed(void **state)
{
    (void)state;
    static const dse_real w0[NX] = {2, 1, 4};
    model = plant_model("quadratic_ex3");
    const struct dse_second_order_config config = {
        .model = &model, .x0 = w0, .S0 = unit_covariance, .R = R_source};
    struct dse_second_order filter;
    struct dse_random random;
    start(&filter, &config);
    dse_random_init(&random, 7, 0);
    dse_real x[NX];
    memcpy(x, plant_start, sizeof x);
    for (int k = 1; k <= 10; k++) {
        plant_second(&model, x);
        const dse_real y = x[0] + DSE_REAL(0.1) * (dse_real)dse_random_normal(&random);
        const struct dse_measurement measurement = {&y, NULL};
        assert_int_equal(dse_second_order_predict(&filter, (dse_real)k, NULL), DSE_OK);
        assert_int_equal(dse_second_order_update(&filter, &measurement), DSE_OK);
        const dse_real *w = dse_second_order_state(&filter);
        assert_near(w[2] - x[2], 3 * dse_exp((dse_real)-k), TOLERANCE(1e-7, 1e-4));
    }
    assert_all_near(2, dse_second_order_state(&filter), x, TOLERANCE(1e-3, 1e-3));
    assert_int_equal(dse_second_order_health(&filter), DSE_HEALTH_TRACKING);
}

/* T2: x1 -> 0, (x2, x3) turns on with an amplitude of 2.259. */
static void example_4_ends_in_an_oscillation(void **state)
{
    (void)state;
    model = plant_model("quadratic_ex4");
    dse_real x[NX], before[NX];
    memcpy(x, plant_start, sizeof x);
    for (int k = 0; k < 60; k++) {
        memcpy(before, x, sizeof x);
        plant_second(&model, x);
    }
    assert_near(x[0], 0, DSE_REAL(1e-6));
    assert_near(dse_norm2(2, x + 1), DSE_REAL(2.259), DSE_REAL(1e-3));
    const dse_real turned = (before[1] * x[1] + before[2] * x[2]) / dse_dot(2, x + 1, x + 1);
    assert_near(turned, dse_cos(1), TOLERANCE(1e-6, 1e-4));
}

/* ---- the predictor ---- */

/* d/dt(|w|^2 + tr S) = w'(A + A')w + tr((A + A')S): the quadratic terms cancel. */
static void quadratic_terms_cancel_in_the_rate_of_energy(void **state)
{
    (void)state;
    struct dse_random random;
    dse_random_init(&random, 3, 0);
    for (int trial = 0; trial < 20; trial++) {
        model = plant_model(examples[trial % 2]);
        const struct dse_quadratic *system = dse_quadratic_of(&model);
        dse_real w[NX], S[NX * NX], dw[NX], J[NX * NX], rate = 0, linear = 0, size = 0;
        for (int i = 0; i < NX; i++)
            w[i] = 3 * (dse_real)dse_random_normal(&random);
        random_covariance(&random, 2, S);
        model.f(&model, 0, w, NULL, dw);
        model.dfdx(&model, 0, w, NULL, J);
        dse_quadratic_add_trace(NX, system, S, dw);
        for (int i = 0; i < NX; i++) {
            rate += 2 * w[i] * dw[i];
            for (int j = 0; j < NX; j++) {
                rate += 2 * J[i * NX + j] * S[j * NX + i];
                linear += 2 * system->A[i * NX + j] * (w[i] * w[j] + S[j * NX + i]);
                size += dse_abs(J[i * NX + j] * S[j * NX + i]);
            }
        }
        assert_near(rate, linear, 100 * size * DSE_REAL_EPSILON);
    }
}

static void energy_never_grows_between_samples(void **state)
{
    (void)state;
    struct dse_random random;
    dse_random_init(&random, 4, 0);
    for (int trial = 0; trial < 16; trial++) {
        model = plant_model(examples[trial % 2]);
        dse_real w0[NX], S0[NX * NX];
        for (int i = 0; i < NX; i++)
            w0[i] = 5 * (dse_real)dse_random_normal(&random);
        random_covariance(&random, 10, S0);
        const struct dse_second_order_config config = {
            .model = &model, .x0 = w0, .S0 = S0, .R = R_source, .substeps = trial < 8 ? 0 : 3};
        struct dse_second_order filter;
        start(&filter, &config);
        for (int k = 1; k <= 10; k++) {
            const dse_real before = energy(&filter);
            assert_int_equal(dse_second_order_predict(&filter, DSE_REAL(0.3) * (dse_real)k, NULL),
                             DSE_OK);
            assert_true(energy(&filter) <= before * (1 + TOLERANCE(1e-6, 1e-3)));
        }
    }
}

/* Without the trace term nothing controls tr S. */
static void the_extended_filter_lacks_that_bound(void **state)
{
    (void)state;
    static const dse_real w0[NX] = {0, -8, 0};
    static const dse_real S0[NX * NX] = {100, 0, 0, 0, 100, 0, 0, 0, 100};
    model = plant_model("quadratic_ex3");
    struct dse_second_order_config config = {.model = &model, .x0 = w0, .S0 = S0, .R = R_source};
    dse_real grown[2];
    for (int kind = 0; kind < 2; kind++) {
        config.kind = kind == 0 ? DSE_SECOND_ORDER : DSE_SECOND_ORDER_EXTENDED;
        struct dse_second_order filter;
        start(&filter, &config);
        const dse_real before = energy(&filter);
        assert_int_equal(dse_second_order_predict(&filter, DSE_REAL(0.2), NULL), DSE_OK);
        grown[kind] = energy(&filter) / before;
    }
    assert_true(grown[0] <= 1);
    assert_true(grown[1] > DSE_REAL(1.01));
}

/* A coarse Runge-Kutta step after a bad update is where NaN came from; the guard halves it. */
static void coarse_steps_are_halved_before_they_blow_up(void **state)
{
    (void)state;
    static const dse_real w0[NX] = {60, -40, 30};
    dse_real S0[NX * NX], plain[NX], scratch[DSE_RK4_SCRATCH(NX)];
    model = plant_model("quadratic_ex4");
    memcpy(plain, w0, sizeof plain);
    bool blew_up = false;
    for (int s = 0; s < 5; s++)
        blew_up = dse_rk4_model_step(&model, 0, DSE_REAL(0.2), NULL, plain, scratch) != DSE_OK ||
                  dse_norm2(NX, plain) > DSE_REAL(1e3) || blew_up;
    assert_true(blew_up);

    for (int i = 0; i < NX * NX; i++)
        S0[i] = 4 * unit_covariance[i];
    struct dse_second_order_config config = {
        .model = &model, .x0 = w0, .S0 = S0, .R = R_source, .substeps = 5};
    struct dse_second_order filter;
    start(&filter, &config);
    assert_int_equal(dse_second_order_predict(&filter, 1, NULL), DSE_OK);
    assert_true(dse_second_order_counts(&filter)->halved > 0);
    dse_real guarded[NX];
    memcpy(guarded, dse_second_order_state(&filter), sizeof guarded);
    config.substeps = 0;
    start(&filter, &config);
    assert_int_equal(dse_second_order_predict(&filter, 1, NULL), DSE_OK);
    assert_agree(NX, guarded, dse_second_order_state(&filter), TOLERANCE(1e-3, 1e-2));
}

/* Without Q S decays, in places to denormals and to 0; nothing ever needs its inverse. */
static void a_covariance_that_decays_to_nothing_stops_nobody(void **state)
{
    (void)state;
    static const dse_real w0[NX] = {4, 3, 2};
    static const dse_real C[NX] = {1, 1, 0};
    model = plant_model("quadratic_ex4");
    const struct dse_second_order_config config = {
        .model = &model, .ny = 1, .C = C, .x0 = w0, .S0 = unit_covariance, .R = R_source};
    struct dse_second_order filter;
    struct dse_random random;
    start(&filter, &config);
    dse_random_init(&random, 9, 0);
    dse_real x[NX];
    memcpy(x, plant_start, sizeof x);
    for (int k = 1; k <= 900; k++) {
        plant_second(&model, x);
        const dse_real y = x[0] + x[1] + DSE_REAL(0.1) * (dse_real)dse_random_normal(&random);
        const struct dse_measurement measurement = {&y, NULL};
        assert_int_equal(dse_second_order_predict(&filter, (dse_real)k, NULL), DSE_OK);
        assert_int_equal(dse_second_order_update(&filter, &measurement), DSE_OK);
    }
    assert_true(dse_second_order_covariance(&filter)[0] < DSE_REAL_MIN);
    assert_all_near(NX, dse_second_order_state(&filter), x, TOLERANCE(0.05, 0.05));
}

/* ---- the baselines ---- */

/* The same kind of filter in two places of the library. */
static void the_extended_kind_is_the_extended_kalman_filter(void **state)
{
    (void)state;
    static const dse_real w0[NX] = {2, 1, 3};
    static const dse_real R2[4] = {DSE_REAL(0.02), DSE_REAL(0.01), DSE_REAL(0.01), DSE_REAL(0.03)};
    static const dse_real Q[NX * NX] = {DSE_REAL(0.01), 0, 0, 0, 0, 0, 0, 0, DSE_REAL(0.02)};
    static dse_real memory[DSE_EKF_STORAGE_CONTINUOUS(NX, 2)];
    model = plant_model("quadratic_ex4");
    const struct dse_second_order_config config = {.model = &model,
                                                   .kind = DSE_SECOND_ORDER_EXTENDED,
                                                   .x0 = w0,
                                                   .S0 = unit_covariance,
                                                   .Q = Q,
                                                   .R = R2};
    const struct dse_ekf_config other = {
        .model = &model, .x0 = w0, .P0 = unit_covariance, .Q = Q, .R = R2, .panels = 40};
    struct dse_second_order filter;
    struct dse_ekf ekf;
    struct dse_arena arena;
    start(&filter, &config);
    dse_arena_init(&arena, memory, DSE_EKF_STORAGE_CONTINUOUS(NX, 2));
    assert_int_equal(dse_ekf_init(&ekf, &other, &arena), DSE_OK);
    static const dse_real y[2] = {DSE_REAL(0.3), DSE_REAL(2.1)};
    const struct dse_measurement measurement = {y, NULL};
    dse_real P[NX * NX];
    for (int k = 1; k <= 3; k++) {
        const dse_real t = DSE_REAL(0.7) * (dse_real)k;
        assert_int_equal(dse_second_order_predict(&filter, t, NULL), DSE_OK);
        assert_int_equal(dse_second_order_update(&filter, &measurement), DSE_OK);
        assert_int_equal(dse_ekf_predict(&ekf, t, NULL), DSE_OK);
        assert_int_equal(dse_ekf_update(&ekf, t, NULL, &measurement), DSE_OK);
    }
    dse_ekf_covariance(&ekf, P);
    assert_agree(NX, dse_second_order_state(&filter), dse_ekf_state(&ekf), TOLERANCE(1e-7, 1e-3));
    assert_agree(NX * NX, dse_second_order_covariance(&filter), P, TOLERANCE(1e-7, 1e-3));
}

/* The mean moves by f + trace at first: points see the trace term, the extended filter does not. */
static void unscented_points_see_the_trace_term(void **state)
{
    (void)state;
    static const dse_real w0[NX] = {1, DSE_REAL(-0.5), 2};
    dse_real S0[NX * NX], moved[3][NX];
    struct dse_random random;
    dse_random_init(&random, 5, 0);
    random_covariance(&random, 1, S0);
    model = plant_model("quadratic_ex4");
    const dse_real h = TOLERANCE(1e-3, 1e-2);
    for (int kind = 0; kind < 3; kind++) {
        const struct dse_second_order_config config = {.model = &model,
                                                       .kind = (enum dse_second_order_kind)kind,
                                                       .x0 = w0,
                                                       .S0 = S0,
                                                       .R = R_source};
        struct dse_second_order filter;
        start(&filter, &config);
        assert_int_equal(dse_second_order_predict(&filter, h, NULL), DSE_OK);
        memcpy(moved[kind], dse_second_order_state(&filter), sizeof moved[kind]);
    }
    assert_all_near(NX, moved[DSE_SECOND_ORDER_UNSCENTED], moved[DSE_SECOND_ORDER], 100 * h * h);
    const dse_real trace = dse_abs(S0[0]) + dse_abs(S0[1]);
    assert_true(dse_norm_max(NX, moved[DSE_SECOND_ORDER]) > 0);
    dse_real apart = 0;
    for (int i = 0; i < NX; i++)
        apart += dse_abs(moved[DSE_SECOND_ORDER_EXTENDED][i] - moved[DSE_SECOND_ORDER][i]);
    assert_near(apart, h * trace, DSE_REAL(0.1) * h * trace);
}

/* A linear plant: all kinds are the Kalman filter, with the exact covariance of the noise. */
static void all_kinds_are_exact_for_a_linear_plant(void **state)
{
    (void)state;
    static const dse_real A[NX * NX] = {DSE_REAL(-0.5), 1, 0, -1, DSE_REAL(-0.2), 1, 0, 0, -2};
    static const dse_real B[NX] = {1, 0, 2}, d[NX] = {0, DSE_REAL(0.5), 0};
    static const dse_real Q[NX * NX] = {0, 0, 0, 0, 0, 0, 0, 0, 1}; /* of rank 1 */
    static const dse_real x0[NX] = {1, -2, DSE_REAL(0.5)}, u[1] = {DSE_REAL(0.3)};
    const struct dse_quadratic system = {.A = A, .B = B, .d = d, .C = unit_covariance};
    const dse_real h = DSE_REAL(0.8);
    dse_real Ad[NX * NX], Qd[NX * NX], scratch[DSE_VAN_LOAN_SCRATCH(NX)], want[NX * NX];
    dse_real Bd[NX * 2], forced[NX * 2], discretise[DSE_DISCRETISE_SCRATCH(NX, 2)], x[NX];
    dse_quadratic_model(&model, NX, 1, NX, &system);
    assert_int_equal(dse_van_loan(NX, A, Q, h, Ad, Qd, scratch), DSE_OK);
    for (int i = 0; i < NX; i++) {
        forced[2 * i] = B[i];
        forced[2 * i + 1] = d[i];
    }
    assert_int_equal(dse_discretise(NX, 2, A, forced, h, Ad, Bd, discretise), DSE_OK);
    dse_mat_vec(NX, NX, Ad, x0, x);
    for (int i = 0; i < NX; i++)
        x[i] += Bd[2 * i] * u[0] + Bd[2 * i + 1];
    for (int kind = 0; kind < 6; kind++) {
        const bool noise = kind < 2;
        const struct dse_second_order_config config = {.model = &model,
                                                       .kind =
                                                           (enum dse_second_order_kind)(kind % 3),
                                                       .x0 = x0,
                                                       .S0 = unit_covariance,
                                                       .Q = noise ? Q : NULL,
                                                       .R = unit_covariance,
                                                       .substeps = kind == 4 ? 50 : 0};
        struct dse_second_order filter;
        start(&filter, &config);
        assert_int_equal(dse_second_order_predict(&filter, h, u), DSE_OK);
        dse_sym_congruence(NX, NX, Ad, unit_covariance, noise ? Qd : NULL, want, scratch);
        assert_agree(NX, dse_second_order_state(&filter), x, TOLERANCE(1e-7, 1e-4));
        assert_agree(NX * NX, dse_second_order_covariance(&filter), want, TOLERANCE(1e-6, 1e-4));
    }
}

/* The points' filter gets h Q where the differential equation integrates it. */
static void the_unscented_kind_adds_noise_at_the_end(void **state)
{
    (void)state;
    dse_real S[2][NX * NX], Q[NX * NX];
    model = plant_model("quadratic_ex4");
    for (int i = 0; i < NX * NX; i++)
        Q[i] = DSE_REAL(0.3) * unit_covariance[i] + DSE_REAL(0.1);
    for (int noise = 0; noise < 2; noise++) {
        const struct dse_second_order_config config = {.model = &model,
                                                       .kind = DSE_SECOND_ORDER_UNSCENTED,
                                                       .x0 = plant_start,
                                                       .S0 = unit_covariance,
                                                       .Q = noise ? Q : NULL,
                                                       .R = R_source};
        struct dse_second_order filter;
        start(&filter, &config);
        assert_int_equal(dse_second_order_predict(&filter, DSE_REAL(0.5), NULL), DSE_OK);
        memcpy(S[noise], dse_second_order_covariance(&filter), sizeof S[noise]);
    }
    for (int i = 0; i < NX * NX; i++)
        S[0][i] += DSE_REAL(0.5) * Q[i];
    assert_agree(NX * NX, S[1], S[0], TOLERANCE(1e-12, 1e-5));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(example_3_is_followed_though_x3_is_not_observed),
        cmocka_unit_test(example_4_ends_in_an_oscillation),
        cmocka_unit_test(quadratic_terms_cancel_in_the_rate_of_energy),
        cmocka_unit_test(energy_never_grows_between_samples),
        cmocka_unit_test(the_extended_filter_lacks_that_bound),
        cmocka_unit_test(coarse_steps_are_halved_before_they_blow_up),
        cmocka_unit_test(a_covariance_that_decays_to_nothing_stops_nobody),
        cmocka_unit_test(the_extended_kind_is_the_extended_kalman_filter),
        cmocka_unit_test(unscented_points_see_the_trace_term),
        cmocka_unit_test(all_kinds_are_exact_for_a_linear_plant),
        cmocka_unit_test(the_unscented_kind_adds_noise_at_the_end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
