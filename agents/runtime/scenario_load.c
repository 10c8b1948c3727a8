/* From text to a tree: libyaml reads, then the document is copied with aliases expanded and merge
 * keys resolved. */
#include <stdarg.h>
#include <string.h>

#include "runtime/scenario_internal.h"

#define MAX_NODES 50000 /* aliases expanded: a small file can stand for a huge document */
#define MAX_DEPTH 64
#define MAX_KEYS  1000 /* of one mapping: they are compared pairwise */

/* ---- messages ---- */

/* Where a text comes from: "file:line: .." or, for an override, "file (--set key=value): ..". */
struct origin {
    const char *file;
    const char *override; /* NULL: the text is the file's */
};

static bool fail_at(const struct origin *origin, size_t line, struct error *error,
                    const char *format, ...) __attribute__((format(printf, 4, 5)));

static bool fail_at(const struct origin *origin, size_t line, struct error *error,
                    const char *format, ...)
{
    char message[512];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    if (origin->override != NULL)
        return error_set(error, "%s (--set %.100s): %s", origin->file, origin->override, message);
    return error_set(error, "%s:%zu: %s", origin->file, line + 1, message);
}

static size_t line_of(const char *text, size_t offset)
{
    size_t line = 0;
    for (size_t i = 0; i < offset && text[i] != '\0'; i++)
        line += text[i] == '\n';
    return line;
}

/* What libyaml says about text that is not YAML. */
static bool fail_syntax(const yaml_parser_t *parser, const char *text, size_t size,
                        const struct origin *origin, struct error *error)
{
    if (parser->error == YAML_MEMORY_ERROR)
        return error_set(error, "%s: out of memory", origin->file);
    if (parser->error == YAML_READER_ERROR)
        return fail_at(origin, line_of(text, parser->problem_offset), error,
                       "%s (byte %zu); a scenario is UTF-8 text", parser->problem,
                       parser->problem_offset);
    const yaml_mark_t *mark = &parser->problem_mark;
    bool tab = mark->index < size && text[mark->index] == '\t';
    return fail_at(origin, mark->line, error, "not valid YAML: %s%s%s, column %zu%s",
                   parser->context != NULL ? parser->context : "",
                   parser->context != NULL ? ", " : "", parser->problem, mark->column + 1,
                   tab ? " (a tab: indent with spaces)" : "");
}

/* ---- loading ---- */

/* Reads exactly one document that is not empty. */
static bool load_document(const char *text, const struct origin *origin, yaml_document_t *document,
                          struct error *error)
{
    size_t size = strlen(text);
    yaml_parser_t parser;
    if (!yaml_parser_initialize(&parser))
        return error_set(error, "%s: out of memory", origin->file);
    yaml_parser_set_input_string(&parser, (const unsigned char *)text, size);
    if (!yaml_parser_load(&parser, document)) {
        fail_syntax(&parser, text, size, origin, error);
        yaml_parser_delete(&parser);
        return false;
    }
    bool good = true;
    yaml_document_t next;
    if (yaml_document_get_root_node(document) == NULL) {
        good = fail_at(origin, 0, error, "there is nothing in it");
    } else if (!yaml_parser_load(&parser, &next)) {
        good = fail_syntax(&parser, text, size, origin, error);
    } else {
        const yaml_node_t *root = yaml_document_get_root_node(&next);
        if (root != NULL)
            good = fail_at(origin, root->start_mark.line, error,
                           "a second document begins; there must be one only");
        yaml_document_delete(&next);
    }
    yaml_parser_delete(&parser);
    if (!good)
        yaml_document_delete(document);
    return good;
}

/* A copy of one document into another, aliases expanded and merge keys resolved. */
struct copy {
    yaml_document_t *from;
    yaml_document_t *to;
    struct origin origin;
    bool resolve; /* expand merge keys and check keys; false: as it is */
    size_t line;  /* of every new node from an override */
    int nodes;
    struct error *error;
};

static int copy_node(struct copy *copy, int from, int depth);

static bool copy_fail(struct copy *copy, const yaml_node_t *at, const char *message)
{
    return fail_at(&copy->origin, at->start_mark.line, copy->error, "%s", message);
}

/* Bounds on what aliases and merge keys can make of a small file. */
static bool enter(struct copy *copy, const yaml_node_t *at, int depth)
{
    if (depth > MAX_DEPTH)
        return copy_fail(copy, at, "nested too deeply; does an alias contain itself?");
    if (++copy->nodes > MAX_NODES)
        return copy_fail(copy, at, "too many values (aliases count each time that they are used)");
    return true;
}

static bool is_merge_key(const yaml_node_t *key)
{
    return key->type == YAML_SCALAR_NODE && key->data.scalar.style == YAML_PLAIN_SCALAR_STYLE &&
           strcmp((const char *)key->data.scalar.value, "<<") == 0;
}

static bool copy_pair(struct copy *copy, const yaml_node_pair_t *pair, int to, int depth)
{
    int key = copy_node(copy, pair->key, depth + 1);
    int value = key != 0 ? copy_node(copy, pair->value, depth + 1) : 0;
    if (value == 0)
        return false;
    return yaml_document_append_mapping_pair(copy->to, to, key, value) ||
           error_set(copy->error, "%s: out of memory", copy->origin.file);
}

static bool copy_pairs(struct copy *copy, int from, int to, int depth, bool merged);

/* `<<: *other` and `<<: [*one, *other]`: keys that the mapping does not have itself. */
static bool merge(struct copy *copy, int from, int to, int depth)
{
    const yaml_node_t *at = yaml_document_get_node(copy->from, from);
    if (!enter(copy, at, depth))
        return false;
    if (at->type == YAML_MAPPING_NODE)
        return copy_pairs(copy, from, to, depth + 1, true);
    if (at->type != YAML_SEQUENCE_NODE)
        return copy_fail(copy, at, "<< must name a mapping");
    for (yaml_node_item_t *i = at->data.sequence.items.start; i < at->data.sequence.items.top; i++)
        if (!merge(copy, *i, to, depth + 1))
            return false;
    return true;
}

