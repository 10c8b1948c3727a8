/* Window QP: search, certificate, second opinion. */
#include <stddef.h>

#include "active_set_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"
#include "window_qp_internal.h"

#define PASSES 20
/* Solutions with certificates above this are corrected by their residual, at most this often. */
#define REFINE_ABOVE    (16 * DSE_REAL_EPSILON)
#define REFINEMENTS_MAX 3
/* Multipliers of a backend below this, relative to the largest, say nothing. */
#define BACKEND_ROUNDING DSE_REAL(1e-5)

static dse_real tolerance_of(const struct dse_window_qp *qp)
{
    if (qp->config->tolerance > 0)
        return qp->config->tolerance;
    return sizeof(dse_real) == sizeof(double) ? DSE_REAL(1e-10) : DSE_REAL(1e-4);
}

static int limit(int configured, int otherwise)
{
    return configured == 0 ? otherwise : configured < 0 ? 0 : configured;
}

/* Active bounds hold exactly, multipliers whose sign is wrong by rounding are none. */
static void tidy(struct dse_window_qp *qp)
{
    const struct dse_active_set *set = &qp->set;
    const int stride = qp->nz + qp->nr;
    for (int k = 0; k < set->stages * stride; k++)
        qp->y_next[k] = 0;
    for (int m = 0; m < set->count; m++) {
        const int k = set->member[m], j = k / stride, i = k % stride;
        if (i < qp->nz)
            qp->z_next[j * qp->nz + i] = active_set_bound(set, k, set->side[k]);
        if ((dse_real)set->side[k] * set->y[m] > 0 || active_set_is_equality(set, k))
            qp->y_next[k] = set->y[m];
    }
}

/* z_next and y_next corrected by their residual once; the better of the two stays. */
static bool refine(struct dse_window_qp *qp, const struct dse_window_qp_problem *problem,
                   struct dse_window_qp_certificate *certificate)
{
    struct dse_active_set *set = &qp->set;
    const int all = qp->nz * problem->stages;
    for (int i = 0; i < all; i++)
        qp->work[i] = -qp->residual[i];
    if (window_qp_apply(qp, 1, problem->stages - 1, qp->work) != DSE_OK)
        return false;
    for (int m = 0; m < set->count; m++)
        set->kept[m] = set->y[m];
    for (int i = 0; i < all; i++)
        qp->free[i] = qp->z_next[i];
    active_set_correct(set, qp->z_next, qp->work);
    dse_axpy(all, 1, qp->work, qp->z_next);
    tidy(qp);
    const struct dse_window_qp_certificate better =
        dse_window_qp_certify(qp, problem, qp->z_next, qp->y_next);
    qp->counts.refinements++;
    if (window_qp_worst(&better) < window_qp_worst(certificate)) {
        *certificate = better;
        return true;
    }
    for (int m = 0; m < set->count; m++)
        set->y[m] = set->kept[m];
    for (int i = 0; i < all; i++)
        qp->z_next[i] = qp->free[i];
    tidy(qp);
    return false;
}

/* The search, and whether its result is what it says. */
static enum dse_status search(struct dse_window_qp *qp, const struct dse_window_qp_problem *problem,
                              int max_passes, int max_steps,
                              struct dse_window_qp_certificate *certificate)
{
    const int H = problem->stages, all = qp->nz * H;
    for (int i = 0; i < all; i++)
        qp->free[i] = problem->c[i];
    enum dse_status status = window_qp_apply(qp, 1, H - 1, qp->free);
    if (status == DSE_OK)
        status = active_set_search(&qp->set, qp->free, max_passes, max_steps, qp->z_next);
    if (status != DSE_OK)
        return status;
    tidy(qp);
    *certificate = dse_window_qp_certify(qp, problem, qp->z_next, qp->y_next);
    for (int r = 0; r < REFINEMENTS_MAX && window_qp_worst(certificate) > REFINE_ABOVE; r++)
        if (!refine(qp, problem, certificate))
            break;
    return window_qp_worst(certificate) <= tolerance_of(qp) ? DSE_OK : DSE_ENOCONV;
}

