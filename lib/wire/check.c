/* Is it the message that it should be? And the words for all verdicts. */
#include "bytes_internal.h"
#include "dse/wire.h"

enum dse_wire_verdict dse_wire_check(const uint8_t *bytes, int length, uint64_t fingerprint,
                                     int expected_size)
{
    if (length < DSE_WIRE_FINGERPRINT_BYTES)
        return DSE_WIRE_TOO_SHORT;
    if (wire_get64(bytes) != fingerprint)
        return DSE_WIRE_WRONG_TYPE;
    return length == expected_size ? DSE_WIRE_OK : DSE_WIRE_WRONG_LENGTH;
}

const char *dse_wire_verdict_text(enum dse_wire_verdict verdict)
{
    switch (verdict) {
    case DSE_WIRE_OK:
        return "ok";
    case DSE_WIRE_TOO_SHORT:
        return "the bytes end too early";
    case DSE_WIRE_WRONG_TYPE:
        return "the fingerprint is that of another message type";
    case DSE_WIRE_WRONG_LENGTH:
        return "the length is not that of the message type";
    case DSE_WIRE_NOT_LCM:
        return "the datagram is not one of LCM";
    case DSE_WIRE_FRAGMENT:
        return "the datagram is a fragment of a larger message";
    case DSE_WIRE_BAD_CHANNEL:
        return "the channel name is empty or too long";
    }
    return "unknown verdict";
}
