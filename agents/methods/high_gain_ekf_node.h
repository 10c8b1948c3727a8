/* A node of the high-gain EKF: made in high_gain_ekf_create.c, with the plant as it sees it from
 * high_gain_ekf_plant.c, run in high_gain_ekf.c. */
#ifndef DSE_METHODS_HIGH_GAIN_EKF_NODE_H
#define DSE_METHODS_HIGH_GAIN_EKF_NODE_H

#include "dse/high_gain_ekf.h"
#include "dse/part.h"
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
    struct dse_model model, predictor_model; /* of the subsystems in its picture */
    struct dse_normal_form form;
    int *block; /* form.p: which subsystems these are; all of them without a graph */
    int own;    /* place of its own subsystem among them */
    struct dse_high_gain_ekf_config config;
    struct dse_high_gain_ekf filter;
    struct lossy_link *links; /* NULL: what is said is heard at once */
    struct dse_arena arena;
    dse_real *memory;

    /* where these come from */
    struct dse_model whole_model, whole_predictor_model;
    struct dse_normal_form whole_form;
    struct dse_part part, predictor_part; /* with a graph */
    dse_real *part_memory;
    int part_storage;            /* reals */
    dse_real *values, *prepared; /* of the predictor's own plant, NULL: none */

    int64_t k;
    int planned; /* rounds of this sample, also when the own filter has failed in it */
    bool ok;     /* the own filter takes part in this sample */
};

/* Fills model, form, block, own and config.predictor_model. */
bool high_gain_ekf_take_plant(struct high_gain_ekf_node *node, const struct method_setup *setup,
                              struct error *error);
void high_gain_ekf_leave_plant(struct high_gain_ekf_node *node);
/* x0 (form.n): the guess of the states in the picture. */
void high_gain_ekf_guess(const struct high_gain_ekf_node *node, const struct method_setup *setup,
                         dse_real *x0);
void high_gain_ekf_describe_neighbours(const struct method_setup *setup, struct method_info *info);
/* Place of subsystem j in the picture, -1: it is not in it. */
int high_gain_ekf_place(const struct high_gain_ekf_node *node, int j);

/* As in struct method. */
void *high_gain_ekf_create(const struct method_setup *setup, struct method_info *info,
                           struct error *error);
void high_gain_ekf_destroy(void *self);

#endif
