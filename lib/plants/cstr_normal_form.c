/* Normal form of a reactor network, in closed form (section 5.1 of the adaptive high-gain spec):
 *
 *     z_i = (T_i, Tdot_i),   C_i = (z_i2 - aT_i - sum_j a_ij T_j) / R_h(T_i)
 *
 * Tdot_i is the full time derivative at the current feed flow, so that b_i1 = 0 even when the flow
 * varies; the rate of the flow then enters the last row (section 4.1). */
#include "cstr_network_internal.h"

#include <stddef.h>

#include "dse/math.h"

/* Everything about one point z that the field and its Jacobian need. */
struct point {
    struct dse_cstr_kinetics kinetics[DSE_CSTR_NETWORK_MAX];
    dse_real C[DSE_CSTR_NETWORK_MAX];    /* decoded concentrations */
    dse_real Cdot[DSE_CSTR_NETWORK_MAX]; /* their derivatives */
};

/* aT_i + sum_j a_ij T_j, the part of T_i' that mixing and heating make. */
static dse_real mixing_heat(const struct dse_cstr_network *network, int reactors, const dse_real *u,
                            const dse_real *z, int i)
{
    dse_real sum = dse_cstr_aT(network, u, i);
    for (int j = 0; j < reactors; j++) {
        sum += dse_cstr_a(network, u, i, j) * z[2 * j];
    }
    return sum;
}

static enum dse_status encode(const struct dse_normal_form *form, dse_real t, const dse_real *chi,
                              const dse_real *u, dse_real *z)
{
    const struct dse_cstr_network *network = form->parameters;
    (void)t;
    if (dse_cstr_inputs(form->nu, &u) != DSE_OK) {
        return DSE_EINVAL;
    }
    for (int i = 0; i < form->p; i++) {
        dse_real Rh, r;
        if (dse_cstr_rates(network, chi[2 * i], &Rh, &r) != DSE_OK) {
            return DSE_EMODEL;
        }
        z[2 * i] = chi[2 * i];
        z[2 * i + 1] = mixing_heat(network, form->p, u, chi, i) + Rh * chi[2 * i + 1];
    }
    return DSE_OK;
}

static enum dse_status decode(const struct dse_normal_form *form, dse_real t, const dse_real *z,
                              const dse_real *u, dse_real *chi)
{
    const struct dse_cstr_network *network = form->parameters;
    (void)t;
    if (dse_cstr_inputs(form->nu, &u) != DSE_OK) {
        return DSE_EINVAL;
    }
    for (int i = 0; i < form->p; i++) {
        dse_real Rh, r;
        if (dse_cstr_rates(network, z[2 * i], &Rh, &r) != DSE_OK || !(Rh > 0)) {
            return DSE_EMODEL;
        }
        chi[2 * i] = z[2 * i];
        chi[2 * i + 1] = (z[2 * i + 1] - mixing_heat(network, form->p, u, z, i)) / Rh;
    }
    return DSE_OK;
}

static enum dse_status decode_point(const struct dse_normal_form *form, const dse_real *z,
                                    const dse_real *u, struct point *point)
{
    const struct dse_cstr_network *network = form->parameters;
    for (int i = 0; i < form->p; i++) {
        struct dse_cstr_kinetics *kinetics = &point->kinetics[i];
        if (dse_cstr_kinetics(network, z[2 * i], kinetics) != DSE_OK || !(kinetics->Rh > 0)) {
            return DSE_EMODEL;
        }
        point->C[i] = (z[2 * i + 1] - mixing_heat(network, form->p, u, z, i)) / kinetics->Rh;
    }
    for (int i = 0; i < form->p; i++) {
        /* Cdot_i = aC_i + sum_j a_ij C_j - r_i C_i */
        dse_real sum = dse_cstr_aC(network, u, i);
        for (int j = 0; j < form->p; j++) {
            sum += dse_cstr_a(network, u, i, j) * point->C[j];
        }
        point->Cdot[i] = sum - point->kinetics[i].r * point->C[i];
    }
    return DSE_OK;
}

/* Part of b_i2 that a varying feed makes: (daT_i/dF + sum_j (da_ij/dF) T_j) F'. */
static dse_real feed_rate_term(const struct dse_cstr_network *network, int reactors,
                               const dse_real *u, const dse_real *z, int i)
{
    if (u == NULL) { /* no variable feed */
        return 0;
    }
    dse_real sum = network->per_feed.aT[i];
    for (int j = 0; j < reactors; j++) {
        sum += network->per_feed.a[i][j] * z[2 * j];
    }
    return sum * u[DSE_CSTR_FEED_RATE];
}

