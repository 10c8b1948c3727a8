/* example_microcontroller.c at work: the tank is simulated, its level sensor is noisy and fails for
 * a while, and the filter finds the outlet coefficient that nobody measures. */
#include <math.h>

#include "dse/ekf.h"
#include "dse/math.h"
#include "dse/random.h"
#include "report.h"

/* The example's own functions. */
enum dse_status estimator_start(void);
const struct dse_ekf *estimator_sample(dse_real t, dse_real pump, dse_real level);

enum { SAMPLES = 600, FAILS_FROM = 300, FAILS_TO = 320 };
static const dse_real period = DSE_REAL(0.5), coefficient = DSE_REAL(0.002);

int main(void)
{
    struct dse_random random;
    dse_random_init(&random, 65, 0);
    report_check("the example starts", estimator_start() == DSE_OK);
    dse_real level = DSE_REAL(0.4), worst = 0;
    for (int k = 1; k <= SAMPLES; k++) {
        const dse_real pump = k % 100 < 50 ? DSE_REAL(0.0020) : DSE_REAL(0.0008);
        level += period * (pump - coefficient * dse_sqrt(level)) / DSE_REAL(0.1);
        const bool fails = k >= FAILS_FROM && k < FAILS_TO;
        const dse_real y = level + DSE_REAL(0.01) * (dse_real)dse_random_normal(&random);
        const struct dse_ekf *ekf =
            estimator_sample(period * (dse_real)k, pump, fails ? (dse_real)NAN : y);
        report_check("a failed sensor is told",
                     fails == (dse_ekf_health(ekf) == DSE_HEALTH_COASTING));
        if (k > SAMPLES / 2)
            worst = dse_max(worst, dse_abs(dse_ekf_state(ekf)[1] / coefficient - 1));
        if (k % 50 == 0)
            report_vector("level and coefficient", 2, dse_ekf_state(ekf));
    }
    report_real("worst relative error of the coefficient", worst);
    report_check("the coefficient is found to 10 percent", worst < DSE_REAL(0.1));
    return report_verdict();
}
