/* The two examples of the second-order observers' source, as the tests of filters need them. */
#ifndef SECOND_ORDER_PLANTS_H
#define SECOND_ORDER_PLANTS_H

#include "dse/ode.h"
#include "dse/plant.h"
#include "dse/quadratic.h"
#include "dse/random.h"

#define NX 3

static const dse_real unit_covariance[NX * NX] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
static const dse_real plant_start[NX] = {1, 2, 1};

static inline struct dse_model plant_model(const char *name)
{
    static dse_real prepared[1];
    struct dse_model model;
    dse_plant_find(name)->model(prepared, &model);
    return model;
}

/* One second of the plant. */
static inline void plant_second(const struct dse_model *model, dse_real *x)
{
    dse_real scratch[DSE_RK4_SCRATCH(NX)];
    for (int s = 0; s < 50; s++)
        dse_rk4_model_step(model, 0, DSE_REAL(0.02), NULL, x, scratch);
}

/* A positive definite matrix of about `size`. */
static inline void random_covariance(struct dse_random *random, dse_real size, dse_real *S)
{
    dse_real half[NX * NX];
    for (int i = 0; i < NX * NX; i++)
        half[i] = (dse_real)dse_random_normal(random);
    for (int i = 0; i < NX; i++)
        for (int j = 0; j < NX; j++) {
            S[i * NX + j] = 0;
            for (int k = 0; k < NX; k++)
                S[i * NX + j] += size * half[i * NX + k] * half[j * NX + k];
        }
}

#endif
