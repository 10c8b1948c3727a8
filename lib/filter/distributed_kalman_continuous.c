/* Distributed Kalman filter, continuous: one Runge-Kutta step of estimate, covariance, gains and
 * Lyapunov matrix together. */
#include "distributed_kalman_internal.h"
#include "dse/math.h"
#include "dse/ode.h"

/* Scratch of the right-hand side. */
struct workspace {
    dse_real *A;    /* nx x nx */
    dse_real *AP;   /* nx x nx */
    dse_real *CP;   /* ny x nx: C P, or C W */
    dse_real *T;    /* ny x nx */
    dse_real *Cx;   /* ny */
    dse_real *eps;  /* ny */
    dse_real *d;    /* 2 ny */
    dse_real *q;    /* ny */
    dse_real *pull; /* ny: what C P' is multiplied by */
    dse_real *s;    /* nx */
    dse_real *rest; /* of the Runge-Kutta step */
};

static struct workspace workspace(const struct dse_dkf *dkf)
{
    const int n = dkf->nx, m = dkf->ny;
    dse_real *scratch = dkf->scratch;
    struct workspace w;
    w.A = dkf_take(&scratch, n * n);
    w.AP = dkf_take(&scratch, n * n);
    w.CP = dkf_take(&scratch, m * n);
    w.T = dkf_take(&scratch, m * n);
    w.Cx = dkf_take(&scratch, m);
    w.eps = dkf_take(&scratch, m);
    w.d = dkf_take(&scratch, 2 * m);
    w.q = dkf_take(&scratch, m);
    w.pull = dkf_take(&scratch, m);
    w.s = dkf_take(&scratch, n);
    w.rest = scratch;
    return w;
}

/* ---- the right-hand side ---- */

struct step {
    const struct dse_dkf *dkf;
    struct workspace w;
};

/* dX = F + F' + Q - U' T, each element computed once: X stays symmetric bit for bit. Q, or U and T
 * (m x n) may be NULL. */
static inline void symmetric_rate(int n, int m, const dse_real *restrict F,
                                  const dse_real *restrict Q, const dse_real *restrict U,
                                  const dse_real *restrict T, dse_real *restrict dX)
{
    for (int i = 0; i < n; i++) {
        dse_real *row = dX + i * n;
        for (int j = i; j < n; j++)
            row[j] = F[i * n + j] + F[j * n + i];
        for (int j = i; Q != NULL && j < n; j++)
            row[j] += Q[i * n + j];
        for (int l = 0; l < m; l++)
            for (int j = i; j < n; j++)
                row[j] -= U[l * n + i] * T[l * n + j];
        for (int j = i + 1; j < n; j++)
            dX[j * n + i] = row[j];
    }
}

/* P' = A P + P A' + Q - (C P)' R^-1 (C P); leaves C P behind. */
static inline void riccati(const struct dse_dkf *dkf, struct workspace *w, int n, int m,
                           const dse_real *P, dse_real *dP)
{
    dkf_product(n, n, n, w->A, P, w->AP);
    dkf_product(m, n, n, dkf->config->sensor.C, P, w->CP);
    dkf_product(m, m, n, dkf->R_present, w->CP, w->T);
    symmetric_rate(n, m, w->AP, dkf->config->Q, w->CP, w->T, dP);
}

/* The sizes of most nodes for the compiler to unroll, where loops of a few turns would cost more
 * than what is in them. Same operations, same order, same bits. */
static void riccati_rate(const struct dse_dkf *dkf, struct workspace *w, const dse_real *P,
                         dse_real *dP)
{
    const int n = dkf->nx, m = dkf->ny;
    if (m == 1 && n == 2)
        riccati(dkf, w, 2, 1, P, dP);
    else if (m == 1 && n == 3)
        riccati(dkf, w, 3, 1, P, dP);
    else if (m == 1 && n == 4)
        riccati(dkf, w, 4, 1, P, dP);
    else
        riccati(dkf, w, n, m, P, dP);
}

/* W' = A_i W + W A_i' + S,  A_i = A - K C, K = (R^-1 C P)' = T' when it is not given; leaves C W
 * behind. */
