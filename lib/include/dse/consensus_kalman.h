/* Consensus Kalman filter (CKF): node i of a sensor network. Every node estimates the whole state
 * of a linear discrete plant from its own sensors and from what its neighbours N_i say,
 *
 *     x(k+1) = A x(k) + B u(k) + w,  w ~ N(0, Q)          y_i = C_i x + v_i,  v_i ~ N(0, R_i)
 *
 * fusing in information form, u_i = C_i'R_i^-1 y_i, Y_i = C_i'R_i^-1 C_i:
 *
 *     P = (N^-1 + Y)^-1,  xh = w + P (u - Y w)  (+ consensus on estimates)    then N = A P A' + Q
 *
 * where the schemes differ in how u and Y come about (type I: agreement on information; type II:
 * agreement on estimates):
 *
 *     dse_ckf_begin(&f, k, t, input, &y);                    sample k, taken at t
 *     for (r = 0; r < dse_ckf_rounds(&f); r++) {
 *         count = dse_ckf_message(&f, out);                  -> to every neighbour
 *         dse_ckf_receive(&f, neighbour, in, count);         for every one that was heard
 *         dse_ckf_end_round(&f);
 *     }                                                      dse_ckf_state is now that of t
 *     dse_ckf_advance(&f);                                   now the prior of sample k + 1
 *
 * How often is a measurement counted? What travels never is a sum that another node adds to its
 * own: averages are formed by weights, and raw information of a node goes to its neighbours only.
 * So no loop of the graph can bring a measurement back. What is left:
 * - A agrees on the network's average: after r rounds node i has sum_j w_ij (u_j, Y_j), where
 *   W = I - eps L, w_ij = (W^r)_ij when nothing is lost, and multiplies it. See enum
 *   dse_ckf_counting: by default no measurement is counted more than once, ever, and P bounds the
 *   error's covariance for any graph, any number of rounds and any loss of messages.
 * - B, C: every node of J_i gives its own u_j, Y_j, once a sample; nothing is relayed. Estimates
 *   that are then mixed share data, which P ignores: with weights of a convex combination (B, eps
 *   at most 1 / neighbours) mixing equally good estimates makes none worse.
 * - A_LITERAL adds its own u_i, Y_i to the average: nodes + 1 times in all. Overconfident.
 *
 * P is the error's covariance as it is, where the source's M of type I is nodes times it.
 *
 * Equation and algorithm names are those of the consensus-based second-order observers source,
 * sections those of its spec (4.4-4.6). */
#ifndef DSE_CONSENSUS_KALMAN_H
#define DSE_CONSENSUS_KALMAN_H

#include <stdbool.h>

#include "dse/arena.h"
#include "dse/consensus.h"
#include "dse/health.h"
#include "dse/information.h"
#include "dse/linalg.h"
#include "dse/model.h"
#include "dse/real.h"
#include "dse/status.h"

enum dse_ckf_scheme {
    /* Type I, recommended: high-pass consensus filters of u and Y; u = multiplicity (v + u_i), Y
     * likewise. `rounds` rounds: g = v + (u_i, Y_i), and with DSE_CKF_ONCE the weights. */
    DSE_CKF_A = 0,
    /* Type II in two steps: u = sum_J u_j, Y = sum_J Y_j; psi_i = w_i + P_i (u - Y w_i);
     * xh_i = psi_i + eps sum_N (psi_j - psi_i). Two rounds: (u_j, Y_j), psi_j. */
    DSE_CKF_B = 1,
    /* Type II in one step, Kalman-consensus filter:
     * xh_i = w_i + P_i (u - Y w_i) + eps / (1 + |P_i|_F) P_i sum_N (w_j - w_i).
     * One round: (u_j, Y_j, w_j). */
    DSE_CKF_C = 2,
    /* No network: a Kalman filter in information form. No round. */
    DSE_CKF_ALONE = 3,

    /* For comparison only: */

    /* C as printed, with eps in place of eps / (1 + |P_i|_F): diverges where
     * eps lambda_max(L) |P| is beyond about 2. */
    DSE_CKF_C_LITERAL = 4,
    /* Type I with a low-pass filter of u and a band-pass filter of Y: u = nodes c, Y = nodes b.
     * Lags, and needs sensors that are all alike, both because of the low-pass. `rounds` rounds:
     * (c_j, u_j, g_j, b_j). */
    DSE_CKF_A_LOW_PASS = 5,
    /* As printed: u = nodes (c + u_i), Y = nodes (b + Y_i), and Q / nodes in place of Q. */
    DSE_CKF_A_LITERAL = 6
};

