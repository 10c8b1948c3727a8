/* FNV-1a, 64 bits: fingerprints of scenarios and of sequences of estimates. */
#ifndef DSE_RUNTIME_FINGERPRINT_H
#define DSE_RUNTIME_FINGERPRINT_H

#include <stddef.h>
#include <stdint.h>

#define FINGERPRINT_START UINT64_C(0xcbf29ce484222325)

static inline uint64_t fingerprint_add(uint64_t fingerprint, const void *bytes, size_t length)
{
    const uint8_t *byte = bytes;
    for (size_t i = 0; i < length; i++) {
        fingerprint ^= byte[i];
        fingerprint *= UINT64_C(0x100000001b3);
    }
    return fingerprint;
}

#endif
