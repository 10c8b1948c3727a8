/* Distributed Kalman filter, discrete (sections 4.10, 4.11). */
#include "distributed_kalman_internal.h"
#include "dse/math.h"

struct workspace {
    dse_real *A;     /* nx x nx */
    dse_real *J;     /* nx x nx: I - K C */
    dse_real *M;     /* nx x nx: covariance of the filtered estimate */
    dse_real *LU;    /* nx x nx, also scratch of products */
    dse_real *Kt;    /* ny x nx: K' */
    dse_real *CP;    /* ny x nx */
    dse_real *K;     /* nx x ny */
    dse_real *Z;     /* nx x ny */
    dse_real *S;     /* ny x ny */
    dse_real *noise; /* ny x ny */
    dse_real *Cx;    /* ny */
    dse_real *d;     /* 2 ny */
    dse_real *q;     /* ny */
    dse_real *pull;  /* nx */
    int *pivots;     /* nx */
};

static struct workspace workspace(const struct dse_dkf *dkf)
{
    const int n = dkf->nx, m = dkf->ny;
    dse_real *scratch = dkf->scratch;
    struct workspace w;
    w.A = dkf_take(&scratch, n * n);
    w.J = dkf_take(&scratch, n * n);
    w.M = dkf_take(&scratch, n * n);
    w.LU = dkf_take(&scratch, n * n);
    w.Kt = dkf_take(&scratch, m * n);
    w.CP = dkf_take(&scratch, m * n);
    w.K = dkf_take(&scratch, n * m);
    w.Z = dkf_take(&scratch, n * m);
    w.S = dkf_take(&scratch, m * m);
    w.noise = dkf_take(&scratch, m * m);
    w.Cx = dkf_take(&scratch, m);
    w.d = dkf_take(&scratch, 2 * m);
    w.q = dkf_take(&scratch, m);
    w.pull = dkf_take(&scratch, n);
    w.pivots = (int *)(void *)dkf_take(&scratch, DSE_ARENA_INTS(n));
    return w;
}

/* K = P C' (R + C P C')^-1 of the channels that there are, zero columns for the others: their rows
 * of the innovation's covariance are those of the identity, and their right-hand sides zero. */
static enum dse_status kalman_gain(const struct dse_dkf *dkf, struct workspace *w,
                                   const dse_real *P)
{
    const int n = dkf->nx, m = dkf->ny;
    const dse_real *C = dkf->config->sensor.C, *R = dkf->config->R;
    dse_mat_mul(m, n, n, C, P, w->CP);
    dse_mat_mul_nt(m, n, m, w->CP, C, w->S);
    for (int r = 0; r < m; r++) {
        for (int c = 0; c < m; c++) {
            const bool both = dkf->has[r] != 0 && dkf->has[c] != 0;
            w->noise[r * m + c] = both ? R[r * m + c] : 0;
            w->S[r * m + c] = both ? w->S[r * m + c] + R[r * m + c] : (dse_real)(r == c);
        }
        for (int i = 0; i < n; i++)
            w->Kt[r * n + i] = dkf->has[r] != 0 ? w->CP[r * n + i] : 0;
    }
    const enum dse_status status = dse_cholesky(m, w->S, w->S);
    if (status != DSE_OK)
        return status;
    dse_cholesky_solve(m, w->S, n, w->Kt);
    dse_mat_transpose(m, n, w->Kt, w->K);
    return DSE_OK;
}

/* M = J P J' + K R K' (Joseph), J = I - K C;  P(k+1) = A M A' + Q. */
static void next_covariance(const struct dse_dkf *dkf, struct workspace *w, const dse_real *P,
                            dse_real *P_next)
{
    const int n = dkf->nx, m = dkf->ny;
    dse_mat_mul(n, m, n, w->K, dkf->config->sensor.C, w->J);
    for (int k = 0; k < n * n; k++)
        w->J[k] = (dse_real)(k % (n + 1) == 0) - w->J[k];
    dse_sym_congruence(n, m, w->K, w->noise, NULL, w->M, w->Z);
    dse_sym_congruence(n, n, w->J, P, w->M, w->M, w->LU);
    dse_sym_congruence(n, n, w->A, w->M, dkf->config->Q, P_next, w->LU);
}

/* D = P X^-T C'; X (nx x nx) is in w->LU, transposed. */
static enum dse_status direction(struct dse_dkf *dkf, struct workspace *w, const dse_real *P)
{
    const int n = dkf->nx, m = dkf->ny;
    const enum dse_status status = dse_lu(n, w->LU, w->pivots);
    if (status != DSE_OK)
        return status;
    dse_mat_transpose(m, n, dkf->config->sensor.C, w->Z);
    dse_lu_solve(n, w->LU, w->pivots, m, w->Z);
    dse_mat_mul(n, n, m, P, w->Z, dkf->direction);
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
        dse_mat_transpose(n, n, dkf->has_before ? dkf->A_before : w->A, w->LU);
        return direction(dkf, w, P);
    default: /* P(k+1) A_i^-T C',  A_i = A - K C A = J A                                    (6.6) */
        dse_mat_mul(n, n, n, w->J, w->A, w->M);
        dse_mat_transpose(n, n, w->M, w->LU);
        return direction(dkf, w, P_next);
    }
}

/* Gamma += gamma beta eps d' - sigma Gamma, eps = dkf->residual, and q with the new Gamma when
 * `act_after`, else with the old one. The new gains go to `next`. */
static void couple(struct dse_dkf *dkf, struct workspace *w, bool act_after)
{
    const struct dkf_parts now = dkf_parts(dkf, dkf->now), next = dkf_parts(dkf, dkf->next);
    const int count = dkf->n_gains * dkf->ny * dkf->ny;
    dkf_couple(dkf, now.gains, w->Cx, dkf->residual, w->d, w->q, next.gains);
    for (int k = 0; k < count; k++)
        next.gains[k] += now.gains[k];
    dkf_limit(dkf, next.gains);
    if (act_after)
        dkf_couple(dkf, next.gains, w->Cx, dkf->residual, w->d, w->q, NULL);
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
        status = kalman_gain(dkf, &w, now.P);
    if (status != DSE_OK)
        return status;
    next_covariance(dkf, &w, now.P, next.P);
    if (dkf->n_gains > 0)
        status = find_direction(dkf, &w, now.P, next.P);
    if (status != DSE_OK)
        return status;

    dse_mat_vec(m, n, dkf->config->sensor.C, now.x, w.Cx);
    if (dkf->n_gains > 0)
        couple(dkf, &w, true);
    dkf_residual(dkf, now.x, w.Cx, w.d);
    copy(n, now.x, dkf->filtered);
    add_corrections(dkf, w.K, w.d, dkf->direction, w.q, dkf->filtered); /* xh(k) */
    status = dkf_plant(dkf, dkf->t, dkf->filtered, w.A, next.x);        /* xb(k+1) = A xh(k) */
    if (status != DSE_OK)
        return status;
    if (!dse_all_finite(dkf->next, dkf->n_state) || !dse_all_finite(dkf->filtered, n))
        return DSE_ENONFINITE;
    dkf_residual(dkf, dkf->filtered, w.Cx, dkf->residual); /* y - C xh, for the gains' next step */
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
    dkf_residual(dkf, now.x, w.Cx, dkf->residual);
    if (dkf->n_gains > 0)
        couple(dkf, &w, false);
    add_corrections(dkf, dkf->config->K, dkf->residual, dkf->config->D, w.q, next.x);
    return dse_all_finite(dkf->next, dkf->n_state) ? DSE_OK : DSE_ENONFINITE;
}
