/* A scenario's simulated flow: the run is that of the plant's set, and has no other beginning. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "near.h"
#include "runtime/clock.h"
#include "runtime/scenario.h"

static const char text[] = "name: x\n"
                           "time: {period_s: 0.25, duration_s: 1}\n"
                           "plant: {name: cavity_forced, integrator: {kind: flow}}\n"
                           "networks:\n"
                           "  - name: one\n"
                           "    graph: {nodes: 4, edges: []}\n"
                           "    second_order:\n"
                           "      scheme: B\n"
                           "      R: [1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n"
                           "      P0: [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n";

static struct scenario *parse(const char *const *changes, unsigned count)
{
    struct error error = {.text = ""};
    struct scenario *scenario = scenario_parse(text, "x.yaml", changes, count, &error);
    assert_string_equal(error.text, "");
    return scenario;
}

static void a_flow_starts_as_the_run_of_the_plants_set(void **state)
{
    (void)state;
    static const char *const changes[] = {"plant.set=train2"};
    const struct dse_plant *plant = dse_plant_find("cavity_forced");
    for (unsigned changed = 0; changed < 2; changed++) {
        struct error error = {.text = ""};
        struct sample_source source;
        struct sample_data data = {0};
        char reason[256] = "";
        struct scenario *scenario = parse(changes, changed);
        assert_true(plant_source(scenario, &source, &error));
        assert_true(source.next(source.self, 0, &data, reason, sizeof reason));
        assert_all_near(plant->nx, data.x, plant->sets[changed ? 2 : 0].x0, 1e-12);
        source.destroy(source.self);
        scenario_free(scenario);
    }
}

static void a_flow_has_no_other_beginning(void **state)
{
    (void)state;
    static const char *const changes[] = {"plant.x0=[0, 0, 0, 0, 0, 0, 0, 0, 0, 0]"};
    struct error error = {.text = ""};
    struct sample_source source;
    struct scenario *scenario = parse(changes, 1);
    assert_false(plant_source(scenario, &source, &error));
    assert_non_null(strstr(error.text, "plant.x0"));
    scenario_free(scenario);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_flow_starts_as_the_run_of_the_plants_set),
        cmocka_unit_test(a_flow_has_no_other_beginning),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
