/* Memory of the estimators on this processor and the stack that one step of each takes. Linked with
 * every object of the library, so that checks/stack.py finds all of them, and all that they need of
 * the compiler's runtime, in one image. */
#include "cstr2_network.h"
#include "dse/ekf.h"
#include "report.h"
#include "stack_meter.h"

/* The example's own functions. */
enum dse_status estimator_start(void);
const struct dse_ekf *estimator_sample(dse_real t, dse_real pump, dse_real level);

static struct cstr2_network network;
static enum dse_status result;

/* One predict and update of the continuous EKF with 2 states (checks/stack.py knows the names). */
static void step_ekf(void)
{
    dse_real t = dse_ekf_time(estimator_sample(0, 0, DSE_REAL(0.5)));
    const struct dse_ekf *ekf = estimator_sample(t + 1, 0, DSE_REAL(0.5));
    result = dse_ekf_health(ekf) == DSE_HEALTH_DIVERGED ? DSE_EMODEL : DSE_OK;
}

/* One tick of two high-gain filters with 2 of 4 states each, and of their plant. */
static void step_high_gain_ekf(void)
{
    result = cstr2_network_tick(&network);
}

static void storage(const char *name, int reals)
{
    report_int(name, reals * (int)sizeof(dse_real));
}

static void report_storage(void)
{
    storage("bytes of arena, discrete EKF (nx 4, ny 2)", DSE_EKF_STORAGE(4, 2));
    storage("bytes of arena, discrete EKF (nx 8, ny 4)", DSE_EKF_STORAGE(8, 4));
    storage("bytes of arena, continuous EKF (nx 4, ny 2)", DSE_EKF_STORAGE_CONTINUOUS(4, 2));
    storage("bytes of arena, continuous EKF (nx 8, ny 4)", DSE_EKF_STORAGE_CONTINUOUS(8, 4));
    storage("bytes of arena, high-gain EKF (2 of 4 states, horizon 72)", cstr2_network_storage());
    report_int("bytes of struct dse_ekf", (int)sizeof(struct dse_ekf));
    report_int("bytes of struct dse_high_gain_ekf", (int)sizeof(struct dse_high_gain_ekf));
}

int main(void)
{
    report_storage();
    report_check("the example starts", estimator_start() == DSE_OK);
    report_int("stack ekf", stack_used_by(step_ekf));
    report_check("a step of the EKF succeeds", result == DSE_OK);
    report_check("the network starts", cstr2_network_start(&network) == DSE_OK);
    report_int("stack high_gain_ekf", stack_used_by(step_high_gain_ekf));
    report_check("a tick of the high-gain EKF succeeds", result == DSE_OK);
    return report_verdict();
}
