/* --set key=value: changes the tree as if the file said so. Whether the result makes sense is left
 * to the checks that the file itself has to pass. */
#include <ctype.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/scenario_internal.h"

/* Where the key has led so far. */
struct cursor {
    struct scenario_tree *tree;
    struct error *error;
    unsigned source; /* number of the override */
    int node;
    const cyaml_schema_value_t *schema; /* of this node; NULL where it has none */
    char path[SCENARIO_PATH_SIZE];      /* as messages write it */
};

static bool fail(struct cursor *c, const char *format, ...) __attribute__((format(printf, 2, 3)));

static bool fail(struct cursor *c, const char *format, ...)
{
    char message[768];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    return error_set(c->error, "%s (--set %.100s): %s", c->tree->file,
                     c->tree->overrides[c->source], message);
}

/* A list whose entries are {name: .., value: ..}: written like a mapping on the command line. */
static bool is_named_list(const cyaml_schema_value_t *schema)
{
    if (schema == NULL || schema->type != CYAML_SEQUENCE ||
        schema->sequence.entry->type != CYAML_MAPPING)
        return false;
    const cyaml_schema_field_t *fields = schema->sequence.entry->mapping.fields;
    return scenario_schema_field(fields, "name") != NULL &&
           scenario_schema_field(fields, "value") != NULL;
}

static void path_add(struct cursor *c, const char *format, const char *step)
{
    size_t n = strlen(c->path);
    snprintf(c->path + n, sizeof c->path - n, format, step);
}

/* mapping[key] = value, the key new or not. */
static bool put(struct cursor *c, const char *key, int value)
{
    yaml_node_pair_t *pair = scenario_tree_pair(c->tree, c->node, key);
    if (pair != NULL) {
        pair->value = value;
        return true;
    }
    int name = scenario_tree_add(c->tree, YAML_SCALAR_NODE, key, c->source);
    if (name != 0 && value != 0 &&
        yaml_document_append_mapping_pair(&c->tree->document, c->node, name, value))
        return true;
    return fail(c, "out of memory");
}

/* Descends to mapping[key]; a missing one is made, `value` when this is the last step. */
static bool step_mapping(struct cursor *c, const char *key, int value)
{
    const cyaml_schema_field_t *field = NULL;
    if (c->schema != NULL && c->schema->type == CYAML_MAPPING)
        field = scenario_schema_field(c->schema->mapping.fields, key);
    c->schema = field != NULL ? &field->value : NULL;

    const yaml_node_pair_t *pair = scenario_tree_pair(c->tree, c->node, key);
    int next = pair != NULL ? pair->value : 0;
    if (value != 0 || next == 0) {
        next = value;
        if (next == 0)
            next = scenario_tree_add(
                c->tree, is_named_list(c->schema) ? YAML_SEQUENCE_NODE : YAML_MAPPING_NODE, "",
                c->source);
        if (!put(c, key, next))
            return false;
    }
    path_add(c, c->path[0] != '\0' ? ".%s" : "%s", key);
    c->node = next;
    return true;
}

/* The entry that a step means: by index, or by its name. -1: none. */
static int find_entry(struct cursor *c, const char *step, struct scenario_words *names)
{
    int count = scenario_tree_count(c->tree, c->node);
    for (int i = 0; i < count; i++) {
        const yaml_node_pair_t *pair =
            scenario_tree_pair(c->tree, scenario_tree_item(c->tree, c->node, i), "name");
        const char *name = pair != NULL ? scenario_tree_text(c->tree, pair->value) : NULL;
        if (name != NULL && strcmp(name, step) == 0)
            return i;
        if (name != NULL)
            scenario_words_add(names, name);
    }
    char *end = NULL;
    long i = strtol(step, &end, 10);
    bool number = isdigit((unsigned char)step[0]) && *end == '\0';
    return number && i < count ? (int)i : -1;
}

/* A new entry {name: step} of a named list; its index, -1 when out of memory. */
static int append_named(struct cursor *c, const char *step)
{
    yaml_document_t *document = &c->tree->document;
    int entry = scenario_tree_add(c->tree, YAML_MAPPING_NODE, "", c->source);
    int key = scenario_tree_add(c->tree, YAML_SCALAR_NODE, "name", c->source);
    int name = scenario_tree_add(c->tree, YAML_SCALAR_NODE, step, c->source);
    if (entry == 0 || key == 0 || name == 0 ||
        !yaml_document_append_mapping_pair(document, entry, key, name) ||
        !yaml_document_append_sequence_item(document, c->node, entry))
        return -1;
    return scenario_tree_count(c->tree, c->node) - 1;
}

static bool step_sequence(struct cursor *c, const char *step, int value)
{
    bool named = is_named_list(c->schema);
    struct scenario_words names = {.count = 0};
    int i = find_entry(c, step, &names);
    if (i < 0 && named && !isdigit((unsigned char)step[0])) {
        i = append_named(c, step);
        if (i < 0)
            return fail(c, "out of memory");
    }
    if (i < 0) {
        char text[512];
        if (names.count > 0)
            scenario_words_text(&names, step, text, sizeof text);
        else
            snprintf(text, sizeof text, "%d entries", scenario_tree_count(c->tree, c->node));
        return fail(c, "%s has no entry %s; there are: %s", c->path, step, text);
    }
    char index[16];
    snprintf(index, sizeof index, "%d", i);
    path_add(c, "[%s]", index);
    int entry = scenario_tree_item(c->tree, c->node, i);
    c->schema =
        c->schema != NULL && c->schema->type == CYAML_SEQUENCE ? c->schema->sequence.entry : NULL;
    if (value != 0 && named) {
        c->node = entry;
        return step_mapping(c, "value", value);
    }
    if (value != 0) {
        scenario_tree_node(c->tree, c->node)->data.sequence.items.start[i] = value;
        entry = value;
    }
    c->node = entry;
    return true;
}

static bool apply(struct cursor *c, const char *key, int value)
{
    char step[64];
    while (*key != '\0') {
        if (!scenario_path_step(&key, step, sizeof step))
            return fail(c, "a key is written as in plant.x0 or networks[0].name");
        int final = *key == '\0' ? value : 0;
        yaml_node_type_t type = scenario_tree_node(c->tree, c->node)->type;
        if (type == YAML_SCALAR_NODE)
            return fail(c, "%s is a single value, nothing lies below it", c->path);
        if (!(type == YAML_MAPPING_NODE ? step_mapping(c, step, final)
                                        : step_sequence(c, step, final)))
            return false;
    }
    return true;
}

static bool apply_one(struct cursor *c)
{
    const char *override = c->tree->overrides[c->source];
    const char *equals = strchr(override, '=');
    char key[SCENARIO_PATH_SIZE];
    size_t n = equals != NULL ? (size_t)(equals - override) : 0;
    if (n == 0 || n >= sizeof key)
        return fail(c, "expected key=value, as in seed=7 or plant.x0=[360, 3, 320, 2.5]");
    memcpy(key, override, n);
    key[n] = '\0';
    if (equals[1] == '\0')
        return fail(c, "there is no value after =");
    int value = scenario_tree_add_text(c->tree, equals + 1, c->source, c->error);
    return value != 0 && apply(c, key, value);
}

bool scenario_override(struct scenario_tree *tree, const cyaml_schema_value_t *schema,
                       struct error *error)
{
    for (unsigned i = 0; i < tree->overrides_count; i++) {
        struct cursor cursor = {
            .tree = tree, .error = error, .source = i, .node = 1, .schema = schema, .path = ""};
        if (!apply_one(&cursor))
            return false;
    }
    return true;
}
