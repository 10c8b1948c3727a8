/* Consensus filters: nodes of a network agree on the average of their inputs, each of them talking
 * to its neighbours only, in rounds. N_i are the neighbours of node i, J_i those and i itself:
 *
 *     average    x_i += eps sum_N (x_j - x_i)                                    (4.1), (4.2)
 *     high-pass  v_i += eps sum_N (g_j - g_i),  g_i = v_i + u_i;  gives g_i
 *     low-pass   c_i += eps [sum_N (c_j - c_i) + sum_J (u_j - c_i)];  gives c_i  (4.44)
 *     band-pass  v_i as high-pass, b_i += eps alpha [sum_N (b_j - b_i) + sum_J (g_j - b_i)];
 *                gives b_i                                                       (4.46)-(4.48)
 *
 * Rounds are synchronous: right-hand sides have what was so before the round and the present input.
 * A neighbour that is not heard in a round is left out of its sums.
 *
 * On a connected graph whose links are mutual, for inputs that rest, average and high-pass end at
 * the exact average, at the speed of the Laplacian's second eigenvalue: sum_i v_i stays 0, whatever
 * loops there are. A link that fails in one direction only moves that sum: reset from time to
 * time. The low-pass (and what follows it in the band-pass) ends at (I + D + L)^-1 (I + Adj) u,
 * which is the average on complete graphs and for equal inputs only, and lags.
 *
 * Values are vectors, or symmetric matrices packed by dse_sym_pack.
 *
 *     dse_consensus_input(&c, u);                            the node's input, as it changes
 *     count = dse_consensus_message(&c, out);                -> to every neighbour
 *     dse_consensus_receive(&c, neighbour, in, count);       for every one that was heard
 *     dse_consensus_end_round(&c);
 *
 * Equation numbers are those of the consensus-based second-order observers source; section 4.5 of
 * its spec. */
#ifndef DSE_CONSENSUS_H
#define DSE_CONSENSUS_H

#include <stdbool.h>

#include "dse/arena.h"
#include "dse/graph.h"
#include "dse/real.h"
#include "dse/status.h"

enum dse_consensus_kind {
    DSE_CONSENSUS_AVERAGE = 0, /* the input is where it starts: dse_consensus_input sets x */
    DSE_CONSENSUS_HIGH_PASS = 1,
    DSE_CONSENSUS_LOW_PASS = 2,
    DSE_CONSENSUS_BAND_PASS = 3
};

/* ---- one round, for objects that keep values and messages themselves ---- */

/* What the neighbours said in a round. */
struct dse_consensus_words {
    int count;             /* neighbours, >= 0 */
    int stride;            /* reals from one neighbour's message to the next one's */
    const dse_real *said;  /* count x stride */
    const dse_real *heard; /* count: not 0 for those that are there; NULL: all are */
};

/* All take `size` reals that start at real number `at` of each message; neighbours are added in
 * the order of their places. Nothing is checked. */

/* s = sum_N (w_j - w); w_j at `at`. s may be w. */
void dse_consensus_differences(const struct dse_consensus_words *words, int at, int size,
                               const dse_real *w, dse_real *s);
/* s = w + sum_N w_j = sum_J w_j. s may be w. */
void dse_consensus_sum(const struct dse_consensus_words *words, int at, int size, const dse_real *w,
                       dse_real *s);
/* x += eps sum_N (x_j - x); x_j at `at`. */
void dse_consensus_average(const struct dse_consensus_words *words, int at, int size, dse_real eps,
                           dse_real *x);
/* v += eps sum_N (g_j - v - u); g_j = v_j + u_j at `at`. */
void dse_consensus_high_pass(const struct dse_consensus_words *words, int at, int size,
                             dse_real eps, const dse_real *u, dse_real *v);
/* c += eps [sum_N (c_j - c) + sum_J (u_j - c)]; c_j at at_c, u_j at at_u. */
void dse_consensus_low_pass(const struct dse_consensus_words *words, int at_c, int at_u, int size,
                            dse_real eps, const dse_real *u, dse_real *c);
/* v and b of the band-pass; g_j at at_g, b_j at at_b. */
void dse_consensus_band_pass(const struct dse_consensus_words *words, int at_g, int at_b, int size,
                             dse_real eps, dse_real alpha, const dse_real *u, dse_real *v,
                             dse_real *b);

