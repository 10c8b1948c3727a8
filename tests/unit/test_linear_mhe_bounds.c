/* The linear moving horizon estimator with bounds: against the window QP, and what happens when the
 * bounds cannot be kept. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "dse/window_qp.h"
#include "linear_mhe_rig.h"

/* The estimator divides by Q where the QP inverts it. */
#define ALIKE TOLERANCE(1e-8, 5e-2)

enum { WIDE = NX_MAX * N_MAX };
static dse_real bounded_memory[DSE_LINEAR_MHE_BOUNDED_STORAGE(NX_MAX, NY_MAX, N_MAX, WIDE)];
static dse_real qp_memory[DSE_WINDOW_QP_STORAGE(NX_MAX, NX_MAX, N_MAX, WIDE)];

static enum dse_status start_bounded(struct dse_linear_mhe *mhe,
                                     const struct dse_linear_mhe_config *config)
{
    struct dse_arena arena;
    dse_arena_init(&arena, bounded_memory, (int)(sizeof bounded_memory / sizeof bounded_memory[0]));
    return dse_linear_mhe_init(mhe, config, &arena);
}

/* ---- the reference: Psi and c of a window, with the inverses written out ---- */

struct reference {
    dse_real diagonal_blocks[N_MAX][NX_MAX * NX_MAX], below_block[NX_MAX * NX_MAX];
    const dse_real *diagonal[N_MAX], *below[N_MAX];
    dse_real c[WIDE], lower[WIDE], upper[WIDE], minus_A[NX_MAX * NX_MAX];
    dse_real row_lower[WIDE], row_upper[WIDE];
    struct dse_window_qp_problem problem;
};

/* B = A^-1. */
static void inverse_of(int n, const dse_real *A, dse_real *B)
{
    dse_real copy[NX_MAX * NX_MAX];
    memcpy(copy, A, (size_t)(n * n) * sizeof copy[0]);
    dense_inverse(n, copy, B);
}

/* M += a left' W right. */
static void add_weighted(int n, const dse_real *left, const dse_real *W, const dse_real *right,
                         dse_real a, dse_real *M)
{
    dse_real product[NX_MAX * NX_MAX], whole[NX_MAX * NX_MAX];
    dse_mat_mul(n, n, n, W, right, product);
    dse_mat_mul_tn(n, n, n, left, product, whole);
    dse_axpy(n * n, a, whole, M);
}

static void add_outputs(const struct system *s, const struct data *data, int k, dse_real *M,
                        dse_real *c)
{
    const int nx = s->nx, ny = s->ny;
    dse_real R[NY_MAX * NY_MAX], inverse[NY_MAX * NY_MAX];
    for (int a = 0; a < ny * ny; a++)
        R[a] = data->valid[k][a / ny] && data->valid[k][a % ny] ? s->R[a]
                                                                : (dse_real)(a / ny == a % ny);
    inverse_of(ny, R, inverse);
    for (int ab = 0; ab < ny * ny; ab++) {
        const int a = ab / ny, b = ab % ny;
        for (int i = 0; i < nx && data->valid[k][a] && data->valid[k][b]; i++) {
            const dse_real weight = s->C[a * nx + i] * inverse[ab];
            c[i] += weight * (data->y[k][b] - s->D[b] * data->u[k]);
            for (int p = 0; p < nx; p++)
                M[i * nx + p] += weight * s->C[b * nx + p];
        }
    }
}

