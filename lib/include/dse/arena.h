/* The caller's memory, dealt out at init and never given back.
 *
 *     static dse_real memory[DSE_EKF_STORAGE(4, 2)];
 *     struct dse_arena arena;
 *     dse_arena_init(&arena, memory, DSE_EKF_STORAGE(4, 2));
 *     dse_ekf_init(&ekf, &config, &arena);
 *
 * Every object has a constant expression DSE_<OBJECT>_STORAGE(dimensions) for what it takes, in
 * reals, so that the linker proves that it fits. */
#ifndef DSE_ARENA_H
#define DSE_ARENA_H

#include "dse/real.h"

struct dse_arena {
    dse_real *memory; /* capacity reals, owned by the caller */
    int capacity;     /* in reals */
    int used;         /* in reals */
};

/* memory may be NULL only when capacity is 0. */
void dse_arena_init(struct dse_arena *arena, dse_real *memory, int capacity);

/* The next `count` reals, set to zero; NULL when count is negative or does not fit any more. */
dse_real *dse_arena_take(struct dse_arena *arena, int count);

/* Reals needed to keep `count` ints in an arena. */
#define DSE_ARENA_INTS(count)                                                                      \
    ((int)(((count) * (int)sizeof(int) + (int)sizeof(dse_real) - 1) / (int)sizeof(dse_real)))

#endif
