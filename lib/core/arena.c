/* Dealing out the caller's memory. */
#include "dse/arena.h"

#include <stddef.h>

void dse_arena_init(struct dse_arena *arena, dse_real *memory, int capacity)
{
    arena->memory = memory;
    arena->capacity = capacity;
    arena->used = 0;
}

dse_real *dse_arena_take(struct dse_arena *arena, int count)
{
    if (count < 0 || count > arena->capacity - arena->used)
        return NULL;
    dse_real *taken = arena->memory + arena->used;
    arena->used += count;
    for (int i = 0; i < count; i++)
        taken[i] = 0;
    return taken;
}
