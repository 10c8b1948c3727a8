/* Distributed Kalman filter: what a configuration may say, and what memory it takes. */
#include <math.h>

#include "dse/distributed_kalman.h"

#include "kalman_network.h"
#include "near.h"

enum { NX = 2, NY = 1, IN = 3, ROOM = DSE_DKF_STORAGE_LYAPUNOV(NX, NY, IN) };

static dse_real memory[ROOM];
static const dse_real identity[4] = {1, 0, 0, 1}, one = 1, C[2] = {1, 0}, K[2] = {2, -1};
static const dse_real crooked[4] = {1, DSE_REAL(0.5), 0, 1}, indefinite[4] = {1, 2, 2, 1};
static const dse_real broken[4] = {1, 0, 0, (dse_real)NAN}, minus_one = -1;
static struct dse_model model;
static const struct dse_dkf_sensor listeners[2] = {{1, C}, {1, C}}, blind_listener[2] = {{1, NULL}};
static struct dse_dkf dkf;

static struct dse_dkf_config good(void)
{
    model = swinging_plant();
    return (struct dse_dkf_config){.model = &model,
                                   .period = DSE_REAL(0.01),
                                   .sensor = {NY, C},
                                   .n_neighbours = IN,
                                   .n_listeners = 2,
                                   .listeners = listeners,
                                   .scheme = DSE_DKF_EDGE,
                                   .gamma = DSE_REAL(0.02),
                                   .P0 = identity,
                                   .Q = identity,
                                   .R = &one};
}

static enum dse_status init(const struct dse_dkf_config *config, int room, int *used)
{
    struct dse_arena arena;
    dse_arena_init(&arena, memory, room);
    const enum dse_status status = dse_dkf_init(&dkf, config, &arena);
    if (used != NULL)
        *used = arena.used;
    return status;
}

/* What may be wrong in a configuration, one at a time. */
#define CASE(name, change)                                                                         \
    static void name(struct dse_dkf_config *c)                                                     \
    {                                                                                              \
        (void)c, change;                                                                           \
    }
CASE(no_model, c->model = NULL)
CASE(no_period, c->period = 0)
CASE(endless_period, c->period = (dse_real)INFINITY)
CASE(no_C, c->sensor.C = NULL)
CASE(negative_outputs, c->sensor.ny = -1)
CASE(negative_neighbours, c->n_neighbours = -1)
CASE(negative_listeners, c->n_listeners = -1)
CASE(unknown_listeners, c->listeners = NULL)
CASE(blind, c->listeners = blind_listener)
CASE(no_P0, c->P0 = NULL)
CASE(no_R, c->R = NULL)
CASE(crooked_P0, c->P0 = crooked)
CASE(indefinite_P0, c->P0 = indefinite)
CASE(broken_P0, c->P0 = broken)
CASE(broken_Q, c->Q = broken)
CASE(negative_R, c->R = &minus_one)
CASE(broken_x0, c->x0 = broken + 2)
CASE(negative_gamma, c->gamma = -1)
CASE(negative_beta, c->beta = -1)
CASE(negative_sigma, c->sigma = -1)
CASE(endless_limit, c->limit = (dse_real)INFINITY)
CASE(negative_hold, c->hold = -2)
CASE(no_S, c->direction = DSE_DKF_LYAPUNOV)
CASE(indefinite_S, (c->direction = DSE_DKF_LYAPUNOV, c->S = indefinite))
CASE(indefinite_W0, (c->direction = DSE_DKF_LYAPUNOV, c->S = identity, c->W0 = indefinite))
CASE(no_D, c->direction = DSE_DKF_GIVEN)
CASE(broken_D, (c->direction = DSE_DKF_GIVEN, c->D = broken + 2))
CASE(continuous_filtered, c->direction = DSE_DKF_FILTERED)
CASE(covariance_of_a_given_gain, c->K = K)
CASE(standard_with_a_given_gain, (c->K = K, c->scheme = DSE_DKF_STANDARD))
CASE(standard_with_another_direction, (c->scheme = DSE_DKF_STANDARD, c->direction = DSE_DKF_GAIN))
CASE(broken_K, (c->K = broken + 2, c->direction = DSE_DKF_GIVEN, c->D = K))
CASE(unknown_scheme, c->scheme = (enum dse_dkf_scheme)9)
CASE(unknown_direction, c->direction = (enum dse_dkf_direction)9)
CASE(unknown_message, c->message = (enum dse_dkf_message)9)
CASE(blind_model, model.dfdx = NULL)
CASE(discrete_gain, (model.time = DSE_DISCRETE, c->direction = DSE_DKF_GAIN))
CASE(discrete_global, (model.time = DSE_DISCRETE, c->scheme = DSE_DKF_GLOBAL))
CASE(discrete_standard, (model.time = DSE_DISCRETE, c->scheme = DSE_DKF_STANDARD))
CASE(discrete_leak, (model.time = DSE_DISCRETE, c->sigma = 1))

