/* PID control of an input, cascaded or not. */
#include "sim/loop.h"

#include "dse/math.h"

static double limited(double value, double low, double high)
{
    return value < low ? low : value > high ? high : value;
}

double sim_pid_step(const struct sim_pid *pid, struct sim_pid_state *state, double period,
                    double start, double low, double high, double set_point, double measured)
{
    if (!state->started) {
        state->started = true;
        state->integral = start;
        state->last = measured;
    }
    double error = set_point - measured;
    /* kp e + I - kp td (y_k - y_(k-1))/T */
    double fast = pid->kp * error - pid->kp * pid->td * (measured - state->last) / period;
    double step = pid->ti > 0 ? pid->kp * error * period / pid->ti : 0;
    double wanted = fast + state->integral + step;
    bool stuck = (wanted > high && step > 0) || (wanted < low && step < 0);
    if (!stuck)
        state->integral += step;
    state->last = measured;
    return limited(fast + state->integral, low, high);
}

void sim_loop_init(struct sim_loop_state *state, double flow)
{
    *state = (struct sim_loop_state){.actual = flow};
}

double sim_loop_step(const struct sim_loop *loop, struct sim_loop_state *state, double period,
                     double set_point, double y, bool valid)
{
    if (valid) {
        state->y = y;
        state->measured = true;
    }
    if (!state->measured)
        return state->actual;
    double start = state->actual;
    double wanted = sim_pid_step(&loop->outer, &state->outer, period, start, loop->low, loop->high,
                                 set_point, state->y);
    if (!loop->cascaded) {
        state->actual = wanted;
        return wanted;
    }
    double command = sim_pid_step(&loop->inner, &state->inner, period, start, loop->low, loop->high,
                                  wanted, start);
    /* the lag over one period with the command held: q+ = q + (1 - exp(-T/lag)) (c - q) */
    double share = loop->lag > 0 ? 1 - dse_exp(-period / loop->lag) : 1;
    state->actual += share * (command - state->actual);
    return state->actual;
}
