/* Coordinated distributed moving horizon estimation of a linear plant of several subsystems,
 *
 *     x_i(k+1) = A_ii x_i(k) + sum_{l /= i} A_il x_l(k) + w_i(k)
 *     y_i(k)   = C_ii x_i(k) + v_i(k)
 *
 * in deviations from a steady state, without known inputs. An agent for each subsystem solves a
 * problem of its own over the window of the last H samples; a coordinator makes their solutions fit
 * each other by rounds of messages: it sends prices or predicted interactions down, the agents send
 * their windows up. Equations (x.y) are those of T. An, "Coordinated distributed moving horizon
 * state estimation for linear systems" (2016).
 *
 * Both sides speak in flat arrays of reals, so that any transport will do:
 *
 *     the coordinator, in sample k                agent i
 *
 *     dse_mhe_coordinator_begin(&c, k)              dse_mhe_local_begin(&local, k, &measurement)
 *     for each i, and once more after the end:      while (!dse_mhe_local_is_finished(&local)):
 *       dse_mhe_coordinator_message_down(&c, i, ..)   dse_mhe_local_receive_down(&local, ..)
 *                                                       or dse_mhe_local_missing_down(&local)
 *       dse_mhe_coordinator_receive_up(&c, i, ..)     dse_mhe_local_solve(&local)
 *         or dse_mhe_coordinator_missing_up(&c, i)    dse_mhe_local_message_up(&local, ..)
 *     until dse_mhe_coordinator_advance(&c)         dse_mhe_local_finish(&local)
 *       is not DSE_MHE_CONTINUE
 *
 * The last message of a sample says stop: no answer is due, the agent finishes. While the window is
 * shorter than min_horizon both sides predict open loop, no message is exchanged: is_finished is
 * true and the coordinator's outcome is not CONTINUE right after begin.
 *
 * An agent that is alone (scheme ALONE, no coordinator: decentralised estimation) needs begin and
 * finish only. The centralised estimator is an agent alone with the whole plant as its subsystem.
 *
 * Stacked vectors: subsystem after subsystem, in each time from the oldest sample on, in each of
 * these the local states. X_i has H nx values, W_i, h_i, p_i have (H-1) nx.
 *
 * Bounds are on states and disturbances; those on interactions, (3.50) and (3.51), are not there.
 */
#ifndef DSE_COORDINATED_MHE_H
#define DSE_COORDINATED_MHE_H

#include <stdbool.h>

#include "dse/arena.h"
#include "dse/health.h"
#include "dse/model.h"
#include "dse/real.h"
#include "dse/status.h"
#include "dse/window_qp.h"

enum dse_mhe_scheme {
    DSE_MHE_ALONE = 0,     /* decentralised (2.19), or centralised (2.5) */
    DSE_MHE_PRICE = 1,     /* price-driven (3.34); without D the standard one (3.6) */
    DSE_MHE_PREDICTION = 2 /* prediction-driven (4.2), Algorithm 2 */
};

/* What an agent can say of its estimate. */
enum dse_mhe_status {
    DSE_MHE_STARTING = 0,   /* window shorter than min_horizon: open-loop prediction */
    DSE_MHE_CONVERGED = 1,  /* the coordinator's test holds; or solved, when alone */
    DSE_MHE_PREMATURE = 2,  /* stopped before: a valid estimate of lower accuracy */
    DSE_MHE_HELD = 3,       /* nothing came down in this sample: made with what came last */
    DSE_MHE_LOCAL_ONLY = 4, /* nothing to hold, or too old: the decentralised estimate */
    /* No solution of the local problem: of the last two the estimate is the decentralised one where
     * that exists, else a prediction. */
    DSE_MHE_INFEASIBLE = 5, /* no window within the bounds fits the interactions */
    DSE_MHE_SINGULAR = 6 /* the data at hand, or a scheme without D, do not determine the window */
};
/* "converged" and so on, never NULL. */
const char *dse_mhe_status_text(enum dse_mhe_status status);

/* A subsystem, as its agent and the coordinator know it. It must outlive both. Pointers that may be
 * NULL say so. Weights are symmetric positive definite. */
