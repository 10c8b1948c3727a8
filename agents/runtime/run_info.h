/* What makes a log explain itself: JSON objects described in lcmtypes/README.md. */
#ifndef DSE_RUNTIME_RUN_INFO_H
#define DSE_RUNTIME_RUN_INFO_H

#include <stdbool.h>
#include <stdint.h>

#include "methods/method.h"
#include "runtime/messages.h"
#include "runtime/scenario.h"

/* JSON text of the plant's run_info; the caller frees it. NULL when memory runs out. */
char *run_info_plant(const struct scenario *scenario, int64_t run_id, int pace, int64_t samples);

/* JSON text of a node's run_info. source_run: whose samples it used. */
char *run_info_node(const struct scenario *scenario, int network, int node,
                    const struct method *method, const struct method_info *info,
                    int64_t source_run);

/* A run_info being collected from its parts. */
struct run_info_text {
    int parts;
    int missing;
    bool have[MESSAGE_MAX_TEXT_PARTS];
    char text[MESSAGE_MAX_TEXT_PARTS * DSE_RUN_INFO_T_CAPACITY + 1];
};
/* Adds a part; true when the text is complete. */
bool run_info_add(struct run_info_text *info, const dse_run_info_t *message);

/* The recorded scenario in a plant's run_info: YAML text, file name, overrides, and the texts of
 * the files that it names. The caller frees them with run_info_scenario_free. False when the text
 * is not a plant's run_info. */
struct run_info_scenario {
    char *yaml;
    char *file;
    char **overrides;
    unsigned overrides_count;
    struct scenario_part *parts;
    unsigned parts_count;
    int64_t samples;
};
bool run_info_read_scenario(const char *json, struct run_info_scenario *scenario);
void run_info_scenario_free(struct run_info_scenario *scenario);

#endif
