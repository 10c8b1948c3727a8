/* Distributed adaptive high-gain extended Kalman filter: filter i of a network of p.
 *
 * Each filter carries its own picture of the whole state; block i of it is its estimate, the other
 * blocks come from the neighbours' messages and, between messages, from the model:
 *
 *     z_i' = A_i z_i + b_i(z, u) + K_i (y_i - C_i z_i),   K_i = P_i C_i' R_th^-1        (2.6, 3.10)
 *     P_i' = F_i P_i + P_i F_i' + Q_th - K_i C_i P_i,     F_i = A_i + b_i*              (A.28)
 *
 * R_th, Q_th are weighted by the gain theta, which rises when the innovation J over a past horizon
 * says that the estimate is wrong, and returns to 1. p such objects and a loop are the distributed
 * scheme in one process; with the messages on a bus it is the same scheme in p processes.
 *
 *     dse_high_gain_ekf_begin(&f, k, t_k, u, &y);       the estimate of t_k may be read now
 *     for (int r = 0; r < dse_high_gain_ekf_rounds(&f); r++) {
 *         count = dse_high_gain_ekf_message(&f, r, out);      -> to the neighbours
 *         dse_high_gain_ekf_receive(&f, r, j, in, count);     for every j that was heard
 *         dse_high_gain_ekf_advance(&f, r);
 *     }
 *     dse_high_gain_ekf_finish(&f);                     now at t_{k+1}
 *
 * Equation numbers are those of the adaptive high-gain source; the discretisation (one Runge-Kutta
 * step per tick, measurement and theta held, exact sub-flows for theta) is that of its spec,
 * sections 4.3 to 4.6. */
#ifndef DSE_HIGH_GAIN_EKF_H
#define DSE_HIGH_GAIN_EKF_H

#include <stdbool.h>
#include <stdint.h>

#include "dse/arena.h"
#include "dse/health.h"
#include "dse/model.h"
#include "dse/normal_form.h"
#include "dse/real.h"
#include "dse/status.h"

/* ---- the gain (2.8, 2.9) ---- */

/* theta' = mu(J) D(theta) + (1 - mu(J)) lambda (1 - theta),  mu(s) = 1/(1 + exp(-beta (s - m))) */
struct dse_gain_adaptation {
    dse_real theta_m;    /* half of the largest theta, > 0.5: theta stays in [1, 2 theta_m] */
    dse_real rise_time;  /* DeltaT, plant time, > 0 */
    dse_real relaxation; /* lambda, 1 / plant time, >= 0 */
    dse_real sharpness;  /* beta, 1 / unit of J, > 0 */
    dse_real threshold;  /* m, unit of J: (output unit)^2 times plant time */
};

/* mu(J). */
dse_real dse_gain_adaptation_mu(const struct dse_gain_adaptation *adaptation, dse_real J);
/* theta after a time h with J held, from theta in [1, 2 theta_m]. */
dse_real dse_gain_adaptation_step(const struct dse_gain_adaptation *adaptation, dse_real h,
                                  dse_real J, dse_real theta);

/* ---- configuration ---- */

/* Where the filter lives (spec 4.1). */
enum dse_high_gain_coords {
    DSE_HIGH_GAIN_NORMAL = 0,  /* state z_i */
    DSE_HIGH_GAIN_MAPPED = 1,  /* state chi_i, correction M_i^-1 K_i e, Riccati in z_i */
    DSE_HIGH_GAIN_PHYSICAL = 2 /* state chi_i, Riccati with df_i/dchi_i, no normal form needed */
};

/* How theta enters the weights (spec 4.2); n* is the largest n_i. */
enum dse_high_gain_scaling {
    /* R_th = R theta^{2(n*-n_i)}/theta, Q_th = theta Theta_i^-1 Q Theta_i^-1   (2.6, 2.7) */
    DSE_HIGH_GAIN_FULL = 0,
    /* R_th = R/theta, Q_th = theta Q                                           (3.10, 3.11) */
    DSE_HIGH_GAIN_PLAIN = 1
};

enum dse_high_gain_gain {
    DSE_HIGH_GAIN_ADAPT = 0,
    DSE_HIGH_GAIN_ONE = 1, /* theta = 1: the regular distributed EKF */
    DSE_HIGH_GAIN_MAX = 2  /* theta = 2 theta_m: the permanent high gain */
};

/* Which innovation drives theta. */
enum dse_high_gain_innovation {
    DSE_HIGH_GAIN_OWN = 0, /* J_i                                            (3.14) */
    DSE_HIGH_GAIN_SUM = 1  /* the sum of all J_j, exchanged in every tick    (2.10, 5.4) */
};

enum dse_high_gain_communication {
    /* one exchange of {J_i, z_i} every comm_every_ticks ticks */
    DSE_HIGH_GAIN_TICK = 0,
    /* an exchange at every stage of the Runge-Kutta step, four rounds per tick: all filters
     * integrate one common picture, which is the source's continuous communication */
    DSE_HIGH_GAIN_STAGES = 1,
    /* never; a decentralised filter */
    DSE_HIGH_GAIN_NONE = 2
};

