/* Normal form of the three tanks, in closed form (6.6 - 6.8 of the adaptive high-gain source):
 *
 *     z_1 = x_1,  z_2 = -(p_1 sqrt x_2 + d_1 sqrt x_1) | z_3 = x_3 | z_4 = x_5,  z_5 likewise
 *
 * z_2 is L_f h without the input, which enters z_1' = z_2 + b_1 u_1 as a known term. Levels under
 * square roots are held in [0.01, 100] cm and sqrt x_2, sqrt x_4 in [0.1, 10]; z itself is free.
 * Tanks 1 and 3 are the same block with other constants: `side` 0 and 1. */
#include "three_tank_internal.h"

#include <stddef.h>

#include "dse/math.h"

struct side {
    int z;         /* where the block begins: z[z], z[z + 1] */
    dse_real p, d; /* its constants */
    dse_real bu;   /* b u */
};

static struct side side_of(const struct dse_tanks *tanks, int side, const dse_real *u)
{
    return (struct side){.z = side == 0 ? X1 : X5,
                         .p = tanks->p[side],
                         .d = tanks->d[side == 0 ? 0 : 2],
                         .bu = u != NULL ? tanks->b[side] * u[side] : 0};
}

static dse_real hold(dse_real value, dse_real lowest, dse_real highest)
{
    return value < lowest ? lowest : value > highest ? highest : value;
}

static dse_real level_root(dse_real level)
{
    return dse_sqrt(hold(level, DSE_TANKS_LOWEST, DSE_TANKS_HIGHEST));
}

/* s = (-z_2 - d sqrt z_1)/p, the square root of the interaction. */
static dse_real interaction_root(const struct side *side, const dse_real *z)
{
    const dse_real s = (-z[side->z + 1] - side->d * level_root(z[side->z])) / side->p;
    return hold(s, DSE_REAL(0.1), DSE_REAL(10));
}

static enum dse_status encode(const struct dse_normal_form *form, dse_real t, const dse_real *chi,
                              const dse_real *u, dse_real *z)
{
    (void)t;
    (void)u;
    if (!dse_all_finite(chi, STATES)) {
        return DSE_EMODEL;
    }
    z[X3] = chi[X3];
    for (int k = 0; k < 2; k++) {
        const struct side side = side_of(form->parameters, k, NULL);
        const dse_real *own = chi + side.z;
        z[side.z] = own[0];
        z[side.z + 1] = -(side.p * level_root(own[1]) + side.d * level_root(own[0]));
    }
    return DSE_OK;
}

static enum dse_status decode(const struct dse_normal_form *form, dse_real t, const dse_real *z,
                              const dse_real *u, dse_real *chi)
{
    (void)t;
    (void)u;
    if (!dse_all_finite(z, STATES)) {
        return DSE_EMODEL;
    }
    chi[X3] = hold(z[X3], DSE_TANKS_LOWEST, DSE_TANKS_HIGHEST);
    for (int k = 0; k < 2; k++) {
        const struct side side = side_of(form->parameters, k, NULL);
        const dse_real s = interaction_root(&side, z);
        chi[side.z] = hold(z[side.z], DSE_TANKS_LOWEST, DSE_TANKS_HIGHEST);
        chi[side.z + 1] = s * s;
    }
    return DSE_OK;
}

/* w = z_3' = p_1 s_1 + p_2 s_2 - d_2 sqrt z_3 */
static dse_real middle_rate(const struct dse_tanks *tanks, const dse_real *z)
{
    const struct side first = side_of(tanks, 0, NULL), last = side_of(tanks, 1, NULL);
    return first.p * interaction_root(&first, z) + last.p * interaction_root(&last, z) -
           tanks->d[1] * level_root(z[X3]);
}

static enum dse_status field(const struct dse_normal_form *form, dse_real t, const dse_real *z,
                             const dse_real *u, dse_real *dz)
{
    (void)t;
    if (u == NULL) {
        return DSE_EINVAL;
    }
    if (!dse_all_finite(z, STATES)) {
        return DSE_EMODEL;
    }
    const dse_real w = middle_rate(form->parameters, z);
    dz[X3] = w;
    for (int k = 0; k < 2; k++) {
        const struct side side = side_of(form->parameters, k, u);
        const dse_real s = interaction_root(&side, z);
        const dse_real rate = z[side.z + 1] + side.bu; /* z_1' = z_2 + b u */
        /* z_2' = -(p (z_1' - w)/(2 s) + d z_1'/(2 sqrt z_1))   (6.8 with the factor d) */
        dz[side.z] = rate;
        dz[side.z + 1] =
            -(side.p * (rate - w) / (2 * s) + side.d * rate / (2 * level_root(z[side.z])));
    }
    return DSE_OK;
}

/* What the derivatives of an outer tank's equations are made of, at the held values. */
struct slopes {
    dse_real s1, s2; /* ds/dz_1 = -d/(2 p sqrt z_1), ds/dz_2 = -1/p */
    dse_real g1, g2; /* d(z_2')/d(z_1, z_2), the other blocks frozen */
    dse_real w;      /* d(z_2')/dw = p/(2 s) */
};

