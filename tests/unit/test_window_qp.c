/* The window QP: optimality on random problems, warm starts, sensitivities. */
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

static struct dse_window_qp_config config_of(int nz, int nr, int H)
{
    return (struct dse_window_qp_config){.nz = nz, .nr = nr, .stages = H};
}

static int active_count(const struct dse_window_qp *solver)
{
    int count = 0;
    for (int k = 0; k < solver->stages * (solver->nz + solver->nr); k++)
        count += dse_window_qp_side(solver, k) != 0;
    return count;
}

static void random_problems_are_solved_to_their_optimality_conditions(void **state)
{
    (void)state;
    random_state = 1;
    int most_active = 0;
    for (int run = 0; run < 1000; run++) {
        const int nz = 1 + rig_choose(NZ_MAX), H = 1 + rig_choose(H_MAX);
        const bool identity = run % 2 == 0;
        const int nr = run % 3 == 0 ? 0 : identity ? nz : rig_choose(nz + 1);
        const struct dse_window_qp_config config = config_of(nz, nr, H);
        rig_make(&rig, nz, nr, H, 10 * (run % 10), identity);
        assert_int_equal(rig_start(&qp, &config), DSE_OK);
        rig_solve(&qp, &rig);
        rig_assert_optimal(&rig, &qp, (double)TIGHT);
        most_active = active_count(&qp) > most_active ? active_count(&qp) : most_active;
    }
    assert_true(most_active > Z_MAX / 2);
}

/* max_passes = -1: no swaps. */
static void the_dual_method_alone_finds_the_same_solution(void **state)
{
    (void)state;
    random_state = 2;
    for (int run = 0; run < 200; run++) {
        const int nz = 1 + rig_choose(NZ_MAX), H = 1 + rig_choose(H_MAX);
        struct dse_window_qp_config config = config_of(nz, nz, H);
        rig_make(&rig, nz, nz, H, 60, true);
        assert_int_equal(rig_start(&qp, &config), DSE_OK);
        rig_solve(&qp, &rig);
        dse_real z[Z_MAX];
        memcpy(z, dse_window_qp_z(&qp), sizeof(dse_real) * (size_t)(nz * H));
        config.max_passes = -1;
        assert_int_equal(rig_start(&qp, &config), DSE_OK);
        rig_solve(&qp, &rig);
        rig_assert_optimal(&rig, &qp, (double)TIGHT);
        assert_all_near(nz * H, dse_window_qp_z(&qp), z, TIGHT);
    }
}

/* The members are brought into one order before the last solution, which so depends on the active
 * set alone and not on the way to it. */
static void a_warm_start_gives_the_bits_of_a_cold_one(void **state)
{
    (void)state;
    random_state = 3;
    int same_set = 0;
    for (int run = 0; run < 200; run++) {
        const struct dse_window_qp_config config = config_of(3, 3, H_MAX);
        rig_make(&rig, 3, 3, H_MAX, 50, true);
        assert_int_equal(rig_start(&qp, &config), DSE_OK);
        rig_solve(&qp, &rig);
        for (int i = 0; i < 3 * H_MAX; i++) /* the next problem: nearly the same */
            rig.c[i] += uniform() / 4;
        assert_int_equal(dse_window_qp_solve(&qp, &rig.problem), DSE_OK);
        dse_real z[Z_MAX];
        unsigned char warm[8], cold[8];
        memcpy(z, dse_window_qp_z(&qp), sizeof z[0] * 3 * H_MAX);
        dse_window_qp_bitmap(&qp, warm);
        assert_int_equal(rig_start(&qp, &config), DSE_OK);
        rig_solve(&qp, &rig);
        dse_window_qp_bitmap(&qp, cold);
        if (memcmp(warm, cold, (6 * H_MAX + 7) / 8) != 0)
            continue; /* a constraint that is met without force may count or not */
        same_set++;
        assert_memory_equal(dse_window_qp_z(&qp), z, sizeof z[0] * 3 * H_MAX);
    }
    assert_true(same_set >= TOLERANCE(200, 190));
}

static void a_warm_start_needs_one_pass_when_the_set_stays(void **state)
{
    (void)state;
    random_state = 4;
    const struct dse_window_qp_config config = config_of(3, 3, H_MAX);
    rig_make(&rig, 3, 3, H_MAX, 60, true);
    assert_int_equal(rig_start(&qp, &config), DSE_OK);
    rig_solve(&qp, &rig);
    assert_true(qp.set.passes > 1);
    assert_int_equal(dse_window_qp_solve(&qp, &rig.problem), DSE_OK);
    assert_int_equal(qp.set.passes, 1);
    assert_int_equal(qp.set.steps, 0);
}

