/* Any bytes as a datagram: what is taken lies within them, and encodes to the same bytes again. */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "dse/wire.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void require(int condition)
{
    if (!condition)
        abort();
}

static void check_payload(const uint8_t *payload, int length)
{
    uint64_t fingerprint = 0;
    for (int i = 0; i < length && i < DSE_WIRE_FINGERPRINT_BYTES; i++)
        fingerprint = fingerprint << 8 | payload[i];
    const enum dse_wire_verdict own = dse_wire_check(payload, length, fingerprint, length);
    const enum dse_wire_verdict longer = dse_wire_check(payload, length, fingerprint, length + 1);
    const enum dse_wire_verdict other = dse_wire_check(payload, length, ~fingerprint, length);
    const int enough = length >= DSE_WIRE_FINGERPRINT_BYTES;
    require(own == (enough ? DSE_WIRE_OK : DSE_WIRE_TOO_SHORT));
    require(longer == (enough ? DSE_WIRE_WRONG_LENGTH : DSE_WIRE_TOO_SHORT));
    require(other == (enough ? DSE_WIRE_WRONG_TYPE : DSE_WIRE_TOO_SHORT));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static uint8_t again[DSE_WIRE_MAX_DATAGRAM];
    struct dse_wire_message message;
    if (size > sizeof again)
        return 0;
    check_payload(data, (int)size);
    if (dse_wire_decode(data, (int)size, &message) != DSE_WIRE_OK)
        return 0;
    require(message.channel_length >= 1 && message.channel_length <= DSE_WIRE_MAX_CHANNEL);
    require(strlen(message.channel) == (size_t)message.channel_length);
    require(message.payload_length >= 0 && message.payload >= data);
    require(message.payload + message.payload_length == data + size);
    check_payload(message.payload, message.payload_length);

    int length = 0;
    require(dse_wire_encode(message.sequence, message.channel, message.payload,
                            message.payload_length, again, (int)size, &length) == DSE_OK);
    require((size_t)length == size && memcmp(again, data, size) == 0);
    require(dse_wire_encode(message.sequence, message.channel, message.payload,
                            message.payload_length, again, (int)size - 1, &length) != DSE_OK);
    return 0;
}
