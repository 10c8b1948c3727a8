/* Reference runs of networks: what their files share. */
#ifndef DISTRIBUTED_KALMAN_PARTS_H
#define DISTRIBUTED_KALMAN_PARTS_H

#include "../../unit/kalman_network.h"
#include "../golden.h"

/* The reference agrees with itself to about this, states relative to their own size. */
#define GOLDEN_STATES 1e-9

enum { NX = 2 }; /* of all reference networks; every node has one output */

/* A run of a file, in memory; golden_run_free gives it back. */
struct golden_run {
    int nodes, steps, n_records;
    double h;
    double x[NX];  /* of the plant, moves on */
    double *w, *v; /* steps x NX; nodes x n_v; NULL: no noise */
    int n_v;       /* noises of a node */
    const json_t *records;
    int compared; /* times that something was */
    int worst;    /* verdict so far */
};

/* Edges, sensors, starts, noise and times of a file into run and network (all but the scheme and
 * its gains). GOLDEN_FAIL when something is missing. */
int golden_run_load(const json_t *root, struct golden_run *run, struct kalman_network *network);
/* The verdict; a run that nothing was compared with has failed. */
int golden_run_verdict(const struct golden_run *run);
void golden_run_free(struct golden_run *run);
/* Makes the nodes along the file's edges. */
enum dse_status golden_run_make(const json_t *root, struct kalman_network *network);
/* y (nodes) of step k: C x + v. */
void golden_run_measure(const struct golden_run *run, const struct kalman_network *network, int k,
                        double *y);
/* The record of step k, or NULL. */
const json_t *golden_run_record(const struct golden_run *run, int k);
/* Compares `per_node` reals of every node with record[key] (skipped where that is null or absent).
 */
typedef const dse_real *(*golden_of_node)(const struct dse_dkf *node);
void golden_run_compare(struct golden_run *run, const struct kalman_network *network, int k,
                        const char *name, const char *key, golden_of_node of_node, int per_node);
/* The same for the gains of all nodes, and the plant's state. */
void golden_run_compare_gains(struct golden_run *run, const struct kalman_network *network, int k,
                              const char *name);
void golden_run_compare_plant(struct golden_run *run, int k, const char *name);

/* One file of each kind. */
int golden_adaptive_networks(const json_t *root);
int golden_offline_network(const json_t *root);
int golden_luenberger_network(const json_t *root);
int golden_discrete_network(const json_t *root);

#endif