/* The window first .. first + H - 1 with prior (xbar, P0), or without where xbar is NULL. */
static void make_reference(const struct system *s, const struct dse_linear_mhe_config *config,
                           const struct data *data, int first, int H, const dse_real *xbar,
                           struct reference *r)
{
    const int nx = s->nx;
    dse_real weight[NX_MAX * NX_MAX], identity[NX_MAX * NX_MAX], b[NX_MAX], v[NX_MAX];
    *r = (struct reference){.problem = {.stages = H}};
    dse_mat_identity(nx, identity);
    if (xbar) {
        inverse_of(nx, s->P0, r->diagonal_blocks[0]);
        dse_mat_vec(nx, nx, r->diagonal_blocks[0], xbar, r->c);
    }
    inverse_of(nx, s->Q, weight);
    for (int i = 0; i < nx * nx; i++)
        r->minus_A[i] = -s->A[i];
    add_weighted(nx, identity, weight, r->minus_A, 1, r->below_block);
    for (int j = 0; j < H; j++) {
        add_outputs(s, data, first + j, r->diagonal_blocks[j], r->c + j * nx);
        r->diagonal[j] = r->diagonal_blocks[j];
        r->below[j] = r->below_block;
        for (int i = 0; i < nx; i++) {
            r->lower[j * nx + i] = config->x_min[i];
            r->upper[j * nx + i] = config->x_max[i];
        }
        if (j + 1 == H)
            break;
        add_weighted(nx, r->minus_A, weight, r->minus_A, 1, r->diagonal_blocks[j]);
        add_weighted(nx, identity, weight, identity, 1, r->diagonal_blocks[j + 1]);
        for (int i = 0; i < nx; i++) {
            b[i] = s->B[i] * data->u[first + j];
            r->row_lower[j * nx + i] = config->w_min[i] + b[i];
            r->row_upper[j * nx + i] = config->w_max[i] + b[i];
        }
        dse_mat_vec(nx, nx, weight, b, v);
        dse_axpy(nx, 1, v, r->c + (j + 1) * nx);
        dse_mat_tvec(nx, nx, s->A, v, b);
        dse_axpy(nx, -1, b, r->c + j * nx);
    }
    r->problem.diagonal = r->diagonal;
    r->problem.below = r->below;
    r->problem.c = r->c;
    r->problem.bounds = (struct dse_window_bounds){.lower = r->lower,
                                                   .upper = r->upper,
                                                   .E = r->minus_A,
                                                   .row_lower = r->row_lower,
                                                   .row_upper = r->row_upper};
}

static const dse_real *solve_reference(const struct system *s, const struct reference *r)
{
    static struct dse_window_qp qp;
    static struct dse_window_qp_config config;
    struct dse_arena arena;
    config = (struct dse_window_qp_config){.nz = s->nx, .nr = s->nx, .stages = N_MAX};
    dse_arena_init(&arena, qp_memory, (int)(sizeof qp_memory / sizeof qp_memory[0]));
    assert_int_equal(dse_window_qp_init(&qp, &config, &arena), DSE_OK);
    assert_int_equal(dse_window_qp_factor(&qp, &r->problem, r->problem.stages - 1), DSE_OK);
    assert_int_equal(dse_window_qp_solve(&qp, &r->problem), DSE_OK);
    return dse_window_qp_z(&qp);
}

/* Bounds that bind often; x = 0 and w = -B u keep them all. */
struct limits {
    dse_real x_min[NX_MAX], x_max[NX_MAX], w_min[NX_MAX], w_max[NX_MAX];
};

static void limit(const struct system *s, struct limits *limits,
                  struct dse_linear_mhe_config *config)
{
    for (int i = 0; i < s->nx; i++) {
        limits->x_min[i] = choose(4) == 0 ? -DSE_REAL_MAX : -dse_abs(uniform()) / 4;
        limits->x_max[i] = choose(4) == 0 ? DSE_REAL_MAX : dse_abs(uniform()) / 4;
        limits->w_min[i] = -dse_abs(s->B[i]) - DSE_REAL(0.01);
        limits->w_max[i] = choose(4) == 0 ? DSE_REAL_MAX : dse_abs(s->B[i]);
    }
    config->x_min = limits->x_min;
    config->x_max = limits->x_max;
    config->w_min = limits->w_min;
    config->w_max = limits->w_max;
}

static void quieten(struct system *s)
{
    for (int i = 0; i < s->nx; i++)
        s->B[i] /= 20;
}