static void what_does_not_go_is_refused(void **state)
{
    (void)state;
    static const struct {
        void (*change)(struct dse_dkf_config *config);
        enum dse_status status;
    } cases[] = {
        {no_model, DSE_EINVAL},
        {no_period, DSE_EINVAL},
        {endless_period, DSE_EINVAL},
        {no_C, DSE_EINVAL},
        {negative_outputs, DSE_EINVAL},
        {negative_neighbours, DSE_EINVAL},
        {negative_listeners, DSE_EINVAL},
        {unknown_listeners, DSE_EINVAL},
        {blind, DSE_EINVAL},
        {no_P0, DSE_EINVAL},
        {no_R, DSE_EINVAL},
        {crooked_P0, DSE_EINVAL},
        {indefinite_P0, DSE_ENOTPD},
        {broken_P0, DSE_ENONFINITE},
        {broken_Q, DSE_ENONFINITE},
        {negative_R, DSE_ENOTPD},
        {broken_x0, DSE_ENONFINITE},
        {negative_gamma, DSE_EINVAL},
        {negative_beta, DSE_EINVAL}, /* the opposite sign of the law */
        {negative_sigma, DSE_EINVAL},
        {endless_limit, DSE_EINVAL},
        {negative_hold, DSE_EINVAL},
        {no_S, DSE_EINVAL},
        {indefinite_S, DSE_ENOTPD},
        {indefinite_W0, DSE_ENOTPD},
        {no_D, DSE_EINVAL},
        {broken_D, DSE_ENONFINITE},
        {continuous_filtered, DSE_EINVAL},
        {covariance_of_a_given_gain, DSE_EINVAL},
        {standard_with_a_given_gain, DSE_EINVAL},
        {standard_with_another_direction, DSE_EINVAL},
        {broken_K, DSE_ENONFINITE},
        {unknown_scheme, DSE_EINVAL},
        {unknown_direction, DSE_EINVAL},
        {unknown_message, DSE_EINVAL},
        {blind_model, DSE_EINVAL},
        {discrete_gain, DSE_EINVAL},
        {discrete_global, DSE_EINVAL},
        {discrete_standard, DSE_EINVAL},
        {discrete_leak, DSE_EINVAL},
    };
    for (size_t k = 0; k < sizeof cases / sizeof cases[0]; k++) {
        struct dse_dkf_config config = good();
        assert_int_equal(init(&config, ROOM, NULL), DSE_OK);
        cases[k].change(&config);
        if (init(&config, ROOM, NULL) != cases[k].status)
            fail_msg("case %d: %s", (int)k, dse_status_text(init(&config, ROOM, NULL)));
    }
}

/* Every combination that is allowed fits into the documented storage, and into no real less than it
 * takes. */