static void lyapunov_rate(const struct dse_dkf *dkf, struct workspace *w, const dse_real *W,
                          dse_real *dW)
{
    const int n = dkf->nx, m = dkf->ny;
    const dse_real *K = dkf->config->K;
    dkf_product(n, n, n, w->A, W, w->AP);
    dkf_product(m, n, n, dkf->config->sensor.C, W, w->CP);
    for (int i = 0; i < n; i++)
        for (int l = 0; l < m; l++) /* (A - K C) W */
            dse_axpy(n, K != NULL ? -K[i * m + l] : -w->T[l * n + i], w->CP + l * n, w->AP + i * n);
    symmetric_rate(n, 0, w->AP, dkf->config->S, NULL, NULL, dW);
}

/* dx += M' v for M m x n: gains of the form P C' = (C P)'. */
static void add_transposed(int m, int n, const dse_real *restrict M, const dse_real *restrict v,
                           dse_real *restrict dx)
{
    for (int l = 0; l < m; l++)
        for (int i = 0; i < n; i++)
            dx[i] += v[l] * M[l * n + i];
}

/* dx += a M v for M n x m. */
static void add_product(int n, int m, dse_real a, const dse_real *M, const dse_real *v,
                        dse_real *dx)
{
    for (int i = 0; i < n; i++)
        for (int l = 0; l < m; l++)
            dx[i] += a * M[i * m + l] * v[l];
}

/* dx += K eps + gamma D q, of which the parts that are P C' times something; needs C P. */
static void pull_by_covariance(const struct dse_dkf *dkf, struct workspace *w, dse_real *dx)
{
    const struct dse_dkf_config *config = dkf->config;
    const int n = dkf->nx, m = dkf->ny;
    dkf_apply(m, m, dkf->R_present, w->eps, w->pull); /* K eps = P C' R^-1 eps */
    if (dkf->n_gains > 0 && config->direction == DSE_DKF_COVARIANCE)
        for (int l = 0; l < m; l++)
            w->pull[l] += config->gamma * w->q[l]; /* D q = P C' q */
    if (dkf->n_gains > 0 && config->direction == DSE_DKF_GAIN)
        add_product(m, m, config->gamma, dkf->R_inverse, w->q, w->pull); /* D q = P C' R^-1 q */
    add_transposed(m, n, w->CP, w->pull, dx);
}

/* Gamma' and q. With D = K the residual of the law is R^-1 eps. */
static void couple(const struct dse_dkf *dkf, struct workspace *w, const dse_real *gains,
                   dse_real *dgains)
{
    const int m = dkf->ny;
    const dse_real *eps = w->eps;
    if (dkf->config->direction == DSE_DKF_GAIN) {
        dkf_apply(m, m, dkf->R_present, w->eps, w->pull);
        eps = w->pull;
    }
    dkf_couple(dkf, gains, w->Cx, eps, w->d, w->q, dgains);
}

static enum dse_status rates(void *context, dse_real t, const dse_real *state, dse_real *rate)
{
    struct step *step = context;
    const struct dse_dkf *dkf = step->dkf;
    const struct dse_dkf_config *config = dkf->config;
    struct workspace *w = &step->w;
    const int n = dkf->nx, m = dkf->ny;
    /* parts of what is only read, and of what is only written */
    const struct dkf_parts now = dkf_parts(dkf, (dse_real *)state), d = dkf_parts(dkf, rate);

    const enum dse_status status = dkf_plant(dkf, t, now.x, w->A, d.x); /* A xh */
    if (status != DSE_OK)
        return status;
    dkf_residual(dkf, now.x, w->Cx, w->eps);
    if (config->scheme == DSE_DKF_GLOBAL) /* not part of what is integrated: held */
        couple(dkf, w, dkf_parts(dkf, dkf->next).gains, NULL);
    else if (dkf->n_gains > 0)
        couple(dkf, w, now.gains, d.gains);
    if (now.P != NULL) {
        riccati_rate(dkf, w, now.P, d.P);
        pull_by_covariance(dkf, w, d.x);
    } else {
        add_product(n, m, 1, config->K, w->eps, d.x);
    }
    if (now.W != NULL) {
        lyapunov_rate(dkf, w, now.W, d.W);
        for (int l = 0; l < m; l++)
            w->q[l] *= config->gamma;
        add_transposed(m, n, w->CP, w->q, d.x); /* gamma W C' q */
    }
    if (dkf->n_gains > 0 && config->direction == DSE_DKF_GIVEN)
        add_product(n, m, config->gamma, config->D, w->q, d.x);
    if (config->scheme == DSE_DKF_STANDARD) {
        dkf_consensus(dkf, now.x, w->s);
        add_product(n, n, config->gamma, now.P, w->s, d.x); /* gamma P sum_j (xh_j - xh_i) */
    }
    return DSE_OK;
}

