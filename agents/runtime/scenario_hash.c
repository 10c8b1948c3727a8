/* A number for the experiment: FNV-1a over the values that libcyaml loaded, in the schema's order.
 */
#include <string.h>

#include "methods/method.h"
#include "runtime/scenario_internal.h"

#define FNV_OFFSET 0xcbf29ce484222325u
#define FNV_PRIME  0x100000001b3u

static uint64_t add_byte(uint64_t hash, unsigned char byte)
{
    return (hash ^ byte) * FNV_PRIME;
}

/* Low byte first on every machine. */
static uint64_t add_number(uint64_t hash, uint64_t value)
{
    for (int i = 0; i < 8; i++)
        hash = add_byte(hash, (unsigned char)(value >> (8 * i)));
    return hash;
}

static uint64_t add_text(uint64_t hash, const char *text)
{
    for (; *text != '\0'; text++)
        hash = add_byte(hash, (unsigned char)*text);
    return add_byte(hash, 0);
}

/* The bits of a scalar of 1, 2, 4 or 8 bytes. -0 counts as 0. */
static uint64_t scalar(const cyaml_schema_value_t *schema, const unsigned char *data)
{
    uint8_t one = 0;
    uint16_t two = 0;
    uint32_t four = 0;
    uint64_t eight = 0;
    double real = 0;
    if (schema->type == CYAML_FLOAT && schema->data_size == sizeof real) {
        memcpy(&real, data, sizeof real);
        real = real == 0 ? 0 : real;
        memcpy(&eight, &real, sizeof eight);
        return eight;
    }
    switch (schema->data_size) {
    case 1:
        memcpy(&one, data, 1);
        return one;
    case 2:
        memcpy(&two, data, 2);
        return two;
    case 4:
        memcpy(&four, data, 4);
        return four;
    default:
        memcpy(&eight, data, 8);
        return eight;
    }
}

static const unsigned char *pointer_at(const unsigned char *data)
{
    const unsigned char *pointer = NULL;
    memcpy(&pointer, data, sizeof pointer);
    return pointer;
}

static uint64_t count_at(const unsigned char *base, const cyaml_schema_field_t *field)
{
    const cyaml_schema_value_t size = {.type = CYAML_UINT, .data_size = field->count_size};
    return field->value.type == CYAML_SEQUENCE_FIXED ? field->value.sequence.max
                                                     : scalar(&size, base + field->count_offset);
}

static uint64_t add_fields(uint64_t hash, const cyaml_schema_field_t *fields,
                           const unsigned char *base, bool top);

/* One value, not a sequence. */
static uint64_t add_value(uint64_t hash, const cyaml_schema_value_t *schema,
                          const unsigned char *data)
{
    if (schema->type == CYAML_STRING)
        return add_text(hash, (const char *)data);
    if (schema->type == CYAML_MAPPING)
        return add_number(hash, add_fields(FNV_OFFSET, schema->mapping.fields, data, false));
    return add_number(hash, scalar(schema, data));
}

static uint64_t add_sequence(uint64_t hash, const cyaml_schema_value_t *schema, uint64_t count,
                             const unsigned char *data)
{
    const cyaml_schema_value_t *entry = schema->sequence.entry;
    hash = add_number(hash, count);
    for (uint64_t i = 0; i < count; i++) {
        const unsigned char *at = data + i * schema->data_size;
        if ((entry->flags & CYAML_FLAG_POINTER) != 0)
            at = pointer_at(at);
        if (at != NULL)
            hash = add_value(hash, entry, at);
    }
    return hash;
}

static bool is_scalar(const cyaml_schema_value_t *schema)
{
    return schema->type == CYAML_FLOAT || schema->type == CYAML_INT || schema->type == CYAML_UINT ||
           schema->type == CYAML_BOOL || schema->type == CYAML_ENUM;
}

/* What cannot change a result: titles anywhere, and some keys of the scenario itself. */
static bool has_no_effect(const char *key, bool top)
{
    return strcmp(key, "title") == 0 ||
           (top && (strcmp(key, "source") == 0 || strcmp(key, "timeouts") == 0));
}

/* A scalar 0 or a group of such. */
static bool is_default(const cyaml_schema_value_t *schema, const unsigned char *data)
{
    if ((schema->flags & CYAML_FLAG_POINTER) != 0)
        return false;
    if (schema->type == CYAML_MAPPING)
        return add_fields(FNV_OFFSET, schema->mapping.fields, data, false) == FNV_OFFSET;
    return is_scalar(schema) && scalar(schema, data) == 0;
}

/* What is zero is left out: zero is the default, so a key that a later version adds does not change
 * the hash of the scenarios that are there. */
static uint64_t add_fields(uint64_t hash, const cyaml_schema_field_t *fields,
                           const unsigned char *base, bool top)
{
    for (const cyaml_schema_field_t *field = fields; field->key != NULL; field++) {
        const unsigned char *data = base + field->data_offset;
        if (has_no_effect(field->key, top))
            continue;
        if ((field->value.flags & CYAML_FLAG_POINTER) != 0) {
            data = pointer_at(data);
            if (data == NULL)
                continue;
        }
        if (is_default(&field->value, data))
            continue;
        hash = add_text(hash, field->key);
        if (field->value.type == CYAML_SEQUENCE || field->value.type == CYAML_SEQUENCE_FIXED)
            hash = add_sequence(hash, &field->value, count_at(base, field), data);
        else
            hash = add_value(hash, &field->value, data);
    }
    return hash;
}

uint64_t scenario_hash(const struct scenario *scenario, const cyaml_schema_value_t *schema)
{
    return add_fields(FNV_OFFSET, schema->mapping.fields, (const unsigned char *)scenario, true);
}

uint64_t scenario_hash_fates(uint64_t hash, const struct scenario *scenario)
{
    for (unsigned i = 0; i < scenario->networks_count; i++) {
        const struct dse_link_config *link = scenario_link_fates(&scenario->networks[i]);
        if (link == NULL || link->table == NULL)
            continue;
        const int64_t entries = (int64_t)link->nodes * link->nodes * link->stamps;
        hash = add_number(hash, (uint64_t)link->stamps);
        for (int64_t k = 0; k < entries; k++)
            hash = add_number(hash, (uint64_t)(int64_t)link->table[k]);
    }
    return hash;
}
