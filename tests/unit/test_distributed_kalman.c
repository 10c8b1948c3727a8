/* Distributed Kalman filter: what the theory says of its schemes. */
#include "dse/distributed_kalman.h"

#include "kalman_network.h"
#include "near.h"
#include "random_matrix.h"

static struct kalman_network network, other;

static const dse_real identity[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
static const dse_real identity_2[4] = {1, 0, 0, 1};
static const int ring[] = {0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 0};
enum { RING = 6, STEPS = 100 };

/* ---- the two networks of these tests: six nodes on a ring ---- */

/* The source's plant and simulation 2. */
static void make_swinging(struct kalman_network *net)
{
    static const dse_real R[RING] = {DSE_REAL(0.1), DSE_REAL(0.1), 5,
                                     DSE_REAL(0.1), DSE_REAL(0.1), 10};
    static const dse_real x0[RING][2] = {{5, 5}, {-5, -5}, {5, -5}, {-5, 5}, {0, 0}, {3, -7}};
    *net = (struct kalman_network){.nodes = RING, .model = swinging_plant()};
    net->base = (struct dse_dkf_config){.period = DSE_REAL(0.01),
                                        .sensor = {.ny = 1},
                                        .scheme = DSE_DKF_EDGE,
                                        .gamma = DSE_REAL(0.02),
                                        .P0 = identity_2,
                                        .Q = identity_2,
                                        .S = identity_2};
    for (int i = 0; i < RING; i++) {
        network_sense(net, i, 1 + i % 2);
        net->R[i][0] = R[i];
        net->x0[i][0] = x0[i][0];
        net->x0[i][1] = x0[i][1];
    }
}

/* Four states, two outputs per node with correlated noise, random but always the same. */
static struct dse_linear wide;
static dse_real wide_A[16];

static void make_wide(struct kalman_network *net)
{
    random_state = 11;
    *net = (struct kalman_network){.nodes = RING};
    fill(16, wide_A);
    for (int i = 0; i < 4; i++)
        wide_A[5 * i] -= 2;
    wide.A = wide_A;
    dse_linear_model(&net->model, DSE_CONTINUOUS, 4, 0, 0, &wide);
    net->base = (struct dse_dkf_config){.period = DSE_REAL(0.01),
                                        .sensor = {.ny = 2},
                                        .scheme = DSE_DKF_EDGE,
                                        .gamma = DSE_REAL(0.05),
                                        .P0 = identity,
                                        .Q = identity,
                                        .S = identity};
    for (int i = 0; i < RING; i++) {
        fill(8, net->C[i]);
        net->R[i][0] = 1;
        net->R[i][1] = net->R[i][2] = DSE_REAL(0.3);
        net->R[i][3] = DSE_REAL(0.5);
        fill(4, net->x0[i]);
        for (int c = 0; c < 4; c++)
            net->x0[i][c] *= 5;
    }
}

/* One sample of the noise-free network and plant. */
static void step(struct kalman_network *net, dse_real t, dse_real *x)
{
    const int m = net->base.sensor.ny, n = net->model.nx;
    dse_real y[RING * NETWORK_NY];
    for (int i = 0; i < net->nodes; i++)
        dse_mat_vec(m, n, net->C[i], x, y + i * m);
    assert_int_equal(network_hear(net, t, y), DSE_OK);
    assert_int_equal(network_advance(net), DSE_OK);
    assert_int_equal(plant_step(&net->model, t, net->config[0].period, NULL, x), DSE_OK);
}

static void run(struct kalman_network *net, int steps, dse_real *x)
{
    for (int k = 0; k < steps; k++)
        step(net, (dse_real)k * net->base.period, x);
}

static const dse_real start[4] = {15, -10, 4, 7};

static void copy_start(dse_real *x)
{
    for (int c = 0; c < 4; c++)
        x[c] = start[c];
}

/* ---- the Lyapunov function ---- */

/* a' X^-1 a, and b = X^-1 a. */
static dse_real inverse_square(int n, const dse_real *X, const dse_real *a, dse_real *b)
{
    dse_real L[16];
    assert_int_equal(dse_cholesky(n, X, L), DSE_OK);
    for (int c = 0; c < n; c++)
        b[c] = a[c];
    dse_cholesky_solve(n, L, 1, b);
    return dse_dot(n, a, b);
}

/* V_i = e' Pi e + (1/beta) sum |Gamma_ij|^2,  Pi = P^-1 / gamma or W^-1 / gamma. */
static dse_real lyapunov(const struct kalman_network *net, int i, const dse_real *x)
{
    const struct dse_dkf *node = &net->node[i];
    const int n = node->nx, square = node->ny * node->ny;
    const dse_real *W = dse_dkf_lyapunov(node);
    dse_real e[4], b[4], V, beta = net->base.beta > 0 ? net->base.beta : 1;
    for (int c = 0; c < n; c++)
        e[c] = x[c] - dse_dkf_state(node)[c];
    V = inverse_square(n, W != NULL ? W : dse_dkf_covariance(node), e, b) / net->base.gamma;
    for (int j = 0; dse_dkf_gain(node, j) != NULL; j++)
        V += dse_dot(square, dse_dkf_gain(node, j), dse_dkf_gain(node, j)) / beta;
    return V;
}

/* e' U e: U = (C' R^-1 C + P^-1 Q P^-1) / gamma, or W^-1 S W^-1 / gamma. */
static dse_real decrease(const struct kalman_network *net, int i, const dse_real *x)
{
    const struct dse_dkf *node = &net->node[i];
    const int n = node->nx, m = node->ny;
    const dse_real *W = dse_dkf_lyapunov(node);
    dse_real e[4], b[4], Ce[2], c2[2];
    for (int c = 0; c < n; c++)
        e[c] = x[c] - dse_dkf_state(node)[c];
    inverse_square(n, W != NULL ? W : dse_dkf_covariance(node), e, b);
    if (W != NULL)
        return dse_dot(n, b, b) / net->base.gamma; /* S = I */
    dse_mat_vec(m, n, net->C[i], e, Ce);
    return (inverse_square(m, net->R[i], Ce, c2) + dse_dot(n, b, b)) / net->base.gamma; /* Q = I */
}

static const struct variant {
    enum dse_dkf_scheme scheme;
    enum dse_dkf_direction direction;
    dse_real beta;
} variants[] = {
    {DSE_DKF_EDGE, DSE_DKF_COVARIANCE, 1}, {DSE_DKF_NODE, DSE_DKF_COVARIANCE, 1},
    {DSE_DKF_EDGE, DSE_DKF_GAIN, 1},       {DSE_DKF_NODE, DSE_DKF_GAIN, 1},
    {DSE_DKF_EDGE, DSE_DKF_LYAPUNOV, 1},   {DSE_DKF_NODE, DSE_DKF_LYAPUNOV, 1},
    {DSE_DKF_EDGE, DSE_DKF_COVARIANCE, 3},
};
enum { VARIANTS = sizeof variants / sizeof variants[0] };

static void check_rate(void (*make)(struct kalman_network *), const struct variant *variant)
{
    const dse_real h = TOLERANCE(1e-6, 2e-3);
    dse_real x[4], before[RING], rate[RING];
    make(&network);
    network.base.scheme = variant->scheme;
    network.base.direction = variant->direction;
    network.base.beta = variant->beta;
    assert_int_equal(network_make(&network, RING, ring, true), DSE_OK);
    copy_start(x);
    run(&network, 50, x); /* gains are no longer zero */
    for (int i = 0; i < RING; i++) {
        before[i] = lyapunov(&network, i, x);
        rate[i] = decrease(&network, i, x);
        network.config[i].period = h;
        assert_true(dse_dkf_largest_gain(&network.node[i]) > DSE_REAL(0.1));
    }
    step(&network, 50 * network.base.period, x);
    for (int i = 0; i < RING; i++) {
        const dse_real now = lyapunov(&network, i, x);
        const dse_real rounding = TOLERANCE(1e-3, 0.1) * (rate[i] + before[i]);
        assert_near((now - before[i]) / h, -rate[i], rounding);
    }
}

/* Vdot_i = -e_i' U_i e_i whatever the neighbours say (Theorem 2.1, Lemma 2.3, Remark 2.6). */
static void lyapunov_function_falls_at_the_rate_of_the_proof(void **state)
{
    (void)state;
    for (int v = 0; v < VARIANTS; v++) {
        check_rate(make_swinging, &variants[v]);
        check_rate(make_wide, &variants[v]);
    }
}

/* With messages and y held over a step the fall is disturbed by an amount that vanishes as h^2. */
static dse_real largest_rise(dse_real h)
{
    dse_real x[4], before[RING], worst = 0;
    make_swinging(&network);
    network.base.period = h;
    assert_int_equal(network_make(&network, RING, ring, true), DSE_OK);
    copy_start(x);
    for (int i = 0; i < RING; i++)
        before[i] = lyapunov(&network, i, x);
    for (int k = 0; (dse_real)k * h < 3; k++) {
        step(&network, (dse_real)k * h, x);
        for (int i = 0; i < RING; i++) {
            const dse_real V = lyapunov(&network, i, x);
            worst = dse_max(worst, (V - before[i]) / (before[i] + 1));
            before[i] = V;
        }
    }
    return worst;
}

static void lyapunov_function_does_not_rise_but_for_the_held_messages(void **state)
{
    (void)state;
    const dse_real coarse = largest_rise(DSE_REAL(0.008));
    assert_true(coarse < DSE_REAL(1e-3));
#ifndef DSE_REAL_IS_float
    assert_true(largest_rise(0.002) < coarse / 8);
#endif
}

/* Section 6, R4: noise-free on the ring the errors go to zero and the nodes agree. */
static void errors_vanish_without_noise_in_every_scheme(void **state)
{
    (void)state;
    static const enum dse_dkf_scheme schemes[] = {DSE_DKF_ALONE, DSE_DKF_EDGE, DSE_DKF_NODE,
                                                  DSE_DKF_GLOBAL, DSE_DKF_STANDARD};
    for (size_t s = 0; s < sizeof schemes / sizeof schemes[0]; s++) {
        dse_real x[4], worst = 0;
        make_swinging(&network);
        network.base.scheme = schemes[s];
        network.base.gamma = DSE_REAL(0.01);
        assert_int_equal(network_make(&network, RING, ring, true), DSE_OK);
        copy_start(x);
        run(&network, 3000, x);
        for (int i = 0; i < RING; i++)
            for (int c = 0; c < 2; c++)
                worst = dse_max(worst, dse_abs(x[c] - dse_dkf_state(&network.node[i])[c]));
        assert_true(worst < DSE_REAL(0.1));
    }
}

/* ---- equivalences ---- */

/* Largest difference of the estimates of both networks, relative to the largest estimate. */
static dse_real difference(void)
{
    dse_real worst = 0, size = 0;
    for (int i = 0; i < RING; i++) {
        for (int c = 0; c < network.model.nx; c++) {
            const dse_real a = dse_dkf_state(&network.node[i])[c];
            worst = dse_max(worst, dse_abs(a - dse_dkf_state(&other.node[i])[c]));
            size = dse_max(size, dse_abs(a));
        }
    }
    return worst / size;
}

static dse_real run_both(const int *pairs, int count, bool undirected)
{
    dse_real x[4], z[4];
    assert_int_equal(network_make(&network, count, pairs, undirected), DSE_OK);
    assert_int_equal(network_make(&other, count, pairs, undirected), DSE_OK);
    copy_start(x);
    copy_start(z);
    run(&network, STEPS, x);
    run(&other, STEPS, z);
    return difference();
}

static void only_the_product_of_weight_and_rate_matters(void **state)
{
    (void)state;
    make_swinging(&network);
    make_swinging(&other);
    network.base.gamma = DSE_REAL(0.002);
    network.base.beta = 10;
    other.base.gamma = DSE_REAL(0.02);
    other.base.beta = 1;
    assert_true(run_both(ring, RING, true) < TOLERANCE(1e-12, 1e-4));
    other.base.gamma = DSE_REAL(0.002); /* and the product does */
    assert_true(run_both(ring, RING, true) > DSE_REAL(0.01));
}

static void whole_states_say_what_projected_outputs_say(void **state)
{
    (void)state;
    for (int scheme = DSE_DKF_EDGE; scheme <= DSE_DKF_GLOBAL; scheme++) {
        make_wide(&network);
        make_wide(&other);
        network.base.scheme = other.base.scheme = (enum dse_dkf_scheme)scheme;
        other.base.message = DSE_DKF_FULL;
        assert_true(run_both(ring, RING, true) < TOLERANCE(1e-12, 1e-5));
        assert_int_equal(dse_dkf_message_size(&network.node[0]), 2);
        assert_int_equal(dse_dkf_message_size(&other.node[0]), 4);
    }
}

static void edge_and_node_gains_are_the_same_with_one_neighbour(void **state)
{
    (void)state;
    make_wide(&network);
    make_wide(&other);
    other.base.scheme = DSE_DKF_NODE;
    assert_true(run_both(ring, RING, false) < TOLERANCE(1e-13, 1e-5));
    assert_true(run_both(ring, RING, true) > DSE_REAL(1e-4)); /* and not with two */
}

static void gain_as_direction_is_the_covariance_when_the_noise_is_one(void **state)
{
    (void)state;
    make_wide(&network);
    make_wide(&other);
    other.base.direction = DSE_DKF_GAIN;
    for (int i = 0; i < RING; i++)
        for (int k = 0; k < 4; k++)
            network.R[i][k] = other.R[i][k] = identity_2[k];
    assert_true(run_both(ring, RING, true) < TOLERANCE(1e-12, 1e-4));
    for (int i = 0; i < RING; i++)
        network.R[i][0] = other.R[i][0] = 2;
    assert_true(run_both(ring, RING, true) > DSE_REAL(1e-3));
}

/* With S = Q + K R K' the Lyapunov equation is the Riccati equation. In the steady state K is
 * constant, and so is S: W stays at P. */
static void lyapunov_equation_holds_the_covariance_for_its_own_right_hand_side(void **state)
{
    (void)state;
    dse_real x[4], S[16], CP[8], T[8];
    make_wide(&network);
    network.nodes = 1;
    network.base.scheme = DSE_DKF_ALONE;
    assert_int_equal(network_make(&network, 0, ring, false), DSE_OK);
    copy_start(x);
    run(&network, 2000, x);
    const dse_real *P = dse_dkf_covariance(&network.node[0]);
    dse_mat_mul(2, 4, 4, network.C[0], P, CP);
    dse_mat_mul(2, 2, 4, network.node[0].R_inverse, CP, T);
    dse_mat_mul_tn(4, 2, 4, CP, T, S);
    for (int k = 0; k < 16; k++)
        S[k] += identity[k];

    make_wide(&other);
    other.nodes = 1;
    other.base.direction = DSE_DKF_LYAPUNOV;
    other.base.P0 = P;
    other.base.W0 = P;
    other.base.S = S;
    assert_int_equal(network_make(&other, 0, ring, false), DSE_OK);
    run(&other, STEPS, x);
    assert_agree(16, dse_dkf_lyapunov(&other.node[0]), P, TOLERANCE(1e-9, 1e-3));
    assert_agree(16, dse_dkf_covariance(&other.node[0]), P, TOLERANCE(1e-9, 1e-3));
}

/* p' = 2 a p + q - p^2 / r has the limit r (a + sqrt(a^2 + q / r)). */
static void covariance_of_a_scalar_filter_goes_to_its_closed_form(void **state)
{
    (void)state;
    const dse_real a = DSE_REAL(0.5), q = 2, r = DSE_REAL(0.25), one = 1;
    const struct dse_linear parts = {.A = &a};
    const dse_real y = 0;
    network = (struct kalman_network){.nodes = 1};
    dse_linear_model(&network.model, DSE_CONTINUOUS, 1, 0, 0, &parts);
    network.base =
        (struct dse_dkf_config){.period = DSE_REAL(0.01), .sensor = {.ny = 1}, .P0 = &one, .Q = &q};
    network.C[0][0] = 1;
    network.R[0][0] = r;
    assert_int_equal(network_make(&network, 0, NULL, false), DSE_OK);
    for (int k = 0; k < 1000; k++) {
        assert_int_equal(network_hear(&network, (dse_real)k * network.base.period, &y), DSE_OK);
        assert_int_equal(network_advance(&network), DSE_OK);
    }
    assert_near(dse_dkf_covariance(&network.node[0])[0], r * (a + dse_sqrt(a * a + q / r)),
                TOLERANCE(1e-12, 1e-5));
}

/* ---- discrete ---- */

/* Both rules differ by O(h) only, and couple in the same direction. */
static void discrete_directions_agree_for_short_steps(void **state)
{
    (void)state;
    static const dse_real h[2] = {DSE_REAL(0.02), DSE_REAL(0.005)};
    dse_real gap[2], A[4], Q[4];
    for (int v = 0; v < 2; v++) {
        for (int rule = 0; rule < 2; rule++) {
            struct kalman_network *net = rule == 0 ? &network : &other;
            dse_real continuous[4], y[RING] = {0}, scratch[DSE_EXPM_SCRATCH(2)];
            const struct dse_model swinging = swinging_plant();
            make_swinging(net);
            swinging.dfdx(&swinging, 0, NULL, NULL, continuous);
            for (int k = 0; k < 4; k++) {
                continuous[k] *= h[v];
                Q[k] = h[v] * identity_2[k];
            }
            assert_int_equal(dse_expm(2, continuous, A, scratch), DSE_OK);
            const struct dse_linear parts = {.A = A};
            dse_linear_model(&net->model, DSE_DISCRETE, 2, 0, 0, &parts);
            net->base.direction = rule == 0 ? DSE_DKF_COVARIANCE : DSE_DKF_FILTERED;
            net->base.Q = Q;
            for (int i = 0; i < RING; i++)
                net->R[i][0] = 1 / h[v];
            assert_int_equal(network_make(net, RING, ring, true), DSE_OK);
            for (int k = 0; (dse_real)k * h[v] < 2; k++) {
                assert_int_equal(network_hear(net, (dse_real)k, y), DSE_OK);
                assert_int_equal(network_advance(net), DSE_OK);
            }
        }
        const dse_real *a = dse_dkf_direction(&network.node[0]),
                       *b = dse_dkf_direction(&other.node[0]);
        gap[v] = dse_abs(a[0] - b[0]) + dse_abs(a[1] - b[1]);
        assert_true(a[0] * b[0] + a[1] * b[1] > 0);
    }
    assert_true(gap[0] < DSE_REAL(0.2));
    assert_true(gap[1] < gap[0] / 3);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lyapunov_function_falls_at_the_rate_of_the_proof),
        cmocka_unit_test(lyapunov_function_does_not_rise_but_for_the_held_messages),
        cmocka_unit_test(errors_vanish_without_noise_in_every_scheme),
        cmocka_unit_test(only_the_product_of_weight_and_rate_matters),
        cmocka_unit_test(whole_states_say_what_projected_outputs_say),
        cmocka_unit_test(edge_and_node_gains_are_the_same_with_one_neighbour),
        cmocka_unit_test(gain_as_direction_is_the_covariance_when_the_noise_is_one),
        cmocka_unit_test(lyapunov_equation_holds_the_covariance_for_its_own_right_hand_side),
        cmocka_unit_test(covariance_of_a_scalar_filter_goes_to_its_closed_form),
        cmocka_unit_test(discrete_directions_agree_for_short_steps),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
