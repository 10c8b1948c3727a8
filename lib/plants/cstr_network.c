/* Physical model of a reactor network: see cstr_network_internal.h. */
#include "cstr_network_internal.h"

#include <stddef.h>

#include "dse/math.h"

/* ---- building ---- */

struct dse_cstr_network *dse_cstr_network_clear(dse_real *prepared)
{
    for (int k = 0; k < DSE_CSTR_NETWORK_SIZE; k++) {
        prepared[k] = 0;
    }
    return (struct dse_cstr_network *)prepared;
}

void dse_cstr_add_feed(struct dse_cstr_mixing *mixing, int i, dse_real V, dse_real F, dse_real T,
                       dse_real C)
{
    /* (F/V) (T_0 - T_i), (F/V) (C_0 - C_i) */
    mixing->aT[i] += F / V * T;
    mixing->aC[i] += F / V * C;
    mixing->a[i][i] -= F / V;
}

void dse_cstr_add_link(struct dse_cstr_mixing *mixing, int from, int to, dse_real V_to, dse_real F)
{
    /* (F/V) (T_from - T_to), likewise C */
    mixing->a[to][from] += F / V_to;
    mixing->a[to][to] -= F / V_to;
}

void dse_cstr_add_heat(struct dse_cstr_mixing *mixing, int i, dse_real V, dse_real rho_cp,
                       dse_real Q)
{
    mixing->aT[i] += Q / (rho_cp * V);
}

void dse_cstr_add_reaction(struct dse_cstr_network *network, dse_real rho_cp, dse_real gas,
                           dse_real dH, dse_real k0, dse_real E)
{
    int count = (int)network->exponentials;
    const dse_real s = E / gas;
    int l = 0;
    /* exactly the same exponent: the same exponential serves both */
    while (l < count && !(network->s[l] <= s && network->s[l] >= s)) {
        l++;
    }
    if (l == count) {
        count++;
    }
    network->exponentials = (dse_real)count;
    network->s[l] = s;
    network->k[l] += k0;
    network->q[l] += -dH / rho_cp * k0;
}

/* ---- parts of the right-hand side ---- */

static enum dse_status check_temperature(dse_real T)
{
    return T > 0 && dse_is_finite(T) ? DSE_OK : DSE_EMODEL;
}

enum dse_status dse_cstr_rates(const struct dse_cstr_network *network, dse_real T, dse_real *Rh,
                               dse_real *r)
{
    const int count = (int)network->exponentials;
    if (check_temperature(T) != DSE_OK) {
        return DSE_EMODEL;
    }
    *Rh = 0;
    *r = 0;
    for (int l = 0; l < count; l++) {
        const dse_real e = dse_exp(-network->s[l] / T);
        *Rh += network->q[l] * e;
        *r += network->k[l] * e;
    }
    return DSE_OK;
}

enum dse_status dse_cstr_kinetics(const struct dse_cstr_network *network, dse_real T,
                                  struct dse_cstr_kinetics *kinetics)
{
    const int count = (int)network->exponentials;
    if (check_temperature(T) != DSE_OK) {
        return DSE_EMODEL;
    }
    *kinetics = (struct dse_cstr_kinetics){0};
    for (int l = 0; l < count; l++) {
        /* e = exp(-s/T), e' = e s/T^2, e'' = e s/T^3 (s/T - 2) */
        const dse_real s = network->s[l];
        const dse_real e = dse_exp(-s / T);
        const dse_real de = e * s / (T * T);
        const dse_real dde = de * (s / T - 2) / T;
        kinetics->Rh += network->q[l] * e;
        kinetics->dRh += network->q[l] * de;
        kinetics->ddRh += network->q[l] * dde;
        kinetics->r += network->k[l] * e;
        kinetics->dr += network->k[l] * de;
    }
    return DSE_OK;
}

