/* Shipped plants: their tables, derivatives, normal forms and guards. Agreement with independent
 * reference data is the golden tests' matter. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "dse/math.h"
#include "dse/plant.h"

#ifdef DSE_REAL_IS_float
#define TOLERANCE(in_double, in_float) DSE_REAL(in_float)
#else
#define TOLERANCE(in_double, in_float) DSE_REAL(in_double)
#endif

enum { MAX_N = 16, MAX_U = 4, MAX_PREPARED = 256, MAX_NI = 4 };

/* A plant with its normal form, at a state off its equilibrium. */
struct bench {
    const struct dse_plant *plant;
    dse_real prepared[MAX_PREPARED];
    struct dse_model model;
    struct dse_normal_form form;
    dse_real x[MAX_N], u[MAX_U];
};

static void set_up(struct bench *bench, const struct dse_plant *plant, int set)
{
    assert_true(plant->nx <= MAX_N && plant->nu <= MAX_U && plant->prepared_size <= MAX_PREPARED);
    bench->plant = plant;
    assert_int_equal(plant->prepare(plant->sets[set].values, bench->prepared), DSE_OK);
    plant->model(bench->prepared, &bench->model);
    if (plant->normal_form != NULL) {
        plant->normal_form(bench->prepared, &bench->form);
    }
    for (int k = 0; k < plant->nx; k++) {
        bench->x[k] = plant->sets[set].x0[k];
    }
    for (int k = 0; k < plant->nu; k++) {
        /* every input off zero, so that its part in the equations is seen */
        bench->u[k] = plant->inputs[k].nominal + plant->inputs[k].scale;
    }
}

/* Calls check for every parameter set of every shipped plant that is small enough for dense
 * differences. */
static void for_all_plants(void (*check)(struct bench *bench))
{
    int checked = 0;
    for (int i = 0; dse_plant_at(i) != NULL; i++) {
        const struct dse_plant *plant = dse_plant_at(i);
        if (plant->nx > MAX_N || plant->nu > MAX_U || plant->prepared_size > MAX_PREPARED) {
            continue;
        }
        for (int set = 0; set < plant->n_sets; set++) {
            struct bench bench;
            memset(&bench, 0, sizeof bench);
            set_up(&bench, plant, set);
            check(&bench);
            checked++;
        }
    }
    assert_true(checked > 0);
}

static void assert_near(dse_real got, dse_real want, dse_real scale, dse_real tolerance)
{
    if (!(dse_abs(got - want) <= tolerance * (dse_abs(want) + scale))) {
        fail_msg("%.17g is not %.17g within %g", (double)got, (double)want,
                 (double)(tolerance * (dse_abs(want) + scale)));
    }
}

/* ---- tables ---- */

static void shipped_plants_are_found_by_name(void **state)
{
    (void)state;
    assert_non_null(dse_plant_find("cstr2"));
    for (int i = 0; dse_plant_at(i) != NULL; i++) {
        assert_ptr_equal(dse_plant_find(dse_plant_at(i)->name), dse_plant_at(i));
    }
    assert_null(dse_plant_find("cstr"));
    assert_null(dse_plant_find("cstr22"));
    assert_null(dse_plant_find(""));
    assert_null(dse_plant_find(NULL));
    assert_null(dse_plant_at(-1));
    assert_null(dse_plant_at(1000));
}

static void check_signals(const struct dse_signal *signals, int count)
{
    for (int i = 0; i < count; i++) {
        assert_true(signals[i].name[0] != '\0' && signals[i].title[0] != '\0');
        assert_non_null(signals[i].unit);
        assert_true(dse_is_finite(signals[i].nominal) && signals[i].scale > 0);
        for (int j = 0; j < i; j++) {
            assert_string_not_equal(signals[i].name, signals[j].name);
        }
    }
}

static void check_parameters(const struct dse_plant *plant)
{
    assert_true(plant->n_parameters <= DSE_PLANT_MAX_PARAMETERS && plant->n_sets >= 1);
    for (int i = 0; i < plant->n_parameters; i++) {
        assert_true(plant->parameters[i].name[0] != '\0' && plant->parameters[i].title[0] != '\0');
        for (int j = 0; j < i; j++) {
            assert_string_not_equal(plant->parameters[i].name, plant->parameters[j].name);
        }
        for (int set = 0; set < plant->n_sets; set++) {
            assert_true(plant->sets[set].values[i] >= plant->parameters[i].min &&
                        plant->sets[set].values[i] <= plant->parameters[i].max);
        }
    }
}

