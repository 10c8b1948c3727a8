/* A run_info that is said again and again: at first often, for a network that loses messages, then
 * seldom, for a logger that was started late. */
#ifndef DSE_RUNTIME_ANNOUNCEMENT_H
#define DSE_RUNTIME_ANNOUNCEMENT_H

#include "runtime/sender.h"

struct announcement {
    char *json; /* NULL: nothing to say yet */
    int32_t sequence;
    double said; /* when it was said last */
    double pause;
};

/* Says it for the first time; owns json (from malloc, may be NULL) from now on. */
void announcement_begin(struct announcement *announcement, struct sender *sender, char *json,
                        double now);
/* Says it again when it is time. */
void announcement_poll(struct announcement *announcement, struct sender *sender, double now);
/* Says it again at once. */
void announcement_repeat(struct announcement *announcement, struct sender *sender, double now);
void announcement_free(struct announcement *announcement);

#endif