/* What the average of A is multiplied by to be a sum again. */
enum dse_ckf_counting {
    /* The filters start from zero in every sample, and the weights w_ij of all nodes with data
     * travel along (`nodes` reals more): multiplicity = 1 / max_j w_ij, so that every measurement
     * counts at most once, the one with most weight exactly once. */
    DSE_CKF_ONCE = 0,
    /* The same without the weights: multiplicity = config->multiplicity, of
     * dse_consensus_largest_weight, or a bound of it that a node knows by itself, which is that of
     * one round: 1 / max(1 - eps n_neighbours, eps). At most once while nothing is lost. */
    DSE_CKF_BOUNDED = 1,
    /* As in the source: the filters are kept from sample to sample, multiplicity = nodes. A
     * measurement of node j counts nodes (W^r)_ij times at once and nodes (W^((a+1) r) - W^(a
     * r))_ij times after a samples: more than once at first, which is taken back later, exactly
     * once in all. P is the error's covariance when there are rounds enough, and too small
     * otherwise. Messages lost in one direction make it wrong for good: see `restart`. */
    DSE_CKF_IN_ALL = 2
};

/* Zero is the default where one is named. Config and all that it points to must outlive the filter.
 */
struct dse_ckf_config {
    /* The plant, discrete: dfdx is A(t), also called with the estimate as x; f moves the estimate
     * and may know of inputs; NULL: x(k+1) = A(t_k) x. h and ny are not used. */
    const struct dse_model *model;
    int ny;             /* >= 0: own outputs */
    const dse_real *C;  /* ny x nx, read in every sample: a time-varying C may be written there */
    const dse_real *R;  /* ny x ny, positive definite, likewise */
    const dse_real *Q;  /* nx x nx, positive semidefinite; NULL: none */
    const dse_real *x0; /* nx: estimate before the first sample; NULL: zero */
    const dse_real *P0; /* nx x nx: its covariance, positive semidefinite */

    enum dse_ckf_scheme scheme;
    int n_neighbours;   /* >= 0: nodes that it hears, with mutual links; counted 0, 1, .. */
    int largest_degree; /* A, of the network, >= n_neighbours; 0 means n_neighbours */
    /* A: step of the filters, at most dse_consensus_largest_step of the largest degree; 0 means
     * 1 / (1 + degree), with a low-pass 1 / (1 + 2 degree). B: at most
     * 1 / n_neighbours, 0 means that or 0.1. C: likewise, with 0.5. > 0. */
    dse_real epsilon;
    dse_real alpha; /* band-pass, > 0; 0 means 1 */
    int nodes;      /* A: of the network, > n_neighbours */
    int self;       /* A with ONCE: this node's number, 0 .. nodes - 1, no two alike */
    int rounds;     /* A: of a sample, >= 1; 0 means 5 */
    enum dse_ckf_counting counting; /* A; the low-pass schemes count as IN_ALL */
    dse_real multiplicity;          /* A with BOUNDED, > 0; 0: see there */
    /* IN_ALL: the filters start from zero in every sample whose number is a multiple of it, >= 0;
     * 0 (default): never. */
    int restart;
};

/* Totals since init. */
struct dse_ckf_counts {
    long samples;   /* successful */
    long failed;    /* samples whose correction or prediction failed */
    long used;      /* own channels */
    long missing;   /* own channels flagged invalid */
    long nonfinite; /* own channels flagged valid, but NaN or infinite: treated as missing */
    long heard;     /* messages taken */
    long silent;    /* neighbours that said nothing in a round */
    long refused;   /* messages refused: not finite or of another length */
    long fallback;  /* samples whose fused information was not usable: own information was used */
};

struct dse_ckf {
    const struct dse_ckf_config *config;
    int nx, ny, n_neighbours;
    int rounds, round; /* of a sample, and how many of them have ended */
    int size;          /* of u and the packed Y together */
    int carried;       /* of what is averaged: size, and with ONCE the weights */
    int width;         /* reals of the longest message */
    dse_real epsilon, alpha, multiplicity;
    dse_real t;
    const dse_real *input;
    dse_real *x; /* nx: prior of the sample, then the estimate */
    dse_real *P; /* nx x nx */
    dse_real *x_next;
    dse_real *P_next;
    dse_real *own;        /* carried: u_i, packed Y_i; with ONCE 1 at its own place of `nodes` */
    dse_real *fused;      /* size: u, packed Y */
    dse_real *v;          /* carried: high-pass; low-pass schemes: [c; v of Y] .. */
    dse_real *b;          /* .. and b, packed */
    dse_real *said;       /* n_neighbours x width: messages of this round */
    dse_real *heard;      /* n_neighbours: 1 for those that there are */
    dse_real *innovation; /* ny: y - C w, 0 where there is no value */
    dse_real *scratch;
    int present;    /* own channels that there are */
    bool open;      /* a sample has begun and its rounds have not ended */
    bool corrected; /* its rounds have ended, and it has not been advanced */
    bool any_heard; /* in this sample */
    bool refused;   /* a message, or the fused information, in this sample */
    bool informed;  /* some information has been used, ever */
    enum dse_health health;
    struct dse_ckf_counts counts;
};

