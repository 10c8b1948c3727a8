/* Talking to the debugger or emulator that runs the image (Arm semihosting, M profile). */
#ifndef SEMIHOSTING_H
#define SEMIHOSTING_H

/* Ends the emulation with an exit code. */
_Noreturn void semihosting_exit(int code);

/* Writes text, ended by '\0', to the console. */
void semihosting_write(const char *text);

#endif
