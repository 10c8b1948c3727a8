/* Two adaptive high-gain filters and the two-reactor plant that they watch, in one program: the run
 * run_ch2_cont_ahg of tests/golden, whose configuration golden_high_gain.h holds. */
#ifndef CSTR2_NETWORK_H
#define CSTR2_NETWORK_H

#include "dse/high_gain_ekf.h"
#include "dse/plant.h"

enum { CSTR2_STATES = 4, CSTR2_INPUTS = 2, CSTR2_FILTERS = 2, CSTR2_BLOCK = 2 };

struct cstr2_network {
    struct dse_model model;
    struct dse_normal_form form;
    struct dse_high_gain_ekf_config config[CSTR2_FILTERS];
    struct dse_high_gain_ekf filter[CSTR2_FILTERS];
    dse_real x[CSTR2_STATES]; /* the plant's state */
    dse_real u[CSTR2_INPUTS];
    dse_real xhat[CSTR2_STATES]; /* what the filters say about the t_k of the last tick */
    int k;                       /* ticks made */
};

/* Reals in the memory of one filter. */
int cstr2_network_storage(void);

enum dse_status cstr2_network_start(struct cstr2_network *network);

/* Tick k: measure, exchange at the four stages, move both filters and the plant to t_{k+1}. */
enum dse_status cstr2_network_tick(struct cstr2_network *network);

#endif
