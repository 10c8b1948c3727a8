/* The message bus on LCM. */
#include "runtime/bus.h"

#include <errno.h>
#include <lcm/lcm.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/bus_trouble.h"

#define BUS_DEFAULT_URL       "udpm://239.255.76.67:7667?ttl=0"
#define BUS_MAX_SUBSCRIPTIONS 64
#define BUS_BATCH             256 /* messages handed on before others get a turn */
#define CHECK_TRIES           100
#define CHECK_WAIT_MS         50

struct subscription {
    bus_handler handler;
    void *user;
};

struct bus {
    lcm_t *lcm;
    char *url;
    struct subscription **subscriptions;
    int n_subscriptions;
    int capacity;
};

struct bus *bus_open(const char *url, struct error *error)
{
    if (url == NULL || url[0] == '\0')
        url = getenv("LCM_DEFAULT_URL");
    if (url == NULL || url[0] == '\0')
        url = BUS_DEFAULT_URL;
    struct bus *bus = calloc(1, sizeof *bus);
    if (bus != NULL)
        bus->url = strdup(url);
    if (bus == NULL || bus->url == NULL) {
        error_set(error, "out of memory");
        bus_close(bus);
        return NULL;
    }
    bus->lcm = lcm_create(url);
    if (bus->lcm == NULL) {
        bus_trouble(url, "cannot open the bus", error);
        bus_close(bus);
        return NULL;
    }
    return bus;
}

void bus_close(struct bus *bus)
{
    if (bus == NULL)
        return;
    if (bus->lcm != NULL)
        lcm_destroy(bus->lcm);
    for (int i = 0; i < bus->n_subscriptions; i++)
        free(bus->subscriptions[i]);
    free(bus->subscriptions);
    free(bus->url);
    free(bus);
}

const char *bus_url(const struct bus *bus)
{
    return bus->url;
}

static void deliver(const lcm_recv_buf_t *received, const char *channel, void *user)
{
    struct subscription *subscription = user;
    subscription->handler(subscription->user, channel, received->data, (int)received->data_size);
}

bool bus_subscribe(struct bus *bus, const char *pattern, bus_handler handler, void *user,
                   struct error *error)
{
    struct subscription *subscription = malloc(sizeof *subscription);
    if (subscription == NULL)
        return error_set(error, "out of memory");
    subscription->handler = handler;
    subscription->user = user;
    if (bus->n_subscriptions == bus->capacity) {
        int capacity = bus->capacity + BUS_MAX_SUBSCRIPTIONS;
        void *grown = realloc(bus->subscriptions, (size_t)capacity * sizeof(void *));
        if (grown == NULL) {
            free(subscription);
            return error_set(error, "out of memory");
        }
        bus->subscriptions = grown;
        bus->capacity = capacity;
    }
    lcm_subscription_t *lcm_subscription = lcm_subscribe(bus->lcm, pattern, deliver, subscription);
    if (lcm_subscription == NULL) {
        free(subscription);
        return bus_trouble(bus->url, "cannot listen on the bus", error);
    }
    lcm_subscription_set_queue_capacity(lcm_subscription, 0); /* no limit */
    bus->subscriptions[bus->n_subscriptions++] = subscription;
    return true;
}

bool bus_publish(struct bus *bus, const char *channel, const void *bytes, int length)
{
    return lcm_publish(bus->lcm, channel, bytes, (unsigned)length) == 0;
}

int bus_wait(struct bus *bus, int timeout_ms)
{
    int handled = 0;
    for (; handled < BUS_BATCH; handled++) {
        int answer = lcm_handle_timeout(bus->lcm, handled == 0 ? timeout_ms : 0);
        if (answer < 0 && errno == EINTR)
            return handled;
        if (answer < 0)
            return -1;
        if (answer == 0)
            break;
    }
    return handled;
}

static void count_echo(void *user, const char *channel, const uint8_t *bytes, int length)
{
    (void)channel;
    (void)bytes;
    (void)length;
    ++*(int *)user;
}

bool bus_check(const char *url, struct error *error)
{
    struct bus *bus = bus_open(url, error);
    if (bus == NULL)
        return false;
    int echoes = 0;
    bool ok = bus_subscribe(bus, "DSE_CHECK", count_echo, &echoes, error);
    for (int i = 0; ok && echoes == 0 && i < CHECK_TRIES; i++) {
        bus_publish(bus, "DSE_CHECK", "?", 1);
        if (bus_wait(bus, CHECK_WAIT_MS) < 0)
            break;
    }
    if (ok && echoes == 0)
        ok = bus_trouble(bus->url, "messages do not come back from the bus", error);
    bus_close(bus);
    return ok;
}
