/* The benchmark's initial fields and sources. */
#include "dse/math.h"
#include "sim/flow.h"

#define PI 3.14159265358979323846

struct start {
    double psi[3];    /* A_11, A_21, A_12 */
    double centre[2]; /* of the contaminant */
    double slope[2];  /* of the temperature */
};

static const struct start starts[SIM_FLOW_RUNS] = {
    {{0.6, 0.15, 0.10}, {0.45, 0.45}, {0.2, 0.2}},
    {{0.6, 0.3, 0}, {0.35, 0.40}, {0.5, 0}},
    {{0.5, -0.2, 0.3}, {0.60, 0.35}, {0, 0.5}},
    {{0.7, 0, -0.3}, {0.45, 0.65}, {-0.4, 0.4}},
};

/* exp(-r^2 / (2 s^2)) */
static double bell(double x, double y, double x0, double y0, double s)
{
    const double dx = x - x0, dy = y - y0;
    return dse_exp(-(dx * dx + dy * dy) / (2 * s * s));
}

/* sum A_pq sin(pi x) sin(p pi x) sin(pi y) sin(q pi y) / pi */
static double stream(const double *A, double x, double y)
{
    const double sx = dse_sin(PI * x), sy = dse_sin(PI * y);
    return sx * sy / PI *
           (A[0] * sx * sy + A[1] * dse_sin(2 * PI * x) * sy + A[2] * sx * dse_sin(2 * PI * y));
}

void sim_flow_start(int n, int run, double *z)
{
    const struct start *start = &starts[run];
    double *c = z + SIM_FLOW_PSI(n), *T = c + SIM_FLOW_SCALAR(n);
    for (int i = 1; i < n; i++)
        for (int j = 1; j < n; j++)
            z[(i - 1) * (n - 1) + j - 1] = stream(start->psi, (double)i / n, (double)j / n);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            const double x = (i + 0.5) / n, y = (j + 0.5) / n;
            c[i * n + j] = 16 * x * (1 - x) * y * (1 - y) *
                           bell(x, y, start->centre[0], start->centre[1], 0.15);
            T[i * n + j] =
                dse_sin(PI * x) * dse_sin(PI * y) *
                (1 + start->slope[0] * dse_cos(PI * x) + start->slope[1] * dse_cos(PI * y));
        }
}

/* f = curl of 0.1 (sin(pi x) sin(pi y))^2 / pi */
void sim_flow_force(int n, double *sources)
{
    static const double A[3] = {0.1, 0, 0};
    double *u = sources, *v = u + n * (n + 1), *J = v + n * (n + 1), *D = J + SIM_FLOW_SCALAR(n);
    for (int i = 0; i <= n; i++)
        for (int j = 0; j <= n; j++) {
            const double x = (double)i / n, y = (double)j / n, here = stream(A, x, y);
            if (j < n)
                u[i * n + j] = (stream(A, x, (j + 1.0) / n) - here) * n;
            if (i < n)
                v[i * (n + 1) + j] = -(stream(A, (i + 1.0) / n, y) - here) * n;
        }
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            const double x = (i + 0.5) / n, y = (j + 0.5) / n;
            J[i * n + j] = 0.5 * bell(x, y, 0.3, 0.3, 0.08);
            D[i * n + j] = 0.3 * bell(x, y, 0.7, 0.5, 0.1);
        }
}