/* The set that the backend's multipliers speak for. */
static enum dse_status ask_backend(struct dse_window_qp *qp,
                                   const struct dse_window_qp_problem *problem)
{
    struct dse_active_set *set = &qp->set;
    const struct dse_window_qp_backend *backend = qp->config->backend;
    const int count = active_set_constraints(set);
    dse_real *y = qp->y_next, largest = 0;
    const enum dse_status status = backend->solve(backend->context, problem, y);
    if (status != DSE_OK)
        return status;
    if (!dse_all_finite(y, count))
        return DSE_ENONFINITE;
    for (int k = 0; k < count; k++)
        largest = dse_max(largest, dse_abs(y[k]) * active_set_size(set, k));
    active_set_clear(set);
    for (int k = 0; k < count; k++) {
        const int side = y[k] > 0 ? 1 : -1;
        const bool speaks = dse_abs(y[k]) * active_set_size(set, k) > BACKEND_ROUNDING * largest &&
                            active_set_is_bounded(active_set_bound(set, k, side));
        if (speaks || active_set_is_equality(set, k))
            (void)active_set_insert(set, set->count, k, side); /* as many as there is room for */
    }
    return DSE_OK;
}

static void commit(struct dse_window_qp *qp, const struct dse_window_qp_problem *problem,
                   const struct dse_window_qp_certificate *certificate)
{
    dse_real *z = qp->z, *y = qp->y;
    qp->z = qp->z_next;
    qp->z_next = z;
    qp->y = qp->y_next;
    qp->y_next = y;
    qp->stages = problem->stages;
    for (int k = 0; k < qp->capacity * (qp->nz + qp->nr); k++)
        qp->side[k] = qp->set.side[k];
    qp->certificate = *certificate;
    qp->counts.solved++;
    qp->counts.by_dual += qp->path == DSE_PATH_DUAL;
    qp->counts.by_backend += qp->path == DSE_PATH_BACKEND;
}

/* The set of the last solution again. */
static void restore(struct dse_window_qp *qp)
{
    const int stride = qp->nz + qp->nr;
    active_set_clear(&qp->set);
    for (int k = 0; k < qp->stages * stride; k++)
        if (qp->side[k] != 0)
            (void)active_set_insert(&qp->set, qp->set.count, k, qp->side[k]);
}

enum dse_status dse_window_qp_solve(struct dse_window_qp *qp,
                                    const struct dse_window_qp_problem *problem)
{
    if (qp->factored == 0 || problem->stages != qp->factored)
        return DSE_EINVAL;
    if (!dse_all_finite(problem->c, qp->nz * problem->stages))
        return DSE_ENONFINITE;
    qp->set.bounds = &problem->bounds;
    qp->set.stages = problem->stages;
    enum dse_status status = active_set_check_bounds(&qp->set);
    if (status != DSE_OK)
        return status;
    struct dse_window_qp_certificate certificate = {0, 0, 0};
    active_set_begin(&qp->set, problem->stages, &problem->bounds);
    const int steps = 5 * qp->set.max_active + 20;
    status = search(qp, problem, limit(qp->config->max_passes, PASSES),
                    limit(qp->config->max_steps, steps), &certificate);
    enum dse_active_set_path path = qp->set.steps > 0 ? DSE_PATH_DUAL : DSE_PATH_SWAPS;
    if (status != DSE_OK && status != DSE_EINFEASIBLE && qp->config->backend) {
        path = DSE_PATH_BACKEND;
        status = ask_backend(qp, problem);
        if (status == DSE_OK)
            status = search(qp, problem, PASSES, steps, &certificate);
    }
    if (status == DSE_OK) {
        qp->path = path;
        commit(qp, problem, &certificate);
        return DSE_OK;
    }
    restore(qp);
    qp->counts.infeasible += status == DSE_EINFEASIBLE;
    qp->counts.failed += status != DSE_EINFEASIBLE;
    return status == DSE_EINFEASIBLE || status == DSE_ENONFINITE ? status : DSE_ENOCONV;
}
