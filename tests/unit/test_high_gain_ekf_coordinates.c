/* Adaptive high-gain EKF in normal, mapped and physical coordinates. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "dse/high_gain_ekf.h"
#include "dse/linalg.h"
#include "dse/math.h"
#include "high_gain_rig.h"
#include "near.h"

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

/* With an identity map the three coordinates are one filter, theta and all. */
static void coordinates_agree_when_the_map_is_the_identity(void **state)
{
    (void)state;
    static struct network networks[3];
    for (int c = 0; c < 3; c++) {
        struct dse_high_gain_ekf_config config = linear_config();
        config.coords = (enum dse_high_gain_coords)c;
        linear_network(&networks[c], &config);
        for (int k = 0; k < 2 * LINEAR_HORIZON; k++) {
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

static enum dse_status bend_h(const struct dse_model *model, dse_real t, const dse_real *x,
                              const dse_real *u, dse_real *y)
{
    (void)model;
    (void)t;
    (void)u;
    y[0] = x[0];
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

static const int both_states = 2;

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
        both[b]->model =
            (struct dse_model){.time = DSE_CONTINUOUS, .nx = 2, .ny = 1, .f = bend_f, .h = bend_h};
        both[b]->form = (struct dse_normal_form){.n = 2,
                                                 .p = 1,
                                                 .n_i = &both_states,
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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(picture_is_encoded_anew_when_the_input_jumps),
        cmocka_unit_test(mapped_and_normal_are_one_filter_for_an_undivided_system),
        cmocka_unit_test(coordinates_agree_when_the_map_is_the_identity),
        cmocka_unit_test(physical_covariance_is_that_of_the_decoded_block),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
