/* What the adaptive laws of unknown-input and functional observers promise, and what the published
 * ones do not keep: the network and its plant as one system. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "dse/math.h"
#include "dse/random.h"
#include "near.h"
#include "observer_designs.h"

static const dse_real uio_xd0[3] = {15, 30, 40}, fo_xd0[2] = {15, 30};

/* The graphs of the spec, nodes from 0. */
static const int uio6[6][2] = {{5, 0}, {1, 2}, {5, 2}, {0, 3}, {3, 4}, {0, 5}};
static const int uio6_ring[6][2] = {{0, 1}, {1, 2}, {2, 3}, {3, 4}, {4, 5}, {5, 0}};
static const int fo4[4][2] = {{0, 1}, {1, 2}, {2, 3}, {3, 0}};

static struct rig rig;

/* eps_i: xh_i - x = M_i eps_i, all nodes here have one observer state. */
static dse_real eps_of(int i)
{
    const struct dse_distributed_observer_config *c = &rig.config[i];
    dse_real x[RIG_STATES], u[RIG_OUTPUTS], xh[RIG_STATES], Me = 0, MM = 0;
    rig_truth(&rig, x, u);
    rig_estimate(&rig, i, xh);
    if (c->M == NULL)
        return xh[0] - x[2]; /* the functional is x3 */
    for (int k = 0; k < c->nx; k++) {
        Me += c->M[k] * (xh[k] - x[k]);
        MM += c->M[k] * c->M[k];
    }
    return Me / MM;
}

/* |e_i|^2 */
static dse_real square_of(int i)
{
    const dse_real eps = eps_of(i);
    dse_real MM = rig.config[i].M == NULL ? 1 : 0;
    for (int k = 0; rig.config[i].M != NULL && k < rig.config[i].nx; k++)
        MM += rig.config[i].M[k] * rig.config[i].M[k];
    return MM * eps * eps;
}

/* V_i = eps'Pi eps + tr(Gamma Gamma') / gamma */
static dse_real V_of(int i)
{
    const dse_real eps = eps_of(i), *Gamma = rig_node(&rig, i) + 1;
    dse_real sum = 0;
    for (int k = 0; k < rig.node[i].n_gain; k++)
        sum += Gamma[k] * Gamma[k];
    return rig.config[i].Pi[0] * eps * eps + sum / rig.config[i].gamma;
}

struct outcome {
    dse_real norm;              /* ||e||_2 over the run */
    dse_real final;             /* largest |eps| at the end */
    dse_real V_rise[RIG_NODES]; /* largest rise of V_i in a step, relative to V_i at the start */
    dse_real e_rise[RIG_NODES]; /* the same of eps'Pi eps */
};

static struct outcome run(const dse_real *xd0, dse_real h, int steps)
{
    struct outcome found = {0};
    dse_real V[RIG_NODES] = {0}, V0[RIG_NODES] = {0}, e[RIG_NODES] = {0}, e0[RIG_NODES] = {0};
    dse_real sum = 0;
    assert_int_equal(rig_start(&rig, xd0), DSE_OK);
    for (int i = 0; i < rig.n; i++) {
        V0[i] = V[i] = V_of(i);
        e0[i] = e[i] = eps_of(i) * eps_of(i);
    }
    for (int k = 0; k <= steps; k++) {
        for (int i = 0; i < rig.n; i++) {
            const dse_real weight = k == 0 || k == steps ? DSE_REAL(0.5) : 1;
            const dse_real V_now = V_of(i), e_now = eps_of(i) * eps_of(i);
            sum += weight * h * square_of(i);
            found.V_rise[i] = dse_max(found.V_rise[i], (V_now - V[i]) / V0[i]);
            found.e_rise[i] = dse_max(found.e_rise[i], (e_now - e[i]) / e0[i]);
            V[i] = V_now;
            e[i] = e_now;
        }
        if (k < steps)
            assert_int_equal(rig_step(&rig, h), DSE_OK);
        rig.t = rig.t0 = (dse_real)(k + 1) * h;
    }
    for (int i = 0; i < rig.n; i++)
        found.final = dse_max(found.final, dse_abs(eps_of(i)));
    found.norm = dse_sqrt(sum);
    return found;
}

/* Rounding of V, relative to its start. */
#define ROUNDING TOLERANCE(1e-12, 1e-4)

/* R6: ||e||_2^2 = sum_i |M_i|^2 eps_i(0)^2 (1 - exp(-10 |Lambda_i|)) / (2 |Lambda_i|) */
static void uncoupled_uio_has_the_norm_of_the_closed_form(void **state)
{
    (void)state;
    design_uio(&rig, DESIGN_CONSISTENT, DSE_REAL(0.01), 0, NULL);
    assert_int_equal(rig_start(&rig, uio_xd0), DSE_OK);
    static const dse_real published[6] = {-10, -40, -140, -30, -80, -15};
    dse_real closed = 0;
    for (int i = 0; i < 6; i++) {
        const dse_real rate = -rig.config[i].Lambda[0];
        assert_near(eps_of(i), published[i], TOLERANCE(1e-12, 1e-4));
        closed += square_of(i) * (1 - dse_exp(-10 * rate)) / (2 * rate);
    }
    assert_near(dse_sqrt(closed), DSE_REAL(97.587), TOLERANCE(1e-3, 1e-3));
    assert_near(run(uio_xd0, DSE_REAL(0.005), 1000).norm, dse_sqrt(closed), TOLERANCE(1e-3, 2e-2));
}

