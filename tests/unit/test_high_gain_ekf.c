/* Distributed adaptive high-gain EKF: gain, weights, Riccati step, exchange of messages, missing
 * data and failures. Agreement with independent reference runs is the golden tests' matter. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "dse/high_gain_ekf.h"
#include "dse/linalg.h"
#include "dse/math.h"
#include "dse/ode.h"
#include "dse/plant.h"

#ifdef DSE_REAL_IS_float
#define TOLERANCE(in_double, in_float) DSE_REAL(in_float)
#else
#define TOLERANCE(in_double, in_float) DSE_REAL(in_double)
#endif

#define HOUR_PER_SECOND (DSE_REAL(1) / 3600)

static void assert_near(dse_real got, dse_real want, dse_real tolerance)
{
    if (!(dse_abs(got - want) <= tolerance)) {
        fail_msg("%.17g is not %.17g within %g", (double)got, (double)want, (double)tolerance);
    }
}

/* ---- the gain ---- */

static const struct dse_gain_adaptation ch2_gain = {
    .theta_m = 20, .rise_time = DSE_REAL(0.001), .relaxation = 100, .sharpness = 5, .threshold = 4};

static void gain_stays_in_its_interval_for_any_innovation_and_step(void **state)
{
    (void)state;
    static const dse_real J[] = {0, 3, 4, DSE_REAL(4.1), 5, 1000, DSE_REAL(1e30)};
    static const dse_real h[] = {DSE_REAL(1e-9), DSE_REAL(2.8e-4), DSE_REAL(0.01), 1, 1000};
    static const dse_real theta_m[] = {DSE_REAL(0.75), 1, 3, 20, 80};
    struct dse_gain_adaptation gain = ch2_gain;
    for (int a = 0; a < 5; a++) {
        gain.theta_m = theta_m[a];
        for (int b = 0; b < 7; b++) {
            for (int c = 0; c < 5; c++) {
                for (int s = 0; s <= 10; s++) {
                    const dse_real theta = 1 + (dse_real)s / 10 * (2 * theta_m[a] - 1);
                    const dse_real next = dse_gain_adaptation_step(&gain, h[c], J[b], theta);
                    assert_true(next >= 1 && next <= 2 * theta_m[a]);
                }
            }
        }
    }
}

static void gain_reaches_theta_m_in_the_time_of_the_rise_law(void **state)
{
    (void)state;
    /* DeltaT (1 - 1/theta_m) from theta = 1 with mu = 1 */
    const dse_real h = ch2_gain.rise_time * (1 - 1 / ch2_gain.theta_m);
    assert_near(dse_gain_adaptation_step(&ch2_gain, h, 1000, 1), 20, TOLERANCE(1e-10, 1e-3));
    /* then 2 theta_m - theta = theta_m / (1 + theta_m s): algebraically */
    assert_near(dse_gain_adaptation_step(&ch2_gain, h + ch2_gain.rise_time, 1000, 1),
                40 - DSE_REAL(20) / 21, TOLERANCE(1e-10, 1e-3));
}

static void gain_relaxes_exponentially_without_innovation(void **state)
{
    (void)state;
    const dse_real h = DSE_REAL(0.013);
    assert_true(dse_gain_adaptation_mu(&ch2_gain, -1000) <= 0);
    assert_near(dse_gain_adaptation_step(&ch2_gain, h, -1000, 31), 1 + 30 * dse_exp(-100 * h),
                TOLERANCE(1e-13, 1e-5));
}

static void saturated_gain_does_not_depend_on_the_tick(void **state)
{
    (void)state;
    dse_real theta = 1;
    for (int k = 0; k < 64; k++) {
        theta = dse_gain_adaptation_step(&ch2_gain, DSE_REAL(0.002) / 64, 1000, theta);
    }
    assert_near(theta, dse_gain_adaptation_step(&ch2_gain, DSE_REAL(0.002), 1000, 1),
                TOLERANCE(1e-10, 1e-3));
}

/* (2.14): Theta_i^-1 C' R_th^-1 C Theta_i^-1 = theta C' R^-1 C, and Q_th = theta Theta_i^-1 Q
 * Theta_i^-1 with Theta_i = diag(theta^{-(n*-n_i)}, ..., theta^{-(n*-1)}). */
static void full_weights_satisfy_the_scaling_identities(void **state)
{
    (void)state;
    enum { N_MAX = 3 };
    const dse_real theta = 7, R = DSE_REAL(0.3);
    const dse_real Q[9] = {5, 1, 2, 1, 6, 3, 2, 3, 9};
    for (int n_i = 1; n_i <= N_MAX; n_i++) {
        dse_real R_th, Q_th[9], inverse[3] = {0}, q[9];
        for (int r = 0; r < n_i; r++) {
            inverse[r] = dse_pow(theta, (dse_real)(N_MAX - n_i + r));
            for (int c = 0; c < n_i; c++) {
                q[r * n_i + c] = Q[r * 3 + c];
            }
        }
        dse_high_gain_weights(DSE_HIGH_GAIN_FULL, 1, &n_i, N_MAX, theta, &R, q, &R_th, Q_th);
        assert_near(inverse[0] * inverse[0] / R_th, theta / R, TOLERANCE(1e-12, 1e-4));
        for (int r = 0; r < n_i; r++) {
            for (int c = 0; c < n_i; c++) {
                const dse_real want = theta * inverse[r] * q[r * n_i + c] * inverse[c];
                assert_near(Q_th[r * n_i + c], want, TOLERANCE(1e-13, 1e-5) * want);
            }
        }
    }
}

static void scalings_agree_at_theta_one_and_plain_is_proportional(void **state)
{
    (void)state;
    const dse_real Q[4] = {5, 1, 1, 6}, R = 3;
    const int chain = 2;
    dse_real R_full, R_plain, full[4], plain[4];
    dse_high_gain_weights(DSE_HIGH_GAIN_FULL, 1, &chain, 4, 1, &R, Q, &R_full, full);
    dse_high_gain_weights(DSE_HIGH_GAIN_PLAIN, 1, &chain, 4, 1, &R, Q, &R_plain, plain);
    assert_near(R_full, R_plain, 0);
    assert_memory_equal(full, plain, sizeof full);
    dse_high_gain_weights(DSE_HIGH_GAIN_PLAIN, 1, &chain, 4, 8, &R, Q, &R_plain, plain);
    assert_near(R_plain, DSE_REAL(0.375), 0);
    for (int k = 0; k < 4; k++) {
        assert_near(plain[k], 8 * Q[k], 0);
    }
}

/* ---- a linear plant with an identity map, that can be made to fail ---- */

enum { LINEAR_P = 3, LINEAR_N = 5 };

struct linear {
    dse_real A[LINEAR_N * LINEAR_N];
    bool broken; /* no function can be evaluated */
    bool wild;   /* derivatives are infinite */
};

static const int linear_blocks[LINEAR_P] = {2, 1, 2};
static const int linear_outputs[LINEAR_P] = {0, 2, 3};

static enum dse_status linear_field(const struct linear *linear, int n, const dse_real *x,
                                    dse_real *dx)
{
    if (linear->broken) {
        return DSE_EMODEL;
    }
    dse_mat_vec(n, n, linear->A, x, dx);
    if (linear->wild) {
        dx[0] = (dse_real)INFINITY;
    }
    return DSE_OK;
}

static enum dse_status linear_f(const struct dse_model *model, dse_real t, const dse_real *x,
                                const dse_real *u, dse_real *dx)
{
    (void)t;
    (void)u;
    return linear_field(model->parameters, model->nx, x, dx);
}

static enum dse_status linear_h(const struct dse_model *model, dse_real t, const dse_real *x,
                                const dse_real *u, dse_real *y)
{
    (void)t;
    (void)u;
    for (int j = 0; j < model->ny && j < LINEAR_P; j++) {
        y[j] = x[linear_outputs[j]];
    }
    return DSE_OK;
}

static enum dse_status linear_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                   const dse_real *u, dse_real *F)
{
    const struct linear *linear = model->parameters;
    (void)t;
    (void)x;
    (void)u;
    memcpy(F, linear->A, (size_t)(model->nx * model->nx) * sizeof *F);
    return DSE_OK;
}

