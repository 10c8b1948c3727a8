/* Moving horizon estimation for a linear time-invariant model, with and without bounds:
 *
 *     x(k+1) = A x(k) + B u(k) + w,   w ~ N(0, Q)      y(k) = C x(k) + D u(k) + v,   v ~ N(0, R)
 *
 * Over the last H = min(k + 1, N) samples the states x_0 .. x_{H-1} (oldest first) minimise
 *
 *     1/2 |x_0 - xbar|^2_{P^-1}  +  1/2 sum_j |w_j|^2_{Q^-1}  +  1/2 sum_j |y_j - C x_j - D
 * u_j|^2_{R^-1}
 *
 * with w_j = x_{j+1} - A x_j - B u_j. The window grows from one sample to N and slides then; the
 * first term, the arrival cost, stands for what has left it. Q and P may be singular: where Q^-1 or
 * P^-1 do not exist, the disturbance or the deviation is held to zero in those directions.
 *
 * Solved by a backward Riccati recursion in square-root form on the block-tridiagonal optimality
 * system: Q and A are never inverted, the effort is linear in N, and as long as no value is missing
 * the factors are those made at init. Every solution is judged by its optimality residual, computed
 * from the data of the problem and not from the factors.
 *
 *     static dse_real memory[DSE_LINEAR_MHE_STORAGE(4, 2, 10)];
 *     struct dse_arena arena;
 *     struct dse_linear_mhe mhe;
 *     dse_arena_init(&arena, memory, DSE_LINEAR_MHE_STORAGE(4, 2, 10));
 *     dse_linear_mhe_init(&mhe, &config, &arena);
 *     for each sample:
 *         dse_linear_mhe_advance(&mhe, u_before);         (not before the first one)
 *         dse_linear_mhe_measure(&mhe, 0, u, &measurement);
 *         dse_linear_mhe_measure(&mhe, 3, u, &late);      (a sample of three samples ago)
 *         dse_linear_mhe_solve(&mhe);
 *
 * Bounds on states and disturbances, x_min <= x_j <= x_max and w_min <= w_j <= w_max, are handled
 * by their active set on the same factors (dse/active_set.h): where no bound is active, the result
 * is that without bounds, bit for bit. When no window satisfies them, or the search fails, the
 * estimate is, in this order, the last solution moved on by the model, if that satisfies the bounds
 * (DSE_HEALTH_COASTING), or the solution without bounds (DSE_HEALTH_REJECTING: the bounds, here).
 *
 * A step that fails leaves the estimate as it was. */
#ifndef DSE_LINEAR_MHE_H
#define DSE_LINEAR_MHE_H

#include <stdbool.h>

#include "dse/active_set.h"
#include "dse/arena.h"
#include "dse/factored.h"
#include "dse/health.h"
#include "dse/model.h"
#include "dse/real.h"
#include "dse/status.h"

/* What stands for the samples that have left the window. */
enum dse_arrival {
    /* xbar and P move on by a Kalman step over each sample that leaves: nothing is lost, and the
     * newest estimate is that of the Kalman filter. */
    DSE_ARRIVAL_KALMAN = 0,
    /* P is always P0; xbar is x0 while the window grows, then A x + B u of the estimate x that was
     * given for the last sample that left when it was the newest. */
    DSE_ARRIVAL_CONSTANT = 1,
    /* No such term. The window alone must determine the states: (A, C) observable within it. */
    DSE_ARRIVAL_NONE = 2
};

/* Config and all that it points to must outlive the estimator. */
struct dse_linear_mhe_config {
    int nx, nu, ny;           /* > 0, >= 0, > 0 */
    struct dse_linear linear; /* A, B, C, D, discrete; B may be NULL when nu = 0, D always */
    int horizon;              /* N >= 1: samples in a full window */
    enum dse_arrival arrival; /* default: DSE_ARRIVAL_KALMAN */
    /* DSE_ARRIVAL_NONE: shorter windows are not solved, their states are the prediction from x0.
     * 0 .. N; 0 (default): nx, but at most N. */
    int min_horizon;
    const dse_real *x0; /* nx: estimate of the first state; NULL: zero */
    const dse_real *P0; /* nx x nx: its covariance, positive semidefinite; not read when NONE */
    const dse_real *Q;  /* nx x nx, positive semidefinite; NULL: no disturbance */
    const dse_real *R;  /* ny x ny, positive definite */
    /* A solution whose certificate is larger is refused. > 0; 0 (default): the square root of the
     * machine's precision. Correct solutions have certificates of about the precision itself. */
    dse_real tolerance;
    /* nx each, a bound at or beyond +-DSE_REAL_MAX is none; NULL (default): none at all. Neither
     * the arrival cost nor the prediction of a window that is too short knows of them. */
    const dse_real *x_min, *x_max; /* of all states of the window */
    const dse_real *w_min, *w_max; /* of all disturbances within it */
    int max_active; /* bounds that can be active at once; 0 (default): N nx, which is all */
};

