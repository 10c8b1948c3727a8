/* The window QP: problems without a solution, degenerate ones, limits, bad backends, refusals. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "window_qp_rig.h"

#define TIGHT TOLERANCE(1e-11, 1e-3)

static struct dse_window_qp qp;
static struct rig rig;

/* A row between the first two stages that no point within their bounds satisfies. */
static void contradict(int nz)
{
    dse_real most = 0;
    for (int i = 0; i < nz; i++) {
        for (int j = 0; j < 2; j++) {
            const dse_real a = j == 0 ? rig.E[i] : rig.F[i];
            rig.lower[j * nz + i] = dse_max(rig.lower[j * nz + i], -10);
            rig.upper[j * nz + i] = dse_min(rig.upper[j * nz + i], 10);
            most += a > 0 ? a * rig.upper[j * nz + i] : a * rig.lower[j * nz + i];
        }
    }
    rig.row_lower[0] = most + DSE_REAL(0.1);
    rig.row_upper[0] = NONE;
}

static void infeasible_problems_are_told_from_feasible_ones(void **state)
{
    (void)state;
    random_state = 41;
    int undecided = 0;
    for (int run = 0; run < 200; run++) {
        const int nz = 2 + rig_choose(NZ_MAX - 1), H = 2 + rig_choose(H_MAX - 1);
        const struct dse_window_qp_config config = {.nz = nz, .nr = nz, .stages = H};
        rig_make(&rig, nz, nz, H, 50, false);
        assert_int_equal(rig_start(&qp, &config), DSE_OK);
        rig_solve(&qp, &rig);
        struct rig before = rig;
        dse_real z[Z_MAX];
        memcpy(z, dse_window_qp_z(&qp), sizeof z[0] * (size_t)(nz * H));
        contradict(nz);
        const enum dse_status status = dse_window_qp_solve(&qp, &rig.problem);
        assert_true(status == DSE_EINFEASIBLE || status == DSE_ENOCONV);
        undecided += status == DSE_ENOCONV;
        assert_memory_equal(dse_window_qp_z(&qp), z, sizeof z[0] * (size_t)(nz * H));
        assert_true(qp.counts.infeasible + qp.counts.failed == 1);
        memcpy(rig.row_lower, before.row_lower, sizeof rig.row_lower);
        memcpy(rig.row_upper, before.row_upper, sizeof rig.row_upper);
        memcpy(rig.lower, before.lower, sizeof rig.lower);
        memcpy(rig.upper, before.upper, sizeof rig.upper);
        assert_int_equal(dse_window_qp_solve(&qp, &rig.problem), DSE_OK);
        assert_all_near(nz * H, dse_window_qp_z(&qp), z, TIGHT);
    }
    assert_true(undecided <= TOLERANCE(0, 10)); /* in single precision not every case is clear */
}

/* A vertex where more constraints meet than there are unknowns: E = -F, all of z bounded by 1 from
 * above, all differences by 0 from above, everything pulled upwards. */
static void constraints_that_meet_in_one_point_do_no_harm(void **state)
{
    (void)state;
    for (int nz = 1; nz <= NZ_MAX; nz++) {
        const struct dse_window_qp_config config = {.nz = nz, .nr = nz, .stages = H_MAX};
        random_state = 42;
        rig_make(&rig, nz, nz, H_MAX, 0, true);
        for (int i = 0; i < nz * nz; i++)
            rig.E[i] = i / nz == i % nz ? -1 : 0;
        for (int i = 0; i < nz * H_MAX; i++) {
            rig.upper[i] = 1;
            rig.c[i] = 100;
        }
        for (int i = 0; i < nz * (H_MAX - 1); i++)
            rig.row_lower[i] = rig.row_upper[i] = 0;
        assert_int_equal(rig_start(&qp, &config), DSE_OK);
        rig_solve(&qp, &rig);
        rig_assert_optimal(&rig, &qp, 100 * (double)TIGHT);
        for (int i = 0; i < nz * H_MAX; i++)
            assert_near(dse_window_qp_z(&qp)[i], 1, TIGHT);
    }
}

/* The same constraint again and again: rows equal to bounds. */
static void a_constraint_that_is_given_twice_counts_once(void **state)
{
    (void)state;
    random_state = 43;
    for (int run = 0; run < 50; run++) {
        enum { NZ = 3 };
        const struct dse_window_qp_config config = {.nz = NZ, .nr = NZ, .stages = H_MAX};
        rig_make(&rig, NZ, NZ, H_MAX, 70, false);
        memset(rig.E, 0, sizeof rig.E);
        memset(rig.F, 0, sizeof rig.F);
        for (int i = 0; i < NZ; i++)
            rig.F[i * NZ + i] = 2;
        for (int i = 0; i < NZ * (H_MAX - 1); i++) { /* of stage j + 1, times two */
            rig.row_lower[i] = rig.lower[NZ + i] > -NONE ? 2 * rig.lower[NZ + i] : -NONE;
            rig.row_upper[i] = rig.upper[NZ + i] < NONE ? 2 * rig.upper[NZ + i] : NONE;
        }
        assert_int_equal(rig_start(&qp, &config), DSE_OK);
        rig_solve(&qp, &rig);
        rig_assert_optimal(&rig, &qp, (double)TIGHT);
    }
}

