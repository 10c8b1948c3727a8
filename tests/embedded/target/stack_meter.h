/* How deep the stack goes during a call. */
#ifndef STACK_METER_H
#define STACK_METER_H

/* Paints the free stack, calls work() and returns the bytes below the caller's frame that it
 * overwrote. */
int stack_used_by(void (*work)(void));

#endif