/* R12 without coupling: sqrt(8600 / 2 (1 - exp(-20))) */
static void uncoupled_functional_observer_has_the_norm_of_the_closed_form(void **state)
{
    (void)state;
    design_fo(&rig, DESIGN_CONSISTENT, DSE_REAL(0.1), 0, NULL);
    assert_near(run(fo_xd0, DSE_REAL(0.005), 2000).norm,
                dse_sqrt(4300 * (1 - dse_exp(DSE_REAL(-20.0)))), TOLERANCE(1e-3, 2e-2));
}

static void consistent_uio_law_never_lets_a_lyapunov_function_rise(void **state)
{
    (void)state;
    static const struct {
        const int (*edge)[2];
        double norm;
    } cases[] = {{uio6, 44.174}, {uio6_ring, 40.017}};
    for (int k = 0; k < 2; k++) {
        design_uio(&rig, DESIGN_CONSISTENT, DSE_REAL(0.01), 6, cases[k].edge);
        const struct outcome found = run(uio_xd0, DSE_REAL(0.002), 2500);
        for (int i = 0; i < 6; i++) {
            assert_true(found.V_rise[i] <= ROUNDING);
            assert_true(found.e_rise[i] <= ROUNDING);
        }
        assert_near(found.norm, DSE_REAL(cases[k].norm), TOLERANCE(1e-2, 3e-2));
    }
}

/* R7 and R9 */
static void printed_uio_law_helps_on_one_graph_but_its_lyapunov_function_rises(void **state)
{
    (void)state;
    design_uio(&rig, DESIGN_PRINTED, DSE_REAL(0.01), 6, uio6);
    const struct outcome found = run(uio_xd0, DSE_REAL(0.002), 2500);
    assert_near(found.norm, DSE_REAL(54.915), TOLERANCE(1e-2, 3e-2));
    assert_true(found.norm < DSE_REAL(0.5641) * DSE_REAL(97.587));

    /* node 6 on the ring: within 0.01 s by more than six times what it was at the start */
    design_uio(&rig, DESIGN_PRINTED, DSE_REAL(0.01), 6, uio6_ring);
    assert_int_equal(rig_start(&rig, uio_xd0), DSE_OK);
    const dse_real start = V_of(5);
    dse_real V = start, rise = 0;
    for (int k = 0; k < 200; k++) {
        assert_int_equal(rig_step(&rig, DSE_REAL(0.001)), DSE_OK);
        if (k % 10 == 5) {
            rise = dse_max(rise, V_of(5) - V);
            V = V_of(5);
        }
    }
    assert_true(rise > 6 * start);
}

static void consistent_functional_law_never_lets_a_lyapunov_function_rise(void **state)
{
    (void)state;
    design_fo(&rig, DESIGN_CONSISTENT, DSE_REAL(0.1), 4, fo4);
    const struct outcome found = run(fo_xd0, DSE_REAL(0.002), 5000);
    for (int i = 0; i < 4; i++)
        assert_true(found.V_rise[i] <= ROUNDING);
    assert_near(found.norm, DSE_REAL(14.2145), TOLERANCE(1e-3, 2e-2));
    assert_true(found.final < TOLERANCE(1e-8, 1e-4));
}

static void printed_functional_law_helps_but_its_lyapunov_function_rises(void **state)
{
    (void)state;
    design_fo(&rig, DESIGN_PRINTED, DSE_REAL(0.1), 4, fo4);
    const struct outcome found = run(fo_xd0, DSE_REAL(0.002), 5000);
    dse_real worst = 0;
    for (int i = 0; i < 4; i++)
        worst = dse_max(worst, found.V_rise[i]);
    assert_true(worst > DSE_REAL(0.01));
    assert_near(found.norm, DSE_REAL(31.7227), TOLERANCE(1e-3, 3e-2));
    assert_true(found.final < DSE_REAL(1.1e-3));
}

/* Any directed graph: eps'Pi eps of UIO9 falls at least as fast as without neighbours. */
static void consistent_uio_law_helps_every_node_on_every_graph(void **state)
{
    (void)state;
    struct dse_random random;
    dse_random_init(&random, 5, 0);
    design_uio(&rig, DESIGN_CONSISTENT, DSE_REAL(0.05), 0, NULL);
    assert_int_equal(rig_start(&rig, uio_xd0), DSE_OK);
    dse_real bound[6];
    for (int i = 0; i < 6; i++) /* |eps_i(1)| alone */
        bound[i] = dse_abs(eps_of(i)) * dse_exp(rig.config[i].Lambda[0]);
    for (int trial = 0; trial < 20; trial++) {
        int edge[30][2], edges = 0;
        for (int from = 0; from < 6; from++)
            for (int to = 0; to < 6; to++)
                if (from != to && dse_random_uniform(&random) < 0.4) {
                    edge[edges][0] = from;
                    edge[edges++][1] = to;
                }
        design_uio(&rig, DESIGN_CONSISTENT, DSE_REAL(0.05), edges, (const int(*)[2])edge);
        assert_int_equal(rig_start(&rig, uio_xd0), DSE_OK);
        for (int k = 0; k < 1000; k++)
            assert_int_equal(rig_step(&rig, DSE_REAL(0.001)), DSE_OK);
        for (int i = 0; i < 6; i++)
            assert_true(dse_abs(eps_of(i)) <= bound[i] * (1 + ROUNDING) + TOLERANCE(1e-9, 1e-3));
    }
}

