/* The flow benchmark: its operators have on the grid what the equations have in the plane, its
 * steps are of order four, and a simulator shows it through the modes of the reduced models. */
#include <math.h>
#include <stdlib.h>

#include "dse/random.h"
#include "near.h"
#include "sim/flow_modes.h"
#include "simulator_rig.h"

enum {
    N = 9,
    PSI = SIM_FLOW_PSI(N),
    FACES = SIM_FLOW_FACES(N),
    CELLS = SIM_FLOW_SCALAR(N),
    STATE = SIM_FLOW_STATE(N)
};

static void draw(struct dse_random *random, int count, double *values)
{
    for (int i = 0; i < count; i++)
        values[i] = dse_random_normal(random);
}

static double dot(int count, const double *a, const double *b)
{
    double sum = 0;
    for (int i = 0; i < count; i++)
        sum += a[i] * b[i];
    return sum;
}

/* A velocity without divergence, zero across the walls. */
static void draw_velocity(struct dse_random *random, double *w)
{
    double psi[PSI];
    draw(random, PSI, psi);
    sim_flow_velocity(N, psi, w);
}

/* ---- operators ---- */

static void a_velocity_has_no_divergence_and_does_not_cross_walls(void **state)
{
    (void)state;
    struct dse_random random;
    dse_random_init(&random, 1, 0);
    double w[FACES];
    draw_velocity(&random, w);
    const double *u = w, *v = w + N * (N + 1);
    for (int i = 0; i < N; i++) {
        for (int j = 0; j < N; j++)
            assert_near(u[(i + 1) * N + j] - u[i * N + j] + v[i * (N + 1) + j + 1] -
                            v[i * (N + 1) + j],
                        0, 1e-13);
        assert_near(u[i], 0, 0);
        assert_near(u[N * N + i], 0, 0);
        assert_near(v[i * (N + 1)], 0, 0);
        assert_near(v[i * (N + 1) + N], 0, 0);
    }
    assert_true(dot(FACES, w, w) > 1);
}

static void the_vorticity_is_the_adjoint_of_the_velocity(void **state)
{
    (void)state;
    struct dse_random random;
    dse_random_init(&random, 2, 0);
    double psi[PSI], w[FACES], of_psi[FACES], of_w[PSI];
    draw(&random, PSI, psi);
    draw(&random, FACES, w);
    sim_flow_velocity(N, psi, of_psi);
    sim_flow_vorticity(N, w, of_w);
    assert_near(dot(FACES, of_psi, w) / dot(PSI, psi, of_w), 1, 1e-12);
}

/* <conv(by, a), b> = -<a, conv(by, b)>, for fields that are zero on the walls' own faces. */
static void convection_neither_makes_nor_loses_energy(void **state)
{
    (void)state;
    struct dse_random random;
    dse_random_init(&random, 3, 0);
    double by[FACES], a[FACES], b[FACES], out_a[FACES], out_b[FACES];
    draw_velocity(&random, by);
    draw_velocity(&random, a);
    draw_velocity(&random, b);
    sim_flow_convection(N, by, a, out_a);
    sim_flow_convection(N, by, b, out_b);
    const double size = sqrt(dot(FACES, out_a, out_a) * dot(FACES, b, b));
    assert_near(dot(FACES, out_a, a) / size, 0, 1e-13);
    assert_near((dot(FACES, out_a, b) + dot(FACES, a, out_b)) / size, 0, 1e-13);
    assert_true(fabs(dot(FACES, out_a, b)) > 1e-4 * size);

    double s[CELLS], r[CELLS], out_s[CELLS], out_r[CELLS];
    draw(&random, CELLS, s);
    draw(&random, CELLS, r);
    sim_flow_scalar_convection(N, by, s, out_s);
    sim_flow_scalar_convection(N, by, r, out_r);
    const double scalar = sqrt(dot(CELLS, out_s, out_s) * dot(CELLS, r, r));
    assert_near(dot(CELLS, out_s, s) / scalar, 0, 1e-13);
    assert_near((dot(CELLS, out_s, r) + dot(CELLS, s, out_r)) / scalar, 0, 1e-13);
}

