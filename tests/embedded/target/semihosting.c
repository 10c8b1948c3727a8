/* Semihosting calls: the operation in r0, its argument in r1, then `bkpt 0xAB`. */
#include "semihosting.h"

#include <stdint.h>

#include "platform.h"

enum { SYS_WRITE0 = 0x04, SYS_EXIT_EXTENDED = 0x20 };

#define APPLICATION_EXIT 0x20026u /* reason code ADP_Stopped_ApplicationExit */

static void call(uint32_t operation, const void *argument)
{
    register uint32_t r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
}

_Noreturn void semihosting_exit(int code)
{
    /* Not on the stack: after an overflow there may be none. */
    static uint32_t block[2] = {APPLICATION_EXIT, 0};
    block[1] = (uint32_t)code;
    call(SYS_EXIT_EXTENDED, block);
    for (;;) {
    }
}

void semihosting_write(const char *text)
{
    call(SYS_WRITE0, text);
}

void platform_write(const char *text)
{
    semihosting_write(text);
}
