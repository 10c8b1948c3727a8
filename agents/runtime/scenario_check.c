/* Does the document fit the schema? Checked before libcyaml loads it, because libcyaml's messages
 * name neither line nor remedy, and it knows no limits. */
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/scenario_internal.h"

struct check {
    struct scenario_tree *tree;
    const struct dse_plant *plant; /* NULL while unknown: list lengths are not checked then */
    struct error *error;
    char path[SCENARIO_PATH_SIZE];
};

static bool check_value(struct check *c, const cyaml_schema_value_t *schema, int node);

/* ---- the path, for messages ---- */

static size_t path_key(struct check *c, const char *key)
{
    size_t n = strlen(c->path);
    snprintf(c->path + n, sizeof c->path - n, "%s%s", n > 0 ? "." : "", key);
    return n;
}

static size_t path_index(struct check *c, int i)
{
    size_t n = strlen(c->path);
    snprintf(c->path + n, sizeof c->path - n, "[%d]", i);
    return n;
}

static const char *meaning(const struct check *c)
{
    const struct scenario_rule *rule = scenario_rule_find(c->path);
    return rule != NULL ? rule->meaning : "dse-run --keys lists all keys";
}

/* What stands at a node, in a few words: "abc", a list, nothing. */
static const char *found(struct check *c, int node, char *text, size_t size)
{
    const yaml_node_t *at = scenario_tree_node(c->tree, node);
    if (at->type == YAML_SEQUENCE_NODE)
        return "a list";
    if (at->type == YAML_MAPPING_NODE)
        return "a group of keys";
    if (at->data.scalar.length == 0)
        return "nothing";
    snprintf(text, size, "'%.60s'", (const char *)at->data.scalar.value);
    return text;
}

static bool fail_type(struct check *c, int node, const char *wanted)
{
    char text[80];
    return scenario_fail(c->tree, node, c->path, c->error, "must be %s, not %s (%s)", wanted,
                         found(c, node, text, sizeof text), meaning(c));
}

/* ---- numbers ---- */

bool scenario_number(const char *text, double *value, const char **wrong)
{
    static const char *const not_finite[] = {".nan", ".inf", "-.inf", "+.inf",   "nan",
                                             "inf",  "-inf", "+inf",  "infinity"};
    char *end = NULL;
    for (size_t i = 0; i < sizeof not_finite / sizeof not_finite[0]; i++) {
        *wrong = "is not a finite number";
        if (strcasecmp(text, not_finite[i]) == 0)
            return false;
    }
    *wrong = "is not a number";
    if (text[0] == '\0' || text[strspn(text, "+-.0123456789eE")] != '\0')
        return false;
    errno = 0;
    *value = strtod(text, &end);
    if (*end != '\0')
        return false;
    *wrong = isinf(*value) ? "is too large for a double" : "is too small for a double";
    return errno != ERANGE;
}

void scenario_limits_text(const struct scenario_rule *rule, char *text, size_t size)
{
    size_t n = 0;
    text[0] = '\0';
    if (isfinite(rule->min))
        n = (size_t)snprintf(text, size, "%s %.10g", rule->min_open ? ">" : ">=", rule->min);
    if (isfinite(rule->max) && n < size)
        snprintf(text + n, size - n, "%s<= %.10g", n > 0 ? " and " : "", rule->max);
}

static bool check_limits(struct check *c, int node, double value)
{
    const struct scenario_rule *rule = scenario_rule_find(c->path);
    if (rule == NULL)
        return true;
    bool low = rule->min_open ? !(value > rule->min) && isfinite(rule->min) : value < rule->min;
    if (!low && value <= rule->max)
        return true;
    char limits[64];
    scenario_limits_text(rule, limits, sizeof limits);
    return scenario_fail(c->tree, node, c->path, c->error,
                         "%.60s is out of range; it must be %s (%s)",
                         scenario_tree_text(c->tree, node), limits, rule->meaning);
}

static bool check_float(struct check *c, int node)
{
    const char *text = scenario_tree_text(c->tree, node);
    const char *wrong = NULL;
    double value = 0;
    if (text == NULL || text[0] == '\0')
        return fail_type(c, node, "a number");
    if (!scenario_number(text, &value, &wrong))
        return scenario_fail(c->tree, node, c->path, c->error, "'%.60s' %s (%s)", text, wrong,
                             meaning(c));
    return check_limits(c, node, value);
}

