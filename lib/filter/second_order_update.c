/* Second-order filter: what a measurement, or information from elsewhere, does to the estimate. */
#include "dse/linalg.h"
#include "dse/math.h"
#include "second_order_internal.h"

/* var(c x) + R_ll of channel l. */
static dse_real innovation_variance(const struct dse_second_order *filter, int l)
{
    const int n = filter->nx;
    const dse_real *c = filter->C + l * n;
    dse_real variance = filter->config->R[l * filter->ny + l];
    for (int i = 0; i < n; i++)
        variance += c[i] * dse_dot(n, filter->S + i * n, c);
    return variance;
}

void second_order_take(struct dse_second_order *filter, const struct dse_measurement *measurement)
{
    const dse_real gate = filter->config->gate;
    filter->used = 0;
    filter->rejected = false;
    for (int l = 0; l < filter->ny; l++) {
        const bool flagged = measurement->valid == NULL || measurement->valid[l];
        bool has = dse_measurement_has(measurement, l);
        filter->counts.missing += !flagged;
        filter->counts.nonfinite += flagged && !has;
        filter->y[l] = has ? measurement->y[l] : 0;
        const dse_real e =
            has ? filter->y[l] - dse_dot(filter->nx, filter->C + l * filter->nx, filter->x) : 0;
        filter->innovation[l] = e;
        if (has && gate > 0 && e * e > gate * gate * innovation_variance(filter, l)) {
            has = false;
            filter->rejected = true;
            filter->counts.rejected++;
        }
        filter->has[l] = has ? 1 : 0;
        filter->used += has;
    }
    filter->counts.used += filter->used;
}

/* L L' = R of the channels that there are. A part of a positive definite R, which init has
 * factored.
 */
static void factor_noise(const struct dse_second_order *filter, int count, dse_real *L)
{
    const int m = filter->ny;
    for (int l = 0, row = 0; l < m; l++) {
        if (filter->has[l] == 0)
            continue;
        for (int k = 0, column = 0; k < m; k++)
            if (filter->has[k] != 0)
                L[row * count + column++] = filter->config->R[l * m + k];
        row++;
    }
    (void)dse_cholesky(count, L, L);
}

/* H (count x nx) = R^-1/2 C and e = R^-1/2 y of the channels that there are: independent noises of
 * variance 1. Returns count. L: ny x ny, used when R is not diagonal. */
static int whiten(const struct dse_second_order *filter, const dse_real *y, dse_real *H,
                  dse_real *e, dse_real *L)
{
    const int n = filter->nx, m = filter->ny;
    int count = 0;
    for (int l = 0; l < m; l++) {
        if (filter->has[l] == 0)
            continue;
        const dse_real scale = filter->R_diagonal ? 1 / dse_sqrt(filter->config->R[l * m + l]) : 1;
        for (int i = 0; i < n; i++)
            H[count * n + i] = scale * filter->C[l * n + i];
        e[count++] = scale * y[l];
    }
    if (filter->R_diagonal)
        return count;
    factor_noise(filter, count, L);
    dse_lower_solve(count, L, n, H);
    dse_lower_solve(count, L, 1, e);
    return count;
}

/* Potter's update with one output y = h x + e, var e = 1, from S = Z'Z to (I - K h) S:
 *     f = Z h', a = 1 / (f'f + 1), K = a Z'f, Z <- Z - a / (1 + sqrt(a)) f (Z'f)' */
static void potter(int n, const dse_real *h, dse_real y, dse_real *x, dse_real *Z, dse_real *f,
                   dse_real *Zf)
{
    dse_mat_vec(n, n, Z, h, f);
    dse_mat_tvec(n, n, Z, f, Zf);
    const dse_real a = 1 / (dse_dot(n, f, f) + 1);
    const dse_real step = a / (1 + dse_sqrt(a));
    dse_axpy(n, a * (y - dse_dot(n, h, x)), Zf, x);
    for (int r = 0; r < n; r++)
        dse_axpy(n, -step * f[r], Zf, Z + r * n);
}