static void diffusion_is_symmetric_and_loses_energy(void **state)
{
    (void)state;
    struct dse_random random;
    dse_random_init(&random, 4, 0);
    double a[FACES], b[FACES], out_a[FACES], out_b[FACES];
    draw_velocity(&random, a);
    draw_velocity(&random, b);
    sim_flow_laplacian(N, a, out_a);
    sim_flow_laplacian(N, b, out_b);
    assert_near(dot(FACES, out_a, b) / dot(FACES, a, out_b), 1, 1e-12);
    assert_true(dot(FACES, out_a, a) < -PSI);
    double s[CELLS], r[CELLS], out_s[CELLS], out_r[CELLS];
    draw(&random, CELLS, s);
    draw(&random, CELLS, r);
    sim_flow_scalar_laplacian(N, s, out_s);
    sim_flow_scalar_laplacian(N, r, out_r);
    assert_near(dot(CELLS, out_s, r) / dot(CELLS, s, out_r), 1, 1e-12);
    assert_true(dot(CELLS, out_s, s) < -CELLS);
}

/* lap sin(pi x) sin(pi y) = -2 pi^2 sin(pi x) sin(pi y), to order h^2. */
static void a_laplacian_is_that_of_the_plane(void **state)
{
    (void)state;
    static double z[SIM_FLOW_STATE(32)], out[SIM_FLOW_SCALAR(32)];
    double worst[2];
    const double pi = acos(-1);
    for (int fine = 0; fine < 2; fine++) {
        const int n = fine ? 32 : 16;
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++)
                z[i * n + j] = sin(pi * (i + 0.5) / n) * sin(pi * (j + 0.5) / n);
        sim_flow_scalar_laplacian(n, z, out);
        worst[fine] = 0;
        for (int i = 0; i < n * n; i++)
            worst[fine] = fmax(worst[fine], fabs(out[i] + 2 * pi * pi * z[i]));
    }
    assert_true(worst[1] < 0.02);
    assert_near(worst[0] / worst[1], 4, 0.1);
}

/* ---- in time ---- */

/* curl'curl psi' = curl'(nu lap w - conv(w, w) + f) */
static void the_stream_function_moves_as_the_momentum_equation_says(void **state)
{
    (void)state;
    struct sim_flow *flow = sim_flow_create(N, true);
    assert_non_null(flow);
    double z[STATE], dz[STATE], w[FACES], lap[FACES], conv[FACES], left[PSI], right[PSI];
    sim_flow_start(N, 0, z);
    sim_flow_rhs(flow, z, dz);
    sim_flow_velocity(N, dz, w);
    sim_flow_vorticity(N, w, left);
    sim_flow_velocity(N, z, w);
    sim_flow_laplacian(N, w, lap);
    sim_flow_convection(N, w, w, conv);
    for (int i = 0; i < FACES; i++)
        lap[i] = SIM_FLOW_NU * lap[i] - conv[i] + sim_flow_sources(flow)[i];
    sim_flow_vorticity(N, lap, right);
    assert_all_near(PSI, left, right, 1e-12);
    sim_flow_destroy(flow);
}

/* What half the step is off by, one sixteenth of what the whole one is. */
static void steps_are_of_order_four(void **state)
{
    (void)state;
    struct sim_flow *flow = sim_flow_create(N, true);
    assert_non_null(flow);
    double z[3][STATE], off[2] = {0, 0};
    for (int s = 0; s < 3; s++) {
        const int steps = s == 2 ? 64 : 4 << s;
        sim_flow_start(N, 2, z[s]);
        for (int k = 0; k < steps; k++)
            sim_flow_step(flow, 1.0 / steps, z[s]);
    }
    for (int s = 0; s < 2; s++)
        for (int i = 0; i < STATE; i++)
            off[s] = fmax(off[s], fabs(z[s][i] - z[2][i]));
    assert_in_range((int)(off[0] / off[1]), 14, 19);
    sim_flow_destroy(flow);
}

/* Energies of velocity, contaminant and temperature. */
static void measure(const double *z, double *energy)
{
    double w[FACES];
    sim_flow_velocity(N, z, w);
    energy[0] = dot(FACES, w, w);
    energy[1] = dot(CELLS, z + PSI, z + PSI);
    energy[2] = dot(CELLS, z + PSI + CELLS, z + PSI + CELLS);
}

