/* Second-order filter: mean and covariance between samples. */
#include "dse/linalg.h"
#include "dse/math.h"
#include "second_order_internal.h"

/* The moments as one differential equation in [w; L; W], S = L L' + W: L L' is what becomes of the
 * covariance at the start, W (only there when there is Q) is what the noise adds. */
struct moments {
    const struct dse_second_order *filter;
    const dse_real *u;
    bool trace, noise;
    dse_real *J; /* nx x nx */
    dse_real *X; /* nx x nx */
};

/* dw += sum_k e_k tr(F_k S): the elements of S that the forms ask for, or all where that is less.
 */
static void add_trace(const struct moments *moments, const dse_real *L, const dse_real *W,
                      dse_real *dw)
{
    const struct dse_quadratic *system = moments->filter->system;
    const int n = moments->filter->nx;
    if (system->terms > n * (n + 1) / 2) {
        dse_mat_mul_nt(n, n, n, L, L, moments->X);
        if (moments->noise)
            dse_axpy(n * n, 1, W, moments->X);
        dse_quadratic_add_trace(n, system, moments->X, dw);
        return;
    }
    for (int s = 0; s < system->terms; s++) {
        const struct dse_quadratic_term *term = &system->term[s];
        dse_real S_ij = moments->noise ? W[term->i * n + term->j] : 0;
        for (int r = 0; r < n; r++)
            S_ij += L[term->i * n + r] * L[term->j * n + r];
        dw[term->k] += term->value * S_ij;
    }
}

/* w' = f(w) + sum_k e_k tr(F_k S),  L' = J L,  W' = J W + W J' + Q            (3.48), (3.49) */
static enum dse_status moments_rhs(void *context, dse_real t, const dse_real *z, dse_real *dz)
{
    const struct moments *moments = context;
    const struct dse_second_order *filter = moments->filter;
    const struct dse_model *model = filter->config->model;
    const int n = filter->nx;
    const dse_real *L = z + n, *W = L + n * n;
    dse_real *dL = dz + n, *dW = dL + n * n;
    const enum dse_status status = model->f(model, t, z, moments->u, dz);
    if (status != DSE_OK)
        return status;
    if (moments->trace)
        add_trace(moments, L, W, dz);
    second_order_copy(n * n, filter->system->A, moments->J);
    dse_quadratic_add_jacobian(n, filter->system, z, moments->J);
    dse_mat_mul(n, n, n, moments->J, L, dL);
    if (!moments->noise)
        return DSE_OK;
    const dse_real *Q = filter->config->Q;
    dse_mat_mul(n, n, n, moments->J, W, moments->X);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            dW[i * n + j] = moments->X[i * n + j] + moments->X[j * n + i] +
                            DSE_REAL(0.5) * (Q[i * n + j] + Q[j * n + i]);
    return DSE_OK;
}

/* Z'Z = L L' + W. scratch: 4 nx squares and nx. */
static enum dse_status collect(const struct dse_second_order *filter, bool noise, const dse_real *L,
                               dse_real *W, dse_real *scratch)
{
    const int n = filter->nx;
    if (!noise) {
        dse_mat_transpose(n, n, L, filter->Z_next);
        return DSE_OK;
    }
    dse_real *root = second_order_piece(&scratch, n * n);
    dse_real *A = second_order_piece(&scratch, 2 * n * n); /* [L, root'] */
    dse_sym_enforce(n, W);
    const enum dse_status status = second_order_root(n, W, root, scratch);
    if (status != DSE_OK)
        return status;
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++) {
            A[i * 2 * n + j] = L[i * n + j];
            A[i * 2 * n + n + j] = root[j * n + i];
        }
    }
    second_order_array(n, 2 * n, A, filter->Z_next);
    return DSE_OK;
}