struct dse_mhe_subsystem {
    int nx, ny;        /* > 0 */
    const dse_real *A; /* nx x nx: A_ii */
    const dse_real *C; /* ny x nx: C_ii */
    const dse_real *Q; /* nx x nx: of w_i */
    const dse_real *R; /* ny x ny: of v_i */
    /* nx x nx: penalty 1/2 h' D^-1 h on the interaction (3.34). PRICE only; NULL: none, the
     * standard price-driven scheme, which is singular unless C_ii has full column rank. */
    const dse_real *D;
    const dse_real *x0;    /* nx: estimate of the first state; NULL: zero */
    const dse_real *x_min; /* nx; NULL: no bound; entries may be infinite */
    const dse_real *x_max;
    const dse_real *w_min;
    const dse_real *w_max;
    /* nx x nx: P_i^-1 of an arrival cost 1/2 |x_i(oldest) - xbar_i|^2; NULL: none. xbar_i is x0
     * while the window grows, then the estimate that was given for that sample when it was the
     * newest. */
    const dse_real *prior;
    /* nx x nx, positive semidefinite, added to the cost of every sample but the newest:
     * 1/2 x' stage_cost x; NULL: none. ALONE only; see dse_mhe_interaction_cost. */
    const dse_real *stage_cost;
    dse_real trigger; /* PREDICTION: eps_i of (5.1), send changes from this norm on; 0: always */
};

/* What the agents and the coordinator of a network agree on. It must outlive them. */
struct dse_mhe_settings {
    enum dse_mhe_scheme scheme;
    int horizon;     /* Hp >= 1: samples of a full window */
    int min_horizon; /* Hmin, 1 .. horizon: shorter windows are not solved; no default */
    /* PREDICTION: t > 0 of the log barrier (4.63) in place of hard bounds, 1e6 in the source;
     * 0: hard bounds. The agents alone that it is to be compared with use it as well. */
    dse_real barrier;
    /* Samples after which data that are held for want of newer ones count as never received;
     * 0: they may have any age. */
    int max_age;
};

/* ================ agent ================ */

struct dse_mhe_local_config {
    const struct dse_mhe_settings *settings;
    const struct dse_mhe_subsystem *subsystem;
    /* (min_horizon - 1) x nx: the plant's open-loop prediction from sample 0 on, part of this
     * subsystem, see dse_mhe_open_loop; NULL: x0 predicted by A_ii. */
    const dse_real *start;
    /* Second solvers for bounded windows, see dse/window_qp.h; NULL: none. */
    const struct dse_window_qp_backend *backend;       /* z = x, rows w */
    const struct dse_window_qp_backend *price_backend; /* z = (x, w) */
    int max_active; /* bounds that may be active at once; 0 (default): all */
};

/* Arrays for messages: reals at most. */
#define DSE_MHE_HEADER           5
#define DSE_MHE_BITS_PER_REAL    24
#define DSE_MHE_BIT_WORDS(bits)  (((bits) + DSE_MHE_BITS_PER_REAL - 1) / DSE_MHE_BITS_PER_REAL)
#define DSE_MHE_DOWN_SIZE(nx, N) (DSE_MHE_HEADER + 2 * ((N)-1) * (nx) + (N) * (nx))
#define DSE_MHE_UP_SIZE(nx, ny, N)                                                                 \
    (DSE_MHE_HEADER + DSE_MHE_BIT_WORDS((N) * (ny)) + DSE_MHE_BIT_WORDS((2 * (N)-1) * (nx)) +      \
     (2 * (N)-1) * (nx))

/* ---- what the objects consist of ---- */

/* Reals for `count` pointers, which may be smaller or larger than a real, and one to align them. */
#define DSE_MHE_POINTERS(count)                                                                    \
    ((int)(((count) * (int)sizeof(void *) + (int)sizeof(dse_real) - 1) / (int)sizeof(dse_real)) + 1)