static struct slopes slopes_of(const struct dse_tanks *tanks, const struct side *side,
                               const dse_real *z)
{
    const dse_real s = interaction_root(side, z);
    const dse_real root = level_root(z[side->z]);
    const dse_real rate = z[side->z + 1] + side->bu;
    const dse_real excess = side->p * (rate - middle_rate(tanks, z)) / (2 * s * s);
    const dse_real s1 = -side->d / (2 * root * side->p);
    const dse_real s2 = -1 / side->p;
    return (struct slopes){
        .s1 = s1,
        .s2 = s2,
        /* g1 = p^2 s1/(2 s) + p (z_1' - w) s1/(2 s^2) + d z_1'/(4 z_1^1.5) */
        .g1 = side->p * side->p * s1 / (2 * s) + excess * s1 +
              side->d * rate / (4 * root * root * root),
        /* g2 = -(p/s - p (z_1' - w) s2/(2 s^2) + d/(2 sqrt z_1)) */
        .g2 = -(side->p / s - excess * s2 + side->d / (2 * root)),
        .w = side->p / (2 * s),
    };
}

static enum dse_status jacobian(const struct dse_normal_form *form, int i, dse_real t,
                                const dse_real *z, const dse_real *u, dse_real *F)
{
    const struct dse_tanks *tanks = form->parameters;
    (void)t;
    if (i < 0 || i >= form->p || u == NULL) {
        return DSE_EINVAL;
    }
    if (!dse_all_finite(z, STATES)) {
        return DSE_EMODEL;
    }
    if (i == 1) {
        F[0] = -tanks->d[1] / (2 * level_root(z[X3]));
        return DSE_OK;
    }
    const struct side side = side_of(tanks, i / 2, u);
    const struct slopes slopes = slopes_of(tanks, &side, z);
    F[0] = 0;
    F[1] = 1;
    F[2] = slopes.g1;
    F[3] = slopes.g2;
    return DSE_OK;
}

static enum dse_status field_jacobian(const struct dse_normal_form *form, dse_real t,
                                      const dse_real *z, const dse_real *u, dse_real *F)
{
    const struct dse_tanks *tanks = form->parameters;
    (void)t;
    if (u == NULL) {
        return DSE_EINVAL;
    }
    if (!dse_all_finite(z, STATES)) {
        return DSE_EMODEL;
    }
    for (int k = 0; k < STATES * STATES; k++) {
        F[k] = 0;
    }
    /* w = p_1 s_1 + p_2 s_2 - d_2 sqrt z_3 */
    dse_real *dw = F + X3 * STATES;
    const struct side sides[2] = {side_of(tanks, 0, u), side_of(tanks, 1, u)};
    struct slopes slopes[2];
    dw[X3] = -tanks->d[1] / (2 * level_root(z[X3]));
    for (int k = 0; k < 2; k++) {
        slopes[k] = slopes_of(tanks, &sides[k], z);
        dw[sides[k].z] = sides[k].p * slopes[k].s1;
        dw[sides[k].z + 1] = sides[k].p * slopes[k].s2;
    }
    for (int k = 0; k < 2; k++) {
        dse_real *first = F + sides[k].z * STATES, *second = first + STATES;
        first[sides[k].z + 1] = 1;
        for (int c = 0; c < STATES; c++) {
            second[c] = slopes[k].w * dw[c]; /* through the other blocks */
        }
        second[sides[k].z] = slopes[k].g1;
        second[sides[k].z + 1] = slopes[k].g2;
    }
    return DSE_OK;
}

static enum dse_status map_jacobian(const struct dse_normal_form *form, int i, dse_real t,
                                    const dse_real *chi, const dse_real *u, dse_real *M)
{
    (void)t;
    (void)u;
    if (i < 0 || i >= form->p) {
        return DSE_EINVAL;
    }
    if (!dse_all_finite(chi, STATES)) {
        return DSE_EMODEL;
    }
    M[0] = 1;
    if (i != 1) {
        /* d(z_1, z_2)/d(x_1, x_2) = [1 0; -d/(2 sqrt x_1), -p/(2 sqrt x_2)] */
        const struct side side = side_of(form->parameters, i / 2, NULL);
        M[1] = 0;
        M[2] = -side.d / (2 * level_root(chi[side.z]));
        M[3] = -side.p / (2 * level_root(chi[side.z + 1]));
    }
    return DSE_OK;
}

static enum dse_status push(const struct dse_normal_form *form, dse_real t, const dse_real *chi,
                            const dse_real *u, const dse_real *dchi, dse_real *dz)
{
    dse_real M[4];
    dz[X3] = dchi[X3];
    /* a block's coordinates depend on its own states only */
    for (int k = 0; k < 2; k++) {
        const int first = k == 0 ? X1 : X5;
        const enum dse_status status = map_jacobian(form, 2 * k, t, chi, u, M);
        if (status != DSE_OK) {
            return status;
        }
        dz[first] = dchi[first];
        dz[first + 1] = M[2] * dchi[first] + M[3] * dchi[first + 1];
    }
    return DSE_OK;
}

static const int block_sizes[] = {2, 1, 2};

void dse_three_tank_normal_form(const dse_real *prepared, struct dse_normal_form *form)
{
    const struct dse_tanks *tanks = (const struct dse_tanks *)prepared;
    *form = (struct dse_normal_form){.n = STATES,
                                     .p = OUTPUTS,
                                     .n_i = block_sizes,
                                     .nu = INPUTS,
                                     .map_without_inputs = true,
                                     .parameters = prepared};
    if (!(tanks->p[0] > 0 && tanks->p[1] > 0) || tanks->is_open > 0) {
        return;
    }
    form->encode = encode;
    form->decode = decode;
    form->field = field;
    form->jacobian = jacobian;
    form->map_jacobian = map_jacobian;
    form->push = push;
    form->field_jacobian = field_jacobian;
}
