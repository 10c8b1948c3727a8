/* PID control of an input of the plant, by one controller or by two in cascade as on the rig of the
 * three tanks (section 6.1, Fig 6.2 of the adaptive high-gain source):
 *
 *     set point - y -> [outer PID] -> flow set point - flow -> [inner PID] -> [pump] -> flow
 *
 * y is a measured output of the plant, the flow is the plant's input. The pump is a lag of first
 * order that follows the command within its limits. Everything acts at the samples and is held over
 * them. Set-points step, so the derivative acts on the measurement. */
#ifndef DSE_SIM_LOOP_H
#define DSE_SIM_LOOP_H

#include <stdbool.h>

/* out = kp (e + I) - kp td y', I' = e/ti, held within [low, high]. The integral stands still while
 * the output is at a limit and the error pushes it further (anti-windup). Times in one unit. */
struct sim_pid {
    double kp; /* output unit per unit of y */
    double ti; /* integral time, > 0; 0: no integral action */
    double td; /* derivative time, >= 0 */
};

struct sim_loop {
    int output;           /* the plant's output that the outer controller sees */
    struct sim_pid outer; /* y in, flow set point out */
    bool cascaded;        /* false: the outer controller's output is the flow itself */
    struct sim_pid inner; /* flow in, command to the pump out */
    double low, high;     /* limits of the flow set point and of the command, input units */
    double lag;           /* time constant of the pump, >= 0, in the unit of ti */
};

struct sim_pid_state {
    double integral; /* in units of the output */
    double last;     /* measurement of the sample before */
    bool started;
};

struct sim_loop_state {
    struct sim_pid_state outer, inner;
    double y;      /* latest measurement */
    double actual; /* the flow: what the plant gets */
    bool measured;
};

/* The controller's output. `start` is what it shall begin with at no error. */
double sim_pid_step(const struct sim_pid *pid, struct sim_pid_state *state, double period,
                    double start, double low, double high, double set_point, double measured);

/* Begins without a bump from the flow that is given. */
void sim_loop_init(struct sim_loop_state *state, double flow);

/* One sample: set point and measurement of t_k to the flow from t_k on. A missing measurement
 * leaves the latest one in force; before the first, the flow stays. */
double sim_loop_step(const struct sim_loop *loop, struct sim_loop_state *state, double period,
                     double set_point, double y, bool valid);

#endif