static void memory_is_what_the_macros_say(void **state)
{
    (void)state;
    int accepted = 0, largest[3] = {0, 0, 0};
    for (int choice = 0; choice < 2 * 5 * 5 * 2 * 2; choice++) {
        struct dse_dkf_config config = good();
        model.time = (enum dse_time_kind)(choice % 2);
        config.scheme = (enum dse_dkf_scheme)(choice / 2 % 5);
        config.direction = (enum dse_dkf_direction)(choice / 10 % 5);
        config.message = (enum dse_dkf_message)(choice / 50 % 2);
        config.K = choice / 100 % 2 == 0 ? NULL : K;
        config.D = K;
        config.S = identity;
        int used;
        if (init(&config, ROOM, &used) != DSE_OK)
            continue;
        accepted++;
        const int matrices = dkf.riccati + dkf.lyapunov;
        largest[matrices] = used > largest[matrices] ? used : largest[matrices];
        assert_int_equal(init(&config, used - 1, NULL), DSE_ESTORAGE);
        assert_int_equal(init(&config, used, NULL), DSE_OK);
        assert_int_equal(dse_dkf_health(&dkf), DSE_HEALTH_INITIALISING);
    }
    assert_true(accepted > 60);
    assert_in_range(largest[0], 1, DSE_DKF_STORAGE(NX, NY, IN));
    assert_in_range(largest[1], 1, DSE_DKF_STORAGE(NX, NY, IN));
    assert_in_range(largest[2], 1, DSE_DKF_STORAGE_LYAPUNOV(NX, NY, IN));
}

/* Many outputs, few states: the sizes that a macro forgets first. */
static void memory_suffices_for_more_outputs_than_states(void **state)
{
    (void)state;
    enum { WIDE = 5, SIZE = DSE_DKF_STORAGE_LYAPUNOV(1, WIDE, 2) };
    static dse_real room[SIZE];
    static const dse_real ones[WIDE] = {1, 1, 1, 1, 1}, a = DSE_REAL(0.5), zero[WIDE] = {0};
    dse_real R[WIDE * WIDE];
    const struct dse_linear parts = {.A = &a};
    dse_mat_identity(WIDE, R);
    for (int choice = 0; choice < 12; choice++) {
        struct dse_model scalar;
        struct dse_arena arena;
        dse_linear_model(&scalar, (enum dse_time_kind)(choice % 2), 1, 0, 0, &parts);
        const struct dse_dkf_config config = {.model = &scalar,
                                              .period = DSE_REAL(0.1),
                                              .sensor = {WIDE, ones},
                                              .n_neighbours = 2,
                                              .scheme = choice / 2 % 2 == 0 ? DSE_DKF_EDGE
                                                                            : DSE_DKF_ALONE,
                                              .direction = choice % 2 == 1   ? DSE_DKF_FILTERED
                                                           : choice / 4 == 0 ? DSE_DKF_COVARIANCE
                                                           : choice / 4 == 1 ? DSE_DKF_GAIN
                                                                             : DSE_DKF_LYAPUNOV,
                                              .gamma = DSE_REAL(0.1),
                                              .P0 = &one,
                                              .Q = &one,
                                              .R = R,
                                              .S = &one};
        dse_arena_init(&arena, room, SIZE);
        assert_int_equal(dse_dkf_init(&dkf, &config, &arena), DSE_OK);
        const struct dse_measurement sample = {zero, NULL};
        for (int k = 0; k < 5; k++) {
            assert_int_equal(dse_dkf_begin(&dkf, (dse_real)k, NULL, &sample), DSE_OK);
            assert_int_equal(dse_dkf_receive(&dkf, 0, ones, WIDE), DSE_OK);
            assert_int_equal(dse_dkf_correct(&dkf), DSE_OK);
            assert_int_equal(dse_dkf_advance(&dkf), DSE_OK);
            assert_true(dse_is_finite(dse_dkf_loop_gain(&dkf)));
        }
    }
}