static enum dse_status field(const struct dse_normal_form *form, dse_real t, const dse_real *z,
                             const dse_real *u, dse_real *dz)
{
    const struct dse_cstr_network *network = form->parameters;
    struct point point;
    (void)t;
    if (dse_cstr_inputs(form->nu, &u) != DSE_OK) {
        return DSE_EINVAL;
    }
    if (decode_point(form, z, u, &point) != DSE_OK) {
        return DSE_EMODEL;
    }
    for (int i = 0; i < form->p; i++) {
        const struct dse_cstr_kinetics *kinetics = &point.kinetics[i];
        /* b_i2 = sum_j a_ij Tdot_j + R_h' C_i Tdot_i + R_h Cdot_i */
        dse_real sum = 0;
        for (int j = 0; j < form->p; j++) {
            sum += dse_cstr_a(network, u, i, j) * z[2 * j + 1];
        }
        dz[2 * i] = z[2 * i + 1];
        dz[2 * i + 1] = sum + kinetics->dRh * point.C[i] * z[2 * i + 1] +
                        kinetics->Rh * point.Cdot[i] + feed_rate_term(network, form->p, u, z, i);
    }
    return DSE_OK;
}

/* F_i = [0 1; g1 g2] with all z_j, j /= i, frozen: a change of T_i then changes the decoded C_j of
 * every reactor that i feeds, dC_j/dz_i1 = -a_ji / R_h(T_j). */
static enum dse_status jacobian(const struct dse_normal_form *form, int i, dse_real t,
                                const dse_real *z, const dse_real *u, dse_real *F)
{
    const struct dse_cstr_network *network = form->parameters;
    struct point point;
    (void)t;
    if (i < 0 || i >= form->p || dse_cstr_inputs(form->nu, &u) != DSE_OK) {
        return DSE_EINVAL;
    }
    if (decode_point(form, z, u, &point) != DSE_OK) {
        return DSE_EMODEL;
    }
    const struct dse_cstr_kinetics *own = &point.kinetics[i];
    const dse_real a_ii = dse_cstr_a(network, u, i, i);
    const dse_real C = point.C[i];
    const dse_real Tdot = z[2 * i + 1];
    /* dC_i/dz_i1 = -(a_ii + R_h' C_i)/R_h */
    const dse_real dC = -(a_ii + own->dRh * C) / own->Rh;
    /* dCdot_i/dz_i1 = (a_ii - r) dC_i/dz_i1 - r' C_i - sum_{j /= i} a_ij a_ji / R_h(T_j) */
    dse_real dCdot = (a_ii - own->r) * dC - own->dr * C;
    for (int j = 0; j < form->p; j++) {
        if (j != i) {
            dCdot -=
                dse_cstr_a(network, u, i, j) * dse_cstr_a(network, u, j, i) / point.kinetics[j].Rh;
        }
    }
    const dse_real da_ii = u == NULL ? 0 : network->per_feed.a[i][i] * u[DSE_CSTR_FEED_RATE];
    F[0] = 0;
    F[1] = 1;
    /* g1 = R_h'' C Tdot + R_h' Tdot dC/dz_1 + R_h' Cdot + R_h dCdot/dz_1 + da_ii/dt */
    F[2] = own->ddRh * C * Tdot + own->dRh * Tdot * dC + own->dRh * point.Cdot[i] +
           own->Rh * dCdot + da_ii;
    /* g2 = a_ii + R_h' Tdot/R_h + R_h' C + R_h dCdot/dz_2, where dCdot/dz_2 = (a_ii - r)/R_h */
    F[3] = a_ii + own->dRh * Tdot / own->Rh + own->dRh * C + (a_ii - own->r);
    return DSE_OK;
}

static enum dse_status map_jacobian(const struct dse_normal_form *form, int i, dse_real t,
                                    const dse_real *chi, const dse_real *u, dse_real *M)
{
    const struct dse_cstr_network *network = form->parameters;
    struct dse_cstr_kinetics kinetics;
    (void)t;
    if (i < 0 || i >= form->p || dse_cstr_inputs(form->nu, &u) != DSE_OK) {
        return DSE_EINVAL;
    }
    if (dse_cstr_kinetics(network, chi[2 * i], &kinetics) != DSE_OK) {
        return DSE_EMODEL;
    }
    /* d(T_i, T_i')/d(T_i, C_i) = [1 0; a_ii + R_h' C_i, R_h] */
    M[0] = 1;
    M[1] = 0;
    M[2] = dse_cstr_a(network, u, i, i) + kinetics.dRh * chi[2 * i + 1];
    M[3] = kinetics.Rh;
    return DSE_OK;
}