static void every_plant_describes_itself(void **state)
{
    (void)state;
    for (int i = 0; dse_plant_at(i) != NULL; i++) {
        const struct dse_plant *plant = dse_plant_at(i);
        check_signals(plant->states, plant->nx);
        check_signals(plant->inputs, plant->nu);
        check_signals(plant->outputs, plant->ny);
        check_parameters(plant);
        assert_true(plant->nx <= DSE_PLANT_MAX_STATES && plant->nu <= DSE_PLANT_MAX_INPUTS &&
                    plant->ny <= DSE_PLANT_MAX_OUTPUTS && plant->time_unit_s > 0);
        int own = 0;
        for (int s = 0; s < plant->n_subsystems; s++) {
            own += plant->subsystems[s].n_states;
            for (int k = 0; k < plant->subsystems[s].n_states; k++) {
                assert_in_range(plant->subsystems[s].states[k], 0, plant->nx - 1);
            }
            for (int k = 0; k < plant->subsystems[s].n_outputs; k++) {
                assert_in_range(plant->subsystems[s].outputs[k], 0, plant->ny - 1);
            }
        }
        assert_true(own >= plant->nx);
    }
}

static void check_bad_values(struct bench *bench)
{
    dse_real values[DSE_PLANT_MAX_PARAMETERS], prepared[MAX_PREPARED];
    const struct dse_plant *plant = bench->plant;
    for (int k = 0; k < plant->n_parameters; k++) {
        const dse_real min = plant->parameters[k].min, max = plant->parameters[k].max;
        const dse_real bad[] = {min - 1 - dse_abs(min), max + 1 + dse_abs(max), (dse_real)NAN};
        for (int b = 0; b < 3; b++) {
            memcpy(values, plant->sets[0].values, (size_t)plant->n_parameters * sizeof *values);
            values[k] = bad[b];
            assert_int_equal(plant->prepare(values, prepared), DSE_EINVAL);
        }
    }
}

static void values_outside_their_range_make_no_plant(void **state)
{
    (void)state;
    for_all_plants(check_bad_values);
}

/* ---- derivatives ---- */

/* Central differences of column c of a function of n variables. */
static dse_real step_of(dse_real x)
{
    return TOLERANCE(1e-6, 1e-3) * (1 + dse_abs(x));
}

static void check_model_jacobian(struct bench *bench)
{
    const struct dse_model *model = &bench->model;
    const int n = model->nx;
    if (model->dfdx == NULL) {
        return;
    }
    dse_real F[MAX_N * MAX_N], plus[MAX_N], minus[MAX_N], x[MAX_N];
    assert_int_equal(model->dfdx(model, 0, bench->x, bench->u, F), DSE_OK);
    for (int c = 0; c < n; c++) {
        const dse_real step = step_of(bench->x[c]);
        memcpy(x, bench->x, sizeof x);
        x[c] = bench->x[c] + step;
        assert_int_equal(model->f(model, 0, x, bench->u, plus), DSE_OK);
        x[c] = bench->x[c] - step;
        assert_int_equal(model->f(model, 0, x, bench->u, minus), DSE_OK);
        for (int r = 0; r < n; r++) {
            assert_near(F[r * n + c], (plus[r] - minus[r]) / (2 * step), 1, TOLERANCE(1e-6, 5e-2));
        }
    }
}

static void model_jacobian_agrees_with_differences(void **state)
{
    (void)state;
    for_all_plants(check_model_jacobian);
}

static void check_output_jacobian(struct bench *bench)
{
    const struct dse_model *model = &bench->model;
    if (model->dhdx == NULL) {
        return;
    }
    dse_real H[MAX_N * MAX_N], y0[MAX_N], y[MAX_N], x[MAX_N];
    assert_int_equal(model->dhdx(model, 0, bench->x, bench->u, H), DSE_OK);
    assert_int_equal(model->h(model, 0, bench->x, bench->u, y0), DSE_OK);
    for (int c = 0; c < model->nx; c++) {
        memcpy(x, bench->x, sizeof x);
        x[c] += 1;
        assert_int_equal(model->h(model, 0, x, bench->u, y), DSE_OK);
        for (int r = 0; r < model->ny; r++) {
            assert_near(H[r * model->nx + c], y[r] - y0[r], 1, TOLERANCE(1e-9, 1e-4));
        }
    }
}

static void output_jacobian_agrees_with_differences(void **state)
{
    (void)state;
    for_all_plants(check_output_jacobian);
}

/* ---- normal form ---- */

static void check_round_trip(struct bench *bench)
{
    const struct dse_normal_form *form = &bench->form;
    dse_real z[MAX_N], chi[MAX_N];
    if (bench->plant->normal_form == NULL) {
        return;
    }
    assert_int_equal(form->encode(form, 0, bench->x, bench->u, z), DSE_OK);
    assert_int_equal(form->decode(form, 0, z, bench->u, chi), DSE_OK);
    for (int k = 0; k < form->n; k++) {
        assert_near(chi[k], bench->x[k], 0, TOLERANCE(1e-13, 1e-4));
    }
}

