/* Equations of the plant sep3: (3.63) of the coordinated MHE source with the corrections that its
 * steady state asks for (sep3.c). With k_j(T) = k_j exp(-s_j/T) and overhead fractions
 * x_ir = a_i x_i3/d, d = sum_i a_i x_i3, x_C3 = 1 - x_A3 - x_B3. */
#include "sep3_internal.h"

#include <stddef.h>

#include "dse/math.h"

/* Rates of the two reactions, and their derivatives in T. */
struct rates {
    dse_real k[2], dk[2];
};

static enum dse_status rates_at(const struct dse_sep3 *p, dse_real T, struct rates *rates)
{
    if (!(T > 0) || !dse_is_finite(T))
        return DSE_EMODEL;
    for (int j = 0; j < 2; j++) {
        rates->k[j] = p->k[j] * dse_exp(-p->s[j] / T);
        rates->dk[j] = rates->k[j] * p->s[j] / (T * T);
    }
    return DSE_OK;
}

/* Overhead fractions of A, B, C (x), and their derivatives in x_A3 (dA) and x_B3 (dB). */
struct overhead {
    dse_real x[3], dA[3], dB[3];
};

static enum dse_status overhead_of(const struct dse_sep3 *p, dse_real xA, dse_real xB,
                                   struct overhead *out)
{
    const dse_real *a = p->a;
    const dse_real part[3] = {a[0] * xA, a[1] * xB, a[2] * (1 - xA - xB)};
    const dse_real d = part[0] + part[1] + part[2];
    if (!(d > 0) || !dse_is_finite(d))
        return DSE_EMODEL;
    const dse_real slope_A[3] = {a[0], 0, -a[2]}, slope_B[3] = {0, a[1], -a[2]};
    for (int i = 0; i < 3; i++) {
        /* (n/d)' = (n' - (n/d) d')/d */
        out->x[i] = part[i] / d;
        out->dA[i] = (slope_A[i] - out->x[i] * (a[0] - a[2])) / d;
        out->dB[i] = (slope_B[i] - out->x[i] * (a[1] - a[2])) / d;
    }
    return DSE_OK;
}

/* What the reactions do to (x_A, x_B, T) of a reactor: A -> B -> C. */
static void react(const struct dse_sep3 *p, const struct rates *r, const dse_real *x, dse_real *dx)
{
    dx[0] -= r->k[0] * x[0];
    dx[1] += r->k[0] * x[0] - r->k[1] * x[1];
    dx[2] += p->g[0] * r->k[0] * x[0] + p->g[1] * r->k[1] * x[1];
}

static enum dse_status derivative(const struct dse_model *model, dse_real t, const dse_real *x,
                                  const dse_real *u, dse_real *dx)
{
    const struct dse_sep3 *p = model->parameters;
    const dse_real *x1 = x, *x2 = x + 3, *x3 = x + 6;
    struct rates r1, r2;
    struct overhead over;
    (void)t;
    if (u == NULL)
        return DSE_EINVAL;
    if (rates_at(p, x1[2], &r1) != DSE_OK || rates_at(p, x2[2], &r2) != DSE_OK ||
        overhead_of(p, x3[0], x3[1], &over) != DSE_OK)
        return DSE_EMODEL;
    const dse_real feed[2][3] = {{p->xA_feed[0], p->xB_feed[0], p->T_feed[0]},
                                 {p->xA_feed[1], p->xB_feed[1], p->T_feed[1]}};
    const dse_real recycle[3] = {over.x[0], over.x[1], x3[2]};
    for (int i = 0; i < 3; i++) {
        dx[i] = p->feed_1 * (feed[0][i] - x1[i]) + p->recycle_1 * (recycle[i] - x1[i]);
        dx[3 + i] = p->from_1 * (x1[i] - x2[i]) + p->feed_2 * (feed[1][i] - x2[i]);
        dx[6 + i] = p->from_2 * (x2[i] - x3[i]);
    }
    react(p, &r1, x1, dx);
    react(p, &r2, x2, dx + 3);
    dx[6] -= p->overhead_3 * (over.x[0] - x3[0]);
    dx[7] -= p->overhead_3 * (over.x[1] - x3[1]);
    for (int i = 0; i < 3; i++) {
        dx[8] += p->evaporation[i] * over.x[i];
        dx[3 * i + 2] += p->heat[i] * u[i];
    }
    return DSE_OK;
}