/* A block-tridiagonal matrix and its Cholesky factor; lib/mhe/chain_internal.h. */
struct dse_mhe_chain {
    int n, length;
    dse_real *D, *U; /* blocks n x n: diagonal, and right of it (one less) */
    dse_real *L, *V; /* their factors */
    dse_real *work;  /* n */
};
#define DSE_MHE_CHAIN_STORAGE(n, N) ((4 * (N)-2) * (n) * (n) + (n))

/* What a transition costs, 1/2 |G x - ..|^2_S with G x = x(t+1) - A x(t), and for a problem with a
 * price how the rest follows from x: h = T'G x - V p, w = G x - h. */
struct dse_mhe_penalty {
    dse_real *S;    /* nx x nx: Q^-1, or (Q + D)^-1 */
    dse_real *AtS;  /* A'S */
    dse_real *AtSA; /* A'S A */
    dse_real *T;    /* S D */
    dse_real *V;    /* Q S D */
};

/* What is known of the outputs of a subsystem. */
struct dse_mhe_outputs {
    const struct dse_mhe_subsystem *subsystem;
    dse_real *L;       /* ny x ny: R = L L' */
    dse_real *rows;    /* ny x nx: L^-1 C */
    dse_real *partial; /* ny x nx: the same where channels are missing */
    dse_real *L_partial;
    dse_real *white; /* ny */
};

/* The bounded problem of a window and its memory. */
struct dse_mhe_bounded {
    struct dse_window_qp qp;
    struct dse_window_qp_config config;
    struct dse_window_qp_problem problem;
    dse_real *D, *U;                 /* N nz x nz blocks, for the problem with a price */
    dse_real *below;                 /* nz x nz: the block below each of the diagonal ones */
    dse_real *E;                     /* nx x nx: -A */
    dse_real *c, *lower, *upper;     /* N nz */
    dse_real *row_lower, *row_upper; /* (N-1) nr */
    const dse_real **diagonal_block; /* N pointers */
    const dse_real **below_block;
};

/* A window of states with the disturbances, interactions and multipliers that belong to it. */
struct dse_mhe_solution {
    dse_real *X;     /* H nx */
    dse_real *W;     /* (H-1) nx */
    dse_real *other; /* (H-1) nx: h_i (PRICE) or lambda_i (PREDICTION, ALONE) */
    dse_real J;
};

struct dse_mhe_local {
    const struct dse_mhe_local_config *config;
    const struct dse_mhe_settings *settings;
    const struct dse_mhe_subsystem *subsystem;
    int nx, ny, N;
    bool bounded;
    bool begun;
    long newest;
    int length; /* H */

    struct dse_mhe_outputs outputs;
    dse_real *y, *has;   /* N x ny, oldest first: outputs, 1 where there is one */
    dse_real *c;         /* N x nx: C'R^-1 y */
    dse_real *past;      /* N x nx: estimates of the samples when they were the newest */
    dse_real *xbar;      /* nx */
    dse_real *factored;  /* N x ny: `has` of the windows that the factors belong to, */
    int factored_length; /* and their length; 0: none */

    struct dse_mhe_penalty disturbance, price, interaction; /* of Q, Q + D, D */
    struct dse_mhe_chain own_chain, price_chain;            /* Omega_ii, M_x,i */
    struct dse_mhe_chain barrier_chain;
    enum dse_status own_status, price_status; /* of their factors */
    struct dse_mhe_bounded own_qp, price_qp;

    dse_real *g;         /* (N-1) nx: Th_i'p */
    dse_real *d;         /* (N-1) nx: h_i or p_i */
    int received_length; /* 0: nothing to hold */
    long received_sample;
    bool fresh;   /* there is a message for this round */
    bool heard;   /* there was one in this sample */
    bool stopped; /* the coordinator has said stop */
    int flags;    /* of the last message in this sample */
    int round;

    struct dse_mhe_solution current, kept; /* of the last round, and of the best one */
    bool has_kept;
    bool used_held;              /* the last problem was solved with held data, */
    bool used_nothing;           /* or with none */
    enum dse_status last_status; /* of the last problem */
    int solved;                  /* rounds in this sample */
    int active;
    dse_real certificate;
    dse_real *sent; /* N nx: X_i as the coordinator knows it */
    int sent_length;
    bool sends;