static void decode_inverts_encode(void **state)
{
    (void)state;
    for_all_plants(check_round_trip);
}

/* The input at t + dt: inputs with a rate move, the others stand. */
static void move_inputs(const struct bench *bench, dse_real dt, dse_real *u)
{
    for (int k = 0; k < bench->plant->nu; k++) {
        const int rate = bench->form.rates != NULL ? bench->form.rates[k] : -1;
        u[k] = bench->u[k] + (rate >= 0 ? dt * bench->u[rate] : 0);
    }
}

/* z' = dPhi/dchi f + dPhi/du u': along the solution, encode moves as the field says. */
static void check_field(struct bench *bench)
{
    const struct dse_normal_form *form = &bench->form;
    const dse_real dt = TOLERANCE(1e-7, 2e-4);
    dse_real z[MAX_N], dz[MAX_N], f[MAX_N], x[MAX_N], u[MAX_U], z_plus[MAX_N], z_minus[MAX_N];
    if (bench->plant->normal_form == NULL) {
        return;
    }
    assert_int_equal(form->encode(form, 0, bench->x, bench->u, z), DSE_OK);
    assert_int_equal(form->field(form, 0, z, bench->u, dz), DSE_OK);
    assert_int_equal(bench->model.f(&bench->model, 0, bench->x, bench->u, f), DSE_OK);
    for (int side = -1; side <= 1; side += 2) {
        for (int k = 0; k < form->n; k++) {
            x[k] = bench->x[k] + (dse_real)side * dt * f[k];
        }
        move_inputs(bench, (dse_real)side * dt, u);
        assert_int_equal(form->encode(form, 0, x, u, side > 0 ? z_plus : z_minus), DSE_OK);
    }
    for (int k = 0; k < form->n; k++) {
        assert_near(dz[k], (z_plus[k] - z_minus[k]) / (2 * dt), 1, TOLERANCE(1e-6, 5e-2));
    }
}

static void field_is_the_derivative_of_the_coordinates(void **state)
{
    (void)state;
    for_all_plants(check_field);
}

/* dz_k - z_(k+1): what b_i puts into the rows of a chain before its last. */
static void inputs_of_chain(struct bench *bench, const dse_real *x, dse_real *rest)
{
    const struct dse_normal_form *form = &bench->form;
    dse_real z[MAX_N], dz[MAX_N];
    assert_int_equal(form->encode(form, 0, x, bench->u, z), DSE_OK);
    assert_int_equal(form->field(form, 0, z, bench->u, dz), DSE_OK);
    for (int k = 0; k + 1 < form->n; k++) {
        rest[k] = dz[k] - z[k + 1];
    }
}

/* The same at another state: a known input may enter there, the state may not. */
static void check_chain(struct bench *bench)
{
    const struct dse_normal_form *form = &bench->form;
    dse_real x[MAX_N], here[MAX_N] = {0}, there[MAX_N] = {0};
    if (bench->plant->normal_form == NULL) {
        return;
    }
    for (int k = 0; k < form->n; k++) {
        x[k] = bench->x[k] + bench->plant->states[k].scale / (dse_real)(2 + k);
    }
    inputs_of_chain(bench, bench->x, here);
    inputs_of_chain(bench, x, there);
    for (int i = 0, offset = 0; i < form->p; offset += form->n_i[i++]) {
        for (int k = offset; k + 1 < offset + form->n_i[i]; k++) {
            assert_near(here[k], there[k], 1, TOLERANCE(1e-11, 1e-2));
        }
    }
}

static void only_the_last_row_of_a_block_is_nonlinear_even_with_a_varying_feed(void **state)
{
    (void)state;
    for_all_plants(check_chain);
}

static void check_block_jacobians(struct bench *bench)
{
    const struct dse_normal_form *form = &bench->form;
    dse_real z0[MAX_N], z[MAX_N], plus[MAX_N], minus[MAX_N], F[MAX_NI * MAX_NI];
    if (bench->plant->normal_form == NULL) {
        return;
    }
    assert_int_equal(form->encode(form, 0, bench->x, bench->u, z0), DSE_OK);
    for (int i = 0, offset = 0; i < form->p; offset += form->n_i[i++]) {
        const int n_i = form->n_i[i];
        assert_true(n_i <= MAX_NI);
        assert_int_equal(form->jacobian(form, i, 0, z0, bench->u, F), DSE_OK);
        for (int c = 0; c < n_i; c++) {
            const dse_real step = step_of(z0[offset + c]);
            memcpy(z, z0, sizeof z);
            z[offset + c] = z0[offset + c] + step;
            assert_int_equal(form->field(form, 0, z, bench->u, plus), DSE_OK);
            z[offset + c] = z0[offset + c] - step;
            assert_int_equal(form->field(form, 0, z, bench->u, minus), DSE_OK);
            for (int r = 0; r < n_i; r++) {
                assert_near(F[r * n_i + c], (plus[offset + r] - minus[offset + r]) / (2 * step), 1,
                            TOLERANCE(1e-5, 5e-2));
            }
        }
    }
}