/* What happens to the neighbours' blocks between messages. */
enum dse_high_gain_predictor {
    DSE_HIGH_GAIN_PREDICT = 0, /* they follow the model (3.7) */
    DSE_HIGH_GAIN_HOLD = 1     /* they stay as last received */
};

/* Zero is the default where one is named; everything else has to be set. Model, form, arrays and
 * the configuration itself must outlive the filter. */
struct dse_high_gain_ekf_config {
    const struct dse_model *model; /* the whole plant, continuous, ny >= p; output i is measured by
                                    * subsystem i; dfdx is needed for physical coordinates */
    const struct dse_normal_form *form; /* the blocks, and the maps of the coordinates; physical
                                         * coordinates use only n, p, n_i, nu, rates and take the
                                         * first state of each block as its output */
    int i;                              /* this filter's subsystem, 0..p-1 */
    dse_real period;                    /* T_s, one tick in plant time, > 0 */

    enum dse_high_gain_coords coords;
    enum dse_high_gain_scaling scaling;
    enum dse_high_gain_gain gain;
    enum dse_high_gain_innovation innovation;
    enum dse_high_gain_communication communication;
    enum dse_high_gain_predictor predictor; /* must be PREDICT with STAGES */
    int comm_every_ticks;                   /* >= 1; 0 means 1; must be 1 with STAGES */

    const dse_real *x0; /* n: the guess of the whole physical state that all filters share */
    const dse_real *P0; /* n_i x n_i, symmetric positive definite, in the Riccati coordinates */
    const dse_real *Q;  /* n_i x n_i, symmetric, at theta = 1, per plant time */
    dse_real R;         /* > 0, measurement weight at theta = 1, (output unit)^2 times plant time */
    struct dse_gain_adaptation
        adaptation; /* only theta_m is used with gain MAX, nothing with ONE */
    int horizon; /* N_d = d/T_s ticks, >= 1; 0: no innovation is computed, not allowed with ADAPT */
};

/* ---- the filter ---- */

/* What a runtime counts beside the health. */
struct dse_high_gain_ekf_counters {
    int64_t ticks;                /* finished */
    int64_t failed_ticks;         /* given up; the state stayed as it was */
    int64_t missing_measurements; /* ticks without a usable own measurement */
    int64_t missing_states;       /* blocks of neighbours that were due and did not come */
    int64_t missing_innovations;  /* J_j that were due and did not come: the last one was used */
    int64_t refused;              /* messages with a wrong count, sender or number */
    int64_t duplicates;           /* second messages of one sender in one round; ignored */
    int64_t frozen_predictions;   /* steps of past predictions that could not be made: held */
};

struct dse_high_gain_ekf {
    const struct dse_high_gain_ekf_config *config;
    int n, p, n_i, offset; /* sizes, and where block i begins */
    int n_max;             /* n* */

    /* committed: at t_k before a tick, at t_{k+1} after it */
    bool started;     /* false: x is the physical guess */
    bool measured;    /* a measurement has been used */
    dse_real *x;      /* n: the picture */
    dse_real *P;      /* n_i x n_i */
    dse_real *u_next; /* nu: the inputs that x is encoded with */
    dse_real theta;
    int64_t slot; /* number of finished ticks, for the ring */

    /* the tick under way */
    bool open;
    int round, rounds;
    bool state_due; /* the messages of round 0 carry states */
    int64_t sample;
    dse_real t, y;
    bool has_y;
    dse_real *u, *du, *u_stage; /* nu: inputs at t_k, their rates, inputs at the stage */
    bool moving;                /* some rate is not zero */
    dse_real theta_tick;        /* theta of this tick */
    dse_real R_th, *Q_th;       /* weights of this tick */
    dse_real J_own, J_drive;
    dse_real output_error; /* y_i - C_i z_i at t_k */
    dse_real *base;        /* n: the picture at t_k with the messages in */
    dse_real *xs, *Ps;     /* the stage's point */
    dse_real *kx, *kP;     /* its derivative */
    dse_real *sx, *sP;     /* weighted sum of the derivatives */

    /* neighbours */
    dse_real *inbox; /* n: blocks received in this round */
    dse_real *J;     /* p: last known J_j */
    int *received;   /* p: reals received in this round from j */

    /* what is reported about t_k, physical */
    dse_real *estimate;            /* n_i */
    dse_real *estimate_covariance; /* n_i x n_i */

    /* past predictions: horizon + 1 slots of n + 1 reals, state and accumulated square */
    dse_real *ring;

    /* scratch */
    dse_real *chi, *z, *y_all, *F, *FP, *M, *K, *dfdx, *rk;
    int *pivots;

    enum dse_health health;
    struct dse_high_gain_ekf_counters counters;
};

/* Reals for a filter: n states, nu inputs and ny outputs of the whole plant, p subsystems, n_i own
 * states, horizon N_d. */
