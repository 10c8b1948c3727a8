/* The stack grows down from stack_top to stack_bottom (memory.ld). */
#include "stack_meter.h"

#include <stdint.h>

#define PAINT 0xC5A7E11Eu

extern uint32_t stack_bottom[];

static inline uint32_t *stack_pointer(void)
{
    uint32_t *pointer;
    __asm__ volatile("mov %0, sp" : "=r"(pointer));
    return pointer;
}

/* What stack_pointer(), inlined, tells is the frame that calls work(). */
__attribute__((noinline)) int stack_used_by(void (*work)(void))
{
    uint32_t *const top = stack_pointer();
    for (volatile uint32_t *word = stack_bottom; word < top; word++)
        *word = PAINT;
    work();
    const uint32_t *deepest = stack_bottom;
    while (deepest < top && *deepest == PAINT)
        deepest++;
    return (int)((const char *)top - (const char *)deepest);
}