static enum dse_status same(const struct dse_normal_form *form, dse_real t, const dse_real *in,
                            const dse_real *u, dse_real *out)
{
    (void)t;
    (void)u;
    memcpy(out, in, (size_t)form->n * sizeof *out);
    return DSE_OK;
}

static enum dse_status form_field(const struct dse_normal_form *form, dse_real t, const dse_real *z,
                                  const dse_real *u, dse_real *dz)
{
    (void)t;
    (void)u;
    return linear_field(form->parameters, form->n, z, dz);
}

static enum dse_status form_jacobian(const struct dse_normal_form *form, int i, dse_real t,
                                     const dse_real *z, const dse_real *u, dse_real *F)
{
    const struct linear *linear = form->parameters;
    const int n_i = form->n_i[i], offset = linear_outputs[i];
    (void)t;
    (void)z;
    (void)u;
    for (int r = 0; r < n_i; r++) {
        for (int c = 0; c < n_i; c++) {
            F[r * n_i + c] = linear->A[(offset + r) * form->n + offset + c];
        }
    }
    return DSE_OK;
}

static enum dse_status form_map(const struct dse_normal_form *form, int i, dse_real t,
                                const dse_real *chi, const dse_real *u, dse_real *M)
{
    (void)t;
    (void)chi;
    (void)u;
    dse_mat_identity(form->n_i[i], M);
    return DSE_OK;
}

/* p = 3 blocks of 2, 1, 2 states, or p = 1 block of 2. */
static void linear_plant(const struct linear *linear, int p, struct dse_model *model,
                         struct dse_normal_form *form)
{
    const int n = p == 1 ? 2 : LINEAR_N;
    *model = (struct dse_model){.time = DSE_CONTINUOUS,
                                .nx = n,
                                .ny = p,
                                .parameters = linear,
                                .f = linear_f,
                                .h = linear_h,
                                .dfdx = linear_dfdx};
    *form = (struct dse_normal_form){.n = n,
                                     .p = p,
                                     .n_i = linear_blocks,
                                     .parameters = linear,
                                     .encode = same,
                                     .decode = same,
                                     .field = form_field,
                                     .jacobian = form_jacobian,
                                     .map_jacobian = form_map};
}

static const struct linear coupled = {.A = {0,
                                            1,
                                            0,
                                            0,
                                            0, /**/
                                            -8,
                                            -4,
                                            1,
                                            0,
                                            0, /**/
                                            DSE_REAL(0.5),
                                            0,
                                            -3,
                                            1,
                                            0, /**/
                                            0,
                                            0,
                                            0,
                                            0,
                                            1, /**/
                                            1,
                                            0,
                                            2,
                                            -9,
                                            -5}};

/* ---- a network in one process ---- */

enum { MAX_P = 3, MAX_N = 5, HORIZON = 6, CSTR_HORIZON = 72 };

struct network {
    struct linear linear; /* or: */
    dse_real prepared[256];
    struct dse_model model;
    struct dse_normal_form form;
    int n, p;
    dse_real x[MAX_N]; /* the plant */
    dse_real u[2];
    dse_real x0[MAX_N], P0[4], P0_single[1], Q[4], Q_single[1];
    struct dse_high_gain_ekf_config config[MAX_P];
    struct dse_high_gain_ekf filter[MAX_P];
    int64_t k;
    /* what the tests do to the network */
    bool lose[MAX_P][MAX_P]; /* [i][j]: i does not hear j */
    bool blind[MAX_P];       /* no measurement for i */
    dse_real memory[MAX_P][DSE_HIGH_GAIN_EKF_STORAGE(MAX_N, 2, MAX_P, MAX_P, 2, CSTR_HORIZON)];
    bool backwards; /* messages are taken in from the last sender to the first */
};

static void init_filters(struct network *network, const struct dse_high_gain_ekf_config *config)
{
    for (int i = 0; i < network->p; i++) {
        struct dse_arena arena;
        const bool single = network->form.n_i[i] == 1;
        network->config[i] = *config;
        network->config[i].model = &network->model;
        network->config[i].form = &network->form;
        network->config[i].i = i;
        network->config[i].x0 = network->x0;
        network->config[i].P0 = single ? network->P0_single : network->P0;
        network->config[i].Q = single ? network->Q_single : network->Q;
        dse_arena_init(&arena, network->memory[i],
                       (int)(sizeof network->memory[i] / sizeof(dse_real)));
        assert_int_equal(dse_high_gain_ekf_init(&network->filter[i], &network->config[i], &arena),
                         DSE_OK);
    }
}

static void linear_network(struct network *network, const struct dse_high_gain_ekf_config *config)
{
    *network = (struct network){.linear = coupled,
                                .n = LINEAR_N,
                                .p = LINEAR_P,
                                .x = {1, 0, -1, 2, 1},
                                .x0 = {3, 1, 1, -1, 0},
                                .P0 = {2, DSE_REAL(0.5), DSE_REAL(0.5), 3},
                                .P0_single = {2},
                                .Q = {5, 0, 0, 5},
                                .Q_single = {5}};
    linear_plant(&network->linear, LINEAR_P, &network->model, &network->form);
    init_filters(network, config);
}

static void cstr_network(struct network *network, const struct dse_high_gain_ekf_config *config)
{
    const struct dse_plant *plant = dse_plant_find("cstr2");
    *network = (struct network){.n = 4,
                                .p = 2,
                                .x = {360, 3, 320, DSE_REAL(2.5)},
                                .u = {DSE_REAL(4.998), 0},
                                .x0 = {396, DSE_REAL(2.6), 352, DSE_REAL(10.5)},
                                .P0 = {1, 0, 0, 1},
                                .Q = {150, 0, 0, 5}};
    assert_true(plant->prepared_size <= 256);
    assert_int_equal(plant->prepare(plant->sets[0].values, network->prepared), DSE_OK);
    plant->model(network->prepared, &network->model);
    plant->normal_form(network->prepared, &network->form);
    init_filters(network, config);
}

static void exchange(struct network *network, int round)
{
    dse_real message[MAX_P][DSE_HIGH_GAIN_EKF_MESSAGE(2)] = {{0}};
    int count[MAX_P] = {0};
    for (int j = 0; j < network->p; j++) {
        count[j] = dse_high_gain_ekf_message(&network->filter[j], round, message[j]);
    }
    for (int i = 0; i < network->p; i++) {
        for (int l = 0; l < network->p; l++) {
            const int j = network->backwards ? network->p - 1 - l : l;
            if (j != i && !network->lose[i][j]) {
                assert_int_equal(
                    dse_high_gain_ekf_receive(&network->filter[i], round, j, message[j], count[j]),
                    DSE_OK);
            }
        }
    }
}

static void begin_tick(struct network *network)
{
    dse_real y[MAX_P];
    const dse_real t = (dse_real)network->k * network->config[0].period;
    assert_int_equal(network->model.h(&network->model, t, network->x, network->u, y), DSE_OK);
    for (int i = 0; i < network->p; i++) {
        const bool valid = !network->blind[i];
        const struct dse_measurement own = {.y = y + i, .valid = &valid};
        assert_int_equal(
            dse_high_gain_ekf_begin(&network->filter[i], network->k, t, network->u, &own), DSE_OK);
    }
}

static void end_tick(struct network *network)
{
    dse_real scratch[DSE_RK4_SCRATCH(MAX_N)];
    const int rounds = dse_high_gain_ekf_rounds(&network->filter[0]);
    for (int r = 0; r < rounds; r++) {
        exchange(network, r);
        for (int i = 0; i < network->p; i++) {
            assert_int_equal(dse_high_gain_ekf_advance(&network->filter[i], r), DSE_OK);
        }
    }
    for (int i = 0; i < network->p; i++) {
        assert_int_equal(dse_high_gain_ekf_finish(&network->filter[i]), DSE_OK);
    }
    assert_int_equal(dse_rk4_model_step(&network->model,
                                        (dse_real)network->k * network->config[0].period,
                                        network->config[0].period, network->u, network->x, scratch),
                     DSE_OK);
    network->k++;
}

static void tick(struct network *network)
{
    begin_tick(network);
    end_tick(network);
}

static struct dse_high_gain_ekf_config linear_config(void)
{
    return (struct dse_high_gain_ekf_config){.period = DSE_REAL(0.01),
                                             .innovation = DSE_HIGH_GAIN_SUM,
                                             .R = 1,
                                             .adaptation = {.theta_m = 4,
                                                            .rise_time = DSE_REAL(0.02),
                                                            .relaxation = 2,
                                                            .sharpness = 50,
                                                            .threshold = DSE_REAL(0.05)},
                                             .horizon = HORIZON};
}

