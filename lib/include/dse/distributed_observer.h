/* One node of an adaptive distributed observer for a linear (descriptor) plant without noise:
 * unknown-input observers, functional observers and Luenberger observers, alone or coupled to
 * neighbours through adaptive gains. Source: adaptive distributed observers spec, 4.4-4.9.
 *
 * All of them are the same few lines with other constant matrices, which `dse design uio`,
 * `functional` and `luenberger` work out offline:
 *
 *     z'  = Lambda z + L y + H u + Pi^-1 (coupling)          z: nz
 *     xh  = M z + N y + J u                                  xh: nx
 *
 * y are the node's raw measurements and u the known inputs: the constraint rows of a descriptor
 * plant, [-B1 u; y*] in the source, are folded into L, H, N and J. For an unknown-input or a
 * Luenberger observer xh is the plant's state; for a functional observer it is z = L x of the
 * source, so that nx is the number of functionals.
 *
 * Two couplings, d_ij always the difference to neighbour j:
 *
 *     DSE_OBSERVER_NEIGHBOURS (default)   d_ij = m_j - C2_j xh_i,   m_j = C2_j xh_j
 *         coupling     M' sum_j C2_j' Gamma_ij d_ij
 *         Gamma_ij'    gamma d_ij d_ij' - leak Gamma_ij
 *       C2_j xh_j is what node j measures, so that -d_ij is a true residual of node i. Gamma_ij
 *       stays positive semidefinite and the error's Lyapunov function decreases (UIO9).
 *
 *     DSE_OBSERVER_OWN   d_ij = C2 (xh_j - xh_i),   r = D z + D_y y + D_u u
 *         coupling     D' sum_j Gamma_ij d_ij
 *         Gamma_ij'    -gamma r d_ij' - leak Gamma_ij
 *       with this node's own residual r. The Lyapunov function decreases when r is linear in the
 *       error: full-order forms, and the consistent functional law. The published reduced-order
 *       laws lack this (spec 4.5).
 *
 *     rows of the spec          residual    gain  C2             D            D_y, D_u
 *     UIO9 (default)            NEIGHBOURS  edge  C2 of each     -            -
 *     UIO1, UIO4                OWN         edge, node  none     C2 (TE)^+    of -y2
 *     UIO2, UIO3 (leak = gamma) OWN         edge, node  C2       C2 (TE)^+    of -y2
 *     UIO6, UIO7                OWN         edge, node  none     C            C J - I
 *     FO8 (default)             OWN         edge  Db'            Db' M        of Db'Q yt - W yt
 *     FO1-FO3, FO5, FO6         OWN         edge, node  (C L^+)' as rows, D = C2 M, D_y of -y
 *     UIO0, UIO5, FO0, FO4, Luenberger: no neighbours
 *
 * A period of a node, in this order (spec, section 3, agent mode):
 *
 *     dse_distributed_observer_sample(&node, t, u, &measurement);   integrates to t, forms xh
 *     say dse_distributed_observer_estimate(&node), or a projection of it, to the listeners
 *         - unless dse_distributed_observer_may_speak(&node) is false
 *     dse_distributed_observer_receive(&node, j, ..) for each neighbour that was heard
 *
 * What may go wrong, and what is done:
 * - A neighbour is not heard in a period: its last message goes on to act for `hold` periods but
 *   Gamma_ij is frozen, since an old message would teach it nonsense; then it is dropped from the
 *   sums. When it comes back Gamma_ij starts from 0 (a node-dependent Gamma_i stays, it belongs to
 *   all neighbours). Without any of its neighbours a node's health is alone.
 * - An own channel is missing: the last value is held, there is no coupling and no adaptation in
 *   this period and the next, the node keeps silent (what it would say is not measured), and its
 *   health is coasting. Until every channel has been valid once it is initialising and z stays z0.
 * - A message that is not finite is refused, counted, and counts as not heard.
 * - A step that is not finite changes nothing: DSE_ENONFINITE, health diverged. The next one covers
 *   both periods without coupling and with every Gamma = 0, health alone; then all goes on. */
#ifndef DSE_DISTRIBUTED_OBSERVER_H
#define DSE_DISTRIBUTED_OBSERVER_H

#include <stdbool.h>
#include <stdint.h>

#include "dse/arena.h"
#include "dse/health.h"
#include "dse/model.h"
#include "dse/real.h"
#include "dse/status.h"

