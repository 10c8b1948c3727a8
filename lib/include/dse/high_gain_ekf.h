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
 * States may come late or not at all. They carry stamps; a filter keeps its pictures of the last D
 * communication instants, and whatever arrives corrects the picture of its own instant, from which
 * the model then runs forward again to t_k (4.4). An adapter or a test hands such states in by
 *
 *     dse_high_gain_ekf_deliver(&f, j, stamp, state, count);   after begin, before advance(0)
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
#include "dse/link.h"
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
    /* one exchange of {J_i, z_i} every comm_every_ticks ticks; with max_delay > 0 states may come
     * up to so many instants late (chapter 4) */
    DSE_HIGH_GAIN_TICK = 0,
    /* an exchange at every stage of the Runge-Kutta step, four rounds per tick: all filters
     * integrate one common picture, which is the source's continuous communication */
    DSE_HIGH_GAIN_STAGES = 1,
    /* never; a decentralised filter */
    DSE_HIGH_GAIN_NONE = 2,
    /* every comm_every_ticks ticks a filter sends its state if its trigger fires (chapter 5), and
     * with it, and with every J_i, how many states it has sent so far: silence is not loss */
    DSE_HIGH_GAIN_TRIGGERED = 3
};

/* What happens to the neighbours' blocks between messages. */
enum dse_high_gain_predictor {
    DSE_HIGH_GAIN_PREDICT = 0, /* they follow the model (3.7, 4.1) */
    DSE_HIGH_GAIN_HOLD = 1     /* they stay as in the newest message */
};

/* Zero is the default where one is named; everything else has to be set. Model, form, arrays and
 * the configuration itself must outlive the filter. */
struct dse_high_gain_ekf_config {
    const struct dse_model *model; /* the whole plant, continuous, at least as many outputs as the
                                    * form; dfdx is needed for physical coordinates */
    const struct dse_normal_form *form; /* the blocks, and the maps of the coordinates; physical
                                         * coordinates use only sizes, chains and rates, and take
                                         * the first state of each chain as its output */
    /* A centralised filter: one block of n states with all outputs, no neighbours. Needs
     * field_jacobian and push of the form, unless the coordinates are physical; i must be 0. */
    bool whole;
    int i;      /* this filter's subsystem, 0..p-1 */
    bool heard; /* somebody outside the model and form, which may be those of a part of the plant
                 * (dse/part.h), hears it: it has something to say also where p = 1; not with
                 * whole */
    dse_real period; /* T_s, one tick in plant time, > 0 */

    enum dse_high_gain_coords coords;
    enum dse_high_gain_scaling scaling;
    enum dse_high_gain_gain gain;
    enum dse_high_gain_innovation innovation;
    enum dse_high_gain_communication communication;
    enum dse_high_gain_predictor predictor; /* must be PREDICT with STAGES */
    int comm_every_ticks;                   /* >= 1; 0 means 1; must be 1 with STAGES */
    int max_delay; /* D >= 0 instants: states that come later are dropped; only with TICK */
    struct dse_trigger_config trigger; /* with TRIGGERED; ABSOLUTE: of the state in the filter's
                                        * coordinates, RELATIVE: of the physical estimate */
    /* What moves the blocks of the neighbours, and all blocks where the past is computed again: a
     * predictor that knows the plant less well than the filter (4.7). NULL: model. In normal
     * coordinates it needs the form's push. */
    const struct dse_model *predictor_model;

