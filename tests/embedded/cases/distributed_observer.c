/* Six unknown-input observers with the consistent law and their plant: after half a second they are
 * where the golden run consistent_edge is, here as on the host with the same bits. */
#include "dse/math.h"
#include "observer_designs.h"
#include "report.h"

#ifdef DSE_REAL_IS_float
#define TOLERANCE DSE_REAL(1e-4)
#else
#define TOLERANCE DSE_REAL(1e-6)
#endif

static const int uio6[6][2] = {{5, 0}, {1, 2}, {5, 2}, {0, 3}, {3, 4}, {0, 5}};
static const dse_real xd0[3] = {15, 30, 40};
/* z of each node at t = 0.5, tests/golden/distributed_observer/uio_runs.json */
static const dse_real expected[6] = {DSE_REAL(30.07225878618169), DSE_REAL(-30.69501920258251),
                                     DSE_REAL(42.34669567054249), DSE_REAL(29.68815036945528),
                                     DSE_REAL(49.48441859007219), DSE_REAL(-17.453197110918296)};

static struct rig rig;

int main(void)
{
    design_uio(&rig, DESIGN_CONSISTENT, DSE_REAL(0.01), 6, uio6);
    enum dse_status status = rig_start(&rig, xd0);
    for (int k = 0; k < 100 && !status; k++) {
        status = rig_step(&rig, DSE_REAL(0.005));
        rig.t = rig.t0 = (dse_real)(k + 1) * DSE_REAL(0.005);
    }
    report_int("status", status);
    report_check("every step succeeds", status == DSE_OK);
    for (int i = 0; i < 6; i++) {
        const dse_real *node = rig_node(&rig, i);
        dse_real xh[RIG_STATES];
        rig_estimate(&rig, i, xh);
        report_int("node", i);
        report_vector("z", 1, node);
        report_vector("xh", 4, xh);
        report_digest("Gamma", rig.node[i].n_gain, node + 1);
        report_check("z", dse_abs(node[0] - expected[i]) <= TOLERANCE * dse_abs(expected[i]));
    }
    return report_verdict();
}
