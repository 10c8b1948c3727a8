/* A node of a distributed observer as an agent runs it: sampled measurements, held messages. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "dse/linalg.h"
#include "dse/math.h"
#include "near.h"
#include "observer_designs.h"
#include "observer_scalar.h"

static const int uio6[6][2] = {{5, 0}, {1, 2}, {5, 2}, {0, 3}, {3, 4}, {0, 5}};
static const bool step_is_held[2] = {false, true};

static struct rig plant, nodes; /* the plant alone; the configured nodes with their graph */

static struct dse_measurement all_of(const dse_real *y)
{
    return (struct dse_measurement){y, NULL};
}

/* ---- a whole network in agent mode ---- */

/* The plant and the nodes at their first sample. */
static void start_network(enum design_law law)
{
    static const dse_real xd0[3] = {15, 30, 40};
    design_uio(&nodes, law, DSE_REAL(0.01), 6, uio6);
    for (int i = 0; i < 6; i++)
        nodes.config[i].u_held = step_is_held;
    assert_int_equal(rig_start(&nodes, xd0), DSE_OK);
    plant = (struct rig){.plant = &rig_descriptor_uio};
    assert_int_equal(rig_start(&plant, xd0), DSE_OK);
}

/* Every node samples the plant; returns sum_i |e_i|^2. */
static dse_real sample_network(dse_real *y_last)
{
    dse_real x[4], u[2], y[2], sum = 0;
    rig_truth(&plant, x, u);
    for (int i = 0; i < 6; i++) {
        dse_mat_vec(2, 4, nodes.C[i], x, y);
        const struct dse_measurement sample = all_of(y);
        assert_int_equal(dse_distributed_observer_sample(&nodes.node[i], plant.t, u, &sample),
                         DSE_OK);
        for (int k = 0; k < 4; k++) {
            const dse_real e = dse_distributed_observer_estimate(&nodes.node[i])[k] - x[k];
            sum += e * e;
        }
    }
    if (y_last != NULL)
        dse_mat_vec(2, 4, nodes.C[0], x, y_last);
    return sum;
}

/* Node i hears all its neighbours: whole estimates, or the rows that it compares. */
static void exchange(int i, bool rows)
{
    const struct dse_distributed_observer_config *c = &nodes.config[i];
    for (int j = 0; j < c->neighbours; j++) {
        const dse_real *xh = dse_distributed_observer_estimate(&nodes.node[nodes.neighbour[i][j]]);
        dse_real part[4];
        if (!rows) {
            assert_int_equal(dse_distributed_observer_receive(&nodes.node[i], j, xh), DSE_OK);
            continue;
        }
        const struct dse_observer_rows *compared = &c->theirs[j];
        dse_mat_vec(compared->rows, 4, compared->C2, xh, part);
        assert_int_equal(dse_distributed_observer_receive_rows(&nodes.node[i], j, part), DSE_OK);
    }
}

static void advance_plant(dse_real h)
{
    for (int k = 0; k < 10; k++)
        assert_int_equal(rig_step(&plant, h / 10), DSE_OK);
}

/* ||e||_2 over 5 s. */
static dse_real norm_of_network(enum design_law law, dse_real h, bool rows)
{
    const int steps = (int)(5 / h + DSE_REAL(0.5));
    dse_real sum = 0;
    start_network(law);
    for (int k = 0; k <= steps; k++) {
        plant.t = plant.t0 = (dse_real)k * h;
        sum += (k == 0 || k == steps ? DSE_REAL(0.5) : 1) * h * sample_network(NULL);
        for (int i = 0; i < 6; i++)
            exchange(i, rows);
        if (k < steps)
            advance_plant(h);
    }
    return dse_sqrt(sum);
}

static void agents_with_held_messages_come_near_the_continuous_network(void **state)
{
    (void)state;
    static const struct {
        enum design_law law;
        double h, norm;
    } cases[] = {{DESIGN_PRINTED, 0.01, 54.90},
                 {DESIGN_PRINTED, 0.02, 54.90},
                 {DESIGN_CONSISTENT, 0.01, 44.13},
                 {DESIGN_CONSISTENT, 0.02, 44.11}};
    for (int k = 0; k < 4; k++)
        assert_near(norm_of_network(cases[k].law, DSE_REAL(cases[k].h), false),
                    DSE_REAL(cases[k].norm), TOLERANCE(0.015, 0.03));
}

static void whole_estimates_and_compared_rows_give_the_same_bits(void **state)
{
    (void)state;
    const dse_real whole = norm_of_network(DESIGN_CONSISTENT, DSE_REAL(0.05), false);
    const dse_real rows = norm_of_network(DESIGN_CONSISTENT, DSE_REAL(0.05), true);
    assert_true(whole == rows);
}

/* ---- one node ---- */

static void input_is_held_or_interpolated_as_told(void **state)
{
    (void)state;
    static const bool held[1] = {true};
    for (int k = 0; k < 2; k++) {
        const dse_real before = 2, after = 6, y = 0;
        const struct dse_measurement sample = all_of(&y);
        scalar_config(DSE_OBSERVER_OWN, 0);
        config.nu = 1;
        config.H = one;
        config.z0 = NULL;
        config.u_held = k == 0 ? held : NULL;
        assert_int_equal(start_node(), DSE_OK);
        assert_int_equal(dse_distributed_observer_sample(&node, 0, &before, &sample), DSE_OK);
        assert_int_equal(dse_distributed_observer_sample(&node, DSE_REAL(0.1), &after, &sample),
                         DSE_OK);
        /* z' = -z + u: 2 (1 - e) when held; with u = 2 + 40 t also 40 (h - 1 + e); e = exp(-h) */
        const dse_real e = dse_exp(DSE_REAL(-0.1));
        const dse_real expected = 2 * (1 - e) + (k == 0 ? 0 : 40 * (DSE_REAL(0.1) - 1 + e));
        assert_near(dse_distributed_observer_z(&node)[0], expected, TOLERANCE(5e-6, 1e-5));
    }
}