/* Section 2.6. */
static struct dse_high_gain_ekf_config cstr_config(void)
{
    return (struct dse_high_gain_ekf_config){.period = HOUR_PER_SECOND,
                                             .innovation = DSE_HIGH_GAIN_SUM,
                                             .communication = DSE_HIGH_GAIN_STAGES,
                                             .R = 1,
                                             .adaptation = ch2_gain,
                                             .horizon = CSTR_HORIZON};
}

/* Everything that a filter carries from tick to tick has the same bits. */
static void assert_same_state(const struct network *a, const struct network *b)
{
    for (int i = 0; i < a->p; i++) {
        const struct dse_high_gain_ekf *f = &a->filter[i], *g = &b->filter[i];
        assert_memory_equal(f->x, g->x, (size_t)f->n * sizeof *f->x);
        assert_memory_equal(f->P, g->P, (size_t)(f->n_i * f->n_i) * sizeof *f->P);
        assert_memory_equal(&f->theta, &g->theta, sizeof f->theta);
        assert_memory_equal(f->ring, g->ring,
                            (size_t)((f->config->horizon + 1) * (f->n + 1)) * sizeof *f->ring);
    }
}

/* ---- Riccati ---- */

/* A single block with F = [0 1; -700 -54]; Q_th = 40 diag(1,40) diag(5,5) diag(1,40), R_th = 1/40.
 */
static void riccati_reaches_the_solution_of_the_algebraic_equation(void **state)
{
    (void)state;
    static const struct linear plant = {.A = {0, 1, -700, -54}};
    static const dse_real zero[2] = {0}, identity[4] = {1, 0, 0, 1}, Q[4] = {5, 0, 0, 5};
    dse_real storage[DSE_HIGH_GAIN_EKF_STORAGE(2, 0, 1, 1, 2, 0)];
    struct dse_model model;
    struct dse_normal_form form;
    linear_plant(&plant, 1, &model, &form);
    const struct dse_high_gain_ekf_config config = {.model = &model,
                                                    .form = &form,
                                                    .period = HOUR_PER_SECOND,
                                                    .gain = DSE_HIGH_GAIN_MAX,
                                                    .x0 = zero,
                                                    .P0 = identity,
                                                    .Q = Q,
                                                    .R = 1,
                                                    .adaptation = {.theta_m = 20}};
    struct dse_high_gain_ekf filter;
    struct dse_arena arena;
    dse_arena_init(&arena, storage, DSE_HIGH_GAIN_EKF_STORAGE(2, 0, 1, 1, 2, 0));
    assert_int_equal(dse_high_gain_ekf_init(&filter, &config, &arena), DSE_OK);
    const dse_real y = 0;
    const struct dse_measurement measurement = {.y = &y};
    const dse_real *P = dse_high_gain_ekf_covariance(&filter);
    for (int k = 0; k < 3600; k++) {
        if (k == 360) {
            assert_near(P[0], DSE_REAL(2.33), DSE_REAL(0.005));
            assert_near(P[1], DSE_REAL(8.19), DSE_REAL(0.005));
            assert_near(P[2], P[1], 0);
            assert_near(P[3], DSE_REAL(2831.99), TOLERANCE(0.005, 0.05));
        }
        assert_int_equal(
            dse_high_gain_ekf_begin(&filter, k, (dse_real)k / 3600, NULL, &measurement), DSE_OK);
        assert_int_equal(dse_high_gain_ekf_finish(&filter), DSE_OK);
    }
    /* FP + PF' + Q_th - P C' R_th^-1 C P = 0 */
    const dse_real r00 = 2 * P[1] + 200 - 40 * P[0] * P[0];
    const dse_real r01 = P[3] - 700 * P[0] - 54 * P[1] - 40 * P[0] * P[1];
    const dse_real r11 = 2 * (-700 * P[1] - 54 * P[3]) + 320000 - 40 * P[1] * P[1];
    assert_near(r00, 0, TOLERANCE(1e-6, 1e-2));
    assert_near(r01, 0, TOLERANCE(1e-4, 1));
    assert_near(r11, 0, TOLERANCE(1e-3, 10));
}

#ifndef DSE_REAL_IS_float
/* V = sum eps_i' S_i eps_i in normal coordinates. */
static double lyapunov(const struct network *network)
{
    double z[4], V = 0;
    assert_int_equal(network->form.encode(&network->form, 0, network->x, network->u, z), DSE_OK);
    for (int i = 0; i < 2; i++) {
        const double *P = dse_high_gain_ekf_covariance(&network->filter[i]);
        const double *picture = dse_high_gain_ekf_picture(&network->filter[i]);
        const double e0 = picture[2 * i] - z[2 * i], e1 = picture[2 * i + 1] - z[2 * i + 1];
        const double determinant = P[0] * P[3] - P[1] * P[2];
        V += (P[3] * e0 * e0 - 2 * P[1] * e0 * e1 + P[0] * e1 * e1) / determinant;
    }
    return V;
}

/* Section 4.8: 2-CSTR, continuous communication, theta = 40, no noise, half an hour. */
static void error_energy_falls_in_every_tick_at_the_permanent_high_gain(void **state)
{
    (void)state;
    static struct network network;
    struct dse_high_gain_ekf_config config = cstr_config();
    config.gain = DSE_HIGH_GAIN_MAX;
    config.horizon = 0;
    cstr_network(&network, &config);
    double before = INFINITY;
    for (int k = 0; k < 1800; k++) {
        tick(&network);
        const double now = lyapunov(&network);
        assert_true(now < before);
        before = now;
    }
    assert_true(before < 1e-7);
}

struct run_errors {
    double T[2], C[2];           /* rmse over the whole run */
    double late_T[2], late_C[2]; /* after 0.3 h */
    int theta_high;              /* first tick with theta > 39, or -1 */
    int theta_low;               /* tick from which theta < 2 for good */
};

/* Half an hour of section 2.6 without noise. */
static struct run_errors cstr_run(const struct dse_high_gain_ekf_config *config)
{
    static struct network network;
    struct run_errors e = {.theta_high = -1};
    cstr_network(&network, config);
    for (int k = 0; k < 1800; k++) {
        double x[4];
        memcpy(x, network.x, sizeof x);
        tick(&network);
        const double theta = dse_high_gain_ekf_theta(&network.filter[0]);
        e.theta_high = e.theta_high < 0 && theta > 39 ? k : e.theta_high;
        e.theta_low = theta < 2 ? e.theta_low : k + 1;
        for (int i = 0; i < 2; i++) {
            const double *estimate = dse_high_gain_ekf_estimate(&network.filter[i]);
            const double T2 = pow(estimate[0] - x[2 * i], 2),
                         C2 = pow(estimate[1] - x[2 * i + 1], 2);
            e.T[i] += T2 / 1800;
            e.C[i] += C2 / 1800;
            e.late_T[i] += k > 1080 ? T2 / 719 : 0;
            e.late_C[i] += k > 1080 ? C2 / 719 : 0;
        }
    }
    for (int i = 0; i < 2; i++) {
        e.T[i] = sqrt(e.T[i]);
        e.C[i] = sqrt(e.C[i]);
        e.late_T[i] = sqrt(e.late_T[i]);
        e.late_C[i] = sqrt(e.late_C[i]);
    }
    return e;
}

/* AHG-43, Fig 2.4, noise-free; figures of the spec's section 6. */
static void adaptive_gain_converges_faster_than_the_regular_filter(void **state)
{
    (void)state;
    struct dse_high_gain_ekf_config config = cstr_config();
    const struct run_errors adaptive = cstr_run(&config);
    config.gain = DSE_HIGH_GAIN_ONE;
    const struct run_errors regular = cstr_run(&config);
    for (int i = 0; i < 2; i++) {
        assert_true(adaptive.T[i] < 0.5 * regular.T[i]);
        assert_true(adaptive.C[i] < 0.5 * regular.C[i]);
    }
    assert_near(adaptive.T[0], 3.5, 0.05);
    assert_near(adaptive.T[1], 3.1, 0.05);
    assert_near(adaptive.C[0], 2.09, 0.005);
    assert_near(adaptive.C[1], 1.77, 0.005);
    assert_near(regular.C[0], 7.54, 0.005);
    assert_near(regular.C[1], 5.56, 0.005);
    assert_in_range(adaptive.theta_high, 1, 15);
    assert_true(adaptive.theta_low < 0.07 * 3600);
}