static enum dse_status predict_moments(struct dse_second_order *filter, dse_real span,
                                       const dse_real *u, bool may_grow)
{
    const int n = filter->nx;
    const bool noise = filter->config->Q != NULL;
    const bool trace = filter->config->kind == DSE_SECOND_ORDER;
    const int count = n + (noise ? 2 : 1) * n * n;
    dse_real *scratch = filter->scratch;
    dse_real *z = second_order_piece(&scratch, count);
    struct moments moments = {.filter = filter, .u = u, .trace = trace, .noise = noise};
    moments.J = second_order_piece(&scratch, n * n);
    moments.X = second_order_piece(&scratch, n * n);
    dse_real *L = z + n, *W = L + n * n;
    second_order_copy(n, filter->x, z);
    dse_mat_transpose(n, n, filter->Z, L);
    for (int k = 0; noise && k < n * n; k++)
        W[k] = 0;
    /* |w|^2 + |L|^2 = |w|^2 + tr S; without the trace term only |w|^2 cannot grow */
    const int guarded = trace ? n + n * n : n;
    enum dse_status status = second_order_integrate(filter, moments_rhs, &moments, may_grow, span,
                                                    count, guarded, z, scratch);
    if (status == DSE_OK)
        status = collect(filter, noise, L, W, scratch);
    if (status != DSE_OK)
        return status;
    second_order_copy(n, z, filter->x_next);
    return DSE_OK;
}

static enum dse_status predict_points(struct dse_second_order *filter, dse_real span,
                                      const dse_real *u, bool may_grow)
{
    const int n = filter->nx;
    dse_real *scratch = filter->scratch;
    dse_real *points = second_order_piece(&scratch, 2 * n * n);
    struct dse_held_model plant = {filter->config->model, u};
    second_order_place_points(filter, points);
    for (int p = 0; p < 2 * n; p++) {
        const enum dse_status status = second_order_integrate(
            filter, dse_held_model_rhs, &plant, may_grow, span, n, n, points + p * n, scratch);
        if (status != DSE_OK)
            return status;
    }
    return second_order_collect_points(filter, span, points, scratch);
}

static bool all_zero(int count, const dse_real *u)
{
    for (int i = 0; i < count; i++)
        if (u[i] != 0)
            return false;
    return true;
}

static enum dse_status predict(struct dse_second_order *filter, dse_real t, const dse_real *u)
{
    const int nu = filter->config->model->nu;
    const dse_real span = t - filter->time;
    if (!dse_is_finite(t) || !(span >= 0) || (nu > 0 && u == NULL))
        return DSE_EINVAL;
    if (nu > 0 && !dse_all_finite(u, nu))
        return DSE_ENONFINITE;
    if (span == 0)
        return DSE_OK;
    const bool may_grow = !filter->bounded || !all_zero(nu, u);
    const enum dse_status status = filter->config->kind == DSE_SECOND_ORDER_UNSCENTED
                                       ? predict_points(filter, span, u, may_grow)
                                       : predict_moments(filter, span, u, may_grow);
    if (status != DSE_OK)
        return status;
    if (!dse_all_finite(filter->x_next, filter->nx) ||
        !dse_all_finite(filter->Z_next, filter->nx * filter->nx))
        return DSE_ENONFINITE;
    second_order_exchange(filter);
    filter->time = t;
    return DSE_OK;
}

enum dse_status dse_second_order_predict(struct dse_second_order *filter, dse_real t,
                                         const dse_real *u)
{
    const enum dse_status status = predict(filter, t, u);
    if (status != DSE_OK) {
        filter->counts.failed++;
        filter->health = DSE_HEALTH_DIVERGED;
        return status;
    }
    filter->counts.predictions++;
    if (filter->counts.used == 0)
        filter->health = DSE_HEALTH_INITIALISING;
    else if (filter->predicted)
        filter->health = DSE_HEALTH_COASTING;
    else if (filter->health == DSE_HEALTH_DIVERGED)
        filter->health = DSE_HEALTH_TRACKING;
    filter->predicted = true;
    return DSE_OK;
}