static enum dse_status output(const struct dse_model *model, dse_real t, const dse_real *x,
                              const dse_real *u, dse_real *y)
{
    (void)model, (void)t, (void)u;
    for (int i = 0; i < DSE_SEP3_NY; i++)
        y[i] = x[3 * i + 2];
    return DSE_OK;
}

static enum dse_status output_jacobian(const struct dse_model *model, dse_real t, const dse_real *x,
                                       const dse_real *u, dse_real *H)
{
    (void)model, (void)t, (void)x, (void)u;
    for (int k = 0; k < DSE_SEP3_NY * DSE_SEP3_NX; k++)
        H[k] = 0;
    for (int i = 0; i < DSE_SEP3_NY; i++)
        H[i * DSE_SEP3_NX + 3 * i + 2] = 1;
    return DSE_OK;
}

/* d(react)/dx into the block at F of a reactor's own states. */
static void react_jacobian(const struct dse_sep3 *p, const struct rates *r, const dse_real *x,
                           dse_real *F)
{
    const int n = DSE_SEP3_NX;
    F[0] -= r->k[0];
    F[2] -= r->dk[0] * x[0];
    F[n] += r->k[0];
    F[n + 1] -= r->k[1];
    F[n + 2] += r->dk[0] * x[0] - r->dk[1] * x[1];
    F[2 * n] += p->g[0] * r->k[0];
    F[2 * n + 1] += p->g[1] * r->k[1];
    F[2 * n + 2] += p->g[0] * r->dk[0] * x[0] + p->g[1] * r->dk[1] * x[1];
}

static enum dse_status derivative_jacobian(const struct dse_model *model, dse_real t,
                                           const dse_real *x, const dse_real *u, dse_real *F)
{
    const struct dse_sep3 *p = model->parameters;
    const int n = DSE_SEP3_NX;
    struct rates r1, r2;
    struct overhead over;
    (void)t, (void)u;
    if (rates_at(p, x[2], &r1) != DSE_OK || rates_at(p, x[5], &r2) != DSE_OK ||
        overhead_of(p, x[6], x[7], &over) != DSE_OK)
        return DSE_EMODEL;
    for (int k = 0; k < n * n; k++)
        F[k] = 0;
    for (int i = 0; i < 3; i++) {
        F[i * n + i] = -p->feed_1 - p->recycle_1;
        F[(3 + i) * n + i] = p->from_1;
        F[(3 + i) * n + 3 + i] = -p->from_1 - p->feed_2;
        F[(6 + i) * n + 3 + i] = p->from_2;
        F[(6 + i) * n + 6 + i] = -p->from_2;
    }
    react_jacobian(p, &r1, x, F);
    react_jacobian(p, &r2, x + 3, F + 3 * n + 3);
    for (int i = 0; i < 2; i++) {
        /* recycle into reactor 1; overhead out of the separator */
        F[i * n + 6] = p->recycle_1 * over.dA[i];
        F[i * n + 7] = p->recycle_1 * over.dB[i];
        F[(6 + i) * n + 6] -= p->overhead_3 * over.dA[i];
        F[(6 + i) * n + 7] -= p->overhead_3 * over.dB[i];
        F[(6 + i) * n + 6 + i] += p->overhead_3;
    }
    F[2 * n + 8] = p->recycle_1;
    for (int i = 0; i < 3; i++) {
        F[8 * n + 6] += p->evaporation[i] * over.dA[i];
        F[8 * n + 7] += p->evaporation[i] * over.dB[i];
    }
    return DSE_OK;
}

void dse_sep3_model(const dse_real *prepared, struct dse_model *model)
{
    *model = (struct dse_model){.time = DSE_CONTINUOUS,
                                .nx = DSE_SEP3_NX,
                                .nu = DSE_SEP3_NU,
                                .ny = DSE_SEP3_NY,
                                .parameters = prepared,
                                .f = derivative,
                                .h = output,
                                .dfdx = derivative_jacobian,
                                .dhdx = output_jacobian};
}