/* Decimal digits only: libcyaml would read 010 as 8. */
static bool check_integer(struct check *c, const cyaml_schema_value_t *schema, int node)
{
    const char *text = scenario_tree_text(c->tree, node);
    bool is_signed = schema->type == CYAML_INT;
    if (text == NULL || text[0] == '\0')
        return fail_type(c, node, "a whole number");
    const char *digits = text + (text[0] == '-' || text[0] == '+');
    size_t n = strspn(digits, "0123456789");
    bool plain = n > 0 && digits[n] == '\0' && (n == 1 || digits[0] != '0');
    if (!plain || (!is_signed && text[0] == '-'))
        return fail_type(c, node, is_signed ? "a whole number" : "a whole number >= 0");

    unsigned bits = 8 * schema->data_size - (is_signed ? 1 : 0);
    uint64_t largest = bits >= 64 ? UINT64_MAX : ((uint64_t)1 << bits) - 1;
    errno = 0;
    uint64_t magnitude = strtoull(digits, NULL, 10);
    if (errno == ERANGE || magnitude > largest)
        return scenario_fail(c->tree, node, c->path, c->error,
                             "%.60s is too large; the largest is %llu (%s)", text,
                             (unsigned long long)largest, meaning(c));
    return check_limits(c, node, text[0] == '-' ? -(double)magnitude : (double)magnitude);
}

/* ---- words ---- */

static bool check_word(struct check *c, const struct scenario_words *words, int node)
{
    const char *text = scenario_tree_text(c->tree, node);
    char list[512];
    for (int i = 0; text != NULL && i < words->count; i++)
        if (strcmp(words->word[i], text) == 0)
            return true;
    scenario_words_text(words, text != NULL ? text : "", list, sizeof list);
    char what[80];
    return scenario_fail(c->tree, node, c->path, c->error, "%s is not one of: %s",
                         found(c, node, what, sizeof what), list);
}

static bool check_enum(struct check *c, const cyaml_schema_value_t *schema, int node)
{
    struct scenario_words words = {.count = 0};
    for (uint32_t i = 0; i < schema->enumeration.count; i++)
        scenario_words_add(&words, schema->enumeration.strings[i].str);
    return check_word(c, &words, node);
}

static bool check_bool(struct check *c, int node)
{
    const struct scenario_words words = {.word = {"true", "false", "yes", "no", "on", "off"},
                                         .count = 6};
    return check_word(c, &words, node);
}

static bool check_text(struct check *c, const cyaml_schema_value_t *schema, int node)
{
    const char *text = scenario_tree_text(c->tree, node);
    if (text == NULL || (text[0] == '\0' && schema->string.min > 0))
        return fail_type(c, node, "a text");
    size_t length = strlen(text);
    if (length < schema->string.min || length > schema->string.max)
        return scenario_fail(c->tree, node, c->path, c->error,
                             "has %zu characters; it must have %u to %u (%s)", length,
                             schema->string.min, schema->string.max, meaning(c));
    return true;
}

/* ---- lists and groups ---- */

/* The length that the plant gives to a list, -1 when it gives none. */
static int wanted_count(const struct check *c, const char **each)
{
    const struct scenario_rule *rule = scenario_rule_find(c->path);
    if (c->plant == NULL || rule == NULL || rule->count == SCENARIO_COUNT_ANY)
        return -1;
    switch (rule->count) {
    case SCENARIO_PER_STATE:
        *each = "state";
        return c->plant->nx;
    case SCENARIO_PER_INPUT:
        *each = "input";
        return c->plant->nu;
    case SCENARIO_PER_OUTPUT:
        *each = "output";
        return c->plant->ny;
    case SCENARIO_PER_SUBSYSTEM:
        *each = "subsystem";
        return c->plant->n_subsystems;
    case SCENARIO_COUNT_ANY:
        break;
    }
    return -1;
}

/* ": T1, C1, T2, C2", as far as it helps. */
static const char *name_of(const struct dse_plant *plant, const char *each, int i)
{
    if (strcmp(each, "state") == 0)
        return plant->states[i].name;
    if (strcmp(each, "input") == 0)
        return plant->inputs[i].name;
    if (strcmp(each, "output") == 0)
        return plant->outputs[i].name;
    return plant->subsystems[i].name;
}

static bool fail_count(struct check *c, int node, int count, int wanted, const char *each)
{
    char names[256] = "";
    size_t n = 0;
    for (int i = 0; i < wanted && i < 12 && n < sizeof names; i++)
        n += (size_t)snprintf(names + n, sizeof names - n, "%s%s", i > 0 ? ", " : ": ",
                              name_of(c->plant, each, i));
    return scenario_fail(c->tree, node, c->path, c->error,
                         "has %d values; it must have %d, one per %s of %s%s%s (%s)", count, wanted,
                         each, c->plant->name, names, wanted > 12 ? ", .." : "", meaning(c));
}

