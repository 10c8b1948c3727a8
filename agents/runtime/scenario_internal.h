/* The parts of the scenario reader:
 *
 *     text -> scenario_tree_load -> scenario_override -> scenario_check -> libcyaml ->
 * scenario_judge
 *
 * The tree is libyaml's document, so that every message can say the line; libcyaml fills the
 * structures from the tree once the tree is known to fit the schema. */
#ifndef DSE_RUNTIME_SCENARIO_INTERNAL_H
#define DSE_RUNTIME_SCENARIO_INTERNAL_H

#include <stdio.h>

#include <yaml.h>

#include "runtime/scenario.h"

#define SCENARIO_PATH_SIZE 256

/* ---- scenario_schema.c ---- */

/* The schema refers to parts of itself: do not copy it. */
struct scenario_schema {
    cyaml_schema_field_t network[16 + SCENARIO_MAX_METHODS];
    cyaml_schema_value_t network_entry;
    cyaml_schema_field_t top[16];
    cyaml_schema_value_t root;
};

/* The scenario's own keys, and in a network one optional section per registered method. */
void scenario_schema_make(struct scenario_schema *schema);
/* The field called `key`, or NULL. */
const cyaml_schema_field_t *scenario_schema_field(const cyaml_schema_field_t *fields,
                                                  const char *key);
/* The rule for a path such as networks[0].high_gain_ekf.Q[1], or NULL: indices are ignored. */
const struct scenario_rule *scenario_rule_find(const char *path);
/* The base rules, ends with key NULL. */
extern const struct scenario_rule scenario_rules[];

/* ---- scenario_words.c: lists of allowed words for messages ---- */

#define SCENARIO_MAX_WORDS 160

struct scenario_words {
    const char *word[SCENARIO_MAX_WORDS];
    int count;
};

void scenario_words_add(struct scenario_words *words, const char *word);
/* Index of the word that `wrong` was probably meant to be, -1: none is near. */
int scenario_words_nearest(const struct scenario_words *words, const char *wrong);
/* "a, b, c (did you mean b?)", the list cut short where it does not fit. size >= 128. */
void scenario_words_text(const struct scenario_words *words, const char *wrong, char *text,
                         size_t size);

/* ---- scenario_load.c, scenario_tree.c ---- */

/* A node that an override brought in keeps, in place of its line, this plus the override's number.
 */
#define SCENARIO_OVERRIDE_LINE (SIZE_MAX / 2)

/* The document with aliases expanded and merge keys resolved: every node has one parent and may be
 * changed alone. Nodes are libyaml's: numbers from 1, the root is 1. */
struct scenario_tree {
    yaml_document_t document;
    const char *file;
    const char *const *overrides;
    unsigned overrides_count;
    struct scenario_linear_plant *linear; /* made by scenario_check, taken by scenario_judge */
    const struct scenario_part *parts;    /* given with the text, else read from files */
    unsigned parts_count;
};

/* Nothing to free after a failure. */
bool scenario_tree_load(struct scenario_tree *tree, const char *yaml, const char *file,
                        const char *const *overrides, unsigned overrides_count,
                        struct error *error);
void scenario_tree_free(struct scenario_tree *tree);
/* Reads YAML into the tree as what override number `source` says. Its root node, 0 on failure. */
int scenario_tree_add_text(struct scenario_tree *tree, const char *yaml, unsigned source,
                           struct error *error);
/* A new node that override number `source` makes necessary; 0 when out of memory. */
int scenario_tree_add(struct scenario_tree *tree, yaml_node_type_t type, const char *text,
                      unsigned source);
