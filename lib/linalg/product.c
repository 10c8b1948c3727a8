/* Products of matrices and vectors. */
#include "combine_internal.h"
#include "dse/linalg.h"

static void set_zero(int n, dse_real *x)
{
    for (int i = 0; i < n; i++)
        x[i] = 0;
}

void dse_mat_mul(int m, int k, int n, const dse_real *A, const dse_real *B, dse_real *C)
{
    set_zero(m * n, C);
    for (int i = 0; i < m; i++) /* C_i = sum_p A_ip B_p */
        combine_add(n, k, A + i * k, 1, B, n, C + i * n);
}

void dse_mat_mul_tn(int m, int k, int n, const dse_real *A, const dse_real *B, dse_real *C)
{
    set_zero(m * n, C);
    for (int i = 0; i < m; i++) /* C_i = sum_p A_pi B_p */
        combine_add(n, k, A + i, m, B, n, C + i * n);
}

void dse_mat_mul_nt(int m, int k, int n, const dse_real *A, const dse_real *B, dse_real *C)
{
    for (int i = 0; i < m; i++)
        for (int j = 0; j < n; j++)
            C[i * n + j] = dse_dot(k, A + i * k, B + j * k);
}

void dse_mat_vec(int m, int n, const dse_real *A, const dse_real *x, dse_real *y)
{
    for (int i = 0; i < m; i++)
        y[i] = dse_dot(n, A + i * n, x);
}

void dse_mat_tvec(int m, int n, const dse_real *A, const dse_real *x, dse_real *y)
{
    set_zero(n, y);
    combine_add(n, m, x, 1, A, n, y);
}
