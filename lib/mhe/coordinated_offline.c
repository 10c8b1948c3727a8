/* Coordinated moving horizon estimation: what is computed from the plant before anything runs. */
#include "coordinated_internal.h"
#include "dse/linalg.h"

void dse_mhe_open_loop(int n, const dse_real *A, const dse_real *x0, int steps, int from, int nx,
                       dse_real *start, dse_real *scratch)
{
    dse_real *x = scratch, *next = scratch + n;
    for (int i = 0; i < n; i++)
        x[i] = x0[i];
    for (int k = 0; k < steps; k++) {
        for (int i = 0; i < nx; i++)
            start[k * nx + i] = x[from + i];
        dse_mat_vec(n, n, A, x, next);
        for (int i = 0; i < n; i++)
            x[i] = next[i];
    }
}

enum dse_status dse_mhe_interaction_cost(int n, const dse_real *A, int parts,
                                         const struct dse_mhe_subsystem *subsystems, dse_real *cost,
                                         dse_real *scratch)
{
    dse_real *rows = scratch, *L = scratch + n * n; /* rows: D^-1/2 A_off */
    for (int e = 0; e < n * n; e++)
        rows[e] = A[e];
    for (int i = 0, first = 0; i < parts; first += subsystems[i].nx, i++) {
        const int nx = subsystems[i].nx;
        for (int e = 0; e < nx * nx; e++)
            rows[(first + e / nx) * n + first + e % nx] = 0;
        if (!subsystems[i].D)
            return DSE_EINVAL;
        const enum dse_status status = dse_cholesky(nx, subsystems[i].D, L);
        if (status != DSE_OK)
            return status;
        dse_lower_solve(nx, L, n, rows + first * n);
    }
    dse_mat_mul_tn(n, n, n, rows, rows, cost);
    dse_sym_enforce(n, cost);
    return DSE_OK;
}
