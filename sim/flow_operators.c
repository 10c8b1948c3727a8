/* Differences and fluxes on the staggered grid. */
#include <stddef.h>

#include "sim/flow.h"

/* Where things are: corner (i, j), 0 to n, zero on the walls; faces across x and y; cells. */
static double corner(int n, const double *psi, int i, int j)
{
    return i == 0 || j == 0 || i == n || j == n ? 0 : psi[(i - 1) * (n - 1) + j - 1];
}

static int face_y(int n, int i, int j)
{
    return n * (n + 1) + i * (n + 1) + j;
}

/* u = (psi_(i,j+1) - psi_(i,j)) / h, v = -(psi_(i+1,j) - psi_(i,j)) / h */
void sim_flow_velocity(int n, const double *psi, double *w)
{
    for (int i = 0; i <= n; i++)
        for (int j = 0; j < n; j++)
            w[i * n + j] = (corner(n, psi, i, j + 1) - corner(n, psi, i, j)) * n;
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= n; j++)
            w[face_y(n, i, j)] = -(corner(n, psi, i + 1, j) - corner(n, psi, i, j)) * n;
}

/* psi_(i,j) = (u_(i,j-1) - u_(i,j) + v_(i,j) - v_(i-1,j)) / h */
void sim_flow_vorticity(int n, const double *w, double *psi)
{
    for (int i = 1; i < n; i++)
        for (int j = 1; j < n; j++)
            psi[(i - 1) * (n - 1) + j - 1] =
                (w[i * n + j - 1] - w[i * n + j] + w[face_y(n, i, j)] - w[face_y(n, i - 1, j)]) * n;
}

/* The flux of a through the corner (i, j) across y, carried by b: both are zero on a wall in the
 * mean, and so is the flux. */
static double flux_x_by_y(int n, const double *by, const double *w, int i, int j)
{
    if (j == 0 || j == n)
        return 0;
    return 0.25 * (by[face_y(n, i - 1, j)] + by[face_y(n, i, j)]) *
           (w[i * n + j - 1] + w[i * n + j]);
}

static double flux_y_by_x(int n, const double *by, const double *w, int i, int j)
{
    if (i == 0 || i == n)
        return 0;
    return 0.25 * (by[i * n + j - 1] + by[i * n + j]) *
           (w[face_y(n, i - 1, j)] + w[face_y(n, i, j)]);
}

/* The flux of u through the centre of cell (i, j) across x; that of v across y. */
static double flux_x_by_x(int n, const double *by, const double *w, int i, int j)
{
    return 0.25 * (by[i * n + j] + by[(i + 1) * n + j]) * (w[i * n + j] + w[(i + 1) * n + j]);
}

static double flux_y_by_y(int n, const double *by, const double *w, int i, int j)
{
    const int f = face_y(n, i, j);
    return 0.25 * (by[f] + by[f + 1]) * (w[f] + w[f + 1]);
}

void sim_flow_convection(int n, const double *by, const double *w, double *out)
{
    for (int i = 0; i <= n; i++)
        for (int j = 0; j < n; j++) {
            const bool wall = i == 0 || i == n;
            out[i * n + j] = wall
                                 ? 0
                                 : (flux_x_by_x(n, by, w, i, j) - flux_x_by_x(n, by, w, i - 1, j) +
                                    flux_x_by_y(n, by, w, i, j + 1) - flux_x_by_y(n, by, w, i, j)) *
                                       n;
        }
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= n; j++) {
            const bool wall = j == 0 || j == n;
            out[face_y(n, i, j)] =
                wall ? 0
                     : (flux_y_by_y(n, by, w, i, j) - flux_y_by_y(n, by, w, i, j - 1) +
                        flux_y_by_x(n, by, w, i + 1, j) - flux_y_by_x(n, by, w, i, j)) *
                           n;
        }
}

/* by s in the mean of two cells, zero on a wall */
static double flux_across_x(int n, const double *by, const double *s, int i, int j)
{
    return i == 0 || i == n ? 0 : by[i * n + j] * 0.5 * (s[(i - 1) * n + j] + s[i * n + j]);
}

static double flux_across_y(int n, const double *by, const double *s, int i, int j)
{
    return j == 0 || j == n ? 0 : by[face_y(n, i, j)] * 0.5 * (s[i * n + j - 1] + s[i * n + j]);
}

void sim_flow_scalar_convection(int n, const double *by, const double *s, double *out)
{
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            out[i * n + j] = (flux_across_x(n, by, s, i + 1, j) - flux_across_x(n, by, s, i, j) +
                              flux_across_y(n, by, s, i, j + 1) - flux_across_y(n, by, s, i, j)) *
                             n;
}

/* a + b - 2 m of the neighbours along a row; an image has the sign turned. */
static double second(const double *at, int step, bool first, bool last)
{
    const double before = first ? -at[0] : at[-step], after = last ? -at[0] : at[step];
    return before + after - 2 * at[0];
}

void sim_flow_laplacian(int n, const double *w, double *out)
{
    const double scale = (double)n * n;
    for (int i = 0; i <= n; i++)
        for (int j = 0; j < n; j++) {
            const double *at = w + i * n + j;
            out[i * n + j] =
                i == 0 || i == n
                    ? 0
                    : (second(at, n, false, false) + second(at, 1, j == 0, j == n - 1)) * scale;
        }
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= n; j++) {
            const double *at = w + face_y(n, i, j);
            out[face_y(n, i, j)] =
                j == 0 || j == n
                    ? 0
                    : (second(at, n + 1, i == 0, i == n - 1) + second(at, 1, false, false)) * scale;
        }
}

void sim_flow_scalar_laplacian(int n, const double *s, double *out)
{
    const double scale = (double)n * n;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            const double *at = s + i * n + j;
            out[i * n + j] =
                (second(at, n, i == 0, i == n - 1) + second(at, 1, j == 0, j == n - 1)) * scale;
        }
}
