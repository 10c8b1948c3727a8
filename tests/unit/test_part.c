/* Parts of a plant: the functions of a closed choice have the bits of the whole plant's, and what
 * is no part is refused. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "dse/part.h"
#include "plant_bench.h"

enum { N = 8, P = 4, STORAGE = DSE_PART_STORAGE(N, P, P), COUNT = 11 };

struct rig {
    struct bench whole;
    struct dse_part part;
    dse_real memory[STORAGE];
};

static void value_of(const struct dse_plant *plant, dse_real *values, const char *name,
                     dse_real value)
{
    for (int k = 0; k < plant->n_parameters; k++) {
        if (strcmp(plant->parameters[k].name, name) == 0) {
            values[k] = value;
        }
    }
}

/* Four reactors, with or without the recycles that make a network of the series. */
static void open_plant(struct rig *rig, bool series)
{
    const struct dse_plant *plant = dse_plant_find("cstr4");
    dse_real values[DSE_PLANT_MAX_PARAMETERS];
    memset(rig, 0, sizeof *rig);
    set_up(&rig->whole, plant, 0);
    memcpy(values, plant->sets[0].values, (size_t)plant->n_parameters * sizeof *values);
    if (series) {
        value_of(plant, values, "Fr1", 0);
        value_of(plant, values, "Fr2", 0);
    }
    assert_int_equal(plant->prepare(values, rig->whole.prepared), DSE_OK);
}

static enum dse_status choose(struct rig *rig, const int *block, int blocks)
{
    struct dse_arena arena;
    dse_arena_init(&arena, rig->memory, STORAGE);
    return dse_part_init(&rig->part, &rig->whole.model, &rig->whole.form, block, blocks,
                         rig->whole.x, rig->whole.u, &arena);
}

/* Another state of the part than the one that the whole was given. */
static void move(const struct rig *rig, dse_real by, dse_real *part, dse_real *whole)
{
    memcpy(whole, rig->whole.x, N * sizeof *whole);
    for (int k = 0; k < rig->part.model.nx; k++) {
        part[k] = rig->whole.x[k] * (1 + by * (dse_real)(k + 1));
        whole[k] = part[k];
    }
}

static const int upstream[] = {0, 1, 2};

static void model_of_a_series_upstream_has_the_bits_of_the_whole(void **state)
{
    (void)state;
    for (int blocks = 1; blocks <= 3; blocks++) {
        static struct rig rig;
        dse_real x[COUNT * N], X[COUNT * N], dx[COUNT * N], dX[COUNT * N], F[N * N], FX[N * N];
        open_plant(&rig, true);
        assert_int_equal(choose(&rig, upstream, blocks), DSE_OK);
        const struct dse_model *part = &rig.part.model, *whole = &rig.whole.model;
        const int n = part->nx;
        assert_true(n == 2 * blocks && part->ny == blocks && part->nu == whole->nu);
        for (int c = 0; c < COUNT; c++) {
            move(&rig, DSE_REAL(1e-3) * (dse_real)c, x + c * n, X + c * N);
        }
        assert_int_equal(part->f(part, 0, x + n, rig.whole.u, dx), DSE_OK);
        assert_int_equal(whole->f(whole, 0, X + N, rig.whole.u, dX), DSE_OK);
        assert_memory_equal(dx, dX, (size_t)n * sizeof *dx);
        /* more than the lanes that are taken together */
        assert_int_equal(part->f_many(part, 0, COUNT, x, rig.whole.u, dx), DSE_OK);
        assert_int_equal(whole->f_many(whole, 0, COUNT, X, rig.whole.u, dX), DSE_OK);
        for (int c = 0; c < COUNT; c++) {
            assert_memory_equal(dx + c * n, dX + c * N, (size_t)n * sizeof *dx);
        }
        assert_int_equal(part->h(part, 0, x, rig.whole.u, dx), DSE_OK);
        assert_int_equal(whole->h(whole, 0, X, rig.whole.u, dX), DSE_OK);
        assert_memory_equal(dx, dX, (size_t)blocks * sizeof *dx);
        assert_int_equal(part->dfdx(part, 0, x, rig.whole.u, F), DSE_OK);
        assert_int_equal(whole->dfdx(whole, 0, X, rig.whole.u, FX), DSE_OK);
        for (int r = 0; r < n; r++) {
            assert_memory_equal(F + r * n, FX + r * N, (size_t)n * sizeof *F);
        }
        assert_int_equal(part->dhdx(part, 0, x, rig.whole.u, F), DSE_OK);
        assert_int_equal(whole->dhdx(whole, 0, X, rig.whole.u, FX), DSE_OK);
        for (int r = 0; r < blocks; r++) {
            assert_memory_equal(F + r * n, FX + r * N, (size_t)n * sizeof *F);
        }
    }
}