/* Every node reaches every node. */
static bool strongly_connected(int edges, const int (*edge)[2])
{
    bool reach[6][6] = {{false}};
    for (int e = 0; e < edges; e++)
        reach[edge[e][0]][edge[e][1]] = true;
    for (int via = 0; via < 6; via++)
        for (int from = 0; from < 6; from++)
            for (int to = 0; to < 6; to++)
                reach[from][to] = reach[from][to] || (reach[from][via] && reach[via][to]);
    for (int from = 0; from < 6; from++)
        for (int to = 0; to < 6; to++)
            if (from != to && !reach[from][to])
                return false;
    return true;
}

/* 6 to 10 edges. */
static int draw_graph(struct dse_random *random, int (*edge)[2])
{
    int edges;
    do {
        bool taken[6][6] = {{false}};
        const int wanted = 6 + (int)(5 * dse_random_uniform(random));
        for (edges = 0; edges < wanted;) {
            const int from = (int)(6 * dse_random_uniform(random));
            const int to = (int)(6 * dse_random_uniform(random));
            if (from == to || taken[from][to])
                continue;
            taken[from][to] = true;
            edge[edges][0] = from;
            edge[edges++][1] = to;
        }
    } while (!strongly_connected(edges, (const int(*)[2])edge));
    return edges;
}

/* R8: on 400 strongly connected graphs 87 % improve, the norm between 77.9 and 105. */
static void printed_uio_law_helps_on_most_graphs_but_not_on_all(void **state)
{
    (void)state;
    enum { GRAPHS = 60 };
    struct dse_random random;
    int better = 0;
    dse_real best = DSE_REAL_MAX, worst = 0;
    dse_random_init(&random, 8, 0);
    for (int trial = 0; trial < GRAPHS; trial++) {
        int edge[10][2];
        const int edges = draw_graph(&random, edge);
        design_uio(&rig, DESIGN_PRINTED, DSE_REAL(0.01), edges, (const int(*)[2])edge);
        const dse_real norm = run(uio_xd0, DSE_REAL(0.01), 500).norm;
        better += norm < DSE_REAL(97.587);
        best = dse_min(best, norm);
        worst = dse_max(worst, norm);
    }
    assert_in_range(better, GRAPHS * 3 / 4, GRAPHS - 1);
    assert_true(best > 75 && best < 90);
    assert_true(worst > DSE_REAL(97.587) && worst < 110);
    print_message("    better on %d of %d, norm %.1f to %.1f\n", better, GRAPHS, (double)best,
                  (double)worst);
}

static void consistent_uio_gains_stay_symmetric_and_positive_semidefinite(void **state)
{
    (void)state;
    design_uio(&rig, DESIGN_CONSISTENT, DSE_REAL(0.01), 6, uio6_ring);
    run(uio_xd0, DSE_REAL(0.01), 500);
    for (int i = 0; i < 6; i++) {
        const dse_real *Gamma = rig_node(&rig, i) + 1;
        dse_real largest = 0;
        for (int k = 0; k < 9; k++)
            largest = dse_max(largest, dse_abs(Gamma[k]));
        for (int a = 0; a < 3; a++) {
            assert_true(Gamma[4 * a] >= 0);
            for (int b = 0; b < a; b++) {
                assert_true(Gamma[3 * a + b] == Gamma[3 * b + a]);
                assert_true(Gamma[3 * a + b] * Gamma[3 * a + b] <=
                            Gamma[4 * a] * Gamma[4 * b] +
                                100 * DSE_REAL_EPSILON * largest * largest);
            }
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(uncoupled_uio_has_the_norm_of_the_closed_form),
        cmocka_unit_test(uncoupled_functional_observer_has_the_norm_of_the_closed_form),
        cmocka_unit_test(consistent_uio_law_never_lets_a_lyapunov_function_rise),
        cmocka_unit_test(printed_uio_law_helps_on_one_graph_but_its_lyapunov_function_rises),
        cmocka_unit_test(consistent_functional_law_never_lets_a_lyapunov_function_rise),
        cmocka_unit_test(printed_functional_law_helps_but_its_lyapunov_function_rises),
        cmocka_unit_test(consistent_uio_law_helps_every_node_on_every_graph),
        cmocka_unit_test(printed_uio_law_helps_on_most_graphs_but_not_on_all),
        cmocka_unit_test(consistent_uio_gains_stay_symmetric_and_positive_semidefinite),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
