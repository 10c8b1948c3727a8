/* A plant in the coordinates of a high-gain observer, subsystem by subsystem (section 2.2,
 * eq 2.1-2.5 of the adaptive high-gain source).
 *
 *     z_i = Phi_i(chi) = [h_i, L_f h_i, ..., L_f^{n_i-1} h_i]
 *     z_i' = A_i z_i + b_i(z, u),    y_i = C_i z_i
 *
 * A block with several outputs has one such chain for each, one behind the other: A_i is block
 * diagonal and C_i picks the first entry of every chain (eq 3.6).
 *
 * chi is the physical state, z the stacked coordinates (same total dimension n), L_f the Lie
 * derivative along the whole vector field. A_i is the upper shift matrix, C_i the first unit row.
 *
 * A known input that enters Phi makes the map move with it. Inputs are held over a sample and the
 * filter re-encodes where they jump; or a plant declares a second input as the time derivative of
 * the first (`rates`), takes z_i2 as the full derivative and puts the part of the rate into the
 * last row of b_i (section 4.1), and the filter follows the input between the samples. */
#ifndef DSE_NORMAL_FORM_H
#define DSE_NORMAL_FORM_H

#include <stdbool.h>

#include "dse/real.h"
#include "dse/status.h"

struct dse_normal_form {
    int n;          /* states of the whole plant, sum of n_i */
    int p;          /* subsystems */
    const int *n_i; /* p block dimensions, subsystem-major stacking in z and chi */
    /* p: outputs of each block, which are the model's outputs in this order. NULL: one each. */
    const int *n_outputs;
    /* Lengths of all chains, block by block; those of block i sum to n_i. NULL: one chain each. */
    const int *chains;
    int nu; /* known inputs, as in the plant's model; u may be NULL when 0 */
    /* nu entries: rates[j] is the index of the input that is the time derivative of input j, or -1
     * for one that is held. NULL: all are held. */
    const int *rates;
    /* True: Phi does not depend on u, and coordinates stay what they are when an input jumps.
     * False: they are computed anew from the physical state. */
    bool map_without_inputs;
    const void *parameters;

    /* z (n) = Phi(chi). */
    enum dse_status (*encode)(const struct dse_normal_form *form, dse_real t, const dse_real *chi,
                              const dse_real *u, dse_real *z);
    /* chi (n) = Phi^-1(z). DSE_EMODEL where the map is not invertible. */
    enum dse_status (*decode)(const struct dse_normal_form *form, dse_real t, const dse_real *z,
                              const dse_real *u, dse_real *chi);
    /* dz (n) = A z + b(z, u), the whole vector field. */
    enum dse_status (*field)(const struct dse_normal_form *form, dse_real t, const dse_real *z,
                             const dse_real *u, dse_real *dz);
    /* F (n_i x n_i) = A_i + b_i*: derivative of block i of the field with respect to z_i, all other
     * z_j frozen. */
    enum dse_status (*jacobian)(const struct dse_normal_form *form, int i, dse_real t,
                                const dse_real *z, const dse_real *u, dse_real *F);
    /* M (n_i x n_i) = dPhi_i / dchi_i at chi, own block only. */
    enum dse_status (*map_jacobian)(const struct dse_normal_form *form, int i, dse_real t,
                                    const dse_real *chi, const dse_real *u, dse_real *M);

    /* Optional, NULL where the plant does not offer it. */

    /* dz (n) = (dPhi/dchi) dchi at chi: what a change of the physical state does to the
     * coordinates. Needed by a predictor with a model of its own in normal coordinates. */
    enum dse_status (*push)(const struct dse_normal_form *form, dse_real t, const dse_real *chi,
                            const dse_real *u, const dse_real *dchi, dse_real *dz);
    /* F (n x n) = d(A z + b(z, u))/dz. Needed by a centralised filter. */
    enum dse_status (*field_jacobian)(const struct dse_normal_form *form, dse_real t,
                                      const dse_real *z, const dse_real *u, dse_real *F);
};

#endif
