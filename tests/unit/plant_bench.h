/* A shipped plant on the bench of its tests, with its model and normal form, at a state off its
 * equilibrium. */
#ifndef PLANT_BENCH_H
#define PLANT_BENCH_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "dse/math.h"
#include "dse/plant.h"
#include "near.h"

enum { MAX_N = 16, MAX_U = 4, MAX_PREPARED = 256, MAX_NI = 4 };

/* A plant with its normal form, at a state off its equilibrium. */
struct bench {
    const struct dse_plant *plant;
    dse_real prepared[MAX_PREPARED];
    struct dse_model model;
    struct dse_normal_form form;
    dse_real x[MAX_N], u[MAX_U];
};

static inline void set_up(struct bench *bench, const struct dse_plant *plant, int set)
{
    assert_true(plant->nx <= MAX_N && plant->nu <= MAX_U && plant->prepared_size <= MAX_PREPARED);
    bench->plant = plant;
    assert_int_equal(plant->prepare(plant->sets[set].values, bench->prepared), DSE_OK);
    plant->model(bench->prepared, &bench->model);
    if (plant->normal_form != NULL) {
        plant->normal_form(bench->prepared, &bench->form);
    }
    for (int k = 0; k < plant->nx; k++) {
        bench->x[k] = plant->sets[set].x0[k];
    }
    for (int k = 0; k < plant->nu; k++) {
        /* every input off zero, so that its part in the equations is seen */
        bench->u[k] = plant->inputs[k].nominal + plant->inputs[k].scale;
    }
}

/* Calls check for every parameter set of every shipped plant that is small enough for dense
 * differences. */
static inline void for_all_plants(void (*check)(struct bench *bench))
{
    int checked = 0;
    for (int i = 0; dse_plant_at(i) != NULL; i++) {
        const struct dse_plant *plant = dse_plant_at(i);
        if (plant->nx > MAX_N || plant->nu > MAX_U || plant->prepared_size > MAX_PREPARED) {
            continue;
        }
        for (int set = 0; set < plant->n_sets; set++) {
            struct bench bench;
            memset(&bench, 0, sizeof bench);
            set_up(&bench, plant, set);
            check(&bench);
            checked++;
        }
    }
    assert_true(checked > 0);
}

/* |got - want| <= tolerance (|want| + scale). */
static inline void assert_near_scaled(dse_real got, dse_real want, dse_real scale,
                                      dse_real tolerance)
{
    assert_near(got, want, tolerance * (dse_abs(want) + scale));
}

/* Half the width of a central difference at x. */
static inline dse_real step_of(dse_real x)
{
    return TOLERANCE(1e-6, 1e-3) * (1 + dse_abs(x));
}

#endif
