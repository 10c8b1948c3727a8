/* An incompressible flow in the unit square that carries a contaminant and heat: the benchmark of
 * section 5.3 of the consensus-based second-order observers' source, (3.1), (3.17), (3.30):
 *
 *     v' = nu lap v - (v.grad) v - grad p + f,   div v = 0,   v = 0 on the walls
 *     c' = kappa lap c - v.grad c + J,           c = 0 on the walls
 *     T' = zeta lap T - v.grad T + D,            T = 0 on the walls
 *
 * on n x n cells of width h = 1/n, first index x:
 *
 *     psi  (n-1) x (n-1)   stream function at the corners inside, 0 on the walls
 *     w    (n+1) x n, then n x (n+1)   u on the faces across x, v on the faces across y
 *     c, T n x n           at the cells' centres
 *
 * u = D_y psi / h, v = -D_x psi / h has no divergence to rounding, and the pressure has vanished.
 */
#ifndef DSE_SIM_FLOW_H
#define DSE_SIM_FLOW_H

#include <stdbool.h>

#define SIM_FLOW_CELLS 32     /* n of the benchmark */
#define SIM_FLOW_NU    0.0025 /* 1/Re, Re = 400 */
#define SIM_FLOW_KAPPA 0.0025
#define SIM_FLOW_ZETA  (0.0025 / 0.71)
#define SIM_FLOW_DT    0.025 /* of the Runge-Kutta steps */

/* Numbers in a stream function, a velocity, a scalar field and a state (psi, c, T). */
#define SIM_FLOW_PSI(n)    (((n)-1) * ((n)-1))
#define SIM_FLOW_FACES(n)  (2 * (n) * ((n) + 1))
#define SIM_FLOW_SCALAR(n) ((n) * (n))
#define SIM_FLOW_STATE(n)  (SIM_FLOW_PSI(n) + 2 * SIM_FLOW_SCALAR(n))

/* ---- operators; no output overlaps an input ---- */

/* w = curl psi. */
void sim_flow_velocity(int n, const double *psi, double *w);
/* psi = curl' w, the adjoint. */
void sim_flow_vorticity(int n, const double *w, double *psi);
/* out = div(by w) on the faces inside, 0 on the walls: (by.grad) w in divergence form with
 * arithmetic means, so that <convection(by, w), w> = 0. */
void sim_flow_convection(int n, const double *by, const double *w, double *out);
/* out = div(by s). */
void sim_flow_scalar_convection(int n, const double *by, const double *s, double *out);
/* Five points; beyond a wall a tangential velocity or a scalar is minus its image. */
void sim_flow_laplacian(int n, const double *w, double *out);
void sim_flow_scalar_laplacian(int n, const double *s, double *out);

/* ---- simulation ---- */

struct sim_flow;

/* free (f = J = D = 0) or forced. NULL: n < 2 or no memory. */
struct sim_flow *sim_flow_create(int n, bool forced);
void sim_flow_destroy(struct sim_flow *flow); /* may be NULL */
/* The sources f (w), J, D, one after the other. */
const double *sim_flow_sources(const struct sim_flow *flow);
/* dz (SIM_FLOW_STATE(n)) = z'; another field than z. */
void sim_flow_rhs(struct sim_flow *flow, const double *z, double *dz);
/* One classical Runge-Kutta step, in place. */
void sim_flow_step(struct sim_flow *flow, double dt, double *z);

/* ---- the benchmark's runs ---- */

#define SIM_FLOW_RUNS      4 /* 0: the test run; 1 to 3: those of the snapshots */
#define SIM_FLOW_SNAPSHOTS 41
#define SIM_FLOW_PERIOD    0.25 /* between snapshots */

/* The initial fields of a run. */
void sim_flow_start(int n, int run, double *z);
/* The sources of the forced case: f (w), J, D. */
void sim_flow_force(int n, double *sources);

#endif