static void left_to_itself_a_flow_decays_and_sources_wake_it(void **state)
{
    (void)state;
    for (int forced = 0; forced < 2; forced++) {
        struct sim_flow *flow = sim_flow_create(N, forced);
        assert_non_null(flow);
        double z[STATE] = {0}, before[3], after[3];
        if (!forced)
            sim_flow_start(N, 3, z);
        measure(z, before);
        for (int k = 0; k < 100; k++)
            sim_flow_step(flow, 0.05, z);
        measure(z, after);
        for (int i = 0; i < 3; i++)
            assert_true(forced ? before[i] == 0 && after[i] > 0.01 : after[i] < 0.9 * before[i]);
        sim_flow_destroy(flow);
    }
}

/* ---- through the modes ---- */

static struct simulator *simulate(const char *name, struct sim_config *config, char *reason)
{
    static double x0[DSE_PLANT_MAX_STATES];
    static const double u[DSE_PLANT_MAX_INPUTS], prepared[64];
    config->plant = dse_plant_find(name);
    assert_non_null(config->plant);
    config->prepared = prepared;
    config->x0 = x0;
    config->u = u;
    config->period = 0.25;
    config->integrator = SIM_FLOW;
    return sim_create(config, reason, REASON);
}

/* Data of lib/plants and weights of the modes are of one making. */
static void a_run_starts_with_the_initial_state_of_its_set(void **state)
{
    (void)state;
    static const char *const names[] = {"cavity_free", "cavity_forced"};
    for (int c = 0; c < 2; c++)
        for (int run = c; run < SIM_FLOW_RUNS; run += 2) {
            char reason[REASON] = "";
            struct sim_config config = {.flow_run = run};
            struct simulator *sim = simulate(names[c], &config, reason);
            assert_string_equal(reason, "");
            assert_all_near(SIM_FLOW_MODES, sim_state(sim), config.plant->sets[run].x0, 1e-12);
            sim_destroy(sim);
        }
}

/* Within what the modes leave out. */
static void sensors_read_about_what_the_reduced_model_says(void **state)
{
    (void)state;
    char reason[REASON] = "";
    struct sim_config config = {.flow_run = 1};
    struct simulator *sim = simulate("cavity_free", &config, reason);
    assert_non_null(sim);
    struct dse_model model;
    config.plant->model(NULL, &model);
    double square = 0, off = 0;
    for (int k = 0; k < 5; k++) {
        double y[SIM_FLOW_OUTPUTS];
        assert_true(sim_step(sim, reason, REASON));
        assert_int_equal(model.h(&model, 0, sim_state(sim), NULL, y), DSE_OK);
        for (int j = 0; j < SIM_FLOW_OUTPUTS; j++) {
            square += y[j] * y[j];
            off += (y[j] - sim_output(sim)[j]) * (y[j] - sim_output(sim)[j]);
        }
    }
    assert_true(off < 0.02 * square);
    assert_true(off > 1e-6 * square); /* they do not read the model */
    sim_destroy(sim);
}

static void what_is_no_flow_is_refused(void **state)
{
    (void)state;
    char reason[REASON] = "";
    struct sim_config config = {0};
    assert_null(simulate("three_tank", &config, reason));
    assert_non_null(strstr(reason, "no flow"));
    config.flow_run = SIM_FLOW_RUNS;
    assert_null(simulate("cavity_free", &config, reason));
    const double scale[SIM_FLOW_MODES] = {1};
    config = (struct sim_config){.process = {.distribution = SIM_GAUSSIAN, .scale = scale}};
    assert_null(simulate("cavity_free", &config, reason));
    assert_non_null(strstr(reason, "process noise"));
    assert_null(sim_flow_create(1, false));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_velocity_has_no_divergence_and_does_not_cross_walls),
        cmocka_unit_test(the_vorticity_is_the_adjoint_of_the_velocity),
        cmocka_unit_test(convection_neither_makes_nor_loses_energy),
        cmocka_unit_test(diffusion_is_symmetric_and_loses_energy),
        cmocka_unit_test(a_laplacian_is_that_of_the_plane),
        cmocka_unit_test(the_stream_function_moves_as_the_momentum_equation_says),
        cmocka_unit_test(steps_are_of_order_four),
        cmocka_unit_test(left_to_itself_a_flow_decays_and_sources_wake_it),
        cmocka_unit_test(a_run_starts_with_the_initial_state_of_its_set),
        cmocka_unit_test(sensors_read_about_what_the_reduced_model_says),
        cmocka_unit_test(what_is_no_flow_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
