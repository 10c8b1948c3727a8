/* Packets of one pair under way. */
#include <stddef.h>

#include "dse/link.h"

enum dse_status dse_line_init(struct dse_line *line, int max_delay, int size,
                              struct dse_arena *arena)
{
    if (line == NULL || arena == NULL || max_delay < 0 || size < 1) {
        return DSE_EINVAL;
    }
    const int depth = max_delay + 1;
    *line = (struct dse_line){.depth = depth, .size = size, .newest = -1};
    line->value = dse_arena_take(arena, depth * size);
    line->delay = (int *)(void *)dse_arena_take(arena, DSE_ARENA_INTS(depth));
    if (line->value == NULL || line->delay == NULL) {
        return DSE_ESTORAGE;
    }
    for (int s = 0; s < depth; s++) {
        line->delay[s] = DSE_LINK_LOST;
    }
    return DSE_OK;
}

void dse_line_put(struct dse_line *line, int64_t stamp, int delay, const dse_real *value)
{
    if (stamp <= line->newest || delay < 0 || delay >= line->depth) {
        return;
    }
    const int slot = (int)(stamp % line->depth);
    /* a gap in the stamps leaves packets behind that nobody took when they were due */
    for (int64_t s = line->newest + 1; s < stamp && s <= line->newest + line->depth; s++) {
        line->delay[s % line->depth] = DSE_LINK_LOST;
    }
    line->newest = stamp;
    line->delay[slot] = delay;
    for (int k = 0; k < line->size; k++) {
        line->value[slot * line->size + k] = value[k];
    }
}

const dse_real *dse_line_take(struct dse_line *line, int64_t now, int64_t *stamp)
{
    for (int64_t s = line->newest - line->depth + 1; s <= line->newest; s++) {
        if (s < 0) {
            continue;
        }
        const int slot = (int)(s % line->depth);
        if (line->delay[slot] >= 0 && s + line->delay[slot] <= now) {
            line->delay[slot] = DSE_LINK_LOST;
            *stamp = s;
            return line->value + slot * line->size;
        }
    }
    return NULL;
}
