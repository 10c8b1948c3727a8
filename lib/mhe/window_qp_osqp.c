/* Window QP: OSQP, hosted or generated, as a second opinion. */
#include "dse/window_qp_osqp.h"

#include <osqp.h>
#include <stddef.h>

#include "dse/math.h"
#include "window_qp_osqp_internal.h"

_Static_assert(sizeof(OSQPFloat) <= sizeof(dse_real), "OSQP's numbers fit into the arena's");

#define TEN DSE_REAL(10.0)

/* A bound in OSQP's terms: +-OSQP_INFTY is none. */
static OSQPFloat bound(dse_real value, dse_real scale)
{
    const dse_real scaled = value / scale, none = (dse_real)OSQP_INFTY;
    return (OSQPFloat)(scaled >= none / TEN ? none : scaled <= -none / TEN ? -none : scaled);
}

static void write_bounds(const dse_real *lower, const dse_real *upper, const dse_real *scale,
                         int count, OSQPFloat *l, OSQPFloat *u)
{
    for (int i = 0; i < count; i++) {
        l[i] = bound(lower ? lower[i] : -DSE_REAL_MAX, scale[i]);
        u[i] = bound(upper ? upper[i] : DSE_REAL_MAX, scale[i]);
    }
}

#if !defined(OSQP_EMBEDDED_MODE) || OSQP_EMBEDDED_MODE != 1
/* Upper triangle, column by column: P_{j-1,j} = P_{j,j-1}', then the diagonal block. */
void window_qp_osqp_write_P(const struct dse_window_qp_osqp *osqp,
                            const struct dse_window_qp_problem *problem, OSQPFloat *values)
{
    const int nz = osqp->nz;
    const dse_real *s = osqp->scale;
    for (int j = 0; j < osqp->stages; j++) {
        for (int i = 0; i < nz; i++) {
            for (int p = 0; p < nz && j > 0; p++)
                *values++ = (OSQPFloat)(s[(j - 1) * nz + p] * problem->below[j - 1][i * nz + p] *
                                        s[j * nz + i]);
            for (int p = 0; p <= i; p++)
                *values++ =
                    (OSQPFloat)(s[j * nz + p] * problem->diagonal[j][p * nz + i] * s[j * nz + i]);
        }
    }
}

static bool update_P(const struct dse_window_qp_osqp *osqp,
                     const struct dse_window_qp_problem *problem, OSQPFloat *values)
{
    const int nz = osqp->nz, H = osqp->stages;
    window_qp_osqp_write_P(osqp, problem, values);
    return osqp_update_data_mat(osqp->solver, values, NULL,
                                H * nz * (nz + 1) / 2 + (H - 1) * nz * nz, NULL, NULL, 0) == 0;
}
#else
static bool update_P(const struct dse_window_qp_osqp *osqp,
                     const struct dse_window_qp_problem *problem, const OSQPFloat *values)
{
    (void)osqp;
    (void)problem;
    (void)values;
    return true;
}
#endif

/* Multipliers of scaled constraints -> by constraint: y = ys / scale. */
static enum dse_status read_multipliers(const struct dse_window_qp_osqp *osqp, const OSQPFloat *ys,
                                        dse_real *y)
{
    const int nz = osqp->nz, nr = osqp->nr, stride = nz + nr, H = osqp->stages;
    for (int j = 0; j < H; j++) {
        for (int i = 0; i < nz; i++)
            y[j * stride + i] = (dse_real)ys[j * nz + i] / osqp->scale[j * nz + i];
        for (int r = 0; r < nr && j + 1 < H; r++)
            y[j * stride + nz + r] =
                (dse_real)ys[H * nz + j * nr + r] / osqp->row_scale[j * nr + r];
    }
    return dse_all_finite(y, H * stride - nr) ? DSE_OK : DSE_ENONFINITE;
}

enum dse_status dse_window_qp_osqp_solve(void *context, const struct dse_window_qp_problem *problem,
                                         dse_real *y)
{
    const struct dse_window_qp_osqp *osqp = context;
    const struct dse_window_bounds *bounds = &problem->bounds;
    const int H = osqp->stages, n = H * osqp->nz, rows = (H - 1) * osqp->nr;
    OSQPSolver *solver = osqp->solver;
    if (problem->stages != H)
        return DSE_EDIM;
    OSQPFloat *q = osqp->numbers, *l = q + n, *u = l + n + rows;
    for (int i = 0; i < n; i++)
        q[i] = (OSQPFloat)(-problem->c[i] * osqp->scale[i]);
    write_bounds(bounds->lower, bounds->upper, osqp->scale, n, l, u);
    write_bounds(bounds->row_lower, bounds->row_upper, osqp->row_scale, rows, l + n, u + n);
    if (!update_P(osqp, problem, u + n + rows))
        return DSE_ENOCONV;
    if (osqp_update_data_vec(solver, q, l, u) != 0)
        return DSE_ENOCONV;
    osqp_cold_start(solver); /* the answer depends on the question alone */
    if (osqp_solve(solver) != 0)
        return DSE_ENOCONV;
    const OSQPInt status = solver->info->status_val;
    if (status != OSQP_SOLVED && status != OSQP_SOLVED_INACCURATE &&
        status != OSQP_MAX_ITER_REACHED)
        return DSE_ENOCONV;
    return read_multipliers(osqp, solver->solution->y, y);
}
