/* Distributed second-order filters on example 4: the source's claims, in the form that the spec's
 * own runs of them have (section 6.2 and 6.3). Errors are root mean squares over nodes, runs and
 * samples of a window; all methods have the same noise. */
#include <math.h>
#include <string.h>

#include "dse/linalg.h"
#include "near.h"
#include "second_order_network.h"
#include "second_order_plants.h"

enum { RUNS = 20, SAMPLES = 120, WINDOWS = 4 };

static const int window_end[WINDOWS] = {5, 20, 60, SAMPLES};

static struct dse_model model;
static struct second_order_network network;
static const dse_real R_source[4] = {DSE_REAL(0.01), 0, 0, DSE_REAL(0.01)};

/* What differs from method to method. */
struct method {
    enum dse_dso_scheme scheme;
    enum dse_second_order_kind kind;
    dse_real delta, epsilon;
    int rounds;
    enum dse_dso_memory memory;
};

struct trouble {
    int off_from; /* sample from which node 1 has no measurement; 0: never */
    double loss;  /* probability of a message's loss */
};

static void prepare(const struct method *method)
{
    static const dse_real w0[2][NX] = {{4, 3, 2}, {2, 1, 3}};
    static const dse_real C[2][NX] = {{1, 1, 0}, {1, 0, 1}};
    memset(&network, 0, sizeof network);
    model = plant_model("quadratic_ex4");
    network.base = (struct dse_dso_config){.filter = {.model = &model,
                                                      .ny = 1,
                                                      .kind = method->kind,
                                                      .S0 = unit_covariance,
                                                      .R = R_source,
                                                      .rtol = TOLERANCE(1e-6, 1e-5),
                                                      .atol = TOLERANCE(1e-8, 1e-7)},
                                           .scheme = method->scheme,
                                           .delta = method->delta,
                                           .epsilon = method->epsilon,
                                           .memory = method->memory,
                                           .rounds = method->rounds};
    network.nodes = 2;
    for (int i = 0; i < 2; i++) {
        memcpy(network.C[i], C[i], sizeof C[i]);
        memcpy(network.w0[i], w0[i], sizeof w0[i]);
        network.hears[i][1 - i] = true;
    }
    assert_int_equal(network_make(&network), DSE_OK);
}

static void sample(struct dse_random *noise, struct dse_random *loss, const struct trouble *trouble,
                   int k, const dse_real *x)
{
    const dse_real m[2] = {x[0] + x[1] + DSE_REAL(0.1) * (dse_real)dse_random_normal(noise),
                           x[0] + x[2] + DSE_REAL(0.1) * (dse_real)dse_random_normal(noise)};
    network.off[1] = trouble->off_from > 0 && k >= trouble->off_from;
    for (int i = 0; i < 2; i++)
        network.lost[i][1 - i] = dse_random_uniform(loss) < trouble->loss;
    assert_int_equal(network_sample(&network, (dse_real)k, m), DSE_OK);
}

static dse_real squared_error(int node, const dse_real *x)
{
    dse_real error[NX];
    memcpy(error, dse_dso_state(&network.node[node]), sizeof error);
    dse_axpy(NX, -1, x, error);
    return dse_dot(NX, error, error);
}

/* rms[node][window] */
static void measure(const struct method *method, const struct trouble *trouble,
                    dse_real rms[2][WINDOWS])
{
    memset(rms, 0, 2 * sizeof rms[0]);
    for (int run = 0; run < RUNS; run++) {
        struct dse_random noise, loss;
        dse_real x[NX];
        dse_random_init(&noise, 20, (uint64_t)run);
        dse_random_init(&loss, 21, (uint64_t)run);
        memcpy(x, plant_start, sizeof x);
        prepare(method);
        for (int k = 1, w = 0; k <= SAMPLES; k++) {
            plant_second(&model, x);
            sample(&noise, &loss, trouble, k, x);
            w += k > window_end[w];
            rms[0][w] += squared_error(0, x);
            rms[1][w] += squared_error(1, x);
        }
    }
    for (int node = 0; node < 2; node++)
        for (int w = 0; w < WINDOWS; w++)
            rms[node][w] =
                dse_sqrt(rms[node][w] /
                         (dse_real)(RUNS * (window_end[w] - (w > 0 ? window_end[w - 1] : 0))));
}

