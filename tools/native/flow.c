/* The flow benchmark of the simulator for the Python tools, through ctypes (tools/dse/flow.py).
 * Answers are 0, or -1 where there is no memory or no such run. */
#include "sim/flow.h"

int flow_start(int n, int run, double *z);
int flow_sources(int n, int forced, double *sources);
int flow_rhs(int n, int forced, const double *z, double *dz);
int flow_advance(int n, int forced, int steps, double dt, int samples, double *z);
void flow_velocity(int n, const double *psi, double *w);
void flow_operator(int n, const char *what, const double *by, const double *field, double *out);

int flow_start(int n, int run, double *z)
{
    if (n < 2 || run < 0 || run >= SIM_FLOW_RUNS)
        return -1;
    sim_flow_start(n, run, z);
    return 0;
}

int flow_sources(int n, int forced, double *sources)
{
    struct sim_flow *flow = sim_flow_create(n, forced != 0);
    if (flow == 0)
        return -1;
    const int size = SIM_FLOW_FACES(n) + 2 * SIM_FLOW_SCALAR(n);
    for (int i = 0; i < size; i++)
        sources[i] = sim_flow_sources(flow)[i];
    sim_flow_destroy(flow);
    return 0;
}

int flow_rhs(int n, int forced, const double *z, double *dz)
{
    struct sim_flow *flow = sim_flow_create(n, forced != 0);
    if (flow == 0)
        return -1;
    sim_flow_rhs(flow, z, dz);
    sim_flow_destroy(flow);
    return 0;
}

/* z (samples x state): the first row is given, every next one is `steps` steps later. */
int flow_advance(int n, int forced, int steps, double dt, int samples, double *z)
{
    struct sim_flow *flow = sim_flow_create(n, forced != 0);
    if (flow == 0)
        return -1;
    const int size = SIM_FLOW_STATE(n);
    for (int k = 1; k < samples; k++) {
        double *now = z + (long)k * size;
        for (int i = 0; i < size; i++)
            now[i] = now[i - size];
        for (int s = 0; s < steps; s++)
            sim_flow_step(flow, dt, now);
    }
    sim_flow_destroy(flow);
    return 0;
}

void flow_velocity(int n, const double *psi, double *w)
{
    sim_flow_velocity(n, psi, w);
}

/* what: c convection, l Laplacian of a velocity; C, L of a scalar. */
void flow_operator(int n, const char *what, const double *by, const double *field, double *out)
{
    switch (what[0]) {
    case 'c':
        sim_flow_convection(n, by, field, out);
        break;
    case 'l':
        sim_flow_laplacian(n, field, out);
        break;
    case 'C':
        sim_flow_scalar_convection(n, by, field, out);
        break;
    default:
        sim_flow_scalar_laplacian(n, field, out);
    }
}