yaml_node_t *scenario_tree_node(struct scenario_tree *tree, int node);
/* A scalar's text, NULL for other nodes. */
const char *scenario_tree_text(struct scenario_tree *tree, int node);
/* The pair with this key of a mapping, or NULL. Valid until a node is added. */
yaml_node_pair_t *scenario_tree_pair(struct scenario_tree *tree, int mapping, const char *key);
/* The same two for a bare document. */
const char *scenario_document_text(yaml_document_t *document, int node);
yaml_node_pair_t *scenario_document_pair(yaml_document_t *document, int mapping, const char *key);
/* Number of entries of a sequence, and the node of one of them. */
int scenario_tree_count(struct scenario_tree *tree, int sequence);
int scenario_tree_item(struct scenario_tree *tree, int sequence, int i);
/* The node at a path, or the nearest one above it that exists. */
int scenario_tree_find(struct scenario_tree *tree, const char *path);
/* A second document with the same content; false when out of memory. */
bool scenario_tree_copy(struct scenario_tree *tree, yaml_document_t *to);
/* The tree as YAML text for libcyaml, freed by the caller; NULL when out of memory. */
char *scenario_tree_emit(struct scenario_tree *tree, size_t *size);

/* Cuts the next step off a path: "networks[0].name" and "networks.0.name" have the steps networks,
 * 0, name. False at the end, and when a step is empty or too long (then *path is not at its end).
 */
bool scenario_path_step(const char **path, char *step, size_t size);

/* Sets "file:line: path: message", or "file (--set key=value): path: message" for a node that an
 * override brought in. Returns false. */
bool scenario_fail(struct scenario_tree *tree, int node, const char *path, struct error *error,
                   const char *format, ...) __attribute__((format(printf, 5, 6)));

/* ---- scenario_override.c, scenario_check.c, scenario_judge.c, scenario_hash.c ---- */

/* Applies all overrides of the tree. */
bool scenario_override(struct scenario_tree *tree, const cyaml_schema_value_t *schema,
                       struct error *error);
/* Structure: keys, types, words, limits, and list lengths where they follow from the plant. */
bool scenario_check(struct scenario_tree *tree, const cyaml_schema_value_t *schema,
                    struct error *error);
/* Meaning: what the structure alone does not show. Sets scenario->process. */
bool scenario_judge(struct scenario_tree *tree, struct scenario *scenario, struct error *error);
/* The part of it about plant.drive, in scenario_drive.c. */
bool scenario_judge_drive(struct scenario_tree *tree, const struct scenario *scenario,
                          struct error *error);
/* The plant that the section plant.linear describes, scenario_linear.c: NULL and an error text when
 * its parts do not fit each other. The section itself fits the schema. */
struct scenario_linear_plant *scenario_linear_make(struct scenario_tree *tree, int section,
                                                   struct error *error);
/* linear may be NULL. */
void scenario_linear_free(struct scenario_linear_plant *linear);
const struct dse_plant *scenario_linear_process(const struct scenario_linear_plant *linear);
/* network->neighbours from network->graph, scenario_graph.c; path: networks[i].graph. */
bool scenario_graph_make(struct scenario_tree *tree, const char *path,
                         struct scenario_network *network, struct error *error);
/* graph may be NULL. */
void scenario_graph_free(struct method_graph *graph);
/* networks[i].fates from its link, scenario_link.c; the rest of the network is judged already. */
bool scenario_link_make(struct scenario_tree *tree, struct scenario *scenario, unsigned i,
                        struct error *error);
/* fates may be NULL. */
void scenario_link_free(struct scenario_fates *fates);
/* The text of a file that the scenario names, kept in scenario->parts, scenario_part.c. NULL and an
 * error text when there is none. */
const char *scenario_part_text(const struct scenario_tree *tree, struct scenario *scenario,
                               const char *name, struct error *error);
void scenario_parts_free(struct scenario_part *parts, unsigned count);
/* A whole file that has at most 1 MiB and no zero byte, freed by the caller; NULL and an error text
 * on failure. */
char *scenario_text(const char *path, struct error *error);
uint64_t scenario_hash(const struct scenario *scenario, const cyaml_schema_value_t *schema);
/* The hash with the fates of recorded networks. */
uint64_t scenario_hash_fates(uint64_t hash, const struct scenario *scenario);

/* A finite number, plainly written; false and what is wrong with it otherwise. */
bool scenario_number(const char *text, double *value, const char **wrong);
/* "> 1", ">= 0 and <= 5"; "" when there is no limit. */
void scenario_limits_text(const struct scenario_rule *rule, char *text, size_t size);

/* scenario_print_keys to a stream. */
void scenario_write_keys(FILE *out);

#endif