static void coordinates_of_a_series_upstream_have_the_bits_of_the_whole(void **state)
{
    (void)state;
    static struct rig rig;
    dse_real chi[N], Chi[N], z[N], Z[N], d[N], D[N], back[N], F[4], FX[4];
    open_plant(&rig, true);
    assert_int_equal(choose(&rig, upstream, 3), DSE_OK);
    const struct dse_normal_form *part = &rig.part.form, *whole = &rig.whole.form;
    const dse_real *u = rig.whole.u;
    const size_t size = (size_t)part->n * sizeof *z;
    assert_true(part->n == 6 && part->p == 3 && part->nu == whole->nu);
    for (int round = 1; round < 3; round++) { /* what is outside stays also after a push */
        move(&rig, DSE_REAL(1e-3) * (dse_real)round, chi, Chi);
        assert_int_equal(part->encode(part, 0, chi, u, z), DSE_OK);
        assert_int_equal(whole->encode(whole, 0, Chi, u, Z), DSE_OK);
        assert_memory_equal(z, Z, size);
        assert_int_equal(part->decode(part, 0, z, u, back), DSE_OK);
        assert_int_equal(whole->decode(whole, 0, Z, u, D), DSE_OK);
        assert_memory_equal(back, D, size);
        assert_int_equal(part->field(part, 0, z, u, d), DSE_OK);
        assert_int_equal(whole->field(whole, 0, Z, u, D), DSE_OK);
        assert_memory_equal(d, D, size);
        for (int i = 0; i < 3; i++) {
            assert_int_equal(part->jacobian(part, i, 0, z, u, F), DSE_OK);
            assert_int_equal(whole->jacobian(whole, i, 0, Z, u, FX), DSE_OK);
            assert_memory_equal(F, FX, sizeof F);
            assert_int_equal(part->map_jacobian(part, i, 0, chi, u, F), DSE_OK);
            assert_int_equal(whole->map_jacobian(whole, i, 0, Chi, u, FX), DSE_OK);
            assert_memory_equal(F, FX, sizeof F);
        }
        dse_real Change[N] = {0};
        memcpy(Change, d, size);
        assert_int_equal(part->push(part, 0, chi, u, d, z), DSE_OK);
        assert_int_equal(whole->push(whole, 0, Chi, u, Change, Z), DSE_OK);
        assert_memory_equal(z, Z, size);
    }
    assert_null(part->field_jacobian); /* a part has no centralised filter */
}

