/* The link of a network: checked, and turned into what libdse needs to tell each packet's fate. */
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "methods/method.h"
#include "runtime/networks.h"
#include "runtime/scenario_internal.h"

#define MAX_ENTRIES 50000000 /* of a recorded network: 100 MB */

struct scenario_fates {
    struct dse_link_config config;
    struct dse_link_outage *outages;
    int16_t *table;
};

struct place {
    struct scenario_tree *tree;
    struct scenario *scenario;
    const struct scenario_link *link;
    struct scenario_fates *fates;
    struct error *error;
    char path[SCENARIO_PATH_SIZE]; /* networks[i].link */
};

static bool fail(const struct place *p, const char *key, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

static bool fail(const struct place *p, const char *key, const char *format, ...)
{
    char path[SCENARIO_PATH_SIZE + 64], message[768];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    snprintf(path, sizeof path, "%s%s%s", p->path, key[0] != '\0' ? "." : "", key);
    return scenario_fail(p->tree, scenario_tree_find(p->tree, path), path, p->error, "%s", message);
}

/* ---- a recorded network ---- */

static bool wrong_row(const struct place *p, int line, const char *row)
{
    return fail(p, "file",
                "%s:%d: '%.60s' is not to,from,stamp,delay with two different nodes from 0 to %d, "
                "a stamp >= 0 and a delay <= %d (-1: lost)",
                p->link->file, line, row, p->fates->config.nodes - 1, SCENARIO_MAX_DELAY);
}

struct row {
    long long to, from, stamp, delay;
};

/* False when the text is none; an empty line, a comment or the head has from = -1. */
static bool read_row(const struct place *p, const char *text, struct row *row)
{
    const int nodes = p->fates->config.nodes;
    int used = 0;
    *row = (struct row){.from = -1};
    if (text[0] == '\0' || text[0] == '#' || strcmp(text, "to,from,stamp,delay") == 0)
        return true;
    int fields = sscanf(text, "%lld,%lld,%lld,%lld%n", &row->to, &row->from, &row->stamp,
                        &row->delay, &used);
    return fields == 4 && text[used] == '\0' && row->to >= 0 && row->to < nodes && row->from >= 0 &&
           row->from < nodes && row->to != row->from && row->stamp >= 0 && row->delay >= -1 &&
           row->delay <= SCENARIO_MAX_DELAY;
}

/* All rows of the file: into the table, or without one only counted. A recording may be longer than
 * the run. */
static bool read_rows(const struct place *p, const char *text, int64_t *stamps)
{
    const int64_t samples = scenario_samples(p->scenario);
    const struct dse_link_config *config = &p->fates->config;
    char line[256];
    *stamps = 0;
    for (int number = 1; *text != '\0'; number++) {
        const size_t length = strcspn(text, "\n");
        struct row row;
        snprintf(line, sizeof line, "%.*s", (int)(length < sizeof line ? length : sizeof line - 1),
                 text);
        line[strcspn(line, "\r")] = '\0';
        if (!read_row(p, line, &row))
            return wrong_row(p, number, line);
        const bool counts = row.from >= 0 && row.stamp < samples;
        if (counts && row.stamp >= *stamps)
            *stamps = row.stamp + 1;
        if (counts && p->fates->table != NULL)
            p->fates->table[(row.to * config->nodes + row.from) * config->stamps + row.stamp] =
                (int16_t)row.delay;
        text += length + (text[length] != '\0');
    }
    return true;
}

/* What is not listed is lost. */
static bool read_recording(const struct place *p)
{
    struct dse_link_config *config = &p->fates->config;
    struct error why = {.text = ""};
    int64_t stamps = 0;
    const char *text = scenario_part_text(p->tree, p->scenario, p->link->file, &why);
    if (text == NULL)
        return fail(p, "file", "%s", why.text);
    if (!read_rows(p, text, &stamps))
        return false;
    const int64_t pairs = (int64_t)config->nodes * config->nodes;
    if (stamps == 0)
        return fail(p, "file", "%s: has no row to,from,stamp,delay", p->link->file);
    if (stamps > MAX_ENTRIES / pairs)
        return fail(p, "file", "%s: too many stamps for %d nodes", p->link->file, config->nodes);
    p->fates->table = malloc((size_t)(pairs * stamps) * sizeof *p->fates->table);
    if (p->fates->table == NULL)
        return error_set(p->error, "%s: out of memory", p->tree->file);
    for (int64_t k = 0; k < pairs * stamps; k++)
        p->fates->table[k] = DSE_LINK_LOST;
    config->stamps = (int)stamps;
    config->table = p->fates->table;
    return read_rows(p, text, &stamps);
}

/* ---- outages ---- */

static bool judge_outage(const struct place *p, unsigned k)
{
    const struct scenario_outage *outage = &p->link->outages[k];
    const int nodes = p->fates->config.nodes;
    const int ends[2] = {outage->from, outage->to};
    char key[64];
    for (int e = 0; e < 2; e++) {
        snprintf(key, sizeof key, "outages[%u].%s", k, e == 0 ? "from" : "to");
        if (ends[e] >= nodes)
            return fail(p, key, "there is no node %d: nodes are 0 to %d, -1 is any", ends[e],
                        nodes - 1);
    }
    snprintf(key, sizeof key, "outages[%u]", k);
    if (outage->from >= 0 && outage->from == outage->to)
        return fail(p, key, "node %d hears itself always", outage->from);
    if (outage->end_s > 0 && outage->end_s <= outage->start_s)
        return fail(p, key, "ends at %.10g s, which is not after its start at %.10g s",
                    outage->end_s, outage->start_s);
    if (outage->start_s / p->scenario->time.period_s > SCENARIO_MAX_SAMPLES ||
        outage->end_s / p->scenario->time.period_s > SCENARIO_MAX_SAMPLES)
        return fail(p, key, "lies beyond the longest run");
    p->fates->outages[k] = (struct dse_link_outage){
        .from = outage->from,
        .to = outage->to,
        .first = scenario_sample_at(p->scenario, outage->start_s),
        .end = outage->end_s > 0 ? scenario_sample_at(p->scenario, outage->end_s) : INT64_MAX};
    return true;
}

static bool judge_outages(const struct place *p)
{
    const unsigned count = p->link->outages_count;
    p->fates->outages = calloc(count + 1, sizeof *p->fates->outages);
    if (p->fates->outages == NULL)
        return error_set(p->error, "%s: out of memory", p->tree->file);
    for (unsigned k = 0; k < count; k++)
        if (!judge_outage(p, k))
            return false;
    p->fates->config.outages = p->fates->outages;
    p->fates->config.n_outages = (int)count;
    return true;
}

/* ---- the whole ---- */

static bool judge_numbers(const struct place *p)
{
    const struct scenario_link *link = p->link;
    if (link->file == NULL)
        return !(link->loss > 0 && link->T_m == 0) ||
               fail(p, "T_m", "0 allows no loss, but loss is %.10g; state T_m >= 1", link->loss);
    const char *unused = link->T_m > 0    ? "T_m"
                         : link->loss > 0 ? "loss"
                         : link->seed > 0 ? "seed"
                                          : NULL;
    return unused == NULL || fail(p, unused, "is not used: the file says what was lost");
}

static bool make(struct place *p, const struct scenario_network *network, int nodes)
{
    const struct method *method = method_at(scenario_method(network));
    if (method == NULL || !method->uses_link)
        return fail(p, "", "%s cannot work with messages that are late or lost; leave it out",
                    method != NULL ? method->name : "the method");
    p->fates->config = (struct dse_link_config){.max_delay = (int)p->link->D,
                                                .max_losses = (int)p->link->T_m,
                                                .loss = p->link->loss,
                                                .seed = p->scenario->seed + p->link->seed,
                                                .nodes = nodes};
    return judge_numbers(p) && judge_outages(p) && (p->link->file == NULL || read_recording(p));
}

bool scenario_link_make(struct scenario_tree *tree, struct scenario *scenario, unsigned i,
                        struct error *error)
{
    struct scenario_network *network = &scenario->networks[i];
    if (network->link == NULL)
        return true;
    const int nodes = network_nodes(scenario, (int)i, NULL, error);
    network->fates = calloc(1, sizeof *network->fates);
    if (network->fates == NULL)
        return error_set(error, "%s: out of memory", tree->file);
    struct place place = {.tree = tree,
                          .scenario = scenario,
                          .link = network->link,
                          .fates = network->fates,
                          .error = error};
    snprintf(place.path, sizeof place.path, "networks[%u].link", i);
    return nodes > 0 && make(&place, network, nodes);
}

void scenario_link_free(struct scenario_fates *fates)
{
    if (fates == NULL)
        return;
    free(fates->outages);
    free(fates->table);
    free(fates);
}

const struct dse_link_config *scenario_link_fates(const struct scenario_network *network)
{
    return network->fates != NULL ? &network->fates->config : NULL;
}