/* The largest step that does not overshoot on any graph whose nodes have at most `degree`
 * neighbours: 1 / degree for average and high-pass, 1 / (1 + 2 degree) for the low-pass, which
 * bounds eps alpha too. Twice as much and more may blow up: stable below 2 / lambda_max(L), and
 * below 2 / (1 + degree + lambda_max(L)). */
dse_real dse_consensus_largest_step(enum dse_consensus_kind kind, int degree);

/* What one measurement weighs in node i's average after so many rounds: the largest entry of row i
 * of (I - eps L)^rounds, 1 / nodes at best. The graph is undirected and its weights are 1. A filter
 * that starts from zero and multiplies by at most the inverse counts no input more than once.
 * scratch: 2 nodes. */
dse_real dse_consensus_largest_weight(const struct dse_graph *graph, int i, dse_real eps,
                                      int rounds, dse_real *scratch);

/* ---- a filter with its memory ---- */

/* Zero is the default where one is named. */
struct dse_consensus_config {
    enum dse_consensus_kind kind;
    int size;           /* reals of a value, > 0 */
    int n_neighbours;   /* >= 0: nodes that it hears, with mutual links; counted 0, 1, .. */
    int largest_degree; /* of the network, >= n_neighbours; 0 means n_neighbours */
    dse_real epsilon;   /* step, > 0, at most dse_consensus_largest_step of the largest degree;
                         * 0 means 1 / (1 + degree), low- and band-pass 1 / (1 + 2 degree) */
    dse_real alpha;     /* band-pass, > 0: eps alpha is bounded like a low-pass' step; 0 means 1 */
};

/* Totals since init. */
struct dse_consensus_counts {
    long rounds;  /* successful */
    long failed;  /* rounds that left everything as it was */
    long heard;   /* messages taken */
    long silent;  /* neighbours that said nothing in a round */
    long refused; /* messages refused: not finite or of another length */
};

struct dse_consensus {
    const struct dse_consensus_config *config;
    dse_real epsilon, alpha;
    int width;       /* reals of a message */
    dse_real *u;     /* size: input */
    dse_real *state; /* [x], [v], [c] or [v; b] */
    dse_real *next;
    dse_real *output; /* size */
    dse_real *said;   /* n_neighbours x width */
    dse_real *heard;  /* n_neighbours */
    struct dse_consensus_counts counts;
};

/* Reals that dse_consensus_init takes at most. */
#define DSE_CONSENSUS_STORAGE(size, neighbours) (6 * (size) + (neighbours) * (2 * (size) + 1))
/* Reals of the longest message. */
#define DSE_CONSENSUS_MESSAGE(size) (2 * (size))

/* DSE_EINVAL: a value outside its range, a step beyond its bound among them; DSE_ESTORAGE. */
enum dse_status dse_consensus_init(struct dse_consensus *filter,
                                   const struct dse_consensus_config *config,
                                   struct dse_arena *arena);
/* The input (size) from now on. DSE_ENONFINITE: the old one stays. */
enum dse_status dse_consensus_input(struct dse_consensus *filter, const dse_real *u);
/* States to zero (average: to the last input), and what was heard in this round is forgotten. All
 * nodes do so between the same rounds. */
void dse_consensus_reset(struct dse_consensus *filter);

int dse_consensus_message_size(const struct dse_consensus *filter);
/* What this node says to all its neighbours in this round: [x], [g], [c; u] or [g; b]. Returns the
 * number of reals. */
int dse_consensus_message(const struct dse_consensus *filter, dse_real *message);
/* What neighbour 0 .. n_neighbours - 1 says in this round; said again it replaces what was said.
 * DSE_EINVAL: no such neighbour; DSE_EDIM, DSE_ENONFINITE: refused and counted, as if it had said
 * nothing. */
enum dse_status dse_consensus_receive(struct dse_consensus *filter, int neighbour,
                                      const dse_real *message, int count);
/* One step with what was heard. DSE_ENONFINITE: it overflowed and was not taken. */
enum dse_status dse_consensus_end_round(struct dse_consensus *filter);

/* The filter's value (size), valid until the next call: x, v + u, c or b. */
const dse_real *dse_consensus_output(const struct dse_consensus *filter);
const struct dse_consensus_counts *dse_consensus_counts(const struct dse_consensus *filter);

#endif
