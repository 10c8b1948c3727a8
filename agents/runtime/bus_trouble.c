/* Why a bus does not work. */
#include "runtime/bus_trouble.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

static const char *const route_advice =
    "LCM needs a route for multicast. On a machine without a network, as root:\n"
    "    ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo\n"
    "or run everything in one process: dse-run --inproc";

/* The group and port of udpm://GROUP:PORT?..; what is left out has LCM's default value. */
static bool udpm_address(const char *url, struct sockaddr_in *address)
{
    char group[64] = "239.255.76.67";
    int port = 7667;
    if (strncmp(url, "udpm://", 7) != 0)
        return false;
    (void)sscanf(url + 7, "%63[0-9.]", group);
    const char *colon = strchr(url + 7, ':');
    if (colon != NULL && sscanf(colon + 1, "%d", &port) != 1)
        return false;
    *address = (struct sockaddr_in){.sin_family = AF_INET, .sin_port = htons((uint16_t)port)};
    return port > 0 && port < 65536 && inet_pton(AF_INET, group, &address->sin_addr) == 1;
}

/* Whether a program holds the port that does not share it, as all LCM programs do. */
static bool occupied(const struct sockaddr_in *address)
{
    struct sockaddr_in any = *address;
    any.sin_addr.s_addr = htonl(INADDR_ANY);
    int descriptor = socket(AF_INET, SOCK_DGRAM, 0);
    int yes = 1;
    if (descriptor < 0)
        return false;
    (void)setsockopt(descriptor, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    bool taken = bind(descriptor, (struct sockaddr *)&any, sizeof any) != 0 && errno == EADDRINUSE;
    close(descriptor);
    return taken;
}

bool bus_trouble(const char *url, const char *what, struct error *error)
{
    struct sockaddr_in address;
    if (strncmp(url, "udpm:", 5) != 0)
        return error_set(
            error, "%s %s: not a URL that LCM knows (udpm://group:port?ttl=0, memq://)", what, url);
    if (!udpm_address(url, &address))
        return error_set(error, "%s %s: must be udpm://group:port?ttl=0 with a port of 1 to 65535",
                         what, url);
    if (!IN_MULTICAST(ntohl(address.sin_addr.s_addr)))
        return error_set(error,
                         "%s %s: the group must be a multicast address, 224.0.0.0 to "
                         "239.255.255.255",
                         what, url);
    if (occupied(&address))
        return error_set(error,
                         "%s %s: another program occupies UDP port %d; choose another port with "
                         "--lcm-url",
                         what, url, ntohs(address.sin_port));
    return error_set(error, "%s %s.\n%s", what, url, route_advice);
}
