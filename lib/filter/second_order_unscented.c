/* Second-order filter's baseline: the unscented transformation of section 4.8. */
#include "dse/linalg.h"
#include "dse/math.h"
#include "second_order_internal.h"

/* w +- sqrt(n) z_r for the rows z_r of Z, each of weight 1 / (2 n): their covariance is Z'Z. */
static void place_points(const struct dse_second_order *filter, dse_real *points)
{
    const int n = filter->nx;
    const dse_real spread = dse_sqrt((dse_real)n);
    for (int r = 0; r < n; r++) {
        for (int i = 0; i < n; i++) {
            const dse_real step = spread * filter->Z[r * n + i];
            points[2 * r * n + i] = filter->x[i] + step;
            points[(2 * r + 1) * n + i] = filter->x[i] - step;
        }
    }
}

static void mean_of(int n, const dse_real *points, dse_real *mean)
{
    for (int i = 0; i < n; i++) {
        mean[i] = 0;
        for (int p = 0; p < 2 * n; p++)
            mean[i] += points[p * n + i];
        mean[i] /= (dse_real)(2 * n);
    }
}

/* Z'Z = sum_p (p - w)(p - w)' / (2 n) + span Q, from [the deviations, sqrt(span) Q^(1/2)]. */
static enum dse_status spread_of(struct dse_second_order *filter, dse_real span,
                                 const dse_real *points, dse_real *scratch)
{
    const int n = filter->nx;
    const dse_real *Q = filter->config->Q;
    const int columns = Q != NULL ? 3 * n : 2 * n;
    const dse_real weight = 1 / dse_sqrt((dse_real)(2 * n));
    const dse_real noise = dse_sqrt(span);
    dse_real *A = second_order_piece(&scratch, n * columns);
    for (int i = 0; i < n; i++)
        for (int p = 0; p < 2 * n; p++)
            A[i * columns + p] = weight * (points[p * n + i] - filter->x_next[i]);
    if (Q != NULL) {
        dse_real *root = second_order_piece(&scratch, n * n);
        const enum dse_status status = second_order_root(n, Q, root, scratch);
        if (status != DSE_OK)
            return status;
        for (int i = 0; i < n; i++)
            for (int r = 0; r < n; r++)
                A[i * columns + 2 * n + r] = noise * root[r * n + i];
    }
    second_order_array(n, columns, A, filter->Z_next);
    return DSE_OK;
}

enum dse_status second_order_predict_unscented(struct dse_second_order *filter, dse_real span,
                                               const dse_real *u, bool may_grow)
{
    const int n = filter->nx;
    dse_real *scratch = filter->scratch;
    dse_real *points = second_order_piece(&scratch, 2 * n * n);
    struct dse_held_model plant = {filter->config->model, u};
    place_points(filter, points);
    for (int p = 0; p < 2 * n; p++) {
        const enum dse_status status = second_order_integrate(
            filter, dse_held_model_rhs, &plant, may_grow, span, n, n, points + p * n, scratch);
        if (status != DSE_OK)
            return status;
    }
    mean_of(n, points, filter->x_next);
    return spread_of(filter, span, points, scratch);
}
