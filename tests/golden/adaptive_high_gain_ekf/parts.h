/* What the parts of the runner share. */
#ifndef ADAPTIVE_HIGH_GAIN_EKF_PARTS_H
#define ADAPTIVE_HIGH_GAIN_EKF_PARTS_H

#include "../golden.h"
#include "../shipped_plant.h"

/* One file of each kind. */
int golden_plant_file(const json_t *root);
int golden_gain_file(const json_t *root);
int golden_run_file(const json_t *root);
int golden_three_tank_plant_file(const json_t *root);
int golden_three_tank_run_file(const json_t *root);

#endif
