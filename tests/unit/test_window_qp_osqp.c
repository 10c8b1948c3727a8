/* OSQP as the window QP's second opinion, on a host. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "dse/window_qp_osqp.h"
#include "window_qp_rig.h"

#define TIGHT 1e-11

static dse_real osqp_memory[DSE_WINDOW_QP_OSQP_STORAGE(NZ_MAX, NZ_MAX, H_MAX)];
static struct dse_window_qp qp;
static struct dse_window_qp_osqp osqp;
static const struct dse_window_qp_backend backend = {dse_window_qp_osqp_solve, &osqp};
static struct rig rig;

static void set_up(int capacity)
{
    struct dse_arena arena;
    dse_arena_init(&arena, osqp_memory, capacity);
    assert_int_equal(dse_window_qp_osqp_setup(&osqp, &rig.problem, rig.nz, rig.nr, &arena), DSE_OK);
    assert_int_equal(arena.used, DSE_WINDOW_QP_OSQP_KEPT(rig.nz, rig.nr, rig.H));
}

/* Its own search switched off, the solver stands on OSQP's active set and refines it. */
static void an_active_set_of_osqp_leads_to_the_exact_solution(void **state)
{
    (void)state;
    random_state = 31;
    long by_backend = 0;
    for (int run = 0; run < 100; run++) {
        const int nz = 1 + rig_choose(NZ_MAX), H = 1 + rig_choose(H_MAX);
        const bool identity = run % 2 == 0;
        const int nr = identity ? nz : rig_choose(nz + 1);
        rig_make(&rig, nz, nr, H, 60, identity);
        set_up(DSE_WINDOW_QP_OSQP_STORAGE(nz, nr, H));
        const struct dse_window_qp_config config = {.nz = nz,
                                                    .nr = nr,
                                                    .stages = H,
                                                    .max_passes = -1,
                                                    .max_steps = -1,
                                                    .backend = &backend};
        assert_int_equal(rig_start(&qp, &config), DSE_OK);
        rig_solve(&qp, &rig);
        rig_assert_optimal(&rig, &qp, TIGHT);
        by_backend += qp.counts.by_backend;
        dse_window_qp_osqp_cleanup(&osqp);
    }
    assert_true(by_backend > 80); /* in the others nothing was to be searched for */
}

/* The workspace follows the problem's P, not only its vectors. */
static void a_changed_p_reaches_osqp(void **state)
{
    (void)state;
    random_state = 32;
    rig_make(&rig, 3, 3, H_MAX, 60, true);
    set_up(DSE_WINDOW_QP_OSQP_STORAGE(3, 3, H_MAX));
    const struct dse_window_qp_config config = {.nz = 3, .nr = 3, .stages = H_MAX};
    dse_real y[K_MAX], largest = 0;
    for (int change = 0; change < 2; change++) {
        for (int i = 0; i < 3; i++)
            rig.diagonal_blocks[2][i * 4] += 10 * (dse_real)change;
        assert_int_equal(rig_start(&qp, &config), DSE_OK);
        rig_solve(&qp, &rig);
        assert_int_equal(dse_window_qp_osqp_solve(&osqp, &rig.problem, y), DSE_OK);
        for (int k = 0; k < 6 * H_MAX - 3; k++)
            largest = dse_max(largest, dse_abs(dse_window_qp_multipliers(&qp)[k]));
        assert_all_near(6 * H_MAX - 3, y, dse_window_qp_multipliers(&qp), 1e-4 * largest);
    }
    dse_window_qp_osqp_cleanup(&osqp);
}

static void windows_of_another_length_are_refused(void **state)
{
    (void)state;
    random_state = 33;
    rig_make(&rig, 2, 2, H_MAX, 60, true);
    set_up(DSE_WINDOW_QP_OSQP_STORAGE(2, 2, H_MAX));
    dse_real y[K_MAX];
    rig.problem.stages--;
    assert_int_equal(dse_window_qp_osqp_solve(&osqp, &rig.problem, y), DSE_EDIM);
    dse_window_qp_osqp_cleanup(&osqp);
    struct dse_arena arena;
    dse_arena_init(&arena, osqp_memory, DSE_WINDOW_QP_OSQP_STORAGE(2, 2, H_MAX - 1) - 1);
    assert_int_equal(dse_window_qp_osqp_setup(&osqp, &rig.problem, 2, 2, &arena), DSE_ESTORAGE);
}

static void a_problem_without_curvature_is_refused_at_set_up(void **state)
{
    (void)state;
    random_state = 34;
    rig_make(&rig, 2, 2, H_MAX, 60, true);
    rig.diagonal_blocks[1][0] = 0;
    struct dse_arena arena;
    dse_arena_init(&arena, osqp_memory, DSE_WINDOW_QP_OSQP_STORAGE(2, 2, H_MAX));
    assert_int_equal(dse_window_qp_osqp_setup(&osqp, &rig.problem, 2, 2, &arena), DSE_EINVAL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_active_set_of_osqp_leads_to_the_exact_solution),
        cmocka_unit_test(a_changed_p_reaches_osqp),
        cmocka_unit_test(windows_of_another_length_are_refused),
        cmocka_unit_test(a_problem_without_curvature_is_refused_at_set_up),
    };
    return cmocka_run_group_tests_name("window_qp_osqp", tests, NULL, NULL);
}
