/* What the parts of the consensus Kalman filter share. */
#ifndef DSE_CONSENSUS_KALMAN_INTERNAL_H
#define DSE_CONSENSUS_KALMAN_INTERNAL_H

#include <stddef.h>

#include "dse/consensus_kalman.h"

/* Type I: the average of the network's information. */
static inline bool ckf_averages(enum dse_ckf_scheme scheme)
{
    return scheme == DSE_CKF_A || scheme == DSE_CKF_A_LOW_PASS || scheme == DSE_CKF_A_LITERAL;
}

/* .. with the weights of all nodes along with it. */
static inline bool ckf_weighs(const struct dse_ckf_config *config)
{
    return config->scheme == DSE_CKF_A && config->counting == DSE_CKF_ONCE;
}

/* .. with low- and band-pass filters. */
static inline bool ckf_low_pass(enum dse_ckf_scheme scheme)
{
    return scheme == DSE_CKF_A_LOW_PASS || scheme == DSE_CKF_A_LITERAL;
}

/* Kalman-consensus filter. */
static inline bool ckf_one_step(enum dse_ckf_scheme scheme)
{
    return scheme == DSE_CKF_C || scheme == DSE_CKF_C_LITERAL;
}

static inline void ckf_copy(int n, const dse_real *from, dse_real *to)
{
    for (int i = 0; i < n; i++)
        to[i] = from[i];
}

/* What the neighbours said in this round. */
static inline struct dse_consensus_words ckf_words(const struct dse_ckf *ckf)
{
    return (struct dse_consensus_words){
        .count = ckf->n_neighbours, .stride = ckf->width, .said = ckf->said, .heard = ckf->heard};
}

/* Consensus filters of type I: from zero; one round; u and Y in `fused` from what all rounds of the
 * sample, of any scheme, have brought. */
void ckf_restart(struct dse_ckf *ckf);
void ckf_filter_round(struct dse_ckf *ckf);
void ckf_fuse(struct dse_ckf *ckf);

/* x, P: estimate and covariance by the fused information, or by own information where that is not
 * usable. */
enum dse_status ckf_correct(struct dse_ckf *ckf);

#endif
