/* Lyapunov's function |x|^2 / 2 of a quadratic system. */
#include "dse/factored.h"
#include "dse/math.h"
#include "dse/quadratic.h"

/* The cubic x'q(x) has, for each product of three states, the sum of all terms that give it. */
static bool same_product(const struct dse_quadratic_term *a, const struct dse_quadratic_term *b)
{
    /* sorted: the largest of k, i, j is max(k, j), the smallest min(k, i) */
    const int high_a = a->k > a->j ? a->k : a->j, high_b = b->k > b->j ? b->k : b->j;
    const int low_a = a->k < a->i ? a->k : a->i, low_b = b->k < b->i ? b->k : b->i;
    return high_a == high_b && low_a == low_b && a->k + a->i + a->j == b->k + b->i + b->j;
}

static dse_real largest_cubic(const struct dse_quadratic *system, dse_real *largest_term)
{
    dse_real largest = 0;
    *largest_term = 0;
    for (int s = 0; s < system->terms; s++) {
        dse_real sum = 0;
        for (int r = 0; r < system->terms; r++)
            if (same_product(&system->term[s], &system->term[r]))
                sum += system->term[r].value;
        largest = dse_max(largest, dse_abs(sum));
        *largest_term = dse_max(*largest_term, dse_abs(system->term[s].value));
    }
    return largest;
}

enum dse_status dse_quadratic_certify(int nx, const struct dse_quadratic *system,
                                      struct dse_quadratic_certificate *certificate,
                                      dse_real *scratch)
{
    dse_real *dissipation = scratch;
    dse_real *rows = dissipation + nx * nx;
    dse_real *weights = rows + nx * nx;
    const enum dse_status status = dse_quadratic_check(nx, 0, 0, system);
    if (status != DSE_OK)
        return status;
    for (int i = 0; i < nx; i++)
        for (int j = 0; j < nx; j++)
            dissipation[i * nx + j] = -(system->A[i * nx + j] + system->A[j * nx + i]) / 2;
    certificate->dissipative = dse_semidefinite_rows(nx, nx, dissipation, rows, weights) == DSE_OK;
    dse_real largest_term = 0;
    const dse_real cubic = largest_cubic(system, &largest_term);
    certificate->cubic = largest_term > 0 ? cubic / largest_term : 0;
    certificate->lossless = certificate->cubic <= (dse_real)(16 * nx) * DSE_REAL_EPSILON;
    return DSE_OK;
}
