/* Distributed Kalman filter: how far the coupling moves an estimate in one step. */
#include "distributed_kalman_internal.h"
#include "dse/math.h"

/* CD (m x m) = C D; CX: scratch of m x n. */
static void output_direction(const struct dse_dkf *dkf, dse_real *CX, dse_real *CD)
{
    const struct dse_dkf_config *config = dkf->config;
    const struct dkf_parts now = dkf_parts(dkf, dkf->now);
    const int n = dkf->nx, m = dkf->ny;
    const dse_real *C = config->sensor.C;
    if (dkf->direction != NULL) {
        dse_mat_mul(m, n, m, C, dkf->direction, CD);
        return;
    }
    if (config->direction == DSE_DKF_GIVEN) {
        dse_mat_mul(m, n, m, C, config->D, CD);
        return;
    }
    dse_mat_mul(m, n, n, C, now.W != NULL ? now.W : now.P, CX); /* D' = C P or C W .. */
    if (config->direction != DSE_DKF_GAIN) {
        dse_mat_mul_nt(m, n, m, CX, C, CD);
        return;
    }
    for (int r = 0; r < m; r++) { /* .. or R^-1 C P */
        for (int c = 0; c < m; c++) {
            CD[r * m + c] = 0;
            for (int l = 0; l < m; l++)
                CD[r * m + c] += dse_dot(n, CX + r * n, C + l * n) * dkf->R_inverse[l * m + c];
        }
    }
}

/* sum_j Gamma_ij over the neighbours in use; returns how many there are. */
static int sum_gains(const struct dse_dkf *dkf, dse_real *sum)
{
    const int square = dkf->ny * dkf->ny;
    int used = 0;
    for (int k = 0; k < square; k++)
        sum[k] = 0;
    for (int j = 0; j < dkf->config->n_neighbours; j++) {
        if (dkf->age[j] < 0)
            continue;
        used++;
        if (dkf->n_gains > 0)
            dse_axpy(square, 1, dse_dkf_gain(dkf, dkf->config->scheme == DSE_DKF_EDGE ? j : 0),
                     sum);
    }
    return used;
}

dse_real dse_dkf_loop_gain(const struct dse_dkf *dkf)
{
    const int n = dkf->nx, m = dkf->ny;
    const dse_real gamma = dkf->config->gamma * (dkf->discrete ? 1 : dkf->config->period);
    dse_real *scratch = dkf->scratch;
    dse_real *CD = dkf_take(&scratch, m * m), *sum = dkf_take(&scratch, m * m);
    if (dkf->config->scheme == DSE_DKF_STANDARD)
        return gamma * (dse_real)sum_gains(dkf, sum) * dse_norm2(n * n, dse_dkf_covariance(dkf));
    if (dkf->n_gains == 0)
        return 0;
    output_direction(dkf, scratch, CD);
    sum_gains(dkf, sum);
    dse_real squares = 0;
    for (int r = 0; r < m; r++) {
        for (int c = 0; c < m; c++) {
            dse_real entry = 0;
            for (int l = 0; l < m; l++)
                entry += CD[r * m + l] * sum[l * m + c];
            squares += entry * entry;
        }
    }
    return gamma * dse_sqrt(squares);
}
