/* Distributed second-order filters for quadratic systems: node i of a sensor network. Every node
 * has a second-order filter (dse/second_order.h) of the whole state with its own sensors C_i, R_i,
 * and agrees with its neighbours at every sample, in one or several rounds:
 *
 *     dse_dso_begin(&f, t_k, u, &m);                         predicts to t_k, takes m_i
 *     for (r = 0; r < dse_dso_rounds(&f); r++) {
 *         count = dse_dso_message(&f, out);                  -> to every neighbour
 *         dse_dso_receive(&f, neighbour, in, count);         for every one that was heard
 *         dse_dso_end_round(&f);
 *     }                                                      dse_dso_state is now that of t_k
 *
 * Links are meant to be mutual; a neighbour that says nothing in a round is left out of its sums.
 *
 * With w_i, S_i the prediction, G_i the gain of S_i, C_i, R_i, and of information form
 *     u_i = C_i'R_i^-1 m_i,  Y_i = C_i'R_i^-1 C_i,  M_i = (I + S_i Y)^-1 S_i = Z'(I + Z Y Z')^-1 Z.
 * Equation numbers are those of the consensus-based second-order observers source, sections those
 * of its spec. */
#ifndef DSE_DISTRIBUTED_SECOND_ORDER_H
#define DSE_DISTRIBUTED_SECOND_ORDER_H

#include <stdbool.h>

#include "dse/arena.h"
#include "dse/health.h"
#include "dse/real.h"
#include "dse/second_order.h"
#include "dse/status.h"

/* J_i: the neighbours N_i and the node itself; sums are in the order of their places. */
enum dse_dso_scheme {
    /* B-I-inf, recommended. u = sum_J u_j, Y = sum_J Y_j; psi_i = w_i + M_i (u - Y w_i);
     * xh_i = psi_i + delta sum_N (psi_j - psi_i). Two rounds: (u_j, Y_j), psi_j. */
    DSE_DSO_B_INFORMATION = 0,
    /* C-I-inf, recommended where one round has to do. xh_i = w_i + M_i (u - Y w_i)
     * + delta S_i sum_N (w_j - w_i). One round: (u_j, Y_j, w_j). */
    DSE_DSO_C_INFORMATION = 1,
    /* A-I*: fusion of information over the whole network by high-pass consensus filters that
     * start from zero in every sample (PERSISTENT: are kept): in every round g = v + (u, Y),
     * v += eps sum_N (g_j - g_i); then u, Y = nodes (v + (u_i, Y_i)). `rounds` rounds: g_j. */
    DSE_DSO_A_INFORMATION = 2,
    /* B-I: psi_i = w_i + G_i (m_i - C_i w_i), then as B-I-inf. One round: psi_j.  (4.61), (4.62) */
    DSE_DSO_B = 3,
    /* C-I: xh_i = w_i + G_i (m_i - C_i w_i) + delta S_i sum_N (w_j - w_i). One round: w_j. No gain
     * for a node whose S_i is small already.                                     (4.63)-(4.65) */
    DSE_DSO_C = 4,
    /* A-II: fusion of covariances, by band-pass consensus filters of U_j = S_j; the gain is that of
     * the fused covariance, see enum dse_dso_memory. `rounds` rounds (1 but for AVERAGE): (g, b)_j.
     * Rough: the gain does not go to zero.                                       (4.59), (4.60) */
    DSE_DSO_A_COVARIANCE = 5,
    /* No network: the second-order filter alone. No round. */
    DSE_DSO_ALONE = 6,

    /* What the source's boxes print. For comparison only, see section 4.7: */

    /* A-I: a low-pass filter of the measurements, y = c_i + m_i, and A-II's of the covariances.
     * Biased: for identical sensors y tends to 2 C x. All ny are equal. One round. */
    DSE_DSO_A_LITERAL = 7,
    /* Steps 3 of B-I and C-I: m = sum_J m_j, S = sum_J S_j. A sum of measurements is compared with
     * one C_i w_i: wrong by a multiple. All ny are equal. Two rounds, one round. */
    DSE_DSO_B_LITERAL = 8,
    DSE_DSO_C_LITERAL = 9
};

