/* The table of all keys that a scenario can have, printed from the schema and its rules. */
#include <string.h>

#include "methods/method.h"
#include "runtime/scenario_internal.h"

static const char *type_of(const cyaml_schema_value_t *schema)
{
    switch (schema->type) {
    case CYAML_FLOAT:
        return "number";
    case CYAML_INT:
    case CYAML_UINT:
        return "whole number";
    case CYAML_BOOL:
        return "yes or no";
    case CYAML_ENUM:
        return "word";
    case CYAML_STRING:
        return "text";
    case CYAML_SEQUENCE:
    case CYAML_SEQUENCE_FIXED:
        return schema->sequence.entry->type == CYAML_MAPPING  ? "list of groups"
               : schema->sequence.entry->type == CYAML_ENUM   ? "list of words"
               : schema->sequence.entry->type == CYAML_STRING ? "list of texts"
                                                              : "list of numbers";
    default:
        return "group of keys";
    }
}

static const char *count_of(const struct scenario_rule *rule)
{
    switch (rule->count) {
    case SCENARIO_PER_STATE:
        return "; one per state";
    case SCENARIO_PER_INPUT:
        return "; one per input";
    case SCENARIO_PER_OUTPUT:
        return "; one per output";
    case SCENARIO_PER_SUBSYSTEM:
        return "; one per subsystem";
    default:
        return "";
    }
}

/* Allowed words, or the limits of a number. */
static void allowed_text(const cyaml_schema_value_t *schema, const struct scenario_rule *rule,
                         char *text, size_t size)
{
    size_t n = 0;
    scenario_limits_text(rule, text, size);
    if (schema->type == CYAML_SEQUENCE && schema->sequence.entry->type == CYAML_ENUM)
        schema = schema->sequence.entry;
    for (uint32_t i = 0; schema->type == CYAML_ENUM && i < schema->enumeration.count && n < size;
         i++)
        n += (size_t)snprintf(text + n, size - n, "%s%s", i > 0 ? "|" : "",
                              schema->enumeration.strings[i].str);
}

static void write_key(FILE *out, const char *path, const cyaml_schema_field_t *field)
{
    static const struct scenario_rule none = {.key = "", SCENARIO_ANY, .meaning = ""};
    const struct scenario_rule *rule = scenario_rule_find(path);
    bool optional = (field->value.flags & CYAML_FLAG_OPTIONAL) != 0;
    char allowed[160];
    if (rule == NULL)
        rule = &none;
    allowed_text(&field->value, rule, allowed, sizeof allowed);
    const char *absent = !optional ? "required" : rule->absent != NULL ? rule->absent : "none";
    fprintf(out, "  %-14s %-15s %-17s %-24s %s%s\n", field->key, type_of(&field->value), absent,
            allowed, rule->meaning, count_of(rule));
}

static const cyaml_schema_field_t *fields_below(const cyaml_schema_value_t *schema)
{
    if (schema->type == CYAML_MAPPING)
        return schema->mapping.fields;
    if (schema->type == CYAML_SEQUENCE && schema->sequence.entry->type == CYAML_MAPPING)
        return schema->sequence.entry->mapping.fields;
    return NULL;
}

/* The keys of one group, then the groups among them. */
static void write_group(FILE *out, const char *path, const char *title,
                        const cyaml_schema_field_t *fields)
{
    char below[SCENARIO_PATH_SIZE];
    const char *dot = path[0] != '\0' ? "." : "";
    fprintf(out, "%s%s%s\n", path, title[0] != '\0' && path[0] != '\0' ? ": " : "", title);
    for (const cyaml_schema_field_t *field = fields; field->key != NULL; field++) {
        snprintf(below, sizeof below, "%s%s%s", path, dot, field->key);
        if (fields_below(&field->value) == NULL)
            write_key(out, below, field);
    }
    for (const cyaml_schema_field_t *field = fields; field->key != NULL; field++) {
        const cyaml_schema_field_t *inner = fields_below(&field->value);
        if (inner == NULL)
            continue;
        const char *mark = field->value.type == CYAML_SEQUENCE ? "[]" : "";
        snprintf(below, sizeof below, "%s%s%s%s", path, dot, field->key, mark);
        const struct scenario_rule *rule = scenario_rule_find(below);
        const struct method *method =
            strcmp(path, "networks[]") == 0 ? method_find(field->key) : NULL;
        fputc('\n', out);
        write_group(out, below,
                    method != NULL ? method->title
                    : rule != NULL ? rule->meaning
                                   : "",
                    inner);
    }
}

void scenario_write_keys(FILE *out)
{
    struct scenario_schema schema;
    scenario_schema_make(&schema);
    fprintf(out, "  %-14s %-15s %-17s %-24s %s\n", "key", "type", "default", "allowed", "meaning");
    write_group(out, "", "scenario", schema.root.mapping.fields);
}

void scenario_print_keys(void)
{
    scenario_write_keys(stdout);
}
