/* Distributed Kalman filter: what neighbours do to an estimate, and the law of the gains. */
#include "distributed_kalman_internal.h"
#include "dse/math.h"

void dkf_residual(const struct dse_dkf *dkf, const dse_real *x, dse_real *Cx, dse_real *eps)
{
    const int m = dkf->ny;
    dkf_apply(m, dkf->nx, dkf->config->sensor.C, x, Cx);
    for (int l = 0; l < m; l++)
        eps[l] = dkf->has[l] != 0 ? dkf->y[l] - Cx[l] : 0;
}

static void stay(int count, dse_real *dgain)
{
    for (int k = 0; k < count; k++)
        dgain[k] = 0;
}

/* q += Gamma d. */
static void act(int m, const dse_real *restrict gain, const dse_real *restrict d,
                dse_real *restrict q)
{
    for (int r = 0; r < m; r++)
        for (int c = 0; c < m; c++)
            q[r] += gain[r * m + c] * d[c];
}

/* Gamma' = beta eps d' - sigma Gamma                                                       (2.5)
 * Rows of channels without a value stay. */
static void adapt(const struct dse_dkf *dkf, const dse_real *restrict gain,
                  const dse_real *restrict eps, const dse_real *restrict d,
                  dse_real *restrict dgain)
{
    const int m = dkf->ny;
    for (int r = 0; r < m; r++) {
        const dse_real push = dkf->adapts[r] * dkf->rate * eps[r];
        const dse_real leak = dkf->adapts[r] * dkf->config->sigma;
        for (int c = 0; c < m; c++)
            dgain[r * m + c] = push * d[c] - leak * gain[r * m + c];
    }
}

/* Gains never adapt with an old word, which does not belong to this residual. */
static bool is_fresh(dse_real age)
{
    return age == 0;
}

/* One output: the loop over all neighbours without anything inside. */
static void couple_scalar_edges(const struct dse_dkf *dkf, const dse_real *restrict gains,
                                dse_real Cx, dse_real eps, dse_real *restrict q,
                                dse_real *restrict dgains)
{
    const int count = dkf->config->n_neighbours;
    const dse_real *restrict said = dkf->said, *restrict age = dkf->age;
    const dse_real push = dkf->adapts[0] * dkf->rate * eps;
    const dse_real leak = dkf->adapts[0] * dkf->config->sigma;
    dse_real sum = 0;
    for (int j = 0; j < count; j++) {
        const dse_real d = said[j] - Cx;
        sum += age[j] >= 0 ? gains[j] * d : 0;
        if (dgains != NULL)
            dgains[j] = is_fresh(age[j]) ? push * d - leak * gains[j] : 0;
    }
    *q = sum;
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
        if (is_fresh(age))
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
        any = any || is_fresh(dkf->age[j]);
        for (int l = 0; l < m; l++) {
            used[l] += said[l] - Cx[l];
            if (is_fresh(dkf->age[j]))
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
    if (dkf->config->scheme == DSE_DKF_EDGE && dkf->ny == 1)
        couple_scalar_edges(dkf, gains, Cx[0], eps[0], q, dgains);
    else if (dkf->config->scheme == DSE_DKF_EDGE)
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
