/* Adaptive high-gain EKF: what the proofs of its convergence rest on, checked on the filter itself.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "dse/high_gain_ekf.h"
#include "dse/linalg.h"
#include "dse/ode.h"
#include "high_gain_rig.h"
#include "near.h"

/* ---- the change of variables (2.13) to (2.15) ---- */

static const dse_real theta = 4;

/* Theta of the linear plant's states: chains of 2, 1, 2, of which the longest is n* = 2. */
static void scales(dse_real *scale)
{
    static const int power[LINEAR_N] = {0, 1, 1, 0, 1};
    for (int r = 0; r < LINEAR_N; r++) {
        scale[r] = power[r] == 0 ? 1 : 1 / theta;
    }
}

/* The same network in the coordinates Theta x and in a time that runs theta times faster. */
static void change_variables(struct network *network, const dse_real *scale)
{
    dse_real *A = network->linear.A;
    for (int r = 0; r < LINEAR_N; r++) {
        network->x[r] *= scale[r];
        network->x0[r] *= scale[r];
        for (int c = 0; c < LINEAR_N; c++) {
            A[r * LINEAR_N + c] *= scale[r] / scale[c] / theta;
        }
    }
    network->P0[1] /= theta;
    network->P0[2] /= theta;
    network->P0[3] /= theta * theta;
    network->P0_single[0] /= theta * theta;
}

/* With theta constant, S_i~ = Theta_i^-1 S_i Theta_i^-1 and eps~ = Theta eps obey the equations of
 * theta = 1, all their right-hand sides multiplied by theta (2.16, 2.17). This holds because
 *
 *     Theta_i A_i = theta A_i Theta_i,   C_i Theta_i^-1 = theta^(n* - n_i) C_i,
 *     Theta_i^-1 C_i' R_th^-1 C_i Theta_i^-1 = theta C_i' R_i^-1 C_i                     (2.14)
 *
 * and is false when one power of theta in R_th or Q_th is wrong, or one block lacks its own. */
static void full_scaling_is_theta_one_in_a_faster_time(void **state)
{
    (void)state;
    static struct network high, fast;
    dse_real scale[LINEAR_N];
    struct dse_high_gain_ekf_config config = linear_config();
    config.communication = DSE_HIGH_GAIN_STAGES;
    config.horizon = 0;
    config.gain = DSE_HIGH_GAIN_MAX;
    config.adaptation.theta_m = theta / 2;
    linear_network(&high, &config);
    config.gain = DSE_HIGH_GAIN_ONE;
    config.period *= theta;
    linear_network(&fast, &config);
    scales(scale);
    change_variables(&fast, scale);
    init_filters(&fast, &config);
    for (int k = 0; k < 100; k++) {
        tick(&high);
        tick(&fast);
        for (int i = 0, first = 0; i < LINEAR_P; first += high.form.n_i[i++]) {
            const int n_i = high.form.n_i[i];
            const dse_real *P = dse_high_gain_ekf_covariance(&high.filter[i]);
            dse_real picture[LINEAR_N], scaled[4];
            for (int r = 0; r < LINEAR_N; r++) {
                picture[r] = scale[r] * dse_high_gain_ekf_picture(&high.filter[i])[r];
            }
            for (int r = 0; r < n_i; r++) {
                for (int c = 0; c < n_i; c++) {
                    scaled[r * n_i + c] = scale[first + r] * P[r * n_i + c] * scale[first + c];
                }
            }
            assert_agree(LINEAR_N, dse_high_gain_ekf_picture(&fast.filter[i]), picture,
                         TOLERANCE(1e-13, 1e-5));
            assert_agree(n_i * n_i, dse_high_gain_ekf_covariance(&fast.filter[i]), scaled,
                         TOLERANCE(1e-13, 1e-5));
        }
    }
}

/* ---- the innovation lemma (2.56) ---- */

#ifndef DSE_REAL_IS_float
/* A bound that the two reactors have, K^2 h per K^2 and (K/h)^2. */
static const double lambda_t = 3e-8;

