/* The true plant: integrates a dse_plant's model from sample to sample, adds process and
 * measurement noise. Knows nothing of estimators, messages or files. */
#ifndef DSE_SIM_SIMULATOR_H
#define DSE_SIM_SIMULATOR_H

#include <stdbool.h>
#include <stdint.h>

#include "dse/plant.h"

enum sim_integrator { SIM_CVODE, SIM_RK4 };
enum sim_distribution { SIM_NONE, SIM_UNIFORM, SIM_GAUSSIAN };

struct sim_noise {
    enum sim_distribution distribution;
    const double *scale; /* per channel: bound (uniform) or standard deviation (Gaussian) */
};

struct sim_config {
    const struct dse_plant *plant;
    const dse_real *prepared;   /* what plant->prepare made of the parameters */
    const double *x0;           /* nx */
    const double *u;            /* nu constant inputs, or NULL when nu = 0 */
    double period;              /* T_s in the plant's time unit, > 0 */
    enum sim_integrator integrator;
    double rtol, atol;          /* CVODE tolerances; atol is multiplied by each state's scale */
    struct sim_noise process;   /* added to the derivative, drawn per sample and held: units per time */
    struct sim_noise measurement; /* added to the output at each sample */
    uint64_t seed;
};

struct simulator;

/* NULL and a one-line reason when the plant cannot be set up. All strings are the caller's. */
struct simulator *sim_create(const struct sim_config *config, char *reason, int reason_size);
void sim_destroy(struct simulator *sim);

/* Sample k (0 at first) and its time k T_s. */
int64_t sim_sample(const struct simulator *sim);
double sim_time(const struct simulator *sim);
const double *sim_state(const struct simulator *sim); /* nx */
const double *sim_input(const struct simulator *sim); /* nu */
/* y (ny) = h(x) + v of this sample; asking twice gives the same values. */
const double *sim_output(struct simulator *sim);
/* Goes on to the next sample. False and a reason when the integration fails. */
bool sim_step(struct simulator *sim, char *reason, int reason_size);

#endif
