/* Any bytes as a scenario with overrides: it is read or it is refused with a message, and what is
 * read keeps the promises of runtime/scenario.h.
 *
 * Input: YAML text, then up to four overrides, each behind a zero byte. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "methods/high_gain_ekf_section.h"
#include "methods/method.h"
#include "runtime/scenario.h"

#define MAX_OVERRIDES 4

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static int nodes(const struct method_setup *setup)
{
    return setup->process->n_subsystems;
}

/* The reader needs a method's section and its number of nodes only, not the method. */
static const struct method section_only = {.name = "high_gain_ekf",
                                           .title = "section only",
                                           .fields = high_gain_ekf_fields,
                                           .section_size = sizeof(struct high_gain_ekf_section),
                                           .rules = high_gain_ekf_rules,
                                           .nodes = nodes};

const struct method *method_at(int i)
{
    return i == 0 ? &section_only : NULL;
}

const struct method *method_find(const char *name)
{
    return strcmp(name, section_only.name) == 0 ? &section_only : NULL;
}

static void require(bool condition)
{
    if (!condition)
        abort();
}

static void require_finite(const double *value, unsigned count, int wanted)
{
    require(value == NULL || (int)count == wanted);
    for (unsigned i = 0; value != NULL && i < count; i++)
        require(isfinite(value[i]));
}

static void require_network(const struct scenario *scenario, const struct scenario_network *network)
{
    const struct dse_plant *plant = scenario->process;
    struct error error = {.text = ""};
    dse_real values[DSE_PLANT_MAX_PARAMETERS];
    dse_real *prepared = malloc((size_t)plant->prepared_size * sizeof *prepared);
    require(prepared != NULL);
    require(scenario_prepare_plant(scenario, network, values, prepared, &error));
    free(prepared);
    require(network->guess != NULL);
    require_finite(network->guess, network->guess_count, plant->nx);
    require(scenario_method(network) == 0);

    const struct high_gain_ekf_section *section = network->section[0];
    require(section->d > 0 && section->theta_m > 1 && section->Q != NULL && section->R != NULL);
    require_finite(section->Q, section->Q_count, plant->nx);
    require_finite(section->R, section->R_count, plant->n_subsystems);
    require_finite(section->P0, section->P0_count, plant->nx);
    if (high_gain_ekf_section_check(section, scenario_period(scenario), &error))
        require(high_gain_ekf_horizon(section, scenario_period(scenario)) >= 1);
}

static void require_scenario(const struct scenario *scenario)
{
    const struct dse_plant *plant = scenario->process;
    require(plant != NULL && scenario->networks_count >= 1);
    require(scenario_samples(scenario) >= 1 &&
            (double)scenario_samples(scenario) <= SCENARIO_MAX_SAMPLES);
    require(scenario_period(scenario) > 0);
    require_finite(scenario->plant.x0, scenario->plant.x0_count, plant->nx);
    require_finite(scenario->plant.inputs, scenario->plant.inputs_count, plant->nu);
    require_finite(scenario->noise.process.scale, scenario->noise.process.scale_count, plant->nx);
    require_finite(scenario->noise.measurement.scale, scenario->noise.measurement.scale_count,
                   plant->ny);
    for (unsigned i = 0; i < scenario->networks_count; i++)
        require_network(scenario, &scenario->networks[i]);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    const char *overrides[MAX_OVERRIDES];
    unsigned count = 0;
    char *text = malloc(size + 1);
    require(text != NULL);
    memcpy(text, data, size);
    text[size] = '\0';
    for (size_t i = 0; i < size && count < MAX_OVERRIDES; i++)
        if (text[i] == '\0')
            overrides[count++] = text + i + 1;

    struct error error = {.text = ""};
    struct scenario *scenario = scenario_parse(text, "x.yaml", overrides, count, &error);
    require((scenario == NULL) == (error.text[0] != '\0'));
    if (scenario != NULL)
        require_scenario(scenario);
    scenario_free(scenario);
    free(text);
    return 0;
}
