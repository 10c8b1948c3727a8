/* LCM datagrams without LCM: for microcontrollers that speak UDP themselves, and the check that
 * comes before the decoding of any message.
 *
 * A small message of LCM's UDP multicast protocol is one datagram, all numbers big-endian:
 *
 *     byte 0   "LC02"
 *          4   sequence number, 32 bits, counts the messages of a sender
 *          8   channel name, 1 to 63 bytes, and a zero byte
 *          .   payload: 8 bytes fingerprint of the message type, then its fields
 *
 * Messages larger than a datagram travel in fragments ("LC03"). dse has none (lcmtypes/README.md),
 * so they are refused, with a verdict of their own. Nothing here allocates or reads beyond the
 * length that it was given. */
#ifndef DSE_WIRE_H
#define DSE_WIRE_H

#include <stdint.h>

#include "dse/status.h"

#define DSE_WIRE_HEADER_BYTES      8     /* magic and sequence number */
#define DSE_WIRE_MAX_CHANNEL       63    /* bytes of a channel name without its zero */
#define DSE_WIRE_FINGERPRINT_BYTES 8     /* at the start of every payload */
#define DSE_WIRE_MAX_DATAGRAM      65507 /* what UDP over IPv4 can carry */

/* Why bytes were taken or refused; a receiver counts each kind. */
enum dse_wire_verdict {
    DSE_WIRE_OK = 0,
    DSE_WIRE_TOO_SHORT,    /* ends within a header, a channel name or a fingerprint */
    DSE_WIRE_WRONG_TYPE,   /* the fingerprint is that of another message type */
    DSE_WIRE_WRONG_LENGTH, /* right type, but not its size */
    DSE_WIRE_NOT_LCM,      /* the datagram begins with something else */
    DSE_WIRE_FRAGMENT,     /* part of a message that is larger than a datagram */
    DSE_WIRE_BAD_CHANNEL   /* the channel name is empty or longer than 63 bytes */
};

/* One line of English about `verdict`, never NULL. */
const char *dse_wire_verdict_text(enum dse_wire_verdict verdict);

/* A datagram taken apart; the pointers point into it. */
struct dse_wire_message {
    uint32_t sequence;
    const char *channel; /* zero-terminated */
    int channel_length;  /* without the zero */
    const uint8_t *payload;
    int payload_length; /* >= 0 */
};

/* Takes a received datagram of `length` bytes apart. `message` is written only when it is OK. */
enum dse_wire_verdict dse_wire_decode(const uint8_t *datagram, int length,
                                      struct dse_wire_message *message);

/* Writes the datagram of a message and its length. `payload` may lie in `datagram` already, at
 * DSE_WIRE_PAYLOAD_OFFSET(channel length): then nothing is copied.
 *   DSE_EINVAL    channel empty or longer than 63 bytes, a length or capacity negative
 *   DSE_ESTORAGE  does not fit into `capacity` bytes, or into any UDP datagram */
enum dse_status dse_wire_encode(uint32_t sequence, const char *channel, const uint8_t *payload,
                                int payload_length, uint8_t *datagram, int capacity, int *length);

/* Where the payload begins behind a channel name of that many bytes. */
#define DSE_WIRE_PAYLOAD_OFFSET(channel_length) (DSE_WIRE_HEADER_BYTES + (channel_length) + 1)

/* Whether a payload is a message of the type with that fingerprint and fixed size: what a receiver
 * asks before it decodes. expected_size: of the whole payload, fingerprint included, as the
 * generated <type>_encoded_size() gives it. The answers are, in the order of the checks,
 * TOO_SHORT (no room for a fingerprint), WRONG_TYPE, WRONG_LENGTH, OK. */
enum dse_wire_verdict dse_wire_check(const uint8_t *bytes, int length, uint64_t fingerprint,
                                     int expected_size);

#endif