/* How far a solution is from optimal. */
struct dse_linear_mhe_parts {
    dse_real dual;   /* of the optimality equations, see dse_linear_mhe_certify */
    dse_real primal; /* the largest violation of a bound, relative to the size of its terms */
    dse_real gap;    /* of multipliers times distances from their bounds, relative to their size */
};

/* Totals since init. */
struct dse_linear_mhe_counts {
    long solved;
    long failed;
    long refinements; /* solutions corrected by their own residual */
    long used;        /* values taken into the window */
    long late;        /* those of them that belong to an earlier sample than the newest */
    long replaced;    /* those of them that took the place of an earlier value of that channel */
    long missing;     /* flagged invalid */
    long nonfinite;   /* flagged valid, but NaN or infinite: treated as missing */
    long outdated;    /* samples refused because they have left the window */
    long bounded;     /* solutions with an active bound */
    long infeasible;  /* windows that no states satisfy */
    long fallbacks;   /* windows whose bounds could not be kept, those among them */
};

/* Cost to go of the newest samples of a window, 1/2 |T x - ..|^2, as a function of the state x of
 * the oldest of them; given x, the next state is F x + .. with covariance S, all data considered.
 */
struct dse_linear_mhe_stage {
    dse_real *T; /* nx x nx, upper triangular */
    dse_real *F; /* nx x nx */
    dse_real *S; /* nx x nx, positive semidefinite */
};

struct dse_linear_mhe {
    const struct dse_linear_mhe_config *config;
    int nx, nu, ny, N;
    int min_horizon;
    int rank;         /* of Q */
    bool Q_diagonal;  /* so that Q x costs nx products */
    long newest;      /* number of the newest sample; 0 after init, */
    int newest_place; /* and where it is in the ring */
    int length;       /* H */
    int incomplete;   /* samples of the window that lack a value */

    dse_real *V;            /* rank x nx: Q = V' V */
    dse_real *L;            /* ny x ny: R = L L' */
    dse_real *E;            /* ny x nx: L^-1 C */
    dse_real *A_transposed; /* for products with many states at once */
    dse_real *E_transposed;
    /* nx x nx: I + |A|' + .. + (|A|')^{N-1}: how rounding spreads through the multipliers */
    dse_real *spread;

    /* Arrival cost: the prior of the oldest sample of the window. */
    dse_real *xbar;
    dse_real *xbar_next;
    dse_real *prior_T; /* P = T' diag(d) T, see dse/factored.h */
    dse_real *prior_d;
    dse_real *prior_V; /* prior_rank x nx: P = V' V */
    int prior_rank;

    /* Samples, in a ring: sample k is in place k modulo N. */
    dse_real *y;     /* ny: y - D u */
    dse_real *has;   /* ny: 1 where there is a value, else 0 */
    dse_real *white; /* ny: L^-1 (y - D u); L of the channels that there are, the others are 0 */
    dse_real *rows;  /* ny x nx: L^-1 C likewise; not kept for a complete sample, where it is E */
    dse_real *c;     /* nx: C' R^-1 (y - D u) */
    dse_real *b;     /* nx: B u of the transition to this sample */
    dse_real *past;  /* nx: estimate of this sample when it was the newest */

    /* Factors for each distance 0 .. N-1 from the newest sample: for complete samples, made at
     * init, and from the newest incomplete sample on, made when they are needed. */
    dse_real *complete;
    dse_real *partial;
    int partial_from; /* the smallest distance where `partial` is to be used */
    dse_real *start;  /* start_rank x nx: covariance of x_0 = start' start (not when NONE) */
    int start_rank;
    int start_length; /* the window length that `start` is good for, 0: none */

