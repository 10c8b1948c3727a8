/* Symmetric positive definite block-tridiagonal systems. */
#include "chain_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"

void mhe_chain_take(struct dse_mhe_chain *chain, int n, int capacity, struct dse_arena *arena)
{
    chain->n = n;
    chain->length = 0;
    chain->D = dse_arena_take(arena, capacity * n * n);
    chain->U = dse_arena_take(arena, (capacity - 1) * n * n);
    chain->L = dse_arena_take(arena, capacity * n * n);
    chain->V = dse_arena_take(arena, (capacity - 1) * n * n);
    chain->work = dse_arena_take(arena, n);
}

/* S (n x n) -= V' V, both triangles. */
static void subtract_square(int n, const dse_real *V, dse_real *S)
{
    for (int p = 0; p < n; p++)
        for (int i = 0; i < n; i++)
            dse_axpy(n, -V[p * n + i], V + p * n, S + i * n);
}

enum dse_status mhe_chain_factor(struct dse_mhe_chain *chain)
{
    const int n = chain->n, size = n * n;
    for (int t = 0; t < chain->length; t++) {
        dse_real *L = chain->L + t * size, *V = chain->V + t * size;
        for (int e = 0; e < size; e++)
            L[e] = chain->D[t * size + e];
        if (t > 0)
            subtract_square(n, V - size, L);
        const enum dse_status status = dse_cholesky(n, L, L);
        if (status != DSE_OK)
            return status;
        /* A pivot that is nothing but rounding beside its diagonal element is none; without data
         * it is about ten times the precision. */
        const dse_real least = (dse_real)(4 * (n + chain->length)) * DSE_REAL_EPSILON;
        for (int i = 0; i < n; i++) {
            const dse_real pivot = L[i * n + i];
            if (!(pivot * pivot > least * chain->D[t * size + i * n + i]))
                return DSE_ENOTPD;
        }
        if (t == chain->length - 1)
            break;
        for (int e = 0; e < size; e++)
            V[e] = chain->U[t * size + e];
        dse_lower_solve(n, L, n, V);
    }
    return DSE_OK;
}

void mhe_chain_solve(const struct dse_mhe_chain *chain, dse_real *x)
{
    const int n = chain->n, size = n * n, H = chain->length;
    for (int t = 0; t < H; t++) { /* L_t y_t = b_t - V_{t-1}' y_{t-1} */
        dse_real *y = x + t * n;
        const dse_real *V = chain->V + (t - 1) * size;
        for (int p = 0; p < n && t > 0; p++)
            dse_axpy(n, -y[p - n], V + p * n, y);
        dse_lower_solve(n, chain->L + t * size, 1, y);
    }
    for (int t = H - 1; t >= 0; t--) { /* L_t' x_t = y_t - V_t x_{t+1} */
        dse_real *y = x + t * n;
        const dse_real *V = chain->V + t * size;
        for (int p = 0; p < n && t < H - 1; p++)
            y[p] -= dse_dot(n, V + p * n, y + n);
        dse_lower_transpose_solve(n, chain->L + t * size, 1, y);
    }
}

void mhe_chain_multiply_row(const struct dse_mhe_chain *chain, const dse_real *x, int t,
                            dse_real *y)
{
    const int n = chain->n, size = n * n;
    const dse_real *U = chain->U + t * size;
    dse_mat_vec(n, n, chain->D + t * size, x + t * n, y);
    for (int i = 0; i < n && t > 0; i++)
        dse_axpy(n, x[(t - 1) * n + i], U - size + i * n, y);
    for (int i = 0; i < n && t < chain->length - 1; i++)
        y[i] += dse_dot(n, U + i * n, x + (t + 1) * n);
}

/* sum_j |m_j| |x_j| of a row or, with a stride, a column. */
static dse_real size_of(int n, int stride, const dse_real *m, const dse_real *x)
{
    dse_real sum = 0;
    for (int j = 0; j < n; j++)
        sum += dse_abs(m[j * stride] * x[j]);
    return sum;
}

dse_real mhe_chain_residual(const struct dse_mhe_chain *chain, const dse_real *x, const dse_real *b)
{
    const int n = chain->n, size = n * n, H = chain->length;
    dse_real worst = 0;
    for (int i = 0; i < n; i++) {
        dse_real residual = 0, terms = 0;
        for (int t = 0; t < H; t++) {
            const dse_real *U = chain->U + t * size, *at = x + t * n;
            mhe_chain_multiply_row(chain, x, t, chain->work);
            dse_real sum = size_of(n, 1, chain->D + t * size + i * n, at) + dse_abs(b[t * n + i]);
            sum += t > 0 ? size_of(n, n, U - size + i, at - n) : 0;
            sum += t < H - 1 ? size_of(n, 1, U + i * n, at + n) : 0;
            residual = dse_max(residual, dse_abs(chain->work[i] - b[t * n + i]));
            terms = dse_max(terms, sum);
        }
        worst = dse_max(worst, residual == 0 ? 0 : residual / terms);
    }
    return worst;
}