    dse_real *rhs, *work; /* N nx */
    dse_real *newton;     /* of the barrier: the last point and its Newton step */
    int barrier_length;   /* of that point; 0: none */

    dse_real *x; /* N nx: window of the finished sample */
    int finished_length;
    dse_real cost;
    long finished_sample;
    enum dse_mhe_status status;
    enum dse_health health;
    bool has_covariance;
};

/* Reals that dse_mhe_local_init takes of the arena: alone or prediction-driven without bounds, with
 * hard bounds (`active`: max_active, or 2 N nx for all), with a barrier; price-driven. */
#define DSE_MHE_LOCAL_STORAGE(nx, ny, N)                                                           \
    (2 * (ny) * (ny) + 2 * (ny) * (nx) + (ny) + 5 * (nx) * (nx) + DSE_MHE_CHAIN_STORAGE(nx, N) +   \
     3 * (N) * (ny) + (14 * (N)-5) * (nx))
#define DSE_MHE_LESS(a, b) ((a) < (b) ? (a) : (b))
#define DSE_MHE_QP_STORAGE(nz, nr, N, active)                                                      \
    ((nz) * (nz) + 3 * (N) * (nz) + 2 * ((N)-1) * (nr) + 2 * DSE_MHE_POINTERS(N) +                 \
     DSE_WINDOW_QP_STORAGE(nz, nr, N, DSE_MHE_LESS(active, (N) * (nz))))
#define DSE_MHE_LOCAL_BOUNDED_STORAGE(nx, ny, N, active)                                           \
    (DSE_MHE_LOCAL_STORAGE(nx, ny, N) + (nx) * (nx) + DSE_MHE_QP_STORAGE(nx, nx, N, active))
#define DSE_MHE_BARRIER_SIZE(nx, N) (12 * (N) * (nx))
#define DSE_MHE_LOCAL_BARRIER_STORAGE(nx, ny, N)                                                   \
    (DSE_MHE_LOCAL_STORAGE(nx, ny, N) + DSE_MHE_CHAIN_STORAGE(nx, N) + DSE_MHE_BARRIER_SIZE(nx, N))
#define DSE_MHE_LOCAL_PRICE_STORAGE(nx, ny, N)                                                     \
    (DSE_MHE_LOCAL_STORAGE(nx, ny, N) + 10 * (nx) * (nx) + DSE_MHE_CHAIN_STORAGE(nx, N))
#define DSE_MHE_LOCAL_PRICE_BOUNDED_STORAGE(nx, ny, N, active)                                     \
    (DSE_MHE_LOCAL_PRICE_STORAGE(nx, ny, N) + (nx) * (nx) +                                        \
     DSE_MHE_QP_STORAGE(nx, nx, N, active) + (2 * (N)-1) * 4 * (nx) * (nx) +                       \
     DSE_MHE_QP_STORAGE(2 * (nx), 0, N, active))
/* The one of these that holds for this configuration; 0: it is not valid. */
int dse_mhe_local_storage(const struct dse_mhe_local_config *config);

/* DSE_EINVAL: a value outside its range; DSE_ENOTPD: a weight; DSE_ENONFINITE; DSE_ESTORAGE. */
enum dse_status dse_mhe_local_init(struct dse_mhe_local *local,
                                   const struct dse_mhe_local_config *config,
                                   struct dse_arena *arena);

/* Sample k begins with its measurement (NULL: none came). k grows; the first call may be with any
 * k: an agent that starts late has a short window, works for itself until it is full and then takes
 * part. Samples that were left out count as samples without measurement. DSE_EINVAL: k is not
 * later than the sample before. */
enum dse_status dse_mhe_local_begin(struct dse_mhe_local *local, long k,
                                    const struct dse_measurement *measurement);
/* A measurement that belongs to the sample `age` samples before the newest; call before the first
 * solve of a sample. DSE_ENODATA: it has left the window; DSE_EINVAL: age < 0. */
enum dse_status dse_mhe_local_measure(struct dse_mhe_local *local, int age,
                                      const struct dse_measurement *measurement);

