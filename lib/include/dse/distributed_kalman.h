/* Distributed Kalman filter (DKF): node i of a sensor network. Every node estimates the whole state
 * of a linear plant from its own sensors and from what its neighbours say of their estimates:
 *
 *     x' = A(t) x + w,  w w' ~ Q            y_i = C_i x + v_i,  v_i v_i' ~ R_i
 *
 *     xh_i'     = A xh_i + K_i eps_i + gamma D_i sum_j Gamma_ij d_ij                       (2.3)
 *     P_i'      = A P_i + P_i A' + Q - K_i R_i K_i',   K_i = P_i C_i' R_i^-1
 *     Gamma_ij' = beta eps_i d_ij' - sigma Gamma_ij                                        (2.5)
 *     eps_i     = y_i - C_i xh_i,   d_ij = C_i xh_j - C_i xh_i
 *
 * The adaptive gains Gamma_ij take the place of the graph's weights. They cancel the coupling in
 * the Lyapunov function V_i = e_i' Pi_i e_i + sum_j tr(Gamma_ij Gamma_ij') / beta, Pi_i = D_i's
 * weight, whatever the graph is; they have no bound of their own (see `limit` and `sigma`).
 *
 *     dse_dkf_begin(&f, t_k, u, &y);                         sample k begins
 *     count = dse_dkf_message(&f, listener, out);            -> to every listener
 *     dse_dkf_receive(&f, neighbour, in, count);             for every neighbour that was heard
 *     dse_dkf_correct(&f);                                   dse_dkf_state is now that of t_k
 *     dse_dkf_advance(&f);                                   now at t_{k+1}
 *
 * Continuous: one classical Runge-Kutta step of (xh, P, Gamma, W) from t_k to t_k + period with y
 * and messages held and A(t) at the stages' times; all nodes use messages of t_k. Messages say
 * xh(t_k); correct changes nothing. Discrete: messages say the prior estimate, correct makes the
 * filtered one of it, advance the next prior.
 *
 * Equation numbers are those of the adaptive distributed observers source, sections those of its
 * spec. */
#ifndef DSE_DISTRIBUTED_KALMAN_H
#define DSE_DISTRIBUTED_KALMAN_H

#include <stdbool.h>

#include "dse/arena.h"
#include "dse/health.h"
#include "dse/linalg.h"
#include "dse/model.h"
#include "dse/ode.h"
#include "dse/real.h"
#include "dse/status.h"

/* How a node is coupled to its neighbours; with s_i = sum_j d_ij: */
enum dse_dkf_scheme {
    DSE_DKF_ALONE = 0, /* not at all: a local Kalman filter */
    DSE_DKF_EDGE = 1,  /* one gain per neighbour                                     (2.3)-(2.5) */
    DSE_DKF_NODE = 2,  /* one gain per node: D Gamma_i s_i, Gamma_i' = beta eps_i s_i'    (2.11) */
    /* One gain for the network: Gamma' = beta sum_i eps_i s_i', a sum that comes from outside
     * (dse_dkf_global_term, dse_dkf_global_sum); held over a step. All ny_i are equal.   (2.12) */
    DSE_DKF_GLOBAL = 3,
    /* No adaptation: gamma P_i sum_j (xh_j - xh_i), messages are whole states. Proved for
     * undirected graphs only. */
    DSE_DKF_STANDARD = 4
};

/* D_i, the direction in which neighbours act. */
enum dse_dkf_direction {
    /* Continuous: P C' (Pi = P^-1). Discrete: P(k+1) A_i^-T C', A_i = A - K C A            (6.6) */
    DSE_DKF_COVARIANCE = 0,
    /* P C' R^-1 = K, and Gamma_ij' = beta R^-1 eps_i d_ij' (Remark 2.6). Continuous. */
    DSE_DKF_GAIN = 1,
    /* W C', W' = A_i W + W A_i' + S, A_i = A - K C: stable forward in time for any S > 0, and
     * Pi = W^-1 meets (2.4) with U = W^-1 S W^-1 (section 4.2). Continuous. */
    DSE_DKF_LYAPUNOV = 2,
    DSE_DKF_GIVEN = 3,   /* config->D: made offline for a time-invariant plant            (2.14) */
    DSE_DKF_FILTERED = 4 /* P(k) A(k-1)^-T C', the exact result for Pi = M^-1. Discrete. */
};

/* What messages carry. Both give the same estimates, but for rounding. */
enum dse_dkf_message {
    DSE_DKF_PROJECTED = 0, /* C_j xh_i for listener j: needs the sensors of the listeners */
    DSE_DKF_FULL = 1       /* xh_i (2.17); always so with DSE_DKF_STANDARD */
};