enum dse_observer_residual { DSE_OBSERVER_NEIGHBOURS = 0, DSE_OBSERVER_OWN = 1 };
enum dse_observer_gain {
    DSE_OBSERVER_EDGE = 0, /* one Gamma_ij for each neighbour */
    DSE_OBSERVER_NODE = 1  /* one Gamma_i, the differences are summed; only with _OWN */
};

/* The rows of an estimate in which two nodes are compared. */
struct dse_observer_rows {
    int rows;           /* >= 0; not used when C2 is NULL */
    const dse_real *C2; /* rows x nx; NULL: the whole estimate, nx rows */
};

/* Config and all that it points to must outlive the object. The matrices have the names of the
 * keys in which `dse design` writes them. */
struct dse_distributed_observer_config {
    enum dse_time_kind time; /* default continuous; discrete: z(k+1) = Lambda z + L y + H u, without
                                neighbours */
    int nz, nu, ny, nx;      /* > 0, >= 0, >= 0, > 0 */
    const dse_real *Lambda;  /* nz x nz, Hurwitz (discrete: Schur) by design, not checked here */
    const dse_real *L;       /* nz x ny; NULL: zero */
    const dse_real *H;       /* nz x nu; NULL: zero */
    const dse_real *M;       /* nx x nz; NULL: identity, nx = nz */
    const dse_real *N;       /* nx x ny; NULL: zero */
    const dse_real *J;       /* nx x nu; NULL: zero */
    const dse_real *z0;      /* nz; NULL: zero */
    const bool *u_held;      /* nu: true: this input keeps the value of a sample until the next
                                (steps, a held command); false: it is interpolated; NULL: all are */

    int neighbours; /* 0 (default): a node alone; all below is not used then */
    enum dse_observer_residual residual;
    enum dse_observer_gain gain;
    const dse_real *Pi; /* nz x nz, positive definite: Lambda'Pi + Pi Lambda = -U */
    const struct dse_observer_rows *theirs; /* neighbours: the C2_j of each; only NEIGHBOURS */
    struct dse_observer_rows own;           /* only OWN: the C2 of this node */
    int nr;              /* only OWN: rows of the residual; 0: Gamma stays away */
    const dse_real *D;   /* nr x nz */
    const dse_real *D_y; /* nr x ny; NULL: zero */
    const dse_real *D_u; /* nr x nu; NULL: zero */
    dse_real gamma;      /* adaptation rate, >= 0; 0: Gamma stays 0 */
    dse_real leak;       /* 1/time, >= 0; 0 (default): no leakage */
    dse_real gain_max;   /* bound of the Frobenius norm of every Gamma, >= 0, kept by
                            scaling Gamma after each period; 0 (default): no bound */
    int hold;            /* periods that a message goes on to act, >= -1; 0 means the
                            default, 3; -1: none */
};

/* Neighbours: what was heard of one. */
enum dse_observer_hearing {
    DSE_OBSERVER_FRESH = 0,  /* for this period: couples and adapts */
    DSE_OBSERVER_HELD = 1,   /* an old message: couples, Gamma frozen */
    DSE_OBSERVER_DROPPED = 2 /* never heard or too old: left out, Gamma frozen */
};

struct dse_distributed_observer {
    const struct dse_distributed_observer_config *config;
    int n_gain;           /* reals of all Gamma */
    int n_rows;           /* compared rows of all neighbours */
    int n_inject;         /* columns of `injection` */
    int hold;             /* with its default put in */
    dse_real t;           /* of the estimate */
    dse_real *state;      /* nz + n_gain: z, then Gamma_ij row-major in the neighbours' order */
    dse_real *xh;         /* nx */
    dse_real *messages;   /* n_rows: C2 xh_j as heard last, stacked */
    dse_real *injection;  /* nz x n_inject: Pi^-1 M' or Pi^-1 D' */
    dse_real *y, *u;      /* ny, nu: of the last sample, held where missing */
    dse_real *y_next;     /* ny: of the sample being taken */
    dse_real *next;       /* nz + n_gain: state after the step that is tried */
    dse_real *y_stage;    /* ny: within the period */
    dse_real *u_stage;    /* nu */
    dse_real *xh_stage;   /* nx */
    dse_real *difference; /* n_rows; of one neighbour at a time */
    dse_real *residual;   /* r, or Gamma_ij d_ij */
    dse_real *sum;        /* n_inject */
    dse_real *scratch;    /* of the integrator */
    int *first_row;       /* neighbours: where the part of each begins in `messages` .. */
    int *first_gain;      /* neighbours: .. and its Gamma in the gains */
    int *age;             /* neighbours: periods since the last message, -1: never heard */
    int *seen;            /* ny: the channel has been valid once */
    bool started;         /* all channels have been seen */
    bool complete;        /* no channel was missing at the last sample */
    enum dse_health health;
    int64_t refused; /* messages with numbers that are not finite */
    int64_t dropped; /* times that a neighbour was dropped */
};