static void block_jacobian_freezes_the_other_blocks_of_z(void **state)
{
    (void)state;
    for_all_plants(check_block_jacobians);
}

static void check_map_jacobians(struct bench *bench)
{
    const struct dse_normal_form *form = &bench->form;
    dse_real x[MAX_N], plus[MAX_N], minus[MAX_N], M[MAX_NI * MAX_NI];
    if (bench->plant->normal_form == NULL) {
        return;
    }
    for (int i = 0, offset = 0; i < form->p; offset += form->n_i[i++]) {
        const int n_i = form->n_i[i];
        assert_int_equal(form->map_jacobian(form, i, 0, bench->x, bench->u, M), DSE_OK);
        for (int c = 0; c < n_i; c++) {
            const dse_real step = step_of(bench->x[offset + c]);
            memcpy(x, bench->x, sizeof x);
            x[offset + c] = bench->x[offset + c] + step;
            assert_int_equal(form->encode(form, 0, x, bench->u, plus), DSE_OK);
            x[offset + c] = bench->x[offset + c] - step;
            assert_int_equal(form->encode(form, 0, x, bench->u, minus), DSE_OK);
            for (int r = 0; r < n_i; r++) {
                assert_near(M[r * n_i + c], (plus[offset + r] - minus[offset + r]) / (2 * step), 1,
                            TOLERANCE(1e-6, 5e-2));
            }
        }
    }
    assert_int_equal(form->map_jacobian(form, form->p, 0, bench->x, bench->u, M), DSE_EINVAL);
    assert_int_equal(form->jacobian(form, -1, 0, bench->x, bench->u, M), DSE_EINVAL);
}

static void map_jacobian_agrees_with_differences(void **state)
{
    (void)state;
    for_all_plants(check_map_jacobians);
}

static void check_push(struct bench *bench)
{
    const struct dse_normal_form *form = &bench->form;
    dse_real dx[MAX_N], x[MAX_N], dz[MAX_N], plus[MAX_N], minus[MAX_N];
    if (bench->plant->normal_form == NULL || form->push == NULL) {
        return;
    }
    for (int k = 0; k < form->n; k++) {
        dx[k] = bench->plant->states[k].scale * (dse_real)(k % 3 - 1);
    }
    assert_int_equal(form->push(form, 0, bench->x, bench->u, dx, dz), DSE_OK);
    const dse_real step = TOLERANCE(1e-6, 1e-3);
    for (int k = 0; k < form->n; k++) {
        x[k] = bench->x[k] + step * dx[k];
    }
    assert_int_equal(form->encode(form, 0, x, bench->u, plus), DSE_OK);
    for (int k = 0; k < form->n; k++) {
        x[k] = bench->x[k] - step * dx[k];
    }
    assert_int_equal(form->encode(form, 0, x, bench->u, minus), DSE_OK);
    for (int k = 0; k < form->n; k++) {
        assert_near(dz[k], (plus[k] - minus[k]) / (2 * step), 1, TOLERANCE(1e-6, 5e-2));
    }
}

static void push_is_the_directional_derivative_of_encode(void **state)
{
    (void)state;
    for_all_plants(check_push);
}

static void check_field_jacobian(struct bench *bench)
{
    const struct dse_normal_form *form = &bench->form;
    dse_real z0[MAX_N], z[MAX_N], plus[MAX_N], minus[MAX_N], F[MAX_N * MAX_N];
    if (bench->plant->normal_form == NULL || form->field_jacobian == NULL) {
        return;
    }
    const int n = form->n;
    assert_int_equal(form->encode(form, 0, bench->x, bench->u, z0), DSE_OK);
    assert_int_equal(form->field_jacobian(form, 0, z0, bench->u, F), DSE_OK);
    for (int c = 0; c < n; c++) {
        const dse_real step = step_of(z0[c]);
        memcpy(z, z0, sizeof z);
        z[c] = z0[c] + step;
        assert_int_equal(form->field(form, 0, z, bench->u, plus), DSE_OK);
        z[c] = z0[c] - step;
        assert_int_equal(form->field(form, 0, z, bench->u, minus), DSE_OK);
        for (int r = 0; r < n; r++) {
            assert_near(F[r * n + c], (plus[r] - minus[r]) / (2 * step), 1, TOLERANCE(1e-5, 5e-2));
        }
    }
}

static void field_jacobian_agrees_with_differences(void **state)
{
    (void)state;
    for_all_plants(check_field_jacobian);
}