static void too_few_places_for_active_constraints_are_reported(void **state)
{
    (void)state;
    random_state = 44;
    struct dse_window_qp_config config = {.nz = 2, .stages = H_MAX, .max_active = 3};
    rig_make(&rig, 2, 0, H_MAX, 0, true);
    for (int i = 0; i < 2 * H_MAX; i++) {
        rig.c[i] = 100;
        rig.upper[i] = i < 3 ? 1 : NONE;
    }
    assert_int_equal(rig_start(&qp, &config), DSE_OK);
    rig_solve(&qp, &rig);
    rig_assert_optimal(&rig, &qp, 100 * (double)TIGHT);
    for (int i = 0; i < 2 * H_MAX; i++)
        rig.upper[i] = 1;
    assert_int_equal(dse_window_qp_solve(&qp, &rig.problem), DSE_ENOCONV);
    assert_true(qp.counts.failed == 1);
}

/* ---- backends that lie ---- */

static enum dse_status all_active(void *context, const struct dse_window_qp_problem *problem,
                                  dse_real *y)
{
    const int count = *(int *)context;
    (void)problem;
    for (int k = 0; k < count; k++)
        y[k] = k % 2 == 0 ? 1 : -1;
    return DSE_OK;
}

static enum dse_status not_a_number(void *context, const struct dse_window_qp_problem *problem,
                                    dse_real *y)
{
    (void)all_active(context, problem, y);
    y[1] = (dse_real)__builtin_nan("");
    return DSE_OK;
}

static enum dse_status gives_up(void *context, const struct dse_window_qp_problem *problem,
                                dse_real *y)
{
    (void)context;
    (void)problem;
    y[0] = 1;
    return DSE_ENOCONV;
}

static void a_backend_is_not_trusted(void **state)
{
    (void)state;
    static const struct {
        enum dse_status (*solve)(void *, const struct dse_window_qp_problem *, dse_real *);
        enum dse_status expected;
    } cases[] = {
        {all_active, DSE_OK}, /* wrong, and put right */
        {not_a_number, DSE_ENONFINITE},
        {gives_up, DSE_ENOCONV},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        int count = 6 * H_MAX - 3;
        const struct dse_window_qp_backend backend = {cases[i].solve, &count};
        const struct dse_window_qp_config config = {.nz = 3,
                                                    .nr = 3,
                                                    .stages = H_MAX,
                                                    .max_passes = -1,
                                                    .max_steps = -1,
                                                    .backend = &backend};
        random_state = 45;
        rig_make(&rig, 3, 3, H_MAX, 60, true);
        assert_int_equal(rig_start(&qp, &config), DSE_OK);
        assert_int_equal(dse_window_qp_factor(&qp, &rig.problem, H_MAX - 1), DSE_OK);
        assert_int_equal(dse_window_qp_solve(&qp, &rig.problem), cases[i].expected);
        if (cases[i].expected == DSE_OK) {
            assert_int_equal(qp.path, DSE_PATH_BACKEND);
            rig_assert_optimal(&rig, &qp, (double)TIGHT);
        }
    }
}

/* ---- refusals ---- */

static void impossible_configurations_are_refused(void **state)
{
    (void)state;
    const struct dse_window_qp_config good = {.nz = 3, .nr = 3, .stages = 4};
    enum { CASES = 8 };
    struct dse_window_qp_config c[CASES];
    for (int i = 0; i < CASES; i++)
        c[i] = good;
    static const struct dse_window_qp_backend nothing;
    c[0].nz = 0;
    c[1].nr = -1;
    c[2].stages = 0;
    c[3].max_active = 13;
    c[4].max_passes = -2;
    c[5].max_steps = -2;
    c[6].tolerance = -1;
    c[7].backend = &nothing;
    for (int i = 0; i < CASES; i++)
        assert_int_equal(rig_start(&qp, &c[i]), DSE_EINVAL);
    assert_int_equal(rig_start(&qp, &good), DSE_OK);
    struct dse_arena arena;
    for (int most = 1; most <= 12; most++) {
        c[0] = good;
        c[0].max_active = most;
        dse_arena_init(&arena, rig_memory, DSE_WINDOW_QP_STORAGE(3, 3, 4, most));
        assert_int_equal(dse_window_qp_init(&qp, &c[0], &arena), DSE_OK);
        assert_int_equal(arena.used, DSE_WINDOW_QP_STORAGE(3, 3, 4, most));
        dse_arena_init(&arena, rig_memory, DSE_WINDOW_QP_STORAGE(3, 3, 4, most) - 1);
        assert_int_equal(dse_window_qp_init(&qp, &c[0], &arena), DSE_ESTORAGE);
    }
}