enum dse_status dse_cstr_inputs(int nu, const dse_real **u)
{
    if (nu == 0) {
        *u = NULL;
        return DSE_OK;
    }
    return *u == NULL ? DSE_EINVAL : DSE_OK;
}

dse_real dse_cstr_a(const struct dse_cstr_network *network, const dse_real *u, int i, int j)
{
    return u == NULL ? network->constant.a[i][j]
                     : network->constant.a[i][j] + u[DSE_CSTR_FEED] * network->per_feed.a[i][j];
}

dse_real dse_cstr_aT(const struct dse_cstr_network *network, const dse_real *u, int i)
{
    return u == NULL ? network->constant.aT[i]
                     : network->constant.aT[i] + u[DSE_CSTR_FEED] * network->per_feed.aT[i];
}

dse_real dse_cstr_aC(const struct dse_cstr_network *network, const dse_real *u, int i)
{
    return u == NULL ? network->constant.aC[i]
                     : network->constant.aC[i] + u[DSE_CSTR_FEED] * network->per_feed.aC[i];
}

/* ---- the model ---- */

static enum dse_status derivative(const struct dse_model *model, dse_real t, const dse_real *x,
                                  const dse_real *u, dse_real *dx)
{
    const struct dse_cstr_network *network = model->parameters;
    const int reactors = model->ny;
    (void)t;
    if (dse_cstr_inputs(model->nu, &u) != DSE_OK) {
        return DSE_EINVAL;
    }
    for (int i = 0; i < reactors; i++) {
        dse_real Rh, r;
        if (dse_cstr_rates(network, x[2 * i], &Rh, &r) != DSE_OK) {
            return DSE_EMODEL;
        }
        /* T_i' = aT_i + sum_j a_ij T_j + R_h C_i,  C_i' = aC_i + sum_j a_ij C_j - r C_i */
        dse_real dT = dse_cstr_aT(network, u, i);
        dse_real dC = dse_cstr_aC(network, u, i);
        for (int j = 0; j < reactors; j++) {
            const dse_real a = dse_cstr_a(network, u, i, j);
            dT += a * x[2 * j];
            dC += a * x[2 * j + 1];
        }
        dx[2 * i] = dT + Rh * x[2 * i + 1];
        dx[2 * i + 1] = dC - r * x[2 * i + 1];
    }
    return DSE_OK;
}

/* Several states side by side: their exponentials are taken together, everything else is as in
 * derivative(). */
enum { LANES = 4 };

static enum dse_status lane_rates(const struct dse_cstr_network *network, int temperatures,
                                  const dse_real *x, dse_real *Rh, dse_real *r)
{
    const int count = (int)network->exponentials;
    dse_real e[LANES * DSE_CSTR_NETWORK_MAX * DSE_CSTR_REACTIONS];
    for (int k = 0; k < temperatures; k++) {
        if (check_temperature(x[2 * k]) != DSE_OK) {
            return DSE_EMODEL;
        }
        for (int l = 0; l < count; l++) {
            e[k * count + l] = -network->s[l] / x[2 * k];
        }
    }
    dse_exp_many(temperatures * count, e, e);
    for (int k = 0; k < temperatures; k++) {
        Rh[k] = 0;
        r[k] = 0;
        for (int l = 0; l < count; l++) {
            Rh[k] += network->q[l] * e[k * count + l];
            r[k] += network->k[l] * e[k * count + l];
        }
    }
    return DSE_OK;
}

