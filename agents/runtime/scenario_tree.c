/* The YAML document as a tree in which every message finds its line. */
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/scenario_internal.h"

bool scenario_fail(struct scenario_tree *tree, int node, const char *path, struct error *error,
                   const char *format, ...)
{
    char message[768];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);

    const yaml_node_t *at = scenario_tree_node(tree, node);
    size_t line = at != NULL ? at->start_mark.line : 0;
    const char *colon = path[0] != '\0' ? ": " : "";
    if (line >= SCENARIO_OVERRIDE_LINE)
        return error_set(error, "%s (--set %.100s): %s%s%s", tree->file,
                         tree->overrides[line - SCENARIO_OVERRIDE_LINE], path, colon, message);
    return error_set(error, "%s:%zu: %s%s%s", tree->file, line + 1, path, colon, message);
}

/* ---- access ---- */

const char *scenario_document_text(yaml_document_t *document, int node)
{
    const yaml_node_t *at = yaml_document_get_node(document, node);
    return at != NULL && at->type == YAML_SCALAR_NODE ? (const char *)at->data.scalar.value : NULL;
}

yaml_node_pair_t *scenario_document_pair(yaml_document_t *document, int mapping, const char *key)
{
    yaml_node_t *at = yaml_document_get_node(document, mapping);
    if (at == NULL || at->type != YAML_MAPPING_NODE)
        return NULL;
    for (yaml_node_pair_t *p = at->data.mapping.pairs.start; p < at->data.mapping.pairs.top; p++) {
        const char *text = scenario_document_text(document, p->key);
        if (text != NULL && strcmp(text, key) == 0)
            return p;
    }
    return NULL;
}

void scenario_tree_free(struct scenario_tree *tree)
{
    scenario_linear_free(tree->linear);
    tree->linear = NULL;
    yaml_document_delete(&tree->document);
}

int scenario_tree_add(struct scenario_tree *tree, yaml_node_type_t type, const char *text,
                      unsigned source)
{
    yaml_document_t *document = &tree->document;
    int node = 0;
    if (type == YAML_SCALAR_NODE)
        node = yaml_document_add_scalar(document, NULL, (const yaml_char_t *)text,
                                        (int)strlen(text), YAML_ANY_SCALAR_STYLE);
    else if (type == YAML_SEQUENCE_NODE)
        node = yaml_document_add_sequence(document, NULL, YAML_ANY_SEQUENCE_STYLE);
    else
        node = yaml_document_add_mapping(document, NULL, YAML_ANY_MAPPING_STYLE);
    if (node != 0)
        scenario_tree_node(tree, node)->start_mark.line = SCENARIO_OVERRIDE_LINE + source;
    return node;
}

yaml_node_t *scenario_tree_node(struct scenario_tree *tree, int node)
{
    return yaml_document_get_node(&tree->document, node);
}

const char *scenario_tree_text(struct scenario_tree *tree, int node)
{
    return scenario_document_text(&tree->document, node);
}

yaml_node_pair_t *scenario_tree_pair(struct scenario_tree *tree, int mapping, const char *key)
{
    return scenario_document_pair(&tree->document, mapping, key);
}

int scenario_tree_count(struct scenario_tree *tree, int sequence)
{
    const yaml_node_t *at = scenario_tree_node(tree, sequence);
    if (at == NULL || at->type != YAML_SEQUENCE_NODE)
        return 0;
    return (int)(at->data.sequence.items.top - at->data.sequence.items.start);
}

int scenario_tree_item(struct scenario_tree *tree, int sequence, int i)
{
    return scenario_tree_node(tree, sequence)->data.sequence.items.start[i];
}

bool scenario_path_step(const char **path, char *step, size_t size)
{
    const char *p = *path;
    p += *p == '[' || *p == '.';
    size_t n = strcspn(p, ".[]");
    if (n == 0 || n >= size)
        return false;
    memcpy(step, p, n);
    step[n] = '\0';
    p += n;
    p += *p == ']';
    *path = p;
    return true;
}

int scenario_tree_find(struct scenario_tree *tree, const char *path)
{
    int node = 1;
    char step[64];
    while (scenario_path_step(&path, step, sizeof step)) {
        const yaml_node_t *at = scenario_tree_node(tree, node);
        int next = 0;
        if (at->type == YAML_MAPPING_NODE) {
            const yaml_node_pair_t *pair = scenario_tree_pair(tree, node, step);
            next = pair != NULL ? pair->value : 0;
        } else if (at->type == YAML_SEQUENCE_NODE) {
            int i = atoi(step);
            next = i < scenario_tree_count(tree, node) ? scenario_tree_item(tree, node, i) : 0;
        }
        if (next == 0)
            break;
        node = next;
    }
    return node;
}

/* ---- writing ---- */

struct text {
    char *bytes;
    size_t size, capacity;
};

static int append(void *context, unsigned char *bytes, size_t size)
{
    struct text *text = context;
    if (text->size + size > text->capacity) {
        size_t capacity = 2 * (text->size + size);
        char *grown = realloc(text->bytes, capacity);
        if (grown == NULL)
            return 0;
        text->bytes = grown;
        text->capacity = capacity;
    }
    memcpy(text->bytes + text->size, bytes, size);
    text->size += size;
    return 1;
}

char *scenario_tree_emit(struct scenario_tree *tree, size_t *size)
{
    struct text text = {.bytes = NULL};
    yaml_document_t document;
    yaml_emitter_t emitter;
    /* The emitter consumes what it writes, so it gets a copy. */
    if (!scenario_tree_copy(tree, &document))
        return NULL;
    if (!yaml_emitter_initialize(&emitter)) {
        yaml_document_delete(&document);
        return NULL;
    }
    yaml_emitter_set_output(&emitter, append, &text);
    yaml_emitter_set_unicode(&emitter, 1);
    yaml_emitter_set_width(&emitter, -1);
    bool good = yaml_emitter_open(&emitter);
    if (good)
        good = yaml_emitter_dump(&emitter, &document) && yaml_emitter_close(&emitter);
    else
        yaml_document_delete(&document);
    yaml_emitter_delete(&emitter);
    if (!good) {
        free(text.bytes);
        return NULL;
    }
    *size = text.size;
    return text.bytes;
}