static enum dse_status driven(const struct dse_model *m, dse_real t, const dse_real *x,
                              const dse_real *u, dse_real *dx)
{
    dse_real A[4];
    const enum dse_status status = m->dfdx(m, t, x, u, A);
    dse_mat_vec(2, 2, A, x, dx);
    dx[0] += u[0];
    return status;
}

/* A known input enters through f: with it a noise-free estimate that starts right stays right. */
static void known_inputs_move_the_estimate(void **state)
{
    (void)state;
    struct dse_dkf_config config = good();
    const dse_real u = 3;
    dse_real x[2] = {0, 0}, scratch[DSE_RK4_SCRATCH(2)];
    model.nu = 1;
    model.f = driven;
    config.n_neighbours = 0;
    assert_int_equal(init(&config, ROOM, NULL), DSE_OK);
    for (int k = 0; k < 50; k++) {
        const dse_real t = (dse_real)k * config.period;
        const struct dse_measurement nothing = {x, (const bool[1]){false}};
        assert_int_equal(dse_dkf_begin(&dkf, t, &u, &nothing), DSE_OK);
        assert_int_equal(dse_dkf_correct(&dkf), DSE_OK);
        assert_all_near(2, dse_dkf_state(&dkf), x, TOLERANCE(1e-14, 1e-6));
        assert_int_equal(dse_dkf_advance(&dkf), DSE_OK);
        assert_int_equal(dse_rk4_model_step(&model, t, config.period, &u, x, scratch), DSE_OK);
    }
    assert_true(x[0] > 1);
    assert_int_equal(dse_dkf_health(&dkf), DSE_HEALTH_INITIALISING); /* never saw a value */
}

static void what_is_read_is_null_where_there_is_nothing(void **state)
{
    (void)state;
    struct dse_dkf_config config = good();
    assert_int_equal(init(&config, ROOM, NULL), DSE_OK);
    assert_non_null(dse_dkf_covariance(&dkf));
    assert_null(dse_dkf_lyapunov(&dkf));
    assert_null(dse_dkf_direction(&dkf));
    assert_non_null(dse_dkf_gain(&dkf, IN - 1));
    assert_null(dse_dkf_gain(&dkf, IN));
    assert_null(dse_dkf_gain(&dkf, -1));
    assert_false(dse_dkf_uses(&dkf, 0));
    dse_real message[2];
    assert_int_equal(dse_dkf_message(&dkf, 2, message), 0);
    assert_int_equal(dse_dkf_message(&dkf, 1, message), 1);
    assert_int_equal(dse_dkf_global_sum(&dkf, &one), DSE_EINVAL);
    const struct dse_measurement sample = {&one, NULL};
    assert_int_equal(dse_dkf_begin(&dkf, (dse_real)NAN, NULL, &sample), DSE_EINVAL);

    config.scheme = DSE_DKF_GLOBAL;
    assert_int_equal(init(&config, ROOM, NULL), DSE_OK);
    assert_non_null(dse_dkf_gain(&dkf, 0));
    assert_null(dse_dkf_gain(&dkf, 1));
    const dse_real nothing = (dse_real)NAN;
    assert_int_equal(dse_dkf_global_sum(&dkf, &nothing), DSE_ENONFINITE);
    assert_int_equal(dse_dkf_counts(&dkf)->refused, 1);

    config.scheme = DSE_DKF_ALONE;
    config.K = K;
    assert_int_equal(init(&config, ROOM, NULL), DSE_OK);
    assert_null(dse_dkf_covariance(&dkf));
    assert_null(dse_dkf_gain(&dkf, 0));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_does_not_go_is_refused),
        cmocka_unit_test(memory_is_what_the_macros_say),
        cmocka_unit_test(memory_suffices_for_more_outputs_than_states),
        cmocka_unit_test(known_inputs_move_the_estimate),
        cmocka_unit_test(what_is_read_is_null_where_there_is_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