/* Section 4.6: 0.76 and 0.59 with one exchange per tick, 0.67 and 0.52 with the common picture. */
static void one_exchange_per_tick_comes_close_to_continuous_communication(void **state)
{
    (void)state;
    struct dse_high_gain_ekf_config config = cstr_config();
    const struct run_errors stages = cstr_run(&config);
    config.communication = DSE_HIGH_GAIN_TICK;
    const struct run_errors once = cstr_run(&config);
    assert_near(stages.late_C[0], 0.67, 0.005);
    assert_near(stages.late_C[1], 0.52, 0.005);
    assert_near(once.late_C[0], 0.76, 0.005);
    assert_near(once.late_C[1], 0.59, 0.005);
}

/* AHG-51's feed, no measurements: with its rate known the picture that starts on the truth stays on
 * it; with samples only, held over a tick, it is encoded anew at every jump and stays near. */
static double feed_error(bool rate_known)
{
    static struct network network;
    struct dse_high_gain_ekf_config config = cstr_config();
    config.communication = DSE_HIGH_GAIN_TICK;
    cstr_network(&network, &config);
    memcpy(network.x0, network.x, sizeof network.x0);
    init_filters(&network, &config);
    network.blind[0] = network.blind[1] = true;
    double worst = 0;
    for (int k = 0; k < 720; k++) {
        const double w = 0.008;
        const double u[2] = {10 * (1 + 0.9 * sin(w * k)), 10 * 0.9 * w * 3600 * cos(w * k)};
        network.u[0] = u[0];
        network.u[1] = rate_known ? u[1] : 0;
        begin_tick(&network);
        for (int i = 0; i < 2; i++) {
            const double *estimate = dse_high_gain_ekf_estimate(&network.filter[i]);
            worst = fmax(worst, fabs(estimate[1] - network.x[2 * i + 1]));
        }
        /* the plant in twenty steps with the true feed of their middle */
        double x[4], scratch[DSE_RK4_SCRATCH(4)];
        memcpy(x, network.x, sizeof x);
        end_tick(&network);
        for (int s = 0; s < 20; s++) {
            const double middle[2] = {10 * (1 + 0.9 * sin(w * (k + (s + 0.5) / 20))), 0};
            assert_int_equal(
                dse_rk4_model_step(&network.model, 0, HOUR_PER_SECOND / 20, middle, x, scratch),
                DSE_OK);
        }
        memcpy(network.x, x, sizeof x);
    }
    return worst;
}

static void varying_feed_is_followed(void **state)
{
    (void)state;
    assert_true(feed_error(true) < 1e-5);
    assert_true(feed_error(false) < 2e-3);
}
#endif

/* The physical estimate does not jump with the input, although its coordinates do. */
static void picture_is_encoded_anew_when_the_input_jumps(void **state)
{
    (void)state;
    static struct network network, other;
    struct dse_high_gain_ekf_config config = cstr_config();
    config.communication = DSE_HIGH_GAIN_TICK;
    cstr_network(&network, &config);
    cstr_network(&other, &config);
    for (int k = 0; k < 10; k++) {
        tick(&network);
        tick(&other);
    }
    network.u[0] = 10;
    begin_tick(&network);
    begin_tick(&other);
    for (int i = 0; i < 2; i++) {
        const dse_real *jumped = dse_high_gain_ekf_estimate(&network.filter[i]);
        const dse_real *steady = dse_high_gain_ekf_estimate(&other.filter[i]);
        dse_real message[3], unchanged[3];
        assert_near(jumped[0], steady[0], TOLERANCE(1e-10, 1e-3));
        assert_near(jumped[1], steady[1], TOLERANCE(1e-10, 1e-2));
        assert_int_equal(dse_high_gain_ekf_message(&network.filter[i], 0, message), 3);
        assert_int_equal(dse_high_gain_ekf_message(&other.filter[i], 0, unchanged), 3);
        assert_true(dse_abs(message[2] - unchanged[2]) > 10);
    }
}

/* ---- an undivided nonlinear system: x1' = x2 + 0.3 x1^2, x2' = -x1 - x2, z = (x1, x1') ---- */

static enum dse_status bend_f(const struct dse_model *model, dse_real t, const dse_real *x,
                              const dse_real *u, dse_real *dx)
{
    (void)model;
    (void)t;
    (void)u;
    dx[0] = x[1] + DSE_REAL(0.3) * x[0] * x[0];
    dx[1] = -x[0] - x[1];
    return DSE_OK;
}

static enum dse_status bend_encode(const struct dse_normal_form *form, dse_real t,
                                   const dse_real *chi, const dse_real *u, dse_real *z)
{
    (void)form;
    (void)t;
    (void)u;
    z[0] = chi[0];
    z[1] = chi[1] + DSE_REAL(0.3) * chi[0] * chi[0];
    return DSE_OK;
}

static enum dse_status bend_decode(const struct dse_normal_form *form, dse_real t,
                                   const dse_real *z, const dse_real *u, dse_real *chi)
{
    (void)form;
    (void)t;
    (void)u;
    chi[0] = z[0];
    chi[1] = z[1] - DSE_REAL(0.3) * z[0] * z[0];
    return DSE_OK;
}

static enum dse_status bend_field(const struct dse_normal_form *form, dse_real t, const dse_real *z,
                                  const dse_real *u, dse_real *dz)
{
    (void)form;
    (void)t;
    (void)u;
    dz[0] = z[1];
    dz[1] = -z[0] - (z[1] - DSE_REAL(0.3) * z[0] * z[0]) + DSE_REAL(0.6) * z[0] * z[1];
    return DSE_OK;
}

static enum dse_status bend_jacobian(const struct dse_normal_form *form, int i, dse_real t,
                                     const dse_real *z, const dse_real *u, dse_real *F)
{
    (void)form;
    (void)i;
    (void)t;
    (void)u;
    F[0] = 0;
    F[1] = 1;
    F[2] = -1 + DSE_REAL(0.6) * (z[0] + z[1]);
    F[3] = -1 + DSE_REAL(0.6) * z[0];
    return DSE_OK;
}

static enum dse_status bend_map(const struct dse_normal_form *form, int i, dse_real t,
                                const dse_real *chi, const dse_real *u, dse_real *M)
{
    (void)form;
    (void)i;
    (void)t;
    (void)u;
    M[0] = 1;
    M[1] = 0;
    M[2] = DSE_REAL(0.6) * chi[0];
    M[3] = 1;
    return DSE_OK;
}

/* Correcting z by K e is correcting chi by M^-1 K e (4.1); also a filter alone has no rounds. */
static void mapped_and_normal_are_one_filter_for_an_undivided_system(void **state)
{
    (void)state;
    static struct network normal, mapped;
    struct network *both[2] = {&normal, &mapped};
    struct dse_high_gain_ekf_config config = linear_config();
    for (int b = 0; b < 2; b++) {
        *both[b] = (struct network){.n = 2,
                                    .p = 1,
                                    .x = {1, DSE_REAL(-0.5)},
                                    .x0 = {DSE_REAL(0.5), 1},
                                    .P0 = {2, 0, 0, 2},
                                    .Q = {5, 0, 0, 5}};
        both[b]->model = (struct dse_model){
            .time = DSE_CONTINUOUS, .nx = 2, .ny = 1, .f = bend_f, .h = linear_h};
        both[b]->form = (struct dse_normal_form){.n = 2,
                                                 .p = 1,
                                                 .n_i = linear_blocks,
                                                 .encode = bend_encode,
                                                 .decode = bend_decode,
                                                 .field = bend_field,
                                                 .jacobian = bend_jacobian,
                                                 .map_jacobian = bend_map};
        config.coords = b == 0 ? DSE_HIGH_GAIN_NORMAL : DSE_HIGH_GAIN_MAPPED;
        init_filters(both[b], &config);
        for (int k = 0; k < 100; k++) {
            tick(both[b]);
            assert_int_equal(dse_high_gain_ekf_rounds(&both[b]->filter[0]), 0);
        }
    }
    for (int r = 0; r < 2; r++) {
        assert_near(normal.filter[0].estimate[r], mapped.filter[0].estimate[r],
                    TOLERANCE(1e-6, 1e-4));
        assert_near(normal.filter[0].estimate_covariance[3 * r],
                    mapped.filter[0].estimate_covariance[3 * r], TOLERANCE(1e-6, 1e-4));
    }
    /* and the coordinates do differ here */
    assert_true(dse_abs(normal.filter[0].x[1] - mapped.filter[0].x[1]) > DSE_REAL(1e-3));
}