static enum dse_status derivatives(const struct dse_model *model, dse_real t, int count,
                                   const dse_real *x, const dse_real *u, dse_real *dx)
{
    const struct dse_cstr_network *network = model->parameters;
    const int reactors = model->ny;
    dse_real a[DSE_CSTR_NETWORK_MAX][DSE_CSTR_NETWORK_MAX];
    dse_real Rh[LANES * DSE_CSTR_NETWORK_MAX], r[LANES * DSE_CSTR_NETWORK_MAX];
    (void)t;
    if (dse_cstr_inputs(model->nu, &u) != DSE_OK) {
        return DSE_EINVAL;
    }
    for (int i = 0; i < reactors; i++) {
        for (int j = 0; j < reactors; j++) {
            a[i][j] = dse_cstr_a(network, u, i, j);
        }
    }
    for (int first = 0; first < count; first += LANES) {
        const int lanes = count - first < LANES ? count - first : LANES;
        const dse_real *X = x + first * model->nx;
        dse_real *dX = dx + first * model->nx;
        if (lane_rates(network, lanes * reactors, X, Rh, r) != DSE_OK) {
            return DSE_EMODEL;
        }
        for (int i = 0; i < reactors; i++) {
            const dse_real aT = dse_cstr_aT(network, u, i), aC = dse_cstr_aC(network, u, i);
            for (int l = 0; l < lanes; l++) {
                const dse_real *z = X + l * model->nx;
                dse_real dT = aT, dC = aC;
                for (int j = 0; j < reactors; j++) {
                    dT += a[i][j] * z[2 * j];
                    dC += a[i][j] * z[2 * j + 1];
                }
                dX[l * model->nx + 2 * i] = dT + Rh[l * reactors + i] * z[2 * i + 1];
                dX[l * model->nx + 2 * i + 1] = dC - r[l * reactors + i] * z[2 * i + 1];
            }
        }
    }
    return DSE_OK;
}

static enum dse_status output(const struct dse_model *model, dse_real t, const dse_real *x,
                              const dse_real *u, dse_real *y)
{
    (void)t;
    (void)u;
    for (int i = 0; i < model->ny; i++) {
        y[i] = x[2 * i];
    }
    return DSE_OK;
}

static enum dse_status derivative_jacobian(const struct dse_model *model, dse_real t,
                                           const dse_real *x, const dse_real *u, dse_real *F)
{
    const struct dse_cstr_network *network = model->parameters;
    const int reactors = model->ny;
    const int n = model->nx;
    (void)t;
    if (dse_cstr_inputs(model->nu, &u) != DSE_OK) {
        return DSE_EINVAL;
    }
    for (int i = 0; i < reactors; i++) {
        struct dse_cstr_kinetics kinetics;
        if (dse_cstr_kinetics(network, x[2 * i], &kinetics) != DSE_OK) {
            return DSE_EMODEL;
        }
        dse_real *row_T = F + 2 * i * n;
        dse_real *row_C = row_T + n;
        for (int j = 0; j < reactors; j++) {
            const dse_real a = dse_cstr_a(network, u, i, j);
            row_T[2 * j] = a;
            row_T[2 * j + 1] = 0;
            row_C[2 * j] = 0;
            row_C[2 * j + 1] = a;
        }
        row_T[2 * i] += kinetics.dRh * x[2 * i + 1];
        row_T[2 * i + 1] += kinetics.Rh;
        row_C[2 * i] -= kinetics.dr * x[2 * i + 1];
        row_C[2 * i + 1] -= kinetics.r;
    }
    return DSE_OK;
}

static enum dse_status output_jacobian(const struct dse_model *model, dse_real t, const dse_real *x,
                                       const dse_real *u, dse_real *H)
{
    (void)t;
    (void)x;
    (void)u;
    for (int k = 0; k < model->ny * model->nx; k++) {
        H[k] = 0;
    }
    for (int i = 0; i < model->ny; i++) {
        H[i * model->nx + 2 * i] = 1;
    }
    return DSE_OK;
}

void dse_cstr_network_model(const dse_real *prepared, int reactors, int nu, struct dse_model *model)
{
    *model = (struct dse_model){.time = DSE_CONTINUOUS,
                                .nx = 2 * reactors,
                                .nu = nu,
                                .ny = reactors,
                                .parameters = prepared,
                                .f = derivative,
                                .h = output,
                                .dfdx = derivative_jacobian,
                                .dhdx = output_jacobian,
                                .f_many = derivatives};
}