/* Slides the window: stage j + 1 becomes stage j. */
static void the_active_set_moves_with_the_window(void **state)
{
    (void)state;
    random_state = 5;
    enum { NZ = 2, STRIDE = 4 };
    const struct dse_window_qp_config config = config_of(NZ, NZ, H_MAX);
    rig_make(&rig, NZ, NZ, H_MAX, 70, true);
    assert_int_equal(rig_start(&qp, &config), DSE_OK);
    rig_solve(&qp, &rig);
    dse_window_qp_slide(&qp);
    for (int k = STRIDE; k < STRIDE * H_MAX; k++)
        assert_int_equal(qp.set.side[k - STRIDE], dse_window_qp_side(&qp, k));
    assert_true(qp.set.count > 0);
}

static void only_changed_stages_need_to_be_factored_again(void **state)
{
    (void)state;
    random_state = 6;
    const struct dse_window_qp_config config = config_of(3, 3, H_MAX);
    for (int newest = 0; newest < H_MAX; newest++) {
        rig_make(&rig, 3, 3, H_MAX, 50, true);
        assert_int_equal(rig_start(&qp, &config), DSE_OK);
        rig_solve(&qp, &rig);
        for (int j = 0; j <= newest; j++)
            for (int i = 0; i < 3; i++)
                rig.diagonal_blocks[j][i * 3 + i] += 1;
        assert_int_equal(dse_window_qp_factor(&qp, &rig.problem, newest), DSE_OK);
        assert_int_equal(dse_window_qp_solve(&qp, &rig.problem), DSE_OK);
        rig_assert_optimal(&rig, &qp, (double)TIGHT);
    }
}

/* A growing window keeps the factors by their distance from the newest stage. */
static void a_window_can_grow_at_its_old_end_with_two_new_factors(void **state)
{
    (void)state;
    random_state = 7;
    const struct dse_window_qp_config config = config_of(3, 3, H_MAX);
    rig_make(&rig, 3, 3, H_MAX, 50, true);
    assert_int_equal(rig_start(&qp, &config), DSE_OK);
    struct rig part = rig;
    part.H = part.problem.stages = H_MAX - 1;
    for (int j = 0; j < H_MAX - 1; j++) { /* the newest stages of the whole */
        memcpy(part.diagonal_blocks[j], rig.diagonal_blocks[j + 1], sizeof part.diagonal_blocks[j]);
        memcpy(part.below_blocks[j], rig.below_blocks[j + 1], sizeof part.below_blocks[j]);
        part.diagonal[j] = part.diagonal_blocks[j];
        part.below[j] = part.below_blocks[j];
    }
    for (int i = 0; i < 3; i++)
        part.diagonal_blocks[0][i * 4] += 1;
    part.problem.diagonal = part.diagonal;
    part.problem.below = part.below;
    assert_int_equal(dse_window_qp_factor(&qp, &part.problem, H_MAX - 2), DSE_OK);
    assert_int_equal(dse_window_qp_factor(&qp, &rig.problem, 1), DSE_OK);
    assert_int_equal(dse_window_qp_solve(&qp, &rig.problem), DSE_OK);
    rig_assert_optimal(&rig, &qp, (double)TIGHT);
}

/* dz/dc by differences: the set stays, so they are exact but for rounding. */
static void sensitivities_are_the_differences_of_solutions(void **state)
{
    (void)state;
    random_state = 8;
    enum { NZ = 3, ALL = NZ * H_MAX };
    const struct dse_window_qp_config config = config_of(NZ, NZ, H_MAX);
    const dse_real h = TOLERANCE(1e-6, 1e-2);
    rig_make(&rig, NZ, NZ, H_MAX, 50, true);
    assert_int_equal(rig_start(&qp, &config), DSE_OK);
    rig_solve(&qp, &rig);
    dse_real z[ALL], X[ALL * ALL];
    memcpy(z, dse_window_qp_z(&qp), sizeof z);
    for (int i = 0; i < ALL * ALL; i++)
        X[i] = i / ALL == i % ALL;
    unsigned char bitmap[K_MAX], after[K_MAX];
    dse_window_qp_bitmap(&qp, bitmap);
    assert_int_equal(dse_window_qp_respond(&qp, ALL, X), DSE_OK);
    for (int p = 0; p < ALL; p++) {
        rig.c[p] += h;
        assert_int_equal(dse_window_qp_solve(&qp, &rig.problem), DSE_OK);
        dse_window_qp_bitmap(&qp, after);
        assert_memory_equal(after, bitmap, (2 * ALL + 7) / 8);
        for (int i = 0; i < ALL; i++)
            assert_near((dse_window_qp_z(&qp)[i] - z[i]) / h, X[i * ALL + p],
                        TOLERANCE(1e-7, 1e-3));
        rig.c[p] -= h;
    }
}