/* With an identity map the three coordinates are one filter, theta and all. */
static void coordinates_agree_when_the_map_is_the_identity(void **state)
{
    (void)state;
    static struct network networks[3];
    for (int c = 0; c < 3; c++) {
        struct dse_high_gain_ekf_config config = linear_config();
        config.coords = (enum dse_high_gain_coords)c;
        linear_network(&networks[c], &config);
        for (int k = 0; k < 2 * HORIZON; k++) {
            tick(&networks[c]);
        }
        assert_same_state(&networks[0], &networks[c]);
    }
}

static void physical_covariance_is_that_of_the_decoded_block(void **state)
{
    (void)state;
    static struct network network;
    const struct dse_high_gain_ekf_config config = cstr_config();
    cstr_network(&network, &config);
    tick(&network);
    begin_tick(&network);
    for (int i = 0; i < 2; i++) {
        /* M P_chi M' = P */
        const dse_real *P = dse_high_gain_ekf_covariance(&network.filter[i]);
        dse_real chi[4], M[4], back[4], scratch[4];
        assert_int_equal(network.form.decode(&network.form, 0,
                                             dse_high_gain_ekf_picture(&network.filter[i]),
                                             network.u, chi),
                         DSE_OK);
        assert_int_equal(network.form.map_jacobian(&network.form, i, 0, chi, network.u, M), DSE_OK);
        dse_sym_congruence(2, 2, M, dse_high_gain_ekf_estimate_covariance(&network.filter[i]), NULL,
                           back, scratch);
        for (int k = 0; k < 4; k++) {
            assert_near(back[k], P[k], TOLERANCE(1e-10, 2e-2) * (1 + dse_abs(P[k])));
        }
    }
}

/* ---- messages ---- */

static const enum dse_high_gain_communication ways[] = {DSE_HIGH_GAIN_TICK, DSE_HIGH_GAIN_STAGES};

static void order_of_messages_does_not_matter(void **state)
{
    (void)state;
    static struct network forwards, backwards;
    for (int way = 0; way < 2; way++) {
        struct dse_high_gain_ekf_config config = linear_config();
        config.communication = ways[way];
        linear_network(&forwards, &config);
        linear_network(&backwards, &config);
        backwards.backwards = true;
        for (int k = 0; k < 3 * HORIZON; k++) {
            tick(&forwards);
            tick(&backwards);
        }
        assert_same_state(&forwards, &backwards);
    }
}

static void filters_that_share_the_innovation_have_the_same_gain_to_the_last_bit(void **state)
{
    (void)state;
    static struct network network;
    const struct dse_high_gain_ekf_config config = linear_config();
    linear_network(&network, &config);
    dse_real highest = 1;
    for (int k = 0; k < 3 * HORIZON; k++) {
        tick(&network);
        const dse_real theta = dse_high_gain_ekf_theta(&network.filter[0]);
        highest = dse_max(highest, theta);
        dse_real sum = 0;
        for (int i = 0; i < LINEAR_P; i++) {
            const dse_real other = dse_high_gain_ekf_theta(&network.filter[i]);
            assert_memory_equal(&other, &theta, sizeof theta);
            sum += dse_high_gain_ekf_innovation(&network.filter[i]);
        }
        assert_near(dse_high_gain_ekf_drive(&network.filter[1]), sum, 0);
    }
    assert_true(highest > 2); /* it did move */
}

static void stages_give_all_filters_one_common_picture(void **state)
{
    (void)state;
    static struct network network;
    struct dse_high_gain_ekf_config config = linear_config();
    config.communication = DSE_HIGH_GAIN_STAGES;
    linear_network(&network, &config);
    for (int k = 0; k < HORIZON; k++) {
        tick(&network);
        for (int i = 1; i < LINEAR_P; i++) {
            assert_memory_equal(network.filter[i].base, network.filter[0].base,
                                LINEAR_N * sizeof(dse_real));
        }
    }
}

static void messages_follow_the_schedule(void **state)
{
    (void)state;
    static struct network network;
    static const struct {
        enum dse_high_gain_communication communication;
        enum dse_high_gain_innovation innovation;
        int every;
        int rounds[4], count[4]; /* of filter 0, which has two states */
    } cases[] = {
        {DSE_HIGH_GAIN_TICK, DSE_HIGH_GAIN_OWN, 0, {1, 1, 1, 1}, {3, 3, 3, 3}},
        {DSE_HIGH_GAIN_TICK, DSE_HIGH_GAIN_OWN, 3, {1, 0, 0, 1}, {3, 0, 0, 3}},
        {DSE_HIGH_GAIN_TICK, DSE_HIGH_GAIN_SUM, 3, {1, 1, 1, 1}, {3, 1, 1, 3}},
        {DSE_HIGH_GAIN_STAGES, DSE_HIGH_GAIN_SUM, 1, {4, 4, 4, 4}, {3, 3, 3, 3}},
        {DSE_HIGH_GAIN_NONE, DSE_HIGH_GAIN_OWN, 1, {0, 0, 0, 0}, {0, 0, 0, 0}},
    };
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++) {
        struct dse_high_gain_ekf_config config = linear_config();
        config.communication = cases[c].communication;
        config.innovation = cases[c].innovation;
        config.comm_every_ticks = cases[c].every;
        linear_network(&network, &config);
        for (int k = 0; k < 4; k++) {
            dse_real message[DSE_HIGH_GAIN_EKF_MESSAGE(2)];
            begin_tick(&network);
            assert_int_equal(dse_high_gain_ekf_rounds(&network.filter[0]), cases[c].rounds[k]);
            assert_int_equal(dse_high_gain_ekf_message(&network.filter[0], 0, message),
                             cases[c].count[k]);
            /* not the time of the other rounds */
            assert_int_equal(dse_high_gain_ekf_message(&network.filter[0], 1, message), 0);
            assert_int_equal(dse_high_gain_ekf_message(&network.filter[0], -1, message), 0);
            end_tick(&network);
        }
    }
}

static void refused_messages_change_nothing_but_the_counter(void **state)
{
    (void)state;
    static struct network clean, disturbed;
    const dse_real good[4] = {1, 2, 3, 4}, nan[3] = {1, (dse_real)NAN, 3},
                   inf[3] = {(dse_real)INFINITY, 2, 3};
    const struct dse_high_gain_ekf_config config = linear_config();
    linear_network(&clean, &config);
    linear_network(&disturbed, &config);
    tick(&clean);
    struct dse_high_gain_ekf *f = &disturbed.filter[0];
    assert_int_equal(dse_high_gain_ekf_receive(f, 0, 2, good, 3), DSE_EINVAL); /* no tick open */
    begin_tick(&disturbed);
    assert_int_equal(dse_high_gain_ekf_receive(f, 1, 2, good, 3), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_receive(f, -1, 2, good, 3), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_receive(f, 0, 0, good, 3), DSE_EINVAL); /* from itself */
    assert_int_equal(dse_high_gain_ekf_receive(f, 0, 3, good, 3), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_receive(f, 0, -1, good, 3), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_receive(f, 0, 2, NULL, 3), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_receive(f, 0, 2, good, 1), DSE_EFORMAT);
    assert_int_equal(dse_high_gain_ekf_receive(f, 0, 2, good, 4), DSE_EFORMAT);
    assert_int_equal(dse_high_gain_ekf_receive(f, 0, 1, good, 3), DSE_EFORMAT); /* one state */
    assert_int_equal(dse_high_gain_ekf_receive(f, 0, 2, nan, 3), DSE_ENONFINITE);
    assert_int_equal(dse_high_gain_ekf_receive(f, 0, 2, inf, 3), DSE_ENONFINITE);
    end_tick(&disturbed);
    assert_same_state(&clean, &disturbed);
    assert_int_equal(dse_high_gain_ekf_counters(f)->refused, 12);
    assert_int_equal(dse_high_gain_ekf_counters(&clean.filter[0])->refused, 0);
}

