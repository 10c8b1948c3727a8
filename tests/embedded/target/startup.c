/* From reset to main() and from main() to the exit code; a fault ends the run. */
#include <stdint.h>

#include "semihosting.h"

/* Addresses set by memory.ld. */
extern const uint32_t data_load[];
extern uint32_t data_begin[], data_end[], bss_begin[], bss_end[], stack_guard[], stack_bottom[];

int main(void);
void reset(void);

/* Coprocessor access control: bits 20..23 give full access to the floating-point unit. */
#define CPACR (*(volatile uint32_t *)0xE000ED88u)

static void enable_floating_point(void)
{
    CPACR |= 0xFu << 20;
    __asm__ volatile("dsb\n\tisb" ::: "memory");
}

enum { EXIT_FAULT = 70, EXIT_STACK = 71 };

#define GUARD 0x57AC6A2Du

static void set_guard(void)
{
    for (uint32_t *word = stack_guard; word < stack_bottom; word++)
        *word = GUARD;
}

static void check_guard(void)
{
    for (const uint32_t *word = stack_guard; word < stack_bottom; word++) {
        if (*word != GUARD) {
            semihosting_write("the stack went below its bottom\n");
            semihosting_exit(EXIT_STACK);
        }
    }
}

void reset(void)
{
    enable_floating_point();
    const uint32_t *from = data_load;
    for (uint32_t *to = data_begin; to < data_end; to++)
        *to = *from++;
    for (uint32_t *to = bss_begin; to < bss_end; to++)
        *to = 0;
    set_guard();
    int code = main();
    check_guard();
    semihosting_exit(code);
}

static void fault(void)
{
    semihosting_write("fault: the processor took an exception that nobody expects\n");
    semihosting_exit(EXIT_FAULT);
}

/* Entry 0, the initial stack pointer, is written by memory.ld. No interrupt is enabled. */
typedef void (*handler)(void);
__attribute__((used, section(".vectors"))) static const handler vectors[15] = {
    reset, fault, fault, fault, fault, fault, fault, fault,
    fault, fault, fault, fault, fault, fault, fault,
};