/* ---- the step ---- */

static enum dse_status check_definite(const struct dse_dkf *dkf, const struct workspace *w)
{
    const struct dkf_parts next = dkf_parts(dkf, dkf->next);
    enum dse_status status = DSE_OK;
    if (next.P != NULL)
        status = dse_cholesky(dkf->nx, next.P, w->AP);
    if (status == DSE_OK && next.W != NULL)
        status = dse_cholesky(dkf->nx, next.W, w->AP);
    return status;
}

static void copy(int n, const dse_real *from, dse_real *to)
{
    for (int i = 0; i < n; i++)
        to[i] = from[i];
}

/* `next` to the end of the period. */
static enum dse_status integrate(struct dse_dkf *dkf)
{
    struct step step = {.dkf = dkf, .w = workspace(dkf)};
    const enum dse_status status = dse_rk4_step(rates, &step, dkf->t, dkf->config->period,
                                                dkf->n_integrated, dkf->next, step.w.rest);
    return status == DSE_OK ? check_definite(dkf, &step.w) : status;
}

/* The measurement alone, x' = P C' R^-1 (y - C x) and P' = -P C' R^-1 C P over a period h, is
 * solved by the update of a Kalman filter that samples y with the noise R / h. R_present is then
 * zero: the rest of the step sees no measurement. */
static enum dse_status measure(struct dse_dkf *dkf)
{
    const int n = dkf->nx, m = dkf->ny;
    const struct dkf_parts next = dkf_parts(dkf, dkf->next);
    dse_real *scratch = dkf->scratch;
    struct dkf_update update = dkf_update_in(dkf, &scratch);
    const enum dse_status status =
        dkf_update_covariance(dkf, 1 / dkf->config->period, next.P, &update);
    if (status != DSE_OK)
        return status;
    dkf_residual(dkf, next.x, update.Cx, update.eps);
    add_product(n, m, 1, update.K, update.eps, next.x);
    copy(n * n, update.M, next.P);
    for (int k = 0; k < m * m; k++)
        dkf->R_present[k] = 0;
    return DSE_OK;
}

/* Gamma(k+1) = Gamma(k) + h (beta sum_i eps_i s_i' - sigma Gamma(k))                       (2.12)
 */
static void adapt_global(struct dse_dkf *dkf)
{
    dse_real *gain = dkf_parts(dkf, dkf->next).gains;
    for (int k = 0; k < dkf->ny * dkf->ny; k++)
        gain[k] +=
            dkf->config->period * (dkf->rate * dkf->global[k] - dkf->config->sigma * gain[k]);
}

enum dse_status dkf_advance_continuous(struct dse_dkf *dkf)
{
    copy(dkf->n_state, dkf->now, dkf->next);
    enum dse_status status = integrate(dkf);
    if ((status == DSE_ENOTPD || status == DSE_ENONFINITE) && dkf->riccati && dkf->present > 0) {
        copy(dkf->n_state, dkf->now, dkf->next);
        status = measure(dkf);
        if (status == DSE_OK)
            status = integrate(dkf);
        dkf->counts.split++;
    }
    if (status != DSE_OK)
        return status;
    const struct dkf_parts next = dkf_parts(dkf, dkf->next);
    if (dkf->has_global)
        adapt_global(dkf);
    if (!dse_all_finite(next.gains, dkf->n_gains * dkf->ny * dkf->ny))
        return DSE_ENONFINITE;
    dkf_limit(dkf, next.gains);
    return DSE_OK;
}