/* Reals that init takes. neighbours = 0: rows = residuals = 0. NEIGHBOURS: rows is the sum of the
 * neighbours' rows, residuals the largest of them. OWN: rows is neighbours times the rows of C2 (nx
 * without C2), residuals is nr. */
#define DSE_DISTRIBUTED_OBSERVER_STORAGE(nz, nu, ny, nx, neighbours, rows, residuals)              \
    (5 * ((nz) + (rows) * (residuals)) + (nz) * (nz) +                                             \
     ((nz) + 1) * ((nx) > (residuals) ? (nx) : (residuals)) + 2 * (rows) + (residuals) +           \
     2 * (nx) + 3 * (ny) + 2 * (nu) + 3 * DSE_ARENA_INTS(neighbours) + DSE_ARENA_INTS(ny))

/* DSE_EINVAL (a setting outside its range, or a matrix that is needed is NULL), DSE_ENONFINITE (a
 * matrix), DSE_ENOTPD (Pi), DSE_ESTORAGE. */
enum dse_status dse_distributed_observer_init(struct dse_distributed_observer *observer,
                                              const struct dse_distributed_observer_config *config,
                                              struct dse_arena *arena);
/* The sample at t, later than the last one: y of this node, u (nu). Integrates z and Gamma from the
 * last sample by one classical Runge-Kutta step with y interpolated, u as u_held says, the
 * neighbours' messages held and the own estimate free, and forms xh at t. At the first sample there
 * is nothing to integrate. DSE_EINVAL (t), DSE_ENONFINITE (t, u, or the step). */
enum dse_status dse_distributed_observer_sample(struct dse_distributed_observer *observer,
                                                dse_real t, const dse_real *u,
                                                const struct dse_measurement *measurement);
/* What neighbour j (index among the neighbours) said after this sample: its estimate (nx), or the
 * compared rows of it, C2 xh_j, in the sender's arithmetic (dse_mat_vec) with the same bits.
 * DSE_EINVAL (no such neighbour), DSE_ENONFINITE (refused). */
enum dse_status dse_distributed_observer_receive(struct dse_distributed_observer *observer, int j,
                                                 const dse_real *estimate);
enum dse_status dse_distributed_observer_receive_rows(struct dse_distributed_observer *observer,
                                                      int j, const dse_real *rows);

/* False until the first estimate and while an own channel is missing: say nothing then. */
bool dse_distributed_observer_may_speak(const struct dse_distributed_observer *observer);
const dse_real *dse_distributed_observer_estimate(const struct dse_distributed_observer *observer);
const dse_real *dse_distributed_observer_z(const struct dse_distributed_observer *observer);
/* All Gamma, n_gain reals, row-major in the neighbours' order. */
const dse_real *dse_distributed_observer_gains(const struct dse_distributed_observer *observer);
enum dse_health dse_distributed_observer_health(const struct dse_distributed_observer *observer);
enum dse_observer_hearing
dse_distributed_observer_hearing(const struct dse_distributed_observer *observer, int j);

/* ---- the equations themselves, for simulations of a whole network as one system ---- */

/* derivative (nz + n_gain) of state (z, Gamma) for given y, u and messages (n_rows, C2 xh_j
 * stacked), all neighbours heard; uses the object's scratch, changes nothing else. */
void dse_distributed_observer_rhs(const struct dse_distributed_observer *observer,
                                  const dse_real *state, const dse_real *y, const dse_real *u,
                                  const dse_real *messages, dse_real *derivative);
/* xh = M z + N y + J u. */
void dse_distributed_observer_output(const struct dse_distributed_observer *observer,
                                     const dse_real *z, const dse_real *y, const dse_real *u,
                                     dse_real *xh);

#endif
