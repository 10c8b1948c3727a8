/* The weights R_th and Q_th of the high-gain EKF, for one chain and for several. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "dse/high_gain_ekf.h"
#include "dse/linalg.h"
#include "dse/math.h"
#include "near.h"

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

/* ---- several chains ---- */

static const int chains[3] = {2, 1, 3};
enum { CHAINS = 3, BLOCK = 6, N_MAX = 4 };

/* Theta of state r: theta^-(n* - n_l + its place in chain l). */
static dse_real scale_of(dse_real theta, int r)
{
    static const int power[BLOCK] = {2, 3, 3, 1, 2, 3};
    return 1 / dse_pow(theta, (dse_real)power[r]);
}

/* Theta^-1 C' R_th^-1 C Theta^-1 = theta C' R^-1 C, and Q_th = theta Theta^-1 Q Theta^-1. */
static void full_weights_of_several_chains_satisfy_the_scaling_identities(void **state)
{
    (void)state;
    const dse_real theta = 3;
    const dse_real R[9] = {2, DSE_REAL(0.5), 0, DSE_REAL(0.5), 1, DSE_REAL(0.2),
                           0, DSE_REAL(0.2), 3};
    static const int start[3] = {0, 2, 3};
    dse_real Q[BLOCK * BLOCK], R_th[9], Q_th[BLOCK * BLOCK], inverse[9], want[9], LU[9];
    int pivots[3];
    for (int k = 0; k < BLOCK * BLOCK; k++) {
        Q[k] = 1 + (dse_real)(k % 7);
    }
    dse_high_gain_weights(DSE_HIGH_GAIN_FULL, CHAINS, chains, N_MAX, theta, R, Q, R_th, Q_th);
    memcpy(LU, R_th, sizeof LU);
    dse_mat_identity(3, inverse);
    assert_int_equal(dse_lu(3, LU, pivots), DSE_OK);
    dse_lu_solve(3, LU, pivots, 3, inverse);
    memcpy(LU, R, sizeof LU);
    dse_mat_identity(3, want);
    assert_int_equal(dse_lu(3, LU, pivots), DSE_OK);
    dse_lu_solve(3, LU, pivots, 3, want);
    for (int a = 0; a < 3; a++) {
        for (int b = 0; b < 3; b++) {
            const dse_real scaled =
                inverse[a * 3 + b] / scale_of(theta, start[a]) / scale_of(theta, start[b]);
            assert_near(scaled, theta * want[a * 3 + b], TOLERANCE(1e-12, 1e-4));
        }
    }
    for (int r = 0; r < BLOCK; r++) {
        for (int c = 0; c < BLOCK; c++) {
            const dse_real q = theta * Q[r * BLOCK + c] / scale_of(theta, r) / scale_of(theta, c);
            assert_near(Q_th[r * BLOCK + c], q, TOLERANCE(1e-12, 1e-5) * q);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(full_weights_satisfy_the_scaling_identities),
        cmocka_unit_test(scalings_agree_at_theta_one_and_plain_is_proportional),
        cmocka_unit_test(full_weights_of_several_chains_satisfy_the_scaling_identities),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
