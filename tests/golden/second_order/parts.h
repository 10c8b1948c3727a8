/* Parts of the runner for second-order filters: one file of each kind. */
#ifndef SECOND_ORDER_PARTS_H
#define SECOND_ORDER_PARTS_H

#include "../golden.h"
#include "../shipped_plant.h"

/* Points, open-loop predictors and a trajectory of a quadratic plant. */
int golden_quadratic_plant(const json_t *root);
/* Recorded runs of a network of nodes, each with its own sensor. */
int golden_second_order_network(const json_t *root);

#endif