    const dse_real *x0; /* n: the guess of the whole physical state that all filters share */
    const dse_real *P0; /* n_i x n_i, symmetric positive definite, in the Riccati coordinates */
    const dse_real *Q;  /* n_i x n_i, symmetric, at theta = 1, per plant time */
    dse_real R;         /* > 0, measurement weight at theta = 1, (output unit)^2 times plant time;
                         * with several own outputs of each, unless there is R_block */
    const dse_real *R_block; /* m x m, symmetric positive definite, for m own outputs; NULL: R */
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
    int64_t missing_states;       /* states of neighbours that were due, or sent, and did not come
                                   * (within D instants) */
    int64_t missing_innovations;  /* J_j that were due and did not come: the last one was used */
    int64_t refused;              /* messages with a wrong count, sender or number */
    int64_t duplicates;           /* second messages of one sender and stamp or round; ignored */
    int64_t too_late;             /* states older than D instants; ignored */
    int64_t replayed_ticks;       /* of the past, computed again after a late state */
    int64_t failed_replays;       /* the model could not be evaluated: the picture ran on */
    int64_t transmissions;        /* states sent */
    int64_t frozen_predictions;   /* steps of past predictions that could not be made: held */
};

struct dse_high_gain_ekf {
    const struct dse_high_gain_ekf_config *config;
    int n, p, n_i, offset; /* sizes, and where block i begins */
    int n_max;             /* n*, the longest chain */
    int m, first_output;   /* own outputs, and where they begin among the model's */
    const int *chains;     /* m: lengths of the own chains */
    int *starts;           /* m: where they begin in the block */

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
    bool instant; /* states are exchanged in this tick */
    bool tells;   /* the own state is sent in it */
    int64_t sample;
    dse_real t;
    dse_real *y;                /* m */
    int q;                      /* how many of them there are, ... */
    int *chosen;                /* ... and which */
    dse_real *u, *du, *u_stage; /* nu: inputs at t_k, their rates, inputs at the stage */
    dse_real *du_past;          /* nu: rates in a tick of the past */
    bool moving;                /* some rate is not zero */
    dse_real theta_tick;        /* theta of this tick */
    dse_real *R_th, *Q_th;      /* weights of this tick: m x m, n_i x n_i; with the q outputs ... */
    dse_real *L, *D, *W;        /* ... R_th = L D L', W = R_th^-1 */
    dse_real J_own, J_drive;
    dse_real *output_error; /* m: y_i - C_i z_i at t_k, 0 where there is no y */
    dse_real *base;         /* n: the picture at t_k with the messages in */
    dse_real *xs, *Ps;      /* the stage's point */
    dse_real *kx, *kP;      /* its derivative */
    dse_real *sx, *sP;      /* weighted sum of the derivatives */

    /* neighbours */
    struct dse_mailbox mailbox; /* the states of the last D + 1 instants */
    dse_real *inbox;            /* n: blocks received in this round, of a stage */
    dse_real *J;                /* p: last known J_j */
    int *received;              /* p: reals received in this round from j */
    int *heard;                 /* p: how many states j said that it had sent */
    struct dse_trigger trigger;
    int number; /* states sent, modulo DSE_LINK_NUMBERS */

    /* the past, with D > 0 */
    dse_real *pictures;  /* (D + 1) x n: at the last instants, with what is known now */
    dse_real *inputs;    /* (D comm_every_ticks + 1) x nu: of the last ticks */
    int64_t past_from;   /* first instant from which on all of it is there */
    int64_t last_sample; /* -1: none, or its tick failed */

    /* what is reported about t_k, physical */
    dse_real *estimate;            /* n_i */
    dse_real *estimate_covariance; /* n_i x n_i */

    /* past predictions: horizon + 1 states (n each), then as many accumulated squares */
    dse_real *ring;

    /* scratch */
    dse_real *chi, *z, *w, *y_all, *F, *FP, *M, *K, *CP, *e, *dfdx, *rk;
    int *pivots;

    enum dse_health health;
    struct dse_high_gain_ekf_counters counters;
};

/* Predictions of the past that are stepped together. */
#define DSE_HIGH_GAIN_EKF_LANES 8

/* Reals for a filter: n states, nu inputs and ny outputs of the whole plant, p subsystems, n_i own
 * states, horizon N_d. A centralised filter: p = 1, n_i = n. */