static void a_choice_is_closed_when_nobody_outside_acts_on_it(void **state)
{
    (void)state;
    static const struct {
        bool series;
        int blocks, block[3];
        bool closed;
        int by, on;
    } cases[] = {
        {true, 1, {0}, true, 0, 0},         {true, 2, {0, 1}, true, 0, 0},
        {true, 3, {0, 1, 2}, true, 0, 0},   {true, 1, {1}, false, 0, 1},
        {true, 2, {0, 2}, false, 1, 2},     {true, 3, {1, 2, 3}, false, 0, 1},
        {false, 2, {0, 1}, false, 3, 0},    {false, 1, {0}, false, 1, 0},
        {false, 3, {0, 1, 3}, false, 2, 3},
    };
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++) {
        static struct rig rig;
        int by = -1, on = -1;
        open_plant(&rig, cases[c].series);
        assert_int_equal(choose(&rig, cases[c].block, cases[c].blocks), DSE_OK);
        const enum dse_status status = dse_part_closed(&rig.part, 0, rig.whole.u, &by, &on);
        assert_int_equal(status, cases[c].closed ? DSE_OK : DSE_EINVAL);
        assert_true(cases[c].closed || (by == cases[c].by && on == cases[c].on));
    }
}

/* Chains and outputs of a block are those of the whole plant's. */
static void a_part_keeps_the_sizes_of_its_blocks(void **state)
{
    (void)state;
    static const int outer[] = {0, 2};
    static dse_real memory[DSE_PART_STORAGE(5, 3, 3)];
    struct bench bench;
    struct dse_part part;
    struct dse_arena arena;
    memset(&bench, 0, sizeof bench);
    set_up(&bench, dse_plant_find("three_tank"), 0);
    dse_arena_init(&arena, memory, DSE_PART_STORAGE(5, 3, 3));
    assert_int_equal(
        dse_part_init(&part, &bench.model, &bench.form, outer, 2, bench.x, bench.u, &arena),
        DSE_OK);
    assert_true(part.form.n == 4 && part.form.p == 2 && part.model.ny == 2);
    assert_true(part.state[0] == 0 && part.state[1] == 1 && part.state[2] == 3);
    assert_true(part.output[0] == 0 && part.output[1] == 2);
    assert_true(part.n_i[1] == 2 && part.n_outputs[1] == 1 && part.chains[1] == 2);
}

static void what_is_no_part_is_refused(void **state)
{
    (void)state;
    static struct rig rig;
    struct dse_arena arena;
    open_plant(&rig, true);
    static const int twice[] = {1, 1}, beyond[] = {4}, down[] = {2, 1}, negative[] = {-1};
    assert_int_equal(choose(&rig, twice, 2), DSE_EINVAL);
    assert_int_equal(choose(&rig, beyond, 1), DSE_EINVAL);
    assert_int_equal(choose(&rig, down, 2), DSE_EINVAL);
    assert_int_equal(choose(&rig, negative, 1), DSE_EINVAL);
    assert_int_equal(choose(&rig, upstream, 0), DSE_EINVAL);
    dse_arena_init(&arena, rig.memory, STORAGE - 1);
    assert_int_equal(dse_part_init(&rig.part, &rig.whole.model, &rig.whole.form, upstream, 2,
                                   rig.whole.x, rig.whole.u, &arena),
                     DSE_ESTORAGE);
    rig.whole.model.nx = 7;
    assert_int_equal(choose(&rig, upstream, 2), DSE_EDIM);
    open_plant(&rig, true);
    rig.whole.x[0] = -1; /* a temperature that is none */
    assert_int_equal(choose(&rig, upstream, 2), DSE_EMODEL);
    open_plant(&rig, true);
    rig.whole.model.dfdx = NULL;
    int by = 0, on = 0;
    assert_int_equal(choose(&rig, upstream, 2), DSE_OK);
    assert_null(rig.part.model.dfdx);
    assert_int_equal(dse_part_closed(&rig.part, 0, rig.whole.u, &by, &on), DSE_EINVAL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(model_of_a_series_upstream_has_the_bits_of_the_whole),
        cmocka_unit_test(coordinates_of_a_series_upstream_have_the_bits_of_the_whole),
        cmocka_unit_test(a_choice_is_closed_when_nobody_outside_acts_on_it),
        cmocka_unit_test(a_part_keeps_the_sizes_of_its_blocks),
        cmocka_unit_test(what_is_no_part_is_refused),
    };
    return cmocka_run_group_tests_name("part", tests, NULL, NULL);
}
