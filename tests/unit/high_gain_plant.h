/* A linear plant whose map to normal coordinates is the identity, for the tests of the adaptive
 * high-gain EKF: it can be cut into subsystems in different ways, and made to fail. */
#ifndef HIGH_GAIN_PLANT_H
#define HIGH_GAIN_PLANT_H

#include <stdbool.h>

#include "dse/model.h"
#include "dse/normal_form.h"

enum { LINEAR_P = 3, LINEAR_N = 5 };

struct linear {
    dse_real A[LINEAR_N * LINEAR_N];
    bool broken; /* no function can be evaluated */
    bool wild;   /* derivatives are infinite */
};

/* Three chains of 2, 1 and 2 states, all coupled. */
extern const struct linear coupled;
/* Which states are its outputs. */
extern const int linear_outputs[LINEAR_P];

/* Five states, three outputs, in p = 3 blocks of 2, 1, 2 states, p = 2 of 3, 2, or one. */
void linear_plant(const struct linear *linear, int p, struct dse_model *model,
                  struct dse_normal_form *form);
/* One block of two states whose first is the output. A: 2 x 2, in the first entries. */
void linear_block(const struct linear *linear, struct dse_model *model,
                  struct dse_normal_form *form);

#endif
