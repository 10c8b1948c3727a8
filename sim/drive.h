/* What drives the plant's inputs: constants unless a signal or a control loop is given.
 *
 *     u(t) = signal(t)                        directly; a sinusoid also between the samples
 *     u_k  = loop(set point = signal(t_k), y_k)      held over the sample
 *
 * Where the plant has an input that is the time derivative of another one (`rates` of its normal
 * form), it follows by itself: the derivative of a sinusoid, 0 else. */
#ifndef DSE_SIM_DRIVE_H
#define DSE_SIM_DRIVE_H

#include <stdbool.h>
#include <stdint.h>

#include "dse/plant.h"
#include "sim/loop.h"
#include "sim/signal.h"

/* One driven input. */
struct sim_drive {
    int input;
    struct sim_signal signal;    /* of the input itself, or set point of the loop */
    const struct sim_loop *loop; /* NULL: none. Times in the plant's unit; copied */
};

struct sim_driver;

/* NULL and a reason appended when the drives do not fit the plant. u: constant values of all
 * inputs; a loop starts from there. Steps are copied. */
struct sim_driver *sim_driver_create(const struct dse_plant *plant,
                                     const struct dse_normal_form *form, const double *u,
                                     const struct sim_drive *drives, int n_drives, double period,
                                     uint64_t seed, char *reason, int reason_size);
void sim_driver_destroy(struct sim_driver *driver);

/* At sample k: what is prescribed into u (nu), before the outputs are measured; then what the
 * loops make of them. Samples ascend. */
void sim_driver_prescribe(struct sim_driver *driver, int64_t k, double *u);
void sim_driver_control(struct sim_driver *driver, int64_t k, const double *y, const bool *valid,
                        double *u);

/* Whether u moves between the samples; then: u(t). */
bool sim_driver_moves(const struct sim_driver *driver);
void sim_driver_move(const struct sim_driver *driver, double t, double *u);

#endif
