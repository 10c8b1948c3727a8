/* Reference data of linear consensus: what the two kinds of files share. */
#ifndef CONSENSUS_LINEAR_PARTS_H
#define CONSENSUS_LINEAR_PARTS_H

#include "../../unit/consensus_network.h"
#include "../golden.h"

/* The same sums in another order. */
#define GOLDEN_LINEAR 1e-10

/* Undirected links of a symmetric adjacency matrix (n x n): their number; pairs: 2 n (n - 1) / 2.
 */
int golden_links(int n, const double *adjacency, int *pairs);
/* The worse of two verdicts. */
int golden_worse(int a, int b);

/* One file of each kind. */
int golden_consensus_filters(const json_t *root);
int golden_consensus_kalman(const json_t *root);

#endif