static void impossible_problems_are_refused(void **state)
{
    (void)state;
    random_state = 46;
    const struct dse_window_qp_config config = {.nz = 3, .nr = 3, .stages = H_MAX};
    const dse_real nan = (dse_real)__builtin_nan("");
    rig_make(&rig, 3, 3, H_MAX, 60, true);
    const struct rig good = rig;
    assert_int_equal(rig_start(&qp, &config), DSE_OK);
    assert_int_equal(dse_window_qp_solve(&qp, &rig.problem), DSE_EINVAL); /* no factor */
    rig_solve(&qp, &rig);
    rig.lower[4] = 1;
    rig.upper[4] = 0;
    assert_int_equal(dse_window_qp_solve(&qp, &rig.problem), DSE_EINVAL);
    rig.lower[4] = nan;
    assert_int_equal(dse_window_qp_solve(&qp, &rig.problem), DSE_ENONFINITE);
    memcpy(rig.lower, good.lower, sizeof rig.lower);
    memcpy(rig.upper, good.upper, sizeof rig.upper);
    rig.c[3] = nan;
    assert_int_equal(dse_window_qp_solve(&qp, &rig.problem), DSE_ENONFINITE);
    memcpy(rig.c, good.c, sizeof rig.c);
    rig.problem.stages--;
    assert_int_equal(dse_window_qp_solve(&qp, &rig.problem), DSE_EINVAL);
    rig.problem.stages++;
    assert_int_equal(dse_window_qp_solve(&qp, &rig.problem), DSE_OK); /* nothing has suffered */
    rig.diagonal_blocks[2][4] = -1;
    assert_int_equal(dse_window_qp_factor(&qp, &rig.problem, H_MAX - 1), DSE_ENOTPD);
    rig.diagonal_blocks[2][4] = nan;
    assert_int_equal(dse_window_qp_factor(&qp, &rig.problem, H_MAX - 1), DSE_ENONFINITE);
    assert_int_equal(dse_window_qp_solve(&qp, &rig.problem), DSE_EINVAL);
    assert_int_equal(dse_window_qp_factor(&qp, &good.problem, 0), DSE_EINVAL); /* what else? */
}

static void a_bitmap_that_cannot_be_is_refused(void **state)
{
    (void)state;
    random_state = 47;
    enum { NZ = 2 };
    struct dse_window_qp_config config = {.nz = NZ, .nr = NZ, .stages = H_MAX};
    const unsigned char all[8] = {255, 255, 255, 255, 255, 255, 255, 255};
    const unsigned char one[8] = {1};
    rig_make(&rig, NZ, NZ, H_MAX, 50, false);
    memset(rig.E, 0, sizeof rig.E);
    rig.F[0] = 1;
    rig.F[1] = 0;
    assert_int_equal(rig_start(&qp, &config), DSE_OK);
    assert_int_equal(dse_window_qp_take_bitmap(&qp, &rig.problem, one), DSE_EINVAL);
    assert_int_equal(dse_window_qp_factor(&qp, &rig.problem, H_MAX - 1), DSE_OK);
    assert_int_equal(dse_window_qp_take_bitmap(&qp, &rig.problem, all), DSE_ESTORAGE);
    const unsigned char clash[8] = {0x14}; /* row 0 and z_10 */
    assert_int_equal(dse_window_qp_take_bitmap(&qp, &rig.problem, clash), DSE_ESINGULAR);
    const unsigned char fine[8] = {0x13};
    assert_int_equal(dse_window_qp_take_bitmap(&qp, &rig.problem, fine), DSE_OK);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(infeasible_problems_are_told_from_feasible_ones),
        cmocka_unit_test(constraints_that_meet_in_one_point_do_no_harm),
        cmocka_unit_test(a_constraint_that_is_given_twice_counts_once),
        cmocka_unit_test(too_few_places_for_active_constraints_are_reported),
        cmocka_unit_test(a_backend_is_not_trusted),
        cmocka_unit_test(impossible_configurations_are_refused),
        cmocka_unit_test(impossible_problems_are_refused),
        cmocka_unit_test(a_bitmap_that_cannot_be_is_refused),
    };
    return cmocka_run_group_tests_name("window_qp_failures", tests, NULL, NULL);
}
