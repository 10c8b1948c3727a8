/* Window QP: how far any point and multipliers are from optimal, from the data of the problem
 * alone. */
#include <stddef.h>

#include "active_set_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"
#include "window_qp_internal.h"

dse_real window_qp_worst(const struct dse_window_qp_certificate *certificate)
{
    return dse_max(certificate->primal, dse_max(certificate->dual, certificate->gap));
}

/* residual = P z. */
static void multiply(struct dse_window_qp *qp, const struct dse_window_qp_problem *problem,
                     const dse_real *z)
{
    const int nz = qp->nz, H = problem->stages;
    dse_real *g = qp->residual, *work = qp->product;
    for (int j = 0; j < H; j++) /* symmetric blocks */
        dse_mat_tvec(nz, nz, problem->diagonal[j], z + j * nz, g + j * nz);
    for (int j = 0; j + 1 < H; j++) {
        dse_mat_vec(nz, nz, problem->below[j], z + j * nz, work);
        dse_axpy(nz, 1, work, g + (j + 1) * nz);
        dse_mat_tvec(nz, nz, problem->below[j], z + (j + 1) * nz, work);
        dse_axpy(nz, 1, work, g + j * nz);
    }
}

/* largest_i = max_j |v_ji|. */
static void find_largest(int H, int nz, const dse_real *v, dse_real *largest)
{
    for (int i = 0; i < nz; i++)
        largest[i] = 0;
    for (int j = 0; j < H; j++) {
        for (int i = 0; i < nz; i++) {
            const dse_real a = dse_abs(v[j * nz + i]);
            largest[i] = a > largest[i] ? a : largest[i];
        }
    }
}

/* dual_size_i = max_j (sum_p |P_ip| largest_p), of each different block once. */
static void find_dual_size(struct dse_window_qp *qp, const struct dse_window_qp_problem *problem,
                           const dse_real *z)
{
    const int nz = qp->nz, H = problem->stages;
    dse_real *largest = qp->largest, *size = qp->dual_size;
    find_largest(H, nz, z, largest);
    for (int i = 0; i < nz; i++)
        size[i] = 0;
    for (int j = 0; j < H; j++) {
        if (j > 0 && problem->diagonal[j] == problem->diagonal[j - 1])
            continue;
        for (int i = 0; i < nz; i++) {
            dse_real sum = 0;
            for (int p = 0; p < nz; p++)
                sum += dse_abs(problem->diagonal[j][i * nz + p]) * largest[p];
            size[i] = dse_max(size[i], sum);
        }
    }
}

/* P z - c + N'y in residual; the sums of terms of the gap. */
struct value {
    dse_real gap, size;
};

static struct value add_multipliers(struct dse_window_qp *qp,
                                    const struct dse_window_qp_problem *problem, const dse_real *z,
                                    const dse_real *y)
{
    const int all = qp->nz * problem->stages;
    struct value v = {0, 0};
    dse_real *g = qp->residual;
    for (int i = 0; i < all; i++) { /* z'Pz - c'z */
        v.gap += z[i] * (g[i] - problem->c[i]);
        v.size += dse_abs(z[i] * g[i]) + dse_abs(z[i] * problem->c[i]);
        g[i] -= problem->c[i];
    }
    for (int k = 0; k < active_set_constraints(&qp->set); k++) {
        if (y[k] == 0)
            continue;
        const dse_real value = y[k] * active_set_bound(&qp->set, k, y[k] > 0 ? 1 : -1);
        v.gap += value;
        v.size += dse_abs(value);
        active_set_add_normal(&qp->set, k, y[k], g);
    }
    return v;
}

static dse_real largest_violation(struct dse_window_qp *qp, const dse_real *z)
{
    const struct dse_active_set *set = &qp->set;
    dse_real worst = 0;
    active_set_measure(&qp->set, z);
    for (int k = 0; k < active_set_constraints(set); k++) {
        const dse_real lower = active_set_bound(set, k, -1), upper = active_set_bound(set, k, 1);
        if (!active_set_is_bounded(lower) && !active_set_is_bounded(upper))
            continue;
        const dse_real value = active_set_value(set, k, z);
        const dse_real excess = dse_max(value - upper, lower - value);
        worst = dse_max(worst, excess / active_set_size(set, k));
    }
    return worst;
}

static dse_real ratio(dse_real residual, dse_real size)
{
    return residual == 0 ? 0 : residual / size;
}

struct dse_window_qp_certificate dse_window_qp_certify(struct dse_window_qp *qp,
                                                       const struct dse_window_qp_problem *problem,
                                                       const dse_real *z, const dse_real *y)
{
    const int nz = qp->nz, H = problem->stages;
    const struct dse_window_bounds *bounds = qp->set.bounds;
    const int stages = qp->set.stages;
    qp->set.bounds = &problem->bounds;
    qp->set.stages = H;
    struct dse_window_qp_certificate certificate = {0, 0, 0};
    multiply(qp, problem, z);
    find_dual_size(qp, problem, z);
    const struct value value = add_multipliers(qp, problem, z, y);
    certificate.primal = largest_violation(qp, z);
    find_largest(H, nz, problem->c, qp->largest);
    dse_axpy(nz, 1, qp->largest, qp->dual_size);
    for (int i = 0; i < H * nz; i++)
        certificate.dual =
            dse_max(certificate.dual, ratio(dse_abs(qp->residual[i]), qp->dual_size[i % nz]));
    certificate.gap = ratio(dse_abs(value.gap), value.size);
    qp->set.bounds = bounds;
    qp->set.stages = stages;
    return certificate;
}
