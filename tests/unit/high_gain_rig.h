/* What the tests of the adaptive high-gain EKF share: networks of filters in one process, of the
 * linear plant or of the two reactors, that can lose, delay and reorder messages. */
#ifndef HIGH_GAIN_RIG_H
#define HIGH_GAIN_RIG_H

#include <stdbool.h>
#include <stdint.h>

#include "dse/high_gain_ekf.h"
#include "high_gain_plant.h"

/* ---- a network in one process ---- */

enum {
    MAX_P = 3,
    MAX_N = 5,
    LINEAR_HORIZON = 6,
    CSTR_HORIZON = 72, /* of section 2.6 */
    MAX_DELAY = 3,     /* instants */
    MAX_EVERY = 5,     /* ticks from instant to instant */
    MAX_INSTANTS = 64,
    LATE_HORIZON = 4
};

#define NETWORK_STORAGE                                                                            \
    (DSE_HIGH_GAIN_EKF_STORAGE(MAX_N, 2, MAX_P, MAX_P, 2, CSTR_HORIZON) +                          \
     DSE_HIGH_GAIN_EKF_DELAY_STORAGE(MAX_N, 2, MAX_P, MAX_DELAY, MAX_EVERY))

struct network {
    struct linear linear; /* or: */
    dse_real prepared[256];
    struct dse_model model;
    struct dse_normal_form form;
    int n, p;
    dse_real x[MAX_N]; /* the plant */
    dse_real u[2];
    dse_real x0[MAX_N], P0[4], P0_single[1], Q[4], Q_single[1];
    struct dse_high_gain_ekf_config config[MAX_P];
    struct dse_high_gain_ekf filter[MAX_P];
    int64_t k;
    /* what the tests do to the network */
    bool lose[MAX_P][MAX_P]; /* [i][j]: i does not hear j in the rounds */
    bool blind[MAX_P];       /* no measurement for i */
    bool backwards;          /* messages are taken in from the last sender to the first */
    dse_real memory[MAX_P][NETWORK_STORAGE];
    dse_real said[MAX_P][MAX_INSTANTS][2]; /* states at the instants, of begin_late_tick */
};

/* Adaptation and configuration of section 2.6, and those for the linear plant. */
extern const struct dse_gain_adaptation ch2_gain;
struct dse_high_gain_ekf_config cstr_config(void);
struct dse_high_gain_ekf_config linear_config(void);

/* One exchange per tick, and one per stage. */
extern const enum dse_high_gain_communication ways[2];

void linear_network(struct network *network, const struct dse_high_gain_ekf_config *config);
void cstr_network(struct network *network, const struct dse_high_gain_ekf_config *config);
/* Filters anew, of the plant and the guess that are in the network. */
void init_filters(struct network *network, const struct dse_high_gain_ekf_config *config);

/* A tick: the filters begin with their measurements; rounds, end of the tick, step of the plant. */
void begin_tick(struct network *network);
void exchange(struct network *network, int round);
void end_tick(struct network *network);
void tick(struct network *network);

/* Everything that a filter carries from tick to tick has the same bits. */
void assert_same_state(const struct network *a, const struct network *b);
/* Only pictures and covariances have. */
void assert_same_pictures(const struct network *a, const struct network *b);

/* ---- two reactors of section 4.7 that exchange packets, not rounds ---- */

/* An instant every MAX_EVERY ticks, packets late by up to MAX_DELAY instants. */
struct dse_high_gain_ekf_config late_config(void);
void late_network(struct network *network, const struct dse_high_gain_ekf_config *config);
/* cstr2, set "ch4", with one parameter changed. */
void prepare_late_plant(dse_real *prepared, const char *parameter, dse_real change);

/* As begin_tick; at an instant what the filters say is kept in `said`. */
void begin_late_tick(struct network *network);
/* What the other one said at instant `stamp` reaches i now. */
enum dse_status deliver(struct network *network, int i, int64_t stamp);
/* One tick; at instants packet of stamp s arrives where due[s] == instant. */
void late_tick(struct network *network, const int *due, int stamps);

#endif