/* Sensors of a node. C is read in every step: a time-varying C(t_k) may be written there before
 * dse_dkf_begin and is held over the step. */
struct dse_dkf_sensor {
    int ny;            /* >= 0 */
    const dse_real *C; /* ny x nx */
};

/* Zero is the default where one is named. Config and all that it points to must outlive the filter.
 */
struct dse_dkf_config {
    /* The plant: dfdx is A(t), also called with the estimate as x. f moves the estimate and may
     * know of inputs; NULL: the plant is x' = A(t) x (or x(k+1) = A(t_k) x) and A(t) serves for
     * both. time says which equations hold; h and ny are not used. With given gains (K, and D where
     * there is one) dfdx may be NULL when f is there. */
    const struct dse_model *model;
    dse_real period; /* time of a step, > 0, in the model's unit; discrete: not used */

    struct dse_dkf_sensor sensor; /* of this node */
    int n_neighbours;             /* >= 0: nodes that it hears. They are counted 0, 1, .. */
    int n_listeners;              /* >= 0: nodes that hear it, likewise */
    const struct dse_dkf_sensor *listeners; /* n_listeners; NULL when messages are full */

    enum dse_dkf_scheme scheme;
    enum dse_dkf_direction direction; /* not used with ALONE; STANDARD has P (COVARIANCE) */
    enum dse_dkf_message message;

    const dse_real *x0; /* nx: initial estimate (discrete: prior); NULL: zero */
    const dse_real *P0; /* nx x nx, positive definite; not read when K is given */
    const dse_real *Q;  /* nx x nx: B Q B', positive semidefinite: intensity, or covariance per step
                         * (discrete); NULL: none; not read when K is given */
    const dse_real *R;  /* ny x ny, positive definite: intensity or covariance; not read when K is
                         * given */
    /* nx x ny: a constant gain instead of the Riccati equation's: offline Kalman (2.13) or
     * Luenberger (2.10). Discrete: xh(k+1) = A xh + K (y - C xh) + gamma D sum_j Gamma_ij d_ij, the
     * predicting form (6.7): correct changes nothing. With D either GIVEN or LYAPUNOV. */
    const dse_real *K;
    const dse_real *D;  /* nx x ny; with GIVEN */
    const dse_real *S;  /* nx x nx, positive definite; with LYAPUNOV */
    const dse_real *W0; /* nx x nx, positive definite; with LYAPUNOV; NULL: identity */

    /* Coupling weight, >= 0. Discrete: of the order of the time step; it is in front of the
     * coupling and of the adaptation. period gamma |C D sum_j Gamma_ij| has to stay below about 2:
     * dse_dkf_loop_gain. */
    dse_real gamma;
    dse_real beta;  /* adaptation rate, > 0; 0 means 1. Without leak and limit only gamma beta
                     * counts,  continuous */
    dse_real sigma; /* leak, >= 0, 1 / time; discrete: per step, below 1. 0 (default): none */
    dse_real limit; /* largest Frobenius norm of each Gamma, > 0: a larger one is scaled down to it,
                     * and counted. 0 (default): none */
    /* A neighbour that says nothing is taken at its last word for so many steps, its gain frozen;
     * then it is left out. When it comes back its Gamma_ij starts from 0. >= -1; 0 means the
     * default, 3; -1: left out at once. */
    int hold;
};

/* Totals since init. */
struct dse_dkf_counts {
    long steps;     /* successful */
    long failed;    /* steps that left everything as it was */
    long split;     /* steps taken in two parts, see dse_dkf_advance */
    long used;      /* own channels */
    long missing;   /* own channels flagged invalid */
    long nonfinite; /* own channels flagged valid, but NaN or infinite: treated as missing */
    long heard;     /* messages taken */
    long refused;   /* messages refused: not finite or of another length */
    long held;      /* times a neighbour was taken at an older word */
    long dropped;   /* times a neighbour was left out after having been heard */
    long rejoined;  /* times one came back */
    long limited;   /* gains scaled down to the limit */
};

struct dse_dkf {
    const struct dse_dkf_config *config;
    int nx, ny, n_gains; /* n_gains: number of Gamma's */
    int n_integrated;    /* reals of the state that a Runge-Kutta step moves */
    int n_state;         /* reals of `now` */
    int hold;            /* with its default put in */
    dse_real rate;       /* of the law: beta, discrete: gamma beta */
    bool riccati, lyapunov, discrete;
    bool full; /* messages are whole states */
    dse_real t;
    const dse_real *u;