/* Where a form says that its map has no inputs, another input changes nothing. */
static void check_map_without_inputs(struct bench *bench)
{
    const struct dse_normal_form *form = &bench->form;
    dse_real u[MAX_U], here[MAX_N], there[MAX_N];
    if (bench->plant->normal_form == NULL || !form->map_without_inputs) {
        return;
    }
    for (int k = 0; k < bench->plant->nu; k++) {
        u[k] = bench->u[k] + bench->plant->inputs[k].scale;
    }
    assert_int_equal(form->encode(form, 0, bench->x, bench->u, here), DSE_OK);
    assert_int_equal(form->encode(form, 0, bench->x, u, there), DSE_OK);
    assert_memory_equal(here, there, (size_t)form->n * sizeof *here);
    assert_int_equal(form->decode(form, 0, here, u, there), DSE_OK);
    for (int k = 0; k < form->n; k++) {
        assert_near(there[k], bench->x[k], 0, TOLERANCE(1e-13, 1e-4));
    }
}

static void a_map_without_inputs_has_none(void **state)
{
    (void)state;
    for_all_plants(check_map_without_inputs);
}

/* ---- cstr2 ---- */

static void cstr2_rests_in_its_steady_states(void **state)
{
    (void)state;
    static const dse_real rest[2][4] = {
        {DSE_REAL(305.715512), DSE_REAL(2.497447), DSE_REAL(304.172640), DSE_REAL(2.283483)},
        {DSE_REAL(305.051578), DSE_REAL(2.497514), DSE_REAL(303.914218), DSE_REAL(2.283534)}};
    for (int set = 0; set < 2; set++) {
        struct bench bench;
        dse_real u[2] = {DSE_REAL(4.998), 0}, dx[4];
        set_up(&bench, dse_plant_find("cstr2"), set);
        assert_int_equal(bench.model.f(&bench.model, 0, rest[set], u, dx), DSE_OK);
        for (int k = 0; k < 4; k++) {
            /* six printed decimals times rates of 55 per hour */
            assert_true(dse_abs(dx[k]) < TOLERANCE(1e-4, 2e-2));
        }
    }
}

static void reactor_without_a_temperature_is_a_model_error(void **state)
{
    (void)state;
    struct bench bench;
    set_up(&bench, dse_plant_find("cstr2"), 0);
    const struct dse_model *m = &bench.model;
    const struct dse_normal_form *form = &bench.form;
    const dse_real bad[] = {0, -1, (dse_real)INFINITY, (dse_real)-INFINITY, (dse_real)NAN};
    dse_real out[16];
    for (int b = 0; b < 5; b++) {
        dse_real x[4];
        memcpy(x, bench.x, sizeof x);
        x[2] = bad[b];
        assert_int_equal(m->f(m, 0, x, bench.u, out), DSE_EMODEL);
        assert_int_equal(m->dfdx(m, 0, x, bench.u, out), DSE_EMODEL);
        assert_int_equal(form->encode(form, 0, x, bench.u, out), DSE_EMODEL);
        assert_int_equal(form->decode(form, 0, x, bench.u, out), DSE_EMODEL);
        assert_int_equal(form->field(form, 0, x, bench.u, out), DSE_EMODEL);
        assert_int_equal(form->jacobian(form, 0, 0, x, bench.u, out), DSE_EMODEL);
        assert_int_equal(form->map_jacobian(form, 1, 0, x, bench.u, out), DSE_EMODEL);
    }
    /* so cold that no reaction runs: the concentration cannot be decoded */
    dse_real cold[4] = {DSE_REAL(1), 0, DSE_REAL(1), 0};
    assert_int_equal(form->decode(form, 0, cold, bench.u, out), DSE_EMODEL);
    assert_int_equal(form->field(form, 0, cold, bench.u, out), DSE_EMODEL);
    assert_int_equal(form->jacobian(form, 0, 0, cold, bench.u, out), DSE_EMODEL);
}

static void feed_without_a_value_is_refused(void **state)
{
    (void)state;
    struct bench bench;
    dse_real out[16];
    set_up(&bench, dse_plant_find("cstr2"), 0);
    const struct dse_normal_form *form = &bench.form;
    assert_int_equal(bench.model.f(&bench.model, 0, bench.x, NULL, out), DSE_EINVAL);
    assert_int_equal(bench.model.dfdx(&bench.model, 0, bench.x, NULL, out), DSE_EINVAL);
    assert_int_equal(form->encode(form, 0, bench.x, NULL, out), DSE_EINVAL);
    assert_int_equal(form->decode(form, 0, bench.x, NULL, out), DSE_EINVAL);
    assert_int_equal(form->field(form, 0, bench.x, NULL, out), DSE_EINVAL);
    assert_int_equal(form->jacobian(form, 0, 0, bench.x, NULL, out), DSE_EINVAL);
    assert_int_equal(form->map_jacobian(form, 0, 0, bench.x, NULL, out), DSE_EINVAL);
}