static void second_message_of_a_sender_is_ignored(void **state)
{
    (void)state;
    static struct network clean, disturbed;
    const struct dse_high_gain_ekf_config config = linear_config();
    linear_network(&clean, &config);
    linear_network(&disturbed, &config);
    tick(&clean);
    begin_tick(&disturbed);
    dse_real message[DSE_HIGH_GAIN_EKF_MESSAGE(2)];
    assert_int_equal(dse_high_gain_ekf_message(&disturbed.filter[2], 0, message), 3);
    assert_int_equal(dse_high_gain_ekf_receive(&disturbed.filter[0], 0, 2, message, 3), DSE_OK);
    message[1] += 100;
    assert_int_equal(dse_high_gain_ekf_receive(&disturbed.filter[0], 0, 2, message, 3), DSE_OK);
    end_tick(&disturbed);
    assert_same_state(&clean, &disturbed);
    assert_int_equal(dse_high_gain_ekf_counters(&disturbed.filter[0])->duplicates, 2);
}

/* Filter 0 loses the message of filter 2 in one tick: its block goes on as the model predicts, the
 * innovation of filter 2 is the last one known. */
static void lost_message_is_predicted_or_held_and_counted(void **state)
{
    (void)state;
    static struct network network;
    for (int hold = 0; hold < 2; hold++) {
        struct dse_high_gain_ekf_config config = linear_config();
        config.predictor = hold ? DSE_HIGH_GAIN_HOLD : DSE_HIGH_GAIN_PREDICT;
        linear_network(&network, &config);
        tick(&network);
        tick(&network);
        const dse_real last_J = dse_high_gain_ekf_innovation(&network.filter[2]);
        dse_real before[LINEAR_N];
        memcpy(before, dse_high_gain_ekf_picture(&network.filter[0]), sizeof before);
        network.lose[0][2] = true;
        tick(&network);
        const struct dse_high_gain_ekf *f = &network.filter[0];
        assert_near(f->base[3], before[3], 0);
        assert_near(f->base[4], before[4], 0);
        assert_near(dse_high_gain_ekf_drive(f),
                    dse_high_gain_ekf_innovation(f) +
                        dse_high_gain_ekf_innovation(&network.filter[1]) + last_J,
                    TOLERANCE(1e-14, 1e-6));
        assert_int_equal(dse_high_gain_ekf_counters(f)->missing_states, 1);
        assert_int_equal(dse_high_gain_ekf_counters(f)->missing_innovations, 1);
        assert_int_equal(dse_high_gain_ekf_counters(&network.filter[1])->missing_states, 0);
        assert_true(hold == (dse_abs(f->x[3] - before[3]) <= 0));
        /* the next message mends the picture */
        network.lose[0][2] = false;
        const dse_real mended = dse_high_gain_ekf_picture(&network.filter[2])[3];
        tick(&network);
        assert_near(f->base[3], mended, 0);
    }
}

/* Between messages block j /= i follows z_j' = A_j z_j + b_j(x^{p,i}) (3.7). Filter 1's own block
 * does not move here: no measurement, and its state does not act on the others. */
static void predictor_follows_the_model_between_messages(void **state)
{
    (void)state;
    static struct network network;
    struct dse_high_gain_ekf_config config = linear_config();
    config.comm_every_ticks = 1000;
    config.innovation = DSE_HIGH_GAIN_OWN;
    linear_network(&network, &config);
    network.blind[1] = true; /* then filter 1 is a model and nothing else */
    dse_real free_run[LINEAR_N], scratch[DSE_RK4_SCRATCH(LINEAR_N)];
    memcpy(free_run, network.x0, sizeof free_run);
    for (int k = 0; k < 50; k++) {
        tick(&network);
        assert_int_equal(
            dse_rk4_model_step(&network.model, 0, config.period, NULL, free_run, scratch), DSE_OK);
    }
    for (int r = 0; r < LINEAR_N; r++) {
        assert_near(dse_high_gain_ekf_picture(&network.filter[1])[r], free_run[r],
                    TOLERANCE(1e-13, 1e-5));
    }
}

static void decentralised_filter_with_hold_keeps_the_guess_of_its_neighbours(void **state)
{
    (void)state;
    static struct network network;
    struct dse_high_gain_ekf_config config = linear_config();
    config.communication = DSE_HIGH_GAIN_NONE;
    config.innovation = DSE_HIGH_GAIN_OWN;
    config.predictor = DSE_HIGH_GAIN_HOLD;
    linear_network(&network, &config);
    for (int k = 0; k < 20; k++) {
        tick(&network);
    }
    assert_memory_equal(dse_high_gain_ekf_picture(&network.filter[0]) + 2, network.x0 + 2,
                        3 * sizeof(dse_real));
    assert_memory_equal(dse_high_gain_ekf_picture(&network.filter[2]), network.x0,
                        3 * sizeof(dse_real));
    assert_int_equal(dse_high_gain_ekf_counters(&network.filter[0])->missing_states, 0);
}

/* ---- the innovation ---- */

/* J_i of a tick, literally: restart from the picture N_d ticks ago, trapezoid rule. */
static void running_predictions_give_the_integral_over_the_horizon(void **state)
{
    (void)state;
    enum { TICKS = 4 * HORIZON };
    static struct network network;
    dse_real picture[TICKS][LINEAR_N], y[TICKS];
    const struct dse_high_gain_ekf_config config = linear_config();
    linear_network(&network, &config);
    for (int k = 0; k < TICKS; k++) {
        y[k] = network.x[0];
        tick(&network);
        memcpy(picture[k], network.filter[0].base, sizeof picture[k]);
        const int start = k > HORIZON ? k - HORIZON : 0;
        dse_real chi[LINEAR_N], scratch[DSE_RK4_SCRATCH(LINEAR_N)], J = 0;
        memcpy(chi, picture[start], sizeof chi);
        for (int l = start; l <= k; l++) {
            const dse_real e = y[l] - chi[0];
            const dse_real weight = l == start || l == k ? DSE_REAL(0.5) : 1;
            J += k == start ? 0 : weight * config.period * e * e;
            assert_int_equal(
                dse_rk4_model_step(&network.model, 0, config.period, NULL, chi, scratch), DSE_OK);
        }
        assert_near(dse_high_gain_ekf_innovation(&network.filter[0]), J, TOLERANCE(1e-13, 1e-5));
    }
}

/* A prediction from a bad start may leave the model's region; the filter goes on. */
static void prediction_that_cannot_go_on_stands_still(void **state)
{
    (void)state;
    static struct network network;
    const struct dse_high_gain_ekf_config config = linear_config();
    for (int wild = 0; wild < 2; wild++) {
        struct linear lost = coupled; /* the model that the predictions use; the form still works */
        lost.broken = wild == 0;
        lost.wild = wild == 1;
        linear_network(&network, &config);
        tick(&network);
        struct dse_high_gain_ekf *f = &network.filter[0];
        dse_real before[LINEAR_N];
        memcpy(before, f->ring, sizeof before);
        begin_tick(&network);
        network.model.parameters = &lost;
        exchange(&network, 0);
        assert_int_equal(dse_high_gain_ekf_advance(f, 0), DSE_OK);
        assert_int_equal(dse_high_gain_ekf_finish(f), DSE_OK);
        assert_memory_equal(f->ring, before, sizeof before);
        assert_int_equal(dse_high_gain_ekf_counters(f)->frozen_predictions, 2);
        assert_int_equal(dse_high_gain_ekf_health(f), DSE_HEALTH_TRACKING);
    }
}

/* ---- missing measurements and failures ---- */

