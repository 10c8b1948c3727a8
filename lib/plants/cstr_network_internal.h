/* Stirred-tank reactors in a network, all running the same three parallel exothermic reactions of
 * component A (section 5.1 of the adaptive high-gain spec). With T_i, C_i of reactor i:
 *
 *     T_i' = aT_i + sum_j a_ij T_j + R_h(T_i) C_i
 *     C_i' = aC_i + sum_j a_ij C_j - r(T_i) C_i
 *     R_h(T) = sum_l (-DeltaH_l / (rho c_p)) k_l exp(-E_l/(R T)),   r(T) = sum_l k_l exp(-E_l/(R
 * T))
 *
 * State order T_1, C_1, T_2, C_2 ...; outputs y_i = T_i; one reactor is one subsystem. A network
 * with a variable feed has two known inputs: the feed flow and its time derivative; the mixing
 * coefficients are affine in the flow.
 *
 * A plant of this kind is one file: it fills a dse_cstr_network from its parameter values in
 * `prepare` and names its signals. */
#ifndef DSE_CSTR_NETWORK_INTERNAL_H
#define DSE_CSTR_NETWORK_INTERNAL_H

#include "dse/model.h"
#include "dse/normal_form.h"
#include "dse/real.h"
#include "dse/status.h"

#define DSE_CSTR_NETWORK_MAX 4 /* reactors */
#define DSE_CSTR_REACTIONS   3

/* The linear part: flows divided by volumes. */
struct dse_cstr_mixing {
    dse_real aT[DSE_CSTR_NETWORK_MAX];                      /* K/h */
    dse_real aC[DSE_CSTR_NETWORK_MAX];                      /* kmol/m3/h */
    dse_real a[DSE_CSTR_NETWORK_MAX][DSE_CSTR_NETWORK_MAX]; /* 1/h */
};

/* What `prepare` makes. All members are dse_real because it lives in the plant's prepared reals.
 * Reactions with the same activation energy share one exponential. */
struct dse_cstr_network {
    struct dse_cstr_mixing constant; /* what does not depend on the variable feed */
    struct dse_cstr_mixing per_feed; /* coefficient of the variable feed, per m3/h */
    dse_real exponentials;           /* how many different activation energies */
    dse_real s[DSE_CSTR_REACTIONS];  /* E/R, K */
    dse_real k[DSE_CSTR_REACTIONS];  /* 1/h */
    dse_real q[DSE_CSTR_REACTIONS];  /* (-DeltaH/(rho c_p)) k, K/h per kmol/m3 */
};

#define DSE_CSTR_NETWORK_SIZE ((int)(sizeof(struct dse_cstr_network) / sizeof(dse_real)))

/* Inputs of a network with a variable feed. */
enum { DSE_CSTR_FEED = 0, DSE_CSTR_FEED_RATE = 1, DSE_CSTR_INPUTS = 2 };

/* An empty network in `prepared` (DSE_CSTR_NETWORK_SIZE reals). */
struct dse_cstr_network *dse_cstr_network_clear(dse_real *prepared);

/* Stream F (m3/h) of temperature T and concentration C into reactor i of volume V. */
void dse_cstr_add_feed(struct dse_cstr_mixing *mixing, int i, dse_real V, dse_real F, dse_real T,
                       dse_real C);
/* Stream F from reactor `from` into reactor `to` of volume V_to. */
void dse_cstr_add_link(struct dse_cstr_mixing *mixing, int from, int to, dse_real V_to, dse_real F);
/* Heat input Q (kJ/h) into reactor i; rho_cp in kJ/(m3 K). */
void dse_cstr_add_heat(struct dse_cstr_mixing *mixing, int i, dse_real V, dse_real rho_cp,
                       dse_real Q);
/* Reaction with enthalpy dH (kJ/kmol), rate constant k0 (1/h), activation energy E (kJ/kmol). */
void dse_cstr_add_reaction(struct dse_cstr_network *network, dse_real rho_cp, dse_real gas,
                           dse_real dH, dse_real k0, dse_real E);

/* Model and normal form of `reactors` reactors; nu is 0 or DSE_CSTR_INPUTS. */
void dse_cstr_network_model(const dse_real *prepared, int reactors, int nu,
                            struct dse_model *model);
void dse_cstr_network_normal_form(const dse_real *prepared, int reactors, int nu,
                                  struct dse_normal_form *form);

/* ---- shared by the model and the normal form ---- */

/* Reaction heat and rate with derivatives in T. */
struct dse_cstr_kinetics {
    dse_real Rh, dRh, ddRh; /* K/h per kmol/m3, and per K, per K^2 */
    dse_real r, dr;         /* 1/h, and per K */
};

/* R_h and r only; DSE_EMODEL unless 0 < T < infinity. */
enum dse_status dse_cstr_rates(const struct dse_cstr_network *network, dse_real T, dse_real *Rh,
                               dse_real *r);
/* With the derivatives. */
enum dse_status dse_cstr_kinetics(const struct dse_cstr_network *network, dse_real T,
                                  struct dse_cstr_kinetics *kinetics);
/* The inputs as the functions below take them: NULL for a network without a variable feed,
 * whatever the caller passed. DSE_EINVAL when a variable feed has no value. */
enum dse_status dse_cstr_inputs(int nu, const dse_real **u);
/* Mixing coefficients at the feed flow in u: constant + u per_feed. */
dse_real dse_cstr_a(const struct dse_cstr_network *network, const dse_real *u, int i, int j);
dse_real dse_cstr_aT(const struct dse_cstr_network *network, const dse_real *u, int i);
dse_real dse_cstr_aC(const struct dse_cstr_network *network, const dse_real *u, int i);

#endif