/* A message from the coordinator. DSE_ENODATA: of another sample or an earlier round, nothing has
 * changed; DSE_EFORMAT: it is not one of this scheme and window; DSE_ENONFINITE. */
enum dse_status dse_mhe_local_receive_down(struct dse_mhe_local *local, const dse_real *message,
                                           int count);
/* None came for this round. */
void dse_mhe_local_missing_down(struct dse_mhe_local *local);

/* Solves the local problem of this round. What does not succeed is said in the answer and in the
 * status. */
void dse_mhe_local_solve(struct dse_mhe_local *local);

/* The answer to the round: returns how many reals were written, at most DSE_MHE_UP_SIZE. */
int dse_mhe_local_message_up(struct dse_mhe_local *local, dse_real *message);

/* No more messages are due in this sample: the coordinator has said stop, or none takes part. */
bool dse_mhe_local_is_finished(const struct dse_mhe_local *local);

/* Ends the sample: the estimate and its status are set. May be called at any time after begin: a
 * coordinator that has gone silent cannot keep an agent from its estimate. */
void dse_mhe_local_finish(struct dse_mhe_local *local);

/* ---- the last finished sample ---- */
const dse_real *dse_mhe_local_state(const struct dse_mhe_local *local); /* nx: newest estimate */
long dse_mhe_local_sample(const struct dse_mhe_local *local);
const dse_real *dse_mhe_local_window(const struct dse_mhe_local *local); /* length x nx */
int dse_mhe_local_length(const struct dse_mhe_local *local);             /* H */
enum dse_mhe_status dse_mhe_local_status(const struct dse_mhe_local *local);
enum dse_health dse_mhe_local_health(const struct dse_mhe_local *local);
/* Rounds that were solved in this sample. */
int dse_mhe_local_iterations(const struct dse_mhe_local *local);
/* The last answer carried data (was not held back by the trigger). */
bool dse_mhe_local_has_sent(const struct dse_mhe_local *local);
/* Bounds that hold the last solution. */
int dse_mhe_local_active(const struct dse_mhe_local *local);
/* Largest residual of the optimality conditions of the last local problem, relative to the terms
 * that it consists of; from the data of the problem, not from factors. */
dse_real dse_mhe_local_certificate(const struct dse_mhe_local *local);
/* PRICE: J_i of the estimate's problem with its price terms, without the constant 1/2 Y'R^-1Y. */
dse_real dse_mhe_local_cost(const struct dse_mhe_local *local);
/* Covariance (nx x nx) of the newest estimate when it is one of its own (ALONE, LOCAL_ONLY) and no
 * bound is active; that of a coordinated estimate depends on the neighbours' data. DSE_ENODATA. */
enum dse_status dse_mhe_local_covariance(const struct dse_mhe_local *local, dse_real *P);

/* ================ coordinator ================ */

enum dse_mhe_outcome {
    DSE_MHE_CONTINUE = 0,          /* another round */
    DSE_MHE_OUTCOME_CONVERGED = 1, /* |E| <= eps or d < eps */
    DSE_MHE_OUTCOME_PREMATURE = 2, /* max_iter rounds, or dse_mhe_coordinator_stop */
    DSE_MHE_OUTCOME_SINGULAR = 3,  /* no agent's problem has a unique solution: D is needed */
    DSE_MHE_OUTCOME_STARTING = 4,  /* window shorter than min_horizon */
    DSE_MHE_OUTCOME_ALONE = 5,     /* nobody answers */
    /* PREDICTION: the rounds move apart, as they may where values are missing or bounds active
     * although the certificate of full windows is below 1. The agents give their decentralised
     * estimates; Anderson acceleration helps. */
    DSE_MHE_OUTCOME_DIVERGED = 6
};

enum dse_mhe_price_start { /* where the prices of a sample begin */
                           DSE_MHE_START_DEFAULT =
                               0, /* CLOSED_FORM with bounds, PREVIOUS without */
                           DSE_MHE_START_ZERO = 1,
                           DSE_MHE_START_PREVIOUS = 2, /* those of the sample before */
                           DSE_MHE_START_CLOSED_FORM =
                               3 /* the optimum without bounds: one more round */
};

