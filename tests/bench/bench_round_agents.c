/* Rounds as the agents make them: the runtime's nodes and its loop, one node per process, the
 * plant's clock in the process of node 0. The methods are registered here, in place of the registry
 * of the programs: one that only talks, and the adaptive high-gain EKF with a time stamp per round.
 */
#include "bench_round.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dse_clock_t.h"
#include "methods/method.h"
#include "runtime/clock.h"
#include "runtime/node.h"

#define NODES   2
#define VALUES  3   /* as the high-gain EKF says in round 0 */
#define WARM_UP 500 /* rounds that are not measured */
#define RUN_ID  1
#define JOIN_S  10

static struct round_times *measured; /* of this process, NULL on side 1 */

/* ---- a method that only talks ---- */

struct talker {
    int rounds, node;
    double said;
    bool wrong;
};

struct talk_section {
    unsigned rounds;
};

static const cyaml_schema_field_t talk_fields[] = {
    CYAML_FIELD_UINT("rounds", CYAML_FLAG_DEFAULT, struct talk_section, rounds), CYAML_FIELD_END};
static const struct scenario_rule talk_rules[] = {
    {.key = "rounds", SCENARIO_AT_LEAST(1), .meaning = "rounds per sample"}, {.key = NULL}};

static int talk_nodes(const struct method_setup *setup)
{
    (void)setup;
    return NODES;
}

static void *talk_create(const struct method_setup *setup, struct method_info *info,
                         struct error *error)
{
    const struct talk_section *section = setup->section;
    struct talker *talker = calloc(1, sizeof *talker);
    if (talker == NULL) {
        error_set(error, "out of memory");
        return NULL;
    }
    talker->rounds = (int)section->rounds;
    talker->node = setup->node;
    *info = (struct method_info){.n_states = 1, .n_groups = 1, .n_neighbours = 1, .n_listeners = 1};
    snprintf(info->name, sizeof info->name, "talker");
    info->states[0] = info->groups[0] = setup->node;
    info->neighbours[0] = info->listeners[0] = 1 - setup->node;
    return talker;
}

static enum dse_status talk_begin(void *self, const struct method_sample *sample)
{
    (void)self;
    (void)sample;
    return DSE_OK;
}

static enum method_step talk_next(void *self, int round, struct method_plan *plan,
                                  struct method_message *message)
{
    struct talker *talker = self;
    (void)plan;
    if (measured != NULL && round >= WARM_UP)
        round_tick(measured);
    if (round == talker->rounds)
        return METHOD_DONE;
    talker->said = round;
    for (int i = 0; i < VALUES; i++)
        message->value[i] = talker->said;
    message->count = VALUES;
    return METHOD_ROUND;
}

static enum dse_status talk_receive(void *self, int round, int from,
                                    const struct method_message *message)
{
    struct talker *talker = self;
    bool right = from == 1 - talker->node && message->count == VALUES &&
                 (int)message->value[VALUES - 1] == round;
    talker->wrong = talker->wrong || !right;
    return right ? DSE_OK : DSE_EFORMAT;
}

static enum dse_status talk_finish(void *self, struct method_estimate *estimate)
{
    const struct talker *talker = self;
    estimate->health = talker->wrong ? DSE_HEALTH_DIVERGED : DSE_HEALTH_TRACKING;
    estimate->state[0] = estimate->variance[0] = talker->said;
    return talker->wrong ? DSE_EFORMAT : DSE_OK;
}

static const struct method talk_method = {.name = "talk",
                                          .title = "talks and listens",
                                          .fields = talk_fields,
                                          .section_size = sizeof(struct talk_section),
                                          .rules = talk_rules,
                                          .nodes = talk_nodes,
                                          .create = talk_create,
                                          .destroy = free,
                                          .begin = talk_begin,
                                          .next = talk_next,
                                          .receive = talk_receive,
                                          .finish = talk_finish};

/* ---- the high-gain EKF with a time stamp per round ---- */

extern const struct method high_gain_ekf_method;
static struct method stamped_method;

/* Round 0 also waits for the other node's sample to arrive, so that it is left out. */
static enum method_step stamped_next(void *self, int round, struct method_plan *plan,
                                     struct method_message *message)
{
    if (measured != NULL && round >= 1)
        round_tick(measured);
    enum method_step step = high_gain_ekf_method.next(self, round, plan, message);
    if (measured != NULL && step == METHOD_DONE)
        round_pause(measured);
    return step;
}

