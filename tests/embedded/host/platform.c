/* The same case on the host: its lines go to the standard output. */
#include "platform.h"

#include <stdio.h>

void platform_write(const char *text)
{
    fputs(text, stdout);
}
