/* Pivoted factorisation of a positive semidefinite matrix. */
#include <stdbool.h>

#include "dse/factored.h"
#include "dse/linalg.h"
#include "dse/math.h"

#define NOT_DONE DSE_REAL(-1.0)

/* The index whose variance has kept the largest fraction of what it was; -1 when all are done.
 * Fractions, not variances, so that states of very different units are treated alike. */
static int next_pivot(int n, int s, const dse_real *P, const dse_real *Y, const dse_real *d)
{
    int best = -1;
    for (int i = 0; i < n; i++) {
        if (d[i] != NOT_DONE)
            continue;
        const dse_real kept = Y[i * s + i], was = P[i * n + i];
        if (best < 0 || P[best * n + best] == 0 ||
            kept * P[best * n + best] > Y[best * s + best] * was)
            best = i;
    }
    return best;
}

/* Whether what is left after the last pivot is rounding only: |Y_ij| <= c sqrt(P_ii P_jj). */
static bool is_rounding(int n, int s, const dse_real *P, const dse_real *Y, const dse_real *d,
                        dse_real c)
{
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++) {
            if (d[i] != NOT_DONE || d[j] != NOT_DONE)
                continue;
            const dse_real size = dse_sqrt(P[i * n + i]) * dse_sqrt(P[j * n + j]);
            if (!(dse_abs(Y[i * s + j]) <= c * size))
                return false;
        }
    }
    return true;
}

/* Outer-product elimination with diagonal pivots p, in place:
 *     d_p = Y_pp,  Y_p <- Y_p / d_p,  Y_i <- Y_i - Y_ip Y_p  for all i not done. */
enum dse_status dse_semidefinite_rows(int n, int s, const dse_real *P, dse_real *Y, dse_real *d)
{
    const dse_real rounding = (dse_real)(16 * n) * DSE_REAL_EPSILON;
    if (!dse_all_finite(P, n * n))
        return DSE_ENONFINITE;
    for (int i = 0; i < n; i++) {
        if (P[i * n + i] < 0)
            return DSE_ENOTPD;
        d[i] = NOT_DONE;
        for (int j = i; j < n; j++) {
            Y[i * s + j] = P[i * n + j];
            Y[j * s + i] = P[i * n + j];
        }
    }
    for (int k = 0; k < n; k++) {
        const int p = next_pivot(n, s, P, Y, d);
        dse_real *y = Y + p * s;
        if (!(y[p] > rounding * P[p * n + p])) {
            if (!is_rounding(n, s, P, Y, d, rounding))
                return DSE_ENOTPD;
            break;
        }
        d[p] = y[p];
        for (int j = 0; j < n; j++)
            y[j] = d[j] == NOT_DONE ? y[j] / d[p] : 0;
        y[p] = 1;
        for (int i = 0; i < n; i++)
            if (d[i] == NOT_DONE)
                dse_axpy(n, -Y[i * s + p], y, Y + i * s);
    }
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n && d[i] == NOT_DONE; j++)
            Y[i * s + j] = 0;
        d[i] = d[i] == NOT_DONE ? 0 : d[i];
    }
    return DSE_OK;
}
