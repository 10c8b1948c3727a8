/* The adaptive high-gain EKF follows the golden run run_ch2_cont_ahg within 1e-6 (in single
 * precision within 0.005), here as on the host with the same bits. */
#include "cstr2_network.h"
#include "dse/math.h"
#include "golden_high_gain.h"
#include "report.h"

#ifdef DSE_REAL_IS_float
#define TOLERANCE DSE_REAL(5e-3)
#define FLOOR     DSE_REAL(1e-5)
#else
#define TOLERANCE DSE_REAL(1e-6)
#define FLOOR     DSE_REAL(1e-9)
#endif

/* |x - expected| <= tolerance |expected|, with a floor for what crosses zero. */
static void check_close(const char *name, int n, const dse_real *x, const dse_real *expected)
{
    for (int j = 0; j < n; j++) {
        dse_real error = dse_abs(x[j] - expected[j]);
        report_check(name, error <= TOLERANCE * dse_abs(expected[j]) + FLOOR);
    }
}

static void quantity(const char *name, int n, const dse_real *x, const dse_real *expected)
{
    report_vector(name, n, x);
    check_close(name, n, x, expected);
}

static void compare(const struct cstr2_network *network, int row)
{
    quantity("xhat", CSTR2_STATES, network->xhat, golden_xhat[row]);
    for (int i = 0; i < CSTR2_FILTERS; i++) {
        const struct dse_high_gain_ekf *filter = &network->filter[i];
        const dse_real theta = dse_high_gain_ekf_theta(filter);
        const dse_real J = dse_high_gain_ekf_innovation(filter);
        const int own = i * CSTR2_BLOCK;
        report_int("filter", i);
        quantity("theta", 1, &theta, &golden_theta[row][i]);
        quantity("J", 1, &J, &golden_J[row][i]);
        quantity("z", CSTR2_BLOCK, dse_high_gain_ekf_picture(filter) + own, &golden_z[row][own]);
        quantity("P", CSTR2_BLOCK * CSTR2_BLOCK, dse_high_gain_ekf_covariance(filter),
                 &golden_P[row][i * CSTR2_BLOCK * CSTR2_BLOCK]);
        report_int("health", (int)dse_high_gain_ekf_health(filter));
    }
}

int main(void)
{
    static struct cstr2_network network;
    enum dse_status status = cstr2_network_start(&network);
    int row = 0;
    for (int k = 0; k < GOLDEN_TICKS && !status; k++) {
        status = cstr2_network_tick(&network);
        if (!status && row < GOLDEN_ROWS && golden_tick[row][0] == k) {
            report_int("tick", k);
            compare(&network, row++);
        }
    }
    report_int("status", status);
    report_check("every tick succeeds", status == DSE_OK);
    report_check("every recorded tick is compared", row == GOLDEN_ROWS && row > 0);
    return report_verdict();
}