/* What consensus filters have at the start of a sample. A-II, with the band-pass filter
 * g = v + U, v += eps sum_N (g_j - g_i), b += eps alpha (sum_N (b_j - b_i) + sum_J (g_j - b_i)),
 * and its fused covariance: as below. A-I*: v = 0 with AVERAGE and RESTART, so that `rounds` rounds
 * have to do, but a message that was lost in one direction only is forgotten; PERSISTENT keeps v,
 * of which such a loss leaves a part for ever. */
enum dse_dso_memory {
    DSE_DSO_AVERAGE = 0,   /* v = 0, b = U; b: a convex combination of the S_j */
    DSE_DSO_RESTART = 1,   /* v = b = 0; b + U, inflated by about 1 + eps alpha |J| */
    DSE_DSO_PERSISTENT = 2 /* as printed: that of the last sample; b + U. May grow without bound */
};

/* Zero is the default where one is named. */
struct dse_dso_config {
    struct dse_second_order_config filter; /* of this node; all nodes have the same nx */
    enum dse_dso_scheme scheme;
    int n_neighbours; /* >= 0: nodes that it hears; they are counted 0, 1, .. */

    /* B, C: weight of the neighbours' estimates, > 0; 0 means 0.1 (B), 0.25 (C). B: at most
     * 1 / (n_neighbours + 1) keeps the weights convex; large ones harm, for Sigma does not know of
     * the mixing. C: delta lambda_max(Laplacian) |S| has to stay below 2, see dse_dso_loop_gain. */
    dse_real delta;
    /* C: delta / (1 + |S_i|_F) in place of delta: no S is too large then. */
    bool normalised;

    /* A: consensus filters. */
    dse_real epsilon; /* step, > 0; 0 means 0.1. At most 1 / (largest degree), with the low-pass
                       * part of A-II and the literal A-I 1 / (1 + 2 degree) */
    dse_real alpha;   /* > 0; 0 means 1: speed of the low-pass part */
    enum dse_dso_memory memory; /* A-II, A-I*; the literal A-I is persistent */
    int rounds; /* >= 1, A-I* and A-II with AVERAGE; 0 means 1. Others have their number */
    int nodes;  /* of the network, >= 1: A-I* */
};

/* Totals since init. */
struct dse_dso_counts {
    long samples; /* successful */
    long failed;  /* samples whose prediction or correction failed */
    long heard;   /* messages taken */
    long silent;  /* neighbours that said nothing in a round */
    long refused; /* messages refused: not finite or of another length */
    /* Fused information or covariance that was not positive (section 4.7): its own was used. */
    long fallback;
};

struct dse_dso {
    const struct dse_dso_config *config;
    struct dse_second_order filter;
    int n_neighbours;
    int rounds, round; /* of a sample, and how many of them have ended */
    int width;         /* reals of the longest message */
    dse_real delta, epsilon, alpha;
    dse_real *said;  /* n_neighbours x width: messages of this round */
    dse_real *heard; /* n_neighbours: 1 for those that there are */
    dse_real *own;   /* width: this node's message of this round */
    dse_real *u;     /* nx, and Y (packed): own information */
    dse_real *Y;
    dse_real *v;      /* consensus filters: [c or v of u; v; b], packed */
    dse_real *before; /* nx: S_i sum_N (w_j - w_i) */
    dse_real *fused;  /* ny: fused measurements */
    dse_real *scratch;
    bool open;      /* a sample has begun and not ended */
    bool informed;  /* a channel or a neighbour was ever used */
    bool any_heard; /* in this sample */
    bool refused;   /* a message, or a fused matrix, in this sample */
    enum dse_health health;
    struct dse_dso_counts counts;
};

