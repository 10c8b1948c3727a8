/* What every normal form of a shipped plant keeps: its maps invert each other, its field is that of
 * the plant, its derivatives agree with differences. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "plant_bench.h"

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
        assert_near_scaled(chi[k], bench->x[k], 0, TOLERANCE(1e-13, 1e-4));
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
        assert_near_scaled(dz[k], (z_plus[k] - z_minus[k]) / (2 * dt), 1, TOLERANCE(1e-6, 5e-2));
    }
}

static void field_is_the_derivative_of_the_coordinates(void **state)
{
    (void)state;
    for_all_plants(check_field);
}

/* b(z) = z' - A z at x: in the rows of a chain before its last one, that of the next row is not in
 * it. */
static void nonlinearity(struct bench *bench, const dse_real *x, dse_real *z, dse_real *b)
{
    const struct dse_normal_form *form = &bench->form;
    assert_int_equal(form->encode(form, 0, x, bench->u, z), DSE_OK);
    assert_int_equal(form->field(form, 0, z, bench->u, b), DSE_OK);
    for (int i = 0, offset = 0; i < form->p; offset += form->n_i[i++]) {
        for (int k = offset; k + 1 < offset + form->n_i[i]; k++) {
            b[k] -= z[k + 1];
        }
    }
}

/* The same at another state: a known input may enter there, the state may not. */
static void check_chain(struct bench *bench)
{
    const struct dse_normal_form *form = &bench->form;
    dse_real x[MAX_N], z[MAX_N], here[MAX_N] = {0}, there[MAX_N] = {0};
    if (bench->plant->normal_form == NULL) {
        return;
    }
    for (int k = 0; k < form->n; k++) {
        x[k] = bench->x[k] + bench->plant->states[k].scale / (dse_real)(2 + k);
    }
    nonlinearity(bench, bench->x, z, here);
    nonlinearity(bench, x, z, there);
    for (int i = 0, offset = 0; i < form->p; offset += form->n_i[i++]) {
        for (int k = offset; k + 1 < offset + form->n_i[i]; k++) {
            assert_near_scaled(here[k], there[k], 1, TOLERANCE(1e-11, 1e-2));
        }
    }
}

static void only_the_last_row_of_a_block_is_nonlinear_even_with_a_varying_feed(void **state)
{
    (void)state;
    for_all_plants(check_chain);
}

/* |Theta v|^2 with Theta_i = diag(theta^-(n* - n_i), .., theta^-(n* - 1)). */
static dse_real scaled_square(const struct dse_normal_form *form, dse_real theta, const dse_real *v)
{
    dse_real sum = 0;
    for (int i = 0, k = 0; i < form->p; i++) {
        for (int r = 0; r < form->n_i[i]; r++, k++) {
            const int last = form->n_i[i] - 1 - r; /* rows below it: Theta is largest at the top */
            const dse_real scale = dse_pow(theta, (dse_real)last);
            sum += scale * v[k] * scale * v[k];
        }
    }
    return sum; /* times theta^(2 (n* - 1)), which both sides of a comparison have */
}

/* |Theta (b(z) - b(w))| / |Theta (z - w)| at theta = 1 and at a high gain. */
static void check_lipschitz(struct bench *bench)
{
    const struct dse_normal_form *form = &bench->form;
    dse_real x[MAX_N], z[MAX_N], w[MAX_N], b[MAX_N], c[MAX_N];
    if (bench->plant->normal_form == NULL) {
        return;
    }
    for (int k = 0; k < form->n; k++) {
        x[k] = bench->x[k] + bench->plant->states[k].scale / (dse_real)(2 + k);
    }
    nonlinearity(bench, bench->x, z, b);
    nonlinearity(bench, x, w, c);
    for (int k = 0; k < form->n; k++) {
        z[k] -= w[k];
        b[k] -= c[k];
    }
    const dse_real plain = scaled_square(form, 1, b) / scaled_square(form, 1, z);
    const dse_real high = scaled_square(form, 40, b) / scaled_square(form, 40, z);
    assert_true(plain > 0);
    assert_true(high <= plain);
}

/* The proofs need b to be no steeper in the coordinates Theta z, theta >= 1, than in z (appendix B
 * of the source): so it is when only the last rows of b, which Theta makes smallest, are not zero.
 */
static void high_gain_does_not_steepen_the_nonlinearity(void **state)
{
    (void)state;
    for_all_plants(check_lipschitz);
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
                assert_near_scaled(F[r * n_i + c],
                                   (plus[offset + r] - minus[offset + r]) / (2 * step), 1,
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
                assert_near_scaled(M[r * n_i + c],
                                   (plus[offset + r] - minus[offset + r]) / (2 * step), 1,
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
        assert_near_scaled(dz[k], (plus[k] - minus[k]) / (2 * step), 1, TOLERANCE(1e-6, 5e-2));
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
            assert_near_scaled(F[r * n + c], (plus[r] - minus[r]) / (2 * step), 1,
                               TOLERANCE(1e-5, 5e-2));
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
        assert_near_scaled(there[k], bench->x[k], 0, TOLERANCE(1e-13, 1e-4));
    }
}

static void a_map_without_inputs_has_none(void **state)
{
    (void)state;
    for_all_plants(check_map_without_inputs);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(decode_inverts_encode),
        cmocka_unit_test(field_is_the_derivative_of_the_coordinates),
        cmocka_unit_test(only_the_last_row_of_a_block_is_nonlinear_even_with_a_varying_feed),
        cmocka_unit_test(high_gain_does_not_steepen_the_nonlinearity),
        cmocka_unit_test(block_jacobian_freezes_the_other_blocks_of_z),
        cmocka_unit_test(map_jacobian_agrees_with_differences),
        cmocka_unit_test(push_is_the_directional_derivative_of_encode),
        cmocka_unit_test(field_jacobian_agrees_with_differences),
        cmocka_unit_test(a_map_without_inputs_has_none),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