/* ---- the tests ---- */

static void bounded_windows_equal_the_window_qp(void **state)
{
    (void)state;
    random_state = 21;
    static struct reference reference;
    int bounded = 0;
    for (int trial = 0; trial < 60; trial++) {
        const enum dse_arrival arrival =
            trial % 3 == 0 ? DSE_ARRIVAL_NONE
                           : (trial % 3 == 1 ? DSE_ARRIVAL_CONSTANT : DSE_ARRIVAL_KALMAN);
        const int nx = 1 + trial % 4, N = arrival == DSE_ARRIVAL_KALMAN ? N_MAX : 5;
        struct system s;
        struct data data;
        struct limits limits;
        struct dse_linear_mhe mhe;
        random_system(&s, nx, 2, nx, nx, 1);
        quieten(&s);
        simulate(&s, arrival == DSE_ARRIVAL_NONE ? 0 : 25, &data);
        struct dse_linear_mhe_config config = config_of(&s, N, arrival);
        limit(&s, &limits, &config);
        assert_int_equal(start_bounded(&mhe, &config), DSE_OK);
        const int samples = arrival == DSE_ARRIVAL_KALMAN ? N_MAX : 12; /* KALMAN: P0 stays */
        for (int k = 0; k < samples; k++) {
            step(&mhe, &data, k);
            const int H = dse_linear_mhe_length(&mhe);
            if (arrival == DSE_ARRIVAL_NONE && H < nx)
                continue;
            make_reference(&s, &config, &data, k - H + 1, H,
                           arrival == DSE_ARRIVAL_NONE ? NULL : mhe.xbar, &reference);
            assert_agree(H * nx, dse_linear_mhe_window(&mhe), solve_reference(&s, &reference),
                         ALIKE);
            assert_true(dse_linear_mhe_certificate(&mhe) < TIGHT);
        }
        bounded += (int)mhe.counts.bounded;
        assert_true(mhe.counts.fallbacks == 0);
    }
    assert_true(bounded > 400);
}

static void bounds_that_do_not_bind_change_no_bit(void **state)
{
    (void)state;
    random_state = 22;
    for (int trial = 0; trial < 30; trial++) {
        const int nx = 1 + trial % NX_MAX;
        struct system s;
        struct data data;
        struct limits limits;
        struct dse_linear_mhe free, mhe;
        random_system(&s, nx, 2, choose(nx + 1), nx, 1);
        simulate(&s, 25, &data);
        struct dse_linear_mhe_config config = config_of(&s, 5, DSE_ARRIVAL_KALMAN);
        const struct dse_linear_mhe_config unbounded = config;
        limit(&s, &limits, &config);
        for (int i = 0; i < nx; i++) {
            limits.x_min[i] = limits.w_min[i] = -1000;
            limits.x_max[i] = limits.w_max[i] = 1000;
        }
        assert_int_equal(start(&free, &unbounded), DSE_OK);
        assert_int_equal(start_bounded(&mhe, &config), DSE_OK);
        for (int k = 0; k < STEPS; k++) {
            step(&free, &data, k);
            step(&mhe, &data, k);
            assert_memory_equal(dse_linear_mhe_window(&mhe), dse_linear_mhe_window(&free),
                                (size_t)(nx * dse_linear_mhe_length(&free)) * sizeof(dse_real));
            assert_true(dse_linear_mhe_certificate(&mhe) == dse_linear_mhe_certificate(&free));
        }
        assert_true(mhe.counts.bounded == 0);
    }
}