/* Over both nodes. */
static void measure_network(struct method method, dse_real rms[WINDOWS])
{
    static const struct trouble none = {0, 0};
    dse_real each[2][WINDOWS];
    measure(&method, &none, each);
    for (int w = 0; w < WINDOWS; w++)
        rms[w] = dse_sqrt((each[0][w] * each[0][w] + each[1][w] * each[1][w]) / 2);
}

/* T6: .. */
static void agreeing_on_estimates_beats_staying_alone(void **state)
{
    (void)state;
    dse_real alone[WINDOWS], b[WINDOWS], b_inf[WINDOWS], c_inf[WINDOWS], a_inf[WINDOWS];
    measure_network((struct method){.scheme = DSE_DSO_ALONE}, alone);
    measure_network((struct method){.scheme = DSE_DSO_B, .delta = DSE_REAL(0.1)}, b);
    measure_network((struct method){.scheme = DSE_DSO_B_INFORMATION, .delta = DSE_REAL(0.25)},
                    b_inf);
    measure_network((struct method){.scheme = DSE_DSO_C_INFORMATION, .delta = DSE_REAL(0.25)},
                    c_inf);
    measure_network(
        (struct method){.scheme = DSE_DSO_A_INFORMATION, .epsilon = DSE_REAL(0.25), .rounds = 5},
        a_inf);
    assert_true(b[3] < DSE_REAL(0.9) * alone[3]);
    assert_true(b_inf[3] < DSE_REAL(0.8) * alone[3]);
    assert_true(c_inf[3] < DSE_REAL(0.85) * alone[3]);
    assert_true(a_inf[3] < DSE_REAL(0.8) * alone[3]);
    for (int w = 1; w < 3; w++)
        assert_true(b_inf[w] < alone[w] && a_inf[w] < alone[w]);
    assert_near(alone[3], DSE_REAL(0.0204), DSE_REAL(0.3 * 0.0204));
    assert_near(b[3], DSE_REAL(0.0143), DSE_REAL(0.3 * 0.0143));
    assert_near(b_inf[3], DSE_REAL(0.0137), DSE_REAL(0.3 * 0.0137));
}

/* T3, T5 with the source's initial state and delta = 1/4. */
static void c_is_ahead_of_b_and_both_of_fused_covariances(void **state)
{
    (void)state;
    dse_real b[WINDOWS], c[WINDOWS], persistent[WINDOWS], restart[WINDOWS], average[WINDOWS];
    measure_network((struct method){.scheme = DSE_DSO_B, .delta = DSE_REAL(0.25)}, b);
    measure_network((struct method){.scheme = DSE_DSO_C, .delta = DSE_REAL(0.25)}, c);
    struct method a = {.scheme = DSE_DSO_A_COVARIANCE, .memory = DSE_DSO_PERSISTENT};
    measure_network(a, persistent);
    a.memory = DSE_DSO_RESTART;
    measure_network(a, restart);
    a.memory = DSE_DSO_AVERAGE;
    a.rounds = 5;
    measure_network(a, average);
    for (int w = 1; w < WINDOWS; w++)
        assert_true(c[w] < DSE_REAL(0.9) * b[w] && b[w] < DSE_REAL(0.8) * persistent[w]);
    assert_true(restart[3] > b[3] && restart[3] > DSE_REAL(1.5) * c[3]);
    assert_true(restart[3] < DSE_REAL(0.2) * persistent[3]);
    assert_true(average[3] < DSE_REAL(0.6) * restart[3]);
}