/* dT_i = dT_i, dTdot_i = sum_j a_ij dT_j + R_h' C_i dT_i + R_h dC_i */
static enum dse_status push(const struct dse_normal_form *form, dse_real t, const dse_real *chi,
                            const dse_real *u, const dse_real *dchi, dse_real *dz)
{
    const struct dse_cstr_network *network = form->parameters;
    (void)t;
    if (dse_cstr_inputs(form->nu, &u) != DSE_OK) {
        return DSE_EINVAL;
    }
    for (int i = 0; i < form->p; i++) {
        struct dse_cstr_kinetics kinetics;
        if (dse_cstr_kinetics(network, chi[2 * i], &kinetics) != DSE_OK) {
            return DSE_EMODEL;
        }
        dse_real sum = kinetics.dRh * chi[2 * i + 1] * dchi[2 * i] + kinetics.Rh * dchi[2 * i + 1];
        for (int j = 0; j < form->p; j++) {
            sum += dse_cstr_a(network, u, i, j) * dchi[2 * j];
        }
        dz[2 * i] = dchi[2 * i];
        dz[2 * i + 1] = sum;
    }
    return DSE_OK;
}

/* dC_m/dz_l1 = -(a_ml + [m = l] R_h' C_m)/R_h(T_m) */
static dse_real concentration_slope(const struct dse_cstr_network *network, const dse_real *u,
                                    const struct point *point, int m, int l)
{
    const struct dse_cstr_kinetics *kinetics = &point->kinetics[m];
    const dse_real own = m == l ? kinetics->dRh * point->C[m] : 0;
    return -(dse_cstr_a(network, u, m, l) + own) / kinetics->Rh;
}

/* Derivatives of b_i2 with respect to z_l1 and z_l2. */
static void last_row(const struct dse_normal_form *form, const dse_real *u, const dse_real *z,
                     const struct point *point, int i, int l, dse_real *db)
{
    const struct dse_cstr_network *network = form->parameters;
    const struct dse_cstr_kinetics *kinetics = &point->kinetics[i];
    const dse_real own = i == l ? 1 : 0;
    const dse_real a_il = dse_cstr_a(network, u, i, l);
    const dse_real dC = concentration_slope(network, u, point, i, l);
    /* dCdot_i/dz_l1 = sum_j a_ij dC_j/dz_l1 - r_i dC_i/dz_l1 - [i = l] r_i' C_i */
    dse_real dCdot = -kinetics->r * dC - own * kinetics->dr * point->C[i];
    for (int j = 0; j < form->p; j++) {
        dCdot += dse_cstr_a(network, u, i, j) * concentration_slope(network, u, point, j, l);
    }
    const dse_real rate =
        u == NULL ? 0 : network->per_feed.a[i][l] * u[DSE_CSTR_FEED_RATE]; /* da_il/dt */
    db[0] = own * (kinetics->ddRh * point->C[i] * z[2 * i + 1] + kinetics->dRh * point->Cdot[i]) +
            kinetics->dRh * z[2 * i + 1] * dC + kinetics->Rh * dCdot + rate;
    /* dC_l/dz_l2 = 1/R_h(T_l) */
    db[1] = a_il + kinetics->Rh * (a_il - own * kinetics->r) / point->kinetics[l].Rh +
            own * kinetics->dRh * (point->C[i] + z[2 * i + 1] / kinetics->Rh);
}

static enum dse_status field_jacobian(const struct dse_normal_form *form, dse_real t,
                                      const dse_real *z, const dse_real *u, dse_real *F)
{
    struct point point;
    (void)t;
    if (dse_cstr_inputs(form->nu, &u) != DSE_OK) {
        return DSE_EINVAL;
    }
    if (decode_point(form, z, u, &point) != DSE_OK) {
        return DSE_EMODEL;
    }
    for (int i = 0; i < form->p; i++) {
        dse_real *shift = F + 2 * i * form->n;
        for (int l = 0; l < form->p; l++) {
            shift[2 * l] = 0;
            shift[2 * l + 1] = l == i ? 1 : 0;
            last_row(form, u, z, &point, i, l, shift + form->n + 2 * l);
        }
    }
    return DSE_OK;
}

static const int block_sizes[DSE_CSTR_NETWORK_MAX] = {2, 2, 2, 2};
/* input 1 is the derivative of input 0 */
static const int feed_rates[DSE_CSTR_INPUTS] = {DSE_CSTR_FEED_RATE, -1};

void dse_cstr_network_normal_form(const dse_real *prepared, int reactors, int nu,
                                  struct dse_normal_form *form)
{
    *form = (struct dse_normal_form){.n = 2 * reactors,
                                     .p = reactors,
                                     .n_i = block_sizes,
                                     .nu = nu,
                                     .rates = nu == DSE_CSTR_INPUTS ? feed_rates : NULL,
                                     .parameters = prepared,
                                     .encode = encode,
                                     .decode = decode,
                                     .field = field,
                                     .jacobian = jacobian,
                                     .map_jacobian = map_jacobian,
                                     .push = push,
                                     .field_jacobian = field_jacobian};
}
