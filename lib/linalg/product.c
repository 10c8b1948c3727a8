/* Products of matrices and vectors. */
#include "combine_internal.h"
#include "dot_internal.h"
#include "dse/linalg.h"

void dse_mat_mul(int m, int k, int n, const dse_real *A, const dse_real *B, dse_real *C)
{
    for (int i = 0; i < m; i++) /* C_i = sum_p A_ip B_p */
        combine(n, k, A + i * k, 1, B, n, 1, false, C + i * n, C + i * n);
}

void dse_mat_mul_add(int m, int k, int n, const dse_real *A, const dse_real *B, const dse_real *D,
                     dse_real *C)
{
    for (int i = 0; i < m; i++)
        combine(n, k, A + i * k, 1, B, n, 1, true, D + i * n, C + i * n);
}

void dse_mat_mul_subtract(int m, int k, int n, const dse_real *A, const dse_real *B,
                          const dse_real *D, dse_real *C)
{
    for (int i = 0; i < m; i++)
        combine(n, k, A + i * k, 1, B, n, -1, true, D + i * n, C + i * n);
}

void dse_mat_mul_tn(int m, int k, int n, const dse_real *A, const dse_real *B, dse_real *C)
{
    for (int i = 0; i < m; i++) /* C_i = sum_p A_pi B_p */
        combine(n, k, A + i, m, B, n, 1, false, C + i * n, C + i * n);
}

void dse_mat_mul_nt(int m, int k, int n, const dse_real *A, const dse_real *B, dse_real *C)
{
    for (int i = 0; i < m; i++)
        for (int j = 0; j < n; j++)
            C[i * n + j] = dot(k, A + i * k, B + j * k);
}

void dse_mat_vec(int m, int n, const dse_real *A, const dse_real *x, dse_real *y)
{
    for (int i = 0; i < m; i++)
        y[i] = dot(n, A + i * n, x);
}

void dse_mat_vec_add(int m, int n, const dse_real *A, const dse_real *x, const dse_real *z,
                     dse_real *y)
{
    for (int i = 0; i < m; i++)
        y[i] = z[i] + dot(n, A + i * n, x);
}

void dse_mat_tvec(int m, int n, const dse_real *A, const dse_real *x, dse_real *y)
{
    combine(n, m, x, 1, A, n, 1, false, y, y);
}

void dse_mat_tvec_add(int m, int n, const dse_real *A, const dse_real *x, const dse_real *z,
                      dse_real *y)
{
    combine(n, m, x, 1, A, n, 1, true, z, y);
}
