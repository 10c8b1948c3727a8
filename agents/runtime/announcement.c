/* A run_info that is said again and again. */
#include "runtime/announcement.h"

#include <stdlib.h>

#define FIRST_PAUSE   0.1  /* s; each pause is twice the one before .. */
#define LONGEST_PAUSE 60.0 /* .. up to this */

void announcement_begin(struct announcement *announcement, struct sender *sender, char *json,
                        double now)
{
    announcement_free(announcement);
    announcement->json = json;
    announcement->sequence = sender_sequence(sender, SENDER_RUN_INFO);
    announcement->said = now;
    announcement->pause = FIRST_PAUSE;
    if (json != NULL)
        sender_run_info(sender, json, -1);
}

void announcement_repeat(struct announcement *announcement, struct sender *sender, double now)
{
    if (announcement->json == NULL)
        return;
    sender_run_info(sender, announcement->json, announcement->sequence);
    announcement->said = now;
}

void announcement_poll(struct announcement *announcement, struct sender *sender, double now)
{
    if (announcement->json == NULL || now < announcement->said + announcement->pause)
        return;
    announcement_repeat(announcement, sender, now);
    if (announcement->pause < LONGEST_PAUSE)
        announcement->pause *= 2;
}

void announcement_free(struct announcement *announcement)
{
    free(announcement->json);
    announcement->json = NULL;
}