/* Section 4.7, Fig 4.8: a predictor with a wrong recycle flow; F_1 stays. */
static void recycle_mismatch_moves_reactor_1_only(void **state)
{
    (void)state;
    const struct dse_plant *plant = dse_plant_find("cstr2");
    struct bench right, wrong;
    dse_real values[DSE_PLANT_MAX_PARAMETERS], f[4], g[4];
    int mismatch = 0;
    while (strcmp(plant->parameters[mismatch].name, "dFr") != 0) {
        mismatch++;
        assert_true(mismatch < plant->n_parameters);
    }
    set_up(&right, plant, 1);
    set_up(&wrong, plant, 1);
    memcpy(values, plant->sets[1].values, (size_t)plant->n_parameters * sizeof *values);
    values[mismatch] = 5;
    assert_int_equal(plant->prepare(values, wrong.prepared), DSE_OK);
    plant->model(wrong.prepared, &wrong.model);
    assert_int_equal(right.model.f(&right.model, 0, right.x, right.u, f), DSE_OK);
    assert_int_equal(wrong.model.f(&wrong.model, 0, right.x, right.u, g), DSE_OK);
    /* 5 m3/h into 1 m3: 5 (T_2 - T_1), 5 (C_2 - C_1) */
    assert_near(g[0] - f[0], 5 * (right.x[2] - right.x[0]), 1, TOLERANCE(1e-11, 1e-4));
    assert_near(g[1] - f[1], 5 * (right.x[3] - right.x[1]), 1, TOLERANCE(1e-11, 1e-4));
    assert_memory_equal(&g[2], &f[2], 2 * sizeof *g);
}

/* ---- cstr4 ---- */

static void cstr4_rests_in_its_steady_state(void **state)
{
    (void)state;
    static const dse_real rest[8] = {
        DSE_REAL(310.837553), DSE_REAL(3.031726), DSE_REAL(310.832851), DSE_REAL(2.800238),
        DSE_REAL(312.466274), DSE_REAL(2.844137), DSE_REAL(311.157564), DSE_REAL(3.014166)};
    struct bench bench;
    dse_real dx[8];
    set_up(&bench, dse_plant_find("cstr4"), 0);
    assert_int_equal(bench.model.f(&bench.model, 0, rest, NULL, dx), DSE_OK);
    for (int k = 0; k < 8; k++) {
        assert_true(dse_abs(dx[k]) < TOLERANCE(1e-4, 2e-2));
    }
}

/* F_3 = F_01 + F_02 + F_03 + F_r2 flows from 3 to 4, and with F_04 out of it, whatever the feeds
 * and recycles are. */
static void cstr4_balances_its_flows_for_any_feeds(void **state)
{
    (void)state;
    const struct dse_plant *plant = dse_plant_find("cstr4");
    static const char *const flows[] = {"F01", "F02", "F03", "F04", "Fr1", "Fr2"};
    static const dse_real m3h[] = {DSE_REAL(7.5), 25, 28, 54, 110, 65};
    dse_real values[DSE_PLANT_MAX_PARAMETERS], prepared[MAX_PREPARED], x[8], F[64];
    struct dse_model m;
    memcpy(values, plant->sets[0].values, (size_t)plant->n_parameters * sizeof *values);
    for (int k = 0; k < plant->n_parameters; k++) {
        for (int f = 0; f < 6; f++) {
            if (strcmp(plant->parameters[k].name, flows[f]) == 0) {
                values[k] = m3h[f];
            }
        }
    }
    for (int i = 0; i < 4; i++) {
        x[2 * i] = 300;
        x[2 * i + 1] = 0; /* nothing to react: the Jacobian of the temperatures is the mixing */
    }
    assert_int_equal(plant->prepare(values, prepared), DSE_OK);
    plant->model(prepared, &m);
    assert_int_equal(m.dfdx(&m, 0, x, NULL, F), DSE_OK);
    const dse_real F_3 = m3h[0] + m3h[1] + m3h[2] + m3h[5];
    assert_near(F[6 * 8 + 4], F_3 / 6, 0, TOLERANCE(1e-13, 1e-5));
    assert_near(F[6 * 8 + 6], -(F_3 + m3h[3]) / 6, 0, TOLERANCE(1e-13, 1e-5));
    /* F_1 = F_01 + F_r1 + F_r2 from 1 to 2, F_2 - F_r1 = F_01 + F_02 + F_r2 from 2 to 3 */
    assert_near(F[2 * 8], (m3h[0] + m3h[4] + m3h[5]) / 3, 0, TOLERANCE(1e-13, 1e-5));
    assert_near(F[4 * 8 + 2], (m3h[0] + m3h[1] + m3h[5]) / 4, 0, TOLERANCE(1e-13, 1e-5));
}