static void filter_without_measurements_coasts_on_the_model(void **state)
{
    (void)state;
    static struct network network;
    const struct dse_high_gain_ekf_config config = linear_config();
    linear_network(&network, &config);
    struct dse_high_gain_ekf *f = &network.filter[0];
    assert_int_equal(dse_high_gain_ekf_health(f), DSE_HEALTH_INITIALISING);
    network.blind[0] = true;
    tick(&network);
    assert_int_equal(dse_high_gain_ekf_health(f), DSE_HEALTH_INITIALISING);
    network.blind[0] = false;
    tick(&network);
    assert_int_equal(dse_high_gain_ekf_health(f), DSE_HEALTH_TRACKING);

    /* P' = F P + P F' + Q_th: the integral of a linear equation, in small steps */
    network.blind[0] = true;
    dse_real P[4], F[4], FP[4];
    memcpy(P, dse_high_gain_ekf_covariance(f), sizeof P);
    const dse_real *squares = f->ring + (HORIZON + 1) * f->n;
    const dse_real J = squares[0]; /* of slot 0 */
    tick(&network);
    assert_near(squares[0], J, 0);
    assert_int_equal(network.form.jacobian(&network.form, 0, 0, f->x, NULL, F), DSE_OK);
    for (int s = 0; s < 1000; s++) {
        dse_mat_mul(2, 2, 2, F, P, FP);
        for (int k = 0; k < 4; k++) {
            P[k] += config.period / 1000 * (FP[k] + FP[(k % 2) * 2 + k / 2] + f->Q_th[k]);
        }
    }
    for (int k = 0; k < 4; k++) {
        assert_near(dse_high_gain_ekf_covariance(f)[k], P[k], DSE_REAL(1e-3) * (1 + dse_abs(P[k])));
    }
    assert_int_equal(dse_high_gain_ekf_health(f), DSE_HEALTH_COASTING);
    assert_int_equal(dse_high_gain_ekf_counters(f)->missing_measurements, 2);
    assert_near(dse_high_gain_ekf_output_error(f)[0], 0, 0);
    network.blind[0] = false;
    tick(&network);
    assert_int_equal(dse_high_gain_ekf_health(f), DSE_HEALTH_TRACKING);
}

static void measurement_that_is_not_a_number_counts_as_missing(void **state)
{
    (void)state;
    static struct network nan, blind;
    static const dse_real bad[] = {(dse_real)NAN, (dse_real)INFINITY, (dse_real)-INFINITY};
    const struct dse_high_gain_ekf_config config = linear_config();
    for (int b = 0; b < 4; b++) {
        linear_network(&nan, &config);
        linear_network(&blind, &config);
        blind.blind[1] = true;
        begin_tick(&nan);
        const struct dse_measurement own = {.y = &bad[b < 3 ? b : 0]};
        assert_int_equal(dse_high_gain_ekf_begin(&nan.filter[1], 0, 0, NULL, b < 3 ? &own : NULL),
                         DSE_OK);
        end_tick(&nan);
        tick(&blind);
        assert_same_state(&nan, &blind);
    }
}

/* A tick that fails, wherever it does, leaves no trace in the state. */
static void failed_tick_leaves_the_state_as_it_was(void **state)
{
    (void)state;
    static struct network clean, failing;
    for (int way = 0; way < 2; way++) {
        for (int wild = 0; wild < 2; wild++) {
            struct dse_high_gain_ekf_config config = linear_config();
            config.communication = ways[way];
            linear_network(&clean, &config);
            linear_network(&failing, &config);
            for (int k = 0; k < 2 * HORIZON; k++) {
                tick(&clean);
                tick(&failing);
            }
            const dse_real theta = dse_high_gain_ekf_theta(&failing.filter[0]);
            begin_tick(&failing);
            failing.linear.broken = wild == 0;
            failing.linear.wild = wild == 1;
            enum dse_status status[LINEAR_P] = {DSE_OK, DSE_OK, DSE_OK};
            for (int r = 0; r < 4; r++) {
                for (int i = 0; i < LINEAR_P; i++) {
                    if (status[i] == DSE_OK && r < dse_high_gain_ekf_rounds(&failing.filter[i])) {
                        status[i] = dse_high_gain_ekf_advance(&failing.filter[i], r);
                    }
                }
            }
            for (int i = 0; i < LINEAR_P; i++) {
                struct dse_high_gain_ekf *f = &failing.filter[i];
                status[i] = status[i] == DSE_OK ? dse_high_gain_ekf_finish(f) : status[i];
                assert_int_equal(status[i], wild ? DSE_ENONFINITE : DSE_EMODEL);
                assert_int_equal(dse_high_gain_ekf_health(f), DSE_HEALTH_DIVERGED);
                assert_int_equal(dse_high_gain_ekf_counters(f)->failed_ticks, 1);
                assert_int_equal(dse_high_gain_ekf_finish(f), DSE_EINVAL); /* it is closed */
            }
            assert_near(dse_high_gain_ekf_theta(&failing.filter[0]), theta, 0);
            assert_same_state(&clean, &failing);
            /* and it recovers */
            failing.linear = coupled;
            tick(&clean);
            tick(&failing);
            assert_same_state(&clean, &failing);
            assert_int_equal(dse_high_gain_ekf_health(&failing.filter[0]), DSE_HEALTH_TRACKING);
        }
    }
}

/* P' = -P^2/R with h P/R = 4: one explicit step overshoots to a negative P. */
static void tick_that_loses_positive_definiteness_is_given_up(void **state)
{
    (void)state;
    static struct network network;
    struct dse_high_gain_ekf_config config = linear_config();
    config.R = DSE_REAL(0.005);
    linear_network(&network, &config);
    begin_tick(&network);
    struct dse_high_gain_ekf *f = &network.filter[0];
    assert_int_equal(dse_high_gain_ekf_advance(f, 0), DSE_OK);
    assert_int_equal(dse_high_gain_ekf_finish(f), DSE_ENOTPD);
    assert_int_equal(dse_high_gain_ekf_health(f), DSE_HEALTH_DIVERGED);
    assert_memory_equal(dse_high_gain_ekf_covariance(f), network.P0, sizeof network.P0);
}

static void inputs_that_are_not_numbers_fail_the_tick(void **state)
{
    (void)state;
    static struct network network;
    const dse_real nan[2] = {(dse_real)NAN, 0};
    const struct dse_high_gain_ekf_config config = cstr_config();
    cstr_network(&network, &config);
    struct dse_high_gain_ekf *f = &network.filter[0];
    assert_int_equal(dse_high_gain_ekf_begin(f, 0, 0, nan, NULL), DSE_ENONFINITE);
    assert_int_equal(dse_high_gain_ekf_begin(f, 0, 0, NULL, NULL), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_begin(f, -1, 0, network.u, NULL), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_begin(f, 0, nan[0], network.u, NULL), DSE_ENONFINITE);
    assert_int_equal(dse_high_gain_ekf_health(f), DSE_HEALTH_DIVERGED);
    assert_int_equal(dse_high_gain_ekf_counters(f)->failed_ticks, 4);
    tick(&network);
    assert_int_equal(dse_high_gain_ekf_health(f), DSE_HEALTH_TRACKING);
}

static void steps_of_a_tick_have_one_order(void **state)
{
    (void)state;
    static struct network network;
    const struct dse_high_gain_ekf_config config = linear_config();
    linear_network(&network, &config);
    struct dse_high_gain_ekf *f = &network.filter[0];
    assert_int_equal(dse_high_gain_ekf_rounds(f), 0);
    assert_int_equal(dse_high_gain_ekf_advance(f, 0), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_finish(f), DSE_EINVAL);
    begin_tick(&network);
    assert_int_equal(dse_high_gain_ekf_finish(f), DSE_EINVAL); /* a round is open */
    assert_int_equal(dse_high_gain_ekf_advance(f, 1), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_advance(f, 0), DSE_OK);
    assert_int_equal(dse_high_gain_ekf_advance(f, 0), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_finish(f), DSE_OK);
    assert_int_equal(dse_high_gain_ekf_counters(f)->ticks, 1);
}

/* ---- set-up ---- */

static void storage_is_what_the_constant_says(void **state)
{
    (void)state;
    static struct network network;
    const struct dse_high_gain_ekf_config config = cstr_config();
    cstr_network(&network, &config);
    struct dse_high_gain_ekf filter;
    struct dse_arena arena;
    const int size = DSE_HIGH_GAIN_EKF_STORAGE(4, 2, 2, 2, 2, CSTR_HORIZON);
    dse_arena_init(&arena, network.memory[0], size);
    assert_int_equal(dse_high_gain_ekf_init(&filter, &network.config[0], &arena), DSE_OK);
    assert_int_equal(arena.used, size);
    dse_arena_init(&arena, network.memory[0], size - 1);
    assert_int_equal(dse_high_gain_ekf_init(&filter, &network.config[0], &arena), DSE_ESTORAGE);
    assert_int_equal(dse_high_gain_ekf_init(&filter, &network.config[0], NULL), DSE_ESTORAGE);
}

