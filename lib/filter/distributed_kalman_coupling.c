/* Distributed Kalman filter: what neighbours do to an estimate, and the law of the gains. */
#include "distributed_kalman_internal.h"
#include "dse/math.h"

void dkf_residual(const struct dse_dkf *dkf, const dse_real *x, dse_real *Cx, dse_real *eps)
{
    const int m = dkf->ny;
    dse_mat_vec(m, dkf->nx, dkf->config->sensor.C, x, Cx);
    for (int l = 0; l < m; l++)
        eps[l] = dkf->has[l] != 0 ? dkf->y[l] - Cx[l] : 0;
}

/* q += Gamma d. */
static void act(int m, const dse_real *gain, const dse_real *d, dse_real *q)
{
    for (int r = 0; r < m; r++)
        for (int c = 0; c < m; c++)
            q[r] += gain[r * m + c] * d[c];
}

/* Gamma' = beta eps d' - sigma Gamma                                                       (2.5)
 * Rows of channels without a value stay. */
static void adapt(const struct dse_dkf *dkf, const dse_real *gain, const dse_real *eps,
                  const dse_real *d, dse_real *dgain)
{
    const int m = dkf->ny;
    const dse_real sigma = dkf->config->sigma;
    for (int r = 0; r < m; r++)
        for (int c = 0; c < m; c++)
            dgain[r * m + c] =
                dkf->adapts[r] != 0 ? dkf->rate * eps[r] * d[c] - sigma * gain[r * m + c] : 0;
}

static void stay(int count, dse_real *dgain)
{
    for (int k = 0; k < count; k++)
        dgain[k] = 0;
}

static void couple_edges(const struct dse_dkf *dkf, const dse_real *gains, const dse_real *Cx,
                         const dse_real *eps, dse_real *d, dse_real *q, dse_real *dgains)
{
    const int m = dkf->ny, square = m * m;
    for (int j = 0; j < dkf->config->n_neighbours; j++) {
        const dse_real *gain = gains + j * square, *said = dkf->said + j * m;
        const dse_real age = dkf->age[j];
        if (age >= 0) {
            for (int l = 0; l < m; l++)
                d[l] = said[l] - Cx[l]; /* d_ij = C_i (xh_j - xh_i) */
            act(m, gain, d, q);
        }
        if (dgains == NULL)
            continue;
        if (age == 0) /* never with an old word: it does not belong to this residual */
            adapt(dkf, gain, eps, d, dgains + j * square);
        else
            stay(square, dgains + j * square);
    }
}

/* One gain: s = sum_j d_ij acts, the fresh ones of them adapt                             (2.11) */
static void couple_sum(const struct dse_dkf *dkf, const dse_real *gains, const dse_real *Cx,
                       const dse_real *eps, dse_real *d, dse_real *q, dse_real *dgains)
{
    const int m = dkf->ny;
    dse_real *used = d, *fresh = d + m;
    bool any = false;
    stay(2 * m, d);
    for (int j = 0; j < dkf->config->n_neighbours; j++) {
        const dse_real *said = dkf->said + j * m;
        if (dkf->age[j] < 0)
            continue;
        any = any || dkf->age[j] == 0;
        for (int l = 0; l < m; l++) {
            used[l] += said[l] - Cx[l];
            if (dkf->age[j] == 0)
                fresh[l] += said[l] - Cx[l];
        }
    }
    act(m, gains, used, q);
    if (dgains == NULL)
        return;
    if (any)
        adapt(dkf, gains, eps, fresh, dgains);
    else
        stay(m * m, dgains);
}

void dkf_couple(const struct dse_dkf *dkf, const dse_real *gains, const dse_real *Cx,
                const dse_real *eps, dse_real *d, dse_real *q, dse_real *dgains)
{
    stay(dkf->ny, q);
    if (dkf->config->scheme == DSE_DKF_EDGE)
        couple_edges(dkf, gains, Cx, eps, d, q, dgains);
    else if (dkf->n_gains > 0)
        couple_sum(dkf, gains, Cx, eps, d, q, dgains);
}

void dkf_consensus(const struct dse_dkf *dkf, const dse_real *x, dse_real *s)
{
    const int n = dkf->nx;
    stay(n, s);
    for (int j = 0; j < dkf->config->n_neighbours; j++)
        if (dkf->age[j] >= 0)
            for (int l = 0; l < n; l++)
                s[l] += dkf->said[j * n + l] - x[l];
}

void dkf_limit(struct dse_dkf *dkf, dse_real *gains)
{
    const int square = dkf->ny * dkf->ny;
    const dse_real limit = dkf->config->limit;
    if (!(limit > 0))
        return;
    for (int j = 0; j < dkf->n_gains; j++) {
        dse_real *gain = gains + j * square;
        const dse_real norm = dse_norm2(square, gain);
        if (norm > limit) {
            for (int k = 0; k < square; k++)
                gain[k] *= limit / norm;
            dkf->counts.limited++;
        }
    }
}