/* T7, T8: from the source's initial state. */
static void the_trace_term_shortens_the_transient(void **state)
{
    (void)state;
    dse_real second[WINDOWS], extended[WINDOWS], unscented[WINDOWS];
    struct method alone = {.scheme = DSE_DSO_ALONE};
    measure_network(alone, second);
    alone.kind = DSE_SECOND_ORDER_EXTENDED;
    measure_network(alone, extended);
    alone.kind = DSE_SECOND_ORDER_UNSCENTED;
    measure_network(alone, unscented);
    assert_true(second[0] < DSE_REAL(0.8) * extended[0]);
    assert_true(second[1] < DSE_REAL(0.7) * extended[1]);
    assert_true(unscented[1] < DSE_REAL(0.7) * extended[1]);
    assert_near(unscented[3], second[3], DSE_REAL(0.15) * second[3]);
}

/* T9 and section 6.3: node j's error with its sensor dead from the start, or half of all messages
 * lost. */
static void estimation_survives_a_dead_sensor_and_losses(void **state)
{
    (void)state;
    static const struct trouble dead = {1, 0}, losses = {0, 0.5};
    const struct method alone = {.scheme = DSE_DSO_ALONE};
    const struct method b_inf = {.scheme = DSE_DSO_B_INFORMATION, .delta = DSE_REAL(0.25)};
    const struct method c = {.scheme = DSE_DSO_C, .delta = DSE_REAL(0.25)};
    dse_real rms[2][WINDOWS], unhelped[2][WINDOWS];
    measure(&alone, &dead, unhelped);
    assert_true(unhelped[1][3] > 1);
    measure(&b_inf, &dead, rms);
    assert_near(rms[1][3], DSE_REAL(0.0201), DSE_REAL(0.4 * 0.0201));
    measure(&c, &dead, rms);
    assert_near(rms[1][3], DSE_REAL(0.0212), DSE_REAL(0.4 * 0.0212));
    measure(&b_inf, &losses, rms);
    assert_near(rms[1][3], DSE_REAL(0.0165), DSE_REAL(0.4 * 0.0165));
}

/* Why the printed A-I is not the default, with neither noise nor an initial error (section 4.7). */
static void the_printed_fusion_of_measurements_is_biased(void **state)
{
    (void)state;
    static const struct method methods[] = {
        {.scheme = DSE_DSO_A_LITERAL, .epsilon = DSE_REAL(0.1)},
        {.scheme = DSE_DSO_A_INFORMATION, .epsilon = DSE_REAL(0.25), .rounds = 5}};
    dse_real error[2] = {0, 0};
    for (int c = 0; c < 2; c++) {
        dse_real x[NX];
        memcpy(x, plant_start, sizeof x);
        prepare(&methods[c]);
        memcpy(network.C[1], network.C[0], sizeof network.C[0]); /* identical sensors */
        for (int i = 0; i < 2; i++)
            assert_int_equal(dse_dso_set(&network.node[i], 0, plant_start, NULL), DSE_OK);
        for (int k = 1; k <= SAMPLES; k++) {
            plant_second(&model, x);
            const dse_real m[2] = {x[0] + x[1], x[0] + x[1]};
            assert_int_equal(network_sample(&network, (dse_real)k, m), DSE_OK);
            error[c] = k > 60 ? error[c] + squared_error(0, x) / 60 : 0;
        }
    }
    assert_near(dse_sqrt(error[0]), DSE_REAL(1.16), DSE_REAL(0.02));
    assert_near(dse_sqrt(error[1]), DSE_REAL(0.0012), DSE_REAL(0.0003));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(agreeing_on_estimates_beats_staying_alone),
        cmocka_unit_test(c_is_ahead_of_b_and_both_of_fused_covariances),
        cmocka_unit_test(the_trace_term_shortens_the_transient),
        cmocka_unit_test(estimation_survives_a_dead_sensor_and_losses),
        cmocka_unit_test(the_printed_fusion_of_measurements_is_biased),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