    dse_real *x;        /* N x nx: states of the last solution, oldest first, */
    dse_real *x_next;   /* and of the one that is being made */
    dse_real *g;        /* N x nx */
    dse_real *lambda;   /* N x nx */
    dse_real *residual; /* N x nx */
    dse_real *errors;   /* N x ny */
    dse_real *scratch;

    /* With bounds only. */
    bool bounded;
    struct dse_active_set set;
    struct dse_window_bounds bounds;
    dse_real *minus_A;   /* nx x nx */
    dse_real *lower;     /* N x nx: x_min, repeated */
    dse_real *upper;     /* N x nx */
    dse_real *w_lower;   /* N x nx: w_min + b */
    dse_real *w_upper;   /* N x nx */
    dse_real *free;      /* N x nx: the solution without bounds */
    dse_real *product;   /* nx x DSE_ACTIVE_SET_BATCH */
    dse_real *product_S; /* nx x DSE_ACTIVE_SET_BATCH */
    dse_real *forces;    /* N x 2 nx: multipliers by constraint, of x_next */
    long set_newest;     /* newest sample of the window that the set belongs to */
    int set_length;      /* its length */
    bool factors_new;    /* the factors have been made again since the columns of the set */
    struct dse_linear_mhe_parts parts;
    enum dse_active_set_path path;

    long solved_newest;    /* newest sample of the last solution, */
    int solved_length;     /* its length, 0 when there is none */
    bool solved_by_window; /* not merely predicted */
    bool factors_hold;     /* the factors are still those of the last solution */
    dse_real certificate;
    enum dse_health health;
    struct dse_linear_mhe_counts counts;
};

#define DSE_LINEAR_MHE_LARGER(a, b) ((a) > (b) ? (a) : (b))
/* The array of a Riccati step and its reflectors; the Kalman step of the arrival cost; whitening;
 * sizes of terms for the certificate. */
#define DSE_LINEAR_MHE_SCRATCH_FACTOR(nx, ny) ((2 * (nx) + (ny)) * 2 * (nx) + 2 * (nx))
#define DSE_LINEAR_MHE_SCRATCH_ARRIVAL(nx, ny)                                                     \
    (DSE_FACTORED_SIZE(nx) + 2 * (nx) + (nx)*DSE_FACTORED_STRIDE(ny) + 2 * (ny) +                  \
     DSE_LINEAR_MHE_LARGER((nx)*DSE_FACTORED_STRIDE(ny),                                           \
                           DSE_LINEAR_MHE_LARGER(DSE_FACTORED_UPDATE_SCRATCH(nx, ny),              \
                                                 DSE_FACTORED_PREDICT_SCRATCH(nx))))
#define DSE_LINEAR_MHE_SCRATCH_REST(nx, ny) ((ny) * (ny) + (ny) + 5 * (nx))
#define DSE_LINEAR_MHE_SCRATCH(nx, ny)                                                             \
    DSE_LINEAR_MHE_LARGER(DSE_LINEAR_MHE_SCRATCH_FACTOR(nx, ny),                                   \
                          DSE_LINEAR_MHE_LARGER(DSE_LINEAR_MHE_SCRATCH_ARRIVAL(nx, ny),            \
                                                DSE_LINEAR_MHE_SCRATCH_REST(nx, ny)))
/* Reals that dse_linear_mhe_init takes. */
#define DSE_LINEAR_MHE_STORAGE(nx, ny, N)                                                          \
    (5 * (nx) * (nx) + (ny) * (ny) + 2 * (ny) * (nx) + DSE_FACTORED_SIZE(nx) + 3 * (nx) +          \
     (N) * (4 * (ny) + (ny) * (nx) + 8 * (nx) + 6 * (nx) * (nx)) + DSE_LINEAR_MHE_SCRATCH(nx, ny))

/* The same with bounds of which max_active (not 0 here) can be active at once. */
#define DSE_LINEAR_MHE_BOUNDED_STORAGE(nx, ny, N, max_active)                                      \
    (DSE_LINEAR_MHE_STORAGE(nx, ny, N) + DSE_ACTIVE_SET_STORAGE(nx, nx, N, max_active) +           \
     (nx) * ((nx) + 7 * (N) + 2 * DSE_ACTIVE_SET_BATCH))

/* The window then holds one sample, number 0, without data. DSE_EINVAL: a value outside its range,
 * a matrix that is missing or not symmetric; DSE_ENOTPD: P0, Q or R; DSE_ENONFINITE; DSE_ESTORAGE.
 */
