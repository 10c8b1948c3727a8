/* The optional parts of a normal form, for every plant that offers them, against its own maps and
 * fields by central differences. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "dse/math.h"
#include "dse/plant.h"

enum { MAX_N = 16 };

struct point {
    dse_real prepared[512], x[MAX_N], z[MAX_N], u[DSE_PLANT_MAX_INPUTS];
    struct dse_normal_form form;
    int n;
};

/* Off the initial state, with an input that moves. */
static bool make_point(const struct dse_plant *plant, struct point *point)
{
    if (plant->normal_form == NULL || plant->nx > MAX_N || plant->prepared_size > 512) {
        return false;
    }
    assert_int_equal(plant->prepare(plant->sets[0].values, point->prepared), DSE_OK);
    plant->normal_form(point->prepared, &point->form);
    point->n = plant->nx;
    for (int k = 0; k < plant->nx; k++) {
        point->x[k] = plant->sets[0].x0[k] * (1 + DSE_REAL(0.01) * (dse_real)(k + 1));
    }
    for (int k = 0; k < plant->nu; k++) {
        point->u[k] = plant->inputs[k].nominal + plant->inputs[k].scale;
    }
    assert_int_equal(point->form.encode(&point->form, 0, point->x, point->u, point->z), DSE_OK);
    return true;
}

#ifdef DSE_REAL_IS_float
#define STEP      DSE_REAL(5e-3)
#define TOLERANCE DSE_REAL(2e-2)
#else
#define STEP      DSE_REAL(1e-5)
#define TOLERANCE DSE_REAL(1e-6)
#endif

typedef enum dse_status (*map)(const struct dse_normal_form *form, dse_real t, const dse_real *in,
                               const dse_real *u, dse_real *out);

/* (f(at + h d) - f(at - h d)) / 2h */
static void difference(const struct point *point, map f, const dse_real *at, const dse_real *d,
                       dse_real h, dse_real *slope)
{
    dse_real moved[MAX_N] = {0}, up[MAX_N], down[MAX_N];
    for (int k = 0; k < point->n; k++) {
        moved[k] = at[k] + h * d[k];
    }
    assert_int_equal(f(&point->form, 0, moved, point->u, up), DSE_OK);
    for (int k = 0; k < point->n; k++) {
        moved[k] = at[k] - h * d[k];
    }
    assert_int_equal(f(&point->form, 0, moved, point->u, down), DSE_OK);
    for (int k = 0; k < point->n; k++) {
        slope[k] = (up[k] - down[k]) / (2 * h);
    }
}

static void assert_close(const dse_real *got, const dse_real *want, int n)
{
    dse_real largest = 0;
    for (int k = 0; k < n; k++) {
        largest = dse_max(largest, dse_abs(want[k]));
    }
    for (int k = 0; k < n; k++) {
        if (!(dse_abs(got[k] - want[k]) <= TOLERANCE * largest)) {
            fail_msg("%d: %.12g is not %.12g", k, (double)got[k], (double)want[k]);
        }
    }
}

static void push_is_the_derivative_of_the_map(void **state)
{
    (void)state;
    int seen = 0;
    for (int p = 0; dse_plant_at(p) != NULL; p++) {
        struct point point = {.n = 0};
        if (!make_point(dse_plant_at(p), &point) || point.form.push == NULL) {
            continue;
        }
        seen++;
        for (int c = 0; c < point.n; c++) {
            dse_real d[MAX_N] = {0}, got[MAX_N] = {0}, want[MAX_N] = {0};
            d[c] = 1;
            d[(c + 1) % point.n] = DSE_REAL(0.3);
            assert_int_equal(point.form.push(&point.form, 0, point.x, point.u, d, got), DSE_OK);
            difference(&point, point.form.encode, point.x, d, STEP * point.x[c], want);
            assert_close(got, want, point.n);
        }
    }
    assert_true(seen >= 2);
}

static void field_jacobian_is_the_derivative_of_the_field_and_contains_the_blocks(void **state)
{
    (void)state;
    int seen = 0;
    for (int p = 0; dse_plant_at(p) != NULL; p++) {
        struct point point = {.n = 0};
        dse_real F[MAX_N * MAX_N] = {0}, own[MAX_N * MAX_N] = {0};
        if (!make_point(dse_plant_at(p), &point) || point.form.field_jacobian == NULL) {
            continue;
        }
        seen++;
        const int n = point.n;
        assert_int_equal(point.form.field_jacobian(&point.form, 0, point.z, point.u, F), DSE_OK);
        for (int c = 0; c < n; c++) {
            dse_real d[MAX_N] = {0}, column[MAX_N] = {0}, want[MAX_N] = {0};
            d[c] = 1;
            difference(&point, point.form.field, point.z, d, STEP * dse_abs(point.z[c]), want);
            for (int r = 0; r < n; r++) {
                column[r] = F[r * n + c];
            }
            assert_close(column, want, n);
        }
        for (int i = 0, offset = 0; i < point.form.p; offset += point.form.n_i[i++]) {
            const int n_i = point.form.n_i[i];
            assert_int_equal(point.form.jacobian(&point.form, i, 0, point.z, point.u, own), DSE_OK);
            for (int r = 0; r < n_i; r++) {
                for (int c = 0; c < n_i; c++) {
                    const dse_real whole = F[(offset + r) * n + offset + c];
                    assert_true(dse_abs(own[r * n_i + c] - whole) <=
                                TOLERANCE * (1 + dse_abs(whole)));
                }
            }
        }
    }
    assert_true(seen >= 2);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(push_is_the_derivative_of_the_map),
        cmocka_unit_test(field_jacobian_is_the_derivative_of_the_field_and_contains_the_blocks),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
