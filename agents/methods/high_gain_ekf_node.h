/* A node of the high-gain EKF: made in high_gain_ekf_create.c, run in high_gain_ekf.c. */
#ifndef DSE_METHODS_HIGH_GAIN_EKF_NODE_H
#define DSE_METHODS_HIGH_GAIN_EKF_NODE_H

#include "dse/high_gain_ekf.h"
#include "methods/high_gain_ekf_section.h"
#include "methods/lossy_link.h"
#include "methods/method.h"

enum high_gain_ekf_diagnostic {
    DIAGNOSTIC_THETA,
    DIAGNOSTIC_J,
    DIAGNOSTIC_J_SUM,
    DIAGNOSTIC_INNOVATION,
    DIAGNOSTIC_AGE,
    DIAGNOSTIC_SENT,
    DIAGNOSTICS
};

struct high_gain_ekf_node {
    const struct high_gain_ekf_section *section;
    struct dse_model model, predictor_model;
    struct dse_normal_form form;
    struct dse_high_gain_ekf_config config;
    struct dse_high_gain_ekf filter;
    struct lossy_link *links; /* NULL: what is said is heard at once */
    struct dse_arena arena;
    dse_real *memory;
    dse_real *values, *prepared; /* of the predictor's own plant, NULL: none */
    int64_t k;
    int planned; /* rounds of this sample, also when the own filter has failed in it */
    bool ok;     /* the own filter takes part in this sample */
};

/* As in struct method. */
void *high_gain_ekf_create(const struct method_setup *setup, struct method_info *info,
                           struct error *error);
void high_gain_ekf_destroy(void *self);

#endif