enum dse_status second_order_correct(struct dse_second_order *filter, const dse_real *Z,
                                     const dse_real *y)
{
    const int n = filter->nx, m = filter->ny;
    dse_real *scratch = filter->scratch;
    dse_real *H = second_order_piece(&scratch, m * n), *e = second_order_piece(&scratch, m);
    dse_real *f = second_order_piece(&scratch, n), *Zf = second_order_piece(&scratch, n);
    const int count = whiten(filter, y, H, e, scratch);
    second_order_copy(n, filter->x, filter->x_next);
    second_order_copy(n * n, Z, filter->Z_next);
    for (int l = 0; l < count; l++)
        potter(n, H + l * n, e[l], filter->x_next, filter->Z_next, f, Zf);
    const bool finite = dse_all_finite(filter->x_next, n) && dse_all_finite(filter->Z_next, n * n);
    return finite ? DSE_OK : DSE_ENONFINITE;
}

void second_order_information(struct dse_second_order *filter, dse_real *u, dse_real *Y)
{
    const int n = filter->nx, m = filter->ny;
    dse_real *scratch = filter->scratch;
    dse_real *H = second_order_piece(&scratch, m * n), *e = second_order_piece(&scratch, m);
    const int count = whiten(filter, filter->y, H, e, scratch);
    dse_mat_tvec(count, n, H, e, u);
    dse_mat_mul_tn(n, count, n, H, H, Y);
}

/* M = (I + S Y)^-1 S = Z'(I + Z Y Z')^-1 Z = (L^-1 Z)'(L^-1 Z) with I + Z Y Z' = L L';
 * x = w + M (u - Y w). */
enum dse_status second_order_inform(struct dse_second_order *filter, const dse_real *u,
                                    const dse_real *Y)
{
    const int n = filter->nx;
    dse_real *scratch = filter->scratch;
    dse_real *G = second_order_piece(&scratch, n * n), *rest = second_order_piece(&scratch, n);
    dse_real *Zr = second_order_piece(&scratch, n), *x = filter->x_next, *Z = filter->Z_next;
    dse_sym_congruence(n, n, filter->Z, Y, NULL, G, scratch);
    for (int i = 0; i < n; i++)
        G[i * n + i] += 1;
    if (!dse_all_finite(G, n * n))
        return DSE_ENONFINITE;
    const enum dse_status status = dse_cholesky(n, G, G);
    if (status != DSE_OK)
        return status;
    second_order_copy(n * n, filter->Z, Z);
    dse_lower_solve(n, G, n, Z);
    dse_mat_vec(n, n, Y, filter->x, rest);
    for (int i = 0; i < n; i++)
        rest[i] = u[i] - rest[i];
    dse_mat_vec(n, n, Z, rest, Zr);
    dse_mat_tvec(n, n, Z, Zr, x);
    for (int i = 0; i < n; i++)
        x[i] += filter->x[i];
    return dse_all_finite(x, n) && dse_all_finite(Z, n * n) ? DSE_OK : DSE_ENONFINITE;
}

enum dse_status dse_second_order_update(struct dse_second_order *filter,
                                        const struct dse_measurement *measurement)
{
    second_order_take(filter, measurement);
    const enum dse_status status = second_order_correct(filter, filter->Z, filter->y);
    filter->predicted = false;
    if (status != DSE_OK) {
        filter->counts.failed++;
        filter->health = DSE_HEALTH_DIVERGED;
        return status;
    }
    second_order_exchange(filter);
    filter->counts.updates++;
    if (filter->counts.used == 0)
        filter->health = DSE_HEALTH_INITIALISING;
    else if (filter->rejected)
        filter->health = DSE_HEALTH_REJECTING;
    else
        filter->health = filter->used > 0 ? DSE_HEALTH_TRACKING : DSE_HEALTH_COASTING;
    return DSE_OK;
}