/* Reals of a symmetric matrix: its lower triangle by rows. */
#define DSE_DSO_PACKED(nx) ((nx) * ((nx) + 1) / 2)
/* Reals of the longest message of any scheme. */
#define DSE_DSO_MESSAGE(nx, ny) (2 * DSE_DSO_PACKED(nx) + (nx) + 3 * (ny))
#define DSE_DSO_SCRATCH(nx)     (DSE_DSO_PACKED(nx) + 2 * (nx) + 2 * (nx) * (nx))
/* Reals that dse_dso_init takes at most. */
#define DSE_DSO_STORAGE(nx, ny, neighbours)                                                        \
    (DSE_SECOND_ORDER_STORAGE(nx, ny) + ((neighbours) + 1) * (DSE_DSO_MESSAGE(nx, ny) + 1) +       \
     3 * DSE_DSO_PACKED(nx) + 3 * (nx) + 2 * (ny) + DSE_DSO_SCRATCH(nx))

/* As dse_second_order_init; DSE_EINVAL also: settings of the network outside their ranges. */
enum dse_status dse_dso_init(struct dse_dso *node, const struct dse_dso_config *config,
                             struct dse_arena *arena);

/* A sample taken at t: predicts to t with the input u (nu, held since the last one; NULL when there
 * is none) and takes the own measurement. Without rounds it is the whole sample. Channels that are
 * missing or not finite are left out: without any, psi_i = w_i. Errors of dse_second_order_predict
 * (and update, without rounds): the estimate stays, and there is no exchange. */
enum dse_status dse_dso_begin(struct dse_dso *node, dse_real t, const dse_real *u,
                              const struct dse_measurement *measurement);

/* Rounds of a sample. */
int dse_dso_rounds(const struct dse_dso *node);
/* Reals of a message in round r. */
int dse_dso_message_size(const struct dse_dso *node, int r);
/* What this node says to all neighbours in the present round; returns the number of reals, 0 when
 * there is no sample in progress (its prediction failed): the neighbours do without. */
int dse_dso_message(const struct dse_dso *node, dse_real *message);
/* What neighbour 0 .. n_neighbours - 1 says in this round; said again it replaces what was said.
 * DSE_EINVAL: no such neighbour, no sample in progress; DSE_EDIM, DSE_ENONFINITE: refused and
 * counted, as if it had said nothing. */
enum dse_status dse_dso_receive(struct dse_dso *node, int neighbour, const dse_real *message,
                                int count);
/* Ends the round with what was heard. DSE_EINVAL: no sample in progress; DSE_ENOTPD,
 * DSE_ENONFINITE: the correction failed, the sample ends with the prediction as its estimate. */
enum dse_status dse_dso_end_round(struct dse_dso *node);

/* Sets the estimate anew as dse_second_order_set, and consensus filters to zero; a sample in
 * progress ends. */
enum dse_status dse_dso_set(struct dse_dso *node, dse_real t, const dse_real *x, const dse_real *S);

/* ---- read-only; valid until the next call ---- */

const dse_real *dse_dso_state(const struct dse_dso *node);      /* nx */
const dse_real *dse_dso_covariance(const struct dse_dso *node); /* nx x nx */
/* ny: m_i - C_i w_i, 0 where there is no value. */
const dse_real *dse_dso_innovation(const struct dse_dso *node);
dse_real dse_dso_time(const struct dse_dso *node);
/* C: 2 delta n_neighbours |S_i|_F with the normalisation, a bound of delta lambda_max(L) |S_i|
 * where no node has more neighbours; B: delta n_neighbours; others: 0. Beyond 2 (C) or 1 (B) the
 * exchange overshoots. */
dse_real dse_dso_loop_gain(const struct dse_dso *node);
/* Initialising until an own channel or a neighbour's information is used; coasting without own
 * data; rejecting when a message, a channel or a fused matrix was refused in this sample; alone
 * when a node with neighbours heard none; diverged after a failed sample, until one succeeds. */
enum dse_health dse_dso_health(const struct dse_dso *node);
const struct dse_dso_counts *dse_dso_counts(const struct dse_dso *node);

#endif