struct dse_mhe_coordinator_config {
    const struct dse_mhe_settings *settings;
    int parts;                                  /* subsystems, > 0 */
    const struct dse_mhe_subsystem *subsystems; /* parts */
    const dse_real *A;                          /* n x n: the whole plant, n the sum of nx */
    dse_real eps;                               /* > 0 */
    int max_iter;                               /* rounds of a sample; 0 (default): 100 */
    bool fixed_iterations; /* exactly max_iter rounds, whatever the test says (section 5.3) */

    /* Which replies the stopping test needs. Default: the current one of every agent that is alive,
     * made with the current message. true: none, as in the source; unsafe when messages get lost.
     */
    bool stop_on_any;
    /* Rounds without an answer after which an agent counts as not alive; 0 (default): 8. One answer
     * makes it alive again. */
    int dead_after;

    /* -- PRICE -- */
    enum dse_mhe_price_start price_start;
    dse_real
        gradient_step; /* kappa > 0: p + kappa E (3.33) in place of Newton; 0 (default): Newton */
    /* Outer passes of proximal re-centring, 1/2 |h - h_ref|^2 with h_ref <- h, which remove the
     * bias of D: each costs one more round without bounds. 0 (default): none. */
    int recentrings;

    /* -- PREDICTION -- */
    bool shift; /* warm start of a full window: shifted by a sample; default: held as it is */
    /* Spectral radius of the consistent variant, p = Q^-1 G_A X: > 0 asks for that variant, which
     * is refused unless the number is below 1; 0 (default): the literal Algorithm 2. */
    dse_real consistent_certificate;
    dse_real relaxation; /* beta, 0 < beta <= 1, of the new interactions and prices; 0: 1 */
    int anderson; /* memory of Anderson acceleration, 8 is good; 0 (default): plain iteration */
    /* n each: weights of states and prices in its least squares; NULL: 1. */
    const dse_real *x_weight;
    const dse_real *p_weight;
};

/* How the dual function of the price-driven scheme bends, and what its matrices are made of. */
struct dse_mhe_dual {
    bool known;      /* for the window, the data and the agents at hand */
    dse_real *has;   /* N x ny of the plant, packed by length: outputs that the agents have; */
    dse_real *used;  /* the same and who took part (parts), when the matrix was made, */
    int used_length; /* and the length */
    int *last;       /* (N-1) n: where the rows of the matrices end, see dse_envelope_cholesky */
    /* Upper triangles of (N-1) n rows: */
    dse_real *matrix;            /* -Hd0 without bounds; its factor when nobody has bounds */
    dse_real *active;            /* with bounds: -Hd of the active bounds, */
    dse_real *factor;            /* and the factor of the sum that is stepped with */
    dse_real *bits;              /* active bounds, a bit map per subsystem */
    dse_real *column, *response; /* 2 N nx_max */
    dse_real *scratch;           /* 2 nx_max^2 */
    struct dse_mhe_chain chain;
    struct dse_mhe_outputs outputs;
    struct dse_mhe_penalty penalty, disturbance;
};

/* Prices: the point in use, the best one so far, and how the next one is found. */
struct dse_mhe_prices {
    dse_real *E; /* (N-1) n: of the point in use */
    dse_real *best, *best_E, *step;
    dse_real *reference; /* (N-1) n: h of the last re-centring */
    dse_real best_J, best_norm, tau;
    dse_real expected; /* E'd - 1/2 d'(-Hd)d */
    bool has_best;
    bool unbounded_round; /* the closed-form start */
    int recentred;
};

/* Anderson acceleration: past answers and how far each was from what had been asked. */
struct dse_mhe_anderson {
    int memory, count;
    dse_real *f, *r; /* (memory + 1) x (2 N - 1) n, the newest first */
    dse_real *QR;    /* (2 N - 1) n x memory: weighted differences of r */
    dse_real *b;     /* (2 N - 1) n */
    dse_real *tau, *gamma;
};

