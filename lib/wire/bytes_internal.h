/* Big-endian numbers in bytes, independent of the machine's own order and alignment. */
#ifndef DSE_WIRE_BYTES_INTERNAL_H
#define DSE_WIRE_BYTES_INTERNAL_H

#include <stdint.h>

static inline uint32_t wire_get32(const uint8_t *bytes)
{
    return (uint32_t)bytes[0] << 24 | (uint32_t)bytes[1] << 16 | (uint32_t)bytes[2] << 8 | bytes[3];
}

static inline uint64_t wire_get64(const uint8_t *bytes)
{
    return (uint64_t)wire_get32(bytes) << 32 | wire_get32(bytes + 4);
}

static inline void wire_put32(uint8_t *bytes, uint32_t value)
{
    for (int i = 0; i < 4; i++)
        bytes[i] = (uint8_t)(value >> (24 - 8 * i));
}

#endif