/* Noise in some directions only: no inverse exists, the certificate judges. */
static void singular_noise_is_no_obstacle_to_bounds(void **state)
{
    (void)state;
    random_state = 23;
    int bounded = 0, given_up = 0;
    for (int trial = 0; trial < 60; trial++) {
        const int nx = 2 + trial % 5;
        struct system s;
        struct data data;
        struct limits limits;
        struct dse_linear_mhe mhe;
        random_system(&s, nx, 2, 1 + choose(nx - 1), nx, 1);
        quieten(&s);
        simulate(&s, 25, &data);
        struct dse_linear_mhe_config config = config_of(&s, 6, DSE_ARRIVAL_KALMAN);
        limit(&s, &limits, &config);
        config.w_min = config.w_max = NULL; /* w cannot follow B u */
        for (int i = 0; i < nx; i++)
            limits.x_min[i] = -DSE_REAL_MAX;
        assert_int_equal(start_bounded(&mhe, &config), DSE_OK);
        for (int k = 0; k < STEPS; k++) {
            const struct dse_measurement sample = sample_of(&data, k);
            if (k > 0)
                assert_int_equal(dse_linear_mhe_advance(&mhe, &data.u[k - 1]), DSE_OK);
            assert_int_equal(dse_linear_mhe_measure(&mhe, 0, &data.u[k], &sample), DSE_OK);
            assert_int_equal(dse_linear_mhe_solve(&mhe), DSE_OK);
            if (dse_linear_mhe_path(&mhe) > DSE_PATH_DUAL)
                continue; /* the arrival cost, without noise, can contradict the bounds */
            assert_true(dse_linear_mhe_certificate(&mhe) < 20 * TIGHT);
            for (int i = 0; i < nx * dse_linear_mhe_length(&mhe); i++)
                assert_true(dse_linear_mhe_window(&mhe)[i] <=
                            limits.x_max[i % nx] + DSE_REAL(100.0) * EPS);
        }
        bounded += (int)mhe.counts.bounded;
        given_up += (int)(mhe.counts.fallbacks - mhe.counts.infeasible);
    }
    assert_true(bounded > 200 && given_up <= TOLERANCE(0, 10)); /* of 1440 windows */
}

static void late_values_count_with_bounds_as_if_they_had_come_in_time(void **state)
{
    (void)state;
    random_state = 24;
    for (int trial = 0; trial < 20; trial++) {
        enum { nx = 3, N = 6 };
        struct system s;
        struct data data;
        struct limits limits;
        struct dse_linear_mhe mhe;
        dse_real in_time[N * nx];
        random_system(&s, nx, 2, nx, nx, 1);
        quieten(&s);
        simulate(&s, 0, &data);
        struct dse_linear_mhe_config config = config_of(&s, N, DSE_ARRIVAL_KALMAN);
        limit(&s, &limits, &config);
        assert_int_equal(start_bounded(&mhe, &config), DSE_OK);
        for (int k = 0; k < N; k++)
            step(&mhe, &data, k);
        memcpy(in_time, dse_linear_mhe_window(&mhe), sizeof in_time);
        assert_int_equal(start_bounded(&mhe, &config), DSE_OK);
        data.valid[2][0] = false;
        for (int k = 0; k < N; k++)
            step(&mhe, &data, k);
        data.valid[2][0] = true;
        const struct dse_measurement late = sample_of(&data, 2);
        assert_int_equal(dse_linear_mhe_measure(&mhe, N - 3, &data.u[2], &late), DSE_OK);
        assert_int_equal(dse_linear_mhe_solve(&mhe), DSE_OK);
        assert_agree(N * nx, dse_linear_mhe_window(&mhe), in_time, ALIKE);
    }
}

/* x+ = x + u + w, x <= 1, |w| <= 0.1: a step of u by 1 is more than the bounds allow. */
static const dse_real one[1] = {1}, tenth[1] = {DSE_REAL(0.1)}, minus_tenth[1] = {DSE_REAL(-0.1)};

static struct dse_linear_mhe_config integrator(void)
{
    return (struct dse_linear_mhe_config){.nx = 1,
                                          .nu = 1,
                                          .ny = 1,
                                          .linear = {one, one, one, NULL},
                                          .horizon = 4,
                                          .arrival = DSE_ARRIVAL_KALMAN,
                                          .P0 = one,
                                          .Q = one,
                                          .R = one,
                                          .x_max = one,
                                          .w_min = minus_tenth,
                                          .w_max = tenth};
}