struct dse_mhe_coordinator {
    const struct dse_mhe_coordinator_config *config;
    const struct dse_mhe_settings *settings;
    int n, parts, N, ny, nx_max, ny_max;
    bool bounded;
    int max_iter, dead_after;
    int *first;           /* parts + 1: first state of each subsystem, */
    int *first_output;    /* parts + 1: and first output */
    int *neighbour_first; /* parts + 1: into */
    int *neighbour;       /* those that a subsystem is coupled with, in either direction */
    int *silent;          /* rounds without an answer */
    int *age;             /* samples since the data that are held */
    int *state;           /* bits: see lib/mhe/coordinator_internal.h */

    bool begun;
    long newest;
    int length, last_length; /* of the sample, of the one before (0: not optimised) */
    int round;
    int uplinks;
    enum dse_mhe_outcome outcome;
    dse_real error;
    dse_real first_error; /* the largest of the sample's first rounds */
    bool accepted;        /* the answers of the last round are the best so far */

    dse_real *asked; /* N n: X whose interactions the agents were given (PREDICTION), */
    dse_real *p;     /* (N-1) n: and the prices */
    dse_real *X;     /* N n: as last received */
    dse_real *other; /* (N-1) n: h_i (PRICE), lambda_i (PREDICTION), as last received */
    dse_real *J;     /* parts */
    dse_real *work;  /* N n + nx_max^2 */
    /* To go back to when an extrapolated interaction has made a problem infeasible: the last
     * question and its answers, (2 N - 1) n each. */
    dse_real *question, *answer;
    bool has_answer;
    dse_real relaxed;
    struct dse_mhe_dual dual;
    struct dse_mhe_prices prices;
    struct dse_mhe_anderson anderson;
};

/* Reals that dse_mhe_coordinator_init takes, for a plant of n states in `parts` subsystems with nx
 * states and ny outputs at most: prediction-driven with this Anderson memory (0: none); with
 * bounds; price-driven without and with bounds. ny_all: outputs of the plant. */
#define DSE_MHE_COORDINATOR_BASE(n, parts, nx, N)                                                  \
    (DSE_ARENA_INTS((parts) * (parts)) + 3 * DSE_ARENA_INTS((parts) + 1) +                         \
     3 * DSE_ARENA_INTS(parts) + (parts) + (5 * (N)-2) * (n) + 2 * (nx) * (nx))
#define DSE_MHE_COORDINATOR_PREDICTION_STORAGE(n, parts, nx, N, memory)                            \
    (DSE_MHE_COORDINATOR_BASE(n, parts, nx, N) +                                                   \
     ((memory) > 0 ? (3 * (memory) + 3) * (2 * (N)-1) * (n) + 2 * (memory) : 0))
#define DSE_MHE_COORDINATOR_PREDICTION_BOUNDED_STORAGE(n, parts, nx, N, memory)                    \
    (DSE_MHE_COORDINATOR_PREDICTION_STORAGE(n, parts, nx, N, memory) + 2 * (2 * (N)-1) * (n))
#define DSE_MHE_COORDINATOR_PRICE_STORAGE(n, parts, nx, ny, ny_all, N)                             \
    (DSE_MHE_COORDINATOR_BASE(n, parts, nx, N) + 2 * (N) * (ny_all) + (parts) +                    \
     5 * ((N)-1) * (n) + DSE_ARENA_INTS(((N)-1) * (n)) + ((N)-1) * (n) * ((N)-1) * (n) +           \
     2 * (N) * (nx) + 2 * (nx) * (nx) + DSE_MHE_CHAIN_STORAGE(nx, N) + 2 * (ny) * (ny) +           \
     2 * (ny) * (nx) + (ny) + 10 * (nx) * (nx))
#define DSE_MHE_COORDINATOR_PRICE_BOUNDED_STORAGE(n, parts, nx, ny, ny_all, N)                     \
    (DSE_MHE_COORDINATOR_PRICE_STORAGE(n, parts, nx, ny, ny_all, N) +                              \
     2 * ((N)-1) * (n) * ((N)-1) * (n) + (parts)*DSE_MHE_BIT_WORDS((2 * (N)-1) * (nx)) +           \
     2 * (N) * (nx) + DSE_MHE_CHAIN_STORAGE(2 * (nx), N) - DSE_MHE_CHAIN_STORAGE(nx, N))
