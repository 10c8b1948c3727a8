/* The one thing that differs between host and target: where text goes. */
#ifndef PLATFORM_H
#define PLATFORM_H

void platform_write(const char *text);

#endif
