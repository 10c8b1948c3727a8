/* Window QP: the block-tridiagonal factor, from the newest stage backwards,
 *
 *     L_j L_j' = P_jj - W_j' W_j,   W_j = L_{j+1}^-1 P_{j+1,j},
 *
 * kept by the distance from the newest stage: what lies between two samples of a window that grows
 * or slides stays where it is. */
#include <stddef.h>

#include "active_set_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"
#include "window_qp_internal.h"

static dse_real *factor_L(const struct dse_window_qp *qp, int j)
{
    return qp->L + (qp->factored - 1 - j) * qp->nz * qp->nz;
}

static dse_real *factor_W(const struct dse_window_qp *qp, int j)
{
    return qp->W + (qp->factored - 1 - j) * qp->nz * qp->nz;
}

static enum dse_status factor_stage(struct dse_window_qp *qp,
                                    const struct dse_window_qp_problem *problem, int j)
{
    const int nz = qp->nz, size = nz * nz;
    dse_real *L = factor_L(qp, j), *W = factor_W(qp, j);
    const dse_real *diagonal = problem->diagonal[j];
    if (!dse_all_finite(diagonal, size))
        return DSE_ENONFINITE;
    for (int i = 0; i < size; i++)
        L[i] = 0;
    if (j + 1 < problem->stages) {
        if (!dse_all_finite(problem->below[j], size))
            return DSE_ENONFINITE;
        for (int i = 0; i < size; i++)
            W[i] = problem->below[j][i];
        dse_lower_solve(nz, factor_L(qp, j + 1), nz, W);
        dse_mat_mul_tn(nz, nz, nz, W, W, L);
    }
    for (int i = 0; i < size; i++)
        L[i] = diagonal[i] - L[i];
    return dse_cholesky(nz, L, L);
}

/* 1 / sqrt(P_ii), the largest of the window: a standard deviation, given all else. */
static void find_units(struct dse_window_qp *qp, const struct dse_window_qp_problem *problem)
{
    const int nz = qp->nz;
    for (int i = 0; i < nz; i++) {
        dse_real smallest = problem->diagonal[0][i * nz + i];
        for (int j = 1; j < problem->stages; j++)
            smallest = dse_min(smallest, problem->diagonal[j][i * nz + i]);
        qp->set.unit[i] = 1 / dse_sqrt(smallest);
    }
}

enum dse_status dse_window_qp_factor(struct dse_window_qp *qp,
                                     const struct dse_window_qp_problem *problem,
                                     int newest_changed)
{
    if (problem->stages < 1 || problem->stages > qp->capacity)
        return DSE_EINVAL;
    if (newest_changed < 0 || newest_changed >= problem->stages)
        return DSE_EINVAL;
    if (problem->stages - 1 - newest_changed > qp->factored)
        return DSE_EINVAL;
    qp->factored = problem->stages;
    active_set_forget_columns(&qp->set);
    for (int j = newest_changed; j >= 0; j--) {
        const enum dse_status status = factor_stage(qp, problem, j);
        if (status != DSE_OK) {
            qp->factored = 0;
            return status;
        }
    }
    find_units(qp, problem);
    return DSE_OK;
}

/* Backwards in time  V_j = L_j^-1 (B_j - W_j' V_{j+1}),  forwards  X_j = L_j'^-1 (V_j - W_{j-1}
 * X_{j-1}). */
enum dse_status window_qp_apply(void *context, int count, int newest, dse_real *X)
{
    const struct dse_window_qp *qp = context;
    const int nz = qp->nz, block = nz * count, H = qp->factored;
    for (int j = newest; j >= 0; j--) {
        if (j < newest) {
            dse_mat_mul_tn(nz, nz, count, factor_W(qp, j), X + (j + 1) * block, qp->product);
            dse_axpy(block, -1, qp->product, X + j * block);
        }
        dse_lower_solve(nz, factor_L(qp, j), count, X + j * block);
    }
    for (int j = 0; j < H; j++) {
        if (j > 0) {
            dse_mat_mul(nz, nz, count, factor_W(qp, j - 1), X + (j - 1) * block, qp->product);
            dse_axpy(block, -1, qp->product, X + j * block);
        }
        dse_lower_transpose_solve(nz, factor_L(qp, j), count, X + j * block);
    }
    return DSE_OK;
}