static struct network refused;

static enum dse_status init_with(const struct dse_high_gain_ekf_config *config)
{
    struct dse_high_gain_ekf filter;
    struct dse_arena arena;
    dse_arena_init(&arena, refused.memory[0], (int)(sizeof refused.memory[0] / sizeof(dse_real)));
    return dse_high_gain_ekf_init(&filter, config, &arena);
}

#define REFUSES(status, change)                                                                    \
    do {                                                                                           \
        struct dse_high_gain_ekf_config config = good;                                             \
        change;                                                                                    \
        assert_int_equal(init_with(&config), status);                                              \
    } while (0)

static void impossible_configurations_are_refused(void **state)
{
    (void)state;
    static const dse_real indefinite[4] = {1, 2, 2, 1}, skew[4] = {1, 1, 0, 1},
                          nan[5] = {(dse_real)NAN, 1, 1, 1, 1}, negative[4] = {-1, 0, 0, 1};
    const struct dse_high_gain_ekf_config base = linear_config();
    linear_network(&refused, &base);
    const struct dse_high_gain_ekf_config good = refused.config[0];
    assert_int_equal(init_with(&good), DSE_OK);
    REFUSES(DSE_EINVAL, config.model = NULL);
    REFUSES(DSE_EINVAL, config.form = NULL);
    REFUSES(DSE_EINVAL, config.i = -1);
    REFUSES(DSE_EINVAL, config.i = 3);
    REFUSES(DSE_EINVAL, config.period = 0);
    REFUSES(DSE_EINVAL, config.period = (dse_real)NAN);
    REFUSES(DSE_EINVAL, config.period = (dse_real)INFINITY);
    REFUSES(DSE_EINVAL, config.R = 0);
    REFUSES(DSE_EINVAL, config.R = (dse_real)NAN);
    REFUSES(DSE_EINVAL, config.horizon = -1);
    REFUSES(DSE_EINVAL, config.horizon = 0); /* adaptation needs one */
    REFUSES(DSE_EINVAL, config.comm_every_ticks = -1);
    REFUSES(DSE_EINVAL, config.x0 = NULL);
    REFUSES(DSE_EINVAL, config.P0 = NULL);
    REFUSES(DSE_EINVAL, config.Q = NULL);
    REFUSES(DSE_EINVAL, config.adaptation.theta_m = DSE_REAL(0.5));
    REFUSES(DSE_EINVAL, config.adaptation.theta_m = (dse_real)NAN);
    REFUSES(DSE_EINVAL, config.adaptation.rise_time = 0);
    REFUSES(DSE_EINVAL, config.adaptation.relaxation = -1);
    REFUSES(DSE_EINVAL, config.adaptation.sharpness = 0);
    REFUSES(DSE_EINVAL, config.adaptation.threshold = (dse_real)NAN);
    REFUSES(DSE_EINVAL, config.coords = (enum dse_high_gain_coords)3);
    REFUSES(DSE_EINVAL, config.scaling = (enum dse_high_gain_scaling)2);
    REFUSES(DSE_EINVAL, config.gain = (enum dse_high_gain_gain)3);
    REFUSES(DSE_EINVAL, config.innovation = (enum dse_high_gain_innovation)2);
    REFUSES(DSE_EINVAL, config.communication = (enum dse_high_gain_communication)4);
    REFUSES(DSE_EINVAL, config.predictor = (enum dse_high_gain_predictor)2);
    REFUSES(DSE_EINVAL, config.communication = DSE_HIGH_GAIN_STAGES; config.comm_every_ticks = 2);
    REFUSES(DSE_EINVAL, config.communication = DSE_HIGH_GAIN_STAGES;
            config.predictor = DSE_HIGH_GAIN_HOLD);
    REFUSES(DSE_EINVAL, config.communication = DSE_HIGH_GAIN_NONE); /* nobody to sum with */
    REFUSES(DSE_ENOTPD, config.P0 = indefinite);
    REFUSES(DSE_EINVAL, config.P0 = skew);
    REFUSES(DSE_ENONFINITE, config.P0 = nan);
    REFUSES(DSE_EINVAL, config.Q = skew);
    REFUSES(DSE_EINVAL, config.Q = negative);
    REFUSES(DSE_ENONFINITE, config.Q = nan);
    REFUSES(DSE_ENONFINITE, config.x0 = nan);
    assert_int_equal(dse_high_gain_ekf_init(NULL, &good, NULL), DSE_EINVAL);

    struct dse_model model = refused.model;
    struct dse_normal_form form = refused.form;
    model.nx = 4;
    REFUSES(DSE_EDIM, config.model = &model);
    model = refused.model;
    model.ny = 2;
    REFUSES(DSE_EDIM, config.model = &model);
    model = refused.model;
    model.time = DSE_DISCRETE;
    REFUSES(DSE_EINVAL, config.model = &model);
    model = refused.model;
    model.dfdx = NULL;
    REFUSES(DSE_OK, config.model = &model);
    REFUSES(DSE_EINVAL, config.model = &model; config.coords = DSE_HIGH_GAIN_PHYSICAL);
    form.decode = NULL;
    REFUSES(DSE_EINVAL, config.form = &form);
    REFUSES(DSE_OK, config.form = &form; config.coords = DSE_HIGH_GAIN_PHYSICAL);
    form = refused.form;
    form.nu = 1;
    REFUSES(DSE_EDIM, config.form = &form);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(gain_stays_in_its_interval_for_any_innovation_and_step),
        cmocka_unit_test(gain_reaches_theta_m_in_the_time_of_the_rise_law),
        cmocka_unit_test(gain_relaxes_exponentially_without_innovation),
        cmocka_unit_test(saturated_gain_does_not_depend_on_the_tick),
        cmocka_unit_test(full_weights_satisfy_the_scaling_identities),
        cmocka_unit_test(scalings_agree_at_theta_one_and_plain_is_proportional),
        cmocka_unit_test(riccati_reaches_the_solution_of_the_algebraic_equation),
        cmocka_unit_test(picture_is_encoded_anew_when_the_input_jumps),
        cmocka_unit_test(mapped_and_normal_are_one_filter_for_an_undivided_system),
        cmocka_unit_test(coordinates_agree_when_the_map_is_the_identity),
        cmocka_unit_test(physical_covariance_is_that_of_the_decoded_block),
        cmocka_unit_test(order_of_messages_does_not_matter),
        cmocka_unit_test(filters_that_share_the_innovation_have_the_same_gain_to_the_last_bit),
        cmocka_unit_test(stages_give_all_filters_one_common_picture),
        cmocka_unit_test(messages_follow_the_schedule),
        cmocka_unit_test(refused_messages_change_nothing_but_the_counter),
        cmocka_unit_test(second_message_of_a_sender_is_ignored),
        cmocka_unit_test(lost_message_is_predicted_or_held_and_counted),
        cmocka_unit_test(predictor_follows_the_model_between_messages),
        cmocka_unit_test(decentralised_filter_with_hold_keeps_the_guess_of_its_neighbours),
        cmocka_unit_test(running_predictions_give_the_integral_over_the_horizon),
        cmocka_unit_test(prediction_that_cannot_go_on_stands_still),
        cmocka_unit_test(filter_without_measurements_coasts_on_the_model),
        cmocka_unit_test(measurement_that_is_not_a_number_counts_as_missing),
        cmocka_unit_test(failed_tick_leaves_the_state_as_it_was),
        cmocka_unit_test(tick_that_loses_positive_definiteness_is_given_up),
        cmocka_unit_test(inputs_that_are_not_numbers_fail_the_tick),
        cmocka_unit_test(steps_of_a_tick_have_one_order),
        cmocka_unit_test(storage_is_what_the_constant_says),
        cmocka_unit_test(impossible_configurations_are_refused),
#ifndef DSE_REAL_IS_float
        cmocka_unit_test(error_energy_falls_in_every_tick_at_the_permanent_high_gain),
        cmocka_unit_test(adaptive_gain_converges_faster_than_the_regular_filter),
        cmocka_unit_test(one_exchange_per_tick_comes_close_to_continuous_communication),
        cmocka_unit_test(varying_feed_is_followed),
#endif
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