/* ---- three_tank ---- */

enum { IDENTIFIED = 0, RIG = 1 };

static void rig_rests_at_its_initial_state(void **state)
{
    (void)state;
    struct bench bench;
    dse_real u[2], dx[5];
    set_up(&bench, dse_plant_find("three_tank"), RIG);
    for (int k = 0; k < 2; k++) {
        u[k] = bench.plant->inputs[k].nominal;
    }
    assert_int_equal(bench.model.f(&bench.model, 0, bench.x, u, dx), DSE_OK);
    for (int k = 0; k < 5; k++) {
        assert_true(dse_abs(dx[k]) < TOLERANCE(1e-9, 1e-2));
    }
    /* the identified model is off there by 95 cm/h in tank 2 */
    set_up(&bench, dse_plant_find("three_tank"), IDENTIFIED);
    assert_int_equal(bench.model.f(&bench.model, 0, bench.x, u, dx), DSE_OK);
    assert_near(dx[2], 95, 0, DSE_REAL(0.01));
}

static void interactions_move_like_the_differences_of_the_levels(void **state)
{
    (void)state;
    struct bench bench;
    dse_real dx[5];
    for (int set = 0; set < 2; set++) {
        set_up(&bench, dse_plant_find("three_tank"), set);
        bench.x[1] += 3; /* off the differences: the interaction is a state of its own */
        assert_int_equal(bench.model.f(&bench.model, 0, bench.x, bench.u, dx), DSE_OK);
        assert_near(dx[1], dx[0] - dx[2], 1, TOLERANCE(1e-13, 1e-4));
        assert_near(dx[4], dx[3] - dx[2], 1, TOLERANCE(1e-13, 1e-4));
    }
}

static void flows_between_the_tanks_reverse_in_the_rig_only(void **state)
{
    (void)state;
    struct bench bench;
    dse_real up[5], down[5], empty[5];
    const dse_real x[5] = {20, -5, 25, 20, -5};
    const dse_real mirrored[5] = {20, 5, 25, 20, 5};
    const dse_real dry[5] = {-1, 5, -1, -1, 5};
    set_up(&bench, dse_plant_find("three_tank"), RIG);
    assert_int_equal(bench.model.f(&bench.model, 0, x, bench.u, up), DSE_OK);
    assert_int_equal(bench.model.f(&bench.model, 0, mirrored, bench.u, down), DSE_OK);
    /* q and -q: their mean is the flow without q */
    const struct dse_model *m = &bench.model;
    const dse_real level[5] = {20, 0, 25, 20, 0};
    dse_real none[5];
    assert_int_equal(m->f(m, 0, level, bench.u, none), DSE_OK);
    for (int k = 0; k < 5; k++) {
        assert_near((up[k] + down[k]) / 2, none[k], 1, TOLERANCE(1e-12, 1e-4));
    }
    assert_true(up[0] > down[0] && up[2] < down[2]);
    /* an empty tank has no outflow */
    assert_int_equal(m->f(m, 0, dry, bench.u, empty), DSE_OK);
    assert_near(empty[0] + empty[2] + empty[3],
                DSE_REAL(177.662338) * bench.u[0] + DSE_REAL(162.077922) * bench.u[1], 0,
                TOLERANCE(1e-8, 1e-5));
    /* the estimators' model knows one direction, and no level below 0.01 cm */
    const dse_real least[5] = {20, DSE_REAL(0.01), 25, 20, DSE_REAL(0.01)};
    set_up(&bench, dse_plant_find("three_tank"), IDENTIFIED);
    assert_int_equal(m->f(m, 0, x, bench.u, up), DSE_OK);
    assert_int_equal(m->f(m, 0, least, bench.u, down), DSE_OK);
    assert_memory_equal(up, down, sizeof up);
}

static void decoded_levels_stay_within_the_tanks(void **state)
{
    (void)state;
    struct bench bench;
    dse_real chi[5], z[5], dz[5], F[4];
    set_up(&bench, dse_plant_find("three_tank"), IDENTIFIED);
    const struct dse_normal_form *form = &bench.form;
    static const dse_real wild[] = {-1e6, -1e3, -1, 0, 1, 1e3, 1e6};
    for (int a = 0; a < 7; a++) {
        for (int b = 0; b < 7; b++) {
            const dse_real point[5] = {wild[a], wild[b], wild[a], wild[b], wild[a]};
            assert_int_equal(form->decode(form, 0, point, bench.u, chi), DSE_OK);
            for (int k = 0; k < 5; k++) {
                assert_true(chi[k] >= TOLERANCE(0.01 - 1e-15, 0.01 - 1e-8) &&
                            chi[k] <= TOLERANCE(100 + 1e-12, 100.001));
            }
            assert_int_equal(form->field(form, 0, point, bench.u, dz), DSE_OK);
            assert_true(dse_all_finite(dz, 5));
            /* an outer block's chain keeps its own unclipped z: z_1' = z_2 + b u */
            assert_near(dz[0], point[1] + DSE_REAL(177.662338) * bench.u[0], 1,
                        TOLERANCE(1e-7, 1e-5));
            for (int i = 0; i < 3; i++) {
                assert_int_equal(form->jacobian(form, i, 0, point, bench.u, F), DSE_OK);
                assert_true(dse_all_finite(F, form->n_i[i] * form->n_i[i]));
            }
        }
    }
    /* within the limits nothing is held */
    assert_int_equal(form->encode(form, 0, bench.x, bench.u, z), DSE_OK);
    assert_int_equal(form->decode(form, 0, z, bench.u, chi), DSE_OK);
    for (int k = 0; k < 5; k++) {
        assert_near(chi[k], bench.x[k], 0, TOLERANCE(1e-13, 1e-4));
    }
}

