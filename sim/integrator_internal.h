/* Between the simulator and its integrators: the right-hand side with held noise, and CVODE. */
#ifndef DSE_SIM_INTEGRATOR_INTERNAL_H
#define DSE_SIM_INTEGRATOR_INTERNAL_H

#include <stdbool.h>

#include "dse/plant.h"
#include "sim/drive.h"

/* x' or x_(k+1) = f(t, x, u) + w, and the first thing that went wrong in it. */
struct sim_field {
    struct dse_model model;
    const struct dse_plant *plant;
    const double *u;                 /* nu, held over a sample unless the driver moves them */
    const struct sim_driver *driver; /* NULL: none */
    double moved[DSE_PLANT_MAX_INPUTS];
    const double *w; /* nx, held over a sample */

    enum dse_status fault; /* of the latest failed evaluation */
    double fault_time;
    int fault_state; /* whose derivative (next value) was not finite; -1: none in particular */
};

/* A dse_ode_rhs: dx = f(t, x, u) + w. DSE_ENONFINITE when a derivative is not finite, else what the
 * model answers; the fault is kept in the field. */
enum dse_status sim_field_rhs(void *field, double t, const double *x, double *dx);

/* u(t), nu; valid until the next call. */
const double *sim_field_inputs(struct sim_field *field, double t);

/* Appends what the latest fault was; nothing when there was none. */
void sim_field_explain(const struct sim_field *field, char *text, int size);

/* Appends to the text (a string already), cut at size. Returns false, so that a failing function
 * can end with `return sim_reason(...)`. */
bool sim_reason(char *text, int size, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

struct sim_cvode;

/* NULL when there is no memory or a setting is refused. field must outlive the integrator. */
struct sim_cvode *sim_cvode_create(struct sim_field *field, const double *x0, double rtol,
                                   double atol);
void sim_cvode_destroy(struct sim_cvode *cvode);

/* x(t) -> x(t1) in place. jumps: the right-hand side is another one before t and after t1, so that
 * the history of the solution is worth nothing and no step may go beyond t1. Otherwise the solution
 * goes on smoothly from the call before. False and a reason appended; x is then unchanged. */
bool sim_cvode_integrate(struct sim_cvode *cvode, bool jumps, double t, double t1, double *x,
                         char *reason, int reason_size);

#endif
