/* The smallest node there is, z' = -z + y with xh = z, and neighbours whose messages are made up.
 * Full-order residual r = z - y; estimates are compared as a whole. */
#ifndef OBSERVER_SCALAR_H
#define OBSERVER_SCALAR_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "observer_rig.h"

static struct dse_distributed_observer node;
static struct dse_distributed_observer_config config;
static dse_real memory[RIG_STORAGE];

static const dse_real minus_one[1] = {-1}, one[1] = {1};
static const struct dse_observer_rows all_rows[2] = {{0, NULL}, {0, NULL}};

static inline enum dse_status start_node(void)
{
    struct dse_arena arena;
    dse_arena_init(&arena, memory, RIG_STORAGE);
    return dse_distributed_observer_init(&node, &config, &arena);
}

static inline void scalar_config(enum dse_observer_residual residual, int neighbours)
{
    config = (struct dse_distributed_observer_config){.nz = 1,
                                                      .ny = 1,
                                                      .nx = 1,
                                                      .Lambda = minus_one,
                                                      .L = one,
                                                      .z0 = one,
                                                      .neighbours = neighbours,
                                                      .residual = residual,
                                                      .Pi = one,
                                                      .theirs = all_rows,
                                                      .nr = 1,
                                                      .D = one,
                                                      .D_y = minus_one,
                                                      .gamma = 1};
}

static inline enum dse_status sample_at(dse_real t, dse_real y)
{
    const struct dse_measurement sample = {&y, NULL};
    return dse_distributed_observer_sample(&node, t, NULL, &sample);
}

static inline enum dse_status hear(int j, dse_real xh)
{
    return dse_distributed_observer_receive(&node, j, &xh);
}

static inline dse_real gain(int j)
{
    return dse_distributed_observer_gains(&node)[j];
}

#endif