#define DSE_CKF_LARGER(a, b) ((a) > (b) ? (a) : (b))
/* Reals of u and Y. */
#define DSE_CKF_SIZE(nx) ((nx) + DSE_SYM_PACKED(nx))
/* Reals of the longest message of any scheme. nodes: of the network with A and ONCE, else 0. */
#define DSE_CKF_MESSAGE(nx, nodes) (DSE_CKF_SIZE(nx) + DSE_CKF_LARGER(DSE_CKF_SIZE(nx), nodes))
#define DSE_CKF_SCRATCH(nx, ny)                                                                    \
    (2 * (nx) * (nx) + 2 * (nx) +                                                                  \
     DSE_CKF_LARGER(DSE_INFORMATION_SCRATCH(nx), DSE_INFORMATION_OF_SCRATCH(nx, ny)))
/* Reals that dse_ckf_init takes at most; nodes: likewise. */
#define DSE_CKF_STORAGE(nx, ny, neighbours, nodes)                                                 \
    (2 * (nx) + 2 * (nx) * (nx) + 4 * DSE_CKF_SIZE(nx) + 2 * (nodes) + (ny) +                      \
     (neighbours) * (DSE_CKF_MESSAGE(nx, nodes) + 1) + DSE_CKF_SCRATCH(nx, ny))

/* DSE_EINVAL: a value outside its range, a continuous model, a matrix that is missing or not
 * symmetric; DSE_ENOTPD: P0, Q, R; DSE_ENONFINITE; DSE_ESTORAGE. */
enum dse_status dse_ckf_init(struct dse_ckf *ckf, const struct dse_ckf_config *config,
                             struct dse_arena *arena);

/* Sample k, counted alike in the whole network, taken at t; input (nu, NULL when there is none) is
 * held until dse_ckf_advance has returned. Channels that are missing or not finite are left out.
 * Without rounds it corrects at once. A sample that is still open is given up. DSE_EINVAL: t not
 * finite; DSE_ENOTPD, DSE_ENONFINITE: R or C as read now; there is no exchange then. */
enum dse_status dse_ckf_begin(struct dse_ckf *ckf, long k, dse_real t, const dse_real *input,
                              const struct dse_measurement *measurement);

int dse_ckf_rounds(const struct dse_ckf *ckf);
/* Reals of a message in round r. */
int dse_ckf_message_size(const struct dse_ckf *ckf, int r);
/* What this node says to all neighbours in the present round; returns the number of reals, 0 when
 * no sample is open. */
int dse_ckf_message(const struct dse_ckf *ckf, dse_real *message);
/* What neighbour 0 .. n_neighbours - 1 says in this round; said again it replaces what was said.
 * DSE_EINVAL: no such neighbour, no open sample; DSE_EDIM, DSE_ENONFINITE: refused and counted, as
 * if it had said nothing. */
enum dse_status dse_ckf_receive(struct dse_ckf *ckf, int neighbour, const dse_real *message,
                                int count);
/* Ends the round with what was heard. DSE_EINVAL: no open sample; DSE_ENOTPD, DSE_ENONFINITE: the
 * correction failed, the prior stays as the estimate of this sample. */
enum dse_status dse_ckf_end_round(struct dse_ckf *ckf);
/* To the next sample. DSE_EINVAL: no sample has been corrected; errors of the model,
 * DSE_ENONFINITE: the estimate stays. */
enum dse_status dse_ckf_advance(struct dse_ckf *ckf);

/* Sets the prior of the next sample anew and consensus filters to zero; an open sample ends. P
 * NULL: stays. Errors as of init: nothing has changed. */
enum dse_status dse_ckf_set(struct dse_ckf *ckf, const dse_real *x, const dse_real *P);

/* ---- read-only; valid until the next call ---- */

/* Prior, from the end of the rounds on the estimate, from dse_ckf_advance on the next prior. */
const dse_real *dse_ckf_state(const struct dse_ckf *ckf);      /* nx */
const dse_real *dse_ckf_covariance(const struct dse_ckf *ckf); /* nx x nx */
const dse_real *dse_ckf_innovation(const struct dse_ckf *ckf); /* ny */
/* What the average was multiplied by in the last correction (A): with ONCE the number of nodes
 * whose data count in full, as far as it goes. */
dse_real dse_ckf_multiplicity(const struct dse_ckf *ckf);
/* The fused information of the last correction: u (nx), then Y packed. */
const dse_real *dse_ckf_information(const struct dse_ckf *ckf);
/* Initialising until information is used; coasting without own data; rejecting when a message or
 * the fused information was refused in this sample; alone when a node with neighbours heard none;
 * diverged after a failed sample, until one succeeds. */
enum dse_health dse_ckf_health(const struct dse_ckf *ckf);
const struct dse_ckf_counts *dse_ckf_counts(const struct dse_ckf *ckf);

#endif