/* The one of these that holds for this configuration; 0: it is not valid. */
int dse_mhe_coordinator_storage(const struct dse_mhe_coordinator_config *config);

/* DSE_EINVAL: also the consistent variant without its certificate; DSE_ENOTPD; DSE_ENONFINITE;
 * DSE_ESTORAGE. */
enum dse_status dse_mhe_coordinator_init(struct dse_mhe_coordinator *coordinator,
                                         const struct dse_mhe_coordinator_config *config,
                                         struct dse_arena *arena);

/* Sample k begins. Any first k: what is not known of the past is zero. DSE_EINVAL: k is not later
 * than the sample before. */
enum dse_status dse_mhe_coordinator_begin(struct dse_mhe_coordinator *coordinator, long k);

/* The message of this round to agent i, or the final one: returns how many reals were written, at
 * most DSE_MHE_DOWN_SIZE of that subsystem. */
int dse_mhe_coordinator_message_down(struct dse_mhe_coordinator *coordinator, int i,
                                     dse_real *message);

/* The answer of agent i. DSE_ENODATA: of another sample or round (nothing has changed);
 * DSE_EFORMAT, DSE_ENONFINITE: not used, the agent counts as not heard in this round. */
enum dse_status dse_mhe_coordinator_receive_up(struct dse_mhe_coordinator *coordinator, int i,
                                               const dse_real *message, int count);
/* No answer of agent i came in this round. (Those neither received nor missing count as missing.)
 */
void dse_mhe_coordinator_missing_up(struct dse_mhe_coordinator *coordinator, int i);

/* Ends the round. */
enum dse_mhe_outcome dse_mhe_coordinator_advance(struct dse_mhe_coordinator *coordinator);
/* The time is up: the sample ends with what there is. */
void dse_mhe_coordinator_stop(struct dse_mhe_coordinator *coordinator);

/* ---- the sample that runs, or the last one ---- */
enum dse_mhe_outcome dse_mhe_coordinator_outcome(const struct dse_mhe_coordinator *coordinator);
int dse_mhe_coordinator_length(const struct dse_mhe_coordinator *coordinator);     /* H */
int dse_mhe_coordinator_iterations(const struct dse_mhe_coordinator *coordinator); /* rounds done */
/* |E| of the price-driven, d of the prediction-driven scheme after the last round. */
dse_real dse_mhe_coordinator_error(const struct dse_mhe_coordinator *coordinator);
/* X_i (H nx) as last received, NULL: agent i is not alive and nothing is held. */
const dse_real *dse_mhe_coordinator_window(const struct dse_mhe_coordinator *coordinator, int i);
/* The prices, stacked ((H-1) n). */
const dse_real *dse_mhe_coordinator_price(const struct dse_mhe_coordinator *coordinator);
bool dse_mhe_coordinator_hears(const struct dse_mhe_coordinator *coordinator, int i); /* alive */
/* Answers with data in this sample. */
int dse_mhe_coordinator_uplinks(const struct dse_mhe_coordinator *coordinator);

/* ================ offline ================ */

/* Open-loop prediction of the plant: for `steps` samples from 0 on, the part of subsystem i into
 * start (steps x nx_i). n: states of the plant; from: first state of the subsystem. scratch: 2 n.
 */
void dse_mhe_open_loop(int n, const dse_real *A, const dse_real *x0, int steps, int from, int nx,
                       dse_real *start, dse_real *scratch);

/* cost (n x n) = A_off' D^-1 A_off, A_off the part of A that couples subsystems: as stage_cost of
 * an agent alone with the whole plant it makes the estimate to which the price-driven scheme
 * converges
 * ("centralised with D", (Psi + Th'D^-1Th) X = c). scratch: n n + nx_max nx_max.
 * DSE_ENOTPD; DSE_EINVAL: a subsystem without D. */
enum dse_status dse_mhe_interaction_cost(int n, const dse_real *A, int parts,
                                         const struct dse_mhe_subsystem *subsystems, dse_real *cost,
                                         dse_real *scratch);

#endif