/* y of the open loop from z over the horizon, and the trapezoid rule's weights with it. */
static void open_loop(const struct network *network, const double *z, double y[CSTR_HORIZON + 1][2])
{
    double x[4], scratch[DSE_RK4_SCRATCH(4)];
    assert_int_equal(network->form.decode(&network->form, 0, z, network->u, x), DSE_OK);
    for (int k = 0; k <= CSTR_HORIZON; k++) {
        const struct dse_model *model = &network->model;
        assert_int_equal(model->h(model, 0, x, network->u, y[k]), DSE_OK);
        assert_int_equal(
            dse_rk4_model_step(model, 0, network->config[0].period, network->u, x, scratch),
            DSE_OK);
    }
}

/* M = int_0^d dy/dz' dy/dz dt by differences around z. */
static void gramian(const struct network *network, const double *z, double *M)
{
    static const double step[4] = {1e-3, 1e-1, 1e-3, 1e-1}; /* K, K/h */
    static double plus[4][CSTR_HORIZON + 1][2], minus[4][CSTR_HORIZON + 1][2];
    for (int a = 0; a < 4; a++) {
        double moved[4];
        memcpy(moved, z, sizeof moved);
        moved[a] = z[a] + step[a];
        open_loop(network, moved, plus[a]);
        moved[a] = z[a] - step[a];
        open_loop(network, moved, minus[a]);
    }
    for (int e = 0; e < 16; e++) {
        const int a = e / 4, b = e % 4;
        M[e] = 0;
        for (int k = 0; k <= CSTR_HORIZON; k++) {
            const double weight =
                (k % CSTR_HORIZON == 0 ? 0.5 : 1) * network->config[0].period / step[a] / step[b];
            for (int j = 0; j < 2; j++) {
                M[e] += weight * (plus[a][k][j] - minus[a][k][j]) / 2 *
                        (plus[b][k][j] - minus[b][k][j]) / 2;
            }
        }
    }
}

/* J = sum_i J_i at t = d of filters that start with z + error. */
static double innovation(const double *z, const double *error)
{
    static struct network network;
    const struct dse_high_gain_ekf_config config = cstr_config();
    double guess[4];
    cstr_network(&network, &config);
    for (int r = 0; r < 4; r++) {
        guess[r] = z[r] + error[r];
    }
    assert_int_equal(network.form.decode(&network.form, 0, guess, network.u, network.x0), DSE_OK);
    init_filters(&network, &config);
    for (int k = 0; k <= CSTR_HORIZON; k++) {
        tick(&network);
    }
    return dse_high_gain_ekf_drive(&network.filter[0]);
}

/* J(t) >= lambda_t |eps(t - d)|^2: a wrong estimate shows in J whatever the filters did meanwhile,
 * so that theta rises and stays up until the estimate is right. For small errors J is their
 * quadratic form with the observability Gramian of the horizon, M >= lambda_t I; for large ones, up
 * to those of section 2.6 (36 K, 32 K and some hundred K/h), nine tenths of it are left at least.
 */
static void innovation_shows_every_error_of_a_horizon_ago(void **state)
{
    (void)state;
    static struct network network;
    const struct dse_high_gain_ekf_config config = cstr_config();
    double z[4], M[16], rest[16], factor[16];
    cstr_network(&network, &config);
    assert_int_equal(network.form.encode(&network.form, 0, network.x, network.u, z), DSE_OK);
    gramian(&network, z, M);
    memcpy(rest, M, sizeof rest);
    for (int r = 0; r < 4; r++) {
        rest[5 * r] -= lambda_t;
    }
    assert_int_equal(dse_cholesky(4, rest, factor), DSE_OK); /* M - lambda_t I > 0 */
    for (int signs = 0; signs < 16; signs++) {
        static const double size[4] = {36, 300, 32, 300};
        double part = 1;
        for (int decade = 0; decade < 4; decade++, part *= 0.1) {
            double error[4], image[4];
            for (int r = 0; r < 4; r++) {
                error[r] = (signs >> r & 1) != 0 ? -part * size[r] : part * size[r];
            }
            dse_mat_vec(4, 4, M, error, image);
            const double form = dse_dot(4, error, image);
            const double J = innovation(z, error);
            assert_true(J >= 0.9 * form);
            assert_true(part > 2e-3 || J <= 1.01 * form);
        }
    }
}
#endif

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(full_scaling_is_theta_one_in_a_faster_time),
#ifndef DSE_REAL_IS_float
        cmocka_unit_test(innovation_shows_every_error_of_a_horizon_ago),
#endif
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
