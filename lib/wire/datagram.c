/* LCM's small-message datagrams. */
#include <stddef.h>

#include "bytes_internal.h"
#include "dse/wire.h"

#define MAGIC_SMALL    0x4c433032u /* "LC02" */
#define MAGIC_FRAGMENT 0x4c433033u /* "LC03" */

/* Length of the channel name in `size` bytes: DSE_WIRE_MAX_CHANNEL + 1 when the name is longer,
 * -1 when the bytes end before the name does. */
static int channel_length(const char *name, int size)
{
    for (int i = 0; i <= DSE_WIRE_MAX_CHANNEL; i++) {
        if (i >= size)
            return -1;
        if (name[i] == '\0')
            return i;
    }
    return DSE_WIRE_MAX_CHANNEL + 1;
}

enum dse_wire_verdict dse_wire_decode(const uint8_t *datagram, int length,
                                      struct dse_wire_message *message)
{
    if (length < DSE_WIRE_HEADER_BYTES)
        return DSE_WIRE_TOO_SHORT;
    uint32_t magic = wire_get32(datagram);
    if (magic == MAGIC_FRAGMENT)
        return DSE_WIRE_FRAGMENT;
    if (magic != MAGIC_SMALL)
        return DSE_WIRE_NOT_LCM;

    const char *channel = (const char *)datagram + DSE_WIRE_HEADER_BYTES;
    int name = channel_length(channel, length - DSE_WIRE_HEADER_BYTES);
    if (name < 0)
        return DSE_WIRE_TOO_SHORT;
    if (name == 0 || name > DSE_WIRE_MAX_CHANNEL)
        return DSE_WIRE_BAD_CHANNEL;

    message->sequence = wire_get32(datagram + 4);
    message->channel = channel;
    message->channel_length = name;
    message->payload = datagram + DSE_WIRE_PAYLOAD_OFFSET(name);
    message->payload_length = length - DSE_WIRE_PAYLOAD_OFFSET(name);
    return DSE_WIRE_OK;
}

enum dse_status dse_wire_encode(uint32_t sequence, const char *channel, const uint8_t *payload,
                                int payload_length, uint8_t *datagram, int capacity, int *length)
{
    int name = channel_length(channel, DSE_WIRE_MAX_CHANNEL + 1);
    if (name < 1 || name > DSE_WIRE_MAX_CHANNEL || payload_length < 0 || capacity < 0)
        return DSE_EINVAL;
    int room = capacity < DSE_WIRE_MAX_DATAGRAM ? capacity : DSE_WIRE_MAX_DATAGRAM;
    if (payload_length > room - DSE_WIRE_PAYLOAD_OFFSET(name))
        return DSE_ESTORAGE;

    uint8_t *body = datagram + DSE_WIRE_PAYLOAD_OFFSET(name);
    if (payload != body)
        for (int i = 0; i < payload_length; i++)
            body[i] = payload[i];
    wire_put32(datagram, MAGIC_SMALL);
    wire_put32(datagram + 4, sequence);
    for (int i = 0; i <= name; i++)
        datagram[DSE_WIRE_HEADER_BYTES + i] = (uint8_t)channel[i];
    *length = DSE_WIRE_PAYLOAD_OFFSET(name) + payload_length;
    return DSE_OK;
}