/* The rotating target with eigenvalues 0.5 and 0.4 of A - L C: error(k+1) = (A - L C) error(k). */
static void discrete_luenberger_observer_forgets_its_start(void **state)
{
    (void)state;
    const dse_real c = dse_cos(DSE_REAL(0.3)), s = dse_sin(DSE_REAL(0.3));
    const dse_real A[4] = {c, -s, s, c};
    /* C = [1 0]: A - L C has trace 2c - l1 and determinant 1 - l1 c - l2 s */
    const dse_real l1 = 2 * c - DSE_REAL(0.9), l2 = (1 - l1 * c - DSE_REAL(0.2)) / s;
    const dse_real L[2] = {l1, l2}, Lambda[4] = {c - l1, -s, s - l2, c}, identity[4] = {1, 0, 0, 1};
    dse_real x[2] = {1, -2};
    config = (struct dse_distributed_observer_config){
        .time = DSE_DISCRETE, .nz = 2, .ny = 1, .nx = 2, .Lambda = Lambda, .L = L, .M = identity};
    assert_int_equal(start_node(), DSE_OK);
    for (int k = 0; k < 40; k++) {
        assert_int_equal(sample_at((dse_real)k, x[0]), DSE_OK);
        if (k == 1) { /* xh(1) = L y(0) */
            assert_near(dse_distributed_observer_estimate(&node)[0], l1, TOLERANCE(1e-15, 1e-6));
            assert_near(dse_distributed_observer_estimate(&node)[1], l2, TOLERANCE(1e-15, 1e-6));
        }
        if (k < 39) {
            dse_real next[2];
            dse_mat_vec(2, 2, A, x, next);
            x[0] = next[0];
            x[1] = next[1];
        }
    }
    assert_all_near(2, dse_distributed_observer_estimate(&node), x, TOLERANCE(1e-9, 1e-5));
}

static void one_gain_per_node_is_one_per_edge_when_there_is_one_neighbour(void **state)
{
    (void)state;
    dse_real z[2];
    for (int k = 0; k < 2; k++) {
        scalar_config(DSE_OBSERVER_OWN, 1);
        config.gain = k == 0 ? DSE_OBSERVER_EDGE : DSE_OBSERVER_NODE;
        assert_int_equal(start_node(), DSE_OK);
        for (int s = 0; s < 20; s++) {
            assert_int_equal(sample_at(DSE_REAL(0.1) * (dse_real)s, 2), DSE_OK);
            assert_int_equal(hear(0, 5), DSE_OK);
        }
        z[k] = dse_distributed_observer_z(&node)[0];
    }
    assert_true(z[0] == z[1]);
}

static void saturation_bounds_the_gains_and_changes_nothing_below_it(void **state)
{
    (void)state;
    dse_real last[3];
    static const double bounds[3] = {0, 1e6, 0.25};
    for (int b = 0; b < 3; b++) {
        scalar_config(DSE_OBSERVER_NEIGHBOURS, 1);
        config.gain_max = DSE_REAL(bounds[b]);
        assert_int_equal(start_node(), DSE_OK);
        for (int k = 0; k < 50; k++) {
            assert_int_equal(sample_at(DSE_REAL(0.1) * (dse_real)k, 0), DSE_OK);
            assert_int_equal(hear(0, 3), DSE_OK);
            if (b == 2)
                assert_true(dse_abs(gain(0)) <= DSE_REAL(0.25) * (1 + 4 * DSE_REAL_EPSILON));
        }
        last[b] = gain(0);
    }
    assert_true(last[0] == last[1] && last[0] > 1);
    assert_near(last[2], DSE_REAL(0.25), 4 * DSE_REAL_EPSILON);
}

/* Without a difference only the leak acts: Gamma' = -leak Gamma. */
static void leak_lets_the_gains_fade(void **state)
{
    (void)state;
    scalar_config(DSE_OBSERVER_OWN, 1);
    config.leak = DSE_REAL(0.5);
    config.gamma = 0;
    assert_int_equal(start_node(), DSE_OK);
    node.state[1] = 3;
    for (int k = 0; k <= 20; k++) {
        assert_int_equal(sample_at(DSE_REAL(0.1) * (dse_real)k, 0), DSE_OK);
        assert_int_equal(hear(0, 0), DSE_OK);
    }
    assert_near(gain(0), 3 * dse_exp(DSE_REAL(-1.0)), TOLERANCE(1e-6, 1e-5));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(agents_with_held_messages_come_near_the_continuous_network),
        cmocka_unit_test(whole_estimates_and_compared_rows_give_the_same_bits),
        cmocka_unit_test(input_is_held_or_interpolated_as_told),
        cmocka_unit_test(discrete_luenberger_observer_forgets_its_start),
        cmocka_unit_test(one_gain_per_node_is_one_per_edge_when_there_is_one_neighbour),
        cmocka_unit_test(saturation_bounds_the_gains_and_changes_nothing_below_it),
        cmocka_unit_test(leak_lets_the_gains_fade),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