/* ---- the registry ---- */

const struct method *method_at(int i)
{
    stamped_method = high_gain_ekf_method;
    stamped_method.next = stamped_next;
    const struct method *const methods[] = {&talk_method, &stamped_method};
    return i >= 0 && i < (int)(sizeof methods / sizeof methods[0]) ? methods[i] : NULL;
}

const struct method *method_find(const char *name)
{
    for (int i = 0; method_at(i) != NULL; i++)
        if (strcmp(method_at(i)->name, name) == 0)
            return method_at(i);
    return NULL;
}

/* ---- the two processes ---- */

/* One sample of very many rounds. Nothing is repeated in it: what is measured is the undisturbed
 * exchange. */
static const char talk_scenario[] =
    "name: bench_talk\n"
    "time: {period_s: 1, duration_s: 1}\n"
    "plant: {name: cstr2, set: ch2}\n"
    "timeouts: {repeat_s: 5, give_up_s: 20}\n"
    "networks: [{name: talk, guess: [360, 3, 320, 2.5], talk: {rounds: 4500}}]\n";
_Static_assert(WARM_UP + ROUND_COUNT == 4500, "the rounds of talk_scenario");

/* The adaptive network of ahg-43; three measured rounds in each of its samples. */
static const char high_gain_scenario[] = "name: bench_high_gain\n"
                                         "time: {period_s: 1, duration_s: 1400}\n"
                                         "plant: {name: cstr2, set: ch2}\n"
                                         "networks:\n"
                                         "  - name: ahg\n"
                                         "    guess: [396, 2.6, 352, 10.5]\n"
                                         "    high_gain_ekf:\n"
                                         "      innovation: sum\n"
                                         "      communication: {kind: stages}\n"
                                         "      d: 0.02\n"
                                         "      DeltaT: 0.001\n"
                                         "      beta: 5\n"
                                         "      m: 4\n"
                                         "      lambda: 100\n"
                                         "      theta_m: 20\n"
                                         "      Q: [150, 5, 150, 5]\n"
                                         "      R: [1, 1]\n";
_Static_assert(3 * 1400 >= ROUND_COUNT, "the samples of high_gain_scenario");

static bool add_clock(const struct scenario *scenario, struct bus *bus, struct agent *agent,
                      struct error *error)
{
    struct clock_config config = {.scenario = scenario,
                                  .samples = scenario_samples(scenario),
                                  .pace = DSE_CLOCK_T_PACE_LOCKSTEP,
                                  .run_id = RUN_ID,
                                  .join_s = JOIN_S};
    return plant_source(scenario, &config.source, error) &&
           clock_create(&config, bus, agent, error);
}

static bool run(const char *yaml, const char *url, int side, struct round_times *times)
{
    struct error error = {0};
    struct agent agents[2];
    int n_agents = 0;
    measured = times;
    struct scenario *scenario = scenario_parse(yaml, "bench_round", NULL, 0, &error);
    struct bus *bus = scenario != NULL ? bus_open(url, &error) : NULL;
    struct node_config node = {
        .scenario = scenario, .node = side, .pace = DSE_CLOCK_T_PACE_LOCKSTEP, .run_id = RUN_ID};
    bool ok = bus != NULL && node_create(&node, bus, &agents[0], &error);
    n_agents = ok ? 1 : 0;
    if (ok && side == 0) {
        ok = add_clock(scenario, bus, &agents[1], &error);
        n_agents += ok ? 1 : 0;
    }
    ok = ok && host_run(bus, agents, n_agents, NULL, NULL, &error);
    if (!ok)
        fprintf(stderr, "side %d: %s\n", side, error.text);
    for (int i = 0; i < n_agents; i++)
        agents[i].destroy(agents[i].self);
    bus_close(bus);
    scenario_free(scenario);
    return ok;
}

bool round_agents(const char *url, int side, struct round_times *times)
{
    return run(talk_scenario, url, side, times);
}

bool round_high_gain(const char *url, int side, struct round_times *times)
{
    return run(high_gain_scenario, url, side, times);
}
