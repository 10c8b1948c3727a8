/* Second-order filter's baseline: the unscented transformation of section 4.8. */
#include "dse/linalg.h"
#include "dse/math.h"
#include "second_order_internal.h"

#define LARGEST_SWEEPS 30

/* Rotates two rows a, b so that they become orthogonal (one-sided Jacobi): with p = a'a, q = b'b
 * and r = a'b the tangent t of the angle solves t^2 + 2 t (q - p) / (2 r) - 1 = 0. Whether it
 * turned. */
static bool orthogonalise(int n, dse_real *a, dse_real *b)
{
    const dse_real p = dse_dot(n, a, a), q = dse_dot(n, b, b), r = dse_dot(n, a, b);
    if (!(dse_abs(r) > DSE_REAL_EPSILON * dse_sqrt(p) * dse_sqrt(q)))
        return false;
    const dse_real zeta = (q - p) / (2 * r);
    const dse_real size = 1 / (dse_abs(zeta) + dse_sqrt(1 + zeta * zeta));
    const dse_real t = zeta < 0 ? -size : size;
    const dse_real c = 1 / dse_sqrt(1 + t * t), s = c * t;
    for (int i = 0; i < n; i++) {
        const dse_real a_i = a[i];
        a[i] = c * a_i - s * b[i];
        b[i] = s * a_i + c * b[i];
    }
    return true;
}

/* S^(1/2) from its eigenvectors: rotations leave Z'Z as it is; when all rows are orthogonal they
 * are the eigenvectors of S, each times the root of its eigenvalue. They converge quadratically;
 * rows that are not quite orthogonal are a root of S all the same. */
static void principal_axes(int n, dse_real *Z)
{
    bool turned = true;
    for (int sweep = 0; turned && sweep < LARGEST_SWEEPS; sweep++) {
        turned = false;
        for (int p = 0; p < n; p++)
            for (int q = p + 1; q < n; q++)
                turned = orthogonalise(n, Z + p * n, Z + q * n) || turned;
    }
}

/* w +- sqrt(n) z_r for the axes z_r of S, each of weight 1 / (2 n): their covariance is S. */
void second_order_place_points(struct dse_second_order *filter, dse_real *points)
{
    const int n = filter->nx;
    const dse_real spread = dse_sqrt((dse_real)n);
    principal_axes(n, filter->Z);
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
enum dse_status second_order_collect_points(struct dse_second_order *filter, dse_real span,
                                            const dse_real *points, dse_real *scratch)
{
    const int n = filter->nx;
    mean_of(n, points, filter->x_next);
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
