/* Small plants of the tests' own for the simulator, and settings to simulate them with. */
#ifndef SIMULATOR_RIG_H
#define SIMULATOR_RIG_H

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "sim/simulator.h"

#define COUNT(array) ((int)(sizeof(array) / sizeof(array)[0]))
#define REASON       512

/* ---- plants ---- */

typedef enum dse_status (*function)(const struct dse_model *, dse_real, const dse_real *,
                                    const dse_real *, dse_real *);

/* "smooth": a' = -rate a + u, b' = 2 t, c' = 0; outputs 0, so that they show the noise alone. */
static inline enum dse_status smooth_f(const struct dse_model *model, dse_real t, const dse_real *x,
                                       const dse_real *u, dse_real *dx)
{
    const double *rate = model->parameters;
    dx[0] = -*rate * x[0] + u[0];
    dx[1] = 2 * t;
    dx[2] = 0;
    return DSE_OK;
}

static inline enum dse_status zero_h(const struct dse_model *model, dse_real t, const dse_real *x,
                                     const dse_real *u, dse_real *y)
{
    (void)t, (void)x, (void)u;
    for (int j = 0; j < model->ny; j++)
        y[j] = 0;
    return DSE_OK;
}

static inline enum dse_status copy_h(const struct dse_model *model, dse_real t, const dse_real *x,
                                     const dse_real *u, dse_real *y)
{
    (void)t, (void)u;
    memcpy(y, x, (size_t)model->ny * sizeof *y);
    return DSE_OK;
}

static const struct dse_signal signals[] = {{.name = "a", .unit = "1", .scale = 1},
                                            {.name = "b", .unit = "1", .scale = 1},
                                            {.name = "c", .unit = "1", .scale = 1}};

struct test_plant {
    const char *name;
    int nx, nu, ny;
    enum dse_time_kind time;
    function f, h, dfdx;
    double rate;
};

/* `prepared` is the test plant itself: the library's plants keep numbers there. */
static inline void test_model(const dse_real *prepared, struct dse_model *model)
{
    const struct test_plant *plant = (const struct test_plant *)(const void *)prepared;
    *model = (struct dse_model){.time = plant->time,
                                .nx = plant->nx,
                                .nu = plant->nu,
                                .ny = plant->ny,
                                .parameters = &plant->rate,
                                .f = plant->f,
                                .h = plant->h,
                                .dfdx = plant->dfdx};
}

static const struct test_plant smooth = {
    .name = "smooth", .nx = 3, .nu = 1, .ny = 2, .f = smooth_f, .h = zero_h, .rate = 5};

/* ---- set-up ---- */

struct setting {
    struct dse_plant plant;
    struct sim_config config;
};

static const double ones[] = {1, 1, 1};

static inline void set(struct setting *setting, const struct test_plant *plant, double period)
{
    setting->plant = (struct dse_plant){.name = plant->name,
                                        .time_unit = "h",
                                        .nx = plant->nx,
                                        .nu = plant->nu,
                                        .ny = plant->ny,
                                        .states = signals,
                                        .inputs = signals,
                                        .outputs = signals,
                                        .model = test_model};
    setting->config = (struct sim_config){.plant = &setting->plant,
                                          .prepared = (const dse_real *)(const void *)plant,
                                          .x0 = ones,
                                          .u = ones,
                                          .period = period,
                                          .seed = 7};
}

static inline struct simulator *create(const struct setting *setting)
{
    char reason[REASON] = "";
    struct simulator *sim = sim_create(&setting->config, reason, sizeof reason);
    if (sim == NULL)
        fail_msg("%s", reason);
    return sim;
}

static inline void step(struct simulator *sim)
{
    char reason[REASON] = "";
    if (!sim_step(sim, reason, sizeof reason))
        fail_msg("%s", reason);
}

static inline void assert_close(double value, double expected, double tolerance)
{
    if (!(fabs(value - expected) <= tolerance))
        fail_msg("%.17g is not %.17g within %g", value, expected, tolerance);
}

static inline void assert_same_bits(const double *a, const double *b, int n)
{
    assert_memory_equal(a, b, (size_t)n * sizeof *a);
}

#endif