    /* [xh nx; P nx x nx if riccati; W nx x nx if lyapunov; Gamma n_gains x ny x ny] */
    dse_real *now;
    dse_real *next;      /* likewise: filled by a step and exchanged for `now` on success */
    dse_real *filtered;  /* nx, discrete: the corrected estimate */
    dse_real *direction; /* nx x ny, discrete: D of this step */
    dse_real *A_before;  /* nx x nx, discrete with FILTERED: A(k-1) */
    dse_real *said;      /* n_neighbours x width: C_i xh_j, or xh_j with STANDARD */
    dse_real *age;       /* n_neighbours: steps since it was heard; negative: not in use */
    dse_real *y;         /* ny */
    dse_real *has;       /* ny: 1 where there is a value, else 0 */
    dse_real *residual;  /* ny: eps of the last correct */
    dse_real *adapts;    /* ny: 1 where `residual` may move a gain's row */
    dse_real *R_inverse; /* ny x ny */
    dse_real *R_present; /* ny x ny: that of the channels that there are, the others 0 */
    dse_real *global;    /* ny x ny: the sum from outside */
    dse_real *scratch;
    int width;
    bool has_global;
    bool has_before; /* there is an A(k-1) */
    bool corrected;  /* correct has been called in this sample */
    bool refused;    /* a message was, in this sample */
    int present;     /* own channels that are there */
    enum dse_health health;
    struct dse_dkf_counts counts;
};

/* ---- memory ---- */

#define DSE_DKF_LARGER(a, b) ((a) > (b) ? (a) : (b))
/* Reals of the state: `matrices` is how many of P and W there are. */
#define DSE_DKF_STATE(nx, ny, neighbours, matrices)                                                \
    ((nx) + (matrices) * (nx) * (nx) + DSE_DKF_LARGER(neighbours, 1) * (ny) * (ny))
#define DSE_DKF_SCRATCH_CONTINUOUS(nx, ny, neighbours, matrices)                                   \
    (DSE_RK4_SCRATCH(DSE_DKF_STATE(nx, ny, neighbours, matrices)) + 2 * (nx) * (nx) +              \
     2 * (nx) * (ny) + 6 * (ny) + (nx))
/* A measurement update; in discrete time also A, a factorisation and the coupling. */
#define DSE_DKF_SCRATCH_UPDATE(nx, ny)                                                             \
    (3 * (nx) * (nx) + 4 * (nx) * (ny) + 2 * (ny) * (ny) + 2 * (ny))
#define DSE_DKF_SCRATCH_DISCRETE(nx, ny)                                                           \
    (DSE_DKF_SCRATCH_UPDATE(nx, ny) + (nx) * (nx) + 3 * (ny) + (nx))
#define DSE_DKF_STORAGE_WITH(nx, ny, neighbours, matrices)                                         \
    (2 * DSE_DKF_STATE(nx, ny, neighbours, matrices) + (nx) + 2 * (nx) * (ny) +                    \
     (neighbours) * (DSE_DKF_LARGER(nx, ny) + 1) + 4 * (ny) + 3 * (ny) * (ny) +                    \
     DSE_DKF_LARGER(DSE_DKF_SCRATCH_CONTINUOUS(nx, ny, neighbours, matrices),                      \
                    DSE_DKF_SCRATCH_DISCRETE(nx, ny)))
/* Reals that dse_dkf_init takes at most for a node with so many neighbours .. */
#define DSE_DKF_STORAGE(nx, ny, neighbours) DSE_DKF_STORAGE_WITH(nx, ny, neighbours, 1)
/* .. and with the Lyapunov equation beside the Riccati equation (DSE_DKF_LYAPUNOV without K). */
#define DSE_DKF_STORAGE_LYAPUNOV(nx, ny, neighbours) DSE_DKF_STORAGE_WITH(nx, ny, neighbours, 2)
/* Reals of the longest message. */
#define DSE_DKF_MESSAGE(nx, ny) DSE_DKF_LARGER(nx, ny)

/* ---- a node ---- */

/* DSE_EINVAL: a value outside its range, a matrix that is missing or not symmetric, settings that
 * do not go together; DSE_ENOTPD: P0, R, S, W0; DSE_ENONFINITE; DSE_ESTORAGE; DSE_EMODEL,
 * DSE_ESINGULAR (discrete: A at t0 = 0 is not invertible). */
enum dse_status dse_dkf_init(struct dse_dkf *dkf, const struct dse_dkf_config *config,
                             struct dse_arena *arena);

/* A sample taken at t with the input u (nu, held over the step and read until advance; NULL when
 * there is none). Channels that are missing or not finite are left out: their residuals count as 0
 * and the gains stay. DSE_EINVAL: t is not finite. */
enum dse_status dse_dkf_begin(struct dse_dkf *dkf, dse_real t, const dse_real *u,
                              const struct dse_measurement *measurement);

