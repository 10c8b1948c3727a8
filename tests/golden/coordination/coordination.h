/* Parts of the runner golden_coordination. */
#ifndef GOLDEN_COORDINATION_H
#define GOLDEN_COORDINATION_H

#include "../golden.h"
#include "coordination_rig.h"

enum { PARTS = 3, NX = 9, BLOCK = 9 };

/* The plant and the data of a file, and the agents for it. */
struct network {
    struct coordination net;
    bool started;
    struct dse_mhe_subsystem subsystems[PARTS];
    int parts, n, nx, samples;
    double A_ii[PARTS][BLOCK], C[BLOCK];
    double *A, *Q, *R, *D, *x0, *y;
    int dead_from;
};

/* The agents are not started yet. PREDICTION, stopping as the source does. */
int network_read(const json_t *root, struct network *network);
int network_start(struct network *network);
void network_free(struct network *network);

/* A line and GOLDEN_PASS or GOLDEN_FAIL. */
int report(const char *name, double deviation, double tolerance);
/* Largest deviation of the agents' windows from a stack of the reference; infinite when it has
 * another length. */
double window_deviation(const struct network *network, const json_t *stack);

int compare_run(struct network *network, const char *name, const json_t *record, double tolerance);
int compare_price_window(const json_t *root, const json_t *window);
int compare_prediction_window(const json_t *root, const json_t *window);
int compare_bounded(const json_t *root);
/* bounds: x_min, x_max, w_min, w_max. */
int compare_whole(const json_t *section, const char *name, const char *key, double *const bounds[4],
                  double barrier, double tolerance);

#endif
