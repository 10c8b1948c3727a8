/* The plant called linear in motion: around its operating point, and with a matrix that swings. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "dse/model.h"
#include "runtime/clock.h"
#include "runtime/scenario.h"

/* A plant around an operating point starts there unless x0 says otherwise, and stays. */
static void a_plant_rests_at_its_origin(void **state)
{
    (void)state;
    static const char text[] =
        "name: around\n"
        "time: {period_s: 1, duration_s: 20}\n"
        "plant:\n"
        "  name: linear\n"
        "  linear: {time: discrete, nx: 2, A: [0.5, 0.25, 0, 0.5], C: [0, 1],\n"
        "           origin: [300, 0.125]}\n"
        "networks:\n"
        "  - name: one\n"
        "    guess: [0, 0]\n"
        "    high_gain_ekf: {d: 0.02, DeltaT: 0.1, beta: 5, m: 4, lambda: 100, theta_m: 20,\n"
        "                    Q: [1, 1], R: [1]}\n";
    static const char *const away[] = {"plant.x0=[301, 0.25]"};
    for (unsigned moved = 0; moved < 2; moved++) {
        struct error error = {.text = ""};
        struct sample_source source;
        char reason[256] = "";
        struct scenario *scenario = scenario_parse(text, "x.yaml", away, moved, &error);
        assert_string_equal(error.text, "");
        if (!plant_source(scenario, &source, &error))
            fail_msg("%s", error.text);
        double deviation[] = {moved, 0.125 * moved};
        for (int k = 0; k < 12; k++) {
            struct sample_data data = {0};
            if (!source.next(source.self, k, &data, reason, sizeof reason))
                fail_msg("%s", reason);
            const double x[] = {300 + deviation[0], 0.125 + deviation[1]};
            assert_memory_equal(data.x, x, sizeof x);
            assert_memory_equal(data.y, x + 1, sizeof *x);
            deviation[0] = 0.5 * deviation[0] + 0.25 * deviation[1];
            deviation[1] = 0.5 * deviation[1];
        }
        source.destroy(source.self);
        scenario_free(scenario);
    }
}

/* The time-varying plant of two coupled states: dx = (A + A_sin sin(omega t)) x with omega in
 * rad/s, whatever the plant's unit of time is. */
static void a_swinging_matrix_swings_in_seconds(void **state)
{
    (void)state;
    static const char text[] = "name: swings\n"
                               "time: {period_s: 0.01, duration_s: 1}\n"
                               "plant:\n"
                               "  name: linear\n"
                               "  linear: {unit_s: 60, nx: 2, A: [-0.15, -2, 2, 0], omega: 0.5,\n"
                               "           A_sin: [0.4, 0, 0, 0], C: [1, 0]}\n"
                               "networks:\n"
                               "  - name: one\n"
                               "    guess: [0, 0]\n"
                               "    high_gain_ekf: {d: 0.02, DeltaT: 0.1, beta: 5, m: 4,\n"
                               "      lambda: 100, theta_m: 20, Q: [1, 1], R: [1]}\n";
    struct error error = {.text = ""};
    struct scenario *scenario = scenario_parse(text, "x.yaml", NULL, 0, &error);
    struct dse_model model;
    dse_real values[1], prepared[8], F[4];
    assert_string_equal(error.text, "");
    assert_true(scenario_prepare_plant(scenario, NULL, values, prepared, &error));
    scenario->process->model(prepared, &model);
    const dse_real x[] = {15, -10};
    for (int k = 0; k < 5; k++) {
        const double minutes = 0.07 * k, a = -0.15 + 0.4 * sin(0.5 * 60 * minutes);
        dse_real dx[2];
        assert_int_equal(model.f(&model, minutes, x, NULL, dx), DSE_OK);
        assert_int_equal(model.dfdx(&model, minutes, x, NULL, F), DSE_OK);
        assert_true(fabs(dx[0] - (15 * a + 20)) < 1e-12 && fabs(dx[1] - 30) < 1e-12);
        assert_true(fabs(F[0] - a) < 1e-14);
    }
    scenario_free(scenario);
}

/* Reference data of an independent implementation at t = 0, 0.5, 1, 5 and 10. */
static void the_time_varying_plant_runs_as_its_reference(void **state)
{
    (void)state;
    static const char text[] =
        "name: ltv2\n"
        "time: {period_s: 0.01, duration_s: 10.01}\n"
        "plant:\n"
        "  name: linear\n"
        "  linear: {nx: 2, A: [-0.15, -2, 2, 0], A_sin: [0.4, 0, 0, 0], omega: 1, C: [1, 0, 0, "
        "1],\n"
        "           groups: [1, 1]}\n"
        "  x0: [15, -10]\n"
        "networks:\n"
        "  - name: one\n"
        "    guess: [0, 0]\n"
        "    high_gain_ekf: {d: 0.02, DeltaT: 0.1, beta: 5, m: 4, lambda: 100, theta_m: 20,\n"
        "                    Q: [1, 1], R: [1, 1]}\n";
    static const int samples[] = {0, 50, 100, 500, 1000};
    static const double want[][2] = {{15.0, -10.0},
                                     {16.217041917557477, 6.910772638907787},
                                     {3.4253869427857575, 17.642237089791255},
                                     {-14.103576721558328, 1.6503999378244347},
                                     {10.134041711830779, 5.404494923316719}};
    static const char *const rk4[] = {"plant.integrator.kind=rk4"};
    for (unsigned one_step = 0; one_step < 2; one_step++) {
        struct error error = {.text = ""};
        struct sample_source source;
        struct sample_data data = {0};
        char reason[256] = "";
        struct scenario *scenario = scenario_parse(text, "x.yaml", rk4, one_step, &error);
        assert_string_equal(error.text, "");
        if (!plant_source(scenario, &source, &error))
            fail_msg("%s", error.text);
        for (int k = 0, row = 0; k <= 1000; k++) {
            if (!source.next(source.self, k, &data, reason, sizeof reason))
                fail_msg("%s", reason);
            if (k != samples[row])
                continue;
            for (int i = 0; i < 2; i++)
                if (!(fabs(data.x[i] - want[row][i]) < 2e-6)) /* 1e-7 of its size */
                    fail_msg("state %d at sample %d is off by %g", i, k, data.x[i] - want[row][i]);
            row++;
        }
        source.destroy(source.self);
        scenario_free(scenario);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_plant_rests_at_its_origin),
        cmocka_unit_test(a_swinging_matrix_swings_in_seconds),
        cmocka_unit_test(the_time_varying_plant_runs_as_its_reference),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