/* The coordinator knows the problem but for its linear term, and gets the bitmap. */
static void sensitivities_follow_from_the_bitmap_alone(void **state)
{
    (void)state;
    random_state = 9;
    enum { NZ = 3, ALL = NZ * H_MAX };
    static dse_real other_memory[DSE_WINDOW_QP_STORAGE(NZ, NZ, H_MAX, ALL)];
    const struct dse_window_qp_config config = config_of(NZ, NZ, H_MAX);
    struct dse_window_qp other;
    struct dse_arena arena;
    for (int run = 0; run < 20; run++) {
        rig_make(&rig, NZ, NZ, H_MAX, 50, true);
        assert_int_equal(rig_start(&qp, &config), DSE_OK);
        rig_solve(&qp, &rig);
        unsigned char bitmap[K_MAX];
        dse_real X[ALL * 2], Y[ALL * 2];
        fill(ALL * 2, X);
        memcpy(Y, X, sizeof Y);
        dse_window_qp_bitmap(&qp, bitmap);
        assert_int_equal(dse_window_qp_respond(&qp, 2, X), DSE_OK);
        dse_arena_init(&arena, other_memory, (int)(sizeof other_memory / sizeof other_memory[0]));
        assert_int_equal(dse_window_qp_init(&other, &config, &arena), DSE_OK);
        assert_int_equal(dse_window_qp_factor(&other, &rig.problem, H_MAX - 1), DSE_OK);
        assert_int_equal(dse_window_qp_take_bitmap(&other, &rig.problem, bitmap), DSE_OK);
        assert_int_equal(dse_window_qp_respond(&other, 2, Y), DSE_OK);
        assert_memory_equal(Y, X, sizeof X);
        for (int k = 0; k < 2 * ALL - NZ; k++) { /* what is bounded exactly does not move */
            if (k % (2 * NZ) < NZ && dse_window_qp_side(&qp, k) != 0)
                assert_near(Y[(k / (2 * NZ) * NZ + k % (2 * NZ)) * 2], 0, TIGHT);
        }
    }
}

static void the_certificate_tells_what_is_wrong(void **state)
{
    (void)state;
    random_state = 10;
    enum { NZ = 2, ALL = NZ * H_MAX };
    const struct dse_window_qp_config config = config_of(NZ, 0, H_MAX);
    rig_make(&rig, NZ, 0, H_MAX, 100, true);
    assert_int_equal(rig_start(&qp, &config), DSE_OK);
    rig_solve(&qp, &rig);
    dse_real z[ALL], y[ALL];
    memcpy(z, dse_window_qp_z(&qp), sizeof z);
    memcpy(y, dse_window_qp_multipliers(&qp), sizeof y);
    const struct dse_window_qp_certificate good = dse_window_qp_certify(&qp, &rig.problem, z, y);
    assert_true(good.primal == 0 && good.dual < 100 * DSE_REAL_EPSILON &&
                good.gap < 100 * DSE_REAL_EPSILON);
    int active = 0;
    while (y[active] == 0)
        active++;
    const dse_real moved = DSE_REAL(0.01) * (y[active] > 0 ? DSE_REAL(1.0) : DSE_REAL(-1.0));
    z[active] += moved;
    assert_true(dse_window_qp_certify(&qp, &rig.problem, z, y).primal > DSE_REAL(1e-4));
    z[active] -= moved;
    y[active] *= DSE_REAL(1.01);
    assert_true(dse_window_qp_certify(&qp, &rig.problem, z, y).dual > DSE_REAL(1e-5));
    y[active] *= DSE_REAL(-1.0);
    assert_true(dse_window_qp_certify(&qp, &rig.problem, z, y).gap > DSE_REAL(1e-5));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(random_problems_are_solved_to_their_optimality_conditions),
        cmocka_unit_test(the_dual_method_alone_finds_the_same_solution),
        cmocka_unit_test(a_warm_start_gives_the_bits_of_a_cold_one),
        cmocka_unit_test(a_warm_start_needs_one_pass_when_the_set_stays),
        cmocka_unit_test(the_active_set_moves_with_the_window),
        cmocka_unit_test(only_changed_stages_need_to_be_factored_again),
        cmocka_unit_test(a_window_can_grow_at_its_old_end_with_two_new_factors),
        cmocka_unit_test(sensitivities_are_the_differences_of_solutions),
        cmocka_unit_test(sensitivities_follow_from_the_bitmap_alone),
        cmocka_unit_test(the_certificate_tells_what_is_wrong),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
