/* The flow in time: psi' = K^-1 curl'(nu lap w - convection(w, w) + f) with K = curl'curl, the
 * five-point Laplacian, which the sines make diagonal. */
#include "sim/flow.h"

#include <stdlib.h>
#include <string.h>

#include "dse/linalg.h"
#include "dse/math.h"

#define PI 3.14159265358979323846

struct sim_flow {
    int n;
    bool forced;
    double *sine;    /* (n-1) x (n-1): sqrt(2/n) sin(pi j k / n), symmetric and orthogonal */
    double *lambda;  /* n-1: (2 - 2 cos(pi k / n)) / h^2 */
    double *sources; /* f, J, D */
    double *w, *force, *convection; /* faces */
    double *scalar;                 /* cells */
    double *field[2];               /* (n-1) x (n-1) */
    double *k, *stage, *sum;        /* states */
    double memory[];
};

static int doubles(int n)
{
    return 3 * SIM_FLOW_PSI(n) + (n - 1) + 4 * SIM_FLOW_FACES(n) + 3 * SIM_FLOW_SCALAR(n) +
           3 * SIM_FLOW_STATE(n);
}

static double *take(double **free, int count)
{
    double *taken = *free;
    *free += count;
    return taken;
}

static void divide_memory(struct sim_flow *flow, int n)
{
    double *at = flow->memory;
    flow->sine = take(&at, SIM_FLOW_PSI(n));
    flow->lambda = take(&at, n - 1);
    flow->sources = take(&at, SIM_FLOW_FACES(n) + 2 * SIM_FLOW_SCALAR(n));
    flow->w = take(&at, SIM_FLOW_FACES(n));
    flow->force = take(&at, SIM_FLOW_FACES(n));
    flow->convection = take(&at, SIM_FLOW_FACES(n));
    flow->scalar = take(&at, SIM_FLOW_SCALAR(n));
    flow->field[0] = take(&at, SIM_FLOW_PSI(n));
    flow->field[1] = take(&at, SIM_FLOW_PSI(n));
    flow->k = take(&at, SIM_FLOW_STATE(n));
    flow->stage = take(&at, SIM_FLOW_STATE(n));
    flow->sum = take(&at, SIM_FLOW_STATE(n));
}

struct sim_flow *sim_flow_create(int n, bool forced)
{
    struct sim_flow *flow =
        n < 2 ? NULL : calloc(1, sizeof *flow + (size_t)doubles(n) * sizeof *flow->memory);
    if (flow == NULL)
        return NULL;
    flow->n = n;
    flow->forced = forced;
    divide_memory(flow, n);
    for (int j = 1; j < n; j++) {
        flow->lambda[j - 1] = (2 - 2 * dse_cos(PI * j / n)) * n * n;
        for (int k = 1; k < n; k++)
            flow->sine[(j - 1) * (n - 1) + k - 1] =
                dse_sqrt(2.0 / n) * dse_sin(PI * (j * k % (2 * n)) / n);
    }
    if (forced)
        sim_flow_force(n, flow->sources);
    return flow;
}

void sim_flow_destroy(struct sim_flow *flow)
{
    free(flow);
}

const double *sim_flow_sources(const struct sim_flow *flow)
{
    return flow->sources;
}

/* psi = K^-1 rhs = S ((S rhs S) / (lambda_i + lambda_j)) S; rhs is field[0]. */
static void solve(struct sim_flow *flow, double *psi)
{
    const int m = flow->n - 1;
    double *a = flow->field[0], *b = flow->field[1];
    dse_mat_mul(m, m, m, flow->sine, a, b);
    dse_mat_mul(m, m, m, b, flow->sine, a);
    for (int i = 0; i < m; i++)
        for (int j = 0; j < m; j++)
            a[i * m + j] /= flow->lambda[i] + flow->lambda[j];
    dse_mat_mul(m, m, m, flow->sine, a, b);
    dse_mat_mul(m, m, m, b, flow->sine, psi);
}

static void scalar_rhs(struct sim_flow *flow, double diffusion, const double *source,
                       const double *s, double *ds)
{
    const int n = flow->n;
    sim_flow_scalar_laplacian(n, s, ds);
    sim_flow_scalar_convection(n, flow->w, s, flow->scalar);
    for (int i = 0; i < SIM_FLOW_SCALAR(n); i++)
        ds[i] = diffusion * ds[i] - flow->scalar[i] + source[i];
}

void sim_flow_rhs(struct sim_flow *flow, const double *z, double *dz)
{
    const int n = flow->n, faces = SIM_FLOW_FACES(n), psi = SIM_FLOW_PSI(n);
    const double *J = flow->sources + faces, *D = J + SIM_FLOW_SCALAR(n);
    sim_flow_velocity(n, z, flow->w);
    sim_flow_laplacian(n, flow->w, flow->force);
    sim_flow_convection(n, flow->w, flow->w, flow->convection);
    for (int i = 0; i < faces; i++)
        flow->force[i] = SIM_FLOW_NU * flow->force[i] - flow->convection[i] + flow->sources[i];
    sim_flow_vorticity(n, flow->force, flow->field[0]);
    solve(flow, dz);
    scalar_rhs(flow, SIM_FLOW_KAPPA, J, z + psi, dz + psi);
    scalar_rhs(flow, SIM_FLOW_ZETA, D, z + psi + SIM_FLOW_SCALAR(n), dz + psi + SIM_FLOW_SCALAR(n));
}

/* z += dt (k1 + 2 k2 + 2 k3 + k4) / 6 */
void sim_flow_step(struct sim_flow *flow, double dt, double *z)
{
    static const double node[4] = {0, 0.5, 0.5, 1}, weight[4] = {1, 2, 2, 1};
    const int size = SIM_FLOW_STATE(flow->n);
    for (int s = 0; s < 4; s++) {
        for (int i = 0; i < size; i++)
            flow->stage[i] = s == 0 ? z[i] : z[i] + node[s] * dt * flow->k[i];
        sim_flow_rhs(flow, flow->stage, flow->k);
        for (int i = 0; i < size; i++)
            flow->sum[i] = (s == 0 ? 0 : flow->sum[i]) + weight[s] * flow->k[i];
    }
    for (int i = 0; i < size; i++)
        z[i] += dt / 6 * flow->sum[i];
}
