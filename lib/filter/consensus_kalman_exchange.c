/* Consensus Kalman filter: messages, and what is made of them. */
#include "consensus_kalman_internal.h"
#include "dse/math.h"

int dse_ckf_message_size(const struct dse_ckf *ckf, int r)
{
    const enum dse_ckf_scheme scheme = ckf->config->scheme;
    if (r < 0 || r >= ckf->rounds)
        return 0;
    if (ckf_low_pass(scheme))
        return 2 * ckf->size;
    if (scheme == DSE_CKF_B)
        return r == 0 ? ckf->size : ckf->nx;
    return ckf_one_step(scheme) ? ckf->size + ckf->nx : ckf->carried;
}

/* [c; u; g of Y; b]. */
static void say_low_pass(const struct dse_ckf *ckf, dse_real *message)
{
    const int n = ckf->nx, packed = ckf->size - n;
    ckf_copy(n, ckf->v, message);
    ckf_copy(n, ckf->own, message + n);
    for (int k = 0; k < packed; k++) {
        message[2 * n + k] = ckf->v[n + k] + ckf->own[n + k];
        message[2 * n + packed + k] = ckf->b[k];
    }
}

int dse_ckf_message(const struct dse_ckf *ckf, dse_real *message)
{
    const enum dse_ckf_scheme scheme = ckf->config->scheme;
    if (!ckf->open)
        return 0;
    if (ckf_low_pass(scheme)) {
        say_low_pass(ckf, message);
    } else if (scheme == DSE_CKF_A) { /* g = v + (u_i, Y_i) */
        for (int k = 0; k < ckf->carried; k++)
            message[k] = ckf->v[k] + ckf->own[k];
    } else if (scheme == DSE_CKF_B && ckf->round == 1) { /* psi_i */
        ckf_copy(ckf->nx, ckf->x, message);
    } else { /* u_i, Y_i; C: and w_i */
        ckf_copy(ckf->size, ckf->own, message);
        if (ckf_one_step(scheme))
            ckf_copy(ckf->nx, ckf->x, message + ckf->size);
    }
    return dse_ckf_message_size(ckf, ckf->round);
}

enum dse_status dse_ckf_receive(struct dse_ckf *ckf, int neighbour, const dse_real *message,
                                int count)
{
    if (!ckf->open || neighbour < 0 || neighbour >= ckf->n_neighbours)
        return DSE_EINVAL;
    const bool fits = count == dse_ckf_message_size(ckf, ckf->round);
    if (!fits || !dse_all_finite(message, count)) {
        ckf->counts.refused++;
        ckf->refused = true;
        return fits ? DSE_ENONFINITE : DSE_EDIM;
    }
    ckf_copy(count, message, ckf->said + neighbour * ckf->width);
    ckf->heard[neighbour] = 1;
    ckf->any_heard = true;
    ckf->counts.heard++;
    return DSE_OK;
}

/* ---- type I ---- */

void ckf_restart(struct dse_ckf *ckf)
{
    const enum dse_ckf_scheme scheme = ckf->config->scheme;
    for (int k = 0; ckf_averages(scheme) && k < ckf->carried; k++)
        ckf->v[k] = 0;
    for (int k = 0; ckf_low_pass(scheme) && k < ckf->size - ckf->nx; k++)
        ckf->b[k] = 0;
}

/* An overflow makes the filters start from zero. */
void ckf_filter_round(struct dse_ckf *ckf)
{
    const int n = ckf->nx, packed = ckf->size - n;
    const struct dse_consensus_words words = ckf_words(ckf);
    bool finite = true;
    if (ckf_low_pass(ckf->config->scheme)) {
        dse_consensus_low_pass(&words, 0, n, n, ckf->epsilon, ckf->own, ckf->v);
        dse_consensus_band_pass(&words, 2 * n, 2 * n + packed, packed, ckf->epsilon, ckf->alpha,
                                ckf->own + n, ckf->v + n, ckf->b);
        finite = dse_all_finite(ckf->b, packed);
    } else {
        dse_consensus_high_pass(&words, 0, ckf->carried, ckf->epsilon, ckf->own, ckf->v);
    }
    if (!finite || !dse_all_finite(ckf->v, ckf->carried)) {
        ckf_restart(ckf);
        ckf->refused = true;
    }
}

/* ---- u and Y ---- */

/* u = nodes c, Y = nodes b; literal: each with its own value on top. */
static void fuse_low_pass(struct dse_ckf *ckf)
{
    const dse_real again = ckf->config->scheme == DSE_CKF_A_LITERAL;
    for (int k = 0; k < ckf->size; k++) {
        const dse_real average = k < ckf->nx ? ckf->v[k] : ckf->b[k - ckf->nx];
        ckf->fused[k] = ckf->multiplicity * (average + again * ckf->own[k]);
    }
}

/* 1 / max_j w_ij, where w_i = v + e_i has been averaged like the information itself; no node has
 * data: 0. */
static dse_real weighed(const struct dse_ckf *ckf)
{
    dse_real largest = 0;
    for (int k = ckf->size; k < ckf->carried; k++)
        largest = dse_max(largest, ckf->v[k] + ckf->own[k]);
    return largest > 0 ? 1 / largest : 0;
}

void ckf_fuse(struct dse_ckf *ckf)
{
    const enum dse_ckf_scheme scheme = ckf->config->scheme;
    const struct dse_consensus_words words = ckf_words(ckf);
    if (ckf_low_pass(scheme)) {
        fuse_low_pass(ckf);
    } else if (scheme == DSE_CKF_A) {
        if (ckf->carried > ckf->size)
            ckf->multiplicity = weighed(ckf);
        for (int k = 0; k < ckf->size; k++)
            ckf->fused[k] = ckf->multiplicity * (ckf->v[k] + ckf->own[k]);
    } else if (scheme == DSE_CKF_ALONE) {
        ckf_copy(ckf->size, ckf->own, ckf->fused);
    } else { /* sum_J */
        dse_consensus_sum(&words, 0, ckf->size, ckf->own, ckf->fused);
    }
}
