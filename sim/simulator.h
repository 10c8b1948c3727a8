/* The true plant: integrates a dse_plant's model from sample to sample, drives its inputs, adds
 * process and measurement noise. Knows nothing of estimators, messages or files.
 *
 *     x' = f(t, x, u) + w_k              for t_k <= t < t_(k+1),   t_k = k T_s
 *     x_(k+1) = f(t_k, x_k, u_k) + w_k   when the model is discrete: T_s is its step
 *     y_k = h(t_k, x_k, u) + v_k
 *
 * States that an algebraic equation ties to the others (plant->complete) are computed at every
 * sample, whatever x0 says about them.
 *
 * w_k and v_k are drawn once per sample; same seed, same bits. Inputs: sim/drive.h. */
#ifndef DSE_SIM_SIMULATOR_H
#define DSE_SIM_SIMULATOR_H

#include <stdbool.h>
#include <stdint.h>

#include "dse/plant.h"
#include "sim/drive.h"
#include "sim/noise.h"

enum sim_integrator {
    SIM_CVODE, /* variable order and step (BDF), error-controlled: the default truth */
    SIM_RK4,   /* one classical Runge-Kutta step per sample, as the reference runs have it */
    SIM_FLOW   /* the fields behind a reduced flow model (sim/flow_modes.h): states are projections,
                * outputs are read from the fields; x0 is that of the run, no process noise */
};

/* A sensor that is out: no value of output `output` at samples first .. end - 1. */
struct sim_outage {
    int output;
    int64_t first, end;
};

struct sim_config {
    const struct dse_plant *plant;  /* must outlive the simulator, as prepared must */
    const dse_real *prepared;       /* what plant->prepare made of the parameters */
    const double *x0;               /* nx */
    const double *u;                /* nu constant inputs, or NULL when nu = 0 */
    const struct sim_drive *drives; /* inputs that are not constant */
    int n_drives;
    double period;                  /* T_s in the plant's time unit, > 0 */
    enum sim_integrator integrator; /* of no meaning for a discrete model, like rtol and atol */
    int flow_run;                 /* SIM_FLOW: the fields' initial state, a number of sim/flow.h */
    double rtol;                  /* CVODE, >= 0; 0: 1e-10 */
    double atol;                  /* CVODE, >= 0; 0: 1e-12; multiplied by each state's scale */
    struct sim_noise process;     /* nx channels, added to the derivative: units per time. Discrete
                                   * model: to the next state, units */
    struct sim_noise measurement; /* ny channels, added to the output */
    double missing; /* probability that an output's value is missing, per output and sample */
    const struct sim_outage *outages; /* values that do not come either; NULL: none */
    int n_outages;
    uint64_t seed;
};

struct simulator;

/* NULL and a one-line reason when the plant cannot be set up. Apart from plant and prepared, the
 * simulator keeps nothing of the config. */
struct simulator *sim_create(const struct sim_config *config, char *reason, int reason_size);
/* sim may be NULL. */
void sim_destroy(struct simulator *sim);

/* Sample k (0 at first) and its time k T_s. */
int64_t sim_sample(const struct simulator *sim);
double sim_time(const struct simulator *sim);
const double *sim_state(const struct simulator *sim); /* nx, at t_k */
/* nu, from t_k on: held to the next sample unless a sinusoid goes on. y_k is measured with what is
 * prescribed for t_k, but before the loops have acted on it. */
const double *sim_input(const struct simulator *sim);
const double *sim_output(const struct simulator *sim); /* ny, with the measurement noise */
/* ny: false where the value is missing at this sample. */
const bool *sim_output_valid(const struct simulator *sim);

/* Goes on to the next sample. False and a one-line reason (time, sample, the state at fault) when
 * the integration fails; sample, state and output then stay what they were. */
bool sim_step(struct simulator *sim, char *reason, int reason_size);

#endif
