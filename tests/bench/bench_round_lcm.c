/* Rounds on LCM alone: the least that anybody pays. Raw bytes, no time limit, no check. */
#include "bench_round.h"

#include <lcm/lcm.h>
#include <stdint.h>
#include <string.h>

#include "dse_exchange_t.h"

#define WARM_UP         500 /* rounds that are not measured */
#define LAST            (WARM_UP + ROUND_COUNT)
#define PAYLOAD_MAX     1400
#define HELLO           (-1)
#define SILENCE         (-2)
#define HELLO_PERIOD_MS 20

static const char *const channels[2] = {"BENCH_EXCHANGE_0", "BENCH_EXCHANGE_1"};

struct side {
    lcm_t *lcm;
    const char *own, *other;
    int heard; /* number of the last round that the other side spoke in */
    bool answers;
};

int round_payload(void)
{
    static const dse_exchange_t message; /* every one has the same size */
    return dse_exchange_t_encoded_size(&message);
}

static void say(struct side *side, int round)
{
    uint8_t bytes[PAYLOAD_MAX] = {0};
    memcpy(bytes, &round, sizeof round);
    lcm_publish(side->lcm, side->own, bytes, (unsigned)round_payload());
}

static void hear(const lcm_recv_buf_t *received, const char *channel, void *user)
{
    struct side *side = user;
    (void)channel;
    memcpy(&side->heard, received->data, sizeof side->heard);
    if (side->answers)
        say(side, side->heard);
}

static bool open_side(struct side *side, const char *url, int number)
{
    *side = (struct side){.lcm = lcm_create(url), .heard = SILENCE};
    side->own = channels[number];
    side->other = channels[1 - number];
    return side->lcm != NULL && lcm_subscribe(side->lcm, side->other, hear, side) != NULL;
}

static void wait_for(struct side *side, int round)
{
    while (side->heard < round)
        lcm_handle(side->lcm);
}

/* Until both sides listen: whoever has heard anything has been heard in return, or will be. */
static void meet(struct side *side)
{
    while (side->heard == SILENCE) {
        say(side, HELLO);
        lcm_handle_timeout(side->lcm, HELLO_PERIOD_MS);
    }
}

static void do_rounds(struct side *side, struct round_times *times)
{
    for (int r = 0; r <= LAST; r++) {
        if (times != NULL && r >= WARM_UP)
            round_tick(times);
        say(side, r);
        wait_for(side, r);
    }
}

bool round_ping_pong(const char *url, int number, struct round_times *times)
{
    struct side side;
    if (!open_side(&side, url, number))
        return false;
    side.answers = number == 1;
    if (side.answers) {
        wait_for(&side, LAST);
    } else {
        meet(&side);
        do_rounds(&side, times);
    }
    lcm_destroy(side.lcm);
    return true;
}

bool round_exchange(const char *url, int number, struct round_times *times)
{
    struct side side;
    if (!open_side(&side, url, number))
        return false;
    meet(&side);
    do_rounds(&side, times);
    lcm_destroy(side.lcm);
    return true;
}