enum dse_status dse_linear_mhe_init(struct dse_linear_mhe *mhe,
                                    const struct dse_linear_mhe_config *config,
                                    struct dse_arena *arena);

/* A new sample begins, reached from the newest one with input u (nu). A full window slides: its
 * oldest sample goes into the arrival cost. DSE_ENONFINITE, DSE_ENOTPD: nothing has changed. */
enum dse_status dse_linear_mhe_advance(struct dse_linear_mhe *mhe, const dse_real *u);

/* Values of the sample that is `age` samples older than the newest, taken with input u (nu, read
 * only when there is a D). Channels that are missing or not finite leave what is there as it is; a
 * value that comes again replaces the earlier one. DSE_ENODATA: the sample has left the window (or
 * was before its start), nothing has changed; DSE_EINVAL: age < 0; DSE_ENONFINITE: u. */
enum dse_status dse_linear_mhe_measure(struct dse_linear_mhe *mhe, int age, const dse_real *u,
                                       const struct dse_measurement *measurement);

/* Estimates the states of the window from all that is in it now. DSE_ESINGULAR: the data at hand do
 * not determine the states (arrival NONE); DSE_ENOCONV: certificate above the tolerance;
 * DSE_ENONFINITE, DSE_ENOTPD. */
enum dse_status dse_linear_mhe_solve(struct dse_linear_mhe *mhe);

/* ---- the last solution; valid until the next successful solve ---- */

/* The newest estimate (nx), and the number of the sample that it belongs to: 0 is the first. Before
 * the first solve: x0 and 0. */
const dse_real *dse_linear_mhe_state(const struct dse_linear_mhe *mhe);
long dse_linear_mhe_sample(const struct dse_linear_mhe *mhe);
/* All states of the window (length x nx), oldest first, the newest last. */
const dse_real *dse_linear_mhe_window(const struct dse_linear_mhe *mhe);
int dse_linear_mhe_length(const struct dse_linear_mhe *mhe);
/* Covariance (nx x nx) of the newest estimate: correct with the arrival cost KALMAN, else on the
 * assumption that the arrival cost is. Effort: about a product of matrices per sample. DSE_ENODATA:
 * the states are mere prediction, or a solve has failed since. */
enum dse_status dse_linear_mhe_covariance(struct dse_linear_mhe *mhe, dse_real *P);

/* The certificate of the last solution: how far it is from optimal, the largest of its parts. */
dse_real dse_linear_mhe_certificate(const struct dse_linear_mhe *mhe);
struct dse_linear_mhe_parts dse_linear_mhe_parts(const struct dse_linear_mhe *mhe);
/* How the last solution met its bounds; DSE_PATH_SWAPS also when there are none. */
enum dse_active_set_path dse_linear_mhe_path(const struct dse_linear_mhe *mhe);
/* Whether a bound of entry i of state j (oldest first), or with i - nx of the disturbance from j to
 * j + 1, was active in it: -1 the lower, 1 the upper, 0 none. */
int dse_linear_mhe_active(const struct dse_linear_mhe *mhe, int j, int i);
/* The certificate of any states x (H x nx) for the window as it is now, H its present length. With
 * the multipliers of the model that make the gradient with respect to all states zero,
 *
 *     lambda_{j-1} = C' R^-1 (y_j - D u_j - C x_j) + A' lambda_j,   lambda_{H-1} = 0,
 *
 * x is optimal if and only if
 *
 *     x_{j+1} - A x_j - B u_j = Q lambda_j,   x_0 - xbar = P lambda_{-1}  (NONE: lambda_{-1} = 0).
 *
 * The result is the largest residual of these equations over the window, for each state relative to
 * the size of the terms of which it consists; rounding alone makes it a few times the precision.
 * Needs no factorisation. */
dse_real dse_linear_mhe_certify(struct dse_linear_mhe *mhe, const dse_real *x);

/* Initialising until a window is solved with data in it; coasting when the newest sample has no
 * value or the last feasible solution is held; rejecting when bounds are; unobservable or diverged
 * after a failed solve. */
enum dse_health dse_linear_mhe_health(const struct dse_linear_mhe *mhe);
const struct dse_linear_mhe_counts *dse_linear_mhe_counts(const struct dse_linear_mhe *mhe);

#endif