static void tanks_refuse_what_is_not_a_number(void **state)
{
    (void)state;
    struct bench bench;
    set_up(&bench, dse_plant_find("three_tank"), RIG);
    const struct dse_model *m = &bench.model;
    const struct dse_normal_form *form = &bench.form;
    dse_real out[25];
    for (int k = 0; k < 5; k++) {
        const dse_real bad[] = {(dse_real)NAN, (dse_real)INFINITY};
        for (int b = 0; b < 2; b++) {
            dse_real x[5];
            memcpy(x, bench.x, sizeof x);
            x[k] = bad[b];
            assert_int_equal(m->f(m, 0, x, bench.u, out), DSE_EMODEL);
            assert_int_equal(m->dfdx(m, 0, x, bench.u, out), DSE_EMODEL);
            assert_int_equal(form->encode(form, 0, x, bench.u, out), DSE_EMODEL);
            assert_int_equal(form->decode(form, 0, x, bench.u, out), DSE_EMODEL);
            assert_int_equal(form->field(form, 0, x, bench.u, out), DSE_EMODEL);
            assert_int_equal(form->jacobian(form, 0, 0, x, bench.u, out), DSE_EMODEL);
            assert_int_equal(form->map_jacobian(form, 0, 0, x, bench.u, out), DSE_EMODEL);
        }
    }
    assert_int_equal(m->f(m, 0, bench.x, NULL, out), DSE_EINVAL);
    assert_int_equal(form->field(form, 0, bench.x, NULL, out), DSE_EINVAL);
    assert_int_equal(form->jacobian(form, 0, 0, bench.x, NULL, out), DSE_EINVAL);
    dse_real values[DSE_PLANT_MAX_PARAMETERS], prepared[MAX_PREPARED];
    memcpy(values, bench.plant->sets[RIG].values,
           (size_t)bench.plant->n_parameters * sizeof *values);
    values[bench.plant->n_parameters - 1] = DSE_REAL(0.5);
    assert_int_equal(bench.plant->prepare(values, prepared), DSE_EINVAL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(shipped_plants_are_found_by_name),
        cmocka_unit_test(every_plant_describes_itself),
        cmocka_unit_test(values_outside_their_range_make_no_plant),
        cmocka_unit_test(model_jacobian_agrees_with_differences),
        cmocka_unit_test(output_jacobian_agrees_with_differences),
        cmocka_unit_test(decode_inverts_encode),
        cmocka_unit_test(field_is_the_derivative_of_the_coordinates),
        cmocka_unit_test(only_the_last_row_of_a_block_is_nonlinear_even_with_a_varying_feed),
        cmocka_unit_test(block_jacobian_freezes_the_other_blocks_of_z),
        cmocka_unit_test(map_jacobian_agrees_with_differences),
        cmocka_unit_test(push_is_the_directional_derivative_of_encode),
        cmocka_unit_test(field_jacobian_agrees_with_differences),
        cmocka_unit_test(a_map_without_inputs_has_none),
        cmocka_unit_test(cstr2_rests_in_its_steady_states),
        cmocka_unit_test(reactor_without_a_temperature_is_a_model_error),
        cmocka_unit_test(feed_without_a_value_is_refused),
        cmocka_unit_test(recycle_mismatch_moves_reactor_1_only),
        cmocka_unit_test(cstr4_rests_in_its_steady_state),
        cmocka_unit_test(cstr4_balances_its_flows_for_any_feeds),
        cmocka_unit_test(rig_rests_at_its_initial_state),
        cmocka_unit_test(interactions_move_like_the_differences_of_the_levels),
        cmocka_unit_test(flows_between_the_tanks_reverse_in_the_rig_only),
        cmocka_unit_test(decoded_levels_stay_within_the_tanks),
        cmocka_unit_test(tanks_refuse_what_is_not_a_number),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