static void feed(struct dse_linear_mhe *mhe, dse_real u, dse_real y, enum dse_active_set_path path,
                 enum dse_health health)
{
    const struct dse_measurement sample = {&y, NULL};
    assert_int_equal(dse_linear_mhe_advance(mhe, &u), DSE_OK);
    assert_int_equal(dse_linear_mhe_measure(mhe, 0, &u, &sample), DSE_OK);
    assert_int_equal(dse_linear_mhe_solve(mhe), DSE_OK);
    assert_int_equal(dse_linear_mhe_path(mhe), path);
    assert_int_equal(dse_linear_mhe_health(mhe), health);
}

static void bounds_that_contradict_each_other_are_left_out_and_health_says_so(void **state)
{
    (void)state;
    struct dse_linear_mhe_config config = integrator();
    const dse_real zero[1] = {0};
    config.x_min = zero;
    config.horizon = 3;
    config.arrival = DSE_ARRIVAL_NONE;
    struct dse_linear_mhe mhe, free;
    assert_int_equal(start_bounded(&mhe, &config), DSE_OK);
    feed(&mhe, 0, 0, DSE_PATH_SWAPS, DSE_HEALTH_TRACKING);
    feed(&mhe, 0, 0, DSE_PATH_SWAPS, DSE_HEALTH_TRACKING);
    feed(&mhe, 2, DSE_REAL(1.5), DSE_PATH_FREE, DSE_HEALTH_REJECTING);
    assert_true(mhe.counts.infeasible == 1 && mhe.counts.fallbacks == 1);
    assert_true(dse_linear_mhe_parts(&mhe).primal > DSE_REAL(0.01));
    struct dse_linear_mhe_config unbounded = config;
    unbounded.x_min = unbounded.x_max = unbounded.w_min = unbounded.w_max = NULL;
    assert_int_equal(start(&free, &unbounded), DSE_OK);
    feed(&free, 0, 0, DSE_PATH_SWAPS, DSE_HEALTH_TRACKING);
    feed(&free, 0, 0, DSE_PATH_SWAPS, DSE_HEALTH_TRACKING);
    feed(&free, 2, DSE_REAL(1.5), DSE_PATH_SWAPS, DSE_HEALTH_TRACKING);
    assert_memory_equal(dse_linear_mhe_window(&mhe), dse_linear_mhe_window(&free),
                        3 * sizeof(dse_real));
    for (int k = 0; k < 2; k++) /* until the step has left the window */
        feed(&mhe, 0, 1, k == 0 ? DSE_PATH_FREE : DSE_PATH_SWAPS,
             k == 0 ? DSE_HEALTH_REJECTING : DSE_HEALTH_TRACKING);
}

/* Room for one active bound where two are needed: the search ends without a solution although the
 * last one, moved on, keeps the bounds. */
static void the_last_feasible_solution_is_held_when_the_search_fails(void **state)
{
    (void)state;
    struct dse_linear_mhe_config config = integrator();
    config.max_active = 1;
    struct dse_linear_mhe mhe;
    assert_int_equal(start_bounded(&mhe, &config), DSE_OK);
    feed(&mhe, 0, 0, DSE_PATH_SWAPS, DSE_HEALTH_TRACKING);
    const dse_real x = dse_linear_mhe_state(&mhe)[0];
    feed(&mhe, 0, DSE_REAL(0.35), DSE_PATH_SWAPS, DSE_HEALTH_TRACKING); /* w <= 0.1 */
    const dse_real next = dse_linear_mhe_state(&mhe)[0];
    assert_true(next > x);
    feed(&mhe, DSE_REAL(-0.5), 50, DSE_PATH_HELD, DSE_HEALTH_COASTING);
    assert_near(dse_linear_mhe_state(&mhe)[0], next - DSE_REAL(0.5), 10 * EPS);
    assert_true(mhe.counts.fallbacks == 1 && mhe.counts.infeasible == 0);
}