#define DSE_HIGH_GAIN_EKF_STORAGE(n, nu, ny, p, n_i, N_d)                                          \
    ((10 + 3 * DSE_HIGH_GAIN_EKF_LANES) * (n) + (n) * (n) + 13 * (n_i) * (n_i) + 6 * (n_i) +       \
     DSE_TRIGGER_STORAGE(n_i) + 5 * (nu) + (ny) + (p) + 2 * DSE_ARENA_INTS(p) +                    \
     3 * DSE_ARENA_INTS(n_i) + DSE_MAILBOX_STORAGE(p, n, 0) + ((N_d) + 1) * ((n) + 1))

/* Reals beside that for delays up to D instants of `every` ticks each. */
#define DSE_HIGH_GAIN_EKF_DELAY_STORAGE(n, nu, p, D, every)                                        \
    (DSE_MAILBOX_STORAGE(p, n, D) - DSE_MAILBOX_STORAGE(p, n, 0) + ((D) + 1) * (n) +               \
     ((D) * (every) + 1) * (nu))

/* Reals in the longest message of a filter with n_i states. Round 0: {J_i} or {J_i, state_i}, with
 * TRIGGERED {J_i, count of states sent} or the same and state_i; rounds 1 to 3: the state of the
 * stage. */
#define DSE_HIGH_GAIN_EKF_MESSAGE(n_i) (2 + (n_i))

/* DSE_EINVAL: a value outside its range or a combination that is not allowed; DSE_EDIM: model and
 * form do not fit; DSE_ENONFINITE, DSE_ENOTPD: guess or weights; DSE_ESTORAGE. */
enum dse_status dse_high_gain_ekf_init(struct dse_high_gain_ekf *filter,
                                       const struct dse_high_gain_ekf_config *config,
                                       struct dse_arena *arena);

/* Opens the tick of sample k at time t with inputs u (nu) and the own measurement (m channels,
 * mostly one; what is missing or NaN does not correct and contributes nothing to J; NULL: all is
 * missing). Samples with k divisible by comm_every_ticks are communication instants. A tick left
 * open is dropped. Where samples are left out or a tick fails, the past is forgotten. */
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

/* Takes in a state of filter j (count reals) that was sent in sample `stamp`, which may be up to D
 * instants old; several in any order. Only at a communication instant, in round 0. What is too old
 * or known already is dropped and counted. Errors as with receive. */
enum dse_status dse_high_gain_ekf_deliver(struct dse_high_gain_ekf *filter, int j, int64_t stamp,
                                          const dse_real *state, int count);

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
/* y_i - yhat_i at t_k (m), of the corrected picture; 0 where there was no measurement. */
const dse_real *dse_high_gain_ekf_output_error(const struct dse_high_gain_ekf *filter);
/* How many instants old the newest state of filter j is, -1: none has come, or j = i. */
int dse_high_gain_ekf_age(const struct dse_high_gain_ekf *filter, int j);
/* The largest age of the other filters; -1: at least one has never been heard. 0 without others. */
int dse_high_gain_ekf_largest_age(const struct dse_high_gain_ekf *filter);
/* Whether the messages of the open tick carry the own state. */
bool dse_high_gain_ekf_tells(const struct dse_high_gain_ekf *filter);
enum dse_health dse_high_gain_ekf_health(const struct dse_high_gain_ekf *filter);
const struct dse_high_gain_ekf_counters *
dse_high_gain_ekf_counters(const struct dse_high_gain_ekf *filter);

/* ---- for tests and design: the weights at a given theta ---- */

/* R_th (m x m) and Q_th (n_i x n_i) of section 4.2 for a block of m chains; n_i is the sum of their
 * lengths. R_th and Q_th are not R and Q. */
void dse_high_gain_weights(enum dse_high_gain_scaling scaling, int m, const int *chains, int n_max,
                           dse_real theta, const dse_real *R, const dse_real *Q, dse_real *R_th,
                           dse_real *Q_th);

#endif