static bool copy_pairs(struct copy *copy, int from, int to, int depth, bool merged)
{
    const yaml_node_t *at = yaml_document_get_node(copy->from, from);
    const yaml_node_pair_t *begin = at->data.mapping.pairs.start;
    const yaml_node_pair_t *end = at->data.mapping.pairs.top;
    if (end - begin > MAX_KEYS)
        return copy_fail(copy, at, "too many keys in one place");
    for (const yaml_node_pair_t *pair = begin; pair < end; pair++) {
        const yaml_node_t *key = yaml_document_get_node(copy->from, pair->key);
        if (copy->resolve && key->type != YAML_SCALAR_NODE)
            return copy_fail(copy, key, "a key must be a word");
        if (copy->resolve && is_merge_key(key))
            continue;
        if (copy->resolve) {
            const char *name = (const char *)key->data.scalar.value;
            if (scenario_document_pair(copy->to, to, name) != NULL) {
                if (merged)
                    continue;
                return fail_at(&copy->origin, key->start_mark.line, copy->error,
                               "%.60s: given twice in the same place", name);
            }
        }
        if (!copy_pair(copy, pair, to, depth))
            return false;
    }
    for (const yaml_node_pair_t *pair = begin; copy->resolve && pair < end; pair++)
        if (is_merge_key(yaml_document_get_node(copy->from, pair->key)) &&
            !merge(copy, pair->value, to, depth + 1))
            return false;
    return true;
}

static int copy_scalar(struct copy *copy, const yaml_node_t *at)
{
    if (memchr(at->data.scalar.value, '\0', at->data.scalar.length) != NULL) {
        copy_fail(copy, at, "a text contains a zero character");
        return 0;
    }
    return yaml_document_add_scalar(copy->to, NULL, at->data.scalar.value,
                                    (int)at->data.scalar.length, at->data.scalar.style);
}

/* The copy's number; 0 and an error on failure. */
static int copy_node(struct copy *copy, int from, int depth)
{
    const yaml_node_t *at = yaml_document_get_node(copy->from, from);
    if (!enter(copy, at, depth))
        return 0;
    int to = 0;
    if (at->type == YAML_SCALAR_NODE)
        to = copy_scalar(copy, at);
    else if (at->type == YAML_SEQUENCE_NODE)
        to = yaml_document_add_sequence(copy->to, NULL, at->data.sequence.style);
    else
        to = yaml_document_add_mapping(copy->to, NULL, at->data.mapping.style);
    if (to == 0) {
        error_set(copy->error, "%s: out of memory", copy->origin.file);
        return 0;
    }
    yaml_document_get_node(copy->to, to)->start_mark.line =
        copy->origin.override == NULL ? at->start_mark.line : copy->line;

    if (at->type == YAML_MAPPING_NODE)
        return copy_pairs(copy, from, to, depth, false) ? to : 0;
    if (at->type == YAML_SEQUENCE_NODE) {
        yaml_node_item_t *end = at->data.sequence.items.top;
        for (yaml_node_item_t *item = at->data.sequence.items.start; item < end; item++) {
            int entry = copy_node(copy, *item, depth + 1);
            if (entry == 0)
                return 0;
            if (!yaml_document_append_sequence_item(copy->to, to, entry)) {
                error_set(copy->error, "%s: out of memory", copy->origin.file);
                return 0;
            }
        }
    }
    return to;
}

bool scenario_tree_load(struct scenario_tree *tree, const char *yaml, const char *file,
                        const char *const *overrides, unsigned overrides_count, struct error *error)
{
    const struct origin origin = {.file = file};
    yaml_document_t raw;
    memset(tree, 0, sizeof *tree);
    tree->file = file;
    tree->overrides = overrides;
    tree->overrides_count = overrides_count;
    if (!load_document(yaml, &origin, &raw, error))
        return false;
    if (!yaml_document_initialize(&tree->document, NULL, NULL, NULL, 1, 1)) {
        yaml_document_delete(&raw);
        return error_set(error, "%s: out of memory", file);
    }
    struct copy copy = {
        .from = &raw, .to = &tree->document, .origin = origin, .resolve = true, .error = error};
    bool good = copy_node(&copy, 1, 0) != 0;
    yaml_document_delete(&raw);
    if (!good)
        scenario_tree_free(tree);
    return good;
}

int scenario_tree_add_text(struct scenario_tree *tree, const char *yaml, unsigned source,
                           struct error *error)
{
    const struct origin origin = {.file = tree->file, .override = tree->overrides[source]};
    yaml_document_t raw;
    if (!load_document(yaml, &origin, &raw, error))
        return 0;
    struct copy copy = {.from = &raw,
                        .to = &tree->document,
                        .origin = origin,
                        .resolve = true,
                        .line = SCENARIO_OVERRIDE_LINE + source,
                        .error = error};
    int node = copy_node(&copy, 1, 0);
    yaml_document_delete(&raw);
    return node;
}

bool scenario_tree_copy(struct scenario_tree *tree, yaml_document_t *to)
{
    struct error ignored = {.text = ""};
    if (!yaml_document_initialize(to, NULL, NULL, NULL, 1, 1))
        return false;
    struct copy copy = {
        .from = &tree->document, .to = to, .origin = {.file = tree->file}, .error = &ignored};
    if (copy_node(&copy, 1, 0) != 0)
        return true;
    yaml_document_delete(to);
    return false;
}