static void active_bounds_can_be_asked_for(void **state)
{
    (void)state;
    const struct dse_linear_mhe_config config = integrator();
    struct dse_linear_mhe mhe;
    assert_int_equal(start_bounded(&mhe, &config), DSE_OK);
    /* x_0 and x_1 are violated, and w_0: one too many for one equation */
    feed(&mhe, 0, 5, DSE_PATH_DUAL, DSE_HEALTH_TRACKING);
    assert_int_equal(dse_linear_mhe_active(&mhe, 0, 1), 1); /* w_0 = 0.1 */
    assert_int_equal(dse_linear_mhe_active(&mhe, 1, 0), 1); /* x_1 = 1 */
    assert_int_equal(dse_linear_mhe_active(&mhe, 0, 0), 0);
    assert_near(dse_linear_mhe_window(&mhe)[0], DSE_REAL(0.9), 10 * EPS);
    assert_true(dse_linear_mhe_state(&mhe)[0] == 1);
}

static void impossible_bounds_are_refused(void **state)
{
    (void)state;
    const dse_real nan[1] = {(dse_real)__builtin_nan("")}, infinite[1] = {DSE_REAL_MAX};
    struct dse_linear_mhe mhe;
    struct dse_linear_mhe_config config = integrator();
    config.w_max = minus_tenth;
    config.w_min = tenth;
    assert_int_equal(start_bounded(&mhe, &config), DSE_EINVAL);
    config = integrator();
    config.x_max = nan;
    assert_int_equal(start_bounded(&mhe, &config), DSE_ENONFINITE);
    config = integrator();
    config.x_min = infinite;
    assert_int_equal(start_bounded(&mhe, &config), DSE_EINVAL);
    config = integrator();
    config.max_active = 5;
    assert_int_equal(start_bounded(&mhe, &config), DSE_EINVAL);
}

static void bounded_storage_constant_is_what_init_takes(void **state)
{
    (void)state;
    random_state = 25;
    for (int nx = 1; nx <= NX_MAX; nx += 3) {
        struct system s;
        struct limits limits;
        struct dse_linear_mhe mhe;
        struct dse_arena arena;
        random_system(&s, nx, 2, nx, nx, 1);
        struct dse_linear_mhe_config config = config_of(&s, 5, DSE_ARRIVAL_KALMAN);
        limit(&s, &limits, &config);
        config.max_active = 3;
        const int size = DSE_LINEAR_MHE_BOUNDED_STORAGE(nx, 2, 5, 3);
        dse_arena_init(&arena, bounded_memory, size);
        assert_int_equal(dse_linear_mhe_init(&mhe, &config, &arena), DSE_OK);
        assert_int_equal(arena.used, size);
        dse_arena_init(&arena, bounded_memory, size - 1);
        assert_int_equal(dse_linear_mhe_init(&mhe, &config, &arena), DSE_ESTORAGE);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(bounded_windows_equal_the_window_qp),
        cmocka_unit_test(bounds_that_do_not_bind_change_no_bit),
        cmocka_unit_test(singular_noise_is_no_obstacle_to_bounds),
        cmocka_unit_test(late_values_count_with_bounds_as_if_they_had_come_in_time),
        cmocka_unit_test(bounds_that_contradict_each_other_are_left_out_and_health_says_so),
        cmocka_unit_test(the_last_feasible_solution_is_held_when_the_search_fails),
        cmocka_unit_test(active_bounds_can_be_asked_for),
        cmocka_unit_test(impossible_bounds_are_refused),
        cmocka_unit_test(bounded_storage_constant_is_what_init_takes),
    };
    return cmocka_run_group_tests_name("linear_mhe_bounds", tests, NULL, NULL);
}
