/* The high-gain parameter and what it does to the weights. */
#include "dse/high_gain_ekf.h"
#include "dse/math.h"

dse_real dse_gain_adaptation_mu(const struct dse_gain_adaptation *adaptation, dse_real J)
{
    return dse_sigmoid(adaptation->sharpness * (J - adaptation->threshold));
}

/* theta' = D(theta) for a time s in units of DeltaT, exactly; D = theta^2 up to theta_m and
 * (theta - 2 theta_m)^2 above. An Euler step would overshoot 2 theta_m, where D is positive again,
 * and run away. */
static dse_real rise(dse_real theta_m, dse_real s, dse_real theta)
{
    if (theta < theta_m) {
        /* 1/theta falls at rate 1: s1 is when it reaches 1/theta_m */
        const dse_real s1 = 1 / theta - 1 / theta_m;
        if (s <= s1) {
            return 1 / (1 / theta - s);
        }
        s -= s1;
        theta = theta_m;
    }
    const dse_real w = 2 * theta_m - theta;
    return 2 * theta_m - w / (1 + w * s);
}

dse_real dse_gain_adaptation_step(const struct dse_gain_adaptation *adaptation, dse_real h,
                                  dse_real J, dse_real theta)
{
    /* Strang splitting of (2.8): half of the relaxation, the whole rise, half of the relaxation */
    const dse_real mu = dse_gain_adaptation_mu(adaptation, J);
    const dse_real decay = dse_exp(-(1 - mu) * adaptation->relaxation * h / 2);
    theta = 1 + (theta - 1) * decay;
    theta = rise(adaptation->theta_m, mu * h / adaptation->rise_time, theta);
    theta = 1 + (theta - 1) * decay;
    /* the interval is invariant in exact arithmetic; this takes off the rounding */
    return dse_min(dse_max(theta, 1), 2 * adaptation->theta_m);
}

static dse_real power(dse_real base, int exponent)
{
    dse_real result = 1;
    for (int k = 0; k < exponent; k++) {
        result *= base;
    }
    return result;
}

/* Exponent of theta in Theta_i^-1 for state r of a block of m chains: n* - n_l + position in its
 * chain l, so that a single chain has n* - n_i, ..., n* - 1. */
static int exponent_of(int m, const int *chains, int n_max, int r)
{
    int l = 0;
    while (l + 1 < m && r >= chains[l]) {
        r -= chains[l++];
    }
    return n_max - chains[l] + r;
}

void dse_high_gain_weights(enum dse_high_gain_scaling scaling, int m, const int *chains, int n_max,
                           dse_real theta, const dse_real *R, const dse_real *Q, dse_real *R_th,
                           dse_real *Q_th)
{
    const bool full = scaling == DSE_HIGH_GAIN_FULL;
    int n_i = 0;
    for (int l = 0; l < m; l++) {
        n_i += chains[l];
    }
    for (int a = 0; a < m; a++) {
        for (int b = 0; b < m; b++) {
            const int exponent = full ? 2 * n_max - chains[a] - chains[b] : 0;
            R_th[a * m + b] = R[a * m + b] * power(theta, exponent) / theta;
        }
    }
    for (int r = 0; r < n_i; r++) {
        for (int c = 0; c < n_i; c++) {
            /* full: Theta_i^-1 = diag(theta^{n*-n_i}, ..., theta^{n*-1}) on both sides */
            const int exponent =
                full ? exponent_of(m, chains, n_max, r) + exponent_of(m, chains, n_max, c) : 0;
            Q_th[r * n_i + c] = theta * power(theta, exponent) * Q[r * n_i + c];
        }
    }
}