static bool check_sequence(struct check *c, const cyaml_schema_value_t *schema, int node)
{
    const char *each = "";
    if (scenario_tree_node(c->tree, node)->type != YAML_SEQUENCE_NODE)
        return fail_type(c, node, "a list");
    int count = scenario_tree_count(c->tree, node);
    int wanted = wanted_count(c, &each);
    if (wanted >= 0 && count != wanted)
        return fail_count(c, node, count, wanted, each);
    if ((uint32_t)count < schema->sequence.min || (uint32_t)count > schema->sequence.max)
        return scenario_fail(c->tree, node, c->path, c->error,
                             "has %d entries; it must have %u to %u (%s)", count,
                             schema->sequence.min, schema->sequence.max, meaning(c));
    for (int i = 0; i < count; i++) {
        size_t n = path_index(c, i);
        if (!check_value(c, schema->sequence.entry, scenario_tree_item(c->tree, node, i)))
            return false;
        c->path[n] = '\0';
    }
    return true;
}

static bool check_known_keys(struct check *c, const cyaml_schema_field_t *fields, int node)
{
    const yaml_node_t *at = scenario_tree_node(c->tree, node);
    for (const yaml_node_pair_t *pair = at->data.mapping.pairs.start;
         pair < at->data.mapping.pairs.top; pair++) {
        const char *key = scenario_tree_text(c->tree, pair->key);
        if (scenario_schema_field(fields, key) != NULL)
            continue;
        struct scenario_words words = {.count = 0};
        for (const cyaml_schema_field_t *field = fields; field->key != NULL; field++)
            scenario_words_add(&words, field->key);
        char list[512], shown[64];
        scenario_words_text(&words, key, list, sizeof list);
        snprintf(shown, sizeof shown, "%.60s", key[0] != '\0' ? key : "''");
        path_key(c, shown);
        return scenario_fail(c->tree, pair->key, c->path, c->error, "unknown key; allowed here: %s",
                             list);
    }
    return true;
}

static bool check_mapping(struct check *c, const cyaml_schema_value_t *schema, int node)
{
    if (scenario_tree_node(c->tree, node)->type != YAML_MAPPING_NODE)
        return fail_type(c, node, "a group of keys");
    if (!check_known_keys(c, schema->mapping.fields, node))
        return false;
    for (const cyaml_schema_field_t *field = schema->mapping.fields; field->key != NULL; field++) {
        const yaml_node_pair_t *pair = scenario_tree_pair(c->tree, node, field->key);
        size_t n = path_key(c, field->key);
        if (pair == NULL && (field->value.flags & CYAML_FLAG_OPTIONAL) == 0)
            return scenario_fail(c->tree, node, c->path, c->error, "is missing (%s)", meaning(c));
        if (pair != NULL && !check_value(c, &field->value, pair->value))
            return false;
        c->path[n] = '\0';
    }
    return true;
}

static bool check_value(struct check *c, const cyaml_schema_value_t *schema, int node)
{
    switch (schema->type) {
    case CYAML_FLOAT:
        return check_float(c, node);
    case CYAML_INT:
    case CYAML_UINT:
        return check_integer(c, schema, node);
    case CYAML_BOOL:
        return check_bool(c, node);
    case CYAML_ENUM:
        return check_enum(c, schema, node);
    case CYAML_STRING:
        return check_text(c, schema, node);
    case CYAML_SEQUENCE:
    case CYAML_SEQUENCE_FIXED:
        return check_sequence(c, schema, node);
    case CYAML_MAPPING:
        return check_mapping(c, schema, node);
    default:
        return scenario_fail(c->tree, node, c->path, c->error,
                             "has a kind of value that scenarios do not use");
    }
}

/* The plant that the scenario itself describes: its section is checked first, because the lengths
 * of other lists follow from it. */
static bool make_linear(struct check *c, const cyaml_schema_value_t *schema)
{
    const cyaml_schema_field_t *plant = scenario_schema_field(schema->mapping.fields, "plant");
    const cyaml_schema_field_t *linear =
        scenario_schema_field(plant->value.mapping.fields, "linear");
    const yaml_node_pair_t *above = scenario_tree_pair(c->tree, 1, "plant");
    const yaml_node_pair_t *pair =
        above != NULL ? scenario_tree_pair(c->tree, above->value, "linear") : NULL;
    if (pair == NULL)
        return true; /* scenario_judge says so */
    int section = pair->value;
    snprintf(c->path, sizeof c->path, "plant.linear");
    if (!check_value(c, &linear->value, section))
        return false;
    c->path[0] = '\0';
    c->tree->linear = scenario_linear_make(c->tree, section, c->error);
    if (c->tree->linear == NULL)
        return false;
    c->plant = scenario_linear_process(c->tree->linear);
    return true;
}

bool scenario_check(struct scenario_tree *tree, const cyaml_schema_value_t *schema,
                    struct error *error)
{
    struct check check = {.tree = tree, .error = error, .path = ""};
    int name = scenario_tree_find(tree, "plant.name");
    const char *text = scenario_tree_text(tree, name);
    if (text != NULL)
        check.plant = dse_plant_find(text);
    if (text != NULL && strcmp(text, "linear") == 0 && !make_linear(&check, schema))
        return false;
    return check_value(&check, schema, 1);
}