/* What this node says to listener 0 .. n_listeners - 1; returns the number of reals: ny of the
 * listener, or nx when messages are full (then the same for all). 0: no such listener. */
int dse_dkf_message(const struct dse_dkf *dkf, int listener, dse_real *message);

/* What neighbour 0 .. n_neighbours - 1 says in this sample, dse_dkf_message_size reals.
 * DSE_EINVAL: no such neighbour; DSE_EDIM, DSE_ENONFINITE: refused and counted, as if it had said
 * nothing. */
enum dse_status dse_dkf_receive(struct dse_dkf *dkf, int neighbour, const dse_real *message,
                                int count);
/* Reals that a message to this node has. */
int dse_dkf_message_size(const struct dse_dkf *dkf);

/* DSE_DKF_GLOBAL, after all messages: this node's term eps_i s_i' (ny x ny) of the network's sum ..
 */
void dse_dkf_global_term(struct dse_dkf *dkf, dse_real *term);
/* .. and the sum over all nodes, before advance. Without it the gain stays for this step.
 * DSE_EINVAL: another scheme; DSE_ENONFINITE: refused and counted. */
enum dse_status dse_dkf_global_sum(struct dse_dkf *dkf, const dse_real *sum);

/* Ends the exchange: neighbours that said nothing grow older. dse_dkf_state is now the estimate at
 * t. Discrete: DSE_EMODEL, DSE_ENOTPD, DSE_ENONFINITE, DSE_ESINGULAR (A); the prior stays as the
 * estimate. */
enum dse_status dse_dkf_correct(struct dse_dkf *dkf);

/* To the next sample. A large P beside a small R can be too fast for a Runge-Kutta step (beyond
 * period C P C' R^-1 of about 2.5): when P would not stay positive definite, or anything not
 * finite, the step is repeated in two parts. First the measurement alone over the whole period,
 * whose solution is known: P <- (P^-1 + period C' R^-1 C)^-1, and xh accordingly; then all the rest
 * by Runge-Kutta. DSE_EMODEL, DSE_ENONFINITE, DSE_ENOTPD: estimate, covariances and gains stay as
 * they were. DSE_EINVAL: correct was not called, or failed, in this sample. */
enum dse_status dse_dkf_advance(struct dse_dkf *dkf);

/* Sets the estimate anew, e.g. after a divergence: x (nx), P (nx x nx; NULL: stays), and all gains
 * to zero. DSE_ENOTPD, DSE_ENONFINITE: nothing has changed. */
enum dse_status dse_dkf_set(struct dse_dkf *dkf, const dse_real *x, const dse_real *P);

/* ---- read-only; valid until the next call ---- */

/* nx: the estimate of the sample between begin and advance, of the next one after advance. */
const dse_real *dse_dkf_state(const struct dse_dkf *dkf);
/* nx x nx: P, the covariance of the uncoupled filter (of the prior estimate when discrete); with
 * coupling it is a weight only. NULL when K is given. */
const dse_real *dse_dkf_covariance(const struct dse_dkf *dkf);
/* nx x nx: W; NULL but with DSE_DKF_LYAPUNOV. */
const dse_real *dse_dkf_lyapunov(const struct dse_dkf *dkf);
/* nx x ny: D of the next or present correction; NULL when it is not discrete. */
const dse_real *dse_dkf_direction(const struct dse_dkf *dkf);
/* ny x ny: Gamma of neighbour j (EDGE), or the only one (NODE, GLOBAL: j = 0); else NULL. */
const dse_real *dse_dkf_gain(const struct dse_dkf *dkf, int j);
/* ny: eps_i of the last correct, 0 where there is no value. */
const dse_real *dse_dkf_residual(const struct dse_dkf *dkf);
/* Whether neighbour j acts on the estimate now. */
bool dse_dkf_uses(const struct dse_dkf *dkf, int j);
/* Frobenius norm of the largest Gamma. */
dse_real dse_dkf_largest_gain(const struct dse_dkf *dkf);
/* period gamma |C D sum_j Gamma_ij| (discrete: without the period; STANDARD: period gamma |sum_j
 * P|) over the neighbours in use, D at present: how far the coupling moves the output in one step.
 * Beyond about 2 the step overshoots and the estimate is in danger. */
dse_real dse_dkf_loop_gain(const struct dse_dkf *dkf);
/* Initialising until an own channel is used; coasting without one; rejecting when a message was
 * refused in this sample; alone when a coupled node uses no neighbour; diverged after a failed
 * step, until one succeeds. */
enum dse_health dse_dkf_health(const struct dse_dkf *dkf);
const struct dse_dkf_counts *dse_dkf_counts(const struct dse_dkf *dkf);

#endif
