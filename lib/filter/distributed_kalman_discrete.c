/* Distributed Kalman filter, discrete (sections 4.10, 4.11). */
#include "distributed_kalman_internal.h"
#include "dse/math.h"

struct workspace {
    struct dkf_update update;
    dse_real *A; /* nx x nx */
    dse_real *d; /* 2 ny */
    dse_real *q; /* ny */
    int *pivots; /* nx */
};

static struct workspace workspace(const struct dse_dkf *dkf)
{
    const int n = dkf->nx, m = dkf->ny;
    dse_real *scratch = dkf->scratch;
    struct workspace w = {.update = dkf_update_in(dkf, &scratch)};
    w.A = dkf_take(&scratch, n * n);
    w.d = dkf_take(&scratch, 2 * m);
    w.q = dkf_take(&scratch, m);
    w.pivots = (int *)(void *)dkf_take(&scratch, DSE_ARENA_INTS(n));
    return w;
}

/* D = P X^-T C'; X (nx x nx) is in w->update.LU, transposed. */
static enum dse_status direction(struct dse_dkf *dkf, struct workspace *w, const dse_real *P)
{
    const int n = dkf->nx, m = dkf->ny;
    const enum dse_status status = dse_lu(n, w->update.LU, w->pivots);
    if (status != DSE_OK)
        return status;
    dse_mat_transpose(m, n, dkf->config->sensor.C, w->update.Z);
    dse_lu_solve(n, w->update.LU, w->pivots, m, w->update.Z);
    dse_mat_mul(n, n, m, P, w->update.Z, dkf->direction);
    return DSE_OK;
}

static enum dse_status find_direction(struct dse_dkf *dkf, struct workspace *w, const dse_real *P,
                                      const dse_real *P_next)
{
    const int n = dkf->nx, m = dkf->ny;
    switch (dkf->config->direction) {
    case DSE_DKF_GIVEN:
        for (int k = 0; k < n * m; k++)
            dkf->direction[k] = dkf->config->D[k];
        return DSE_OK;
    case DSE_DKF_FILTERED: /* P(k) A(k-1)^-T C' */
        dse_mat_transpose(n, n, dkf->has_before ? dkf->A_before : w->A, w->update.LU);
        return direction(dkf, w, P);
    default: /* P(k+1) A_i^-T C',  A_i = A - K C A = J A                                    (6.6) */
        dse_mat_mul(n, n, n, w->update.J, w->A, w->update.M);
        dse_mat_transpose(n, n, w->update.M, w->update.LU);
        return direction(dkf, w, P_next);
    }
}

/* Gamma += gamma beta eps d' - sigma Gamma, eps = dkf->residual, and q with the new Gamma when
 * `act_after`, else with the old one. The new gains go to `next`. */
static void couple(struct dse_dkf *dkf, struct workspace *w, bool act_after)
{
    const struct dkf_parts now = dkf_parts(dkf, dkf->now), next = dkf_parts(dkf, dkf->next);
    const int count = dkf->n_gains * dkf->ny * dkf->ny;
    dkf_couple(dkf, now.gains, w->update.Cx, dkf->residual, w->d, w->q, next.gains);
    for (int k = 0; k < count; k++)
        next.gains[k] += now.gains[k];
    dkf_limit(dkf, next.gains);
    if (act_after)
        dkf_couple(dkf, next.gains, w->update.Cx, dkf->residual, w->d, w->q, NULL);
}

/* x + K eps + gamma D q. */
static void add_corrections(const struct dse_dkf *dkf, const dse_real *K, const dse_real *eps,
                            const dse_real *D, const dse_real *q, dse_real *x)
{
    const int n = dkf->nx, m = dkf->ny;
    for (int i = 0; i < n; i++) {
        x[i] += dse_dot(m, K + i * m, eps);
        if (dkf->n_gains > 0)
            x[i] += dkf->config->gamma * dse_dot(m, D + i * m, q);
    }
}

static void copy(int n, const dse_real *from, dse_real *to)
{
    for (int i = 0; i < n; i++)
        to[i] = from[i];
}

/* One sample of section 4.10: `filtered` is made of the prior in `now`, all else goes to `next`.
 * The gains take the step from k - 1 to k first, whose difference is the one of this sample's
 * messages and whose residual is that of k - 1: so one message per edge and step suffices. */
enum dse_status dkf_correct_discrete(struct dse_dkf *dkf)
{
    struct workspace w = workspace(dkf);
    const struct dkf_parts now = dkf_parts(dkf, dkf->now), next = dkf_parts(dkf, dkf->next);
    const int n = dkf->nx, m = dkf->ny;

    enum dse_status status = dkf_plant(dkf, dkf->t, now.x, w.A, next.x);
    if (status == DSE_OK)
        status = dkf_update_covariance(dkf, 1, now.P, &w.update);
    if (status != DSE_OK)
        return status;
    dse_sym_congruence(n, n, w.A, w.update.M, dkf->config->Q, next.P, w.update.LU);
    if (dkf->n_gains > 0)
        status = find_direction(dkf, &w, now.P, next.P);
    if (status != DSE_OK)
        return status;

    dse_mat_vec(m, n, dkf->config->sensor.C, now.x, w.update.Cx);
    if (dkf->n_gains > 0)
        couple(dkf, &w, true);
    dkf_residual(dkf, now.x, w.update.Cx, w.update.eps);
    copy(n, now.x, dkf->filtered);
    add_corrections(dkf, w.update.K, w.update.eps, dkf->direction, w.q, dkf->filtered); /* xh(k) */
    status = dkf_plant(dkf, dkf->t, dkf->filtered, w.A, next.x); /* xb(k+1) = A xh(k) */
    if (status != DSE_OK)
        return status;
    if (!dse_all_finite(dkf->next, dkf->n_state) || !dse_all_finite(dkf->filtered, n))
        return DSE_ENONFINITE;
    dkf_residual(dkf, dkf->filtered, w.update.Cx,
                 dkf->residual); /* y - C xh, for the gains' next step */
    copy(m, dkf->has, dkf->adapts);
    copy(dkf->A_before != NULL ? n * n : 0, w.A, dkf->A_before);
    dkf->has_before = true;
    return DSE_OK;
}

/* Section 4.11, all quantities of time k:
 *     xh(k+1)    = A xh + K (y - C xh) + gamma D sum_j Gamma_ij d_ij
 *     Gamma(k+1) = Gamma + gamma (y - C xh) d_ij' */
enum dse_status dkf_advance_predictor(struct dse_dkf *dkf)
{
    struct workspace w = workspace(dkf);
    const struct dkf_parts now = dkf_parts(dkf, dkf->now), next = dkf_parts(dkf, dkf->next);
    const enum dse_status status = dkf_plant(dkf, dkf->t, now.x, w.A, next.x);
    if (status != DSE_OK)
        return status;
    dkf_residual(dkf, now.x, w.update.Cx, dkf->residual);
    if (dkf->n_gains > 0)
        couple(dkf, &w, false);
    add_corrections(dkf, dkf->config->K, dkf->residual, dkf->config->D, w.q, next.x);
    return dse_all_finite(dkf->next, dkf->n_state) ? DSE_OK : DSE_ENONFINITE;
}