#define DSE_HIGH_GAIN_EKF_STORAGE(n, nu, ny, p, n_i, N_d)                                          \
    (11 * (n) + (n) * (n) + 9 * (n_i) * (n_i) + 2 * (n_i) + 4 * (nu) + (ny) + (p) +                \
     DSE_ARENA_INTS(p) + DSE_ARENA_INTS(n_i) + ((N_d) + 1) * ((n) + 1))

/* Reals in the longest message of a filter with n_i states. Round 0: {J_i} or {J_i, state_i};
 * rounds 1 to 3: the state of the stage. */
#define DSE_HIGH_GAIN_EKF_MESSAGE(n_i) (1 + (n_i))

/* DSE_EINVAL: a value outside its range or a combination that is not allowed; DSE_EDIM: model and
 * form do not fit; DSE_ENONFINITE, DSE_ENOTPD: guess or weights; DSE_ESTORAGE. */
enum dse_status dse_high_gain_ekf_init(struct dse_high_gain_ekf *filter,
                                       const struct dse_high_gain_ekf_config *config,
                                       struct dse_arena *arena);

/* Opens the tick of sample k at time t with inputs u (nu) and the own measurement (1 channel;
 * missing, NaN or NULL: the tick is predicted without correction and contributes nothing to J).
 * Samples with k divisible by comm_every_ticks communicate. A tick left open is dropped. */
enum dse_status dse_high_gain_ekf_begin(struct dse_high_gain_ekf *filter, int64_t k, dse_real t,
                                        const dse_real *u,
                                        const struct dse_measurement *measurement);

/* Exchanges in this tick: 0, 1, or 4 with STAGES. */
int dse_high_gain_ekf_rounds(const struct dse_high_gain_ekf *filter);

/* What filter i has to say in this round into out (DSE_HIGH_GAIN_EKF_MESSAGE(n_i)); returns the
 * count, 0 when it is not the time of this round. */
int dse_high_gain_ekf_message(const struct dse_high_gain_ekf *filter, int round, dse_real *out);

/* Takes in what filter j said in this round. The order of the calls does not matter; a second
 * message of one sender is ignored. DSE_EINVAL: not this round, or no such neighbour; DSE_EFORMAT:
 * wrong count; DSE_ENONFINITE. What is refused changes nothing but the counter. */
enum dse_status dse_high_gain_ekf_receive(struct dse_high_gain_ekf *filter, int round, int j,
                                          const dse_real *message, int count);

/* Closes the round. Neighbours that were not heard are predicted (or held) and counted. */
enum dse_status dse_high_gain_ekf_advance(struct dse_high_gain_ekf *filter, int round);

/* The rest of the tick, up to t_{k+1}. On failure here or above (DSE_EMODEL, DSE_ENONFINITE,
 * DSE_ENOTPD, DSE_ESINGULAR) the state stays as it was at t_k, the health is DIVERGED and the tick
 * is closed; the next begin tries again from there. */
enum dse_status dse_high_gain_ekf_finish(struct dse_high_gain_ekf *filter);

/* Physical estimate of the own subsystem (n_i) at the t_k of the last begin, before the messages
 * and the measurement of t_k; with STAGES it is that of the common picture and valid after
 * advance(0). */
const dse_real *dse_high_gain_ekf_estimate(const struct dse_high_gain_ekf *filter);
/* Its covariance P_i (n_i x n_i) in physical coordinates, M_i^-1 P_i M_i^-T. */
const dse_real *dse_high_gain_ekf_estimate_covariance(const struct dse_high_gain_ekf *filter);
/* The picture (n) of the whole state in the filter's coordinates; after finish at t_{k+1}. Until
 * the first finish: the physical guess. */
const dse_real *dse_high_gain_ekf_picture(const struct dse_high_gain_ekf *filter);
/* P_i (n_i x n_i) in the Riccati coordinates; after finish at t_{k+1}. */
const dse_real *dse_high_gain_ekf_covariance(const struct dse_high_gain_ekf *filter);
/* theta of the last tick (after its update). */
dse_real dse_high_gain_ekf_theta(const struct dse_high_gain_ekf *filter);
/* J_i of the last tick, and the J that drove theta. */
dse_real dse_high_gain_ekf_innovation(const struct dse_high_gain_ekf *filter);
dse_real dse_high_gain_ekf_drive(const struct dse_high_gain_ekf *filter);
/* y_i - yhat_i at t_k, of the corrected picture; 0 when there was no measurement. */
dse_real dse_high_gain_ekf_output_error(const struct dse_high_gain_ekf *filter);
enum dse_health dse_high_gain_ekf_health(const struct dse_high_gain_ekf *filter);
const struct dse_high_gain_ekf_counters *
dse_high_gain_ekf_counters(const struct dse_high_gain_ekf *filter);

/* ---- for tests and design: the weights at a given theta ---- */

/* R_th (1) and Q_th (n_i x n_i) of section 4.2. */
void dse_high_gain_weights(enum dse_high_gain_scaling scaling, int n_i, int n_max, dse_real theta,
                           dse_real R, const dse_real *Q, dse_real *R_th, dse_real *Q_th);

#endif
