/* Does plant.drive make sense? What the schema alone does not show. */
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/scenario_internal.h"

struct place {
    struct scenario_tree *tree;
    const struct scenario *scenario;
    struct error *error;
    struct dse_normal_form form;   /* zero where the plant has none */
    char path[SCENARIO_PATH_SIZE]; /* plant.drive[i] */
};

static bool fail(struct place *p, const char *key, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

static bool fail(struct place *p, const char *key, const char *format, ...)
{
    char path[SCENARIO_PATH_SIZE + 64], message[768];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    snprintf(path, sizeof path, "%s%s%s", p->path, key[0] != '\0' ? "." : "", key);
    return scenario_fail(p->tree, scenario_tree_find(p->tree, path), path, p->error, "%s", message);
}

/* Index of the signal called `name`, -1 and a message when there is none. */
static int find_signal(struct place *p, const char *key, const char *what, const char *name,
                       const struct dse_signal *signals, int count)
{
    struct scenario_words words = {.count = 0};
    char list[512];
    for (int i = 0; i < count; i++) {
        if (strcmp(signals[i].name, name) == 0)
            return i;
        scenario_words_add(&words, signals[i].name);
    }
    scenario_words_text(&words, name, list, sizeof list);
    fail(p, key, "the plant has no %s called %s; there are: %s", what, name, list);
    return -1;
}

/* A key that the kind of signal does not use is a misunderstanding. */
static bool judge_use(struct place *p, const char *key, bool given, bool used, const char *kind)
{
    if (used && !given)
        return fail(p, key, "is missing: a signal of kind %s needs it", kind);
    if (given && !used)
        return fail(p, key, "is not used by a signal of kind %s", kind);
    return true;
}

static bool judge_signal(struct place *p, const struct scenario_drive *drive)
{
    static const char *const kinds[] = {[SCENARIO_CONSTANT] = "constant",
                                        [SCENARIO_STEPS] = "steps",
                                        [SCENARIO_SINUSOID] = "sinusoid",
                                        [SCENARIO_PRBS] = "prbs"};
    const char *kind = kinds[drive->signal];
    bool sinusoid = drive->signal == SCENARIO_SINUSOID, prbs = drive->signal == SCENARIO_PRBS;
    return judge_use(p, "amplitude", drive->amplitude > 0, sinusoid || prbs, kind) &&
           judge_use(p, "omega", drive->omega > 0, sinusoid, kind) &&
           (sinusoid || judge_use(p, "phase", fabs(drive->phase) > 0, false, kind)) &&
           judge_use(p, "bit_s", drive->bit_s > 0, prbs, kind) &&
           judge_use(p, "steps", drive->steps_count > 0, drive->signal == SCENARIO_STEPS, kind);
}

static bool judge_steps(struct place *p, const struct scenario_drive *drive)
{
    char key[64];
    for (unsigned i = 1; i < drive->steps_count; i++) {
        if (drive->steps[i].at_s >= drive->steps[i - 1].at_s + p->scenario->time.period_s)
            continue;
        snprintf(key, sizeof key, "steps[%u].at_s", i);
        return fail(p, key, "%.10g is not at least one period after the step before",
                    drive->steps[i].at_s);
    }
    return true;
}

static bool judge_bits(struct place *p, const struct scenario_drive *drive)
{
    double samples = drive->bit_s / p->scenario->time.period_s;
    if (drive->signal != SCENARIO_PRBS ||
        (samples > 0.5 && fabs(samples - round(samples)) < 1e-6 * samples))
        return true;
    return fail(p, "bit_s", "%.10g are %.6g periods; it must be a whole number of them",
                drive->bit_s, samples);
}

static bool judge_loop(struct place *p, const struct scenario_loop *loop)
{
    const struct dse_plant *plant = p->scenario->process;
    if (loop == NULL)
        return true;
    if (find_signal(p, "loop.output", "output", loop->output, plant->outputs, plant->ny) < 0)
        return false;
    if (!(loop->low < loop->high))
        return fail(p, "loop.high", "%.10g is not above low, %.10g", loop->high, loop->low);
    if (loop->lag_s > 0 && loop->inner == NULL)
        return fail(p, "loop.lag_s", "belongs to a cascade; without 'inner' the input has no lag");
    return true;
}

/* rates[j] of the normal form is the derivative of input j: it follows by itself. */
static bool judge_rate(struct place *p, int input)
{
    const struct dse_plant *plant = p->scenario->process;
    const int *rates = p->form.rates;
    for (int j = 0; rates != NULL && j < plant->nu; j++)
        if (rates[j] == input)
            return fail(p, "name", "%s is the time derivative of %s and follows by itself",
                        plant->inputs[input].name, plant->inputs[j].name);
    return true;
}

static bool judge_one(struct place *p, unsigned i)
{
    const struct scenario *scenario = p->scenario;
    const struct scenario_drive *drive = &scenario->plant.drive[i];
    const struct dse_plant *plant = scenario->process;
    int input = find_signal(p, "name", "input", drive->name, plant->inputs, plant->nu);
    if (input < 0 || !judge_rate(p, input))
        return false;
    for (unsigned other = 0; other < i; other++)
        if (strcmp(scenario->plant.drive[other].name, drive->name) == 0)
            return fail(p, "name", "%s is driven by plant.drive[%u] too", drive->name, other);
    return judge_signal(p, drive) && judge_steps(p, drive) && judge_bits(p, drive) &&
           judge_loop(p, drive->loop);
}

bool scenario_judge_drive(struct scenario_tree *tree, const struct scenario *scenario,
                          struct error *error)
{
    const struct dse_plant *plant = scenario->process;
    struct place place = {.tree = tree, .scenario = scenario, .error = error};
    dse_real values[DSE_PLANT_MAX_PARAMETERS];
    dse_real *prepared = calloc((size_t)plant->prepared_size + 1, sizeof *prepared);
    if (prepared == NULL)
        return error_set(error, "%s: out of memory", tree->file);
    bool good = scenario_prepare_plant(scenario, NULL, values, prepared, error);
    if (good && plant->normal_form != NULL)
        plant->normal_form(prepared, &place.form);
    for (unsigned i = 0; good && i < scenario->plant.drive_count; i++) {
        snprintf(place.path, sizeof place.path, "plant.drive[%u]", i);
        good = judge_one(&place, i);
    }
    free(prepared);
    return good;
}
