/* The section `high_gain_ekf` of a network: the tunables of the distributed adaptive high-gain EKF
 * under the names of its source. Times are in the plant's time unit. */
#ifndef DSE_METHODS_HIGH_GAIN_EKF_SECTION_H
#define DSE_METHODS_HIGH_GAIN_EKF_SECTION_H

#include "dse/high_gain_ekf.h"
#include "runtime/error.h"
#include "runtime/scenario.h"

/* The frameworks of Fig 1.1 and 1.2; a decentralised one is distributed with communication none. */
enum high_gain_ekf_framework { HIGH_GAIN_EKF_DISTRIBUTED = 0, HIGH_GAIN_EKF_CENTRALISED = 1 };

struct high_gain_ekf_trigger {
    enum dse_trigger_norm norm;
    double L;
    double *H; /* n, NULL: ones */
    unsigned H_count;
};

/* When the filters exchange their states. J is exchanged at every tick where it is summed. What is
 * late or lost is networks[].link. */
struct high_gain_ekf_communication {
    enum dse_high_gain_communication kind;
    unsigned every;                         /* ticks between exchanges, 0: 1 */
    enum dse_high_gain_predictor predictor; /* what the neighbours' states do in between */
    struct high_gain_ekf_trigger *trigger;  /* with kind triggered, else NULL */
};

/* Lists run over the subsystems in the plant's order; Q and P0 hold the diagonals of Q_1, Q_2, ..
 * one after the other. */
struct high_gain_ekf_section {
    enum high_gain_ekf_framework framework;
    enum dse_high_gain_coords coordinates;
    enum dse_high_gain_scaling scaling;
    enum dse_high_gain_gain gain;
    enum dse_high_gain_gain *gains; /* p, NULL: all as `gain` */
    unsigned gains_count;
    enum dse_high_gain_innovation innovation;
    struct high_gain_ekf_communication communication;
    struct scenario_parameter *predictor_parameters; /* NULL: the filters' own */
    unsigned predictor_parameters_count;
    double d; /* horizon of J */
    double DeltaT, beta, m, lambda, theta_m;
    double *Q; /* n */
    unsigned Q_count;
    double *R; /* ny */
    unsigned R_count;
    double *P0; /* n, NULL: identity */
    unsigned P0_count;
};

extern const cyaml_schema_field_t high_gain_ekf_fields[];
extern const struct scenario_rule high_gain_ekf_rules[];

/* N_d = d / T_s in ticks. */
int high_gain_ekf_horizon(const struct high_gain_ekf_section *section, double period);
/* Of the filter of subsystem i. */
enum dse_high_gain_gain high_gain_ekf_gain(const struct high_gain_ekf_section *section, int i);
/* Combinations that no limit on a single number covers; period T_s in plant time. */
bool high_gain_ekf_section_check(const struct high_gain_ekf_section *section, double period,
                                 struct error *error);

#endif
